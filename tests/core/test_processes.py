"""Worker processes end with their parent."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from multiprocessing import Pipe
from pathlib import Path

import pytest
from worker_jobs import pid_soon, surroundings

from hab_tasks.errors import WorkerError
from hab_tasks.processes import Worker, worker_pool


def test_a_worker_has_what_its_parent_has_when_it_starts(tmp_path, monkeypatch, capfd):
    seen = []
    for value in ("first", "second"):
        monkeypatch.setenv("HAB_TEST_VALUE", value)
        (tmp_path / value).mkdir()
        monkeypatch.chdir(tmp_path / value)
        with worker_pool(1) as pool:
            seen.append(pool.submit(surroundings).result())
        assert capfd.readouterr() == (f"out {value}\n", f"err {value}\n")
    assert [one[:2] for one in seen] == [(v, str(tmp_path / v)) for v in ("first", "second")]
    assert seen[0][2] == seen[1][2] != os.getpid()  # one server
    assert seen[0][3] != seen[1][3]  # random numbers


def server_pid():
    with worker_pool(1) as pool:
        return pool.submit(os.getppid).result()


def test_a_killed_worker_or_server_is_told_and_the_next_pool_has_another_server():
    server, pids = server_pid(), []

    def work(victim):
        with worker_pool(1) as pool:
            pids.append(pool.submit(os.getpid).result())
            os.kill(victim or pids[-1], signal.SIGKILL)
            pool.submit(time.sleep, 60).result()

    for victim in (None, server):
        with pytest.raises(WorkerError, match="worker process was killed"):
            work(victim)
    wait_until_gone(*pids)
    assert server_pid() != server
    queue = Pipe()[0]
    queue.close()  # as a pool does when a worker is killed
    with pytest.raises(WorkerError):
        Worker(target=print, args=(queue,)).start()


def test_a_forked_process_has_its_own_workers():
    server = server_pid()
    forked = os.fork()
    if not forked:
        code = 1
        with contextlib.suppress(BaseException):
            code = 0 if server_pid() != server else 2
        os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(forked, 0)[1]) == 0


def test_workers_start_where_the_path_of_the_temporary_folder_is_long(tmp_path):
    """A socket's path has at most 104 bytes; this folder alone has more."""
    folder = tmp_path / ("long" * 25)
    folder.mkdir()
    code = (
        "import os\nfrom hab_tasks.processes import worker_pool\n"
        "with worker_pool(1) as pool: print(pool.submit(os.getpid).result())"
    )
    variables = {**os.environ, "TMPDIR": str(folder)}
    command = [sys.executable, "-c", code]
    ended = subprocess.run(command, capture_output=True, text=True, env=variables, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert int(ended.stdout) > 0
    assert not list(folder.iterdir())


def test_workers_end_when_something_is_raised(tmp_path):
    pids = []

    def interrupted():
        with worker_pool(2, os.chdir, (tmp_path,)) as pool:
            assert pool.submit(os.getcwd).result() == str(tmp_path), "its start is called"
            pids.append(pool.submit(os.getpid).result())
            for _ in range(8):
                pool.submit(time.sleep, 60)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    wait_until_gone(*pids)


@pytest.mark.slow
@pytest.mark.parametrize("victim", [0, 1])
def test_a_worker_killed_at_the_end_does_not_block_the_others(victim):
    started = time.monotonic()
    with worker_pool(2) as pool:
        pids = sorted(set(pool.map(pid_soon, [1.0] * 4)))
        assert len(pids) == 2
        # One of the two waits for work and holds the lock for which the other one waits.
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        threading.Timer(1.0, os.kill, (pids[victim], signal.SIGKILL)).start()
        threading.Timer(1.5, continued, (pids[1 - victim],)).start()
    wait_until_gone(*pids)
    assert time.monotonic() - started < 60


def continued(pid):
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGCONT)


def wait_until_gone(*pids):
    deadline = time.monotonic() + 30
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < deadline, f"of {pids} some are still there"
        time.sleep(0.1)
