"""Handle markers: points on doors and drawers that the gripper can snap to.

Templates that tasks do not distinguish, such as the fridges with hinges on either side, have
markers of the same names; a layout has one of them. Names and offsets are Habitat's where
available (its four drawers and the fridge); the other drawers follow the same rule. Offsets are in
the link's frame, before the furniture's scale.
"""

from __future__ import annotations

from dataclasses import dataclass

from hab_tasks.articulations import ARTICULATION_KINDS, ArticulationKind
from hab_tasks.world.scenes.spec import Vector


@dataclass(frozen=True, kw_only=True)
class HandleMarker:
    """A point fixed to a link of one furniture template."""

    name: str
    template: str
    link: str
    offset_m: Vector


FRIDGES = ("fridge", "fridge_mirrored")
"""Templates of fridges: ReplicaCAD's, and the apartment's with its hinges on the other side."""

_DRAWER_HANDLE_M = (0.3, 0.0, 0.0)


def _drawer(number: int, link: str) -> HandleMarker:
    return HandleMarker(
        name=f"cab_push_point_{number}",
        template="kitchen_counter",
        link=link,
        offset_m=_DRAWER_HANDLE_M,
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
        name="fridge_push_point", template="fridge", link="top_door", offset_m=(0.10, -0.62, 0.2)
    ),
    HandleMarker(
        name="fridge_push_point",
        template="fridge_mirrored",
        link="top_door",
        offset_m=(0.10, 0.62, 0.2),
    ),
]


def add_kind(kind: ArticulationKind, *markers: HandleMarker) -> None:
    """Adds a kind of door or drawer with its handles, for a skill of another package.

    Tasks use the handle `kind.marker`; there is one marker for each furniture template.
    """
    ARTICULATION_KINDS[kind.name] = kind
    HANDLE_MARKERS.extend(marker for marker in markers if marker not in HANDLE_MARKERS)
