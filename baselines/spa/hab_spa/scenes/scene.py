"""What a skill may ask about the world; `TrueScene` and the seen one answer (S App. D)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from hab_spa.planning.collision import ArmCollision
from hab_spa.shapes import Array
from hab_tasks.navigation import NavigationMap
from hab_tasks.privileged import FrontState


class Scene(Protocol):
    """The world as the robot knows it at this step."""

    def forget(self) -> None:
        """Starts a new episode."""
        ...

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Takes in the observation of one row of a batch; called at every step."""
        ...

    @property
    def arm_qpos(self) -> Array:
        """The arm (7,) [rad]."""
        ...

    @property
    def world_from_base(self) -> Array:
        """(4, 4) pose of Fetch's base_link."""
        ...

    @property
    def holding(self) -> bool:
        """Whether an object is in the hand."""
        ...

    def holds(self, number: int) -> bool:
        """Whether the hand holds this object of the episode, as far as the robot knows."""
        ...

    def object_m(self, number: int) -> Array:
        """Returns where the centre of mass (3,) of an object is, as far as the robot knows."""
        ...

    def goal_m(self, number: int) -> Array:
        """Returns where it is to be (3,)."""
        ...

    def grasp_points_m(self, number: int, *, around: bool = False) -> Array:
        """Returns points (P, 3) in the world at which the hand would take an object.

        These are a few at its faces, or many `around` it, some as far away as it can be taken.
        """
        ...

    def ee_from_held(self) -> Array:
        """Returns the point (3,) in the end-effector's frame that is to come to the goal."""
        ...

    def front(self, number: int) -> FrontState:
        """Returns a door or drawer of the episode."""
        ...

    def collision(
        self,
        *,
        base: Array | None = None,
        without: str | None = None,
        reach_m: float | None = None,
    ) -> ArmCollision:
        """Returns the collision model of the arm and of what it holds.

        Args:
            base: A base pose (3,) where the robot is thought to stand; None for where it is.
            without: Name of a body that is left out.
            reach_m: Shapes farther than this from the shoulder are left out; None: as usual.
        """
        ...

    def in_the_way(self, path: Array) -> bool:
        """Returns whether something was seen in the way of the arm since it set out on a path.

        Asked at every step.

        Args:
            path: The arm poses (K, 7) that are left of it.
        """
        ...

    def taking(self, number: int, world_from_ee: Array) -> ArmCollision | None:
        """Returns the collision model as if the hand, at a pose (4, 4), had taken an object.

        It is None where the robot does not know what it will hold.
        """
        ...

    def met(self, path: Array) -> None:
        """Is told that the arm met with something where it was about to go, (K, 7)."""
        ...

    def floor_map(self) -> NavigationMap:
        """Returns the floor with everything as it stands now, but for robot and held object."""
        ...
