"""Rules of a task: its goal, the progress of each row, and the rewards of its skills (S H.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from torch import Tensor

from hab_tasks.arrays import Bools, Floats, Ints, put_rows, to_tensors
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Focus, Measures, Tracker
from hab_tasks.engine.rows import Rows
from hab_tasks.engine.rules import Rules, StepResult
from hab_tasks.engine.skill_env import Skill
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.skills.navigate import NAVIGATE
from hab_tasks.tasks.base import Condition, Facts, Task
from hab_tasks.world.navigation import poses_reaching

_STATE = ("stages", "part", "done", "succeeded")


class Progress:
    """Progress of each row; advances once per control step.

    Attributes:
        stages: (N,) number of stages reached, in order.
        part: (N,) index of the current part, which pays the reward of this step.
        done: (N,) whether that part has succeeded: the next step belongs to the next part.
        succeeded: (N,) whether it succeeded in this step. The last part stays done, and pays once.
    """

    _flags: Bools
    _told: dict[str, Bools]

    def __init__(self, task: Task, count: int) -> None:
        """Starts all of `count` rows at the first part."""
        self._task = task
        self.stages: Ints = np.zeros(count, dtype=np.int64)
        self.part: Ints = np.zeros(count, dtype=np.int64)
        self.done = self.succeeded = self.stages > 0
        self._everywhere = ~self.done
        self._told_of: Ints | None = None
        self._facts = Facts(task)
        self._objects: Ints = np.array([part.object for part in task.parts])
        self._articulations: Ints = np.array([part.articulation for part in task.parts])

    @property
    def focus(self) -> Focus:
        """Focus of the current parts."""
        return Focus(object=self._objects[self.part], articulation=self._articulations[self.part])

    def begin(self, rows: Sequence[int], s: Snapshot, g: Goals, tracker: Tracker) -> None:
        """Starts `rows` (R,) at the first part."""
        for name in _STATE:
            setattr(self, name, put_rows(getattr(self, name), rows, 0))
        self._flags = self._facts.read(s, g, tracker)

    def move_on(self) -> list[int]:
        """Advances finished rows to the next part; returns those rows."""
        going = self.done & (self.part < len(self._task.parts) - 1)
        if not going.any():
            return []
        self.part = self.part + going
        self.done = self.done & ~going
        return [row for row, went in enumerate(going.tolist()) if went]

    def advance(self, s: Snapshot, m: Measures, g: Goals, tracker: Tracker) -> None:
        """Advances by one control step, with the snapshot and the measures after it."""
        self._flags = self._facts.read(s, g, tracker)
        # The entry after the last stage is the goal; it must not count as a stage.
        reached = self._facts.holds(self._flags, self.stages)
        reached = reached & (self.stages < len(self._task.stages))
        if reached.any():
            self.stages = self.stages + reached
        before = self.done
        for skill, here in self.doing():
            self.done = self.done | (skill.done(s, m, g) & here)
        self.succeeded = self.done & ~before

    def success(self) -> Bools:
        """Whether the task's goal is reached, (N,) bool."""
        return self._facts.holds(self._flags, self._facts.goal)

    def holds(self, condition: Condition) -> Bools:
        """Whether a condition holds in the current step, (N,) bool."""
        return self._facts.holds(self._flags, condition)

    def reached(self) -> dict[str, Bools]:
        """Returns stage name -> (N,) bool, latched; cached until another stage is reached."""
        if self._told_of is not self.stages:
            names = enumerate(self._task.stages)
            self._told = {name: self.stages > i for i, name in names}
            self._told_of = self.stages
        return self._told

    def doing(self) -> list[tuple[Skill, Bools]]:
        """Returns each current skill with a mask of its rows (N,)."""
        skills = [self._task.parts[number].skill for number in self.part.tolist()]
        if len(skills) == 1:
            return [(skills[0], self._everywhere)]
        named = {skill.name: skill for skill in skills}
        return [
            (skill, np.array([other.name == name for other in skills]))
            for name, skill in named.items()
        ]

    def get_state(self) -> dict[str, Tensor]:
        """Returns copies of the complete state by name."""
        return to_tensors({name: getattr(self, name) for name in _STATE})

    def set_state(
        self, state: Mapping[str, Any], rows: Sequence[int], s: Snapshot, g: Goals, tracker: Tracker
    ) -> None:
        """Restores `rows` (R,) from a state of R rows, at the current snapshot."""
        for name in _STATE:
            setattr(self, name, put_rows(getattr(self, name), rows, state[name]))
        self._flags = self._facts.read(s, g, tracker)


_EVENTS = ("force", "left_region", "wrong_object", "dropped_object")
"""Failures of the skills; they do not end a task."""

SHOWN = ("ee_to_object_m", "ee_to_rest_m", "object_to_goal_m", "force_n", "force_total_n")


