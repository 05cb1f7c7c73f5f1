"""What the simulation has to read for a skill or a task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hab_tasks.fronts import FrontKind


@dataclass(frozen=True, kw_only=True)
class Needs:
    """What of an episode is asked about.

    Attributes:
        objects: How many objects are to be rearranged.
        fronts: The doors and drawers whose state counts. An episode of a skill names its own.
        goals: Whether each object has a goal.
        holds: Whether the first object starts in the grasp.
        leads: Whether the episode names where the base is to go.
        navigates: Whether ways of the base are measured.
        takes: What the hand snaps to: ``objects``, ``handles``, or ``any``, whatever is allowed
            to be nearest.
    """

    objects: int = 1
    fronts: tuple[FrontKind, ...] = ()
    goals: bool = False
    holds: bool = False
    leads: bool = False
    navigates: bool = False
    takes: Literal["objects", "handles", "any"] = "objects"
