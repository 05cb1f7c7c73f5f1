"""Grasps of the bar of a handle by two fingers, for the drawer and fridge skills by friction."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from hab_plans.motion import GRASP, RELEASE, Command, Motion
from scipy.spatial.transform import Rotation

from hab_spa.motion.follow import TimingConfig
from hab_spa.motion.moves import follow, wait
from hab_spa.motion.robot import Robot
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.ik import BatchArm
from hab_spa.planning.joint_goal import free_poses
from hab_spa.shapes import Array
from hab_spa.skills.friction_pick import FrictionConfig, grasp_poses, line

TURN_M = 0.2
"""Weight of an orientation error [m/rad]."""


@dataclass(frozen=True, kw_only=True)
class BarConfig:
    """Parameters of the grasp of a bar.

    Attributes:
        behind_m: Distance of the point between the fingers from the bar.
        along_m: Offsets of the hand along the bar.
        about_rad: Angles of the hand about the bar, from straight ahead.
        aside_rad: Angles of the hand about the axis along which the fingers close.
        near_rad: Joint tolerance at the ends of the straight way to the bar.
        apart_m: Length of this way ...
        way_poses: ... and number of its poses.
        pressing_steps: Steps for which the fingers press before the hand moves, ...
        release_steps: ... and for which they open before it draws back.
        margins_m: Clearances of the grasp, most preferred first.
        search: Parameters of inverse kinematics and of closing.
    """

    behind_m: float = 0.012
    along_m: tuple[float, ...] = (0.0, -0.06, 0.06, -0.12, 0.12)
    about_rad: tuple[float, ...] = (0.0, 0.3, -0.3, 0.6, -0.6, 0.9, -0.9)
    aside_rad: tuple[float, ...] = (0.0, 0.25, -0.25, 0.5, -0.5)
    near_rad: float = 0.02
    apart_m: float = 0.06
    way_poses: int = 5
    pressing_steps: int = 2
    release_steps: int = 2
    margins_m: tuple[float, ...] = (0.01, 0.004, 0.001)
    search: FrictionConfig = field(default_factory=FrictionConfig)


def bar_grasps(ahead: Array, along: Array, handle_m: Array, bar: BarConfig) -> Array:
    """Returns end-effector poses (G, 4, 4) in the world with the bar between the fingers.

    Args:
        ahead: (3,) direction from the room to the front that the bar is on.
        along: (3,) direction of the bar.
        handle_m: (3,) middle of the bar.
        bar: Parameters.
    """
    found = []
    for about, aside, offset_m, side in product(
        bar.about_rad, bar.aside_rad, bar.along_m, (1.0, -1.0)
    ):
        x = Rotation.from_rotvec(about * along).apply(ahead)
        y = side * np.cross(along, x)
        x = Rotation.from_rotvec(aside * y).apply(x)
        pose = np.eye(4)
        pose[:3, :3] = np.stack((x, y, np.cross(x, y)), axis=1)
        pose[:3, 3] = handle_m + offset_m * along - bar.behind_m * x
        found.append(pose)
    return np.array(found)


def bar_goals(
    arm: BatchArm, collision: ArmCollision, grasps: Array, seed: int, bar: BarConfig
) -> tuple[Array, float]:
    """Returns free arm poses (B, J) at grasps (G, 4, 4) in the world, those near rest first.

    The straight ways to them are free as well. The second value is their clearance [m]; the first
    is empty if there are none.
    """
    rng = np.random.default_rng(seed)
    poses = grasp_poses(arm, collision.arm_from_world @ grasps, rng, bar.search)
    found, margin_m = poses[:0], bar.margins_m[-1]
    for margin_m in bar.margins_m:
        found = _with_free_way(arm, collision, poses, margin_m, bar)
        if len(found):
            break
    return found[np.abs(found - arm.rest_rad).max(axis=1).argsort()], margin_m


def same_grasps(
    arm: BatchArm, collision: ArmCollision, grasps: Array, near: Array, bar: BarConfig
) -> Array:
    """Returns the free ones of arm poses (B, J) at the grasps nearest to those of `near` (B, J).

    They are from almost the same base pose.
    """
    goals = collision.arm_from_world @ grasps
    found = near[:0]
    for pose in near:
        gaps = goals - arm.ee_pose(pose)
        turns = np.linalg.norm(gaps[:, :3, :3], axis=(1, 2))
        best = int((np.linalg.norm(gaps[:, :3, 3], axis=1) + TURN_M * turns).argmin())
        moved = arm.track_pose(pose, goals[best], bar.search.ik_steps, TURN_M)
        found = np.concatenate((found, moved[None]))
    return _with_free_way(arm, collision, found, bar.margins_m[-1], bar)


def _with_free_way(
    arm: BatchArm, collision: ArmCollision, poses: Array, margin_m: float, bar: BarConfig
) -> Array:
    """Returns those of arm poses (B, J) that are free, with the way to them."""
    free = free_poses(poses, collision, margin_m)
    clear = [collision.are_free(way_to_bar(arm, pose, bar)).all() for pose in free]
    return free[np.array(clear, dtype=bool)]


def way_to_bar(arm: BatchArm, pose: Array, bar: BarConfig) -> Array:
    """Returns the straight way (K, J) of the open hand to its grasp of the bar, a pose (J,)."""
    return line(arm, pose, -bar.apart_m * arm.ee_pose(pose)[:3, 0], bar.way_poses)[::-1]


def close_around(robot: Robot, number: int, bar: BarConfig) -> Generator[Command, None, bool]:
    """Closes the fingers; returns whether they hold the handle of an articulation."""
    robot.doing, robot.gripper = "grasp", GRASP
    for _ in range(bar.search.closing_steps):
        yield robot.command()
        if robot.scene.articulation(number).held:
            break
    yield from wait(robot, bar.pressing_steps)
    return robot.scene.articulation(number).held


def let_go(robot: Robot, bar: BarConfig, timing: TimingConfig | None = None) -> Motion:
    """Opens the fingers, and draws the hand straight back from the bar.

    Args:
        robot: The robot.
        bar: Parameters.
        timing: Speed limits; the robot's by default.
    """
    robot.doing, robot.gripper = "let go", RELEASE
    yield from wait(robot, bar.release_steps)
    way = way_to_bar(robot.kinematics, robot.scene.arm_qpos, bar)[::-1]
    near_rad = 2 * bar.near_rad
    return (yield from follow(robot, way, 0.0, timing=timing, near_rad=near_rad, feels=False))
