"""The worker processes of a vector environment."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from hab_tasks.errors import HabError, RunStoppedError, WorkerError
from hab_tasks.io.cache import temporary_folder
from hab_tasks.io.pool import Worker, end_all
from hab_tasks.io.shared_arrays import ArraySpec, SharedArrays
from hab_tasks.registration import declared_here
from hab_tasks.vector.layout import Path, RowLayout
from hab_tasks.vector.messages import Connect, WorkerSetup
from hab_tasks.vector.worker import run_worker


class VectorWorkerError(HabError):
    """A worker process ended."""

    def __init__(self, rows: range, ended: WorkerError) -> None:
        super().__init__(
            f"Worker process {ended.pid}, with rows {rows.start} to {rows.stop - 1} of the vector "
            f"environment, {ended.how}. The vector environment is closed; make a new one, with "
            "fewer rows (num_envs) if memory is short."
        )


class _RowsWorker(Worker):
    """A worker with the first rows of its groups, `starts`, and all its rows."""

    def __init__(self, setup: WorkerSetup, starts: tuple[int, ...]) -> None:
        self.starts = starts
        self.rows = range(starts[0], starts[0] + sum(setup.group_sizes))
        self._finished: set[int] = set()
        super().__init__(run_worker, setup)

    def answer(self) -> Any:
        """Returns the answer to a message, or the error if it is due to the message."""
        try:
            return self.receive()
        except (VectorWorkerError, RunStoppedError):
            raise
        except HabError as error:
            return error

    def finish(self, group: int) -> None:
        """Waits for the end of a group's step."""
        while group not in self._finished:
            self._finished.add(self.receive())
        self._finished.discard(group)

    def death(self) -> HabError:
        """Returns an error that names the rows."""
        return VectorWorkerError(self.rows, self.ending())


class WorkerTeam:
    """Starts the workers, and exchanges messages with all of them.

    Attributes:
        closed: Whether the workers have been ended.
    """

    def __init__(self, setups: Sequence[WorkerSetup], starts: Sequence[tuple[int, ...]]) -> None:
        """Starts one worker for each setup; `starts` has the first row of each of its groups."""
        self.closed = False
        self._workers: list[_RowsWorker] = []
        self._shared: SharedArrays | None = None
        # Removed by `close`, or after a kill when the next process creates one.
        self._folder = temporary_folder() if len(setups) > 1 else None
        with self.closed_on_error():
            for one, firsts in zip(setups, starts, strict=True):
                task = declared_here(one.reference)
                setup = replace(one, episodes_folder=self._folder, task=task)
                self._workers.append(_RowsWorker(setup, firsts))

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
        return tuple(worker.pid for worker in self._workers)

    def layout(self) -> RowLayout:
        """Waits until all rows are built; returns their layout."""
        layout, *_ = [worker.receive() for worker in self._workers]
        return layout

    def share(self, specs: dict[str, ArraySpec], info: tuple[Path, ...]) -> dict[str, NDArray[Any]]:
        """Creates arrays, and shares them with the workers."""
        self._shared = SharedArrays(specs)
        for worker in self._workers:
            worker.send(Connect(specs=specs, info=info, starts=worker.starts))
            worker.send_file(self._shared.file)
        for worker in self._workers:
            worker.receive()
        return self._shared.arrays

    def start_step(self, groups: Sequence[int] | range) -> None:
        """Starts a step of these groups."""
        with self.closed_on_error():
            for group in groups:
                for worker in self._workers:
                    worker.send(group)

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
        with self.closed_on_error():
            for worker in self._workers:
                worker.send(message)
            answers = [worker.answer() for worker in self._workers]
        for answer in answers:
            if isinstance(answer, HabError):
                raise answer
        return [value for part in answers if part is not None for value in part]

    def close(self) -> None:
        """Ends the workers and frees the memory."""
        if self.closed:
            return
        self.closed = True
        end_all(self._workers)
        if self._shared is not None:
            self._shared.close()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
