"""The console script `hab-tasks`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import reduce
from operator import or_
from typing import Annotated, Any

import tyro

from hab_tasks.commands import COMMANDS
from hab_tasks.errors import HabError
from hab_tasks.options import check_options

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs `hab-tasks`; returns its exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        check_options("hab-tasks", COMMANDS, arguments)
        command = tyro.cli(
            _any_command(),
            prog="hab-tasks",
            description="Environments, datasets and episodes of hab-tasks.",
            args=arguments,
            config=(tyro.conf.FlagCreatePairsOff,),
        )
        return command.run()
    except HabError as error:
        print(f"hab-tasks: {' '.join(str(error).split())}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("hab-tasks: interrupted.", file=sys.stderr)
        return EXIT_INTERRUPTED


def _any_command() -> Any:
    """Returns the union of all subcommands' options, as tyro reads it."""
    kinds: list[Any] = [
        Annotated[options, tyro.conf.subcommand(name, description=options.help)]
        for name, options in COMMANDS.items()
    ]
    return reduce(or_, kinds)
