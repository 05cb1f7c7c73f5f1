"""Exit status of console scripts, and one-line errors on stderr."""

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from typing import ClassVar

import pytest

from hab_tasks.console import Command, run_script
from hab_tasks.errors import HabError, RunStoppedError


def interrupt():
    os.kill(os.getpid(), signal.SIGTERM)
    signal.pause()


def fail(error):
    raise error


STOPPED = RunStoppedError("It stopped.", details="Traceback\n")
ENDINGS = {
    "done": (lambda: 0, 0, ""),
    "bad": (lambda: fail(HabError("no\nsuch thing")), 2, "prog: no such thing\n"),
    "stopped": (lambda: fail(STOPPED), 1, "prog: It stopped.\n"),
    "stopped --verbose": (lambda: fail(STOPPED), 1, "prog: It stopped.\nTraceback\n"),
    "disk": (lambda: fail(OSError(28, "No space left")), 1, "prog: [Errno 28] No space left\n"),
    "ctrl-c": (lambda: fail(KeyboardInterrupt()), 130, "prog: interrupted. Half is kept.\n"),
    "sigterm": (interrupt, 130, "prog: interrupted. Half is kept.\n"),
}


@dataclass(frozen=True, kw_only=True)
class End(Command):
    """Ends as it is told."""

    help: ClassVar[str] = "Ends as it is told."

    how: str
    """One of `ENDINGS`."""
    verbose: bool = False
    """Show the traceback."""

    def run(self):
        return ENDINGS[self.how][0]()

    def advice(self):
        return "Half is kept."


@pytest.mark.parametrize("how", ENDINGS)
def test_every_end_has_its_status_and_one_line(how, capsys):
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    _, code, line = ENDINGS[how]
    assert run_script("prog", {"end": End}, ["end", "--how", *how.split()]) == code
    assert capsys.readouterr().err == line
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_characters_that_a_locale_lacks_are_escaped():
    code = (
        "import sys; from hab_tasks.console import run_script; sys.exit(run_script('p', {}, ['†']))"
    )
    environment = {**os.environ, "PYTHONIOENCODING": "latin-1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    assert (done.returncode, b"Traceback" in done.stderr) == (2, False)
    assert b"\\u2020" in done.stderr
