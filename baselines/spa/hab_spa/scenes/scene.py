"""Scene interface of the skills, implemented by `TrueScene` and `SeenScene` (S App. D).

Object and goal positions are `KnownPositions` if the task's observation gives them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
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

    def drives_into(self, bases: Array) -> bool:
        """Returns whether an obstacle seen since the last plan is where the robot drives.

        Called at every step.

        Args:
            bases: Next base poses (K, 3).
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

    def missed(self) -> None:
        """Takes note that the hand has closed where a handle is believed, and holds nothing."""
        ...

    def floor_map(self, joints: Mapping[int, float] | None = None) -> NavigationMap:
        """Returns the current floor map, without the robot and the held object.

        Args:
            joints: Hypothetical joint positions [rad or m], by number of the door or drawer.
        """
        ...


class KnownPositions:
    """Positions as given by the task's observation, updated when the robot moves objects.

    Attributes:
        objects_m: (K, 3) believed positions of the objects in the world.
        goals_m: (K, 3) goal positions in the world.
        let_go: Numbers of the objects that the robot has moved and released.
    """

    def __init__(self, starts_m: Array, goals_m: Array) -> None:
        """Takes world positions (K, 3)."""
        self.objects_m, self.goals_m = starts_m.copy(), goals_m
        self.let_go: set[int] = set()

    @classmethod
    def read(
        cls,
        obs: Mapping[str, Any],
        row: int,
        world_from_base: Array,
        world_from_ee: Array,
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
        return cls(starts_m, goals_m)

    def lies_at(self, number: int, place_m: Array) -> None:
        """Sets the position (3,) of an object that was released."""
        self.objects_m[number] = place_m
        self.let_go.add(number)
