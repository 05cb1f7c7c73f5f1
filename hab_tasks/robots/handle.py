"""Handles of doors and drawers: spring to the hand, and contacts with it while held."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.utils.structs import Articulation, Link
from numpy.typing import NDArray
from torch import Tensor

from hab_tasks.constants import CONTROL_HZ, EE_STEP_M, GRASP_RADIUS_M
from hab_tasks.simulator import sapien_object
from hab_tasks.world.scenes.physics import FRONT, HELD_FRONT, set_groups


@dataclass(frozen=True, kw_only=True)
class Handle:
    """A handle marker on a built piece of furniture."""

    name: str
    furniture_name: str
    furniture: Articulation
    link: Link
    offset_m: tuple[float, float, float]

    @cached_property
    def body(self) -> Any:
        """SAPIEN's link."""
        return sapien_object(self.link)

    @cached_property
    def column(self) -> int:
        """Index of the handle's joint in the furniture's active joints."""
        joint: Any = self.link.joint
        return int(joint.active_index[0])

    @cached_property
    def body_from_handle(self) -> sapien.Pose:
        """Its pose in the link's frame."""
        return sapien.Pose(list(self.offset_m))

    def pose(self) -> sapien.Pose:
        """Returns its current pose in the world, with the axes of the link."""
        return self.body.entity_pose * self.body_from_handle

    def joint(self) -> float:
        """Returns its joint's current position [m or rad]."""
        return float(sapien_object(self.furniture).qpos[self.column])

    @property
    def limits(self) -> tuple[float, float]:
        """Limits of the handle's joint [m or rad]."""
        lower, upper = sapien_object(self.furniture).active_joints[self.column].limits[0].tolist()
        return lower, upper


@dataclass(frozen=True, kw_only=True)
class HandleSpring:
    """Parameters of the spring.

    Attributes:
        stiffness_n_m, damping_n_s_m: Stiffness and damping per axis.
        force_n: Maximum force per axis; about the load capacity of Fetch's arm at half reach.
        draw_in_m: Step per action by which a handle grasped at a distance is drawn in; equal to
            the hand's maximum step.
        reach_m: Distance to the hand from which a handle counts as out of reach.
        lost_steps: Number of actions out of reach after which it is lost: half a second.
    """

    stiffness_n_m: float = 3000.0
    damping_n_s_m: float = 150.0
    force_n: float = 200.0
    draw_in_m: float = EE_STEP_M
    reach_m: float = GRASP_RADIUS_M
    lost_steps: int = CONTROL_HZ // 2

    def drawn_in(self, place_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns the handle's target position (3,) in the hand one action later."""
        distance_m = float(np.linalg.norm(place_m))
        if distance_m <= self.draw_in_m:
            return np.zeros(3, dtype=np.float32)
        return (place_m * (1.0 - self.draw_in_m / distance_m)).astype(np.float32)


HANDLE_SPRING = HandleSpring()


class HandlePassage:
    """The links that the hand passes through."""

    def __init__(self, links: Sequence[Any], gap_m: Callable[[int], float]) -> None:
        """Takes the link of each handle, and a function from its index to its distance [m]."""
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
