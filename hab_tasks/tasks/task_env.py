"""The environment that runs a task: its own goal and stages, and the reward of its skills (H.3)."""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from hab_tasks.arrays import Rows, to_tensor
from hab_tasks.goals import Goals
from hab_tasks.measures import Measures
from hab_tasks.navigation import poses_reaching
from hab_tasks.robots.control_modes import MOBILE_MODES
from hab_tasks.sensors import PROPRIOCEPTION, handles_in_base, targets_in_base
from hab_tasks.skills.hab_env import HabEnv, Verdict
from hab_tasks.skills.navigate import NAVIGATE
from hab_tasks.skills.needs import Needs
from hab_tasks.skills.recorded_state import shaped_like, with_columns
from hab_tasks.snapshot import Snapshot
from hab_tasks.tasks.base import Condition, Task
from hab_tasks.tasks.progress import Progress

_EVENTS = ("force", "left_region", "wrong_object", "dropped_object")
"""Failures of the skills; in a task they end nothing."""

SHOWN = ("ee_to_object_m", "ee_to_rest_m", "object_to_goal_m", "force_n", "force_total_n")


class TaskEnv(HabEnv):
    """Runs one `Task`; see `HabEnv` for the options.

    ``info`` also holds ``stages`` (name -> whether it was reached, in order and for good) and
    ``part``, with the ``number`` of what is being done, which pays the reward.
    """

    task: ClassVar[Task]
    _progress: Progress
    _no_terms: dict[str, Tensor]
    _never: Rows

    def __init_subclass__(cls) -> None:
        """Takes over what the task says."""
        task = cls.task
        cls.name, cls.horizon_steps = task.name, task.horizon_steps
        cls.needs = Needs(
            objects=task.objects, fronts=task.fronts, goals=True, navigates=True, takes="any"
        )
        cls.control_modes = MOBILE_MODES
        cls.observation = (*PROPRIOCEPTION, targets_in_base(task.objects))
        cls.handle = handles_in_base(len(task.fronts)) if task.fronts else None
        cls.reward_bound = max(part.skill.reward_bound for part in task.parts)

    def judge(self, snapshot: Snapshot, measures: Measures) -> Verdict:
        """Success is the task's; the reward is that of the skill being done."""
        progress, goals = self._progress, self._world.goals
        return Verdict(
            success=progress.success(),
            failures={},
            reward_terms=partial(self._reward_terms, snapshot, measures, goals),
            measures=lambda success: measures.scalars(SHOWN),
            unpaid=self._no_terms,
            extra={"stages": progress.reached(), "part": progress.current()},
        )

    def _reward_terms(
        self, s: Snapshot, m: Measures, g: Goals, ends: dict[str, Rows]
    ) -> dict[str, Rows]:
        """Returns ``skill/term`` -> (N,) of the skills that are being done."""
        never = self._never
        # No force ends a task, and no region; what the hand does wrong is paid once (H.3).
        events = {
            "force": never,
            "left_region": never,
            "wrong_object": m.picked_other_now,
            "dropped_object": m.dropped_now,
            "success": self._progress.succeeded,
        }
        paid: dict[str, Rows] = {}
        for skill, here in self._progress.doing():
            terms = skill.reward_terms(s, m, g, skill.config, events)
            paid |= {f"{skill.name}/{name}": term * here for name, term in terms.items()}
        return paid

    def _zero_terms(self) -> dict[str, Tensor]:
        """Returns every term that a skill of this task can pay, as zeros (N,)."""
        s, m, g = self._world.snapshot, self.measures, self._world.goals
        zeros = s.force_n * 0.0
        self._never = zeros > 0
        nothing = dict.fromkeys(("success", *_EVENTS), self._never)
        skills = {part.skill.name: part.skill for part in self.task.parts}
        return {
            f"{name}/{term}": to_tensor(zeros)
            for name, skill in skills.items()
            for term in skill.reward_terms(s, m, g, skill.config, nothing)
        }

    def masked_gripper(self, gripper: Rows, measures: Measures) -> Rows:
        """Masks nothing."""
        return gripper

    # Progress --------------------------------------------------------------------------------

    def begin_rows(self, rows: Tensor) -> None:
        """Starts at the first part."""
        if not hasattr(self, "_progress"):
            self._progress = Progress(self.task, self._world.tracker.focus.object)
            self._no_terms = self._zero_terms()
        world = self._world
        self._progress.begin(rows, world.snapshot, world.goals, world.tracker.targets)
        self._turn_to_parts(rows.tolist())
        # Anew, now that it is about the first part: nothing of an earlier episode is left.
        world.tracker.begin(world.snapshot, rows)

    def before_action(self) -> None:
        """Goes on to the next part where one is done."""
        rows = self._progress.move_on()
        if rows:
            self._turn_to_parts(rows)

    def after_action(self) -> None:
        """Looks what was reached."""
        world = self._world
        self._progress.advance(world.snapshot, self.measures, world.goals, world.tracker.targets)

    def _turn_to_parts(self, rows: list[int]) -> None:
        """Makes measures and ways those of the present parts of `rows`."""
        world = self._world
        for row in rows:
            part = self.task.parts[int(self._progress.part[row])]
            if part.skill is NAVIGATE:
                if part.to == "handle":
                    point = world.snapshot.handles_m[row, part.front]
                else:
                    points = world.goals.starts_m if part.to == "start" else world.goals.goals_m
                    point = points[row, part.object]
                self._lead(row, np.array(point.tolist()))
        world.tracker.refocus(world.snapshot, rows, self._progress.focus)

    def _lead(self, row: int, point_m: np.ndarray) -> None:
        """Makes the nearest base pose from which a point can be reached the row's goal."""
        world = self._world
        map_ = world.maps.of(world.episodes[row].scene_id, world.episodes[row].joints)
        poses = poses_reaching(map_, point_m)
        if len(poses):
            base = poses[0]
        else:
            x, y = map_.nearest_free(point_m[:2])
            base = np.array([x, y, np.arctan2(point_m[1] - y, point_m[0] - x)])
        world.tracker.goals = world.goals.changed([row], {"base": base[None]})
        world.lead(row)

    def holds(self, condition: Condition) -> Tensor:
        """Returns whether a condition on the task's things holds now, by success's rules, (N,)."""
        return to_tensor(self._progress.holds(condition))

    # State -----------------------------------------------------------------------------------

    def get_state_dict(self) -> dict[str, Any]:
        """Returns `HabEnv`'s state and the progress."""
        progress = with_columns(self._progress.get_state())
        return {**super().get_state_dict(), "progress": progress}

    def set_state_dict(self, state: dict[str, Any], env_idx: Tensor | None = None) -> None:
        """Restores what `get_state_dict` returned."""
        rest = {name: value for name, value in state.items() if name != "progress"}
        super().set_state_dict(rest, env_idx)
        rows = torch.arange(self.num_envs, device=self.device) if env_idx is None else env_idx
        known = self._progress.get_state()
        world = self._world
        restored = shaped_like(state["progress"], known, len(rows), self.device)
        targets = world.tracker.targets
        self._progress.set_state(restored, rows, world.snapshot, world.goals, targets)
