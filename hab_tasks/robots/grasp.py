"""What a robot holds: the interface of the snap grasp and of the grasp by friction."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import numpy as np
from mani_skill.utils.structs import Actor
from torch import Tensor

from hab_tasks.arrays import Bools, Floats
from hab_tasks.robots.handle import Handle
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.simulator import rigid_body, sapien_object

NOTHING = -1


class Grasp(ABC):
    """What one robot holds, and the rules of grasping and releasing.

    Attributes:
        objects: All graspable objects, in a fixed order.
        handles: Handle markers.
        held: Index into `objects`, `NOTHING` without one.
        held_handle: Index into `handles`, `NOTHING` without one.
        lost: Whether the held object or handle slipped away since the last command.
        is_enclosed: Returns which objects (K,) are in closed containers; None if none is.
        known_com_m: (K, 3) centres of mass kept current by the caller; None to read each.
    """

    def __init__(
        self, agent: MobileManipulator, objects: list[Actor], handles: list[Handle]
    ) -> None:
        """Holds nothing yet."""
        self.objects, self.handles = objects, handles
        self.is_enclosed: Callable[[], Bools | None] = lambda: None
        self.known_com_m: Floats | None = None
        self.held, self.held_handle, self.lost = NOTHING, NOTHING, False
        self._bodies = [(rigid_body(a), rigid_body(a).cmass_local_pose) for a in objects]
        self._hand, self._link_from_ee = sapien_object(agent.ee_link), agent.link_from_ee

    @property
    def holding(self) -> bool:
        """Whether an object or a handle is held."""
        return self.held != NOTHING or self.held_handle != NOTHING

    def ee_position_m(self) -> Floats:
        """Returns the end-effector point (3,) in the world."""
        return (self._hand.entity_pose * self._link_from_ee).p

    def objects_com_m(self) -> Floats:
        """Returns every object's centre of mass (K, 3) in the world."""
        if self.known_com_m is not None:
            return self.known_com_m
        points = [(body.entity_pose * com).p for body, com in self._bodies]
        return np.array(points, dtype=np.float32).reshape(-1, 3)

    @abstractmethod
    def reset(self) -> None:
        """Releases without physics, and restores all contacts."""

    @abstractmethod
    def command(self, gripper: float) -> None:
        """Executes the gripper action: >= 0 grasps, < 0 releases."""

    @abstractmethod
    def attach(self, index: int) -> None:
        """Grasps object `index` where it is, at the start of an episode."""

    def carry(self) -> None:  # noqa: B027  # only what is tied to the hand has to be moved
        """Moves what is held after joint states were set, before the next physics step."""

    def before_physics_step(self) -> None:  # noqa: B027
        """Moves the furniture of a held handle to a hand whose state was set."""

    @abstractmethod
    def after_control_step(self) -> None:
        """Notices what was pulled out of the hand, after the physics of an action."""

    @abstractmethod
    def get_state(self) -> dict[str, Tensor]:
        """Returns the state by name, (1, ...) each; `held` and `held_handle` (1,) among them."""

    @abstractmethod
    def set_state(self, state: Mapping[str, Tensor]) -> None:
        """Restores a state of `get_state`, after the bodies' poses were restored."""

    def awake_in(self, state: Mapping[str, Tensor]) -> list[int]:
        """Returns the objects that have to be dynamic in a state of `get_state`."""
        held = int(state["held"][0])
        return [held] * (held != NOTHING)
