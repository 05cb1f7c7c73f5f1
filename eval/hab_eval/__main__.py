"""`python -m hab_eval` is `hab-eval`."""

import sys

from hab_eval.cli import main

if __name__ == "__main__":
    sys.exit(main())
