"""Start states of the three tasks (S G.1): clutter, objects to move, and where they are to go.

Goals are found like starts: a second instance of each object is put down at the goal, settles with
everything else, and is taken away. Whatever starts closed is filled while open.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hab_tasks.episodes.generators.base import (
    Generator,
    instances,
    open_joints,
    put_all,
    stage,
    start_state,
)
from hab_tasks.episodes.generators.drawer import DRAWER_MARKER, carried, slides
from hab_tasks.episodes.generators.furniture import find_front, handles_m
from hab_tasks.episodes.placing import AWAY, Placer
from hab_tasks.episodes.receptacles import DRAWER, Spot
from hab_tasks.episodes.refusal import RefusedError
from hab_tasks.episodes.robot_start import KeepOff
from hab_tasks.episodes.schema import Episode, Rearrangement
from hab_tasks.episodes.workbench import Workbench
from hab_tasks.geometry import Pose7

LEAST_MOVE_M = 0.5
"""A start and its goal are at least this far apart (Habitat's generator)."""

KEPT_CLUTTER = 0.8
"""Unstable clutter is taken away, as in Habitat's generator; at least this share must stay."""

KEEP_OFF_M = 0.6
"""A goal is sought at least this far from the start: both may settle a little aside."""


@dataclass(frozen=True, kw_only=True)
class Move:
    """One object of a task.

    Attributes:
        start: Receptacles of which it starts on one.
        goal: Receptacles of which it ends on one; empty for `into`.
        object: Its name; drawn when None.
        into: Number of the move whose object, at its goal, this one is put into.
    """

    start: tuple[str, ...]
    goal: tuple[str, ...] = ()
    object: str | None = None
    into: int | None = None


class Rearrange(Generator):
    """A task given by its moves."""

    moves: ClassVar[tuple[Move, ...]]
    clutter: ClassVar[int]
    clutter_on: ClassVar[tuple[str, ...]]
    starts_open: ClassVar[bool]

    def attempt(self, bench: Workbench, rng: np.random.Generator) -> Episode:
        """Returns one candidate."""
        named = [n for move in self.moves for n in (*move.start, *move.goal)]
        everywhere = tuple(dict.fromkeys([*named, *self.clutter_on]))
        spots = {s.ref: s for s in self.spots(bench, everywhere)}
        names = [move.object or self._any_name(rng) for move in self.moves]
        clutter = [self._any_name(rng) for _ in range(self.clutter)]
        handles = instances([*names, *clutter, *names])
        count = len(self.moves)
        targets, ghosts = handles[:count], handles[-count:]
        bench.show(handles)
        joints = _merged([*(spot.joints for spot in spots.values()), self._open_drawer(bench)])
        open_joints(bench, joints)
        placer = Placer(bench, rng, self.settling)
        self._put_targets(placer, targets, list(spots.values()))
        self._put_goals(placer, targets, ghosts, list(spots.values()))
        put_all(placer, handles[count:-count], _named(spots.values(), self.clutter_on))
        settled = placer.settle()
        goals = self._goals(settled, targets, ghosts)
        objects = {h: pose for h, pose in settled.items() if h not in ghosts}
        if any(handle not in objects for handle in targets):
            raise RefusedError("a target does not stay at its start")
        if len(objects) - count < KEPT_CLUTTER * self.clutter:
            raise RefusedError("too much clutter fell")
        points = [bench.com_m(handle) for handle in (*targets, *ghosts)]
        stage(bench, objects, joints)
        starts = self.starts(bench, rng)
        if not all(starts.stand(point) for point in points):
            raise RefusedError("a start or goal is out of reach")
        if not self.starts_open:
            objects = self._closed(bench, placer, objects)
            stage(bench, objects, {})
        rearrangements = tuple(
            Rearrangement(
                object=target, start=placer.on[target], goal=placer.on[ghost], world_from_goal=goal
            )
            for target, ghost, goal in zip(targets, ghosts, goals, strict=True)
        )
        in_reach = KeepOff(points_m=np.concatenate([bench.graspable_m(), handles_m(bench)]))
        robot = self.starts(bench, rng, in_reach).anywhere()
        return start_state(bench, robot, objects, rearrangements)

    def _open_drawer(self, bench: Workbench) -> dict[str, dict[str, float]]:
        """Returns the drawer's open joint where the task starts with it open, empty or not."""
        if not self.starts_open:
            return {}
        ref = find_front(bench, DRAWER_MARKER).ref
        return {ref.furniture: {ref.joint: bench.joint_limits(ref.furniture, ref.joint)[1]}}

    def _any_name(self, rng: np.random.Generator) -> str:
        return self.objects.names[int(rng.integers(len(self.objects.names)))]

    def _put_targets(self, placer: Placer, targets: list[str], spots: list[Spot]) -> None:
        for target, move in zip(targets, self.moves, strict=True):
            if not placer.put(target, _named(spots, move.start)):
                raise RefusedError("no room for a target at its start")

    def _put_goals(
        self, placer: Placer, targets: list[str], ghosts: list[str], spots: list[Spot]
    ) -> None:
        for target, ghost, move in zip(targets, ghosts, self.moves, strict=True):
            start = np.array(placer.placed[target][:3])
            if move.into is not None:
                placer.put_into(ghost, ghosts[move.into])
            elif not placer.put(ghost, _named(spots, move.goal), [(start, KEEP_OFF_M)]):
                raise RefusedError("no room for a target at its goal")

    def _goals(
        self, settled: dict[str, Pose7], targets: list[str], ghosts: list[str]
    ) -> list[Pose7]:
        goals = []
        for target, ghost in zip(targets, ghosts, strict=True):
            if ghost not in settled:
                raise RefusedError("a target does not stay at its goal")
            goals.append(settled[ghost])
            way = np.subtract(goals[-1][:3], settled.get(target, AWAY)[:3])
            if np.linalg.norm(way) < LEAST_MOVE_M:
                raise RefusedError("start and goal too near each other")
        return goals

    def _closed(
        self, bench: Workbench, placer: Placer, objects: dict[str, Pose7]
    ) -> dict[str, Pose7]:
        """Shuts the drawer with what is in it; doors do not move what stands on shelves."""
        inside = {h: pose for h, pose in objects.items() if placer.on[h][0] == DRAWER}
        if inside:
            front = find_front(bench, DRAWER_MARKER)
            if not slides(bench, inside, front):
                raise RefusedError("the drawer cannot be moved with the object")
            inside = carried(bench, inside, front, 0.0)
            stage(bench, objects | inside, {})
            if any(bench.touching(handle) for handle in inside):
                raise RefusedError("the drawer cannot be closed over the object")
        return objects | inside


def _named(spots: Iterable[Spot], names: tuple[str, ...]) -> list[Spot]:
    return [spot for spot in spots if spot.receptacle.name in names]


def _merged(parts: Iterable[dict[str, dict[str, float]]]) -> dict[str, dict[str, float]]:
    merged: dict[str, dict[str, float]] = {}
    for part in parts:
        for furniture, joints in part.items():
            merged.setdefault(furniture, {}).update(joints)
    return merged
