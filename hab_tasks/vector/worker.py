"""A worker process of a vector environment, with the simulations of its rows."""

from __future__ import annotations

from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.rows import Rows
from hab_tasks.episodes.source import shared_sources
from hab_tasks.errors import HabError
from hab_tasks.io.pool import received_file
from hab_tasks.io.shared_arrays import SharedArrays
from hab_tasks.registration import MAIN, register_task
from hab_tasks.vector.layout import ACTION, RowLayout, info_types
from hab_tasks.vector.messages import CallRows, Connect, ResetRows, WorkerSetup
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


def local_group(setup: WorkerSetup) -> tuple[list[HabEnv], StepGroup, NDArray[Any]]:
    """Returns a worker's only group in this process, for measurements: rows, group, actions."""
    envs = make_rows(setup)
    layout, info = layout_of(envs[0]), (("success",),)
    specs = layout.arrays(len(envs), info, final=False)
    arrays = {name: np.zeros(spec.shape, spec.dtype) for name, spec in specs.items()}
    outputs = GroupOutputs(joined_rows(envs), layout, arrays, info, setup.max_steps)
    return envs, StepGroup(envs, outputs, arrays[ACTION], 0, setup), arrays[ACTION]


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
