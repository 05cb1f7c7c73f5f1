"""Worker processes of this machine: the only place that starts, watches and ends them.

A server imports what workers need and forks them: importing PyTorch and ManiSkill takes seconds, a
fork milliseconds. The simulator and Vulkan do not survive a fork: the server only imports them.

This process and the server talk over a socket pair. multiprocessing's fork server listens on a
named socket instead, which a killed parent leaves behind, and gives workers neither this process's
environment variables nor its output; both could only be changed in its private members.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import spawn
from multiprocessing.connection import Connection, Pipe, wait
from typing import Any, Generic, Self, TypeVar

from hab_tasks.errors import HabError, WorkerError, check_open_files
from hab_tasks.io import worker_server
from hab_tasks.io.worker_server import STREAMS, THREADS, program, received

J = TypeVar("J")
R = TypeVar("R")

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Variables with which libraries start no threads when they are imported."""

CLEAN_UP_S = 1.0
"""Time in which a process that has to end removes its scratch files."""

END_S = 5.0
"""Time in which a process that was killed, or whose pipe is at its end, is gone."""


class Worker:
    """A process that calls a function with its end of a pipe; the other end is here.

    It has this process's environment variables, working directory and output, and one compute
    thread. Ctrl-C does nothing in it: it reaches all processes, and the parent ends its workers.
    It ends when this process ends, even if that is killed.

    Attributes:
        pid: The process id.
        connection: This process's end of the pipe.
    """

    def __init__(
        self,
        function: Callable[..., None],
        *arguments: Any,
        variables: Mapping[str, str] | None = None,
    ) -> None:
        """Starts the process, and the server if there is none yet.

        Args:
            function: Called as function(connection, *arguments). Known by its module and name.
            arguments: Pickled.
            variables: More environment variables for a process that imports everything itself,
                with these already set; None to fork the process from what the server has imported.

        Raises:
            WorkerError: The server was killed.
            HabError: The limit of open files is too low, or a worker imports a main script that
                starts workers whenever it is imported.
        """
        if worker_server.importing_main:
            raise HabError(
                "Workers import the main script, so put what it does under "
                "`if __name__ == '__main__':`."
            )
        server = start_server(function.__module__)
        self._owner, self._code = os.getpid(), None
        self.connection, theirs = Pipe()
        self._status, status = Pipe(duplex=False)
        try:
            with theirs, status, open(os.devnull, "wb") as null:
                files = [theirs.fileno(), status.fileno(), *_streams(null.fileno())]
                socket.send_fds(server.control, [json.dumps(variables).encode()], files)
            self.pid = int(self._status.recv())
        except (EOFError, ConnectionError) as error:
            raise WorkerError(None, -signal.SIGKILL) from error
        data = spawn.get_preparation_data("worker")
        del data["authkey"]  # cannot be pickled
        if not os.path.exists(data.get("init_main_from_path", "/")):  # that of `python -`
            del data["init_main_from_path"]
        call = pickle.dumps((function, arguments))
        self.send((dict(os.environ) | dict(variables or {}), data, call))

    def send(self, message: Any) -> None:
        """Sends a message.

        Raises:
            HabError: The process has ended: what it reported before, or that it was killed.
        """
        try:
            self.connection.send_bytes(pickle.dumps(message))
        except OSError:
            while True:  # what it sent before is still in the pipe, in the end an error
                self.receive()

    def receive(self) -> Any:
        """Waits for a message.

        Raises:
            HabError: The function raised: this error, or a RunStoppedError that tells of another.
            WorkerError: The process was killed.
        """
        try:
            message = self.connection.recv()
        except (EOFError, OSError) as error:
            raise self.death() from error
        if isinstance(message, HabError):
            raise message
        return message

    def death(self) -> HabError:
        """Returns the error for a process that has ended; subclasses tell what it was doing."""
        return self.ending()

    def ending(self) -> WorkerError:
        """Returns how the process has ended."""
        return WorkerError(self.pid, self.exit_code(END_S))

    def exit_code(self, within_s: float = 0.0) -> int | None:
        """Returns the exit code, minus the signal if one killed it; None if it runs on."""
        if self._code is None and not self._status.closed and self._status.poll(within_s):
            try:
                self._code = int(self._status.recv())
            except EOFError:
                self._code = -signal.SIGKILL  # with the server
        return self._code

    def send_file(self, descriptor: int) -> None:
        """Sends a file; the process calls `received_file`."""
        with socket.socket(fileno=os.dup(self.connection.fileno())) as channel:
            socket.send_fds(channel, [b"f"], [descriptor])

    def end(self, within_s: float = 0.0) -> None:
        """Closes the pipe, and kills the process if it does not end by itself in this time."""
        end_all([self], within_s)


