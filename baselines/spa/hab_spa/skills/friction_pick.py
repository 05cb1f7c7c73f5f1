"""Pick by two fingers: an antipodal grasp, a straight way to it, closing, lifting, rest."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from hab_plans.motion import GRASP, RELEASE, Failure, Motion
from scipy.spatial.transform import Rotation

from hab_spa.motion.moves import follow, go
from hab_spa.motion.robot import Robot
from hab_spa.planning.collision import ArmCollision
from hab_spa.planning.ik import BatchArm, CompiledArm
from hab_spa.planning.joint_goal import free_poses
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.shapes import Array
from hab_spa.skills.pick import pick

TOUCH_M = 0.003
"""Clearance of the open hand to the object where the straight way begins."""


@dataclass(frozen=True, kw_only=True)
class FrictionConfig:
    """Parameters of the skill.

    Attributes:
        tried: Numbers of grasps for which arm poses are sought, one after the other.
        judged: Number of grasps by which a base pose is scored.
        starts: Number of arm poses from which each is sought.
        ik_steps: Iterations of inverse kinematics.
        off_m, off_rad: Largest error of a solution.
        margins_m: Clearances, most preferred first.
        apart_m: Lengths of the straight way to a grasp, the preferred one first.
        way_poses: Number of its poses.
        goals: Maximum number of grasps that a motion is planned to.
        near_rad: Joint tolerance at the ends of the straight way.
        closing_steps: Steps that the fingers take to close, at most.
        pressing_steps: Steps for which they press before the lift.
        lift_m: Height of the straight lift.
    """

    tried: tuple[int, ...] = (300, 1500, 5000)
    judged: int = 60
    starts: int = 10
    ik_steps: int = 30
    off_m: float = 0.003
    off_rad: float = 0.04
    margins_m: tuple[float, ...] = (0.01, 0.004, 0.001)
    apart_m: tuple[float, ...] = (0.1, 0.06)
    way_poses: int = 5
    goals: int = 6
    near_rad: float = 0.005
    closing_steps: int = 20
    pressing_steps: int = 3
    lift_m: float = 0.06


def pick_by_friction(robot: Robot, number: int) -> Motion:
    """Grasps an object of the episode with two fingers and rests; replans when that fails.

    Args:
        robot: The robot, in a `TrueScene`.
        number: Number of the object.
    """
    return pick(robot, number, _take)


def friction_pick_score(robot: Robot, number: int, base: Array, effort: int = 1) -> int:
    """Scores a base pose (3,) by the number of free ways to a few grasps of an object.

    `effort` multiplies the number of grasps.
    """
    config = FrictionConfig()
    assert isinstance(robot.scene, TrueScene)
    return len(ways_in(robot, robot.scene, number, effort * config.judged, config, base))


def _take(robot: Robot, number: int) -> Motion:
    """Plans a grasp, moves to it, closes the fingers and lifts the object."""
    config = FrictionConfig()
    robot.doing, robot.gripper = "reach", RELEASE
    assert isinstance(robot.scene, TrueScene)
    began = time.perf_counter()
    ways = np.zeros((0, 0, 0))
    for tried in config.tried:
        ways = ways_in(robot, robot.scene, number, tried, config)
        if len(ways):
            break
    robot.spend("target", time.perf_counter() - began)
    if not len(ways):
        return Failure.TARGET_PLAN
    before = ways[:, 0]
    failure = yield from go(robot, robot.scene.collision(), before, near_rad=config.near_rad)
    if failure is not None:
        return failure
    reached = int(np.abs(before - robot.arm_target_rad).max(axis=1).argmin())
    failure = yield from follow(robot, ways[reached], 0.0, near_rad=config.near_rad)
    if failure is not None:
        return failure
    return (yield from _close(robot, number, config))


def _close(robot: Robot, number: int, config: FrictionConfig) -> Motion:
    """Closes the fingers, and lifts what they hold."""
    robot.doing, robot.gripper, scene = "grasp", GRASP, robot.scene
    for _ in range(config.closing_steps):
        yield robot.command()
        if scene.holds(number):
            break
    for _ in range(config.pressing_steps):
        yield robot.command()
    if not scene.holds(number):
        return Failure.EXECUTION
    robot.held_up = robot.up()
    arm = robot.kinematics
    lift = line(arm, scene.arm_qpos, np.array((0.0, 0.0, config.lift_m)), config.way_poses)
    return (yield from follow(robot, lift, 0.0, intact=lambda: scene.holds(number)))


def ways_in(
    robot: Robot,
    scene: TrueScene,
    number: int,
    tried: int,
    config: FrictionConfig,
    base: Array | None = None,
) -> Array:
    """Returns ways (W, K, J) of the arm to some grasps of an object, those near rest first.

    They are from a base pose (3,), the current one by default.
    """
    arm, rng = robot.kinematics, np.random.default_rng(robot.next_seed())
    bare = scene.collision(base=base, without=scene.name_of(number))
    full = scene.collision(base=base)
    arm_from_ee = bare.arm_from_world @ scene.grasps(number)
    some = arm_from_ee[rng.permutation(len(arm_from_ee))[:tried]]
    if not len(some):
        return np.zeros((0, 0, len(arm.rest_rad)))
    poses = grasp_poses(arm, some, rng, config)
    found: list[Array] = []
    for margin_m in config.margins_m:
        free = free_poses(poses, bare, margin_m)
        near_rest = free[np.abs(free - arm.rest_rad).max(axis=1).argsort()]
        for pose, apart_m in ((pose, one) for one in config.apart_m for pose in near_rest):
            back = -apart_m * arm.ee_pose(pose)[:3, 0]
            way = line(arm, pose, back, config.way_poses)[::-1]
            if _is_free(way, bare, full, margin_m):
                found.append(way)
            if len(found) == config.goals:
                return np.array(found)
        if found:
            break
    return np.array(found)


def _is_free(way: Array, bare: ArmCollision, full: ArmCollision, margin_m: float) -> bool:
    """Whether a way (K, J) is free, and its start from the object too."""
    full.set_margin(min(margin_m, TOUCH_M))
    return bool(bare.are_free(way).all()) and full.is_free(way[0])


def grasp_poses(
    arm: BatchArm, arm_from_ee: Array, rng: np.random.Generator, config: FrictionConfig
) -> Array:
    """Returns arm poses (B, J) with the end-effector at one of its poses (G, 4, 4)."""
    count = len(arm_from_ee)
    if isinstance(arm, CompiledArm):
        starts, numbers = arm.starts.near(arm_from_ee[:, :3, 3], 2 * config.starts, rng)
        goals = arm_from_ee[numbers]
    else:
        starts = arm.random(rng, config.starts * count)
        goals = np.repeat(arm_from_ee, config.starts, axis=0)
    weights_m = np.full(len(starts), 0.2)
    poses = arm.track_poses(starts, goals, config.ik_steps, weights_m)
    reached = np.array([arm.ee_pose(pose) for pose in poses])
    off_m = np.linalg.norm(reached[:, :3, 3] - goals[:, :3, 3], axis=1)
    turned = reached[:, :3, :3].transpose(0, 2, 1) @ goals[:, :3, :3]
    off_rad = np.linalg.norm(Rotation.from_matrix(turned).as_rotvec(), axis=1)
    return poses[(off_m < config.off_m) & (off_rad < config.off_rad)]


def line(arm: BatchArm, start: Array, way_m: Array, steps: int) -> Array:
    """Returns arm poses (K, J) along a straight way (3,) of the end-effector, from a pose (J,)."""
    goal, qpos, found = arm.ee_pose(start).copy(), start, [start]
    for _ in range(steps):
        goal[:3, 3] += way_m / steps
        qpos = arm.track_pose(qpos, goal, steps=5, turn_weight_m=0.2)
        found.append(qpos)
    return np.array(found)
