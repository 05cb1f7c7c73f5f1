"""Looking around before a skill, and closer where that is not enough (S App. D, SPA)."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np

from hab_spa.motion.moves import follow
from hab_spa.motion.robot import Command, Robot
from hab_spa.planning.arm_plan import Ends, PlanConfig, plan_path
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.ik import BatchArm
from hab_spa.planning.joint_goal import apart, in_arm, near_rest
from hab_spa.scenes.seen_scene import SeenScene
from hab_spa.shapes import Array
from hab_tasks.robots.cameras import PLACES
from hab_tasks.robots.fetch_spec import EE_OFFSET_M

ASIDE_RAD = (
    (-0.93, -1.22, 0.15, 0.75, -0.01, 2.16, -0.01),
    (-1.05, -1.22, -0.06, 0.84, -0.07, 2.16, -0.01),
    (-1.10, -1.22, 0.30, 0.48, 0.19, 2.16, -0.01),
)
"""Arm poses next to the resting one that leave the view of the head's camera free."""

EE_FROM_CAMERA_M = np.array(PLACES["arm"].position_m) - np.array((EE_OFFSET_M, 0.0, 0.0))
"""Where the hand's camera sits; it looks where the hand points, along x."""


@dataclass(frozen=True, kw_only=True)
class LookConfig:
    """The numbers of looking around.

    Attributes:
        every_steps: On its way the hand's camera looks this often.
        share: Of the time left that one way of the arm may take.
        poses: Random arm poses from which one is chosen that shows an object from near.
        spread_rad: Their standard deviation around the resting pose.
        distance_m: From this near to this far the hand looks at an object ...
        angle_rad: ... which is at most this far from the middle of the picture ...
        down_rad: ... while it looks down by at least and at most this much.
        margin_m: The arm keeps this far from everything there.
        plan: Of the ways; when one is not easily found, what is seen so far has to do.
    """

    every_steps: int = 5
    share: float = 0.2
    poses: int = 3000
    spread_rad: float = 0.7
    distance_m: tuple[float, float] = (0.25, 0.7)
    angle_rad: float = 0.45
    down_rad: tuple[float, float] = (0.15, 1.0)
    margin_m: float = 0.03
    plan: PlanConfig = field(default_factory=lambda: PlanConfig(time_limit_s=2.0))


def look_around(
    robot: Robot, scene: SeenScene, config: LookConfig
) -> Generator[Command, None, None]:
    """Looks; then, with a free hand, moves the arm out of the picture and looks again."""
    robot.doing = "look"
    scene.look()
    if not scene.holding:
        yield from _look_from(robot, scene, np.array(ASIDE_RAD), scene.collision(), config)


def look_closer(
    robot: Robot, scene: SeenScene, number: int, config: LookConfig
) -> Generator[Command, None, None]:
    """Looks with the hand's camera at an object that the head does not see standing on anything."""
    if scene.holding or scene.stands(number):
        return
    robot.doing = "look closer"
    collision = scene.collision()
    object_m = in_arm(scene.object_m(number)[None], collision)[0]
    rng = np.random.default_rng(robot.next_seed())
    poses = near_rest(rng, config.poses, config.spread_rad)
    poses = poses[_shows(robot.kinematics, poses, object_m, config)]
    poses = poses[np.argsort(np.abs(poses - scene.arm_qpos).max(axis=1))]
    collision.set_margin(config.margin_m)
    free = np.array([pose for pose in poses if collision.is_free(pose)]).reshape(-1, 7)
    if len(free):
        goals = apart(free, robot.config.goal)
        yield from _look_from(robot, scene, goals, collision, config)


def _look_from(
    robot: Robot, scene: SeenScene, poses: Array, collision: ArmCollision, config: LookConfig
) -> Generator[Command, None, None]:
    """Moves the arm to one of some poses (P, 7), looking on the way and there."""
    start = scene.arm_qpos.copy()
    ends = [Ends(open=start, tight=pose) for pose in poses]
    result = plan_path(collision, robot.kinematics, ends, robot.next_seed(), config.plan)
    robot.spend("motion", result.seconds)
    if result.path is None:
        return
    for step, command in enumerate(follow(robot, result.path, config.share)):
        if step % config.every_steps == 0:
            scene.look()
        yield command
    scene.look()


def _shows(arm: BatchArm, poses: Array, object_m: Array, config: LookConfig) -> list[bool]:
    """Whether the hand's camera, in each of some arm poses (P, 7), would show an object well.

    Args:
        arm: Kinematics.
        poses: The arm poses [rad].
        object_m: (3,) the object in the arm's frame.
        config: What is well.
    """
    shown = []
    for pose in poses:
        arm_from_ee = arm.ee_pose(pose)
        way_m = object_m - (arm_from_ee[:3, :3] @ EE_FROM_CAMERA_M + arm_from_ee[:3, 3])
        distance_m = float(np.linalg.norm(way_m))
        angle_rad = np.arccos(np.clip(arm_from_ee[:3, 0] @ way_m / distance_m, -1.0, 1.0))
        down_rad = np.arcsin(-way_m[2] / distance_m)
        shown.append(
            bool(
                config.distance_m[0] <= distance_m <= config.distance_m[1]
                and angle_rad <= config.angle_rad
                and config.down_rad[0] <= down_rad <= config.down_rad[1]
            )
        )
    return shown
