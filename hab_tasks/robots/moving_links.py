"""Doors and drawers that are on the move, and the room they take."""

from __future__ import annotations

import numpy as np
from mani_skill.utils.structs import Articulation
from numpy.typing import NDArray

MOVED = 1e-4
"""A joint that has changed by less [m or rad] since the last look stands still."""


class MovingLinks:
    """Watches the joints of all furniture of one simulated scene (row 0)."""

    def __init__(self, furniture: list[Articulation]) -> None:
        self._furniture = [piece._objs[0] for piece in furniture]
        self._links = [
            link._objs[0]
            for piece in furniture
            for link in sorted(
                (link for link in piece.links if _is_moved(link)),
                key=lambda link: int(link.joint.active_index[0]),  # type: ignore[union-attr]
            )
        ]
        self._seen: NDArray[np.float32] = self._joints()

    def look_again(self) -> None:
        """Takes the joints as they are for the state of rest."""
        self._seen = self._joints()

    def boxes_m(self) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Returns lower and upper corner (3,) of every link that moved since the last look."""
        joints = self._joints()
        moved = np.abs(joints - self._seen) > MOVED
        if not moved.any():
            return []
        self._seen = joints
        links = [self._links[index] for index in np.flatnonzero(moved).tolist()]
        return [(low, high) for low, high in (link.compute_global_aabb_tight() for link in links)]

    def _joints(self) -> NDArray[np.float32]:
        parts = [piece.qpos for piece in self._furniture]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=np.float32)


def _is_moved(link: object) -> bool:
    joint = getattr(link, "joint", None)
    return joint is not None and joint.active_index is not None and len(joint.active_index) > 0
