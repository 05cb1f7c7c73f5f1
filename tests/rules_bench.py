"""An environment without a simulator: hand-made snapshots go in, what its rules say comes out."""

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from builders import StraightWays, as_arrays, snapshot

from hab_tasks.goals import Goals
from hab_tasks.measures import Tracker
from hab_tasks.skills.hab_env import HabEnv
from hab_tasks.snapshot import Snapshot
from hab_tasks.tasks.task_env import TaskEnv

FIRST = 7
"""Index in the grasp of object 0; the others follow."""


class World:
    """What the rules ask of an environment's world."""

    snapshot: Snapshot

    def __init__(self, tracker: Tracker) -> None:
        self.tracker = tracker

    @property
    def goals(self) -> Goals:
        return self.tracker.goals


class RulesBench:
    """N rows of a skill or task, as tensors or arrays; the base has to go to the world's origin.

    Object k starts at (k + 1, 0, 1) and has to go to (k + 1, 4, 1).

    Attributes:
        env: The environment, of which only the rules work.
        led: (row, point) of every way that a task has asked for.
    """

    def __init__(self, env: type[HabEnv], count: int, *, arrays: bool = False) -> None:
        self.count, self.arrays, self.needs = count, arrays, env.needs
        objects, fronts = env.needs.objects, len(env.needs.fronts)
        starts = torch.tensor([[k + 1.0, 0.0, 1.0] for k in range(objects)])
        goals = replace(
            Goals.empty(count, objects, fronts, "cpu"),
            starts_m=starts.repeat(count, 1, 1),
            goals_m=(starts + torch.tensor([0.0, 4.0, 0.0])).repeat(count, 1, 1),
            joint_upper=torch.full((count, fronts), 2.5),
        )
        self.env: Any = object.__new__(env)
        self.led: list[tuple[int, list[float]]] = []
        self.env._lead = lambda row, point: self.led.append((row, point.tolist()))
        self.tracker = Tracker(self._kind(goals), StraightWays())
        targets = torch.arange(FIRST, FIRST + objects).repeat(count, 1)
        handles = torch.arange(fronts).repeat(count, 1)
        self.tracker.targets = targets.numpy() if arrays else targets
        self.tracker.handles = handles.numpy() if arrays else handles
        self.world = self.env._world = World(self.tracker)
        self.rows = torch.arange(count)

    def moment(self, **values: torch.Tensor) -> Snapshot:
        """A snapshot with the objects at their starts and the base far away, but for `values`."""
        starts = torch.as_tensor(np.asarray(self.world.goals.starts_m))
        usual = {"objects_m": starts.clone(), "base": torch.tensor([[9.0, 0, 0]] * self.count)}
        return snapshot(self.count, fronts=len(self.needs.fronts), **{**usual, **values})

    def begin(self, shot: Snapshot, *parts: int) -> None:
        """Starts all rows; those of a task at these parts."""
        self.world.snapshot = self._kind(shot)
        self.tracker.begin(self.world.snapshot, self.rows)
        self.env.begin_rows(self.rows)
        if parts:
            assert isinstance(self.env, TaskEnv)
            progress, world = self.env._progress, self.world
            state = progress.get_state() | {"part": torch.tensor(parts)}
            targets = self.tracker.targets
            progress.set_state(state, self.rows, world.snapshot, world.goals, targets)
            self.env._turn_to_parts(self.rows.tolist())

    def step(self, shot: Snapshot, stopped: torch.Tensor | None = None) -> dict[str, Any]:
        """One action, after which this is seen; returns `info`."""
        stopped = torch.zeros(self.count, dtype=torch.bool) if stopped is None else stopped
        self.env.before_action()
        self.world.snapshot = self._kind(shot)
        self.tracker.advance(self.world.snapshot, stopped.numpy() if self.arrays else stopped)
        self.env.after_action()
        return self.env.evaluate()

    def _kind(self, x: Any) -> Any:
        return as_arrays(x) if self.arrays else x
