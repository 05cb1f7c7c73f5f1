"""`hab-eval` on the stub environment. Spawned workers import this file too, so they see it."""

import sys

import stub_hab
from hab_eval.cli import main

stub_hab.install()

if __name__ == "__main__":
    sys.exit(main())
