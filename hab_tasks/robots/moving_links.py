"""Moving doors and drawers, and the space they occupy."""

from __future__ import annotations

import numpy as np
from mani_skill.utils.structs import Articulation
from numpy.typing import NDArray

from hab_tasks.simulator import sapien_object

MOVED = 1e-4
"""Joint displacement [m or rad] since the last check from which a joint counts as moved."""


class MovingLinks:
    """Tracks the joints of all furniture in one scene."""

    def __init__(self, furniture: list[Articulation]) -> None:
        self._furniture = [sapien_object(piece) for piece in furniture]
        self._links = [
            sapien_object(link)
            for piece in furniture
            for link in sorted(
                (link for link in piece.links if _is_moved(link)),
                key=lambda link: int(link.joint.active_index[0]),  # type: ignore[union-attr]
            )
        ]
        self._seen: NDArray[np.float32] = self._joints()

    def look_again(self) -> None:
        """Takes the current joint positions as the reference."""
        self._seen = self._joints()

    def boxes_m(self) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Returns lower and upper corner (3,) of every link that moved since the last check."""
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
