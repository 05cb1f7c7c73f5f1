"""The worker processes of a vector environment: their start, and what runs in them."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.rows import Rows
from hab_tasks.episodes.source import shared_sources
from hab_tasks.errors import HabError, RunStoppedError, WorkerError
from hab_tasks.io.cache import temporary_folder
from hab_tasks.io.pool import Worker, end_all, received_file
from hab_tasks.io.shared_arrays import ArraySpec, SharedArrays
from hab_tasks.registration import MAIN, declared_here, register_task
from hab_tasks.vector.layout import (
    ACTION,
    CallRows,
    Connect,
    Path,
    ResetRows,
    RowLayout,
    WorkerSetup,
    info_types,
)
from hab_tasks.vector.outputs import GroupOutputs


def run_worker(connection: Connection, setup: WorkerSetup) -> None:
    """Builds the rows, and answers messages until the connection is closed."""
    envs = make_rows(setup)
    layout = layout_of(envs[0])
    connection.send(layout)
    connect: Connect = connection.recv()
    shared = SharedArrays(connect.specs, received_file(connection))
    groups, first = [], 0
    for size, start in zip(setup.group_sizes, connect.starts, strict=True):
        arrays = {name: array[start : start + size] for name, array in shared.arrays.items()}
        mine = joined_rows(envs[first : first + size])
        outputs = GroupOutputs(mine, layout, arrays, connect.info, setup.max_steps)
        groups.append(StepGroup(mine, outputs, arrays[ACTION], start, setup))
        first += size
    connection.send(None)
    _answer(connection, groups)


def make_rows(setup: WorkerSetup) -> list[HabEnv]:
    """Returns the environments of all rows of a worker."""
    if setup.task is not None:
        register_task(setup.task, MAIN)
    with shared_sources(setup.episodes_folder):
        envs: list[Any] = [
            gym.make(setup.reference, **setup.options).unwrapped
            for _ in range(sum(setup.group_sizes))
        ]
    return envs


def joined_rows(envs: list[HabEnv]) -> list[HabEnv]:
    """Joins environments made with the same options: one snapshot, measures and rules for all."""
    Rows([env.simulation for env in envs], envs[0].rules_of)
    return envs


def layout_of(env: HabEnv) -> RowLayout:
    """Returns the layout of rows like `env`."""
    return RowLayout(
        observation_space=env.single_observation_space,
        action_space=env.single_action_space,
        info=info_types(env.get_info()),
    )


def _answer(connection: Connection, groups: list[StepGroup]) -> None:
    """Answers messages until the connection is closed."""
    while True:
        message = connection.recv()
        if isinstance(message, int):
            groups[message].step()
            connection.send(message)
            continue
        try:
            connection.send(_value_of(message, groups))
        except HabError as error:
            connection.send(error)


def _value_of(message: ResetRows | CallRows, groups: list[StepGroup]) -> Any:
    if isinstance(message, ResetRows):
        for group in groups:
            group.reset(message)
        return None
    return [value for group in groups for value in group.call(message)]


class StepGroup:
    """One group of the worker's rows: steps, resets and writes the results."""

    def __init__(
        self,
        envs: Sequence[HabEnv],
        outputs: GroupOutputs,
        actions: np.ndarray,
        start: int,
        setup: WorkerSetup,
    ) -> None:
        """The group's first row is row `start` of the vector environment."""
        self._envs, self._outputs, self._actions = envs, outputs, actions
        self._start, self._autoreset = start, setup.autoreset
        self._repeat = setup.action_repeat

    def step(self) -> None:
        """Steps all rows; those that ended are reset before or after it."""
        outputs = self._outputs
        before = self._autoreset is AutoresetMode.NEXT_STEP
        restarted = np.flatnonzero(outputs.ended).tolist() if before else []
        going = [row for row in range(len(self._envs)) if row not in restarted]
        self._execute(going)
        for row in going:
            outputs.write_images(row)
        if restarted:
            for row in restarted:
                outputs.write_images(row, self._envs[row].reset()[0])
            outputs.write_info(restarted)
        outputs.write_entries()
        if self._autoreset is AutoresetMode.SAME_STEP and outputs.ended.any():
            ended = np.flatnonzero(outputs.ended).tolist()
            outputs.keep_final(ended)
            for row in ended:
                outputs.write_images(row, self._envs[row].reset()[0])
            outputs.write_reset()

    def _execute(self, going: list[int]) -> None:
        """Executes the actions of the rows `going`, each until its episode ends."""
        self._outputs.begin_step()
        for _ in range(self._repeat):
            self._envs[0].rows.step({row: self._actions[row] for row in going})
            self._outputs.add_step(going)
            going = [row for row in going if not self._outputs.ended[row]]
            if not going:
                return

    def reset(self, message: ResetRows) -> None:
        """Resets those rows of the message that are in this group."""
        mine = range(self._start, self._start + len(self._envs))
        chosen = [row for row in mine if row in message.seeds]
        for row in chosen:
            here = row - self._start
            seed, options = message.seeds[row], message.options.get(row)
            obs, _ = self._envs[here].reset(seed=seed, options=options)
            self._outputs.write_images(here, obs)
            self._outputs.ended[here] = False
        if chosen:
            self._outputs.write_reset()

    def call(self, message: CallRows) -> list[Any]:
        """Returns the result of a call for each row."""
        values = []
        for here, env in enumerate(self._envs):
            env.elapsed_steps[:] = int(env.rows.steps[here])
            value = env.get_wrapper_attr(message.name)
            if callable(value):
                value = value(*message.arguments, **message.named)
            values.append(value)
        return values


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
    """Starts the workers, and exchanges messages with all of them until they are `closed`."""

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
