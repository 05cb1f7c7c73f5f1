"""Worker processes have what their parent has, and end with it."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest
from worker_jobs import call, call_once, signal_at_end, surroundings

from hab_tasks.errors import RunStoppedError, WorkerError
from hab_tasks.io.pool import Worker, WorkerPool, in_order

SCRIPT = """
from hab_tasks.io.pool import WorkerPool
def start(): return abs
if {guard}:
    with WorkerPool(1, start) as pool: print(*pool.run([-3]))
"""


def pool_of(workers):
    return WorkerPool(workers, partial, (call,))


def results(*jobs):
    with pool_of(1) as pool:
        return list(in_order(pool.run(jobs)))


def test_a_worker_has_what_its_parent_has_when_it_starts(tmp_path, monkeypatch, capfd):
    seen = []
    for value in ("first", "second"):
        monkeypatch.setenv("HAB_TEST_VALUE", value)
        (tmp_path / value).mkdir()
        monkeypatch.chdir(tmp_path / value)
        seen += results((surroundings,))
        assert capfd.readouterr() == (f"out {value}\n", f"err {value}\n")
    assert [one[:2] for one in seen] == [(v, str(tmp_path / v)) for v in ("first", "second")]
    assert seen[0][2] == seen[1][2] != os.getpid()  # one server
    assert seen[0][3] != seen[1][3]  # random numbers


def server_pid():
    return results((os.getppid,))[0]


def test_a_killed_worker_or_server_is_told_and_the_next_pool_has_another_server():
    server, pids = server_pid(), []

    def work(victim):
        with pool_of(1) as pool:
            for _, pid in pool.run([(os.getpid,), (time.sleep, 60)]):
                pids.append(pid)
                os.kill(victim or pid, signal.SIGKILL)

    for victim in (None, server):
        with pytest.raises(WorkerError, match="worker process was killed by signal 9"):
            work(victim)
    wait_until_gone(*pids)
    assert server_pid() != server
    with pytest.raises(RunStoppedError, match="process failed: ZeroDivisionError"):
        results((divmod, 1, 0))


def test_a_forked_process_has_its_own_workers():
    worker, server = Worker(call_once), server_pid()
    forked = os.fork()
    if not forked:
        code = 1
        with contextlib.suppress(BaseException):
            worker.end()  # which stays the parent's
            code = 0 if server_pid() != server else 2
        os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(forked, 0)[1]) == 0
    worker.send((os.getpid,))
    assert (worker.receive(), worker.exit_code(5.0)) == (worker.pid, 0)
    worker.end()


def test_workers_import_the_main_script_and_python_s_own_modules(tmp_path):
    (tmp_path / "re.py").write_text("raise ImportError")  # beside the script, so first in the path
    script, found = tmp_path / "script.py", []
    for guard in ("__name__ == '__main__'", "True"):
        script.write_text(SCRIPT.format(guard=guard))
        ended = subprocess.run([sys.executable, str(script)], capture_output=True, text=True)
        found.append((ended.returncode, ended.stdout, "HabError: Workers import" in ended.stderr))
    assert found == [(0, "(0, 3)\n", False), (1, "", True)]


def test_workers_end_when_something_is_raised():
    pids = []

    def interrupted():
        with pool_of(2) as pool:
            for _, pid in pool.run([(os.getpid,), *[(time.sleep, 60)] * 8]):
                pids.append(pid)
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    wait_until_gone(*pids)


def test_a_worker_told_to_end_while_it_ends_prints_nothing(capfd):
    worker = Worker(call_once)
    worker.connection.send((signal_at_end,))
    worker.end(10)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_a_worker_that_is_stopped_ends_too():
    with pool_of(2) as pool:
        jobs = [(time.sleep, 1.0), (time.sleep, 1.0), (os.getpid,), (os.getpid,)]
        pids = {pid for _, pid in pool.run(jobs) if pid is not None}
        os.kill(max(pids), signal.SIGSTOP)
    wait_until_gone(*pids)


def wait_until_gone(*pids):
    deadline = time.monotonic() + 30
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < deadline, f"of {pids} some are still there"
        time.sleep(0.1)
