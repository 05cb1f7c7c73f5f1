"""Objects put side by side on receptacles, then left to physics; what falls off is refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from transforms3d import quaternions

from hab_tasks.episodes.receptacles import FRIDGE, MOST_OBJECTS, Spot
from hab_tasks.episodes.schema import ReceptacleRef, rounded, template_of
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.geometry import Array, Pose7, pose, rotation_between

Disc = tuple[Array, float]
"""Centre (3,) and radius [m] of a piece of surface."""

AWAY: Pose7 = (0.0, 0.0, -9.0, 1.0, 0.0, 0.0, 0.0)

INTO_M = 0.03
"""An object put into a bowl starts this far below the brim."""


@dataclass(frozen=True, kw_only=True)
class Settling:
    """How objects are put down, and when they count as stable.

    Attributes:
        seconds: Longest settling time.
        drop_m: Height from which an object is let go.
        beside_m: Farthest its centre of mass may lie beside the receptacle's box.
        below_m: Farthest it may lie below the box's lower face; cushions give way.
        fridge_inner: Share of the fridge's shelf that is used (Habitat).
        rounds: How often what fell is put somewhere else, the first time included.
        restarts: How often everything is started anew from where it lies, to see whether it stays.
    """

    seconds: float = 4.0
    drop_m: float = 0.005
    beside_m: float = 0.02
    below_m: float = 0.03
    fridge_inner: float = 0.5
    rounds: int = 3
    restarts: int = 3


@dataclass(frozen=True, kw_only=True)
class _Wish:
    """Where an object may be put, and what it must keep off: points (3,) with radii [m]."""

    spots: tuple[Spot, ...]
    avoid: tuple[Disc, ...] = ()


class Placer:
    """Finds places for objects on spots, one after another.

    Attributes:
        placed: Handle -> pose where each object was put.
        on: Handle -> the receptacle it was put on.
    """

    def __init__(
        self, bench: Workbench, rng: np.random.Generator, settling: Settling = Settling()
    ) -> None:
        self._bench, self._rng, self._settling = bench, rng, settling
        self._taken: dict[ReceptacleRef, dict[str, Disc]] = {}
        self._lying: dict[ReceptacleRef, list[Disc]] = {}
        self._wishes: dict[str, _Wish] = {}
        self._spots: dict[str, Spot] = {}
        self._inside: dict[str, str] = {}
        self.placed: dict[str, Pose7] = {}
        self.on: dict[str, ReceptacleRef] = {}

    def put(self, handle: str, spots: Sequence[Spot], avoid: Sequence[Disc] = ()) -> bool:
        """Stands an object upright on one of the spots, tried in random order, turned at random.

        Returns whether there was room. It keeps off the discs of `avoid`.
        """
        self._wishes[handle] = _Wish(spots=tuple(spots), avoid=tuple(avoid))
        order = self._rng.permutation(len(spots))
        return any(self._put_on(handle, spots[int(index)], avoid) for index in order)

    def _put_on(self, handle: str, spot: Spot, avoid: Sequence[Disc]) -> bool:
        bench = self._bench
        taken = self._taken.setdefault(spot.ref, {})
        if len(taken) >= MOST_OBJECTS.get(spot.receptacle.name, len(taken) + 1):
            return False
        middle, radius_m, depth_m = bench.footprint(handle)
        inner = self._settling.fridge_inner if spot.receptacle.name == FRIDGE else 1.0
        if spot.ref not in self._lying:
            self._lying[spot.ref] = self._lying_on(spot)
        discs = [*taken.values(), *self._lying[spot.ref], *avoid]
        point = spot.sample(self._rng, radius_m, discs, inner)
        if point is None:
            return False
        turn = quaternions.axangle2quat([0.0, 0.0, 1.0], self._rng.uniform(-math.pi, math.pi))
        upright = bench.templates[template_of(handle)].up
        q = quaternions.qmult(turn, rotation_between(np.array(upright), np.array([0.0, 0.0, 1.0])))
        above = np.array([0.0, 0.0, depth_m + self._settling.drop_m])
        self._place(handle, pose(point + above - quaternions.rotate_vector(middle, q), q), spot.ref)
        taken[handle], self._spots[handle] = (point, radius_m), spot
        return True

    def _lying_on(self, spot: Spot) -> list[Disc]:
        """Returns discs that hold the layout's own loose objects, where they reach into a spot."""
        face_m = float(spot.center_m[2])
        found = []
        for name in self._bench.handles.loose:
            low, high = self._bench.box_m(name)
            if (
                name != spot.receptacle.body
                and low[2] < face_m + spot.height_m
                and high[2] > face_m
            ):
                middle = (low + high) / 2
                disc = np.array([middle[0], middle[1], face_m]), math.dist(low[:2], high[:2]) / 2
                found.append(disc)
        return found

    def put_into(self, handle: str, container: str) -> None:
        """Holds an object just above the middle of another one, so that it falls in."""
        bench = self._bench
        middle, _, depth_m = bench.footprint(handle)
        top_m = bench.top_m(container)
        upright = bench.templates[template_of(handle)].up
        q = np.array(rotation_between(np.array(upright), np.array([0.0, 0.0, 1.0])))
        centre = bench.com_m(container)
        point = np.array([centre[0], centre[1], top_m - INTO_M + depth_m])
        world_from_object = pose(point - quaternions.rotate_vector(middle, q), q)
        self._inside[handle] = container
        self._place(handle, world_from_object, self.on[container])

    def _is_in(self, handle: str, container: str) -> bool:
        """Whether an object lies in another one: within its outline, lower than its brim."""
        bench = self._bench
        _, radius_m, _ = bench.footprint(container)
        way = bench.com_m(handle) - bench.com_m(container)
        low = bench.pose(handle)[2] - bench.footprint(handle)[2]
        return float(np.linalg.norm(way[:2])) < radius_m and low < bench.top_m(container)

    def _place(self, handle: str, world_from_object: Pose7, on: ReceptacleRef) -> None:
        # The last digits of a product depend on where its numbers lie in memory, and physics would
        # carry them on: what is put down is rounded first.
        self.placed[handle], self.on[handle] = rounded(world_from_object), on
        self._bench.place(handle, self.placed[handle])

    def settle(self) -> dict[str, Pose7]:
        """Runs physics; returns handle -> pose of what rests on its receptacle, sorted.

        What fell off is put somewhere else, `Settling.rounds` times in all.
        """
        for _ in range(self._settling.rounds - 1):
            stable = self._run()
            fallen = [handle for handle in sorted(self.placed) if handle not in stable]
            if not fallen:
                return stable
            for handle in fallen:
                if handle not in self._inside:
                    self._put_again(handle)
            for handle, container in self._inside.items():
                if {handle, container} & set(fallen) and container in self.placed:
                    self.put_into(handle, container)
        return self._run()

    def _put_again(self, handle: str) -> None:
        wish = self._wishes[handle]
        del self._taken[self.on[handle]][handle]
        if not self.put(handle, wish.spots, wish.avoid):
            self._bench.place(handle, AWAY)
            del self.placed[handle]

    def _run(self) -> dict[str, Pose7]:
        names = tuple(sorted(self.placed))
        self._bench.settle(self._settling.seconds, names)
        poses: dict[str, Pose7] = {}
        restless: set[str] = set()
        for _ in range(self._settling.restarts):
            poses = {name: rounded(self._bench.pose(name)) for name in names}
            restless = self._bench.restless(poses)
            if not restless:
                break
        return {name: poses[name] for name in names if name not in restless and self._rests(name)}

    def _rests(self, handle: str) -> bool:
        """Whether an object lies on the receptacle it was put on."""
        limits = self._settling
        if handle in self._inside:
            return self._is_in(handle, self._inside[handle])
        spot = self._spots[handle]
        offset = self._bench.com_m(handle) - spot.center_m
        beside = np.abs(offset @ spot.axes) - spot.half_m
        return bool((beside < limits.beside_m).all() and -limits.below_m < offset[2])
