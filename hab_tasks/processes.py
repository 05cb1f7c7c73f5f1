"""Worker processes that exit with their parent process, even if it is killed."""

from __future__ import annotations

import ctypes
import gc
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import connection, forkserver, reduction, resource_tracker, util
from multiprocessing.context import ForkServerContext, ForkServerProcess, SpawnProcess
from typing import Any

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from hab_tasks.errors import WorkerError
from hab_tasks.limits import check_open_files

STREAMS = (1, 2)
"""File descriptors of standard output and standard error."""

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Variables with which libraries start no threads when they are imported."""

PR_SET_PDEATHSIG = 1
"""From Linux's <sys/prctl.h>."""

LONGEST_FOLDER_BYTES = 103 - len("/pymp-01234567/listener-01234567")
"""Length of a temporary folder in which a socket's path still fits into the system's 104 bytes."""

SHORT_FOLDERS = ("/tmp", "/var/tmp")
"""Where sockets are put if the temporary folder's path is longer, as Python 3.14 does."""

SERVER_IMPORTS = ["hab_tasks.worker_server", __name__]
"""What each server imports, besides the modules that its first workers ask for."""


class NewProcess(SpawnProcess):
    """A process that imports all that it needs, for variables that count when a module is imported.

    Ctrl-C does nothing in it: it reaches all processes, and the parent ends its workers.
    """

    def start(self) -> None:
        """Starts the process with SIGINT blocked, so that it is also while Python starts."""
        with _interrupt_blocked():
            super().start()


class Worker(ForkServerProcess):
    """A process forked from a server that has imported its modules; see `start_worker_server`.

    It has this process's environment variables, standard output and standard error, and Ctrl-C
    does nothing in it.
    """

    def start(self) -> None:
        """Starts the process, and the server if there is none yet.

        Raises:
            WorkerError: The server was killed, or another worker of the pool.
        """
        target = getattr(self, "_target", None)
        start_worker_server(*([] if target is None else [target.__module__]))
        try:
            with _importable_main():
                _wait_for_server()
                with _interrupt_blocked():  # a process half started would not be ended
                    super().start()
        except (EOFError, ConnectionError) as error:
            raise WorkerError from error
        except OSError as error:
            if error.errno is not None:
                raise
            raise WorkerError from error  # a pool closes its queue when a worker is killed

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickled, (_Surroundings(), type(self), self.__dict__)


class _Surroundings:
    """What a worker takes over from its parent, before anything else of the worker is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        streams = {number: reduction.DupFd(number) for number in STREAMS if _is_open(number)}
        return _take_over, (dict(os.environ), streams)


def start_worker_server(*modules: str) -> None:
    """Starts the server that forks workers, unless it runs already.

    Importing PyTorch and ManiSkill takes seconds, a fork milliseconds. The simulator and Vulkan do
    not survive a fork: the server only imports them.

    Args:
        modules: What the server imports.

    Raises:
        HabError: The limit of open files is too low.
    """
    check_open_files()
    with _interrupt_blocked(), set_variables(ONE_THREAD), _short_socket_paths():
        forkserver.set_forkserver_preload([*SERVER_IMPORTS, *modules])
        forkserver.ensure_running()


@contextmanager
def _importable_main() -> Iterator[None]:
    """Hides the main script's path from workers if it is none: that of ``python -``."""
    main = vars(sys.modules["__main__"])
    path = main.get("__file__")
    if path is None or os.path.exists(path):
        yield
        return
    del main["__file__"]
    try:
        yield
    finally:
        main["__file__"] = path


def _wait_for_server() -> None:
    """Waits until the server has imported its modules: until it has forked a process."""
    idle = ForkServerProcess()
    idle.start()
    idle.join()


def _take_over(variables: dict[str, str], streams: dict[int, Any]) -> None:
    """Makes a forked process like one that its parent has spawned."""
    os.environ.clear()
    os.environ.update(variables)
    for number, stream in streams.items():
        sent = stream.detach()
        os.dup2(sent, number)
        os.close(sent)
    _leave_server()
    _end_with_server()
    np.random.seed()  # noqa: NPY002, all have forked the same state
    gc.freeze()  # what the server has imported is no garbage


def _leave_server() -> None:
    """Lets the server end with its parent, and gives workers of this process another server."""
    server: Any = forkserver._forkserver  # pyright: ignore[reportAttributeAccessIssue]
    if server._forkserver_alive_fd is not None:
        os.close(server._forkserver_alive_fd)
    server._forkserver_alive_fd = server._forkserver_address = server._forkserver_pid = None


