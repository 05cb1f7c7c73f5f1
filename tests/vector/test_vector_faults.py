"""Vector environments whose processes are killed or lack memory: nothing is left."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from playing import long, slow
from vectors import make_vec

from hab_tasks.vector import shared_arrays
from hab_tasks.vector.shared_arrays import ArraySpec, SharedArrays, SharedMemoryError
from hab_tasks.vector.workers import VectorWorkerError

GONE_WITHIN_S = 20.0
PARENT = """
    import sys, gymnasium as gym
    if __name__ == "__main__":
        env = gym.make_vec("hab_tasks:HabPick-v1", num_envs=2, num_workers=2)
        env.reset(seed=0)
        print(*[p.pid for p in __import__("multiprocessing").active_children()], flush=True)
        env.action_space.seed(0)
        while True:
            env.step(env.action_space.sample())
"""


def is_alive(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def assert_gone(pids):
    until = time.monotonic() + GONE_WITHIN_S
    while any(map(is_alive, pids)):
        assert time.monotonic() < until, f"still there: {pids}"
        time.sleep(0.05)


def shared_files():
    """Named shared memory on this machine, without the semaphores of other programs."""
    return {path for path in Path("/dev/shm").iterdir() if not path.name.startswith("sem.")}


@slow
def test_a_killed_worker_is_one_clear_error_and_nothing_is_left():
    before = shared_files()
    env = make_vec("HabPick-v1", 4, num_workers=2)
    env.reset(seed=0)
    pids = list(env.worker_pids)
    os.kill(pids[1], signal.SIGKILL)
    assert_gone(pids[1:])
    with pytest.raises(
        VectorWorkerError, match=rf"process {pids[1]}, with rows 2 to 3 .* killed by signal 9"
    ):
        env.step(np.zeros((4, 4)))
    assert_gone(pids)
    assert shared_files() == before
    env.close()


@slow
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, signal.SIGINT, pytest.param(signal.SIGTERM, marks=long)]
)
def test_workers_end_with_their_parent(tmp_path, number):
    before = shared_files()
    script = tmp_path / "parent.py"
    script.write_text(textwrap.dedent(PARENT))
    parent = subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Tests started in a shell's background ignore Ctrl-C, and so would this process.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert parent.stdout is not None
    pids = [int(pid) for pid in parent.stdout.readline().split()]
    assert len(pids) == 2
    assert all(map(is_alive, pids))
    if number == signal.SIGINT:
        os.killpg(parent.pid, number)  # as a terminal does
    else:
        parent.send_signal(number)
    _, errors = parent.communicate(timeout=60)
    assert_gone(pids)
    assert shared_files() == before
    if number == signal.SIGINT:
        assert errors.count("KeyboardInterrupt") == 1, errors  # of the script, not of workers
        assert "hab_tasks/vector/worker.py" not in errors
    else:
        assert errors == ""


@slow
def test_closing_ends_the_workers_and_frees_the_memory():
    before = shared_files()
    files = len(list(Path("/proc/self/fd").iterdir()))
    env = make_vec("HabPick-v1", 2, num_workers=2)
    pids = list(env.worker_pids)
    env.reset(seed=0)
    obs = env.step(np.zeros((2, 4)))[0]
    env.close()
    env.close()
    assert_gone(pids)
    assert obs.shape[0] == 2
    assert np.isfinite(obs).all()
    del env
    assert shared_files() == before
    assert len(list(Path("/proc/self/fd").iterdir())) <= files + 1


@pytest.mark.parametrize("function", ["posix_fallocate", "memfd_create"])
def test_without_memory_the_error_says_what_to_do(monkeypatch, function):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, function, full)
    files = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(SharedMemoryError, match=r"0\.4 MB .*No space left.*fewer rows"):
        SharedArrays({"obs": ArraySpec(shape=(100, 1000), dtype="<f4")})
    assert len(list(Path("/proc/self/fd").iterdir())) == files


def test_arrays_are_shared_and_aligned():
    specs = {
        "action": ArraySpec(shape=(3, 2), dtype="<f4"),
        "ended": ArraySpec(shape=(3,), dtype="|b1"),
        "empty": ArraySpec(shape=(3, 0), dtype="<f4"),
        "steps": ArraySpec(shape=(3,), dtype="<i4"),
    }
    ours = SharedArrays(specs)
    theirs = SharedArrays(specs, os.dup(ours.file))
    for name, array in ours.arrays.items():
        assert not array.any()
        assert array.shape == specs[name].shape
        assert array.size == 0 or array.ctypes.data % shared_arrays.ALIGNMENT_BYTES == 0
    ours.arrays["steps"][:] = 1, 2, 3
    theirs.arrays["ended"][1] = True
    assert theirs.arrays["steps"].tolist() == [1, 2, 3]
    assert ours.arrays["ended"].tolist() == [False, True, False]
    theirs.close()
    ours.close()
