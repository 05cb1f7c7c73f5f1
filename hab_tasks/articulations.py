"""Doors and drawers: open and closed thresholds (S H.2; design decision for drawers), handles.

Skills, tasks and planning predicates share these functions.

Handle markers are points that the gripper can snap to. Templates that tasks do not distinguish,
such as the fridges with hinges on either side, have markers of the same names; a layout has one of
them. Names and offsets are Habitat's where available (its four drawers and the fridge); the other
drawers follow the same rule. Offsets are in the link's frame, before the furniture's scale.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from hab_tasks.arrays import Bools, Floats

FRIDGE_OPEN_RAD = math.pi / 2
FRIDGE_CLOSED_RAD = 0.15
DRAWER_OPEN_SHARE = 0.9
DRAWER_CLOSED_M = 0.05


@dataclass(frozen=True, kw_only=True)
class Rectangle:
    """A floor region in a furniture frame: x ahead of the furniture, y to its side [m]."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]

    def contains(self, x_m: float, y_m: float) -> bool:
        """Whether a point in the frame is inside."""
        return self.x_m[0] <= x_m <= self.x_m[1] and self.y_m[0] <= y_m <= self.y_m[1]


@dataclass(frozen=True, kw_only=True)
class ArticulationKind:
    """A kind of door or drawer.

    Attributes:
        name: ``fridge`` or ``drawer``.
        marker: Handle marker of the instance that tasks use.
        open_at: Open beyond this joint position [m or rad]; None where `open_share` applies.
        open_share: Open from this share of its travel.
        closed_at: Closed up to this joint position [m or rad].
        opening_region: Start region of the base in episodes of its open skill (S H.2), in the
            frame of the fridge, or of the drawer's link at its position at the start.
        closing_region: The same of its close skill.
        pulled_m: A hand that has pulled the handle at least so far has opened it.
    """

    name: str
    marker: str
    open_at: float | None
    open_share: float
    closed_at: float
    opening_region: Rectangle
    closing_region: Rectangle
    pulled_m: float = 0.0

    def is_open(self, joint: Floats, share: Floats) -> Bools:
        """Whether joints (...) [m or rad] at shares (...) of their travel are open."""
        return share >= self.open_share if self.open_at is None else joint > self.open_at

    def is_closed(self, joint: Floats) -> Bools:
        """Whether joints (...) [m or rad] are closed."""
        return joint <= self.closed_at


_FRIDGE_REGION = Rectangle(x_m=(0.933, 1.833), y_m=(-0.6, 0.6))
"""0.9 m x 1.2 m; the distance from the fridge is M3's."""

FRIDGE = ArticulationKind(
    name="fridge",
    marker="fridge_push_point",
    open_at=FRIDGE_OPEN_RAD,
    open_share=1.0,
    closed_at=FRIDGE_CLOSED_RAD,
    opening_region=_FRIDGE_REGION,
    closing_region=_FRIDGE_REGION,
    pulled_m=0.6,
)
DRAWER = ArticulationKind(
    name="drawer",
    marker="cab_push_point_5",
    open_at=None,
    open_share=DRAWER_OPEN_SHARE,
    closed_at=DRAWER_CLOSED_M,
    # 0.15 m x 0.75 m. The handle is 0.3 m ahead of the link: opening starts 0.80 to 0.95 m before
    # it, Habitat's distance, and closing 0.50 to 0.65 m, from where the closed handle is in reach.
    opening_region=Rectangle(x_m=(1.10, 1.25), y_m=(-0.375, 0.375)),
    closing_region=Rectangle(x_m=(0.80, 0.95), y_m=(-0.375, 0.375)),
    pulled_m=0.25,
)
ARTICULATION_KINDS = {kind.name: kind for kind in (FRIDGE, DRAWER)}
"""Name -> kind."""


@dataclass(frozen=True, kw_only=True)
class HandleMarker:
    """A point fixed to a link of one furniture template.

    Attributes:
        bar_m: Length of the bar that a handle has for a grasp by friction, along the link's z axis.
    """

    name: str
    template: str
    link: str
    offset_m: tuple[float, float, float]
    bar_m: float = 0.32


FRIDGES = ("fridge", "fridge_mirrored")
"""Templates of fridges: ReplicaCAD's, and the apartment's with its hinges on the other side."""


def _drawer(number: int, link: str) -> HandleMarker:
    return HandleMarker(
        name=f"cab_push_point_{number}",
        template="kitchen_counter",
        link=link,
        offset_m=(0.3, 0.0, 0.0),
    )


HANDLE_MARKERS = [
    _drawer(7, "drawer1_top"),
    _drawer(6, "drawer2_top"),
    _drawer(5, "drawer3"),
    _drawer(4, "drawer4"),
    _drawer(3, "drawer1_bottom"),
    _drawer(2, "drawer2_middle"),
    _drawer(1, "drawer2_bottom"),
    HandleMarker(
        name="fridge_push_point",
        template="fridge",
        link="top_door",
        offset_m=(0.10, -0.62, 0.2),
        bar_m=0.52,
    ),
    HandleMarker(
        name="fridge_push_point",
        template="fridge_mirrored",
        link="top_door",
        offset_m=(0.10, 0.62, 0.2),
        bar_m=0.52,
    ),
]


def add_kind(kind: ArticulationKind, *markers: HandleMarker) -> None:
    """Adds a kind of door or drawer with its handles, for a skill of another package.

    Tasks use the handle `kind.marker`; there is one marker for each furniture template.
    """
    ARTICULATION_KINDS[kind.name] = kind
    HANDLE_MARKERS.extend(marker for marker in markers if marker not in HANDLE_MARKERS)
