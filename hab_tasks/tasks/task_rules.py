"""Rules of a task: its goal and stages, and the rewards of its skills (S H.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from torch import Tensor

from hab_tasks.arrays import Bools, Floats
from hab_tasks.engine.goals import Goals
from hab_tasks.engine.measures import Measures
from hab_tasks.engine.rows import Rows
from hab_tasks.engine.rules import Rules, StepResult
from hab_tasks.engine.snapshot import Snapshot
from hab_tasks.skills.navigate import NAVIGATE
from hab_tasks.tasks.base import Task
from hab_tasks.tasks.progress import Progress
from hab_tasks.world.navigation import poses_reaching

_EVENTS = ("force", "left_region", "wrong_object", "dropped_object")
"""Failures of the skills; they do not end a task."""

SHOWN = ("ee_to_object_m", "ee_to_rest_m", "object_to_goal_m", "force_n", "force_total_n")


class TaskRules(Rules):
    """Rules of a `Task`.

    Attributes:
        progress: Progress of each row.
    """

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
            extra={"stages": progress.reached(), "part": progress.current()},
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
