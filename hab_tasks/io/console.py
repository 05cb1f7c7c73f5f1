"""Common entry point of the console scripts: parse, run, report errors in one line on stderr."""

from __future__ import annotations

import io
import os
import pkgutil
import select
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import ClassVar

from hab_tasks import limits
from hab_tasks.errors import HabError, RunStoppedError
from hab_tasks.options import one_line, parse_command

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
            if not limits.advice(error):
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
        reason, advice = str(message) or type(message).__name__, limits.advice(message)
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
