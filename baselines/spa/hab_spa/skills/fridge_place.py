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
from hab_spa.shapes import Array
from hab_spa.skills.fridge_arc import Lead, Pull, arm_points_m
from hab_spa.skills.fridge_door import Door
from hab_spa.skills.fridge_leads import LeadConfig, Leads
from hab_spa.skills.fridge_shunt import Shunt, shunts
from hab_tasks.episodes.robot_start import Rectangle
from hab_tasks.navigation import NavigationMap


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
        most_tries: ... and at most so many.
        stride: Behind the first `most_tries`, only one of so many places is looked at.
        margins_m: Clearances of the resting arm, the largest wanted most.
        alike: Base poses that differ by less in x, y [m] and yaw [rad] are the same to the arm.
        arm_reach_m: Nothing that is farther from the middle of the base touches the resting arm.
        off_steps, in_the_way_steps: What a metre costs that a place is too near or too far, and
            one that something is in the way.
        stop_steps: A drive takes so many steps more than its turns and its way.
        edge_steps: A place at the edge of the region counts as so many steps.
        tight_steps: A clearance that a place lacks counts as so many steps.
        drives: So many ways to a place are looked at closely.
        lead: How the hand's ways with the door are looked for.
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
    lead: LeadConfig = field(default_factory=LeadConfig)


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """A place to stand at.

    Attributes:
        shunt: How to get there; None: the robot stands there.
        cost: About how many steps it takes to move the door from there, and to get there.
        whole: Whether nothing remains to be done then.
        enough: Whether the door gets far enough.
        tight: How many of the wanted clearances are too large for the drive.
    """

    shunt: Shunt | None
    cost: float
    whole: bool
    enough: bool
    tight: int


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
        front = robot.scene.front(number)
        self.door, self._frame, self._body = Door(front), front.frame, front.body
        self._leads = Leads(robot, front, pull, self.may_tow, self._middle(), config.lead)
        self._kept: dict[tuple[int, ...], int] = {}
        self._arm_m = arm_points_m(robot.scene.arm_qpos[None])[0]

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
        lead = self.config.lead
        return self._leads.find(pose, lead.doing if thorough else lead.judging)

    def choose(self, tries: int, in_time_steps: float) -> Chosen | None:
        """Returns the best of the places that are looked at closely; None where none will do.

        Args:
            tries: So many are looked at, more where none of them will do in time.
            in_time_steps: So many steps are left.
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
            place = self._judge(pose)
            # While no place will do at all, those to which there is no way do not count.
            number += best is not None or place is not None
            if place is not None and (best is None or place.cost < best.cost):
                best = place
                if best.enough:
                    more = config.more_tries * (best.tight > 0 or not best.whole)
                    tries = min(tries, number + more)
        return best

    def _judge(self, pose: Array) -> Chosen | None:
        """Looks closely at a base pose (3,); None if the arm or the drive cannot do it."""
        here = np.array_equal(pose, self.robot.base)
        shunt, tight = (None, 0) if here else self.way(pose)
        leads = self.leads(None if here else pose) if here or shunt is not None else []
        if not leads:
            return None
        way_steps = 0.0 if shunt is None else shunt.steps + self.config.tight_steps * tight
        return Chosen(
            shunt=shunt,
            cost=leads[0].cost + way_steps,
            whole=leads[0].whole,
            enough=leads[0].enough,
            tight=tight,
        )

    def glance(self, pose: Array) -> list[Lead]:
        """Returns what the arm can do at a base pose (3,) at first sight."""
        return self._leads.find(pose, self.config.lead.glance)

    def may_tow(self, poses: Array) -> NDArray[np.bool_]:
        """Whether the base may go over poses (K, 3) with the door in the hand, (K,)."""
        roomy = _clearance_m(self._map, poses) >= self.config.least_base_m
        return roomy & self._inside(poses)

    def swept_m(self, poses: Array) -> Array:
        """Returns how far base poses (K, 3) put torso or arm into the door's way, (K,)."""
        points = _placed(self._arm_m[:, :2], poses)
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

        Nobody asks for the number when it is `least` or below. Drives have much in common, so a
        pose next to one that was looked at is not looked at.
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
        """Returns how many of the margins the resting arm keeps at each base pose (3,)."""
        collision, arm = self._leads.collision, self.robot.scene.arm_qpos
        collision.move(self._body, np.eye(4))
        kept = [0] * len(poses)
        for number, margin_m in enumerate(self.config.margins_m[::-1]):
            collision.set_margin(margin_m)
            for i, pose in enumerate(poses):
                if kept[i] == number:
                    collision.stand_at(pose)
                    kept[i] += collision.is_free(arm)
        return kept

    def _reach_m(self, poses: Array) -> Array:
        """Returns how far the hand's places are from the base (3, K), each a pose of `poses`."""
        joints = np.linspace(self.door.joint, self.pull.whole, 3)
        points = np.stack([self.door.handle(float(joint))[:2] for joint in joints])
        return np.linalg.norm(points[:, None] - poses[None, :, :2], axis=2)

    def _middle(self) -> Array:
        """Returns the base pose (3,) in the middle of the places, facing the fridge."""
        x0, y0, yaw = self._frame
        x_m, y_m = np.mean(self.config.x_m), np.mean(self.config.y_m)
        turn = np.array(((np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw))))
        return np.array((*(turn @ (x_m, y_m) + (x0, y0)), yaw + np.pi))

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
