"""Evaluation of an environment's rewards and endings on given snapshots, without a simulator."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from builders import StraightWays, goals_of
from builders import snapshot as make_snapshot

from hab_tasks.engine.goals import Goals
from hab_tasks.engine.hab_env import HabEnv
from hab_tasks.engine.measures import Measures, Tracker
from hab_tasks.engine.rules import Evaluation
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.tasks.task_env import TaskEnv

FIRST = 7
"""Index in the grasp of object 0; the others follow."""


class World:
    """The attributes of `Rows` that rewards and endings use."""

    snapshot: Snapshot
    rules: Any
    ee_step_m = 0.015

    def __init__(self, tracker: Tracker) -> None:
        self.tracker = tracker

    @property
    def goals(self) -> Goals:
        return self.tracker.goals

    @property
    def measures(self) -> Measures:
        return self.tracker.measures

    def evaluate(self) -> Evaluation:
        return self.rules.evaluate()


class RulesHarness:
    """N rows of a skill or task; the base's goal is the origin.

    Object k starts at (k + 1, 0, 1) and has to go to (k + 1, 4, 1).

    Attributes:
        env: The environment; only its rewards and endings work, for all rows at once.
        navigation_goals: (row, point) of every navigation goal that a task has set.
    """

    def __init__(self, env: type[HabEnv], count: int) -> None:
        self.count, self.requirements = count, env.requirements
        objects, articulations = env.requirements.objects, len(env.requirements.articulations)
        starts = np.array([[k + 1.0, 0.0, 1.0] for k in range(objects)], dtype=np.float32)
        goals = goals_of(
            count,
            objects,
            articulations,
            starts_m=np.tile(starts, (count, 1, 1)),
            goals_m=np.tile(starts + np.float32((0.0, 4.0, 0.0)), (count, 1, 1)),
            joint_upper=np.full((count, articulations), 2.5, dtype=np.float32),
        )
        self.env: Any = object.__new__(type(env.__name__, (env,), {"here": slice(None)}))
        self.navigation_goals: list[tuple[int, list[float]]] = []
        self.tracker = Tracker(goals, StraightWays())
        self.tracker.targets = np.tile(np.arange(FIRST, FIRST + objects), (count, 1))
        self.tracker.handles = np.tile(np.arange(articulations), (count, 1))
        self.world: Any = World(self.tracker)
        self.rules = self.world.rules = self.env.rules_of(self.world)
        self.rules._set_navigation_goal = lambda row, point: self.navigation_goals.append(
            (row, point.tolist())
        )
        self.env.simulation = SimpleNamespace(rows=self.world)
        self.rows = range(count)

    def snapshot(self, **values: Any) -> Snapshot:
        """A snapshot with the objects at their starts and the base far away, but for `values`."""
        far = np.float32([[9.0, 0, 0]] * self.count)
        usual = {"objects_m": self.world.goals.starts_m, "base": far}
        return make_snapshot(
            self.count, articulations=len(self.requirements.articulations), **{**usual, **values}
        )

    def begin(self, shot: Snapshot, *parts: int) -> None:
        """Starts all episodes; those of a task at the given parts."""
        self.world.snapshot = shot
        self.tracker.begin(shot, self.rows)
        self.rules.begin_rows(self.rows)
        if parts:
            assert issubclass(type(self.env), TaskEnv)
            progress, world = self.rules.progress, self.world
            state = progress.get_state() | {"part": np.array(parts)}
            progress.set_state(state, self.rows, shot, world.goals, self.tracker)
            self.rules.turn_to_parts(self.rows)

    def step(self, shot: Snapshot, stopped: Any = None) -> dict[str, Any]:
        """Advances one step to a snapshot; returns `info`."""
        self.rules.before_action()
        self.world.snapshot = shot
        stopped = np.zeros(self.count, dtype=bool) if stopped is None else np.array(stopped)
        self.tracker.advance(shot, stopped)
        self.rules.after_action()
        return self.env.evaluate()
