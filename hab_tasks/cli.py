"""The console script `hab-tasks`."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from hab_tasks.commands import COMMANDS
from hab_tasks.errors import HabError
from hab_tasks.options import one_line, parse_command

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-tasks`; returns its exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        command = parse_command(
            "hab-tasks", COMMANDS, arguments, "Environments, datasets and episodes of hab-tasks."
        )
        return command.run()
    except HabError as error:
        print(f"hab-tasks: {one_line(error)}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("hab-tasks: interrupted.", file=sys.stderr)
        return EXIT_INTERRUPTED
