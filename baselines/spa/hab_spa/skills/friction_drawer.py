"""The drawer skills by two fingers: they close around the bar of the handle and keep it straight.

Contact alone holds the bar, so the hand keeps its orientation to the drawer on the way.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from hab_plans.motion import GRASP, RELEASE, Failure, Motion
from scipy.spatial.transform import Rotation

from hab_spa.motion.moves import follow, go, wait
from hab_spa.motion.robot import Robot
from hab_spa.planning.joint_goal import free_poses
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.shapes import Array
from hab_spa.skills.drawer import DrawerConfig, slide, travel_m
from hab_spa.skills.friction_pick import FrictionConfig, grasp_poses, line
from hab_tasks.privileged import ArticulationState


@dataclass(frozen=True, kw_only=True)
class BarConfig:
    """Parameters of the grasp of a bar.

    Attributes:
        behind_m: Distance of the point between the fingers from the bar.
        along_m: Offsets of the hand along the bar.
        about_rad: Angles of the hand about the bar, from straight ahead.
        aside_rad: Angles of the hand about the axis along which the fingers close.
        apart_m: Length of the straight way to the bar.
        step_m: Distance of the poses on the way with the bar.
        turns_rad: Angles by which the hand turns about the bar on the way.
        jump_rad: Maximum joint displacement between them.
        off_m, off_rad: Largest error of their hand.
        margins_m: Clearances of the grasp, most preferred first.
        goals: Maximum number of grasps that a motion is planned to.
    """

    behind_m: float = 0.012
    along_m: tuple[float, ...] = (0.0, -0.06, 0.06, -0.12, 0.12)
    about_rad: tuple[float, ...] = (0.0, 0.3, -0.3, 0.6, -0.6, 0.9, -0.9)
    aside_rad: tuple[float, ...] = (0.0, 0.25, -0.25, 0.5, -0.5)
    apart_m: float = 0.08
    step_m: float = 0.02
    turns_rad: tuple[float, ...] = (0.0, 0.5, -0.5)
    jump_rad: float = 0.35
    off_m: float = 0.004
    off_rad: float = 0.5
    margins_m: tuple[float, ...] = (0.01, 0.004, 0.001)
    goals: int = 6
    search: FrictionConfig = field(default_factory=FrictionConfig)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pull:
    """A grasp of the bar and the arm's way with it.

    Attributes:
        reach: (K, J) straight way of the open hand to the bar.
        line: (S, J) way with the bar.
    """

    reach: Array
    line: Array


def open_drawer_by_friction(robot: Robot, number: int) -> Motion:
    """Grasps the bar of the handle, pulls the drawer open, releases it and rests.

    Args:
        robot: The robot, in a `TrueScene`.
        number: Number of the drawer among the episode's articulations.
    """
    return (yield from slide(robot, number, True, DrawerConfig(), _move))


def close_drawer_by_friction(robot: Robot, number: int) -> Motion:
    """Grasps the bar of the handle, pushes the drawer closed, releases it and rests."""
    return (yield from slide(robot, number, False, DrawerConfig(open_share=0.97), _move))


def _move(robot: Robot, number: int, out: bool, config: DrawerConfig) -> Motion:
    """Reaches for the bar, moves it along its line and releases it."""
    scene, bar = robot.scene, BarConfig()
    assert isinstance(scene, TrueScene)
    robot.doing, robot.gripper = "reach", RELEASE
    began = time.perf_counter()
    pulls = pulls_of(robot, scene, scene.articulation(number), out, config, bar)
    robot.spend("target", time.perf_counter() - began)
    if not pulls:
        return Failure.TARGET_PLAN
    before, near_rad = np.array([one.reach[0] for one in pulls]), bar.search.near_rad
    failure = yield from go(robot, scene.collision(), before, config.reach_share, near_rad=near_rad)
    if failure is not None:
        return failure
    pull = pulls[int(np.abs(before - robot.arm_target_rad).max(axis=1).argmin())]
    failure = yield from follow(robot, pull.reach, 0.0, near_rad=near_rad)
    if failure is not None:
        return failure
    held = lambda: scene.articulation(number).held  # noqa: E731
    robot.doing, robot.gripper = "grasp", GRASP
    for _ in range(bar.search.closing_steps):
        yield robot.command()
        if held():
            break
    yield from wait(robot, bar.search.pressing_steps)
    if not held():
        return (yield from _let_go(robot, pull, Failure.EXECUTION))
    robot.doing = "pull" if out else "push"
    failure = yield from follow(
        robot, pull.line, config.line_share, held, config.timing, feels=False
    )
    robot.relax()
    yield from wait(robot, config.still_steps)
    return (yield from _let_go(robot, pull, failure))


def _let_go(robot: Robot, pull: Pull, failure: Failure | None) -> Motion:
    """Opens the fingers, and draws the hand back from the bar; returns `failure`."""
    robot.doing, robot.gripper = "let go", RELEASE
    yield from wait(robot, robot.config.release_steps)
    arm, here = robot.kinematics, robot.scene.arm_qpos
    back_m = BarConfig().apart_m * -arm.ee_pose(here)[:3, 0]
    yield from follow(robot, line(arm, here, back_m, len(pull.reach)), 0.0, feels=False)
    return failure


def pulls_of(
    robot: Robot,
    scene: TrueScene,
    articulation: ArticulationState,
    out: bool,
    config: DrawerConfig,
    bar: BarConfig,
) -> list[Pull]:
    """Returns grasps with whose hand the arm can move a drawer all the way, the best first."""
    arm, rng = robot.kinematics, np.random.default_rng(robot.next_seed())
    full = scene.collision()
    arm_from_world = full.arm_from_world
    grasps = arm_from_world @ bar_grasps(scene, articulation, bar)
    poses = grasp_poses(arm, grasps, rng, bar.search)
    way_m = arm_from_world[:3, :3] @ articulation.axis * travel_m(articulation, out, config)
    found: list[Pull] = []
    for margin_m in bar.margins_m:
        free = free_poses(poses, full, margin_m)
        for pose in free[np.abs(free - arm.rest_rad).max(axis=1).argsort()]:
            full.set_margin(margin_m)
            reach = line(arm, pose, -bar.apart_m * arm.ee_pose(pose)[:3, 0], 5)[::-1]
            if not full.are_free(reach).all():
                continue
            for turn_rad in bar.turns_rad:
                pulled = _line(robot, scene, articulation, pose, way_m, turn_rad, bar)
                if pulled is not None and _is_free(scene, articulation, pulled, way_m, margin_m):
                    found.append(Pull(reach=reach, line=pulled))
                    break
            if len(found) == bar.goals:
                return found
        if found:
            break
    return found


def bar_grasps(scene: TrueScene, articulation: ArticulationState, bar: BarConfig) -> Array:
    """Returns end-effector poses (G, 4, 4) in the world with the bar between the fingers.

    The bar is along the z axis of its link; the fingers close across it.
    """
    along, ahead = _along(scene, articulation), -articulation.axis
    found = []
    for about, aside, offset_m, flip in product(
        bar.about_rad, bar.aside_rad, bar.along_m, (1.0, -1.0)
    ):
        x = Rotation.from_rotvec(about * along).apply(ahead)
        y = flip * np.cross(along, x)
        x = Rotation.from_rotvec(aside * y).apply(x)
        pose = np.eye(4)
        pose[:3, :3] = np.stack((x, y, np.cross(x, y)), axis=1)
        pose[:3, 3] = articulation.handle_m + offset_m * along - bar.behind_m * x
        found.append(pose)
    return np.array(found)


def _along(scene: TrueScene, articulation: ArticulationState) -> Array:
    """Returns the direction (3,) of the bar in the world."""
    return scene.state.world_from_body[articulation.body][:3, 2]


def _line(
    robot: Robot,
    scene: TrueScene,
    articulation: ArticulationState,
    pose: Array,
    way_m: Array,
    turn_rad: float,
    bar: BarConfig,
) -> Array | None:
    """Returns arm poses (S, J) that move the hand with the bar; None if it does not reach.

    On its way (3,) the hand turns by an angle about the bar.
    """
    arm, arm_from_world = robot.kinematics, scene.collision().arm_from_world
    along = arm_from_world[:3, :3] @ _along(scene, articulation)
    bar_m = (arm_from_world @ np.append(articulation.handle_m, 1.0))[:3]
    steps = max(1, int(np.ceil(np.linalg.norm(way_m) / bar.step_m)))
    first, goal = arm.ee_pose(pose).copy(), np.eye(4)
    found = [pose]
    for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
        turn = Rotation.from_rotvec(share * turn_rad * along).as_matrix()
        goal[:3, :3] = turn @ first[:3, :3]
        goal[:3, 3] = bar_m + turn @ (first[:3, 3] - bar_m) + share * way_m
        found.append(arm.track_pose(found[-1], goal, steps=5, turn_weight_m=0.03))
        if np.abs(found[-1] - found[-2]).max() > bar.jump_rad:
            return None
    last = arm.ee_pose(found[-1])
    off_rad = Rotation.from_matrix(goal[:3, :3].T @ last[:3, :3]).magnitude()
    off_m = float(np.linalg.norm(last[:3, 3] - goal[:3, 3]))
    return np.array(found) if off_m < bar.off_m and off_rad < bar.off_rad else None


def _is_free(
    scene: TrueScene, articulation: ArticulationState, poses: Array, way_m: Array, margin_m: float
) -> bool:
    """Whether arm poses (S, J) are free while the drawer moves with them."""
    moving = scene.collision()
    moving.set_margin(margin_m)
    sign = np.sign((moving.arm_from_world[:3, :3] @ articulation.axis) @ way_m)
    travels = sign * np.linspace(0.0, float(np.linalg.norm(way_m)), len(poses))
    for pose, travel in zip(poses, travels, strict=True):
        moving.move(articulation.body, articulation.moved(articulation.joint + float(travel)))
        if not moving.is_free(pose):
            return False
    return True
