"""Is a layout usable: nothing overlaps, doors and drawers open, the robot can reach what it must.

A layout is checked on its own (`check_layout`), or against the macro layout that it varies
(`Baseline`): what an artist accepted there, such as a cushion sunk into its sofa, may stay.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hab_tasks.privileged import Array
from hab_tasks.scenes.dataset import SceneDataset
from hab_tasks.scenes.floor import CELL_M, FreeFloor
from hab_tasks.scenes.layout_geometry import STAGE, Bodies, Joint, Layout, Placed, depth_m, overlaps
from hab_tasks.scenes.load import load_scene
from hab_tasks.scenes.markers import FRIDGES
from hab_tasks.scenes.standing import FloorPlan, handle_room, reachable

MAX_DEPTH_M = 0.0101
"""Bodies may overlap by 1 cm; a tenth of a millimetre is left to rounding."""

ISLAND_M2 = 0.25
"""A cut-off part of the free floor counts from this area on."""

SLIDE_STEP_M = 0.025
HINGE_STEP_RAD = math.radians(5.0)

FRIDGE_HINGE = "top_door_hinge"
"""It need not open to its limit: tasks leave the fridge at 90 degrees or more."""

TASK_FURNITURE = (*FRIDGES, "kitchen_counter", "cabinet", "chestOfDrawers_01")
"""Templates whose drawers and doors must open in every layout (the fridge's upper door)."""

Kind = Literal["overlap", "blocked joint", "no room at a handle", "out of reach", "cut-off floor"]


@dataclass(frozen=True, kw_only=True)
class Needs:
    """How much room is enough.

    Attributes:
        fridge_rad: The fridge's upper door must open so far.
        handle_share: Share of a handle's spawn rectangle that must be free, unless the macro layout
            has less.
        task_joints_only: Whether doors and drawers that no task uses may open less far than in the
            macro layout.
    """

    fridge_rad: float = 2.0
    handle_share: float = 0.5
    task_joints_only: bool = False


USUAL = Needs()
WILD = Needs(fridge_rad=1.6, handle_share=0.3, task_joints_only=True)
"""What `hab-tasks vary --wild` keeps to: tasks are possible, and no more."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Something that makes a layout unusable; `text` tells what and where."""

    kind: Kind
    text: str


@dataclass(frozen=True, kw_only=True)
class LayoutReport:
    """What is wrong with one layout; nothing if `reasons` is empty."""

    scene_id: str
    faults: tuple[Fault, ...]

    @property
    def reasons(self) -> tuple[str, ...]:
        """One line for each fault."""
        return tuple(f"{fault.kind}: {fault.text}" for fault in self.faults)


@dataclass(frozen=True, kw_only=True)
class FreeRange:
    """How far a joint opens from closed [m or rad], and the body that then stops it."""

    lower: float
    upper: float
    blocker: str | None = None


def check_layout(dataset: SceneDataset, scene_id: str) -> LayoutReport:
    """Checks one layout of a dataset on its own."""
    layout = Layout.of(load_scene(dataset, scene_id))
    needs = WILD if dataset.layouts and dataset.layouts.wild else USUAL
    return LayoutReport(scene_id=scene_id, faults=tuple(_own_faults(layout, needs)))


def free_range(joint: Joint, others: Bodies, hinge_step_rad: float = HINGE_STEP_RAD) -> FreeRange:
    """Sweeps a joint from closed to both limits against `others`.

    It is stopped where one of its bodies overlaps another by more than `MAX_DEPTH_M` and by more
    than when closed. Everything else stays closed.
    """
    near = [
        (body, other)
        for body, way in zip(joint.members, joint.ways_m, strict=True)
        for other in others.near(way)
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
    """What a macro layout itself keeps to, by which its variations are judged."""

    def __init__(
        self, layout: Layout, needs: Needs = USUAL, away: Mapping[str, Array] | None = None
    ) -> None:
        """Measures the macro layout.

        Args:
            layout: The macro layout.
            needs: How much room its variations are to leave.
            away: Motions (4, 4) that take pieces out of the room; floor that is cut off even then
                may be. Without it, what is cut off in the macro layout may be.
        """
        self._needs = needs
        bodies = layout.bodies
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
        """Yields overlaps of moved pieces (handles) that are deeper than in the macro layout."""
        for first, second, depth in overlaps(layout.of_pieces(moved), layout.bodies):
            if depth > max(MAX_DEPTH_M, self._depths.get(_pair(first, second), 0.0) + 1e-6):
                yield _overlap(first, second, depth)

    def blocked(self, layout: Layout, moved: Iterable[str]) -> Iterator[Fault]:
        """Yields joints that open less far than in the macro layout, and than tasks need."""
        moved = set(moved)
        movers = layout.of_pieces(moved)
        for joint in layout.joints:
            if self._needs.task_joints_only and not _in_tasks(layout, joint):
                continue
            others = layout.bodies if joint.piece in moved else movers
            own = self._ranges[_key(joint)]
            needed = min(own.upper, _needed(layout, joint, self._needs))
            found = free_range(joint, others)
            if found.lower > own.lower + 1e-6 or found.upper < needed - 1e-6:
                yield _blocked(joint, found)

    def cramped(self, layout: Layout, motions: Mapping[str, Array]) -> Iterator[Fault]:
        """Yields what the robot can no longer reach, and floor that is cut off."""
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
        for handle, share in handle_room(layout, floor).items():
            enough = min(self._needs.handle_share, self._rooms[handle])
            if share < enough - 1e-6 and handle.partition("/")[0] not in absent:
                yield _no_room(handle, share)


def _own_faults(layout: Layout, needs: Needs) -> Iterator[Fault]:
    bodies = layout.bodies
    for first, second, depth in overlaps(bodies, bodies):
        if first.name < second.name and depth > MAX_DEPTH_M:
            yield _overlap(first, second, depth)
    for joint in layout.joints:
        if not _in_tasks(layout, joint):
            continue
        found = free_range(joint, bodies)
        if found.lower > joint.lower + 1e-6 or found.upper < _needed(layout, joint, needs) - 1e-6:
            yield _blocked(joint, found)
    plan = FloorPlan(layout)
    floor = plan.floor()
    for island in plan.cut_off(floor):
        yield from _island(island)
    for handle, share in handle_room(layout, floor).items():
        if share < needs.handle_share:
            yield _no_room(handle, share)
    for name, ok in reachable(layout, plan, floor).items():
        if not ok:
            yield Fault(kind="out of reach", text=name)


def _open(
    joint: Joint,
    limit: float,
    step: float,
    near: list[tuple[Placed, Placed]],
    allowed_m: list[float],
) -> tuple[float, str | None]:
    """Opens a joint towards one limit; returns how far it came, and what stopped it.

    Args:
        joint: The joint.
        limit: Where to stop at the latest [m or rad].
        step: Between places that are looked at [m or rad].
        near: Bodies of the joint, each with another that it may meet.
        allowed_m: How deep each of these pairs may overlap.
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


def _needed(layout: Layout, joint: Joint, needs: Needs) -> float:
    fridge = _template(layout, joint) in FRIDGES and joint.name == FRIDGE_HINGE
    return min(joint.upper, needs.fridge_rad) if fridge else joint.upper


def _template(layout: Layout, joint: Joint) -> str:
    return next(a.template for a in layout.spec.articulations if a.name == joint.piece)


def _pair(first: Placed, second: Placed) -> frozenset[str]:
    return frozenset((first.name, second.name))


def _key(joint: Joint) -> tuple[str, str]:
    return joint.piece, joint.name


def _overlap(first: Placed, second: Placed, depth: float) -> Fault:
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


def _no_room(handle: str, share: float) -> Fault:
    return Fault(
        kind="no room at a handle",
        text=f"{handle}: {share:.0%} of the floor before it is free",
    )


def _shown(name: str) -> str:
    return STAGE if name.startswith(f"{STAGE}/") else name
