"""A mistyped subcommand or option, told in one line like every other bad name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields

from hab_tasks.errors import UnknownNameError


def check_options(
    program: str, commands: Mapping[str, type], arguments: Sequence[str] | None
) -> None:
    """Refuses subcommands and options that do not exist, before the parser sees them.

    Args:
        program: Name of the console script.
        commands: Subcommand -> the dataclass of its options.
        arguments: What was typed after the program's name.

    Raises:
        UnknownNameError: With the valid names and the nearest match.
    """
    typed = list(arguments or ())
    if not typed or typed[0].startswith("-"):
        return
    command = typed[0]
    if command not in commands:
        raise UnknownNameError(f"command of {program}", command, commands)
    valid = {"--help", *(f"--{f.name.replace('_', '-')}" for f in fields(commands[command]))}
    for word in typed[1:]:
        option = word.split("=", 1)[0].replace("_", "-")
        if word.startswith("--") and option not in valid:
            raise UnknownNameError(f"option of {program} {command}", word, valid)
