"""Choice of an executor by name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated

import tyro

from hab_tasks.errors import OptionError, UnknownNameError
from hab_tasks.io.executors.executor import Executor
from hab_tasks.io.executors.local import LocalExecutor

LOCAL, RAY = "local", "ray"
EXECUTORS = (LOCAL, RAY)


@dataclass(frozen=True, kw_only=True)
class ExecutorChoice:
    """Options that select an executor; part of the options of several commands."""

    executor: Annotated[str, tyro.conf.arg(metavar="NAME")] = LOCAL
    """local: worker processes of this machine; ray: workers of a Ray cluster, which requires the
    package ray. Does not change results."""
    address: Annotated[str | None, tyro.conf.arg(metavar="HOST:PORT")] = None
    """With --executor ray: address of the cluster, or auto for the one on this machine. If not
    given, Ray runs on this machine for the duration of the command."""

    @property
    def is_remote(self) -> bool:
        """Whether workers may be on other machines."""
        return self.executor == RAY

    def check_executor(self) -> None:
        """Checks the options.

        Raises:
            UnknownNameError: Unknown executor.
            OptionError: An address without Ray.
        """
        if self.executor not in EXECUTORS:
            raise UnknownNameError("executor", self.executor, EXECUTORS)
        if self.address is not None and self.executor != RAY:
            raise OptionError(f"--address {self.address} needs --executor ray.")


@contextmanager
def open_executor(
    choice: ExecutorChoice, workers: int = 1, *, device: str = "cpu"
) -> Iterator[Executor]:
    """Yields the chosen executor; a Ray cluster is connected within the context.

    Args:
        choice: The executor.
        workers: Number of worker processes.
        device: Torch device that the jobs use; on Ray, each worker on cuda reserves a GPU.

    Raises:
        OptionError: Ray is not installed, or there is no cluster at the address.
    """
    choice.check_executor()
    if choice.executor == LOCAL:
        yield LocalExecutor(workers)
        return
    # Of an optional package's connection, which none but this choice needs.
    from hab_tasks.io.executors import ray_connection, ray_executor

    if device not in ("cpu", "cuda"):
        raise OptionError(f"device {device!r}: Ray assigns the GPUs, so it has to be cpu or cuda.")
    gpus = int(device == "cuda")
    with ray_connection.connected(choice.address, workers):
        yield ray_executor.RayExecutor(workers, gpus=gpus)
