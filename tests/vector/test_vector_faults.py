"""Vector environments that are closed or whose processes are killed: nothing is left."""

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

from hab_tasks.vector.workers import VectorWorkerError

GONE_WITHIN_S = 20.0
PARENT = """
    import gymnasium as gym
    if __name__ == "__main__":
        env = gym.make_vec("hab_tasks:HabPick-v1", num_envs=2, num_workers=2)
        env.reset(seed=0)
        print(*env.unwrapped.worker_pids, flush=True)
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
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, signal.SIGINT, pytest.param(signal.SIGTERM, marks=long)]
)
def test_workers_end_with_their_parent(tmp_path, number):
    before = shared_files()
    script = tmp_path / "parent.py"
    script.write_text(textwrap.dedent(PARENT))
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    parent = subprocess.Popen(
        [sys.executable, str(script)],
        **pipes,
        start_new_session=True,
        # Tests started in a shell's background ignore Ctrl-C, and so would this process.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
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
        assert errors.count("Traceback") == 1
    else:
        assert errors == ""


@slow
@pytest.mark.parametrize("killed", [False, True])
def test_closing_or_a_killed_worker_ends_all_and_frees_the_memory(killed):
    """A killed worker is one clear error; what was returned before stays."""
    before, files = shared_files(), len(os.listdir("/proc/self/fd"))
    env = make_vec("HabPick-v1", 4, num_workers=2)
    pids = list(env.worker_pids)
    obs = env.reset(seed=0)[0]
    if killed:
        os.kill(pids[1], signal.SIGKILL)
        assert_gone(pids[1:])
        words = rf"process {pids[1]}, with rows 2 to 3 .* killed by signal 9"
        with pytest.raises(VectorWorkerError, match=words):
            env.step(np.zeros((4, 4)))
        assert_gone(pids)
    for _ in range(2):
        env.close()
    assert_gone(pids)
    assert np.isfinite(obs).all()
    del env
    assert shared_files() == before
    assert len(os.listdir("/proc/self/fd")) <= files + 1
