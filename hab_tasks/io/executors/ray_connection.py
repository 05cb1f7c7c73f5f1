"""Connection to a Ray cluster, or a temporary Ray instance on this machine."""

from __future__ import annotations

import importlib
import importlib.util
import ipaddress
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

from hab_tasks.errors import OptionError, RunStoppedError

INSTALL = "pip install 'ray>=2.30'"
AUTO = "auto"
CONNECT_TIMEOUT_S = 5.0
STATUS_TIMEOUT_S = 30.0
OBJECT_STORE_BYTES = 200_000_000
"""For results on their way; Ray would reserve 30 % of the memory."""


def imported_ray() -> Any:
    """Returns the module `ray`, with its usage statistics switched off.

    Raises:
        OptionError: It is not installed.
    """
    if importlib.util.find_spec("ray") is None:
        raise OptionError(f"--executor ray needs the package ray, which is missing: {INSTALL}")
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    return importlib.import_module("ray")


@contextmanager
def connected(address: str | None, workers: int) -> Iterator[None]:
    """Connects this process to a cluster, or starts Ray on this machine if `address` is None.

    A Ray that is started here listens on the loopback interface only. At the end, it and all
    workers have ended.

    Raises:
        OptionError: Ray is not installed, or there is no cluster at the address.
        RunStoppedError: Ray could not be started, or would listen on other interfaces.
    """
    ray = imported_ray()
    if address is not None:
        _check_address(address)
    options: dict[str, Any] = {"address": address or "local"}
    if address is None:
        # Ray adds 15, which on a busy machine makes workers slower than local ones.
        os.environ.setdefault("RAY_worker_niceness", "0")
        options |= {
            "num_cpus": workers,
            "object_store_memory": OBJECT_STORE_BYTES,
            "include_dashboard": False,
        }
    try:
        with _signals_kept(), nullcontext() if address else _on_loopback(ray):
            ray.init(**options, log_to_driver=False, logging_level="error")
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        ray.shutdown()
        if address is not None:
            raise _no_cluster(address, str(error)) from error
        raise RunStoppedError(f"Ray could not be started: {error}") from error
    except BaseException:  # Ctrl-C
        ray.shutdown()
        raise
    try:
        yield
    finally:
        ray.shutdown()


@contextmanager
def _on_loopback(ray: Any) -> Iterator[None]:
    """Starts Ray on the loopback address, as it does by itself on Windows and macOS.

    Its servers listen on all interfaces if their node has any other address, and run the code of
    everyone who connects.

    Raises:
        RunStoppedError: Ray started on another address nevertheless.
    """
    constants: Any = importlib.import_module("ray._private.ray_constants")
    variable = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"  # read by this process before, and by new ones
    before = os.environ.get(variable), getattr(constants, "ENABLE_RAY_CLUSTER", None)
    os.environ[variable], constants.ENABLE_RAY_CLUSTER = "0", False
    try:
        yield
    finally:
        del os.environ[variable]
        if before[0] is not None:
            os.environ[variable] = before[0]
        constants.ENABLE_RAY_CLUSTER = before[1]
    address = ray.util.get_node_ip_address()
    if not ipaddress.ip_address(address).is_loopback:
        ray.shutdown()
        raise RunStoppedError(
            f"Ray {ray.__version__} listens on all interfaces of this machine ({address}). Use "
            "--executor local, or start a cluster behind a firewall and name it with --address."
        )


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Restores the signal handlers of this process, which Ray replaces."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _check_address(address: str) -> None:
    """Checks that a cluster answers; Ray itself would try for minutes, and end the process."""
    if address == AUTO:
        return
    host, colon, port = address.rpartition(":")
    if not (colon and host and port.isdigit() and 0 < int(port) < 65536) or "/" in host:
        raise OptionError(f"--address {address!r}: it has to be HOST:PORT or auto.")
    try:
        socket.create_connection((host, int(port)), CONNECT_TIMEOUT_S).close()
    except OSError as error:
        raise _no_cluster(address, error.strerror or str(error)) from error
    status = (sys.executable, "-m", "ray.scripts.scripts", "status", "--address", address)
    try:
        done = subprocess.run(status, capture_output=True, timeout=STATUS_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise _no_cluster(address, "no answer") from error
    if done.returncode != 0:
        raise _no_cluster(address, "the answer is not Ray's")


def _no_cluster(address: str, reason: str) -> OptionError:
    lines = reason.strip().splitlines() or [""]
    return OptionError(
        f"--address {address}: no Ray cluster ({lines[0].rstrip('.')}). Start one with `ray start "
        "--head --disable-usage-stats`; this machine has to be one of its nodes."
    )
