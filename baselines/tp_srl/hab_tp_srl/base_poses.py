"""Base poses for learned skills: those from which their training starts (S H.2)."""

from __future__ import annotations

from itertools import chain

import numpy as np
from hab_plans.belief import point_of
from hab_plans.stage import Stage
from hab_spa.motion.robot import Robot
from hab_spa.scenes.true_scene import TrueScene
from hab_spa.shapes import Array
from hab_spa.tasks.planned_skills import SKILLS as PLANNED_SKILLS
from hab_spa.tasks.standing import spread

from hab_tasks.articulations import ARTICULATION_KINDS
from hab_tasks.episodes.robot_start import HAND_CLEARANCE_M, StartNoise
from hab_tasks.world.navigation import NavigationMap, poses_reaching
from hab_tp_srl.approach import faces_open_side, open_sides

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
