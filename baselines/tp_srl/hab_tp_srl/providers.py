"""Skills of TP+SRL as providers of the plan's executor: learned, or planned."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from hab_plans.motion import RELEASE, Failure, Motion
from hab_plans.plan import Action
from hab_plans.protocols import BasePose, SkillProvider
from hab_plans.stage import Stage
from hab_spa.motion.moves import wait
from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array
from hab_spa.tasks.planned_skills import SKILLS as PLANNED_SKILLS
from hab_spa.tasks.planned_skills import PlannedSkill

from hab_tasks.tasks.base import Task
from hab_tp_srl.base_poses import TURNING_M, features, start_pose
from hab_tp_srl.ending import Ending
from hab_tp_srl.hand_over import reset_arm
from hab_tp_srl.policies import AgentPolicy, SkillPolicy
from hab_tp_srl.sight import Look
from hab_tp_srl.skill import learned
from hab_tp_srl.view import TaskView

BETWEEN_LOOKS, MOST_WATCHED, SAME_M = 10, 60, 0.01
"""What was placed is looked at every so many steps, until it lies where it lay in the last look."""

AFTER_STEPS = 350
"""Most steps after a skill: to rest and look, and to put back what is not the target."""

REACHED_M = 1.8
"""No arm on a base that stands reaches a point so far from it: the navigator has not arrived."""

Policies = Mapping[str, Sequence[SkillPolicy | AgentPolicy | SkillProvider[Robot] | None]]
"""Skill -> policies, providers of another package, or None for planning, in turn."""


def providers(
    task: Task, policies: Policies, view: TaskView, knows: bool
) -> dict[str, SkillProvider[Robot]]:
    """Returns the providers of a task's skills, for the robot of one row.

    Args:
        task: The task.
        policies: Who executes each skill.
        view: What the robot observes.
        knows: Whether the robot notices that a learned skill's effect does not hold.
    """
    placing = policies.get("place", ())
    kinds = (SkillPolicy, AgentPolicy)  # a learned one, as it takes no time to plan
    put = next((one for kind in kinds for one in placing if isinstance(one, kind)), None)
    found: dict[str, SkillProvider[Robot]] = {}
    for skill, ones in policies.items():
        parts: list[SkillProvider[Robot]] = []
        for one in ones:
            if one is None:
                parts.append(PlannedPart(**vars(PLANNED_SKILLS[skill]), view=view))
            elif isinstance(one, SkillPolicy | AgentPolicy):
                learned = LearnedSkill(
                    task=task, policy=one, view=view, knows_effect=knows, put=put
                )
                parts.append(learned)
            else:
                parts.append(one)
        found[skill] = parts[0] if len(parts) == 1 else InTurn(parts=parts)
    return found


@dataclass(kw_only=True, eq=False)
class InTurn:
    """A skill by several providers: each further attempt of a stage is by the next one.

    Attributes:
        parts: The providers.
    """

    parts: Sequence[SkillProvider[Robot]]
    _starts: Counter[Action] = field(default_factory=Counter)
    _now: int = 0

    @property
    def name(self) -> str:
        """Name of the one whose turn it is, or was last."""
        return self.parts[self._now].name

    @property
    def knows_effect(self) -> bool:
        """See `SkillProvider`."""
        return self.parts[self._now].knows_effect

    @property
    def horizon_steps(self) -> int:
        """See `SkillProvider`."""
        return self.parts[self._now].horizon_steps

    def can_start(self, robot: Robot, stage: Stage) -> bool:
        """See `SkillProvider`."""
        return self.parts[0].can_start(robot, stage)

    def base_pose(self, robot: Robot, stage: Stage, tried: Sequence[BasePose]) -> BasePose | None:
        """See `SkillProvider`."""
        return self._next(stage).base_pose(robot, stage, tried)

    def start_of(self, robot: Robot, stage: Stage) -> str | None:
        """See `SkillProvider`."""
        return self.parts[self._now].start_of(robot, stage)

    def start(self, robot: Robot, stage: Stage) -> Motion:
        """Returns the motion of the one whose turn it is."""
        provider = self._next(stage)
        self._starts[stage.action] += 1
        return provider.start(robot, stage)

    def _next(self, stage: Stage) -> SkillProvider[Robot]:
        self._now = self._starts[stage.action] % len(self.parts)
        return self.parts[self._now]


@dataclass(frozen=True, kw_only=True, eq=False)
class LearnedSkill:
    """A skill by a policy.

    Attributes:
        task: The task.
        policy: The policy.
        view: What the robot observes.
        knows_effect: See `SkillProvider`.
        put: Policy that puts back what was picked by mistake.
    """

    task: Task
    policy: SkillPolicy | AgentPolicy
    view: TaskView
    knows_effect: bool
    put: SkillPolicy | AgentPolicy | None = None

    @property
    def name(self) -> str:
        """Name of the policy."""
        return self.policy.name

    @property
    def horizon_steps(self) -> int:
        """Maximum number of steps, with those to see what came of it."""
        return self.policy.horizon_steps + (AFTER_STEPS if self.view.sees else 0)

    def can_start(self, robot: Robot, stage: Stage) -> bool:
        """Whether there is something in the hand to place."""
        return _can_start(robot, stage)

    def base_pose(self, robot: Robot, stage: Stage, tried: Sequence[BasePose]) -> BasePose:
        """Returns a base pose from which the skill's training starts."""
        others = [other.base for other in tried]
        base = start_pose(robot, stage, robot.scene.floor_map(), others)
        # The arm sticks out in front.
        return BasePose(base=base, arm_rad=robot.scene.arm_qpos.copy(), turning_m=TURNING_M)

    def start_of(self, robot: Robot, stage: Stage) -> str | None:
        """Returns whether training knows a start like this one, for the trace.

        Returns:
            ``known`` or ``new``; None where training starts are unknown.
        """
        if self.policy.starts is None:
            return None
        entries = self.view.entries(stage, self.view.point(stage))
        point_m = entries["extra", "point_in_base"].astype(float)
        found = features(point_m, entries["agent", "ee_position"].astype(float))
        return "known" if self.policy.starts.include(found) else "new"

    def start(self, robot: Robot, stage: Stage) -> Motion:
        """Returns the motion of the skill."""
        self.view.begin(stage)
        if not _can_start(robot, stage) or self._is_far(stage):
            return _not_started()
        ending = Ending(self.task, stage, self.view, robot.scene if self.view.truth else None)
        return self._run(robot, stage, ending)

    def _is_far(self, stage: Stage) -> bool:
        """Whether a robot that feels where it is knows that its arm cannot reach the point."""
        if not self.view.feels or self.policy.control.base != "still":
            return False
        point_m = self.view.entries(stage, self.view.point(stage))["extra", "point_in_base"]
        return float(np.hypot(point_m[0], point_m[1])) > REACHED_M

    def _run(self, robot: Robot, stage: Stage, ending: Ending) -> Motion:
        if self.view.sees:
            if stage.articulation is not None:
                return (yield from self._move(robot, stage, ending, stage.articulation))
            if self.policy.control.base == "still":  # two looks from one place can be compared
                return (yield from self._handle(robot, stage, ending))
        return (yield from self._act(robot, stage, ending, self.view.point(stage)))

    def _act(self, robot: Robot, stage: Stage, ending: Ending, point_m: Array) -> Motion:
        failure = yield from learned(robot, stage, self.policy, self.view, ending, point_m)
        self.view.end(stage, failure is None)
        return failure

    def _move(self, robot: Robot, stage: Stage, ending: Ending, number: int) -> Motion:
        """Opens or closes; whether a door or drawer is closed is seen."""
        view, closes = self.view, stage.action.verb == "close"
        before = view.look(robot.spec)
        if closes and view.see_closed(before, stage, number):
            return None
        view.see_front(before, number)
        failure = yield from self._act(robot, stage, ending, view.point(stage))
        if not closes:
            view.see_opened(view.look(robot.spec), number)
            return failure
        closed = view.see_closed(view.look(robot.spec), stage, number)
        return None if closed else failure or Failure.EXECUTION

    def _handle(self, robot: Robot, stage: Stage, ending: Ending) -> Motion:
        """Picks or places; which object was taken, and where it came to lie, is seen."""
        view, point_m = self.view, self.view.point(stage)
        before = view.look(robot.spec)
        if stage.skill == "place":
            view.see_held(before)
        elif view.see_moved(before, stage.object, point_m):
            return Failure.EXECUTION  # the next attempt is there
        view.see_all(before)
        failure = yield from self._act(robot, stage, ending, point_m)
        if stage.skill == "place":
            yield from self._watch(robot, stage, before)
            view.see_all(view.look(robot.spec))
        elif stage.drawer is None and view.holding:
            yield from reset_arm(robot)  # so that it hides what it hid before
            if view.took_other(robot.spec, before, point_m):
                yield from self._put_back(robot, stage)
                return Failure.EXECUTION
        return failure

    def _watch(self, robot: Robot, stage: Stage, before: Look) -> Motion:
        """Looks at what was placed until it no longer moves, as cans roll."""
        view, steps = self.view, 0
        seen_m = view.see_placed(robot.spec, stage.object, before)
        while seen_m is not None and steps < MOST_WATCHED:
            yield from wait(robot, BETWEEN_LOOKS)
            steps, last_m = steps + BETWEEN_LOOKS, seen_m
            seen_m = view.see_placed(robot.spec, stage.object, before)
            if seen_m is None or np.linalg.norm(seen_m - last_m) < SAME_M:
                break
        return None

    def _put_back(self, robot: Robot, stage: Stage) -> Motion:
        """Puts what is not the target back to where the hand took it."""
        view = self.view
        point_m = view.take_for_other()
        if self.put is not None:
            placing = replace(stage, skill="place", at="goal")
            ending = Ending(self.task, placing, view, None)
            yield from learned(robot, placing, self.put, view, ending, point_m)
        robot.gripper = RELEASE


@dataclass(frozen=True, kw_only=True)
class PlannedPart(PlannedSkill):
    """A planned skill between learned ones.

    Attributes:
        view: What the learned ones observe; it has to know which skill begins.
    """

    view: TaskView

    def can_start(self, robot: Robot, stage: Stage) -> bool:
        """Whether there is something in the hand to place."""
        return _can_start(robot, stage)

    def start(self, robot: Robot, stage: Stage) -> Motion:
        """Returns the motion of the skill."""
        self.view.begin(stage)
        return super().start(robot, stage) if _can_start(robot, stage) else _not_started()


def _can_start(robot: Robot, stage: Stage) -> bool:
    return stage.skill != "place" or robot.scene.holding


def _not_started() -> Motion:
    """Fails at once: there is nothing to place, or nothing in reach."""
    yield from ()
    return Failure.EXECUTION
