"""The drawer skills by two fingers, which hold the bar of the handle by contact alone.

The hand nearly keeps its orientation to the drawer on the way; where the arm would not reach, it
turns a little.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
from hab_plans.motion import RELEASE, Failure, Motion
from scipy.spatial.transform import Rotation

from hab_spa.motion.moves import follow, go, wait
from hab_spa.motion.robot import Robot
from hab_spa.planning.ik import BatchArm
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.shapes import Array
from hab_spa.skills.bar import (
    BarConfig,
    bar_goals,
    bar_grasps,
    close_around,
    let_go,
    way_to_bar,
)
from hab_spa.skills.drawer import DrawerConfig, slide, travel_m
from hab_tasks.privileged import ArticulationState


@dataclass(frozen=True, kw_only=True)
class PullConfig:
    """Parameters of a drawer's motion with the hand.

    Attributes:
        bar: Grasps of its bar.
        goals: Maximum number of grasps that a motion is planned to.
        tried: Maximum number of grasps whose way with the drawer is computed.
        step_m: Distance of the poses on the way with the bar.
        turns_rad: Angles by which the hand turns about the bar on the way.
        turn_weight_m: Weight of an orientation error [m/rad].
        jump_rad: Maximum joint displacement between poses.
        off_m, off_rad: Largest error of the hand at the end.
    """

    bar: BarConfig = field(default_factory=BarConfig)
    goals: int = 6
    tried: int = 1000
    step_m: float = 0.02
    turns_rad: tuple[float, ...] = (0.0, 0.5, -0.5)
    turn_weight_m: float = 0.03
    jump_rad: float = 0.35
    off_m: float = 0.004
    off_rad: float = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Grip:
    """A grasp of the bar, and the arm's way with it.

    Attributes:
        reach: (K, J) straight way of the open hand to the bar.
        line: (S, J) way with the bar.
    """

    reach: Array
    line: Array


CLOSE = DrawerConfig(open_share=0.92, far_m=(0.56, 0.5, 0.62, 0.45))
"""From nearer, as the hand has to keep its orientation to the drawer until it is closed."""


def open_drawer_by_friction(robot: Robot, number: int) -> Motion:
    """Grasps the bar of the handle, pulls the drawer open, releases it and rests.

    Args:
        robot: The robot, in a `TrueScene`.
        number: Number of the drawer among the episode's articulations.
    """
    return (yield from slide(robot, number, True, DrawerConfig(), _move))


def close_drawer_by_friction(robot: Robot, number: int) -> Motion:
    """Grasps the bar of the handle, pushes the drawer closed, releases it and rests."""
    return (yield from slide(robot, number, False, CLOSE, _move))


def friction_drawer_score(robot: Robot, number: int, base: Array, out: bool) -> int:
    """Returns 1 for a base pose (3,) from which a grasp moves the drawer all the way, else 0."""
    assert isinstance(robot.scene, TrueScene)
    few = replace(PullConfig(), goals=1, tried=15, step_m=0.04)
    drawer = DrawerConfig() if out else CLOSE
    return len(DrawerGrips(robot, robot.scene, number, out, drawer, few, base).find())


def _move(robot: Robot, number: int, out: bool, config: DrawerConfig) -> Motion:
    """Reaches for the bar, moves it along its line and releases it."""
    scene, pull_config = robot.scene, PullConfig()
    assert isinstance(scene, TrueScene)
    robot.doing, robot.gripper = "reach", RELEASE
    began = time.perf_counter()
    grips = DrawerGrips(robot, scene, number, out, config, pull_config).find()
    robot.spend("target", time.perf_counter() - began)
    if not grips:
        return Failure.TARGET_PLAN
    before = np.array([one.reach[0] for one in grips])
    near_rad = pull_config.bar.near_rad
    failure = yield from go(robot, scene.collision(), before, config.reach_share, near_rad=near_rad)
    if failure is not None:
        return failure
    grip = grips[int(np.abs(before - robot.arm_target_rad).max(axis=1).argmin())]
    failure = yield from follow(robot, grip.reach, 0.0, near_rad=near_rad)
    if failure is not None:
        return failure
    failure = Failure.EXECUTION
    if (yield from close_around(robot, number, pull_config.bar)):
        robot.doing = "pull" if out else "push"
        held = lambda: scene.articulation(number).held  # noqa: E731
        failure = yield from follow(
            robot, grip.line, config.line_share, held, config.timing, feels=False
        )
        robot.relax()
        yield from wait(robot, config.still_steps)
    yield from let_go(robot, pull_config.bar)
    return failure


class DrawerGrips:
    """Finds the grasps with whose hand the arm can move a drawer all the way."""

    def __init__(
        self,
        robot: Robot,
        scene: TrueScene,
        number: int,
        out: bool,
        drawer: DrawerConfig,
        config: PullConfig,
        base: Array | None = None,
    ) -> None:
        """Reads the current state of drawer `number`; `base` (3,) is the robot's by default."""
        self._robot, self._config = robot, config
        self._arm: BatchArm = robot.kinematics
        self._drawer: ArticulationState = scene.articulation(number)
        # Bars are along the z axes of their links.
        self._bar_axis = scene.state.world_from_body[self._drawer.body][:3, 2]
        self._collision, self._moving = scene.collision(base=base), scene.collision(base=base)
        self._travel_m = travel_m(self._drawer, out, drawer)
        arm_from_world = self._collision.arm_from_world
        self._way_m = arm_from_world[:3, :3] @ self._drawer.axis * self._travel_m
        self._bar_m = (arm_from_world @ np.append(self._drawer.handle_m, 1.0))[:3]
        self._along = arm_from_world[:3, :3] @ self._bar_axis

    def find(self) -> list[Grip]:
        """Returns them, those with a grasp near the resting pose first."""
        config, found = self._config, list[Grip]()
        handle_m = self._drawer.handle_m
        grasps = bar_grasps(-self._drawer.axis, self._bar_axis, handle_m, config.bar)
        seed = self._robot.next_seed()
        goals, margin_m = bar_goals(self._arm, self._collision, grasps, seed, config.bar)
        for pose in goals[: config.tried]:
            turned = (self._line(pose, turn_rad) for turn_rad in config.turns_rad)
            line = next((one for one in turned if self._is_free(one, margin_m)), None)
            if line is not None:
                found.append(Grip(reach=way_to_bar(self._arm, pose, config.bar), line=line))
            if len(found) == config.goals:
                break
        return found

    def _line(self, pose: Array, turn_rad: float) -> Array:
        """Returns arm poses (S, J) that move the hand with the bar, as far as it reaches.

        On its way the hand turns by an angle about the bar.
        """
        config, first, goal = self._config, self._arm.ee_pose(pose).copy(), np.eye(4)
        steps, found = self._steps, [pose]
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            turn = Rotation.from_rotvec(share * turn_rad * self._along).as_matrix()
            goal[:3, :3] = turn @ first[:3, :3]
            goal[:3, 3] = self._bar_m + turn @ (first[:3, 3] - self._bar_m) + share * self._way_m
            next_pose = self._arm.track_pose(found[-1], goal, 5, config.turn_weight_m)
            here = self._arm.ee_pose(next_pose)
            off_m = float(np.linalg.norm(here[:3, 3] - goal[:3, 3]))
            off_rad = Rotation.from_matrix(goal[:3, :3].T @ here[:3, :3]).magnitude()
            jumps = np.abs(next_pose - found[-1]).max() > config.jump_rad
            if jumps or off_m > config.off_m or off_rad > config.off_rad:
                break
            found.append(next_pose)
        return np.array(found)

    @property
    def _steps(self) -> int:
        return max(1, int(np.ceil(abs(self._travel_m) / self._config.step_m)))

    def _is_free(self, line: Array, margin_m: float) -> bool:
        """Whether a line (S, J) is complete, and free while the drawer moves with it."""
        if len(line) <= self._steps:
            return False
        travels_m = np.linspace(0.0, self._travel_m, len(line))
        self._moving.set_margin(margin_m)
        for pose, travelled_m in zip(line, travels_m.tolist(), strict=True):
            moved = self._drawer.moved(self._drawer.joint + travelled_m)
            self._moving.move(self._drawer.body, moved)
            if not self._moving.is_free(pose):
                return False
        return True