os.register_at_fork(after_in_child=_leave_server)


def _end_with_server() -> None:
    """Makes the kernel kill this worker when its server ends, even inside a library call."""
    if sys.platform == "linux":
        server = os.getppid()
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != server:  # it ended before
            os._exit(1)


def _unpickled(surroundings: None, kind: type[Worker], values: dict[str, Any]) -> Worker:
    """Returns the worker of `Worker.__reduce__`, whose arguments are unpickled in their order."""
    worker = kind.__new__(kind)
    worker.__dict__.update(values)
    return worker


def _is_open(number: int) -> bool:
    with suppress(OSError):
        os.fstat(number)
        return True
    return False


@contextmanager
def _interrupt_blocked() -> Iterator[None]:
    """Blocks SIGINT, also in processes that are started now."""
    resource_tracker.ensure_running()  # starting it would unblock the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _short_socket_paths() -> Iterator[None]:
    """Lets multiprocessing make its folder of sockets where paths are short, if it has none yet.

    The temporary folder of a batch system is often a long path in TMPDIR.
    """
    before = tempfile.gettempdir()
    if len(os.fsencode(before)) > LONGEST_FOLDER_BYTES:
        tempfile.tempdir = next((d for d in SHORT_FOLDERS if os.access(d, os.W_OK)), before)
    try:
        util.get_temp_dir()
        yield
    finally:
        tempfile.tempdir = before


@contextmanager
def set_variables(variables: Mapping[str, str]) -> Iterator[None]:
    """Sets environment variables for processes started within the context."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class _PoolContext(ForkServerContext):
    """Creates the worker processes of one pool.

    Attributes:
        workers: Those created.
    """

    def __init__(self) -> None:
        super().__init__()
        self.workers: list[Worker] = []

    def Process(self, *args: Any, **options: Any) -> Worker:  # noqa: N802, multiprocessing's name
        """Returns a new worker process."""
        self.workers.append(Worker(*args, **options))
        return self.workers[-1]

    def started(self) -> list[Worker]:
        """Returns the workers that run or have ended."""
        return [worker for worker in self.workers if worker.pid is not None]


@contextmanager
def worker_pool(
    workers: int, start: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Yields a pool of worker processes, each limited to one compute thread.

    The processes exit at once when an exception leaves the context, Ctrl-C included, and when this
    process dies.

    Args:
        workers: Number of processes.
        start: Called once in each process, with `arguments`.
        arguments: Arguments of `start`; pickled.

    Raises:
        WorkerError: A worker process was killed.
    """
    start_worker_server(*([] if start is None else [start.__module__]))
    context = _PoolContext()
    pool = ProcessPoolExecutor(workers, context, _begin, (start, arguments))
    try:
        yield pool
    except BaseException as error:
        for process in context.started():
            process.kill()
        if isinstance(error, BrokenProcessPool):
            raise WorkerError from error
        raise
    finally:
        ended = threading.Thread(target=_end_together, args=(context.started(),), daemon=True)
        ended.start()
        pool.shutdown(cancel_futures=True)
        ended.join()


def _end_together(workers: Sequence[Worker]) -> None:
    """Waits for workers to exit; if one was killed, kills the others.

    A worker that is killed while it waits for work holds a lock that the others wait for as well.
    A pool that is already shutting down would wait for them forever.
    """
    waiting = {worker.sentinel: worker for worker in workers}
    while waiting:
        for sentinel in connection.wait(list(waiting)):
            if _exit_code(waiting.pop(int(sentinel))) != 0:  # pyright: ignore[reportArgumentType]
                for worker in waiting.values():
                    worker.kill()


def _exit_code(process: Worker) -> int:
    """Returns the exit code of a process that has ended."""
    while (code := process.exitcode) is None:  # another thread is reading it
        time.sleep(0.01)
    return code


def use_one_thread() -> None:
    """Limits this process to one compute thread.

    More threads do not speed up tensors this small, and compete with other processes. A single
    thread also makes sums reproducible.
    """
    torch.set_num_threads(1)
    threadpool_limits(limits=1)


@contextmanager
def compute_threads(count: int) -> Iterator[None]:
    """Lets PyTorch compute in so many threads for a while."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def begin_worker() -> None:
    """Limits this worker process to one compute thread, and ends it when its parent ends."""
    use_one_thread()
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _begin(start: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    begin_worker()
    if start is not None:
        start(*arguments)


def _end_with_parent() -> None:
    """Waits on a pipe that the system closes when the parent exits for any reason."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
