"""Entry point of the console scripts: parses options, runs, reports progress and errors."""

from __future__ import annotations

import contextlib
import io
import os
import pkgutil
import re
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import reduce
from operator import or_
from types import FrameType
from typing import Annotated, Any, ClassVar

import tyro
from tqdm import tqdm

from hab_tasks.errors import HabError, RunStoppedError, UnknownNameError, limit_advice

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
    """Reports unknown CLI options and subcommands, before parsing.

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
    """Returns the parsed options of the subcommand; their `help` is the text of `--help`.

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


EXIT_STOPPED = 1
EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130
EXIT_UNREAD = 141
"""The status of a program that SIGPIPE ends, as the other programs of a shell's pipe."""

IMPORT_POLL_S = 0.05
"""An interrupt during an import is tried again after this time."""


@dataclass(frozen=True, kw_only=True)
class Command:
    """Options of one subcommand.

    The module of the options does not import the simulator, to keep `--help` fast; that of the
    work imports what it needs.

    Attributes:
        help: Text of `--help`, with an example.
        work: ``module:function`` that runs the command, given its options.
        verbose: Whether to print the traceback of a stopped run; an option of some subcommands.
    """

    help: ClassVar[str]
    work: ClassVar[str]
    verbose = False

    def run(self) -> int:
        """Imports the work and does it; returns the exit status.

        Raises:
            HabError: Bad input.
            RunStoppedError: The run started and could not be finished.
        """
        status: int = pkgutil.resolve_name(self.work)(self)
        return status

    def advice(self) -> str:
        """Returns the message after Ctrl-C: what was kept, and how to resume."""
        return ""


def run_script(
    program: str,
    commands: Mapping[str, type[Command]],
    arguments: Sequence[str] | None,
    description: str = "",
) -> int:
    """Runs a console script; returns its exit status.

    Args:
        program: Name of the console script.
        commands: Subcommand -> options.
        arguments: Arguments after the program's name; None for those of the process.
        description: Description of a program with several subcommands.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a locale may lack characters of names and tables
            stream.reconfigure(errors="backslashreplace")
    command = None
    with _interruptible():
        try:
            try:
                command = parse_command(program, commands, arguments, description)
                return command.run()
            finally:
                sys.stdout.flush()  # of a help text too
        except RunStoppedError as error:
            say(program, error)
            if command is not None and command.verbose:
                sys.stderr.write(error.details)
            return EXIT_STOPPED
        except HabError as error:
            say(program, error)
            return EXIT_BAD_INPUT
        except OSError as error:  # from stdout or a disk
            if isinstance(error, BrokenPipeError) and _nobody_reads():
                return EXIT_UNREAD
            say(program, error)
            return EXIT_STOPPED
        except KeyboardInterrupt:
            say(program, f"interrupted. {'' if command is None else command.advice()}")
            return EXIT_INTERRUPTED
        except Exception as error:
            if not limit_advice(error):
                raise
            say(program, error)
            return EXIT_STOPPED


def _nobody_reads() -> bool:
    """Whether the reader of standard output has ended, as ``head`` does; discards the rest then."""
    output = sys.stdout.fileno()
    unread = select.poll()
    unread.register(output, 0)
    if not any(event & select.POLLERR for _, event in unread.poll(0)):
        return False
    os.dup2(os.open(os.devnull, os.O_WRONLY), output)
    return True


def tell(text: object) -> None:
    """Writes a line to stdout at once, for who watches a log."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def say(program: str, message: object) -> None:
    """Writes a message or an error, with advice, to stderr in one line."""
    if isinstance(message, BaseException):
        reason, advice = str(message) or type(message).__name__, limit_advice(message)
        message = f"{reason.rstrip('.')}. {advice}" if advice else reason
    sys.stderr.write(f"{program}: {one_line(message)}\n")


@contextmanager
def _interruptible() -> Iterator[None]:
    """Turns Ctrl-C and SIGTERM, which schedulers of clusters send, into KeyboardInterrupt."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {n: signal.signal(n, _interrupt) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


def _interrupt(signal_number: int, frame: FrameType | None) -> None:
    """Raises KeyboardInterrupt, after an import: trimesh catches it in those of its own."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            again = threading.Timer(IMPORT_POLL_S, os.kill, (os.getpid(), signal_number))
            again.daemon = True
            again.start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt


LINE_INTERVAL_S = 10.0


class GenerationLines:
    """Writes a line every `LINE_INTERVAL_S`, and at the end."""

    def __init__(self, write_line: Callable[[str], None]) -> None:
        self._write = write_line
        self._last_line_s = time.monotonic()

    def show(self, done: int, total: int) -> None:
        """Writes a line, if one is due."""
        now_s = time.monotonic()
        if done < total and now_s - self._last_line_s < LINE_INTERVAL_S:
            return
        self._last_line_s = now_s
        self._write(f"generated {done} of {total} episodes")


@contextmanager
def progress_bar(
    unit: str, line: Callable[[int, int], None] | None = None
) -> Iterator[Callable[[int, int], None]]:
    """Yields a function that shows (done, all): a bar on a terminal, elsewhere it calls `line`."""
    with tqdm(unit=unit, disable=None) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)
            if bar.disable and line is not None:
                line(done, total)

        yield show
