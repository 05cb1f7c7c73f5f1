"""Killed commands: no orphaned processes, no partial files, and a repeated run succeeds.

`make kills` kills each command ten times. `hab-eval run` is killed in test_eval_runs.
"""

import functools
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import pytest
from killed import session_of
from textured import textured_dataset

from hab_tasks.io.cache import RUN_DIR
from hab_tasks.io.files import ASIDE

BIN = Path(sys.executable).parent
KILLS = int(os.environ.get("HAB_KILLS", "1"))
"""Of each command's process, and as many of its workers."""

GONE_WITHIN_S = 20.0
LONGEST_S = 240.0

pytestmark = pytest.mark.timeout(1800)

COMMANDS = {
    "assets": "hab-tasks assets source --workers 2 --out out --force",
    "episodes": "hab-tasks episodes --env HabPick-v1 --seed 3 --count 3 --workers 2 --out out.json "
    "--force",
    "record": "hab-spa record --agent hab_spa:spa_priv --env HabPick-v1 --count 1 --split val "
    "--out out --force",
}
# CI kills the shortest of these commands.
EACH = [
    pytest.param("assets", marks=pytest.mark.slow),
    *(pytest.param(name, marks=pytest.mark.long) for name in ("episodes", "record")),
]


class Work:
    """A command in a folder of its own, which has run to its end once.

    Attributes:
        folder: Has the folders `work`, with a dataset, `cache` and `temporary`.
        duration_s: How long the command took.
        whole: What it wrote.
        there: All names in the folder since then.
    """

    def __init__(self, folder, name):
        self.folder, self.command = folder, COMMANDS[name].split()
        self.out = folder / "work" / self.command[self.command.index("--out") + 1]
        for part in ("cache", "temporary"):
            (folder / part).mkdir()
        textured_dataset(folder / "work" / "source")
        began = time.monotonic()
        self.whole = self.finish()
        self.duration_s = time.monotonic() - began
        self.there = self.names()
        assert not self.half_written()

    def start(self):
        script, *arguments = self.command
        folders = {"HAB_CACHE_DIR": "cache", "TMPDIR": "temporary"}
        own = {name: value for name, value in os.environ.items() if name != RUN_DIR}
        return subprocess.Popen(
            [str(BIN / script), *arguments],
            cwd=self.folder / "work",
            env=own | {name: str(self.folder / part) for name, part in folders.items()},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            # Tests started in a shell's background ignore Ctrl-C, and so would this process.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    def start_anew(self):
        """Starts it with an empty cache, so that it has work to do."""
        shutil.rmtree(self.folder / "cache")
        (self.folder / "cache").mkdir()
        return self.start()

    def finish(self):
        """Runs to the end; returns what it wrote."""
        process = self.start()
        _, errors = process.communicate(timeout=LONGEST_S)
        assert process.returncode == 0, errors
        check_nothing_runs(process.pid)
        return self.written()

    def written(self):
        """Returns what has been written to the end: path -> content."""
        files = [self.out] if self.out.is_file() else sorted(self.out.rglob("*"))
        return {file: content(file) for file in files if file.is_file()}

    def names(self):
        """Returns the paths of all files and folders: work, cache and temporary ones."""
        return sorted(str(path.relative_to(self.folder)) for path in self.folder.rglob("*"))

    def half_written(self):
        return [name for name in self.names() if ASIDE in name or name.startswith("temporary/")]

    def check_runs_again(self):
        """Runs once more, on what the last kill left: no file is missing or too many."""
        assert self.finish() == self.whole
        # A kill may leave a scratch file in the temporary folder, which is the system's to clear.
        left = [name for name in self.names() if not name.startswith(f"temporary/{ASIDE}")]
        assert left == self.there


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    return functools.cache(lambda name: Work(tmp_path_factory.mktemp(name), name))


def check_nothing_runs(pid):
    deadline = time.monotonic() + GONE_WITHIN_S
    while session_of(pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert session_of(pid) == []


def content(file):
    """Returns a file's bytes; of HDF5, which holds times of day, the values."""
    if file.suffix != ".h5":
        return file.read_bytes()
    items = {}
    with h5py.File(file) as data:
        data.visititems(items.__setitem__)
        return {name: x[()].tobytes() for name, x in items.items() if isinstance(x, h5py.Dataset)}


def is_worker(pid):
    """Whether a process is a worker, or the server that forks them."""
    try:
        return b"serve_forks" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("name", EACH)
def test_a_killed_command_leaves_what_was_there_and_runs_again(work, name):
    done, rng = work(name), random.Random(f"parent of {name}")
    for _ in range(KILLS):
        process = done.start_anew()
        time.sleep(rng.uniform(0.0, done.duration_s))
        process.kill()
        process.communicate()
        check_nothing_runs(process.pid)
        assert done.written() == done.whole
    done.check_runs_again()


@pytest.mark.parametrize("name", EACH[:2])
def test_a_killed_worker_is_told_and_nothing_is_lost(work, name):
    done, rng = work(name), random.Random(f"worker of {name}")
    told = tried = 0
    while tried < KILLS or not told:
        tried += 1
        assert tried < KILLS + 10, "no kill came while the workers worked"
        process = done.start_anew()
        time.sleep(rng.uniform(0.3, 0.9) * done.duration_s)
        workers = [p for p in session_of(process.pid) if p != process.pid and is_worker(p)]
        if workers:
            os.kill(rng.choice(workers), signal.SIGKILL)
        _, errors = process.communicate(timeout=LONGEST_S)
        check_nothing_runs(process.pid)
        if process.returncode:
            (line,) = [line for line in errors.splitlines() if line.startswith("hab-tasks:")]
            assert process.returncode == 2, errors
            assert "worker" in line
            assert "Traceback" not in errors
            told += 1
        assert done.written() == done.whole
    done.check_runs_again()


@pytest.mark.parametrize("name", EACH)
def test_ctrl_c_ends_a_command_in_one_line(work, name):
    done = work(name)
    process = done.start_anew()
    while not done.half_written():
        assert process.poll() is None, "it wrote nothing aside"
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    out, errors = process.communicate(timeout=60)
    check_nothing_runs(process.pid)
    assert process.returncode == 130, out + errors
    assert "Traceback" not in errors
    assert errors.splitlines()[-1].startswith(f"{done.command[0]}: interrupted")
    assert done.written() == done.whole
    assert done.half_written() == []
