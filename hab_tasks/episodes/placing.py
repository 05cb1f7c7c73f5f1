"""Placement of objects on receptacles, followed by settling; release of a held object."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from transforms3d import quaternions

from hab_tasks.constants import PHYSICS_STEPS, PLACE_RADIUS_M, SKILL_HORIZON_STEPS
from hab_tasks.episodes.sandbox import PlacementSandbox
from hab_tasks.episodes.schema import ReceptacleRef, RobotStart, rounded, template_of
from hab_tasks.episodes.spots import MOST_OBJECTS, Spot
from hab_tasks.geometry import Array, Pose7, pose, rotation_between
from hab_tasks.receptacles import FRIDGE
from hab_tasks.robots.hand import hand_of

Disc = tuple[Array, float]
"""Centre (3,) and radius [m] of a disc on a surface."""

AWAY: Pose7 = (0.0, 0.0, -9.0, 1.0, 0.0, 0.0, 0.0)

INTO_M = 0.03
"""Start depth below the rim of an object placed into a bowl."""


@dataclass(frozen=True, kw_only=True)
class Settling:
    """Parameters of placement and stability.

    Attributes:
        seconds: Maximum settling time.
        drop_m: Drop height.
        beside_m: Maximum horizontal distance of the centre of mass to the receptacle's box.
        below_m: Maximum distance below the box's lower face; cushions give way.
        fridge_inner: Usable share of the fridge's shelf (Habitat).
        rounds: Maximum number of placements of an object that falls.
        restarts: Number of restarts from the settled poses, to test stability.
    """

    seconds: float = 4.0
    drop_m: float = 0.005
    beside_m: float = 0.02
    below_m: float = 0.03
    fridge_inner: float = 0.5
    rounds: int = 3
    restarts: int = 3


class Placer:
    """Places objects on spots, one after another; has their poses and receptacles by name."""

    def __init__(
        self, sandbox: PlacementSandbox, rng: np.random.Generator, settling: Settling = Settling()
    ) -> None:
        self._sandbox, self._rng, self._settling = sandbox, rng, settling
        self._taken: dict[ReceptacleRef, dict[str, Disc]] = {}
        self._lying: dict[ReceptacleRef, list[Disc]] = {}
        self._asked: dict[str, tuple[Sequence[Spot], Sequence[Disc]]] = {}
        self._spots: dict[str, Spot] = {}
        self._inside: dict[str, str] = {}
        self.placed: dict[str, Pose7] = {}
        self.on: dict[str, ReceptacleRef] = {}

    def put(self, name: str, spots: Sequence[Spot], avoid: Sequence[Disc] = ()) -> bool:
        """Places an object upright with random yaw on one of the spots, in random order.

        Returns whether there was room. The object avoids the discs of `avoid`.
        """
        self._asked[name] = spots, avoid
        order = self._rng.permutation(len(spots))
        return any(self._put_on(name, spots[int(index)], avoid) for index in order)

    def _put_on(self, name: str, spot: Spot, avoid: Sequence[Disc]) -> bool:
        sandbox = self._sandbox
        taken = self._taken.setdefault(spot.ref, {})
        if len(taken) >= MOST_OBJECTS.get(spot.receptacle.name, len(taken) + 1):
            return False
        middle, radius_m, depth_m = sandbox.footprint(name)
        inner = self._settling.fridge_inner if spot.receptacle.name == FRIDGE else 1.0
        if spot.ref not in self._lying:
            self._lying[spot.ref] = self._lying_on(spot)
        discs = [*taken.values(), *self._lying[spot.ref], *avoid]
        point = spot.sample(self._rng, radius_m, discs, inner)
        if point is None:
            return False
        turn = quaternions.axangle2quat([0.0, 0.0, 1.0], self._rng.uniform(-math.pi, math.pi))
        upright = sandbox.templates[template_of(name)].up
        q = quaternions.qmult(turn, rotation_between(np.array(upright), np.array([0.0, 0.0, 1.0])))
        above = np.array([0.0, 0.0, depth_m + self._settling.drop_m])
        self._place(name, pose(point + above - quaternions.rotate_vector(middle, q), q), spot.ref)
        taken[name], self._spots[name] = (point, radius_m), spot
        return True

    def _lying_on(self, spot: Spot) -> list[Disc]:
        """Returns discs around the layout's loose objects that overlap a spot."""
        face_m = float(spot.center_m[2])
        found = []
        for name in self._sandbox.scene_bodies.loose:
            low, high = self._sandbox.box_m(name)
            level = low[2] < face_m + spot.height_m and high[2] > face_m
            if level and name != spot.receptacle.body:
                middle = (low + high) / 2
                disc = np.array([middle[0], middle[1], face_m]), math.dist(low[:2], high[:2]) / 2
                found.append(disc)
        return found

    def put_into(self, name: str, container: str) -> None:
        """Places an object just above the centre of a container, so that it falls in."""
        sandbox = self._sandbox
        middle, _, depth_m = sandbox.footprint(name)
        top_m = sandbox.top_m(container)
        upright = sandbox.templates[template_of(name)].up
        q = np.array(rotation_between(np.array(upright), np.array([0.0, 0.0, 1.0])))
        centre = sandbox.com_m(container)
        point = np.array([centre[0], centre[1], top_m - INTO_M + depth_m])
        world_from_object = pose(point - quaternions.rotate_vector(middle, q), q)
        self._inside[name] = container
        self._place(name, world_from_object, self.on[container])

    def _is_in(self, name: str, container: str) -> bool:
        """Whether an object is in a container: within its outline, below its rim."""
        sandbox = self._sandbox
        _, radius_m, _ = sandbox.footprint(container)
        offset = sandbox.com_m(name) - sandbox.com_m(container)
        low = sandbox.pose(name)[2] - sandbox.footprint(name)[2]
        return float(np.linalg.norm(offset[:2])) < radius_m and low < sandbox.top_m(container)

    def _place(self, name: str, world_from_object: Pose7, on: ReceptacleRef) -> None:
        # The last digits of a product depend on memory alignment, and physics would amplify the
        # difference, so poses are rounded first.
        self.placed[name], self.on[name] = rounded(world_from_object), on
        self._sandbox.place(name, self.placed[name])

    def settle(self) -> dict[str, Pose7]:
        """Runs physics; returns name -> pose, sorted, of objects resting on their receptacles.

        Objects that fell are placed again, up to `Settling.rounds` placements in total.
        """
        for _ in range(self._settling.rounds - 1):
            stable = self._run()
            fallen = [name for name in sorted(self.placed) if name not in stable]
            if not fallen:
                return stable
            for name in fallen:
                if name not in self._inside:
                    del self._taken[self.on[name]][name]
                    if not self.put(name, *self._asked[name]):
                        self._sandbox.place(name, AWAY)
                        del self.placed[name]
            for name, container in self._inside.items():
                if {name, container} & set(fallen) and container in self.placed:
                    self.put_into(name, container)
        return self._run()

    def _run(self) -> dict[str, Pose7]:
        names = tuple(sorted(self.placed))
        self._sandbox.settle(self._settling.seconds, names)
        poses: dict[str, Pose7] = {}
        restless: set[str] = set()
        for _ in range(self._settling.restarts):
            poses = {name: rounded(self._sandbox.pose(name)) for name in names}
            restless = self._sandbox.restless(poses)
            if not restless:
                break
        return {name: poses[name] for name in names if name not in restless and self._rests(name)}

    def _rests(self, name: str) -> bool:
        """Whether an object rests on the receptacle it was placed on."""
        limits = self._settling
        if name in self._inside:
            return self._is_in(name, self._inside[name])
        spot = self._spots[name]
        offset = self._sandbox.com_m(name) - spot.center_m
        beside = np.abs(offset @ spot.axes) - spot.half_m
        return bool((beside < limits.beside_m).all() and -limits.below_m < offset[2])


