"""The team that executes a plan: a learned or planned skill for each stage, and navigation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

from hab_spa.motion.drive import DriveConfig, drive_to, leave, reverse
from hab_spa.motion.robot import Motion, Robot
from hab_spa.results import Failure
from hab_spa.shapes import Array
from hab_spa.tasks import navigate
from hab_spa.tasks.interactions import Hands, interaction
from hab_spa.tasks.standing import Standing, StandingConfig, choose

from hab_tasks.constants import SKILL_HORIZON_STEPS
from hab_tasks.tasks.base import Task
from hab_tp_srl.base_poses import TURNING_M, start_pose
from hab_tp_srl.ending import Ending
from hab_tp_srl.navigation import NavigatorPolicy
from hab_tp_srl.policies import SkillPolicy, Turn
from hab_tp_srl.skill import learned, learned_navigation, turn_of
from hab_tp_srl.stage import Stage
from hab_tp_srl.training_starts import features
from hab_tp_srl.view import TaskView

ORACLE_STEPS = 1000
"""Maximum number of steps of the oracle's navigation: twice Navigate's horizon."""


@dataclass(kw_only=True, eq=False)
class Tries:
    """What was tried for a stage.

    Attributes:
        standings: Base poses.
        drive: The policy that navigated; None without one.
        before: The one that navigated last in this episode.
    """

    standings: list[Standing] = field(default_factory=list)
    drive: Turn | None = None
    before: Turn | None = None


@dataclass(frozen=True, kw_only=True)
class Team:
    """Who executes what.

    Attributes:
        policies: Skill -> policy, or None for planning.
        navigation: ``oracle``, ``perfect`` or ``learned``.
        navigate: Policy of learned navigation.
        privileged: Whether robots have ground truth.
        true_knowledge: Whether learned skills know it too.
    """

    policies: Mapping[str, SkillPolicy | None]
    navigation: str
    navigate: SkillPolicy | NavigatorPolicy | None
    privileged: bool
    true_knowledge: bool

    @property
    def learned(self) -> list[SkillPolicy | NavigatorPolicy]:
        """Returns all policies."""
        found = [*self.policies.values(), self.navigate]
        return [policy for policy in found if policy is not None]

    def is_planned(self, stage: Stage) -> bool:
        """Returns whether a stage's skill is planned."""
        return self.policies[stage.skill] is None

    def executor(self, stage: Stage) -> str:
        """Returns who executes a stage's skill, for the trace."""
        policy = self.policies[stage.skill]
        return "spa_priv" if policy is None else policy.name

    def start(self, stage: Stage, view: TaskView) -> str | None:
        """Returns whether training knows a start like this one, for the trace.

        Returns:
            ``known`` or ``new``; None for a planned skill, and where training starts are unknown.
        """
        policy = self.policies[stage.skill]
        if policy is None or policy.starts is None:
            return None
        entries = view.entries(stage, view.point(stage))
        point_m = entries["extra", "point_in_base"].astype(float)
        found = features(point_m, entries["agent", "ee_position"].astype(float))
        return "known" if policy.starts.include(found) else "new"

    def skill_steps(self, stage: Stage) -> int:
        """Returns the maximum number of steps of a stage's skill."""
        policy = self.policies[stage.skill]
        return SKILL_HORIZON_STEPS if policy is None else policy.horizon_steps

    def skill(self, robot: Robot, task: Task, stage: Stage, view: TaskView) -> Motion:
        """Returns the motion of a stage's skill."""
        policy = self.policies[stage.skill]
        view.begin(stage)
        if stage.skill == "place" and not robot.scene.holding:
            return _nothing_held()
        if policy is None:
            return interaction(task, stage.action, Hands()).skill(robot)
        ending = Ending(task, stage, view, robot.scene if self.true_knowledge else None)
        return learned(robot, stage, policy, view, ending)

    def go(
        self,
        robot: Robot,
        task: Task,
        stage: Stage,
        view: TaskView,
        tries: Tries,
    ) -> Motion:
        """Returns the motion of the navigation before a stage.

        Args:
            robot: The robot.
            task: The task.
            stage: The stage.
            view: What the robot observes.
            tries: What was tried before; a new base pose is appended, if there is one.
        """
        if self.navigate is not None:
            turn = tries.drive
            if turn is None or not self._stands(stage) or not self.navigate.goes_on(turn):
                turn = turn_of(robot, self.navigate)
                turn.before, tries.drive, tries.before = tries.before, turn, turn
            return learned_navigation(robot, stage, turn, view)
        if self.is_planned(stage):
            return self._go_to_plan(robot, task, stage, tries.standings)
        return self._go_to_start(robot, task, stage, tries.standings)

    def _stands(self, stage: Stage) -> bool:
        """Returns whether the base stands still while a stage's skill runs."""
        policy = self.policies[stage.skill]
        return policy is not None and policy.control.base == "still"

    @property
    def navigation_steps(self) -> int:
        """Maximum number of steps of a navigation.

        Navigate's horizon is one of a skill. The longest ways through the apartment take the
        oracle more steps.
        """
        return ORACLE_STEPS if self.navigate is None else self.navigate.horizon_steps

    def _go_to_plan(self, robot: Robot, task: Task, stage: Stage, tried: list[Standing]) -> Motion:
        """Goes to a base pose from which the skill can be planned, as TP+SPA does."""
        item, map_ = interaction(task, stage.action, Hands()), robot.scene.floor_map()
        request = navigate.NavigationRequest(
            point_m=item.point_m(robot),
            map=map_,
            choose_base_pose=partial(choose, robot, item, map_, tried, StandingConfig()),
        )
        return (yield from navigate.NAVIGATORS[self.navigation](robot, request))

    def _go_to_start(self, robot: Robot, task: Task, stage: Stage, tried: list[Standing]) -> Motion:
        """Goes to a base pose from which the skill's training starts."""
        others = [other.base for other in tried]
        base = start_pose(robot, task, stage, robot.scene.floor_map(), others)
        tried.append(Standing(base=base, arm_rad=robot.scene.arm_qpos.copy()))
        return (yield from self.drive(robot, base))

    def drive(self, robot: Robot, base: Array) -> Motion:
        """Drives to a base pose (3,), with ground truth."""
        robot.doing = "navigate"
        config = DriveConfig(turning_m=TURNING_M)  # the arm sticks out in front
        return (yield from drive_to(robot, robot.scene.floor_map(), base, config))

    def back_off(self, robot: Robot) -> Motion:
        """Drives straight back, if there is room; without a map, until something is in the way."""
        robot.doing, config = "navigate", DriveConfig()
        if self.navigate is not None:
            return (yield from reverse(robot, config.before_m, config))
        yield from leave(robot, robot.scene.floor_map(), config)
        return None

    def go_again(
        self, robot: Robot, task: Task, stage: Stage, view: TaskView, tries: Tries
    ) -> Motion:
        """Returns to where it was before it backed off; a policy, to where it likes best now."""
        if self.navigate is not None:
            return self.go(robot, task, stage, view, tries)
        return self.drive(robot, tries.standings[-1].base)


def _nothing_held() -> Motion:
    """Fails at once: there is nothing to place."""
    yield from ()
    return Failure.EXECUTION
