"""Base poses for learned skills: those from which their training starts (S H.2); such states."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np
from hab_navigator.belief import Reach
from hab_plans.belief import point_of
from hab_plans.stage import Stage
from hab_spa.motion.robot import Robot
from hab_spa.planning.items import coal_shapes
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.shapes import Array
from hab_spa.tasks.planned_skills import SKILLS as PLANNED_SKILLS
from hab_spa.tasks.planned_skills import spread
from numpy.typing import NDArray

from hab_tasks.articulations import ARTICULATION_KINDS
from hab_tasks.constants import REST_POSITION_M
from hab_tasks.episodes import Episode, EpisodeRequest, load_episodes
from hab_tasks.episodes.robot_start import HAND_CLEARANCE_M, StartNoise
from hab_tasks.privileged import PrivilegedState
from hab_tasks.registration import SKILLS
from hab_tasks.robots.kinematics import ArmKinematics
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.navigation import NavigationMap, poses_reaching

Placed = tuple[coal.CollisionGeometry, coal.Transform3s]
"""A shape and its pose in the world."""

SIDES = 24
"""Number of horizontal directions that are tried."""

RADII_M = (0.09, 0.05)
LENGTH_M, RISE_M = 0.6, 0.06
"""The hand's way is a level capsule of this length, this far above the place. Its radius is the
second one if no side is open to the first."""


def open_sides(state: PrivilegedState, point_m: Array) -> NDArray[np.bool_]:
    """Returns the sides (SIDES,) from which no furniture or wall is in the hand's way.

    Args:
        state: The scene. Loose objects and the robot do not count.
        point_m: (3,) the place, in the world.
    """
    centre_m = point_m + np.array((0.0, 0.0, RISE_M))
    near = _shapes_near(state, centre_m)
    free = np.zeros(SIDES, dtype=bool)
    for radius_m in RADII_M:
        if not free.any():
            free = _free_of(near, centre_m, coal.Capsule(radius_m, LENGTH_M))
    return free


def faces_open_side(free: NDArray[np.bool_], poses: Array) -> NDArray[np.bool_]:
    """Whether base poses (K, 3) that face a place are on an open side of it, (K,)."""
    sides = np.round((poses[:, 2] + np.pi) / (2.0 * np.pi) * SIDES).astype(int)
    return free[sides % SIDES]


def _free_of(near: Sequence[Placed], centre_m: Array, capsule: coal.Capsule) -> NDArray[np.bool_]:
    """Returns the sides (SIDES,) to which a capsule from a point touches no shape."""
    free = np.ones(SIDES, dtype=bool)
    for side in range(SIDES):
        angle_rad = 2.0 * np.pi * side / SIDES
        ahead = np.array((np.cos(angle_rad), np.sin(angle_rad), 0.0))
        aside = np.array((-ahead[1], ahead[0], 0.0))
        # Coal's capsules lie along z.
        turn = np.column_stack((aside, (0.0, 0.0, 1.0), ahead))
        way = coal.Transform3s(turn, centre_m + (LENGTH_M / 2) * ahead)
        free[side] = not any(_touch(capsule, way, *shape) for shape in near)
    return free


def _shapes_near(state: PrivilegedState, centre_m: Array) -> list[Placed]:
    """Returns the shapes of furniture and walls around a point, with their poses."""
    ball, found = coal.Sphere(RADII_M[0] + LENGTH_M), []
    here = coal.Transform3s(np.eye(3), centre_m)
    for body in state.bodies:
        fixed = body.group != "robot" and body.name not in state.object_com_m
        if not fixed or body.name not in state.world_from_body:
            continue
        for shape, made in zip(body.shapes, coal_shapes(body), strict=True):
            pose = state.world_from_body[body.name] @ shape.body_from_shape @ made[1]
            placed = coal.Transform3s(pose[:3, :3], pose[:3, 3])
            if _touch(ball, here, made[0], placed):
                found.append((made[0], placed))
    return found


def _touch(
    shape: coal.CollisionGeometry,
    world_from_shape: coal.Transform3s,
    other: coal.CollisionGeometry,
    world_from_other: coal.Transform3s,
) -> bool:
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    return bool(coal.collide(shape, world_from_shape, other, world_from_other, request, result))


CANDIDATES = StartNoise().candidates
APART_M = 0.12
"""Minimum distance from base poses tried before."""

TURNING_M = 0.65
"""Clearance in which the base turns without meeting a wall with the hand at rest."""

CELL_M = 0.05
"""Spacing of the candidates in a spawn region."""


def start_pose(robot: Robot, stage: Stage, map_: NavigationMap, tried: list[Array]) -> Array:
    """Returns a base pose (3,) like those at the start of a skill's training episodes.

    At it, the arm as it is now is free of collisions and, for an object, its place can be reached.

    Args:
        robot: The robot, with ground truth.
        stage: The stage.
        map_: The floor map.
        tried: Base poses tried before.
    """
    point_m = point_of(robot.scene, stage)
    groups = candidates(robot, stage, map_, point_m)
    for other in tried:
        groups = [g[np.linalg.norm(g[:, :2] - other[:2], axis=1) >= APART_M] for g in groups]
    poses = np.concatenate([spread(group, CANDIDATES) for group in groups])
    # Lazily, as each check takes milliseconds and the first poses usually pass.
    free = (pose for pose in poses if _has_room(robot, pose, point_m, stage))
    first = next(free, None)
    if first is None:
        return poses[0] if len(poses) else _nearest(map_, point_m)
    if stage.skill == "pick" or (stage.skill == "place" and robot.scene.holding):
        score = PLANNED_SKILLS[stage.skill].score(robot, stage.number, map_)
        return next((pose for pose in chain((first,), free) if score(pose, 1) > 0), first)
    return first


def candidates(robot: Robot, stage: Stage, map_: NavigationMap, point_m: Array) -> list[Array]:
    """Returns groups of base poses (K, 3) on free floor, best first.

    Those for an object are the nearest that face it, first those on a side from which the hand can
    come, as from another side of a fridge it meets a wall. Those for a door or drawer are in its
    spawn region, where the arm can turn and from the middle outwards, and face the handle; those
    from which a drawer is closed are near it.
    """
    if stage.articulation is None:
        noise = StartNoise()
        poses = poses_reaching(map_, point_m, noise.nearest_m, noise.farthest_m)
        if stage.drawer is not None:  # the hand comes from above
            return [poses]
        assert isinstance(robot.scene, TrueScene)
        free = open_sides(robot.scene.state, point_m)
        faces = faces_open_side(free, poses)
        return [poses[faces], poses[~faces]]
    x, y, yaw = _spawn_frame(robot, stage.articulation)
    articulation = robot.scene.articulation(stage.articulation)
    kind, opens = ARTICULATION_KINDS[articulation.kind], stage.action.verb == "open"
    region = kind.opening_region if opens else kind.closing_region
    ahead, aside = (np.arange(low, high, CELL_M) for low, high in (region.x_m, region.y_m))
    local = np.stack(np.meshgrid(ahead, aside), axis=-1).reshape(-1, 2)
    # A drawer is pushed away from the robot, to the end of its reach.
    best_x = region.x_m[0] if articulation.slides and not opens else np.mean(region.x_m)
    best = np.array((best_x, np.mean(region.y_m)))
    local = local[np.argsort(np.linalg.norm(local - best, axis=1), kind="stable")]
    cosine, sine = np.cos(yaw), np.sin(yaw)
    places = local @ np.array(((cosine, sine), (-sine, cosine))) + np.array((x, y))
    places = places[map_.is_free(places)]
    cramped = map_.clearance_m(places) < TURNING_M
    places = places[np.argsort(cramped, kind="stable")]
    gap = point_m[:2] - places
    return [np.column_stack((places, np.arctan2(gap[:, 1], gap[:, 0])))]


def _spawn_frame(robot: Robot, number: int) -> Array:
    """Returns x, y [m] and yaw [rad] of the frame of a spawn region: of a fridge, or a drawer."""
    scene = robot.scene
    assert isinstance(scene, TrueScene)
    articulation = scene.articulation(number)
    if not articulation.slides:
        return articulation.frame
    pose = scene.state.world_from_body[articulation.body]  # the region moves with the drawer
    return np.array((*pose[:2, 3], np.arctan2(pose[1, 0], pose[0, 0])))


def _has_room(robot: Robot, pose: Array, point_m: Array, stage: Stage) -> bool:
    """Whether the arm is free of collisions at a base pose, and the hand clear of the point."""
    scene = robot.scene
    ee_m = robot.kinematics.ee_pose(scene.arm_qpos)[:3, 3]
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    hand_m = pose[:2] + np.array(((cosine, -sine), (sine, cosine))) @ ee_m[:2]
    gap_m = np.append(hand_m - point_m[:2], 0.0 if stage.at == "goal" else ee_m[2] - point_m[2])
    if np.linalg.norm(gap_m) < HAND_CLEARANCE_M:
        return False
    return bool(scene.collision(base=pose).is_free(scene.arm_qpos))


def _nearest(map_: NavigationMap, point_m: Array) -> Array:
    """Returns the free base pose (3,) nearest to a point, facing it."""
    x, y = map_.nearest_free(point_m[:2])
    return np.array((x, y, np.arctan2(point_m[1] - y, point_m[0] - x)))


EPISODES = 500
"""Episodes of each skill that ship with hab-tasks; they come from the generator of training."""

PERCENTILES = (0.5, 99.5)
SLACK = 0.05
"""Share of a range by which it is widened at both ends."""

SHY_M = 0.1
"""A base is sent so far into a range of distances, as it does not stop exactly there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StartRanges:
    """Ranges of `features` over the episodes of a skill, without the extremes.

    Attributes:
        low: (4,) lower ends.
        high: (4,) upper ends.
    """

    low: Array
    high: Array

    def reach(self, level: bool) -> Reach:
        """Returns where the point may be when the skill starts.

        Args:
            level: Whether the hand comes to it level, not from above.
        """
        (near_m, right_rad), (far_m, left_rad) = self.low[:2].tolist(), self.high[:2].tolist()
        return Reach(
            distance_m=(near_m + SHY_M, far_m - SHY_M),
            bearing_rad=(right_rad, left_rad),
            level=level,
        )

    def include(self, found: Array) -> bool:
        """Whether all features (4,) of a start are in their ranges."""
        slack = SLACK * (self.high - self.low)
        return bool(((found >= self.low - slack) & (found <= self.high + slack)).all())


