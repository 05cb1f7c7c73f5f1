"""Doors and drawers: when they count as open and as closed (S H.2; design decision for drawers).

Skills, tasks and planning predicates ask these same functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from hab_tasks.arrays import Rows

FRIDGE_OPEN_RAD = math.pi / 2
FRIDGE_CLOSED_RAD = 0.15
DRAWER_OPEN_SHARE = 0.9
DRAWER_CLOSED_M = 0.05


@dataclass(frozen=True, kw_only=True)
class FrontKind:
    """A kind of door or drawer.

    Attributes:
        name: ``fridge`` or ``drawer``.
        marker: The handle marker of the one that tasks use.
        open_at: It is open beyond this position [m or rad]; None where `open_share` decides.
        open_share: It is open from this share of its travel.
        closed_at: It is closed up to this position [m or rad].
    """

    name: str
    marker: str
    open_at: float | None
    open_share: float
    closed_at: float

    def is_open(self, joint: Rows, share: Rows) -> Rows:
        """Whether joints (...) [m or rad], at these shares of their travel, are open."""
        return share >= self.open_share if self.open_at is None else joint > self.open_at

    def is_closed(self, joint: Rows) -> Rows:
        """Whether joints (...) [m or rad] are closed."""
        return joint <= self.closed_at


FRIDGE = FrontKind(
    name="fridge",
    marker="fridge_push_point",
    open_at=FRIDGE_OPEN_RAD,
    open_share=1.0,
    closed_at=FRIDGE_CLOSED_RAD,
)
DRAWER = FrontKind(
    name="drawer",
    marker="cab_push_point_5",
    open_at=None,
    open_share=DRAWER_OPEN_SHARE,
    closed_at=DRAWER_CLOSED_M,
)
