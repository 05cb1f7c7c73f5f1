"""Runs the console script as ``python -m hab_ppo``, as the ranks of a run do."""

import sys

from hab_ppo.cli import main

if __name__ == "__main__":
    sys.exit(main())
