"""Validation of layouts: no overlaps, doors and drawers open, receptacles and handles reachable.

A layout is checked on its own (`check_layout`), or against the macro layout that it varies
(`Baseline`): defects of the macro layout, such as a cushion sunk into its sofa, are accepted.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hab_authoring.layouts.overlaps import (
    Bodies,
    bodies_of,
    depth_m,
    overlaps,
    pieces_of,
    swept_boxes_m,
)
from hab_authoring.layouts.standing import FloorPlan, HandleRoom, handle_room, reachable
from hab_tasks.articulations import FRIDGES
from hab_tasks.privileged import Array
from hab_tasks.world.scenes.floor import CELL_M, FreeFloor
from hab_tasks.world.scenes.habitat.dataset import SceneDataset
from hab_tasks.world.scenes.habitat.load import load_scene
from hab_tasks.world.scenes.layout_geometry import STAGE, Joint, Layout, PosedBody

MAX_DEPTH_M = 0.0101
"""Maximum overlap of bodies: 1 cm, plus 0.1 mm for rounding."""

ISLAND_M2 = 0.25
"""Minimum area of a cut-off part of the free floor that counts as a fault."""

SLIDE_STEP_M = 0.025
HINGE_STEP_RAD = math.radians(5.0)

FRIDGE_HINGE = "top_door_hinge"
"""Exempt from opening to its limit: tasks require 90 degrees of the fridge."""

TASK_FURNITURE = (*FRIDGES, "kitchen_counter", "cabinet", "chestOfDrawers_01")
"""Templates whose drawers and doors must open in every layout (the fridge's upper door)."""

Kind = Literal["overlap", "blocked joint", "no room at a handle", "out of reach", "cut-off floor"]


ALL_FREE = HandleRoom(working=1.0, spawn=1.0)


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """Required clearances of a layout.

    Attributes:
        fridge_rad: Minimum opening angle of the fridge's upper door.
        working_share: Minimum free share of a handle's working region, unless the macro layout
            has less.
        spawn_share: The same of its spawn region, which is larger.
        task_joints_only: Whether doors and drawers that no task uses may open less than in the
            macro layout.
    """

    fridge_rad: float = 2.0
    working_share: float = 0.5
    spawn_share: float = 0.25
    task_joints_only: bool = False


USUAL = Requirements()
WILD = Requirements(fridge_rad=1.6, working_share=0.3, spawn_share=0.2, task_joints_only=True)
"""Requirements of `hab-tasks vary --wild`, the minimum for feasible tasks."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault that makes a layout unusable, with a description."""

    kind: Kind
    text: str


@dataclass(frozen=True, kw_only=True)
class LayoutReport:
    """Faults of one layout; valid if `reasons` is empty."""

    scene_id: str
    faults: tuple[Fault, ...]

    @property
    def reasons(self) -> tuple[str, ...]:
        """One line per fault."""
        return tuple(f"{fault.kind}: {fault.text}" for fault in self.faults)


@dataclass(frozen=True, kw_only=True)
class FreeRange:
    """Collision-free range of a joint from closed [m or rad], and the body that limits it."""

    lower: float
    upper: float
    blocker: str | None = None


def check_layout(dataset: SceneDataset, scene_id: str) -> LayoutReport:
    """Checks one layout of a dataset on its own."""
    layout = Layout.of(load_scene(dataset, scene_id))
    requirements = WILD if dataset.layouts and dataset.layouts.wild else USUAL
    return LayoutReport(scene_id=scene_id, faults=tuple(_own_faults(layout, requirements)))


def free_range(joint: Joint, others: Bodies, hinge_step_rad: float = HINGE_STEP_RAD) -> FreeRange:
    """Sweeps a joint from closed to both limits against `others`.

    The sweep stops where one of its bodies overlaps another by more than `MAX_DEPTH_M` and by more
    than when closed. All other joints stay closed.
    """
    near = [
        (body, other)
        for body, box_m in zip(joint.members, swept_boxes_m(joint), strict=True)
        for other in others.near(box_m)
        if other.piece != joint.piece
    ]
    if not near:
        return FreeRange(lower=joint.lower, upper=joint.upper)
    allowed_m = [max(MAX_DEPTH_M, depth_m(body, other)) + 1e-6 for body, other in near]
    step = SLIDE_STEP_M if joint.kind == "slide" else hinge_step_rad
    lower, first = _open(joint, joint.lower, step, near, allowed_m)
    upper, second = _open(joint, joint.upper, step, near, allowed_m)
    return FreeRange(lower=lower, upper=upper, blocker=first or second)


class Baseline:
    """Reference values of a macro layout, against which its variations are checked."""

    def __init__(
        self,
        layout: Layout,
        requirements: Requirements = USUAL,
        away: Mapping[str, Array] | None = None,
    ) -> None:
        """Measures the macro layout.

        Args:
            layout: The macro layout.
            requirements: Required clearances of its variations.
            away: Motions (4, 4) that move pieces out of the room. Floor that is cut off even then
                is accepted; without this argument, floor cut off in the macro layout is.
        """
        self._needs = requirements
        bodies = bodies_of(layout)
        self.layout = layout
        self.plan = FloorPlan(layout)
        self._depths = {_pair(a, b): depth for a, b, depth in overlaps(bodies, bodies)}
        self._ranges = {_key(joint): free_range(joint, bodies) for joint in layout.joints}
        floor = self.plan.floor()
        self._cut_off = np.zeros_like(floor.room)
        for island in self.plan.cut_off(self.plan.floor(away)):
            self._cut_off |= island
        self._reached = {k for k, ok in reachable(layout, self.plan, floor).items() if ok}
        self._rooms = handle_room(layout, floor)

    def overlapping(self, layout: Layout, moved: Iterable[str]) -> Iterator[Fault]:
        """Yields overlaps of the `moved` pieces that are deeper than in the macro layout."""
        for first, second, depth in overlaps(pieces_of(layout, moved), bodies_of(layout)):
            if depth > max(MAX_DEPTH_M, self._depths.get(_pair(first, second), 0.0) + 1e-6):
                yield _overlap(first, second, depth)

    def blocked(self, layout: Layout, moved: Iterable[str]) -> Iterator[Fault]:
        """Yields joints that open less than in the macro layout, and less than tasks require."""
        moved = set(moved)
        movers = pieces_of(layout, moved)
        for joint in layout.joints:
            if self._needs.task_joints_only and not _in_tasks(layout, joint):
                continue
            others = bodies_of(layout) if joint.piece in moved else movers
            own = self._ranges[_key(joint)]
            needed = min(own.upper, _needed(layout, joint, self._needs))
            found = free_range(joint, others)
            if found.lower > own.lower + 1e-6 or found.upper < needed - 1e-6:
                yield _blocked(joint, found)

    def cramped(self, layout: Layout, motions: Mapping[str, Array]) -> Iterator[Fault]:
        """Yields receptacles that are no longer reachable, and cut-off floor."""
        floor = self.plan.floor(motions)
        yield from self.crowded(layout, floor)
        for name, ok in reachable(layout, self.plan, floor).items():
            if not ok and name in self._reached:
                yield Fault(kind="out of reach", text=name)

    def crowded(
        self, layout: Layout, floor: FreeFloor, absent: Collection[str] = ()
    ) -> Iterator[Fault]:
        """Yields cut-off floor, and handles (not those of pieces in `absent`) without room."""
        for island in self.plan.cut_off(floor):
            yield from _island(island & ~self._cut_off)
        for handle, room in handle_room(layout, floor).items():
            if handle.partition("/")[0] not in absent:
                yield from _no_room(handle, room, self._needs, self._rooms[handle])


def is_refused(counts: Counter[str], faults: Iterator[Fault]) -> bool:
    """Whether there is a fault; counts the first by kind."""
    fault = next(faults, None)
    if fault is not None:
        counts[fault.kind] += 1
    return fault is not None


def _own_faults(layout: Layout, requirements: Requirements) -> Iterator[Fault]:
    bodies = bodies_of(layout)
    for first, second, depth in overlaps(bodies, bodies):
        if first.name < second.name and depth > MAX_DEPTH_M:
            yield _overlap(first, second, depth)
    for joint in layout.joints:
        if not _in_tasks(layout, joint):
            continue
        found = free_range(joint, bodies)
        if (
            found.lower > joint.lower + 1e-6
            or found.upper < _needed(layout, joint, requirements) - 1e-6
        ):
            yield _blocked(joint, found)
    plan = FloorPlan(layout)
    floor = plan.floor()
    for island in plan.cut_off(floor):
        yield from _island(island)
    for handle, room in handle_room(layout, floor).items():
        yield from _no_room(handle, room, requirements)
    for name, ok in reachable(layout, plan, floor).items():
        if not ok:
            yield Fault(kind="out of reach", text=name)


def _open(
    joint: Joint,
    limit: float,
    step: float,
    near: list[tuple[PosedBody, PosedBody]],
    allowed_m: list[float],
) -> tuple[float, str | None]:
    """Opens a joint towards one limit; returns the reached position, and the blocking body.

    Args:
        joint: The joint.
        limit: Joint limit [m or rad].
        step: Step between checked positions [m or rad].
        near: Pairs of a body of the joint and another body it may collide with.
        allowed_m: Allowed overlap of each pair.
    """
    reached = 0.0
    for value in np.linspace(0.0, limit, 1 + math.ceil(abs(limit) / step))[1:]:
        motion = joint.motion(value)
        moved = {body.name: body.moved(motion) for body, _ in near}
        for (body, other), allowed in zip(near, allowed_m, strict=True):
            if depth_m(moved[body.name], other) > allowed:
                return reached, other.name
        reached = float(value)
    return limit, None


def _in_tasks(layout: Layout, joint: Joint) -> bool:
    return _template(layout, joint) in TASK_FURNITURE and joint.name != "bottom_door_hinge"


def _needed(layout: Layout, joint: Joint, requirements: Requirements) -> float:
    fridge = _template(layout, joint) in FRIDGES and joint.name == FRIDGE_HINGE
    return min(joint.upper, requirements.fridge_rad) if fridge else joint.upper


def _template(layout: Layout, joint: Joint) -> str:
    return next(a.template for a in layout.spec.articulations if a.name == joint.piece)


def _pair(first: PosedBody, second: PosedBody) -> frozenset[str]:
    return frozenset((first.name, second.name))


def _key(joint: Joint) -> tuple[str, str]:
    return joint.piece, joint.name


def _overlap(first: PosedBody, second: PosedBody, depth: float) -> Fault:
    names = " and ".join(_shown(name) for name in sorted((first.name, second.name)))
    return Fault(kind="overlap", text=f"{names} by {depth:.3f} m")


def _blocked(joint: Joint, found: FreeRange) -> Fault:
    unit = "m" if joint.kind == "slide" else "rad"
    return Fault(
        kind="blocked joint",
        text=f"{joint.piece} {joint.name} opens over [{found.lower:.2f}, {found.upper:.2f}] {unit} "
        f"of [{joint.lower:.2f}, {joint.upper:.2f}], then meets {_shown(found.blocker or '')}",
    )


def _island(cells: NDArray[np.bool_]) -> Iterator[Fault]:
    area_m2 = CELL_M**2 * float(cells.sum())
    if area_m2 > ISLAND_M2:
        yield Fault(kind="cut-off floor", text=f"{area_m2:.2f} m2, behind furniture")


def _no_room(
    handle: str, room: HandleRoom, requirements: Requirements, macro: HandleRoom = ALL_FREE
) -> Iterator[Fault]:
    """Yields the regions with less free floor than required, and than the macro layout has."""
    required = HandleRoom(requirements.working_share, requirements.spawn_share)
    for region, share, *enough in zip(HandleRoom._fields, room, required, macro, strict=True):
        if share < min(enough) - 1e-6:
            text = f"{handle}: {share:.0%} of the {region} region before it is free"
            yield Fault(kind="no room at a handle", text=text)


def _shown(name: str) -> str:
    return STAGE if name.startswith(f"{STAGE}/") else name
