"""What runs in the server that forks workers, and in the workers; see `hab_tasks.io.pool`."""

from __future__ import annotations

import gc
import importlib
import json
import os
import pickle
import signal
import socket
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from ctypes import CDLL
from multiprocessing import spawn
from multiprocessing.connection import Connection, wait
from typing import Any

import numpy as np

from hab_tasks.errors import reported

STREAMS = (1, 2)
"""File descriptors of standard output and standard error."""

THREADS = "hab_tasks.io.threads"
"""Module that each worker needs; it loads PyTorch."""

PR_SET_PDEATHSIG = 1
"""From Linux's <sys/prctl.h>."""

REQUEST_BYTES = 65536

importing_main = False
"""Whether this process is a worker that imports its parent's main script."""


class ParentConnection(Connection):
    """A worker's end of its pipe; sends copies, where PyTorch would have shared its tensors."""

    def send(self, obj: Any) -> None:
        """Sends a message."""
        self.send_bytes(pickle.dumps(obj))


def program(main: str, path: Sequence[str], *arguments: str) -> list[str]:
    """Returns the command of a new Python that calls a function of this module.

    Args:
        main: The function's name.
        path: Search path. It is set after Python's own modules are there, as a folder of the user
            may have modules of the same names.
        arguments: For ``sys.argv``.
    """
    code = (
        f"import json, multiprocessing.spawn, sys; sys.path[:] = {list(path)}; "
        f"from hab_tasks.io import worker_server; worker_server.{main}()"
    )
    return [sys.executable, "-P", "-c", code, *arguments]


def received(channel: socket.socket, size: int, most: int) -> tuple[bytes, list[int]]:
    """Returns at most so many bytes and files from a socket; no bytes at its end."""
    closed_by_exec = getattr(socket, "MSG_CMSG_CLOEXEC", 0)
    data, files, _, _ = socket.recv_fds(channel, size, most, closed_by_exec)
    return data, files


def serve_forks() -> None:
    """Main function of the server: forks workers, and tells their process ids and exit codes.

    It ends at once with the process that started it, and kills its workers.
    """
    control, modules = socket.socket(fileno=int(sys.argv[1])), sys.argv[2:]
    woken, wake = socket.socketpair()
    wake.setblocking(False)
    signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    statuses: dict[int, Connection] = {}
    while True:
        ready = wait([control, woken])
        if woken in ready:
            woken.recv(4096)
            _tell_exits(statuses)
        if control not in ready:
            continue
        request, files = received(control, REQUEST_BYTES, 2 + len(STREAMS))
        if not request:
            for pid in statuses:
                os.kill(pid, signal.SIGKILL)
            os._exit(0)  # without freeing what it has imported, which takes a second
        variables = json.loads(request)
        while variables is None and modules:
            with suppress(Exception):  # the worker will import it, and report the error
                importlib.import_module(modules.pop(0))
        server, (channel, status, *streams) = os.getpid(), files
        told = Connection(status, readable=False)
        if pid := os.fork():
            for number in (channel, *streams):
                os.close(number)
            with suppress(OSError):  # the parent has been interrupted or killed
                told.send(pid)
            statuses[pid] = told
            continue
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for one in (control, woken, wake, told, *statuses.values()):
            one.close()
        _begin_worker(server, channel, streams, variables)


def _tell_exits(statuses: dict[int, Connection]) -> None:
    """Sends the exit codes of workers that have ended."""
    for pid in list(statuses):
        ended, code = os.waitpid(pid, os.WNOHANG)
        if ended:
            with suppress(OSError), statuses.pop(pid) as told:
                told.send(os.waitstatus_to_exitcode(code))


def _begin_worker(
    server: int, channel: int, streams: Sequence[int], variables: Mapping[str, str] | None
) -> None:
    """Makes a process that the server has forked one with its parent's output, and calls."""
    if sys.platform == "linux":  # the kernel kills it with its server, even in a library's call
        CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != server:  # it ended before
            os._exit(1)
    for number, sent in zip(STREAMS, streams, strict=True):
        os.dup2(sent, number)
        os.close(sent)
    if variables is not None:
        os.set_inheritable(channel, True)
        command = program("serve_call", sys.path, str(channel))
        os.execve(command[0], command, {**os.environ, **variables})
    gc.freeze()  # what the server has imported is no garbage
    _call(ParentConnection(channel))


def serve_call() -> None:
    """Main function of a worker that imports everything itself."""
    _call(ParentConnection(int(sys.argv[1])))


def _call(connection: Connection) -> None:
    """Does what the parent has sent; ends the process, wherever a signal to end interrupts it."""
    code = 1
    try:
        code = _exit_code(connection)
    finally:
        os._exit(code)


def _exit_code(connection: Connection) -> int:
    """Does what the parent has sent; returns 0, or 1 after an error, which it reports."""
    try:
        variables, data, call = connection.recv()
        os.environ.clear()
        os.environ.update(variables)
        signal.signal(signal.SIGTERM, _terminate)
        _prepare(data)
        np.random.seed()  # noqa: NPY002, all have forked the same state
        function, arguments = pickle.loads(call)
        importlib.import_module(THREADS).use_one_thread()
        function(connection, *arguments)
        return 0
    except _TerminatedError:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGTERM)
    except BaseException as error:
        with suppress(OSError):  # the parent has closed the pipe, or was killed
            connection.send(reported("A worker process failed", error))
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
    return 1


class _TerminatedError(BaseException):
    """Lets a process that is to end remove its scratch files first."""


def _terminate(*_: object) -> None:
    raise _TerminatedError


def _prepare(data: dict[str, Any]) -> None:
    """Takes over search path, arguments, working directory and main script."""
    global importing_main
    importing_main = True
    spawn.prepare(data)
    importing_main = False
