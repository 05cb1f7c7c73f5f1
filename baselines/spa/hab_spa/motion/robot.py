"""The robot's interface for skills, which are motions (`hab_plans.motion`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from hab_plans.motion import GRASP, RELEASE, Command, Failure
from hab_plans.protocols import MotionPlanner, PathResult

from hab_spa.motion.follow import FollowConfig, TimingConfig
from hab_spa.planning.arm_plan import PLANNERS, BatchedPlanner, OmplPlanner, PlanConfig
from hab_spa.planning.batch import search_kernel
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.escape import EscapeConfig
from hab_spa.planning.ik import BatchArm, CompiledArm, pose_table
from hab_spa.planning.joint_goal import GoalConfig
from hab_spa.planning.place_goal import PlacingConfig
from hab_spa.scenes.scene import Scene
from hab_spa.shapes import Array
from hab_tasks.errors import UnknownNameError
from hab_tasks.robots.spec import RobotSpec


@dataclass(frozen=True, kw_only=True)
class SpaConfig:
    """Parameters of sense-plan-act.

    Attributes:
        retries: Maximum replans of a skill after an execution failure.
        grasp_steps: Maximum steps until a grasp holds.
        release_steps: Steps to wait after a release.
        goal, placing, plan, escape, timing, follow: Parameters of the stages.
        planner: Plans the motions of the arm.
        kinematics: Class of its kinematics.
    """

    retries: int = 2
    grasp_steps: int = 15
    release_steps: int = 4
    goal: GoalConfig = field(default_factory=GoalConfig)
    placing: PlacingConfig = field(default_factory=PlacingConfig)
    plan: PlanConfig = field(default_factory=PlanConfig)
    escape: EscapeConfig = field(default_factory=EscapeConfig)
    timing: TimingConfig = field(default_factory=TimingConfig)
    follow: FollowConfig = field(default_factory=FollowConfig)
    planner: MotionPlanner[ArmCollision, PlanConfig] = field(default_factory=OmplPlanner)
    kinematics: type[BatchArm] = BatchArm

    def planned_by(self, name: str, robot: RobotSpec) -> SpaConfig:
        """Returns the parameters with a planner by name, for a robot.

        Raises:
            UnknownNameError: There is no such planner.
        """
        if name not in PLANNERS:
            raise UnknownNameError("planner", name, PLANNERS)
        if name == "ompl":
            return replace(self, planner=OmplPlanner(), kinematics=BatchArm)
        search_kernel()  # compiled or read here, not in the first plan
        pose_table(robot)
        return replace(self, planner=BatchedPlanner(), kinematics=CompiledArm)


TRAIL_RAD, BACK_POSES = 0.04, 10
"""Spacing of the poses of the trail, and the number of those through which the arm backs off."""


SWING_STEPS = 8
"""Steps after which the arm has come to rest when the base has stopped."""


class Robot:
    """The robot of one row: scene model, latest command and remaining time.

    Attributes:
        scene: Scene model.
        config: Parameters of the skills.
        spec: Its specification.
        kinematics: Kinematics of the arm.
        gripper: Gripper entry of the commands.
        steps: Number of commands executed in this episode.
        deadline: Step by which the current skill should end.
        doing: Current activity, as text.
        held_up: (3,) direction in the end-effector's frame that was up before the held object was
            grasped; None if unknown.
        timings_s: Time spent on ``target`` (goal sampling), ``motion`` (motion planning) and
            ``plan`` (their sum) in this episode [s].
        failure: The latest failure.
        obs: The latest observation of the environment.
        trace: Log of beliefs and actions, one entry per motion of a task's plan.
    """

    def __init__(self, scene: Scene, config: SpaConfig, *, seed: int, deadline: int) -> None:
        """Starts an episode, after `scene` has processed its first observation."""
        self.scene, self.config, self.spec = scene, config, scene.robot
        self.kinematics = config.kinematics(scene.robot)
        # An episode of Place begins with the object in the hand.
        self.gripper = GRASP if scene.holding else RELEASE
        self.steps, self.deadline, self.doing = 0, deadline, ""
        self.timings_s = {"target": 0.0, "motion": 0.0, "plan": 0.0}
        self.failure: Failure | None = None
        self.obs: Mapping[str, Any] = {}
        self.trace: list[dict[str, Any]] = []
        self.held_up: Array | None = None
        self._seeds = np.random.default_rng(seed)
        self._arm_rad = scene.arm_qpos.copy()
        self._trail: list[Array] = []
        self._rolled = -SWING_STEPS

    @property
    def steps_left(self) -> int:
        """Remaining steps of the current skill."""
        return self.deadline - self.steps

    @property
    def settle_steps(self) -> int:
        """Steps beyond the deadline in which a motion may still come to rest."""
        return self.config.follow.settle_steps

    @property
    def arm_target_rad(self) -> Array:
        """The latest commanded arm pose (J,)."""
        return self._arm_rad

    @property
    def base(self) -> Array:
        """Base pose x, y [m], yaw [rad] (3,) in the world."""
        pose = self.scene.world_from_base
        return np.array((*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])))

    @property
    def world_from_ee(self) -> Array:
        """(4, 4) pose of the end-effector; the torso is locked."""
        return self.scene.world_from_base @ self.kinematics.ee_pose(self.scene.arm_qpos)

    def command(
        self,
        arm_rad: Array | None = None,
        base: tuple[float, float] = (0.0, 0.0),
        pose: Array | None = None,
    ) -> Command:
        """Returns a command; the arm keeps its latest targets by default."""
        if arm_rad is not None:
            self._arm_rad = np.array(arm_rad, dtype=float)
        if any(base):
            self._rolled = self.steps
            self._trail.clear()  # elsewhere, the same arm poses need not be free
        return Command(arm_rad=self._arm_rad, gripper=self.gripper, base=base, pose=pose)

    @property
    def swings(self) -> bool:
        """Whether the arm may still swing since the base has rolled."""
        return self.steps - self._rolled < SWING_STEPS

    def relax(self) -> None:
        """Sets the arm's targets to its current pose."""
        self._arm_rad = self.scene.arm_qpos.copy()

    def leave_trail(self) -> None:
        """Notes the arm's pose for `back_off`."""
        pose = self.scene.arm_qpos
        if not self._trail or np.abs(pose - self._trail[-1]).max() > TRAIL_RAD:
            self._trail.append(pose.copy())

    def back_off(self) -> list[Array]:
        """Takes the latest poses (J,) from the trail, in which the arm was free, latest first."""
        back = self._trail[: -BACK_POSES - 1 : -1]
        del self._trail[-BACK_POSES:]
        return back

    def up(self) -> Array:
        """Returns the current upward direction (3,) in the end-effector's frame."""
        return self.kinematics.ee_pose(self.scene.arm_qpos)[2, :3].copy()

    def next_seed(self) -> int:
        """Returns the seed of the next search."""
        # Another one for each search: a retry with the same numbers would fail as before.
        return int(self._seeds.integers(2**31 - 1))

    def plan(
        self, goals: Array, collision: ArmCollision, limits: PlanConfig | None = None
    ) -> PathResult:
        """Plans a path from the current arm pose to one of the goals (G, J), best first.

        Args:
            goals: The goals, near obstacles.
            collision: The current model.
            limits: Parameters of the planner; the robot's by default.
        """
        start, limits = self.scene.arm_qpos.copy(), limits or self.config.plan
        seed = self.next_seed()
        result = self.config.planner.plan(start, goals, collision, seed=seed, limits=limits)
        self.spend("motion", result.seconds)
        return result

    def spend(self, stage: str, seconds: float) -> None:
        """Adds time spent on ``target`` or ``motion``."""
        self.timings_s[stage] += seconds
        self.timings_s["plan"] += seconds
