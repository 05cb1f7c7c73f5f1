"""Object and goal positions, as given by the task's observation (S App. D, SPA)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hab_spa.shapes import Array, within_body
from hab_tasks.privileged import ArticulationState, PrivilegedState


class KnownPositions:
    """Believed positions of the objects: start positions, updated when the robot moves objects.

    Attributes:
        goals_m: (K, 3) goal positions in the world.
        let_go: Numbers of the objects that the robot has moved and released.
    """

    def __init__(self, starts_m: Array, goals_m: Array, state: PrivilegedState | None) -> None:
        """Takes world positions (K, 3); objects in a drawer will move with it.

        Args:
            starts_m: Start positions.
            goals_m: Goal positions.
            state: State of doors and drawers, if observed.
        """
        self._at_m, self.goals_m = starts_m.copy(), goals_m
        self.let_go: set[int] = set()
        self._drawers: dict[int, ArticulationState] = {}
        if state is None:
            return
        for articulation in state.articulations:
            if articulation.slides:
                body = next(body for body in state.bodies if body.name == articulation.body)
                lies = within_body(body, state.world_from_body[articulation.body], starts_m)
                self._drawers |= {int(number): articulation for number in np.flatnonzero(lies)}

    @classmethod
    def read(
        cls,
        obs: Mapping[str, Any],
        row: int,
        world_from_base: Array,
        world_from_ee: Array,
        state: PrivilegedState | None,
    ) -> KnownPositions:
        """Reads the first observation of an episode; the poses (4, 4) are the robot's."""
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
        if not len(starts_m):  # in Place, the object is in the hand
            starts_m = np.repeat(hand_m[None], len(goals_m), axis=0)
        return cls(starts_m, goals_m, state)

    def object_m(self, number: int, state: PrivilegedState | None) -> Array:
        """Returns the believed position (3,) of an object, which moves with its drawer."""
        if number not in self._drawers or state is None:
            return self._at_m[number]
        before = self._drawers[number]
        now = next(
            articulation for articulation in state.articulations if articulation.body == before.body
        )
        return self._at_m[number] + before.moved(now.joint)[:3, 3]

    def lies_at(self, number: int, place_m: Array) -> None:
        """Sets the position (3,) of an object that was released."""
        self._at_m[number] = place_m
        self.let_go.add(number)
        self._drawers.pop(number, None)
