"""The worker processes of a vector environment."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from multiprocessing import reduction
from multiprocessing.connection import Connection, Pipe
from typing import Any

from numpy.typing import NDArray

from hab_tasks import processes
from hab_tasks.cache import temporary_folder
from hab_tasks.errors import HabError, RunStoppedError
from hab_tasks.registration import declared_here
from hab_tasks.vector.layout import Path, RowLayout
from hab_tasks.vector.messages import (
    STEP,
    Answer,
    Connect,
    WorkerSetup,
    packed,
    step_message,
    unpacked,
)
from hab_tasks.vector.shared_arrays import ArraySpec, SharedArrays
from hab_tasks.vector.worker import run_worker

END_TIMEOUT_S = 5.0


class VectorWorkerError(HabError):
    """A worker process ended."""

    def __init__(self, rows: range, pid: int | None, exit_code: int | None) -> None:
        signal = exit_code is not None and exit_code < 0
        how = f"was killed by signal {-(exit_code or 0)}" if signal else f"ended ({exit_code})"
        why = ", possibly for lack of memory" if signal else ""
        remedy = "make a new one, with fewer rows (num_envs) if memory is short"
        if exit_code == 1:  # as Python ends a process that cannot import the script
            remedy = (
                "workers import the main script, so put what it does under "
                "`if __name__ == '__main__':`"
            )
        super().__init__(
            f"Worker process {pid}, with rows {rows.start} to {rows.stop - 1} of the vector "
            f"environment, {how}{why}. The vector environment is closed; {remedy}."
        )


@dataclass(kw_only=True)
class _Worker:
    process: processes.Worker
    connection: Connection
    starts: tuple[int, ...]
    rows: range
    finished: set[int] = field(default_factory=set)

    def send(self, data: bytes) -> None:
        try:
            self.connection.send_bytes(data)
        except OSError as error:
            raise self._ended() from error

    def receive(self) -> bytes:
        try:
            return self.connection.recv_bytes()
        except (EOFError, OSError) as error:
            raise self._ended() from error

    def answer(self) -> Any:
        """Returns the value of the next answer; raises its error."""
        return _value(unpacked(self.receive()))

    def finish(self, group: int) -> None:
        """Waits for the end of a group's step."""
        while group not in self.finished:
            data = self.receive()
            if data[:1] != STEP:
                _value(unpacked(data))
            self.finished.add(data[1])
        self.finished.discard(group)

    def _ended(self) -> VectorWorkerError:
        self.process.join(END_TIMEOUT_S)
        return VectorWorkerError(self.rows, self.process.pid, self.process.exitcode)


def _value(answer: Answer) -> Any:
    if answer.crash is not None:
        first, _, details = answer.crash.partition("\n")
        raise RunStoppedError(
            f"A worker of the vector environment failed: {first}", details=details
        )
    if answer.error is not None:
        raise answer.error
    return answer.value


class WorkerTeam:
    """Starts the workers, and exchanges messages with all of them.

    Attributes:
        closed: Whether the workers have been ended.
    """

    def __init__(self, setups: Sequence[WorkerSetup], starts: Sequence[tuple[int, ...]]) -> None:
        """Starts one worker for each setup; `starts` has the first row of each of its groups."""
        self.closed = False
        self._workers: list[_Worker] = []
        self._shared: SharedArrays | None = None
        # Removed by `close`, or after a kill when the next process creates one.
        self._folder = temporary_folder() if len(setups) > 1 else None
        with self.closed_on_error():
            for one, firsts in zip(setups, starts, strict=True):
                task = declared_here(one.reference)
                setup = replace(one, episodes_folder=self._folder, task=task)
                ours, theirs = Pipe()
                process = processes.Worker(
                    target=run_worker, args=(theirs, setup), daemon=True, name="hab_tasks rows"
                )
                process.start()
                theirs.close()
                rows = range(firsts[0], firsts[0] + sum(setup.group_sizes))
                self._workers.append(
                    _Worker(process=process, connection=ours, starts=firsts, rows=rows)
                )

    @contextlib.contextmanager
    def closed_on_error(self) -> Iterator[None]:
        """Ends the workers if an exception leaves the context, Ctrl-C included."""
        try:
            yield
        except BaseException:
            self.close()
            raise

    @property
    def pids(self) -> tuple[int, ...]:
        """Process ids of the workers."""
        return tuple(worker.process.pid or 0 for worker in self._workers)

    def layout(self) -> RowLayout:
        """Waits until all rows are built; returns their layout."""
        layout, *_ = [worker.answer() for worker in self._workers]
        return layout

    def share(self, specs: dict[str, ArraySpec], info: tuple[Path, ...]) -> dict[str, NDArray[Any]]:
        """Creates arrays, and shares them with the workers."""
        self._shared = SharedArrays(specs)
        for worker in self._workers:
            worker.send(packed(Connect(specs=specs, info=info, starts=worker.starts)))
            reduction.send_handle(worker.connection, self._shared.file, worker.process.pid)
        for worker in self._workers:
            worker.answer()
        return self._shared.arrays

    def start_step(self, groups: Sequence[int] | range) -> None:
        """Starts a step of these groups."""
        with self.closed_on_error():
            for group in groups:
                for worker in self._workers:
                    worker.send(step_message(group))

    def finish_step(self, groups: Sequence[int] | range) -> None:
        """Waits for the steps of these groups."""
        with self.closed_on_error():
            for group in groups:
                for worker in self._workers:
                    worker.finish(group)

    def ask(self, message: Any) -> list[Any]:
        """Sends a message to all workers; returns their values, joined.

        Raises:
            HabError: The first error that a worker reported; all of them stay alive.
        """
        with self._closed_unless_answered():
            for worker in self._workers:
                worker.send(packed(message))
            answers = [unpacked(worker.receive()) for worker in self._workers]
            values = [_value(answer) for answer in answers]
        return [value for part in values if part is not None for value in part]

    @contextlib.contextmanager
    def _closed_unless_answered(self) -> Iterator[None]:
        """Ends the workers on any error but one that a worker reported about its input."""
        try:
            yield
        except HabError as error:
            if isinstance(error, VectorWorkerError | RunStoppedError):
                self.close()
            raise
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Ends the workers and frees the memory."""
        if self.closed:
            return
        self.closed = True
        for worker in self._workers:
            worker.connection.close()
            worker.process.terminate()
        for worker in self._workers:
            worker.process.join(END_TIMEOUT_S)
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
            worker.process.close()
        if self._shared is not None:
            self._shared.close()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
