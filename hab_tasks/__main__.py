"""`python -m hab_tasks` is the console script `hab-tasks`."""

import sys

from hab_tasks.cli import main

sys.exit(main())
