"""The robot as its skills command it, and what a skill is.

A skill is a generator: it yields one `Command` for each control step, and is resumed when the
scene has been seen again. It returns None when it worked out, else what failed.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from hab_spa.motion.follow import FollowConfig
from hab_spa.planning.arm_plan import PlanConfig
from hab_spa.planning.escape import EscapeConfig
from hab_spa.planning.ik import BatchArm
from hab_spa.planning.joint_goal import GoalConfig
from hab_spa.planning.path import TimingConfig
from hab_spa.planning.place_goal import PlacingConfig
from hab_spa.results import Failure
from hab_spa.scenes.scene import Scene
from hab_spa.shapes import Array

GRASP, RELEASE = 1.0, -1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Command:
    """What is done in one control step.

    Attributes:
        arm_rad: (7,) joint targets.
        gripper: `GRASP` or `RELEASE`.
        base: Forward and turning velocity, as shares of the largest ones.
        pose: (3,) where the base is put at once, in modes that can; None: where it stands.
    """

    arm_rad: Array
    gripper: float
    base: tuple[float, float] = (0.0, 0.0)
    pose: Array | None = None


Motion: TypeAlias = Generator[Command, None, Failure | None]
"""A skill being done."""


@dataclass(frozen=True, kw_only=True)
class SpaConfig:
    """The numbers of sense, plan and act.

    Attributes:
        retries: How often a skill plans again after an execution failure.
        grasp_steps: A grasp must hold after this many steps.
        release_steps: After letting go, the hand stays this many steps.
        goal, placing, plan, escape, timing, follow: Numbers of the stages.
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


class Robot:
    """One row's robot: what it knows, what it was told last, and the time that is left.

    Attributes:
        scene: What it knows of the world.
        config: The numbers of its skills.
        kinematics: Of its arm.
        gripper: Entry of every command until it is changed.
        steps: How many commands were carried out in this episode.
        deadline: The skill being done should be over by this step.
        doing: What it is doing, in words.
        held_up: (3,) direction in the end-effector's frame that was up when what is held stood;
            None when nobody saw it stand.
        timings_s: Time spent on ``target`` (goal sampling), ``motion`` (motion planning) and
            ``plan`` (their sum) in this episode [s].
        failure: What failed last, for whoever tries something else then.
        obs: The latest observation of the environment.
        trace: What it believed and did, action by action of a task's plan.
    """

    def __init__(self, scene: Scene, config: SpaConfig, *, seed: int, deadline: int) -> None:
        """Starts an episode, whose first observation `scene` has seen."""
        self.scene, self.config, self.kinematics = scene, config, BatchArm()
        self.gripper = GRASP if scene.holding else RELEASE
        self.steps, self.deadline, self.doing = 0, deadline, ""
        self.timings_s = {"target": 0.0, "motion": 0.0, "plan": 0.0}
        self.failure: Failure | None = None
        self.obs: Mapping[str, Any] = {}
        self.trace: list[dict[str, Any]] = []
        self.held_up: Array | None = None
        self._seeds = np.random.default_rng(seed)
        self._arm_rad = scene.arm_qpos.copy()

    @property
    def steps_left(self) -> int:
        """How many steps the skill being done may still take."""
        return self.deadline - self.steps

    @property
    def base(self) -> Array:
        """x, y [m] and yaw [rad] (3,) of the base in the world."""
        pose = self.scene.world_from_base
        return np.array((*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])))

    @property
    def world_from_ee(self) -> Array:
        """(4, 4) pose of the end-effector; the torso stands where it is locked."""
        return self.scene.world_from_base @ self.kinematics.ee_pose(self.scene.arm_qpos)

    def command(
        self,
        arm_rad: Array | None = None,
        base: tuple[float, float] = (0.0, 0.0),
        pose: Array | None = None,
    ) -> Command:
        """Returns a command; the arm's last targets are kept for None."""
        if arm_rad is not None:
            self._arm_rad = np.array(arm_rad, dtype=float)
        return Command(arm_rad=self._arm_rad, gripper=self.gripper, base=base, pose=pose)

    def relax(self) -> None:
        """Makes the arm's present pose its target."""
        self._arm_rad = self.scene.arm_qpos.copy()

    def up(self) -> Array:
        """Returns the direction (3,) in the end-effector's frame that points up now."""
        return self.kinematics.ee_pose(self.scene.arm_qpos)[2, :3].copy()

    def next_seed(self) -> int:
        """Returns the seed of the next search."""
        return int(self._seeds.integers(2**31 - 1))

    def spend(self, stage: str, seconds: float) -> None:
        """Counts time spent on ``target`` or ``motion``."""
        self.timings_s[stage] += seconds
        self.timings_s["plan"] += seconds
