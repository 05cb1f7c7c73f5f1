"""Contacts between the hand and the door or drawer whose handle it holds.

The snap grasp takes a handle from 0.15 m off and draws it into the hand. Hand and furniture would
then overlap and push each other apart with hundreds of newtons. As a held object does not collide
with the robot, a held door or drawer does not collide with the hand, until it is released and its
handle out of the hand's reach. The rest of the arm always collides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from hab_tasks.constants import GRASP_RADIUS_M
from hab_tasks.world.scenes.collision_groups import FRONT, HELD_FRONT, set_groups


class HandlePassage:
    """The links that the hand passes through."""

    def __init__(self, links: Sequence[Any], gap_m: Callable[[int], float]) -> None:
        """Creates the passage.

        Args:
            links: The link's body of each handle.
            gap_m: Returns the distance of a handle, by its index, to the hand [m].
        """
        self._links, self._gap_m = links, gap_m
        self._open: set[int] = set()

    def open(self, index: int) -> None:
        """Lets the hand pass the link of handle `index`."""
        self._open.add(index)
        set_groups(self._links[index], HELD_FRONT)

    def close_behind(self, held: int) -> None:
        """Restores the contacts with all links but the held one's that the hand has left."""
        for index in sorted(self._open):
            if index != held and self._gap_m(index) > GRASP_RADIUS_M:
                self._close(index)

    def close(self) -> None:
        """Restores all contacts."""
        for index in sorted(self._open):
            self._close(index)

    def _close(self, index: int) -> None:
        self._open.discard(index)
        set_groups(self._links[index], FRONT)

    def state(self) -> Tensor:
        """Returns which links the hand passes through, (1, H) bool."""
        return torch.tensor([[index in self._open for index in range(len(self._links))]])

    @property
    def is_open(self) -> bool:
        """Whether the hand passes through any link."""
        return bool(self._open)
