"""Selection of a base pose in front of the fridge.

A base pose is good if base and resting arm are outside the door's swept area, the hand can grasp
the handle, and the arm alone can move it far enough along its arc.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array
from hab_spa.skills.fridge.arc import DoorPath, Pull, arm_points_m
from hab_spa.skills.fridge.door import Door
from hab_spa.skills.fridge.door_paths import DoorPathConfig, DoorPathSearch
from hab_spa.skills.fridge.maneuver import BaseManeuver, base_maneuvers
from hab_tasks.articulations import Rectangle
from hab_tasks.world.navigation import NavigationMap


@dataclass(frozen=True, kw_only=True)
class BasePoseConfig:
    """Parameters of base pose selection.

    Attributes:
        x_m, y_m: Ranges of the candidate grid, in the fridge's frame.
        spacing_m: Spacing of the grid.
        asides_rad: Candidate headings, relative to facing the handle.
        inside_m: Margin of the base from the edge of its region.
        base_m: Preferred free radius around the base.
        least_base_m: Minimum free radius around the base.
        arm_m, body_m: Radii of arm and torso for the door's swept area.
        distance_m: Preferred range of the hand's distance from the base's center.
        tries: Number of base poses evaluated.
        more_tries: Additional number if the best is sufficient, but incomplete or tight.
        late_tries: Number while no base pose fits the remaining time.
        most_tries: Maximum number.
        stride: Subsampling of the candidates after the first `most_tries`.
        margins_m: Clearances of the resting arm, most preferred first.
        alike: Resolution in x, y [m] and yaw [rad] of the cache of the arm's clearance.
        arm_reach_m: Radius of base and resting arm around the base's center.
        off_steps, in_the_way_steps: Costs of a metre outside the preferred distance and of a
            metre of obstruction [steps].
        stop_steps: Constant cost of a drive [steps].
        edge_steps: Cost of a base pose at the edge of the region [steps].
        tight_steps: Cost of each clearance that is not kept [steps].
        drives: Number of maneuvers to a base pose that are evaluated.
        hints: Number of its grasp poses that are kept.
        door_path: Parameters of the search for pulls.
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
    tries: int = 20
    margins_m: tuple[float, ...] = (0.04, 0.02, 0.005)
    alike: tuple[float, float, float] = (0.02, 0.02, 0.06)
    arm_reach_m: float = 0.75
    off_steps: float = 60.0
    in_the_way_steps: float = 400.0
    stop_steps: float = 12.0
    edge_steps: float = 60.0
    tight_steps: float = 40.0
    more_tries: int = 14
    late_tries: int = 32
    most_tries: int = 60
    stride: int = 8
    drives: int = 2
    hints: int = 4
    door_path: DoorPathConfig = field(default_factory=DoorPathConfig)


@dataclass(frozen=True, kw_only=True)
class SelectedBasePose:
    """A selected base pose.

    Attributes:
        maneuver: Maneuver to the base pose; None for the current one.
        cost: Estimated steps of maneuver and pull.
        complete: Whether the pull opens or closes the door completely.
        sufficient: Whether the pull is sufficient.
        tight: Number of preferred clearances that the maneuver does not keep.
        goals: (G, J) grasp poses of the best pulls from there.
    """

    maneuver: BaseManeuver | None
    cost: float
    complete: bool
    sufficient: bool
    tight: int
    goals: Array


