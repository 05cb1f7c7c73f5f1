"""Exit status of console scripts, and one-line errors on stderr."""

import os
import resource
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest

from hab_tasks.errors import HabError, RunStoppedError
from hab_tasks.io.console import Command, run_script
from hab_tasks.io.pool import start_server


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


MEMORY = "ulimit -v is 1500; at least 4000000 is needed."
FILES = "ulimit -n is 16; at least 64 is needed."


def test_a_limit_that_is_too_low_is_named_with_its_value(capsys, monkeypatch):
    found = {resource.RLIMIT_AS: 1500 * 1024, resource.RLIMIT_NOFILE: 16}
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (found[kind], -1))
    cause, worker = ImportError("a.so: failed to map segment"), "Its worker ended with signal 6."
    for error, code, line in (
        (MemoryError(), 1, f"MemoryError. {MEMORY}"),
        (RunStoppedError(worker), 1, f"{worker} {MEMORY}"),
        (OSError(24, "Too many open files"), 1, f"[Errno 24] Too many open files. {FILES}"),
        (HabError("no such name."), 2, "no such name."),
    ):
        monkeypatch.setitem(ENDINGS, "limit", (lambda error=error: fail(error),))
        assert run_script("prog", {"end": End}, ["end", "--how", "limit"]) == code
        assert capsys.readouterr().err == f"prog: {line}\n"
    with pytest.raises(HabError, match=FILES):
        start_server()
    found[resource.RLIMIT_AS] = resource.RLIM_INFINITY
    monkeypatch.setitem(ENDINGS, "limit", (lambda: fail(cause),))
    with pytest.raises(ImportError):  # some other fault: the traceback helps
        run_script("prog", {"end": End}, ["end", "--how", "limit"])


def test_a_command_without_enough_memory_ends_in_a_line():
    command = f"ulimit -v 1000000; exec {Path(sys.executable).parent / 'hab-tasks'} list"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 1
    assert "ulimit -v is 1000000; at least" in line


def test_characters_that_a_locale_lacks_are_escaped():
    code = "import hab_tasks.io.console as c; raise SystemExit(c.run_script('p', {}, ['†']))"
    environment = {**os.environ, "PYTHONIOENCODING": "latin-1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    assert (done.returncode, b"Traceback" in done.stderr) == (2, False)
    assert b"\\u2020" in done.stderr
