"""Scene interface of the skills; implemented by `TrueScene` and `SeenScene` (S App. D)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from hab_plans.belief import Scene as Beliefs

from hab_spa.planning.collision import ArmCollision
from hab_spa.shapes import Array
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.navigation import NavigationMap


class Scene(Beliefs, Protocol):
    """The robot's model of the world at the current step."""

    @property
    def robot(self) -> RobotSpec:
        """Specification of the robot."""
        ...

    def forget(self) -> None:
        """Starts a new episode."""
        ...

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Processes the observation of one row of a batch; called at every step."""
        ...

    @property
    def arm_qpos(self) -> Array:
        """Joint positions of the arm (J,) [rad]."""
        ...

    @property
    def world_from_base(self) -> Array:
        """(4, 4) pose of the base frame."""
        ...

    def grasp_points_m(self, number: int, *, around: bool = False) -> Array:
        """Returns world points (P, 3) at which the hand can grasp an object.

        They are a few at its faces or, with `around`, many on spheres up to the grasp radius.
        """
        ...

    def ee_from_held(self) -> Array:
        """Returns the held object's reference point (3,) in the end-effector's frame."""
        ...

    def collision(
        self, *, base: Array | None = None, without: str | None = None, reach_m: float | None = None
    ) -> ArmCollision:
        """Returns the collision model of the arm and the held object.

        Args:
            base: Hypothetical base pose (3,); None for the current one.
            without: Name of a body to leave out.
            reach_m: Maximum distance of shapes from the shoulder; None for the default.
        """
        ...

    def in_the_way(self, path: Array) -> bool:
        """Returns whether an obstacle seen since the path was planned blocks it.

        Called at every step.

        Args:
            path: Remaining arm poses (K, J).
        """
        ...

    def taking(self, number: int, world_from_ee: Array) -> ArmCollision | None:
        """Returns the collision model with an object grasped at an end-effector pose (4, 4).

        It is None if the robot cannot predict what it will hold.
        """
        ...

    def met(self, path: Array) -> None:
        """Reports contact of the arm with an obstacle on its next poses (K, J)."""
        ...

    def floor_map(self, joints: Mapping[int, float] | None = None) -> NavigationMap:
        """Returns the current floor map, without the robot and the held object.

        Args:
            joints: Hypothetical joint positions [rad or m], by number of the door or drawer.
        """
        ...