def received_file(connection: Connection) -> int:
    """Returns the descriptor of a file that the parent has sent; it is the caller's to close."""
    with socket.socket(fileno=os.dup(connection.fileno())) as channel:
        (descriptor,) = received(channel, 1, 1)[1]
    return descriptor


def end_all(workers: Sequence[Worker], within_s: float = 0.0) -> None:
    """Ends workers together; see `Worker.end`."""
    for worker in workers:
        worker.connection.close()
    mine = [worker for worker in workers if worker._owner == os.getpid()]
    for number, waits_s in ((signal.SIGTERM, within_s), (signal.SIGKILL, CLEAN_UP_S)):
        deadline = time.monotonic() + waits_s
        for worker in mine:
            if worker.exit_code(max(0.0, deadline - time.monotonic())) is None:
                with suppress(ProcessLookupError):
                    os.kill(worker.pid, number)
    for worker in mine:
        worker.exit_code(END_S)
        worker._status.close()


class WorkerPool(Generic[J, R]):
    """Workers that do jobs, each one at a time; they end with the context.

    Raises:
        HabError: A job raised this error, or a RunStoppedError that tells of another.
        WorkerError: A worker was killed.
    """

    def __init__(
        self, count: int, start: Callable[..., Callable[[J], R]], arguments: tuple[Any, ...] = ()
    ) -> None:
        """Starts `count` workers; each calls `start`, which returns what does a job."""
        start_server(start.__module__)
        self._workers = [Worker(_do_jobs, start, arguments) for _ in range(count)]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        end_all(self._workers)

    def run(self, jobs: Iterable[J]) -> Iterator[tuple[int, R]]:
        """Yields (number of the job, result) in order of completion."""
        waiting = iter(enumerate(jobs))
        doing: dict[Any, tuple[Worker, int]] = {}

        def give(worker: Worker) -> None:
            for number, job in waiting:
                worker.send(job)
                doing[worker.connection] = worker, number
                return

        for worker in self._workers:
            give(worker)
        while doing:
            for connection in wait(list(doing)):
                worker, number = doing.pop(connection)
                result = worker.receive()
                give(worker)  # before the caller takes the result
                yield number, result


def in_order(results: Iterable[tuple[int, R]]) -> Iterator[R]:
    """Yields results in the order of their numbers, which count from 0."""
    early: dict[int, R] = {}
    count = 0
    for number, result in results:
        early[number] = result
        while count in early:
            yield early.pop(count)
            count += 1


def _do_jobs(
    connection: Connection, start: Callable[..., Callable[[Any], Any]], arguments: tuple[Any, ...]
) -> None:
    work = start(*arguments)
    while True:
        connection.send(work(connection.recv()))


# The server ----------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class _Server:
    process: subprocess.Popen[bytes]
    control: socket.socket


_server: _Server | None = None


def start_server(*modules: str) -> _Server:
    """Starts the server, unless it runs already.

    Args:
        modules: What it imports before it forks the first worker.

    Raises:
        HabError: The limit of open files is too low.
    """
    global _server
    check_open_files()
    if _server is not None and _server.process.poll() is None:
        return _server
    ours, theirs = socket.socketpair()
    path = spawn.get_preparation_data("server")["sys_path"]
    imports = dict.fromkeys((THREADS, *modules))
    out, err = _streams(subprocess.DEVNULL)
    # Blocked in this process, SIGINT is blocked in all that it starts, also while Python starts.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process = subprocess.Popen(
            program("serve_forks", path, str(theirs.fileno()), *imports),
            env={**os.environ, **ONE_THREAD},
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
        )
        _server = _Server(process=process, control=ours)
    finally:
        theirs.close()
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return _server


def _forget_server() -> None:
    """Gives workers of a forked process a server of their own."""
    global _server
    if _server is not None:
        _server.control.close()
        _server = None


os.register_at_fork(after_in_child=_forget_server)


def _streams(instead: int) -> list[int]:
    """Returns the descriptors of this process's output, `instead` of those that are closed."""

    def is_open(number: int) -> bool:
        with suppress(OSError):
            return bool(os.fstat(number))
        return False

    return [number if is_open(number) else instead for number in STREAMS]
