"""Objects at rest and out of reach cost nothing: they are frozen until the robot comes near.

A frozen (kinematic) body in contact with furniture makes no contacts and takes no solver time, so
a step costs the same with ten and with a hundred objects around. Before anything can touch it, a
body near the robot or the held object becomes dynamic again; once it sleeps, out of reach, it is
frozen again. CPU simulation only; on the GPU a body cannot change its kind while running.
"""

from __future__ import annotations

import numpy as np
from mani_skill.utils.structs import Actor, Link
from numpy.typing import NDArray

WAKE_DISTANCE_M = 0.35
"""Free space left between a frozen body and the robot; the arm covers some 5 cm in a step."""

LINK_RADIUS_M = 0.15
_WATCHED = ("gripper_link", "forearm_roll_link", "elbow_flex_link", "base_link")
_BASE_RADIUS_M = 0.45


class DormantObjects:
    """Freezes and wakes the loose objects of one simulated scene (row 0).

    Attributes:
        com_m: (K, 3) centres of mass in the world, current after `refresh`.
        present: (K,) whether the object takes part in the episode.
    """

    def __init__(self, objects: list[Actor], links: dict[str, Link]) -> None:
        self._bodies = [actor._bodies[0] for actor in objects]
        self._com = [body.cmass_local_pose for body in self._bodies]
        self._watched = [links[name]._objs[0] for name in _WATCHED]
        self._reach_m = np.array(
            [_BASE_RADIUS_M if n == "base_link" else LINK_RADIUS_M for n in _WATCHED]
        )
        count = len(objects)
        self._radius_m = np.array([_radius_m(body) for body in self._bodies]).reshape(count)
        self._active: list[int] = []
        self.com_m: NDArray[np.float32] = np.zeros((count, 3), dtype=np.float32)
        self.present = np.zeros(count, dtype=bool)

    def thaw_all(self) -> None:
        """Makes every body dynamic, for a reset."""
        for body in self._bodies:
            if body.kinematic:
                body.kinematic = False
        self._active = list(range(len(self._bodies)))

    def freeze_all(self, present: NDArray[np.bool_]) -> None:
        """Freezes every body where it is; `present` (K,) marks those of this episode."""
        self.present = present.copy()
        for index, body in enumerate(self._bodies):
            self._read(index)
            body.kinematic = True
        self._active = []

    def wake(self, index: int) -> None:
        """Makes one body dynamic now."""
        if index not in self._active:
            self._bodies[index].kinematic = False
            self._active.append(index)

    def before_step(self, held: int) -> None:
        """Wakes what the robot or the held object could touch in the coming action."""
        if not len(self._bodies):
            return
        points = np.array([link.entity_pose.p for link in self._watched])
        reach_m = self._reach_m
        if held >= 0:
            self._read(held)
            points = np.vstack((points, self.com_m[held]))
            reach_m = np.append(reach_m, self._radius_m[held])
        gap = self.com_m[:, None] - points
        near = np.einsum("kpi,kpi->kp", gap, gap) < (
            (self._radius_m[:, None] + reach_m + WAKE_DISTANCE_M) ** 2
        )
        near = near.any(axis=1) & self.present
        for index in np.flatnonzero(near).tolist():
            self.wake(index)
        for index in self._active[:]:
            if not near[index] and index != held and self._bodies[index].is_sleeping:
                self._bodies[index].kinematic = True
                self._active.remove(index)

    def refresh(self) -> None:
        """Reads the centres of mass of the bodies that can have moved."""
        for index in self._active:
            self._read(index)

    def _read(self, index: int) -> None:
        self.com_m[index] = (self._bodies[index].entity_pose * self._com[index]).p


def _radius_m(body) -> float:  # noqa: ANN001  (a SAPIEN component)
    low, high = body.compute_global_aabb_tight()
    return float(np.linalg.norm(np.asarray(high) - np.asarray(low)) / 2)
