"""Concurrent, stalled and killed runs: each episode is recorded exactly once."""

import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
import stub_runs  # first: it finds the stub
from hab_eval.cli import main
from hab_eval.records.results import read_record
from hab_eval.run.run_folder import LOCK, locked
from killed import session_of
from refusals import refused_by_command
from stub_runs import FAULTY, RUN, journal_ids, results_of

KILLS = int(os.environ.get("HAB_KILLS", "1"))
"""Of the command and of its workers; `make kills` kills each ten times."""

FILES = {"config.json", "episodes.jsonl", "run.json"}
"""Of a finished run."""

HOLDER = """
import sys, time
from pathlib import Path
from hab_eval.run.run_folder import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""

pytestmark = pytest.mark.usefixtures("stubbed")


def play(folder, *arguments, episodes=6):
    assert main([*RUN, "--episodes", str(episodes), "--out", str(folder), *arguments]) == 0


def test_a_finished_run_in_use_stays_and_a_resume_wants_the_same_time_limit(tmp_path):
    play(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    arguments = (*RUN, "--episodes", 6, "--out", tmp_path)
    with locked(tmp_path):
        refused_by_command(main, (*arguments, "--force"), "is in use")
    arguments = (*arguments, "--resume", "--step-timeout", 5)
    refused_by_command(main, arguments, "step_timeout_s: None before, 5.0 now")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_folder_in_use_is_refused_until_its_owner_is_killed(tmp_path, capfd):
    out = tmp_path / "run"
    env = {**os.environ, "PYTHONPATH": str(stub_runs.ROOT / "eval")}
    command = [sys.executable, "-c", HOLDER, str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=env) as holder:
        assert holder.stdout.readline() == "held\n"
        words = (str(out), f"process {holder.pid} on {socket.gethostname()}")
        for how in ("--resume", "--force"):
            refused_by_command(main, (*RUN, "--episodes", 1, "--out", out, how), *words)
        holder.kill()
    assert [path.name for path in out.iterdir()] == [LOCK]
    capfd.readouterr()
    play(out)  # a lock alone is no run, and that of a dead process is taken over without a word
    assert capfd.readouterr().err == ""
    assert {path.name for path in out.iterdir()} == FILES


def test_a_time_limit_needs_an_agent_of_one_row(tmp_path):
    arguments = ("run", "--agent", "stub_hab:many", "--env", "HabStub-v1", "--step-timeout", 5)
    refused_by_command(main, (*arguments, "--out", tmp_path / "run"), "--step-timeout", "Many", "3")
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "workers", "steps"),
    [
        ("act:deaf", 2, 1),
        pytest.param("act", 1, 1, marks=pytest.mark.long),
        pytest.param("reset", 2, 0, marks=pytest.mark.long),
    ],
)
def test_an_agent_that_hangs_fails_the_episode_and_the_run_goes_on(
    tmp_path, capfd, case, workers, steps
):
    out, clean = tmp_path / "run", tmp_path / "clean"
    limits = ("--workers", workers, "--step-timeout", 1.5, "--video", 2, "--out", out)
    process = stub_runs.start(*FAULTY, "--option", f"case=late:{case}", "--episodes", 4, *limits)
    _, err = process.communicate(timeout=200)
    assert process.returncode == 0, err
    play(clean, episodes=4)
    found, expected = results_of(out), results_of(clean)
    late = [one for one in found if one["failure"] == "agent timeout"]
    assert [one["id"] for one in late] == ["stub/001", "stub/003"]
    assert [(one["success"], one["steps"]) for one in late] == [(False, steps)] * 2
    assert found[::2] == expected[::2]  # the time limit changes nothing that keeps it
    record = read_record(out / "run.json")
    assert record.step_timeout_s == 1.5
    assert all(1.5 < one.seconds < 60 for one in record.episodes[1::2])
    assert {path.name for path in out.glob("video_*.mp4")} == {"video_000_stub-000.mp4"}
    assert [path.name for path in out.iterdir() if path.name.startswith(".")] == []


@pytest.mark.slow
@pytest.mark.parametrize("stopped", ["all", "workers"])
def test_a_stop_is_no_delay_of_the_agent(tmp_path, capfd, stopped):
    out, clean = tmp_path / "run", tmp_path / "clean"
    limits = ("--workers", 2, "--step-timeout", 1.5, "--out", out)
    case = ("--option", "case=late:act:nap", "--episodes", 4)
    process = stub_runs.start(*FAULTY, *case, *limits)
    wait_until(lambda: process.poll() is not None or len(children_of(process.pid)) == 2)
    while process.poll() is None:
        victims = children_of(process.pid) + [process.pid] * (stopped == "all")
        for number, pause_s in ((signal.SIGSTOP, 2.0), (signal.SIGCONT, 0.5)):
            for victim in victims:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(victim, number)
            time.sleep(pause_s)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    play(clean, episodes=4)
    assert results_of(out) == results_of(clean)


def children_of(pid):
    """Ids of the worker processes of a process, which are those of its server."""
    try:
        found = direct_children(pid)
        servers = [c for c in found if "serve_forks" in Path(f"/proc/{c}/cmdline").read_text()]
        return [worker for server in servers for worker in direct_children(server)]
    except OSError:  # one of them has just ended
        return []


def direct_children(pid):
    return [int(c) for c in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def lines_of(folder):
    """Number of finished episodes of a run."""
    path = folder / "episodes.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


def wait_until(true, seconds=60.0):
    deadline_s = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


@pytest.mark.slow
@pytest.mark.parametrize("killed", ["parent", "worker"])
def test_kills_at_any_moment_lose_nothing(tmp_path, capfd, killed):
    """Each sitting is killed at a seeded moment and goes on; the last one may end."""
    out, clean = tmp_path / "run", tmp_path / "clean"
    rng = random.Random(f"{killed}")
    arguments = (*RUN, "--episodes", 24, "--workers", 2, "--out", out, "--resume")
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    for _ in range(KILLS):
        process = stub_runs.start(*arguments, STUB_STEP_S="0.05", TMPDIR=str(temporary))
        wait_until(lambda p=process: p.poll() is not None or len(children_of(p.pid)) == 2)
        enough = lines_of(out) + rng.randrange(4) - 1  # or while the workers start
        wait_until(lambda p=process, n=enough: p.poll() is not None or lines_of(out) >= n)
        time.sleep(rng.uniform(0.0, 0.3))
        victims = [process.pid] if killed == "parent" else children_of(process.pid)
        if victims and process.poll() is None:
            os.kill(rng.choice(victims), signal.SIGKILL)
        _, err = process.communicate(timeout=60)
        assert "Traceback" not in err
        wait_until(lambda p=process: not session_of(p.pid), 10.0)
    assert lines_of(out) > 0
    play(out, "--resume", episodes=24)
    play(clean, episodes=24)
    assert sorted(journal_ids(out)) == [f"stub/{number:03d}" for number in range(24)]
    assert results_of(out) == results_of(clean)
    assert {path.name for path in out.iterdir()} - {"error.txt"} == FILES
    assert list(temporary.iterdir()) == []
