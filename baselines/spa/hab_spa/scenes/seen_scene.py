"""Scene of SPA: a map from egocentric depth, and object positions from the task's observation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from hab_plans.belief import known_opening
from numpy.typing import NDArray

from hab_spa.planning.collision import ArmCollision, within
from hab_spa.planning.ik import BatchArm
from hab_spa.planning.joint_goal import sphere_m
from hab_spa.scenes.scene import KnownPositions
from hab_spa.scenes.seen_config import SeenConfig
from hab_spa.scenes.true_scene import standing_at
from hab_spa.sensing.cloud import DepthView, world_from_base
from hab_spa.sensing.fitted_box import (
    HELD,
    HELD_UP,
    FittedBox,
    HeldBox,
    fit_box,
    other_things_m,
)
from hab_spa.sensing.own_shapes import own_shapes
from hab_spa.sensing.seen_map import SeenMap
from hab_spa.sensing.voxels import voxel_obstacles
from hab_spa.shapes import Array, invert_pose, standing
from hab_tasks.constants import GRASP_RADIUS_M
from hab_tasks.privileged import ArticulationState, PrivilegedState
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.navigation import NavigationMap
from hab_tasks.world.scenes.floor import LOWEST_M

CAMERAS = ("head", "arm")

LEAST_VOXELS = 4
"""Fewer voxels are in no base's way: a pixel at the robot's edge is not always told from what is
behind it."""

HELD_HALF_M = 0.03
"""Maximum half size of the held object at the highest risk level."""

_GRID_M = np.stack(np.meshgrid(*[np.arange(-0.2, 0.2, 0.014)] * 3), axis=-1).reshape(-1, 3)
"""Points around the gripper where an obstacle that was felt may be."""


class SeenScene:
    """Scene from depth images and localization; see `hab_spa.scenes.scene.Scene`.

    Attributes:
        risk_level: Raised when planning fails. 0: unseen space is occupied; 1: it is free; 2:
            also, obstacles that were only felt are free, and the held object is small.
    """

    place_error_m = 0.0

    def __init__(self, robot: RobotSpec, config: SeenConfig | None = None) -> None:
        """Creates the scene of one row."""
        self.robot, self.config, self._own = robot, config or SeenConfig(), own_shapes(robot)
        self._arm = BatchArm(robot)
        self.forget()

    def forget(self) -> None:
        """Starts a new episode."""
        self.map = SeenMap(self.config.map)
        self._places: KnownPositions | None = None
        self._boxes: dict[int, FittedBox] = {}
        self._hand: HeldBox | None = None
        self._up: Array | None = None
        self._wanted: int | None = None
        self._held: int | None = None
        self._was_holding, self.risk_level = False, 0
        self._steps = 0

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Processes an observation, except for its images; see `look`."""
        self._obs, self._row = obs, row
        self._pose: Array | None = None
        self._looked = False
        self._arm_rad = np.asarray(obs["agent"]["arm_qpos"][row], dtype=float)
        holding = bool(obs["agent"]["is_holding"][row, 0] > 0.5)
        if self._places is None:
            self._places = KnownPositions.read(
                obs, row, self.world_from_base, self._world_from_ee()
            )
            self._held = 0 if holding else None
        elif holding and not self._was_holding:
            self._took()
        elif not holding:
            if self._held is not None:  # believed to be where it was released
                self._known.lies_at(self._held, self._world_from_ee()[:3, 3])
            self._held, self._hand, self._up = None, None, None
        self._was_holding = holding

    @property
    def arm_qpos(self) -> Array:
        """Joint positions of the arm (J,) [rad]."""
        return self._arm_rad

    @property
    def held_up(self) -> Array | None:
        """(3,) what was up before the grasp, in the end-effector frame; None if it is now."""
        told = self._obs["extra"].get(HELD_UP)
        return self._up if told is None else np.asarray(told[self._row], dtype=float)

    @property
    def world_from_base(self) -> Array:
        """(4, 4) pose of the base frame, from perfect localization."""
        if self._pose is None:
            self._pose = world_from_base(self.robot, self._obs, self._row)
        return self._pose

    @property
    def holding(self) -> bool:
        """Whether the hand holds an object."""
        return self._held is not None

    def holds(self, number: int) -> bool:
        """Whether the hand holds this object, assuming that it grasped the intended one."""
        return self._held == number

    def object_m(self, number: int) -> Array:
        """Returns the believed position (3,) of an object; see `KnownPositions`."""
        return self._known.objects_m[number]

    def goal_m(self, number: int) -> Array:
        """Returns its goal (3,)."""
        return self._known.goals_m[number]

    def was_let_go(self, number: int) -> bool:
        """Whether an object lies where the hand let it go."""
        return number in self._known.let_go

    def grasp_points_m(self, number: int, *, around: bool = False) -> Array:
        """Returns the points (P, 3) at which the hand can grasp an object.

        They are the face centres of its best-fit box, or points `around` its position. The next
        grasped object is believed to be this one.
        """
        self.look()
        config, self._wanted = self.config, number
        object_m = self.object_m(number)
        seen_m = self.map.points_m(
            object_m, config.fit_reach_m, config.fit_spacing_m, config.fit_slope
        )
        box = self._boxes[number] = fit_box(
            seen_m, object_m, self.world_from_base[:3, 3], config.box
        )
        points_m = box.upper_face_centres_m()
        if around:
            radii_m, sides = config.grasp.around_m, config.grasp.sides
            points_m = np.concatenate([sphere_m(object_m, r, sides) for r in radii_m])
        own_m = np.linalg.norm(points_m - object_m, axis=1)
        taken = own_m <= GRASP_RADIUS_M - config.grasp.reach_safety_m
        for other_m in other_things_m(seen_m, object_m, box, config.box):
            taken &= np.linalg.norm(points_m - other_m, axis=1) >= own_m + config.runner_up_m
        return points_m[taken]

    def stands(self, number: int) -> bool:
        """Whether the robot sees an object and its support."""
        self.grasp_points_m(number)
        box = self._boxes[number]
        return box.seen and box.support_m is not None

    def ee_from_held(self) -> Array:
        """Returns the middle (3,) of what is seen in the hand; its own position if nothing is."""
        return np.zeros(3) if self._hand is None else self._hand.ee_from_box[:3, 3]

    def articulation(self, number: int) -> ArticulationState:
        """Returns a door or drawer of the episode; those of Pick and Place are not looked for."""
        raise NotImplementedError

    opening = known_opening

    def missed(self) -> None:
        """Does nothing: Pick and Place grasp no handle."""

    def floor_map(self, joints: Mapping[int, float] | None = None) -> NavigationMap:
        """Returns the map of the floor; Pick and Place stay where they are."""
        raise NotImplementedError

    def look(self) -> None:
        """Adds the current camera images to the map."""
        if self._looked:
            return
        self._looked = True
        poses, shoulder_m = self._own.poses(self.world_from_base, self.arm_qpos), self._shoulder_m
        seen = []
        for camera in CAMERAS:
            view = DepthView.read(self._obs, camera, self._row)
            world = ((view.points_m - shoulder_m) ** 2).sum(axis=-1) < self.config.map_m**2
            points_m = view.points_m[world]
            world[world] = ~self._own.contain(points_m, poses, self.config.own_margin_m)
            seen.append((view, world))
        if self.holding and self._hand is None:
            points_m = np.concatenate([view.points_m[world] for view, world in seen])
            world_from_ee = self._world_from_ee()
            self._hand = HeldBox.find(points_m, world_from_ee, self.config.box, self.held_up)
        for view, world in seen:
            points_m = view.points_m[world]
            world[world] = ~self._modeled(points_m, self.config.held_margin_m)
            self.map.add(view, world)

    def collision(
        self, *, base: Array | None = None, without: str | None = None, reach_m: float | None = None
    ) -> ArmCollision:
        """Returns the collision model with the map's obstacles; see `Scene.collision`."""
        self.look()
        if base is None:
            self.map.mark()
        here = self._believed(without)
        there = here if base is None else standing_at(here, base)
        shoulder_m = _at(there.world_from_base, np.array(self.robot.shoulder_m))
        config, far_m = self.config, reach_m or self.config.reach_m
        surfaces_m, hidden_m = self.map.occupied_m(shoulder_m, far_m), np.zeros((0, 3))
        if self.risk_level < 2:
            surfaces_m = np.concatenate((surfaces_m, self.map.felt_m()))
        if self.risk_level < 1:
            hidden_m = self.map.hidden_m(shoulder_m, far_m)
        sizes = config.map.voxels.size_m, config.map.hidden.size_m
        obstacles = [
            obstacle
            for centres_m, size_m in zip((surfaces_m, hidden_m), sizes, strict=True)
            for obstacle in voxel_obstacles(
                centres_m[~self._cleared(centres_m, size_m, here, without)], size_m, config.cell_m
            )
        ]
        return ArmCollision(
            self.robot, there, held=there.held, config=within(reach_m), obstacles=obstacles
        )

    def taking(self, number: int, world_from_ee: Array) -> None:
        """Returns None: the extent of the object is known only after the grasp."""

    def in_the_way(self, path: Array) -> bool:
        """Looks every `watch_steps` and returns whether an arm path (K, J) is no longer free.

        Only voxels seen since the path was planned are checked. A door or drawer held by the hand
        is left out.
        """
        pulled = next(
            (articulation.body for articulation in self._articulations() if articulation.held), None
        )
        new_m = self._new_m(pulled)
        return any(self._filled(new_m, pose).any() for pose in path) if len(new_m) else False

    def drives_into(self, bases: Array) -> bool:
        """Looks every `watch_steps` and returns whether base poses (K, 3) are no longer free.

        Only voxels seen since the last plan are checked.
        """
        new_m = self._new_m(None)
        new_m = new_m[new_m[:, 2] > LOWEST_M]
        if not len(new_m):
            return False
        there = standing(bases, float(self.world_from_base[2, 3]))
        margin_m = self.config.touch_margin_m
        poses = [self._own.poses(pose, self.arm_qpos) for pose in there]
        hits = (self._own.contain(new_m, pose, margin_m).sum() for pose in poses)
        return any(count >= LEAST_VOXELS for count in hits)

    def _new_m(self, without: str | None) -> Array:
        """Looks every `watch_steps`, and returns the voxels (V, 3) seen since the last plan."""
        self._steps += 1
        if self._steps % self.config.watch_steps:
            return np.zeros((0, 3))
        self.look()
        new_m = self.map.new_m(self._shoulder_m, self.config.reach_m)
        size_m = self.config.map.voxels.size_m
        return new_m[~self._cleared(new_m, size_m, self._believed(), without)]

    def met(self, path: Array) -> None:
        """Adds an obstacle to the map after contact during a motion to arm poses (K, J).

        It is in the volume of the arm at these poses, outside its current volume, and unseen.
        """
        self.look()
        here = self._own.poses(self.world_from_base, self.arm_qpos)
        margin_m = self.config.touch_margin_m
        found = [np.zeros((0, 3))]
        for pose in path:
            points_m = _at(self.world_from_base @ self._arm.ee_pose(pose), np.zeros(3)) + _GRID_M
            new = self._filled(points_m, pose)
            new[new] = ~self._own.contain(points_m[new], here, margin_m)
            new[new] = ~self._modeled(points_m[new], margin_m)
            found.append(points_m[new])
        self.map.add_contacts(np.concatenate(found))

    def _filled(self, points_m: Array, pose: Array) -> NDArray[np.bool_]:
        """Whether points (K, 3) are in the arm at a pose (J,), or in the held object."""
        filled = self._own.contain(points_m, self._own.poses(self.world_from_base, pose), 0.0)
        if self._hand is not None:
            world_from_ee = self.world_from_base @ self._arm.ee_pose(pose)
            filled |= self._hand.contains(points_m, world_from_ee, largest_m=self._largest_m)
        return filled

    @property
    def _largest_m(self) -> float:
        """Assumed maximum half size of the held object, at the current risk level."""
        return HELD_HALF_M if self.risk_level > 1 else np.inf

    def _cleared(
        self, centres_m: Array, size_m: float, here: PrivilegedState, without: str | None
    ) -> NDArray[np.bool_]:
        """Whether voxels (V, 3) are of the robot, the held object or the body `without`."""
        corner_m = size_m * 3**0.5 / 2  # half a voxel's diagonal
        cleared = self._own.contain(
            centres_m, here.world_from_body, self.config.touch_margin_m + corner_m
        )
        cleared |= self._modeled(centres_m, self.config.touch_margin_m + corner_m)
        for articulation in self._articulations():
            if articulation.body == without:
                near_m = np.linalg.norm(centres_m - articulation.handle_m, axis=1)
                cleared |= near_m < self.config.front_m
        return cleared

    def _believed(self, without: str | None = None) -> PrivilegedState:
        """Returns the believed state of the robot and the held object; less a body, if given."""
        bodies, poses = self._own.bodies, self._own.poses(self.world_from_base, self.arm_qpos)
        if self._hand is not None:
            poses[HELD] = self._world_from_ee() @ self._hand.ee_from_box
            bodies = (*bodies, self._hand.body(self._largest_m))
        return PrivilegedState(
            scene_key=f"seen with {self._hand} {self.risk_level}",
            bodies=bodies,
            world_from_body=poses,
            world_from_base=self.world_from_base,
            arm_qpos=self.arm_qpos,
            locked_qpos=self.robot.locked_qpos,
            held=None if self._hand is None else HELD,
            object_com_m={},
            targets=(),
            goals_m=np.zeros((0, 3)),
        )

    def _articulations(self) -> tuple[ArticulationState, ...]:
        """Returns the doors and drawers that were found."""
        return ()

    @property
    def _known(self) -> KnownPositions:
        assert self._places is not None, "nothing was seen yet"
        return self._places

    @property
    def _shoulder_m(self) -> Array:
        return _at(self.world_from_base, np.array(self.robot.shoulder_m))

    def _world_from_ee(self) -> Array:
        return self.world_from_base @ self._arm.ee_pose(self.arm_qpos)

    def _modeled(self, points_m: Array, margin_m: float) -> NDArray[np.bool_]:
        """Whether world points (K, 3) belong to a body of `_believed`: the held object."""
        if self._hand is None:
            return np.zeros(len(points_m), dtype=bool)
        return self._hand.contains(points_m, self._world_from_ee(), margin_m)

    def _took(self) -> None:
        """Records a grasp of the intended object, in its previous pose."""
        if any(articulation.held for articulation in self._articulations()) or self._wanted is None:
            return
        # The object has not moved yet, and was seen better during the approach.
        self.grasp_points_m(self._wanted)
        self._held, self._up = self._wanted, self._world_from_ee()[2, :3]
        box, config = self._boxes[self._wanted], self.config
        if box.seen:
            self._hand = HeldBox(
                ee_from_box=invert_pose(self._world_from_ee()) @ box.world_from_box,
                half_size_m=box.half_size_m,
            )
        self.map.remove(box, config.held_margin_m if box.seen else config.unseen_m)


def _at(pose: Array, point_m: Array) -> Array:
    return pose[:3, :3] @ point_m + pose[:3, 3]
