"""Command-line parsing, with one-line errors for invalid options."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import reduce
from operator import or_
from typing import Annotated, Any

import tyro

from hab_tasks.errors import HabError, UnknownNameError

LONGEST_MESSAGE = 1000
"""Maximum length of a message on stderr; longer ones are abbreviated in the middle."""

PLAIN_WORDS = {
    "invalid literal for int() with base 10": "not a whole number",
    "could not convert string to float": "not a number",
}
"""Python's messages for values of the wrong type -> ours."""


def check_options(
    program: str, commands: Mapping[str, type], arguments: Sequence[str] | None
) -> None:
    """Reports unknown CLI options and subcommands with the nearest match, before parsing.

    Args:
        program: Name of the console script.
        commands: Subcommand -> dataclass of its options.
        arguments: Arguments after the program's name.

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


def parse_command(
    program: str, commands: Mapping[str, Any], arguments: Sequence[str], description: str
) -> Any:
    """Returns the parsed options of the subcommand.

    Args:
        program: Name of the console script.
        commands: Subcommand -> dataclass of its options, whose `help` is the text of `--help`.
        arguments: Arguments after the program's name.
        description: Description of a program with several subcommands.

    Raises:
        HabError: An unknown or missing option, or a value of the wrong type.
        SystemExit: With status 0, after `--help`.
    """
    check_options(program, commands, arguments)
    if len(commands) == 1:
        return _parse_only_command(program, commands, list(arguments))
    kinds = [
        Annotated[options, tyro.conf.subcommand(name, description=options.help)]
        for name, options in commands.items()
    ]
    known = [word for word in arguments[:1] if word in commands]
    return _parse(reduce(or_, kinds), program, arguments, description, " ".join([program, *known]))


def one_line(message: object) -> str:
    """Returns a message without line breaks and control characters, abbreviated if long."""
    words = " ".join(str(message).split())
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in words)
    if len(text) <= LONGEST_MESSAGE:
        return text
    half = LONGEST_MESSAGE // 2
    return f"{text[:half]} ... {text[-half:]}"


def _parse_only_command(program: str, commands: Mapping[str, Any], arguments: list[str]) -> Any:
    """Returns the parsed options of the only subcommand; its help is the program's help."""
    ((name, options),) = commands.items()
    if arguments[:1] in (["--help"], ["-h"]):
        arguments = [name, "--help"]
    if arguments[:1] != [name]:
        raise HabError(f"Expected the command {name}. Help: {program} --help")
    called = f"{program} {name}"
    return _parse(options, called, arguments[1:], options.help, called)


def _parse(kind: Any, program: str, arguments: Sequence[str], description: str, helped: str) -> Any:
    """Runs the parser; errors refer to the `--help` of the command `helped`."""
    told = io.StringIO()
    try:
        with contextlib.redirect_stderr(told):
            return tyro.cli(
                kind,
                prog=program,
                description=description,
                args=arguments,
                config=(tyro.conf.FlagCreatePairsOff,),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
    raise HabError(f"{_without_box(told.getvalue())} Help: {helped} --help")


def _without_box(text: str) -> str:
    """Returns the message in the parser's error box, without title and help."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", text)
    lines = [line.strip("│ \t") for line in plain.splitlines() if line[:1] not in "╭╰"]
    parts: list[list[str]] = [[]]
    for line in lines:
        if len(line) > 1 and set(line) in ({"─"}, {"-"}):
            parts.append([])
        else:
            parts[-1].append(line)
    # On terminals without box characters, the title is a line with its own rule.
    body = parts[1] if len(parts) > 1 and len(parts[0]) == 1 and "╭" not in plain else parts[0]
    said = " ".join(body)
    for words, ours in PLAIN_WORDS.items():
        said = said.replace(words, ours)
    return f"{said.strip().rstrip('.')}."