class TaskRules(Rules):
    """Rules of a `Task`, with the progress of each row."""

    _no_terms: dict[str, Floats] | None = None
    _never: Bools

    def __init__(self, task: Task, rows: Rows) -> None:
        """Applies `task` to all episodes of `rows`."""
        super().__init__(rows)
        self._task = task
        self.progress = Progress(task, len(rows.tracker.targets))

    def step_result(self) -> StepResult:
        """Evaluates the task's success and the reward of the current skill."""
        progress, measures = self.progress, self.rows.measures
        if self._no_terms is None:
            self._no_terms = self._zero_terms()
        return StepResult(
            success=progress.success(),
            failures={},
            reward_terms=partial(self._reward_terms, self.rows.snapshot, measures, self.rows.goals),
            measures=lambda success: measures.scalars(SHOWN),
            unpaid=self._no_terms,
            extra={"stages": progress.reached(), "part": {"number": progress.part}},
        )

    def _reward_terms(
        self, s: Snapshot, m: Measures, g: Goals, ends: dict[str, Bools]
    ) -> dict[str, Floats]:
        """Returns ``skill/term`` -> (N,) of the current skills."""
        never = self._never
        # Neither force nor region ends a task; wrong grasps and drops are penalised once (H.3).
        events: dict[str, Bools] = {
            "force": never,
            "left_region": never,
            "wrong_object": m.picked_other_now,
            "dropped_object": m.dropped_now,
            "success": self.progress.succeeded,
        }
        paid: dict[str, Floats] = {}
        for skill, here in self.progress.doing():
            terms = skill.task_reward_terms(s, m, g, events)
            paid |= {f"{skill.name}/{name}": term * here for name, term in terms.items()}
        return paid

    def _zero_terms(self) -> dict[str, Floats]:
        """Returns all reward terms of the task's skills as zeros (N,)."""
        s, m, g = self.rows.snapshot, self.rows.measures, self.rows.goals
        zeros = s.force_n * 0.0
        self._never = zeros > 0
        nothing: dict[str, Bools] = dict.fromkeys(("success", *_EVENTS), self._never)
        skills = {part.skill.name: part.skill for part in self._task.parts}
        return {
            f"{name}/{term}": zeros
            for name, skill in skills.items()
            for term in skill.task_reward_terms(s, m, g, nothing)
        }

    def masked_gripper(self, gripper: Floats) -> Floats:
        """Returns the gripper actions unchanged; tasks have no mask."""
        return gripper

    # Progress --------------------------------------------------------------------------------

    def begin_rows(self, rows: Sequence[int]) -> None:
        """Starts at the first part."""
        here = self.rows
        self.progress.begin(rows, here.snapshot, here.goals, here.tracker)
        self.turn_to_parts(rows)
        # Restart the tracker with the first part's focus, to clear the previous episode.
        here.tracker.begin(here.snapshot, rows)

    def before_action(self) -> None:
        """Advances finished rows to the next part."""
        rows = self.progress.move_on()
        if rows:
            self.turn_to_parts(rows)

    def after_action(self) -> None:
        """Updates the progress."""
        here = self.rows
        self.progress.advance(here.snapshot, here.measures, here.goals, here.tracker)

    def turn_to_parts(self, rows: Sequence[int]) -> None:
        """Sets focus and navigation goal of `rows` to those of the current parts."""
        here = self.rows
        for row in rows:
            part = self._task.parts[int(self.progress.part[row])]
            if part.skill.name == NAVIGATE.name:
                if part.to == "handle":
                    point = here.snapshot.handles_m[row, part.articulation]
                else:
                    points = here.goals.starts_m if part.to == "start" else here.goals.goals_m
                    point = points[row, part.object]
                self._set_navigation_goal(row, np.array(point.tolist()))
        here.tracker.refocus(here.snapshot, rows, self.progress.focus)

    def _set_navigation_goal(self, row: int, point_m: np.ndarray) -> None:
        """Sets a row's navigation goal to the nearest base pose that reaches a point."""
        here = self.rows
        map_ = here.maps.of(here.episodes[row].scene_id, here.episodes[row].joints)
        poses = poses_reaching(map_, point_m)
        if len(poses):
            base = poses[0]
        else:
            x, y = map_.nearest_free(point_m[:2])
            base = np.array([x, y, np.arctan2(point_m[1] - y, point_m[0] - x)])
        here.tracker.goals = here.goals.changed([row], {"base": base[None]})
        here.set_navigation_goal(row)

    # State -----------------------------------------------------------------------------------

    def get_state(self) -> dict[str, dict[str, Tensor]]:
        """Returns the progress."""
        return {"progress": self.progress.get_state()}

    def set_state(self, state: Mapping[str, Any], rows: Sequence[int]) -> None:
        """Restores the progress."""
        here = self.rows
        self.progress.set_state(state["progress"], rows, here.snapshot, here.goals, here.tracker)
