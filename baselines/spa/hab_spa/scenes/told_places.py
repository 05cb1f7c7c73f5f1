"""Where the objects of an episode are and are to be, as the task tells it (S App. D, SPA)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hab_spa.shapes import Array, within_body
from hab_tasks.privileged import FrontState, PrivilegedState


class ToldPlaces:
    """Where objects started, and where they are since the robot has moved them.

    Attributes:
        goals_m: (K, 3) where they are to be, in the world.
    """

    def __init__(self, starts_m: Array, goals_m: Array, state: PrivilegedState | None) -> None:
        """Takes places (K, 3) in the world; what lies in a drawer will move with it.

        Args:
            starts_m: Where objects are.
            goals_m: Where they are to be.
            state: The doors and drawers, where these are told.
        """
        self._at_m, self.goals_m = starts_m.copy(), goals_m
        self._drawers: dict[int, FrontState] = {}
        if state is None:
            return
        for front in state.fronts:
            if front.slides:
                body = next(body for body in state.bodies if body.name == front.body)
                lies = within_body(body, state.world_from_body[front.body], starts_m)
                self._drawers |= {int(number): front for number in np.flatnonzero(lies)}

    @classmethod
    def read(
        cls,
        obs: Mapping[str, Any],
        row: int,
        world_from_base: Array,
        world_from_ee: Array,
        state: PrivilegedState | None,
    ) -> ToldPlaces:
        """Reads them from the first observation of an episode; poses (4, 4) are the robot's."""
        extra = {key: np.asarray(v[row], dtype=float) for key, v in obs["extra"].items()}
        starts_m, goals_m = np.zeros((0, 3)), np.zeros((0, 3))
        if "targets_in_base" in extra:
            pairs_m = extra["targets_in_base"].reshape(-1, 2, 3)
            floor_m = np.append(world_from_base[:2, 3], 0.0)
            places_m = pairs_m @ world_from_base[:3, :3].T + floor_m
            starts_m, goals_m = places_m[:, 0], places_m[:, 1]
        hand_m = world_from_ee[:3, 3]
        for name, is_start in (("object_start_from_ee", True), ("object_goal_from_ee", False)):
            if name in extra:
                place_m = (hand_m + world_from_base[:3, :3] @ extra[name])[None]
                starts_m, goals_m = (place_m, goals_m) if is_start else (starts_m, place_m)
        if not len(starts_m):  # in Place the object is in the hand, wherever it was
            starts_m = np.repeat(hand_m[None], len(goals_m), axis=0)
        return cls(starts_m, goals_m, state)

    def object_m(self, number: int, state: PrivilegedState | None) -> Array:
        """Returns where an object (3,) is believed to be, with its drawer where it is now."""
        if number not in self._drawers or state is None:
            return self._at_m[number]
        before = self._drawers[number]
        now = next(front for front in state.fronts if front.body == before.body)
        return self._at_m[number] + before.moved(now.joint)[:3, 3]

    def lies_at(self, number: int, place_m: Array) -> None:
        """Is told that an object was let go at a place (3,)."""
        self._at_m[number] = place_m
        self._drawers.pop(number, None)
