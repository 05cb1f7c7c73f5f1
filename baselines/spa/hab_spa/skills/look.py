"""Camera motions before a skill: looking around, and closer at an object (S App. D, SPA)."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np
from hab_plans.motion import Command

from hab_spa.motion.drive import turn_to
from hab_spa.motion.moves import follow
from hab_spa.motion.robot import Robot
from hab_spa.planning.arm_plan import PlanConfig
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.ik import BatchArm
from hab_spa.planning.joint_goal import apart, in_arm, near_rest
from hab_spa.scenes.seen_scene import SeenScene
from hab_spa.shapes import Array

ASIDE_RAD = (
    (-0.93, -1.22, 0.15, 0.75, -0.01, 2.16, -0.01),
    (-1.05, -1.22, -0.06, 0.84, -0.07, 2.16, -0.01),
    (-1.10, -1.22, 0.30, 0.48, 0.19, 2.16, -0.01),
)
"""Arm poses near the resting pose that do not occlude the head camera."""


@dataclass(frozen=True, kw_only=True)
class LookConfig:
    """Parameters of looking around.

    Attributes:
        every_steps: Interval of images of the hand camera during a motion.
        share: Share of the remaining time for one motion.
        poses: Random arm poses, candidates for a close view of an object ...
        other_poses: ... and for any other view.
        spread_rad: Standard deviation of these around the resting pose.
        distance_m: Minimum and maximum distance from the hand camera to the object.
        angle_rad: Maximum angle between the object and the camera's axis.
        down_rad: Minimum and maximum downward angle of the line of sight.
        margin_m: Clearance of these arm poses.
        plan: Parameters of the motion planner; no motion if a path is not found quickly.
    """

    every_steps: int = 5
    share: float = 0.2
    poses: int = 3000
    other_poses: int = 200
    spread_rad: float = 0.7
    distance_m: tuple[float, float] = (0.25, 0.7)
    angle_rad: float = 0.45
    down_rad: tuple[float, float] = (0.15, 1.0)
    margin_m: float = 0.03
    plan: PlanConfig = field(default_factory=lambda: PlanConfig(time_limit_s=2.0))


def look_around(
    robot: Robot, scene: SeenScene, config: LookConfig
) -> Generator[Command, None, None]:
    """Looks; with an empty hand, moves the arm out of the head camera's view and looks again."""
    robot.doing = "look"
    scene.look()
    if not scene.holding:
        yield from _look_from(robot, scene, np.array(ASIDE_RAD), scene.collision(), config)


def look_closer(
    robot: Robot, scene: SeenScene, number: int, config: LookConfig
) -> Generator[Command, None, None]:
    """Looks with the hand camera at an object if the head camera does not see its support."""
    if scene.holding or scene.stands(number):
        return
    robot.doing = "look closer"
    collision = scene.collision()
    object_m = in_arm(scene.object_m(number)[None], collision)[0]
    rng = np.random.default_rng(robot.next_seed())
    poses = near_rest(robot.kinematics, rng, config.poses, config.spread_rad)
    poses = poses[_shows(robot.kinematics, poses, object_m, config)]
    poses = poses[np.argsort(np.abs(poses - scene.arm_qpos).max(axis=1))]
    yield from _look_from_free(robot, scene, poses, collision, config)


def look_again(
    robot: Robot, scene: SeenScene, config: LookConfig
) -> Generator[Command, None, None]:
    """Looks from another arm pose near rest, from which a plan may be found as well."""
    robot.doing = "look again"
    collision = scene.collision()
    rng = np.random.default_rng(robot.next_seed())
    poses = near_rest(robot.kinematics, rng, config.other_poses, config.spread_rad)
    yield from _look_from_free(robot, scene, poses, collision, config)


def look_at(robot: Robot, point_m: Array) -> Generator[Command, None, None]:
    """Turns the base until the head camera faces a point (3,), if the robot's arm has room."""
    robot.doing = "look"
    gap_m = point_m[:2] - robot.base[:2]
    yield from turn_to(robot, float(np.arctan2(gap_m[1], gap_m[0])))


def _look_from_free(
    robot: Robot, scene: SeenScene, poses: Array, collision: ArmCollision, config: LookConfig
) -> Generator[Command, None, None]:
    """Looks from one of the poses (P, J) that are free, the first ones preferred."""
    collision.set_margin(config.margin_m)
    free = poses[collision.are_free(poses)]
    if len(free):
        goals = apart(free, robot.config.goal)
        yield from _look_from(robot, scene, goals, collision, config)


def _look_from(
    robot: Robot, scene: SeenScene, poses: Array, collision: ArmCollision, config: LookConfig
) -> Generator[Command, None, None]:
    """Moves the arm to one of the poses (P, J), looking during the motion and at its end."""
    result = robot.plan(poses, collision, config.plan)
    if result.path is None:
        return
    for step, command in enumerate(follow(robot, result.path, config.share)):
        if step % config.every_steps == 0:
            scene.look()
        yield command
    scene.look()


def _shows(arm: BatchArm, poses: Array, object_m: Array, config: LookConfig) -> list[bool]:
    """Whether the hand camera would have a good view of an object, for arm poses (P, J).

    Args:
        arm: Kinematics.
        poses: The arm poses [rad].
        object_m: (3,) position of the object in the arm's frame.
        config: Limits of a good view.
    """
    # The hand camera looks along x, in the direction of the gripper.
    ee_from_camera_m = np.array(arm.robot.cameras["arm"].position_m)
    ee_from_camera_m[0] -= arm.robot.ee_offset_m
    shown = []
    for pose in poses:
        arm_from_ee = arm.ee_pose(pose)
        offset_m = object_m - (arm_from_ee[:3, :3] @ ee_from_camera_m + arm_from_ee[:3, 3])
        distance_m = float(np.linalg.norm(offset_m))
        angle_rad = np.arccos(np.clip(arm_from_ee[:3, 0] @ offset_m / distance_m, -1.0, 1.0))
        down_rad = np.arcsin(-offset_m[2] / distance_m)
        shown.append(
            bool(
                config.distance_m[0] <= distance_m <= config.distance_m[1]
                and angle_rad <= config.angle_rad
                and config.down_rad[0] <= down_rad <= config.down_rad[1]
            )
        )
    return shown