GOAL_MARGIN_M = 0.03
"""Required margin to the goal, as the end of a fall varies by centimetres."""


def falls_to(sandbox: PlacementSandbox, robot: RobotStart, held: str, goal_com_m: Array) -> bool:
    """Whether a released object reaches its goal (3,), by its centre of mass, before it rests.

    The robot opens its hand in the first action, as in an episode, and stands still. The object
    starts at its start pose; the poses of it and of other objects are not restored.
    """
    agent = sandbox.stand_robot(robot.base, robot.arm_pose(sandbox.robot))
    names, movable = list(sandbox.scene_bodies.movable), list(sandbox.scene_bodies.movable.values())
    grasp = hand_of(agent, movable, [], "objects")
    grasp.attach(names.index(held))
    idle = agent.controller.idle_action(holding=False)
    near = False
    for _ in range(SKILL_HORIZON_STEPS):
        agent.controller.set_entries(idle)
        grasp.command(agent.controller.gripper)
        for _ in range(PHYSICS_STEPS):
            grasp.before_physics_step()
            agent.scene.px.step()
        grasp.after_control_step()
        gap_m = float(np.linalg.norm(sandbox.com_m(held) - goal_com_m))
        near = gap_m < PLACE_RADIUS_M + GOAL_MARGIN_M
        if near or sandbox.asleep(held):
            break
    grasp.reset()
    sandbox.send_robot_away()
    return near
