"""Where to stand before the fridge, and how the arm follows the handle from there.

A place is good when base and resting arm are outside of what the door sweeps, when the hand can
take the handle, and when the arm alone can then take it far enough along its arc.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hab_spa.motion.drive import STEP_M, STEP_RAD
from hab_spa.motion.robot import Robot
from hab_spa.planning.joint_goal import GoalConfig, sample_reaching_goals
from hab_spa.shapes import Array
from hab_spa.skills.fridge_arc import ArcConfig, Arcs, Lead, Pull, arm_points_m, best_first
from hab_spa.skills.fridge_door import Door
from hab_spa.skills.fridge_shunt import Shunt, shunts
from hab_tasks.episodes.robot_start import Rectangle
from hab_tasks.navigation import NavigationMap
from hab_tasks.privileged import FrontState
from hab_tasks.robots.fetch_spec import REST_QPOS_RAD


@dataclass(frozen=True, kw_only=True)
class PlaceConfig:
    """The numbers of the search for a place.

    Attributes:
        x_m, y_m: Places looked at, in the fridge's frame ...
        spacing_m: ... so far apart.
        asides_rad: Headings, measured from the one that looks at the handle.
        inside_m: The base stays this far inside the region that it must not leave.
        base_m: Free radius that the base is given where there is as much ...
        least_base_m: ... and at least.
        arm_m, body_m: Radius of the arm and of the torso for what the door sweeps.
        distance_m: The hand works best this far from the middle of the base.
        tries: So many places are looked at closely.
        more_tries: When one will do, but not well, so many more are, ...
        late_tries: ... while none will do in time, so many, ...
        most_tries: ... and while there is no way to any, so many.
        margins_m: Clearances of the resting arm, the largest wanted most.
        alike: Base poses that differ by less in x, y [m] and yaw [rad] are the same to the arm.
        arm_reach_m: Nothing that is farther from the middle of the base touches the resting arm.
        off_steps, in_the_way_steps: What a metre costs that a place is too near or too far, and
            one that something is in the way.
        stop_steps: A drive takes so many steps more than its turns and its way.
        edge_steps: A place at the edge of the region counts as so many steps.
        tight_steps: A clearance that a place lacks counts as so many steps.
        drives: So many ways to a place are looked at closely.
        glance, judging, doing: How the hand's ways to the handle are looked for at first sight,
            while places are compared, and where the robot stands at last.
        resting_rad: An arm that is no farther from rest in any joint rests.
        arc: How the handle's arc is followed.
    """

    x_m: tuple[float, float] = (0.99, 1.79)
    y_m: tuple[float, float] = (-0.55, 0.55)
    spacing_m: float = 0.08
    asides_rad: tuple[float, ...] = (-1.2, -0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.2)
    inside_m: float = 0.05
    base_m: float = 0.33
    least_base_m: float = 0.27
    arm_m: float = 0.09
    body_m: float = 0.24
    distance_m: tuple[float, float] = (0.6, 0.85)
    tries: int = 16
    margins_m: tuple[float, ...] = (0.04, 0.02, 0.005)
    alike: tuple[float, float, float] = (0.02, 0.02, 0.06)
    arm_reach_m: float = 0.75
    off_steps: float = 60.0
    in_the_way_steps: float = 400.0
    stop_steps: float = 12.0
    edge_steps: float = 60.0
    tight_steps: float = 40.0
    more_tries: int = 8
    late_tries: int = 32
    most_tries: int = 60
    drives: int = 2
    resting_rad: float = 0.6
    judging: GoalConfig = field(
        default_factory=lambda: GoalConfig(
            starts_per_point=60, round_starts=60, enough=30, goals=8, same_goal_rad=0.2
        )
    )
    glance: GoalConfig = field(
        default_factory=lambda: GoalConfig(
            starts_per_point=20, round_starts=20, enough=10, goals=3, same_goal_rad=0.3
        )
    )
    doing: GoalConfig = field(
        default_factory=lambda: GoalConfig(
            starts_per_point=300, round_starts=150, enough=120, goals=30, same_goal_rad=0.2
        )
    )
    arc: ArcConfig = field(default_factory=ArcConfig)


def find_leads(
    robot: Robot,
    front: FrontState,
    pull: Pull,
    pose: Array | None,
    goal: GoalConfig,
    config: PlaceConfig,
) -> list[Lead]:
    """Returns what the arm can do at a base pose (3,), or where it is, the best first.

    Args:
        robot: Whose arm.
        front: The door.
        pull: How it is to be moved.
        pose: Where the robot is thought to stand; None for where it is.
        goal: How the hand's ways to the handle are looked for.
        config: The numbers.
    """
    scene, door = robot.scene, Door(front)
    collision = scene.collision(base=pose)
    if pose is not None:
        collision.set_margin(config.margins_m[-1])
        if not collision.is_free(scene.arm_qpos):
            return []
    points_m = np.array([door.point(door.joint, *grasp) for grasp in pull.grasps_m])
    seed = robot.next_seed()
    goals = sample_reaching_goals(points_m, collision, robot.kinematics, seed, goal).goals
    here = scene.arm_qpos
    if np.abs(here - REST_QPOS_RAD).max() > config.resting_rad:
        # A hand that has just led the door may go on with little motion.
        near = sample_reaching_goals(points_m, collision, robot.kinematics, seed, goal, here)
        goals = np.concatenate((goals, near.goals))
    if not len(goals):
        return []
    arcs = Arcs(front, robot.kinematics, pull, config.arc)
    if pull.way_out:
        return best_first(arcs.leads(scene.arm_qpos, goals, collision))
    # A door that closes gives way to a hand before it.
    before = arcs.are_before(goals, collision)
    leads = arcs.leads(scene.arm_qpos, goals[~before], collision)
    collision = scene.collision(base=pose, without=front.body)
    leads += arcs.leads(scene.arm_qpos, goals[before], collision)
    return best_first(leads)


class Places:
    """Looks for places from which a robot can do a pull."""

    def __init__(
        self,
        robot: Robot,
        number: int,
        pull: Pull,
        map_: NavigationMap,
        region: Rectangle | None,
        config: PlaceConfig,
    ) -> None:
        """Looks at the door as it is now."""
        self.robot, self.pull, self.config = robot, pull, config
        self._map, self._region = map_, region
        self._front = front = robot.scene.front(number)
        self.door, self._frame = Door(front), front.frame
        self._kept: dict[tuple[int, ...], int] = {}
        self._rest = arm_points_m(np.array(REST_QPOS_RAD)[None])[0]

    def ranked(self, coming: bool = True) -> Array:
        """Returns base poses (K, 3), those first that are near, roomy and out of the way.

        Args:
            coming: Whether the way there counts, and where the robot is as well.
        """
        config, poses, base = self.config, self._grid(), self.robot.base
        if coming:
            poses = np.concatenate((base[None], poses))
        distance_m = self._reach_m(poses)
        low, high = config.distance_m
        off_m = np.maximum(low - distance_m, 0.0) + np.maximum(distance_m - high, 0.0)
        cost = config.off_steps * off_m.sum(axis=0)
        cost += np.where(self._inside(poses, leaving=False), 0.0, config.edge_steps)
        lacking_m = np.maximum(config.base_m - _clearance_m(self._map, poses), 0.0)
        cost += config.in_the_way_steps * (lacking_m + self.swept_m(poses))
        if coming:
            gap = poses - base
            turn = np.abs((gap[:, 2] + np.pi) % (2 * np.pi) - np.pi)
            way = np.linalg.norm(gap[:, :2], axis=1)
            cost += way / STEP_M + turn / STEP_RAD + config.stop_steps * (way > 0)
        order = np.argsort(cost, kind="stable")
        return poses[order]

    def leads(self, pose: Array | None, thorough: bool = False) -> list[Lead]:
        """Returns what the arm can do at a base pose (3,), or where it is, the best first."""
        goal = self.config.doing if thorough else self.config.judging
        return find_leads(self.robot, self._front, self.pull, pose, goal, self.config)

    def swept_m(self, poses: Array) -> Array:
        """Returns how far base poses (K, 3) put torso or resting arm into the door's way, (K,)."""
        points = _placed(self._rest[:, :2], poses)
        gaps, bodies = [], []
        for joint in np.linspace(*self.pull.swept, 8):
            gaps.append(self.door.gap_m(points, float(joint)).min(axis=1))
            bodies.append(self.door.gap_m(poses[:, :2], float(joint)))
        arm = self.config.arm_m - np.min(gaps, axis=0)
        body = self.config.body_m - np.min(bodies, axis=0)
        return np.maximum(arm, 0.0) + np.maximum(body, 0.0)

    def way(self, pose: Array) -> tuple[Shunt | None, int]:
        """Returns the drive to a base pose (3,) with the most room for the arm; None if none.

        The number tells how many of the wanted clearances are too large for it.
        """
        base, best, most = self.robot.base, None, 0
        room_m = float(_clearance_m(self._map, base[None])[0])
        least_m = min(self.config.least_base_m, room_m - 0.005)
        fits = [
            shunt
            for shunt in shunts(base, pose)
            if self._inside(shunt.poses()).all()
            and (_clearance_m(self._map, shunt.poses()) >= least_m).all()
        ]
        for shunt in fits[: self.config.drives]:
            room = self._arm_room(shunt.poses()[1:], most)
            if room > most:
                best, most = shunt, room
            if most == len(self.config.margins_m):
                break
        return best, len(self.config.margins_m) - most

    def _arm_room(self, poses: Array, least: int) -> int:
        """Returns how many of the margins the resting arm keeps at base poses (K, 3).

        Nobody asks for the number when it is `least` or below.
        """
        room = len(self.config.margins_m)
        near = _clearance_m(self._map, poses) < self.config.arm_reach_m
        for pose in poses[near][::-1]:
            room = min(room, self._margins_kept(pose))
            if room <= least:
                break
        return room

    def _margins_kept(self, pose: Array) -> int:
        """Returns how many of the margins the resting arm keeps at a base pose (3,).

        Drives have much in common, so a pose next to one that was looked at is not looked at.
        """
        key = tuple(np.round(pose / self.config.alike).astype(int).tolist())
        if key not in self._kept:
            collision = self.robot.scene.collision(base=pose)
            arm, kept = self.robot.scene.arm_qpos, 0
            for margin_m in self.config.margins_m[::-1]:
                collision.set_margin(margin_m)
                if not collision.is_free(arm):
                    break
                kept += 1
            self._kept[key] = kept
        return self._kept[key]

    def has_room(self, pose: Array) -> bool:
        """Whether the base may stand at a pose (3,), as far as the floor goes."""
        room_m = float(_clearance_m(self._map, pose[None])[0])
        return bool(self._inside(pose[None])[0]) and room_m > self.config.least_base_m

    def _reach_m(self, poses: Array) -> Array:
        """Returns how far the hand's places are from the base (3, K), each a pose of `poses`."""
        joints = np.linspace(self.door.joint, self.pull.whole, 3)
        points = np.stack([self.door.handle(float(joint))[:2] for joint in joints])
        return np.linalg.norm(points[:, None] - poses[None, :, :2], axis=2)

    def _grid(self) -> Array:
        config, (x0, y0, yaw) = self.config, self._frame
        xs = np.arange(config.x_m[0], config.x_m[1] + 1e-6, config.spacing_m)
        ys = np.arange(config.y_m[0], config.y_m[1] + 1e-6, config.spacing_m)
        places = np.array(list(product(xs, ys)))
        turn = np.array(((np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw))))
        world = places @ turn.T + (x0, y0)
        middle = (self.door.handle(self.door.joint) + self.door.handle(self.pull.whole)) / 2
        gap = middle[:2] - world
        facing = np.arctan2(gap[:, 1], gap[:, 0])
        poses = [np.column_stack((world, facing + aside)) for aside in config.asides_rad]
        grid = np.concatenate(poses)
        return grid[self._inside(grid)]

    def _inside(self, poses: Array, leaving: bool = True) -> NDArray[np.bool_]:
        """Whether base poses (K, 3) are well inside the region, (K,).

        Args:
            poses: The base poses.
            leaving: Whether the way from where the robot is counts as inside.
        """
        if self._region is None:
            return np.ones(len(poses), dtype=bool)
        x0, y0, yaw = self._frame
        turn = np.array(((np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw))))
        local = (poses[:, :2] - (x0, y0)) @ turn
        low = np.array((self._region.x_m[0], self._region.y_m[0])) + self.config.inside_m
        high = np.array((self._region.x_m[1], self._region.y_m[1])) - self.config.inside_m
        if leaving:
            start = (self.robot.base[:2] - (x0, y0)) @ turn
            low, high = np.minimum(low, start), np.maximum(high, start)
        return np.all((local >= low - 1e-6) & (local <= high + 1e-6), axis=1)


def _placed(points_m: Array, poses: Array) -> Array:
    """Returns points (P, 2) of the base's frame in the world for each base pose (K, 3)."""
    cosine, sine = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x = poses[:, :1] + cosine * points_m[:, 0] - sine * points_m[:, 1]
    y = poses[:, 1:2] + sine * points_m[:, 0] + cosine * points_m[:, 1]
    return np.stack((x, y), axis=-1)


def _clearance_m(map_: NavigationMap, poses: Array) -> Array:
    """Returns the free radius (K,) around base poses (K, 3)."""
    x, y = np.moveaxis(map_.cells_of(poses[:, :2]), -1, 0)
    return map_.floor.clearance_m[x, y]