def features(point_m: Array, ee_m: Array) -> Array:
    """Returns the features of a start.

    Args:
        point_m: (3,) the point that the skill observes, in the base frame.
        ee_m: (3,) end-effector in the base frame.

    Returns:
        Distance [m], bearing [rad] and height [m] of the point, and the distance of the
        end-effector from rest [m], (4,).
    """
    x, y, z = point_m
    from_rest_m = np.linalg.norm(ee_m - np.array(REST_POSITION_M))
    return np.array((np.hypot(x, y), np.arctan2(y, x), z, from_rest_m), dtype=np.float64)


@functools.cache
def start_ranges(env_id: str, robot: RobotSpec) -> StartRanges | None:
    """Returns the ranges of a skill's environment; None if no episodes of it ship."""
    if env_id not in SKILLS:
        return None
    request = EpisodeRequest(env_id=env_id, split="val")
    arm, episodes = ArmKinematics(robot), load_episodes(request, EPISODES).episodes
    found = np.stack([_features_of(episode, arm) for episode in episodes])
    low, high = np.percentile(found, PERCENTILES, axis=0)
    low[-1] = 0.0  # the hand cannot be too near to rest
    return StartRanges(low=low, high=high)


def _features_of(episode: Episode, arm: ArmKinematics) -> Array:
    """Returns the features of the start of an episode."""
    (target, *_), (x, y, yaw) = episode.targets, episode.robot.base
    point_m = np.array((target.world_from_goal or episode.objects[target.object])[:3])
    cosine, sine = np.cos(yaw), np.sin(yaw)
    level_m = (point_m[:2] - np.array((x, y))) @ np.array(((cosine, -sine), (sine, cosine)))
    ee_m = arm.position(episode.robot.arm_pose(arm.robot))
    return features(np.append(level_m, point_m[2]), ee_m)
