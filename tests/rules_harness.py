"""Evaluation of an environment's rewards and endings on given snapshots, without a simulator."""

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from builders import StraightWays, as_arrays
from builders import snapshot as make_snapshot

from hab_tasks.engine.goals import Goals
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.measures import Tracker
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.tasks.task_env import TaskEnv

FIRST = 7
"""Index in the grasp of object 0; the others follow."""


class EpisodeSimulation:
    """The attributes of `EpisodeSimulation` that rewards and endings use."""

    snapshot: Snapshot
    ee_step_m = 0.015

    def __init__(self, tracker: Tracker) -> None:
        self.tracker = tracker

    @property
    def goals(self) -> Goals:
        return self.tracker.goals


class RulesHarness:
    """N environments of a skill or task, as tensors or arrays; the base's goal is the origin.

    Object k starts at (k + 1, 0, 1) and has to go to (k + 1, 4, 1).

    Attributes:
        env: The environment; only its rewards and endings work.
        navigation_goals: (row, point) of every navigation goal that a task has set.
    """

    def __init__(self, env: type[HabEnv], count: int, *, arrays: bool = False) -> None:
        self.count, self.arrays, self.requirements = count, arrays, env.requirements
        objects, articulations = env.requirements.objects, len(env.requirements.articulations)
        starts = torch.tensor([[k + 1.0, 0.0, 1.0] for k in range(objects)])
        goals = replace(
            Goals.empty(count, objects, articulations, "cpu"),
            starts_m=starts.repeat(count, 1, 1),
            goals_m=(starts + torch.tensor([0.0, 4.0, 0.0])).repeat(count, 1, 1),
            joint_upper=torch.full((count, articulations), 2.5),
        )
        self.env: Any = object.__new__(env)
        self.navigation_goals: list[tuple[int, list[float]]] = []
        self.tracker = Tracker(self._kind(goals), StraightWays())
        targets = torch.arange(FIRST, FIRST + objects).repeat(count, 1)
        handles = torch.arange(articulations).repeat(count, 1)
        self.tracker.targets = targets.numpy() if arrays else targets
        self.tracker.handles = handles.numpy() if arrays else handles
        self.world: Any = EpisodeSimulation(self.tracker)
        self.rules: Any = self.env.rules_of(self.world)
        self.rules._set_navigation_goal = lambda row, point: self.navigation_goals.append(
            (row, point.tolist())
        )
        self.env._simulation, self.env._rules = self.world, self.rules
        self.rows = torch.arange(count)

    def snapshot(self, **values: torch.Tensor) -> Snapshot:
        """A snapshot with the objects at their starts and the base far away, but for `values`."""
        starts = torch.as_tensor(np.asarray(self.world.goals.starts_m))
        usual = {"objects_m": starts.clone(), "base": torch.tensor([[9.0, 0, 0]] * self.count)}
        return make_snapshot(
            self.count, articulations=len(self.requirements.articulations), **{**usual, **values}
        )

    def begin(self, shot: Snapshot, *parts: int) -> None:
        """Starts all episodes; those of a task at the given parts."""
        self.world.snapshot = self._kind(shot)
        self.tracker.begin(self.world.snapshot, self.rows)
        self.rules.begin_rows(self.rows)
        if parts:
            assert isinstance(self.env, TaskEnv)
            progress, world = self.rules.progress, self.world
            state = progress.get_state() | {"part": torch.tensor(parts)}
            progress.set_state(state, self.rows, world.snapshot, world.goals, self.tracker)
            self.rules.turn_to_parts(self.rows.tolist())

    def step(self, shot: Snapshot, stopped: torch.Tensor | None = None) -> dict[str, Any]:
        """Advances one step to a snapshot; returns `info`."""
        stopped = torch.zeros(self.count, dtype=torch.bool) if stopped is None else stopped
        self.rules.before_action()
        self.world.snapshot = self._kind(shot)
        self.tracker.advance(self.world.snapshot, stopped.numpy() if self.arrays else stopped)
        self.rules.after_action()
        return self.env.evaluate()

    def _kind(self, x: Any) -> Any:
        return as_arrays(x) if self.arrays else x
