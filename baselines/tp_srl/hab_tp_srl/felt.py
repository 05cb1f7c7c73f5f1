"""What a robot without ground truth believes: what the task told, and what its hand has felt.

The task tells where each object starts and where it goes. The hand feels that it holds something,
and where it lets go of it; how far a handle moved while it was held; and a skill feels its own end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hab_plans.belief import Opening
from hab_plans.stage import Stage
from hab_spa.shapes import Array

from hab_tasks.articulations import ARTICULATION_KINDS

DROP_M, BESIDE_M = 0.3, 0.15
"""An object released up to so far above its goal, and so far beside it, falls to it (S H.2)."""

CLOSED_M = {"drawer": 0.06, "fridge": 0.12}
"""A handle that was moved back so near to its place is closed, as far as the hand feels."""


class FeltBeliefs:
    """Where the objects of an episode are, and which doors and drawers are open.

    Positions are in the resting frame of `TaskView`.

    Attributes:
        holding: Whether anything was in the hand when a change was last felt.
        held: Index of the object in the hand; None if it is empty or holds another one.
        places_m: (K, 3) where the objects are.
        openings: Whether each door and drawer is open.
        doubts: How often another object was picked in place of each.
        moved: (K,) whether an object is no longer where it started.
    """

    def __init__(self, starts_m: Array, goals_m: Array, openings: Sequence[Opening]) -> None:
        """Believes what the task tells.

        Args:
            starts_m: (K, 3) starts of the objects.
            goals_m: (K, 3) their goals.
            openings: Which doors and drawers are open at the start.
        """
        self.holding = False
        self.held: int | None = None
        self.places_m, self.moved = starts_m.copy(), np.zeros(len(starts_m), dtype=bool)
        self._goals_m, self.doubts = goals_m, [0] * len(starts_m)
        self._reaching: int | None = None
        self._held_m = np.zeros(3)
        self.openings = list(openings)

    def begin(self, stage: Stage) -> None:
        """Notes what a skill is about to pick."""
        self._reaching = stage.object if stage.skill == "pick" else None

    def feel(self, holding: bool, hand_m: Array) -> None:
        """Notes a change of what the hand feels: a grasp or a release.

        Args:
            holding: Whether anything is in the hand.
            hand_m: (3,) the hand.
        """
        self.holding = holding
        if holding and self.held is None and self._reaching is not None:
            # In the hand it keeps its place relative to it, as good as level.
            self.held, self._held_m = self._reaching, self.places_m[self._reaching] - hand_m
            self._reaching = None
        elif self.held is not None and not holding:
            self._let_go(self.held, hand_m + np.array((0.0, 0.0, self._held_m[2])))
            self.held = None

    def hold(self, held_m: Array) -> None:
        """Notes where the held object is, (3,) from the hand."""
        self._held_m = held_m

    def take_for_other(self) -> None:
        """Notes that what is held is not what was to be picked."""
        assert self.held is not None
        self.doubts[self.held] += 1
        self.held = None

    def end(self, stage: Stage, ended: bool, pulled_m: float | None) -> None:
        """Notes that a skill has ended.

        Args:
            stage: Its stage.
            ended: Whether by its own condition, not at its horizon.
            pulled_m: How far the hand has moved the handle since it was first closed; None if it
                has not held it now.
        """
        if stage.articulation is None:
            return
        verb, _, kind = stage.skill.partition("_")
        if pulled_m is not None and verb == "open":
            # Also if the arm has not come to rest beside it in time.
            ended = pulled_m >= ARTICULATION_KINDS[kind].pulled_m
        elif pulled_m is not None:
            ended = ended and pulled_m <= CLOSED_M[kind]
        done: Opening = "open" if verb == "open" else "closed"
        self.openings[stage.articulation] = done if ended else "ajar"

    def _let_go(self, number: int, place_m: Array) -> None:
        """Notes where an object was let go: it falls to its goal, or stays about there."""
        gap_m = place_m - self._goals_m[number]
        falls = np.hypot(gap_m[0], gap_m[1]) < BESIDE_M and -BESIDE_M < gap_m[2] < DROP_M
        if falls:
            place_m = np.append(place_m[:2], self._goals_m[number][2])
        self.places_m[number], self.moved[number] = place_m, True