class BasePoseSearch:
    """Searches for base poses from which a robot can move the door."""

    def __init__(
        self,
        robot: Robot,
        number: int,
        pull: Pull,
        floor_map: Callable[[], NavigationMap],
        region: Rectangle | None,
        config: BasePoseConfig,
    ) -> None:
        """Reads the current state of the door."""
        self.robot, self.pull, self.config = robot, pull, config
        self._floor_map, self._region = floor_map, region
        articulation = robot.scene.articulation(number)
        self.door, self._frame, self._body = (
            Door(articulation),
            articulation.frame,
            articulation.body,
        )
        self._search = DoorPathSearch(
            robot, articulation, pull, self.may_tow, self._middle(), config.door_path
        )
        self._kept: dict[tuple[int, ...], int] = {}
        self._arm_m = arm_points_m(robot.spec, robot.scene.arm_qpos[None])[0]

    @cached_property
    def _map(self) -> NavigationMap:
        # Without a drive or a tow, the search needs no map.
        return self._floor_map()

    def ranked(self, driving: bool = True) -> Array:
        """Returns base poses (K, 3), ranked by distance, clearance and obstruction.

        Args:
            driving: Whether to add the cost of driving there, and the current base pose.
        """
        config, poses, base = self.config, self._grid(), self.robot.base
        if driving:
            poses = np.concatenate((base[None], poses))
        distance_m = self._reach_m(poses)
        low, high = config.distance_m
        off_m = np.maximum(low - distance_m, 0.0) + np.maximum(distance_m - high, 0.0)
        cost = config.off_steps * off_m.sum(axis=0)
        cost += np.where(self._inside(poses, leaving=False), 0.0, config.edge_steps)
        lacking_m = np.maximum(config.base_m - _clearance_m(self._map, poses), 0.0)
        cost += config.in_the_way_steps * (lacking_m + self.swept_m(poses))
        if driving:
            gap = poses - base
            turn = np.abs((gap[:, 2] + np.pi) % (2 * np.pi) - np.pi)
            drive_m = np.linalg.norm(gap[:, :2], axis=1)
            spec = self.robot.spec
            cost += drive_m / spec.base_step_m + turn / spec.base_step_rad
            cost += config.stop_steps * (drive_m > 0)
        order = np.argsort(cost, kind="stable")
        return poses[order]

    def candidates(self, pose: Array | None, near: Array | None = None) -> list[DoorPath]:
        """Returns the pulls from a base pose (3,), None for the current one, best first.

        Where the robot has driven, more are searched, also near the grasp poses (G, J) for which
        it has.
        """
        config = self.config.door_path
        return self._search.find(pose, config.comparison if near is None else config.final, near)

    def choose(self, tries: int, in_time_steps: float) -> SelectedBasePose | None:
        """Returns the best of the evaluated base poses; None if none is feasible.

        Args:
            tries: Number evaluated; more while none fits the remaining time.
            in_time_steps: Remaining time [steps].
        """
        config, best, number = self.config, None, 0
        ranked = self.ranked()
        first, others = np.split(ranked, [config.most_tries])
        poses = np.concatenate((first, others[:: config.stride]))
        for pose in poses:
            late = best is not None and best.cost > in_time_steps
            if best is not None and number >= (config.late_tries if late else tries):
                break
            if number >= config.most_tries:
                break
            selected = self._evaluate(pose)
            # Until one is feasible, base poses that cannot be evaluated do not count.
            number += best is not None or selected is not None
            if selected is not None and (best is None or selected.cost < best.cost):
                best = selected
                if best.sufficient:
                    more = config.more_tries * (best.tight > 0 or not best.complete)
                    tries = min(tries, number + more)
        return best

    def _evaluate(self, pose: Array) -> SelectedBasePose | None:
        """Evaluates a base pose (3,); None if it has no maneuver or no pull."""
        here = np.array_equal(pose, self.robot.base)
        maneuver, tight = (None, 0) if here else self.maneuver_to(pose)
        candidates = self.candidates(None if here else pose) if here or maneuver is not None else []
        if not candidates:
            return None
        maneuver_steps = (
            0.0 if maneuver is None else maneuver.steps + self.config.tight_steps * tight
        )
        return SelectedBasePose(
            maneuver=maneuver,
            cost=candidates[0].cost + maneuver_steps,
            complete=candidates[0].complete,
            sufficient=candidates[0].sufficient,
            tight=tight,
            goals=np.array([one.goal for one in candidates[: self.config.hints]]),
        )

    def quick_candidates(self, pose: Array) -> list[DoorPath]:
        """Returns the pulls from a base pose (3,), found with few samples."""
        return self._search.find(pose, self.config.door_path.quick)

    def may_tow(self, poses: Array) -> NDArray[np.bool_]:
        """Whether base poses (K, 3) are allowed during a pull, (K,)."""
        roomy = _clearance_m(self._map, poses) >= self.config.least_base_m
        return roomy & self._inside(poses)

    def swept_m(self, poses: Array) -> Array:
        """Returns the penetration (K,) of torso and arm into the door's swept area [m]."""
        points = _placed(self._arm_m[:, :2], poses)
        gaps, bodies = [], []
        for joint in np.linspace(*self.pull.swept, 8):
            gaps.append(self.door.gap_m(points, float(joint)).min(axis=1))
            bodies.append(self.door.gap_m(poses[:, :2], float(joint)))
        arm = self.config.arm_m - np.min(gaps, axis=0)
        body = self.config.body_m - np.min(bodies, axis=0)
        return np.maximum(arm, 0.0) + np.maximum(body, 0.0)

    def maneuver_to(self, pose: Array) -> tuple[BaseManeuver | None, int]:
        """Returns the maneuver to a base pose (3,) with most clearance of the arm; None if none.

        The second value is the number of preferred clearances that it does not keep.
        """
        base, best, most = self.robot.base, None, 0
        room_m = float(_clearance_m(self._map, base[None])[0])
        least_m = min(self.config.least_base_m, room_m - 0.005)
        fits = [
            maneuver
            for maneuver in base_maneuvers(self.robot.spec, base, pose)
            if self._inside(maneuver.poses()).all()
            and (_clearance_m(self._map, maneuver.poses()) >= least_m).all()
        ]
        for maneuver in fits[: self.config.drives]:
            room = self._arm_room(maneuver.poses()[1:], most)
            if room > most:
                best, most = maneuver, room
            if most == len(self.config.margins_m):
                break
        return best, len(self.config.margins_m) - most

    def _arm_room(self, poses: Array, least: int) -> int:
        """Returns the number of margins that the resting arm keeps at base poses (K, 3).

        The value is exact only above `least`. Results are cached at resolution `alike`, since
        maneuvers have many base poses in common.
        """
        near = _clearance_m(self._map, poses) < self.config.arm_reach_m
        keys = np.round(poses[near] / self.config.alike).astype(int).tolist()
        alike = dict(zip(map(tuple, keys), poses[near], strict=True))
        room, known = len(self.config.margins_m), [self._kept[k] for k in alike if k in self._kept]
        room = min([room, *known])
        if room > least:
            new = {key: pose for key, pose in alike.items() if key not in self._kept}
            self._kept.update(zip(new, self._margins_kept(list(new.values())), strict=True))
            room = min([room, *(self._kept[key] for key in new)])
        return room

    def _margins_kept(self, poses: list[Array]) -> list[int]:
        """Returns the number of margins that the resting arm keeps at each base pose (3,)."""
        collision, arm = self._search.collision, self.robot.scene.arm_qpos
        collision.move(self._body, np.eye(4))
        kept, bases = np.zeros(len(poses), dtype=int), np.reshape(poses, (-1, 3))
        for number, margin_m in enumerate(self.config.margins_m[::-1]):
            collision.set_margin(margin_m)
            still = np.flatnonzero(kept == number)
            kept[still] += collision.are_free(np.repeat(arm[None], len(still), 0), bases[still])
        return kept.tolist()

    def _reach_m(self, poses: Array) -> Array:
        """Returns the distances (3, K) of three points of the handle's arc from base poses."""
        joints = np.linspace(self.door.joint, self.pull.complete, 3)
        points = np.stack([self.door.handle(float(joint))[:2] for joint in joints])
        return np.linalg.norm(points[:, None] - poses[None, :, :2], axis=2)

    def _middle(self) -> Array:
        """Returns the base pose (3,) at the center of the grid, facing the fridge."""
        x0, y0, yaw = self._frame
        x_m, y_m = np.mean(self.config.x_m), np.mean(self.config.y_m)
        turn = np.array(((np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw))))
        return np.array((*(turn @ (x_m, y_m) + (x0, y0)), yaw + np.pi))

    def _grid(self) -> Array:
        config, (x0, y0, yaw) = self.config, self._frame
        xs = np.arange(config.x_m[0], config.x_m[1] + 1e-6, config.spacing_m)
        ys = np.arange(config.y_m[0], config.y_m[1] + 1e-6, config.spacing_m)
        grid_m = np.array(list(product(xs, ys)))
        turn = np.array(((np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw))))
        world = grid_m @ turn.T + (x0, y0)
        middle = (self.door.handle(self.door.joint) + self.door.handle(self.pull.complete)) / 2
        gap = middle[:2] - world
        facing = np.arctan2(gap[:, 1], gap[:, 0])
        poses = [np.column_stack((world, facing + aside)) for aside in config.asides_rad]
        grid = np.concatenate(poses)
        return grid[self._inside(grid)]

    def _inside(self, poses: Array, leaving: bool = True) -> NDArray[np.bool_]:
        """Whether base poses (K, 3) are inside the region by `inside_m`, (K,).

        Args:
            poses: The base poses.
            leaving: Whether to extend the region to the current base position.
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
    """Returns points (P, 2) of the base frame in the world, for each base pose (K, 3)."""
    cosine, sine = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x = poses[:, :1] + cosine * points_m[:, 0] - sine * points_m[:, 1]
    y = poses[:, 1:2] + sine * points_m[:, 0] + cosine * points_m[:, 1]
    return np.stack((x, y), axis=-1)


def _clearance_m(map_: NavigationMap, poses: Array) -> Array:
    """Returns the free radius (K,) around base poses (K, 3)."""
    x, y = np.moveaxis(map_.cells_of(poses[:, :2]), -1, 0)
    return map_.floor.clearance_m[x, y]
