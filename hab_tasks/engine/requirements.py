"""Requirements of a skill or task on episodes and simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hab_tasks.articulations import ArticulationKind


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """Parts of an episode that a skill or task uses.

    Attributes:
        objects: Number of objects to rearrange.
        articulations: The doors and drawers whose state is used.
        names_articulation: Whether each episode names its door or drawer, as in skills; in tasks,
            the layout determines it.
        goals: Whether each object has a goal position.
        holds: Whether the first object starts in the grasp.
        names_navigation_goal: Whether each episode names a navigation goal.
        navigates: Whether geodesic distances of the base are measured.
        takes: What the hand snaps to: ``objects``, ``handles``, or ``any`` (objects first).
    """

    objects: int = 1
    articulations: tuple[ArticulationKind, ...] = ()
    names_articulation: bool = False
    goals: bool = False
    holds: bool = False
    names_navigation_goal: bool = False
    navigates: bool = False
    takes: Literal["objects", "handles", "any"] = "objects"
