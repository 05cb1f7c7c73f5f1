"""Killed commands: no orphaned processes, no partial files, and a repeated run succeeds.

`make kills` kills each command ten times. `hab-eval run` is killed in test_eval_runs.
"""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import h5py
import pytest
from textured import textured_dataset

from hab_tasks.files import ASIDE

BIN = Path(sys.executable).parent
KILLS = int(os.environ.get("HAB_KILLS", "1"))
"""Of each command's process, and as many of its workers."""

GONE_WITHIN_S = 20.0
LONGEST_S = 240.0

pytestmark = pytest.mark.timeout(1800)


@dataclass(frozen=True)
class Work:
    """A command that takes some seconds, in a folder of its own.

    Attributes:
        arguments: What is run; relative paths are in the folder.
        out: What it writes.
    """

    arguments: tuple[str, ...]
    out: str


EPISODES = Work(
    (
        *("hab-tasks", "episodes", "--env", "HabPick-v1", "--seed", "3", "--count", "3"),
        *("--workers", "2", "--out", "out.json", "--force"),
    ),
    "out.json",
)
ASSETS = Work(("hab-tasks", "assets", "source", "--workers", "2", "--out", "out", "--force"), "out")
RECORD = Work(
    (
        *("hab-spa", "record", "--agent", "hab_spa:spa_priv", "--env", "HabPick-v1"),
        *("--count", "1", "--split", "val", "--out", "out", "--force"),
    ),
    "out",
)
WORKS = {"episodes": EPISODES, "assets": ASSETS, "record": RECORD}

# CI kills the shortest of these commands.
EACH = [
    pytest.param("assets", marks=pytest.mark.slow),
    *(pytest.param(name, marks=pytest.mark.long) for name in ("episodes", "record")),
]


@dataclass(frozen=True)
class Begun:
    """A command that has run to its end once.

    Attributes:
        folder: Has the folders `work`, with a dataset, `cache` and `temporary`, which nobody else
            writes.
        duration_s: How long the command took.
        whole: What it wrote, see `written`.
        there: All names in the folder since then.
    """

    folder: Path
    duration_s: float
    whole: dict[str, object]
    there: list[str]


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """Runs a command of `WORKS` to its end, once for all tests."""
    done = {}

    def once(name):
        if name not in done:
            folder = tmp_path_factory.mktemp(name)
            for part in ("work", "cache", "temporary"):
                (folder / part).mkdir()
            textured_dataset(folder / "work" / "source")
            duration_s, whole = finish(folder, WORKS[name])
            assert half_written(folder) == []
            done[name] = Begun(folder, duration_s, whole, names(folder))
        return done[name]

    return once


def start(folder, work):
    """Starts a command."""
    script, *arguments = work.arguments
    own = {"HAB_CACHE_DIR": str(folder / "cache"), "TMPDIR": str(folder / "temporary")}
    return subprocess.Popen(
        [str(BIN / script), *arguments],
        cwd=folder / "work",
        env=os.environ | own,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Tests started in a shell's background ignore Ctrl-C, and so would this process.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def session_of(pid):
    """Returns the pids of a session's processes that still run."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            _, _, rest = stat.read_text().rpartition(") ")
        except (FileNotFoundError, ProcessLookupError):
            continue
        state, _, _, session, *_ = rest.split()
        if int(session) == pid and state != "Z":
            found.append(int(stat.parent.name))
    return found


def check_nothing_runs(pid):
    deadline = time.monotonic() + GONE_WITHIN_S
    while session_of(pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert session_of(pid) == []


def start_anew(folder, work):
    """Starts a command that finds nothing in the cache, so that it has work to do."""
    shutil.rmtree(folder / "cache")
    (folder / "cache").mkdir()
    return start(folder, work)


def finish(folder, work):
    """Runs to the end; returns how long that took and what it wrote."""
    started = time.monotonic()
    process = start(folder, work)
    _, told = process.communicate(timeout=LONGEST_S)
    assert process.returncode == 0, told
    check_nothing_runs(process.pid)
    return time.monotonic() - started, written(folder / "work" / work.out)


def written(out):
    """Returns what a command has written to the end: path -> content."""
    files = [out] if out.is_file() else sorted(p for p in out.rglob("*") if p.is_file())
    files = [file for file in files if ASIDE not in str(file)]
    return {str(p.relative_to(out.parent)): content(p) for p in files}


def content(file):
    """Returns a file's bytes; of HDF5, which holds times of day, the values."""
    if file.suffix != ".h5":
        return file.read_bytes()
    found = {}
    with h5py.File(file) as data:
        data.visititems(
            lambda name, item: (
                found.update({name: item[()].tobytes()}) if isinstance(item, h5py.Dataset) else None
            )
        )
    return found


def names(folder):
    """Returns the paths of all files and folders: work, cache and temporary ones."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def half_written(folder):
    return [name for name in names(folder) if ASIDE in name or name.startswith("temporary/")]


def check_nothing_left(done, work):
    """Runs once more, on what the last kill left in the cache: no file is missing or too many."""
    assert finish(done.folder, work)[1] == done.whole
    assert names(done.folder) == done.there


@pytest.mark.parametrize("name", EACH)
def test_a_killed_command_leaves_what_was_there_and_runs_again(begun, name):
    work = WORKS[name]
    done = begun(name)
    folder, duration_s, whole = done.folder, done.duration_s, done.whole
    rng = random.Random(f"parent of {name}")
    for _ in range(KILLS):
        process = start_anew(folder, work)
        time.sleep(rng.uniform(0.0, duration_s))
        process.kill()
        process.communicate()
        check_nothing_runs(process.pid)
        assert written(folder / "work" / work.out) == whole
    check_nothing_left(done, work)


@pytest.mark.parametrize("name", EACH[:2])
def test_a_killed_worker_is_told_and_nothing_is_lost(begun, name):
    work = WORKS[name]
    done = begun(name)
    folder, duration_s, whole = done.folder, done.duration_s, done.whole
    rng = random.Random(f"worker of {name}")
    told = tried = 0
    while tried < KILLS or not told:
        tried += 1
        assert tried < KILLS + 10, "no kill came while the workers worked"
        process = start_anew(folder, work)
        time.sleep(rng.uniform(0.3, 0.9) * duration_s)
        workers = [p for p in session_of(process.pid) if p != process.pid and is_worker(p)]
        if workers:
            os.kill(rng.choice(workers), signal.SIGKILL)
        _, error = process.communicate(timeout=LONGEST_S)
        check_nothing_runs(process.pid)
        if process.returncode:
            lines = [line for line in error.splitlines() if line.startswith("hab-tasks:")]
            assert process.returncode == 2, error
            assert len(lines) == 1, error
            assert "worker" in lines[0]
            assert "Traceback" not in error
            told += 1
        assert written(folder / "work" / work.out) == whole
    check_nothing_left(done, work)


def is_worker(pid):
    """Whether a process is a worker, or the server that forks them."""
    try:
        return b"forkserver" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("name", EACH)
def test_ctrl_c_ends_a_command_in_one_line(begun, name):
    work = WORKS[name]
    done = begun(name)
    folder, whole = done.folder, done.whole
    process = start_anew(folder, work)
    deadline = time.monotonic() + LONGEST_S
    while not half_written(folder) and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    out, error = process.communicate(timeout=60)
    check_nothing_runs(process.pid)
    assert process.returncode == 130, out + error
    assert "Traceback" not in error
    assert error.splitlines()[-1].startswith(f"{work.arguments[0]}: interrupted")
    assert written(folder / "work" / work.out) == whole
    assert half_written(folder) == []
