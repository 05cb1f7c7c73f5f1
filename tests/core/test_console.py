"""Exit status of console scripts, and one-line errors on stderr."""

import importlib
import os
import signal
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


CATCHES_ALL = """
import os, signal

try:
    os.kill(os.getpid(), signal.SIGINT)
    signal.sigtimedwait([], 0.2)  # longer than it takes to try again
    caught = False
except BaseException:
    caught = True
"""


@pytest.mark.parametrize("how", ENDINGS)
def test_every_end_has_its_status_and_one_line(how, capsys):
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    _, code, line = ENDINGS[how]
    assert run_script("prog", {"end": End}, ["end", "--how", *how.split()]) == code
    assert capsys.readouterr().err == line
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_an_import_that_catches_everything_does_not_swallow_ctrl_c(tmp_path, monkeypatch, capsys):
    (tmp_path / "catches_all.py").write_text(CATCHES_ALL)
    monkeypatch.syspath_prepend(tmp_path)

    def import_and_wait():
        assert not importlib.import_module("catches_all").caught
        signal.pause()

    monkeypatch.setitem(ENDINGS, "import", (import_and_wait, 130, ""))
    assert run_script("prog", {"end": End}, ["end", "--how", "import"]) == 130
    assert capsys.readouterr().err == "prog: interrupted. Half is kept.\n"
