"""The scene of SPA: what egocentric depth shows, and where the robot was told things are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hab_spa.planning.collision import ArmCollision, ShapeCache, within
from hab_spa.planning.ik import BatchArm
from hab_spa.planning.joint_goal import GraspConfig, sphere_m
from hab_spa.scenes.told_places import ToldPlaces
from hab_spa.scenes.true_scene import TrueScene, standing_at
from hab_spa.sensing.cloud import DepthView, world_from_base
from hab_spa.sensing.fitted_box import BoxConfig, FittedBox, fit_box, other_things_m
from hab_spa.sensing.held_box import HELD, HeldBox
from hab_spa.sensing.octree import octrees
from hab_spa.sensing.own_shapes import PREFIX, inside_robot, own_bodies, own_poses
from hab_spa.sensing.seen_map import MapConfig, SeenMap
from hab_spa.shapes import Array, invert_pose
from hab_tasks.constants import GRASP_RADIUS_M
from hab_tasks.navigation import NavigationMap
from hab_tasks.privileged import FrontState, PrivilegedState
from hab_tasks.robots.fetch_spec import EE_LINK, LOCKED_QPOS

CAMERAS = ("head", "arm")
HELD_HALF_M = 0.03
"""Half the size of what is held, when the robot dares to think it small."""

_SIDE_M = np.arange(-0.2, 0.2, 0.014)
_GRID_M = np.stack(np.meshgrid(_SIDE_M, _SIDE_M, _SIDE_M), axis=-1).reshape(-1, 3)
"""Points around the gripper, in which it may meet with something."""

SHOULDER_M = np.array((0.033, 0.0, 0.88))
"""About where the arm begins, in the base's frame."""


@dataclass(frozen=True, kw_only=True)
class SeenConfig:
    """The numbers of SPA's perception.

    Attributes:
        own_margin_m: Points this near to the robot are its own ...
        touch_margin_m: ... and where it is now, nothing else is this near to it or what it holds.
        held_margin_m: Points this near to the box of what is held belong to it.
        unseen_m: What is this near to an object that was taken unseen may be part of it.
        held_reach_m: What the hand holds when an episode begins is within this of it.
        reach_m: Obstacles farther than this from the shoulder do not count.
        map_m: What is seen farther than this from it is left out of the map.
        watch_steps: On the way it is looked this often whether something is in the way.
        cell_m: Edge of the cells of which each is an octree of its own.
        fit_reach_m: A box is fitted to the points within this of the object's position.
        fit_spacing_m: Spacing of these points ...
        fit_slope: ... and their slope; see `hab_spa.sensing.cloud.surface_points_m`.
        runner_up_m: Other things are this much farther from a hand that takes an object.
        front_m: When a door or drawer is left out, it is what is this near to its handle.
        map, box, grasp: Numbers of the stages.
    """

    own_margin_m: float = 0.03
    touch_margin_m: float = 0.003
    held_margin_m: float = 0.04
    unseen_m: float = 0.06
    held_reach_m: float = 0.14
    reach_m: float = 1.6
    map_m: float = 1.9
    watch_steps: int = 6
    cell_m: float = 0.4
    fit_reach_m: float = 0.45
    fit_spacing_m: float = 0.008
    fit_slope: float = 3.0
    runner_up_m: float = 0.02
    front_m: float = 0.25
    map: MapConfig = field(default_factory=MapConfig)
    box: BoxConfig = field(default_factory=BoxConfig)
    grasp: GraspConfig = field(default_factory=GraspConfig)


class SeenScene:
    """Answers from depth images and localisation; see `hab_spa.scenes.scene.Scene`.

    Attributes:
        daring: For when there is no plan otherwise. 0: what no view shows is not free; 1: it is;
            2: so is what was only felt, and what is held is small.
        truth: The true scene, for what the privileged group is there for.

    About doors and drawers, and the floor that the oracle of navigation drives on, it knows what
    the observation's privileged group says, if there is one: S App. D is silent on them.
    """

    def __init__(self, config: SeenConfig | None = None) -> None:
        """Makes the scene of one row."""
        self.config = config or SeenConfig()
        self._arm, self._cache, self.truth = BatchArm(), ShapeCache(), TrueScene()
        self.forget()

    def forget(self) -> None:
        """Starts a new episode."""
        self.map = SeenMap(self.config.map)
        self._places: ToldPlaces | None = None
        self._boxes: dict[int, FittedBox] = {}
        self._hand: HeldBox | None = None
        self._wanted: int | None = None
        self._held: int | None = None
        self._was_holding = False
        self.daring = 0
        self._steps = 0

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Takes in an observation; its images are looked at only by `look`."""
        self._obs, self._row = obs, row
        self._pose: Array | None = None
        self._looked = False
        self._arm_rad = np.asarray(obs["agent"]["arm_qpos"][row], dtype=float)
        if "privileged" in obs:
            self.truth.see(obs, row)
        holding = bool(obs["agent"]["is_holding"][row, 0] > 0.5)
        if self._places is None:
            self._places = ToldPlaces.read(
                obs, row, self.world_from_base, self._world_from_ee(), self._told_state()
            )
            self._held = 0 if holding else None
        elif holding and not self._was_holding:
            self._took()
        elif not holding:
            if self._held is not None:  # it is believed to lie where the hand let it go
                self._told.lies_at(self._held, self._world_from_ee()[:3, 3])
            self._held, self._hand = None, None
        self._was_holding = holding

    @property
    def arm_qpos(self) -> Array:
        """The arm (7,) [rad]."""
        return self._arm_rad

    @property
    def world_from_base(self) -> Array:
        """(4, 4) pose of Fetch's base_link, by perfect localisation."""
        if self._pose is None:
            told = "privileged" in self._obs
            self._pose = (
                self.truth.world_from_base if told else world_from_base(self._obs, self._row)
            )
        return self._pose

    @property
    def holding(self) -> bool:
        """Whether an object is in the hand."""
        return self._held is not None

    def holds(self, number: int) -> bool:
        """Whether the hand holds this object; the robot believes that it took what it wanted."""
        return self._held == number

    def object_m(self, number: int) -> Array:
        """Returns where an object (3,) was when the episode began, or its drawer has taken it."""
        return self._told.object_m(number, self._told_state())

    def goal_m(self, number: int) -> Array:
        """Returns where it is to be (3,)."""
        return self._told.goals_m[number]

    def grasp_points_m(self, number: int, *, around: bool = False) -> Array:
        """Returns the points (P, 3) at which the hand would take an object.

        They are centres of the faces of its best-fit box, or points `around` its position. What
        the hand takes next is believed to be this object.
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
        """Whether the robot sees an object and what it stands on."""
        self.grasp_points_m(number)
        box = self._boxes[number]
        return box.seen and box.support_m is not None

    def ee_from_held(self) -> Array:
        """Returns the hand itself: what it holds is thought to be where it is."""
        return np.zeros(3)

    def front(self, number: int) -> FrontState:
        """Returns a door or drawer of the episode."""
        return self.truth.front(number)

    def floor_map(self) -> NavigationMap:
        """Returns the true floor, for the oracle of navigation."""
        return self.truth.floor_map()

    def look(self) -> None:
        """Adds what the cameras show at this step to the map."""
        if self._looked:
            return
        self._looked = True
        poses, shoulder_m = own_poses(self.world_from_base, self.arm_qpos), self._shoulder_m
        for camera in CAMERAS:
            view = DepthView.read(self._obs, camera, self._row)
            pixels = ((view.points_m - shoulder_m) ** 2).sum(axis=-1) < self.config.map_m**2
            points_m = view.points_m[pixels]
            world = pixels.copy()
            of_robot = inside_robot(points_m, poses, self.config.own_margin_m)
            if self.holding and self._hand is None:
                self._find_held(points_m[~of_robot])
            world[pixels] = ~of_robot & ~self._in_hand(points_m, self.config.held_margin_m)
            self.map.add(view, world)

    def collision(
        self,
        *,
        base: Array | None = None,
        without: str | None = None,
        reach_m: float | None = None,
    ) -> ArmCollision:
        """Returns the collision model with what was seen; see `Scene.collision`."""
        self.look()
        if base is None:
            self.map.mark()
        here = self._believed()
        there = here if base is None else standing_at(here, base)
        shoulder_m = _at(there.world_from_base, SHOULDER_M)
        config, far_m = self.config, reach_m or self.config.reach_m
        surfaces_m, hidden_m = self.map.occupied_m(shoulder_m, far_m), np.zeros((0, 3))
        if self.daring < 2:
            surfaces_m = np.concatenate((surfaces_m, self.map.felt_m()))
        if self.daring < 1:
            hidden_m = self.map.hidden_m(shoulder_m, far_m)
        sizes = config.map.voxels.size_m, config.map.hidden.size_m
        obstacles = [
            obstacle
            for centres_m, size_m in zip((surfaces_m, hidden_m), sizes, strict=True)
            for obstacle in octrees(
                centres_m[~self._cleared(centres_m, size_m, here, without)], size_m, config.cell_m
            )
        ]
        return ArmCollision(
            there,
            held=there.held,
            config=within(reach_m),
            cache=self._cache,
            obstacles=obstacles,
        )

    def taking(self, number: int, world_from_ee: Array) -> None:
        """Returns None: what of the points will come along is known when it is in the hand."""

    def in_the_way(self, path: Array) -> bool:
        """Looks every few steps, and returns whether an arm's path (K, 7) is no longer free.

        What was seen when it was planned it keeps clear of, so that only what has been seen since
        can be in its way. The door or drawer that the hand pulls goes with it.
        """
        self._steps += 1
        if self._steps % self.config.watch_steps:
            return False
        self.look()
        new_m = self.map.new_m(self._shoulder_m, self.config.reach_m)
        pulled = next((front.body for front in self._fronts() if front.held), None)
        here, size_m = self._believed(), self.config.map.voxels.size_m
        new_m = new_m[~self._cleared(new_m, size_m, here, pulled)]
        return any(self._meets(pose, new_m) for pose in path) if len(new_m) else False

    def met(self, path: Array) -> None:
        """Is told that the arm met with something where it was about to go, (K, 7).

        What that was is where the arm would have been, is not now, and no view shows.
        """
        self.look()
        here = own_poses(self.world_from_base, self.arm_qpos)
        found = [np.zeros((0, 3))]
        for pose in path:
            there = own_poses(self.world_from_base, pose)
            gripper_m = there[PREFIX + EE_LINK][:3, 3]
            points_m = gripper_m + _GRID_M
            new = inside_robot(points_m, there, 0.0)
            new[new] = ~inside_robot(points_m[new], here, self.config.touch_margin_m)
            found.append(points_m[new])
        self.map.feel(np.concatenate(found))

    def _meets(self, pose: Array, points_m: Array) -> bool:
        """Whether the arm or what it holds would be where points (K, 3) are, in a pose (7,)."""
        if inside_robot(points_m, own_poses(self.world_from_base, pose), 0.0).any():
            return True
        if self._hand is None:
            return False
        world_from_ee = self.world_from_base @ self._arm.ee_pose(pose)
        return bool(self._hand.contains(points_m, world_from_ee, largest_m=self._largest_m).any())

    @property
    def _largest_m(self) -> float:
        """Half the size that the robot, when it dares to, thinks that what it holds has at most."""
        return HELD_HALF_M if self.daring > 1 else np.inf

    def _cleared(
        self, centres_m: Array, size_m: float, here: PrivilegedState, without: str | None
    ) -> NDArray[np.bool_]:
        """Whether voxels (V, 3) are where the robot is, or what it holds or leaves out."""
        corner_m = size_m * 3**0.5 / 2  # half a voxel's diagonal
        cleared = inside_robot(
            centres_m, here.world_from_body, self.config.touch_margin_m + corner_m
        )
        cleared |= self._in_hand(centres_m, self.config.touch_margin_m + corner_m)
        for front in self._fronts():
            if front.body == without:
                near_m = np.linalg.norm(centres_m - front.handle_m, axis=1)
                cleared |= near_m < self.config.front_m
        return cleared

    def _believed(self) -> PrivilegedState:
        """The robot and what it holds, in the form in which true states come."""
        bodies, poses = own_bodies(), own_poses(self.world_from_base, self.arm_qpos)
        if self._hand is not None:
            poses[HELD] = self._world_from_ee() @ self._hand.ee_from_box
            bodies = (*bodies, self._hand.body(self._largest_m))
        return PrivilegedState(
            scene_key=f"seen with {self._hand} {self.daring}",
            bodies=bodies,
            world_from_body=poses,
            world_from_base=self.world_from_base,
            arm_qpos=self.arm_qpos,
            locked_qpos=LOCKED_QPOS,
            held=None if self._hand is None else HELD,
            object_com_m={},
            targets=(),
            goals_m=np.zeros((0, 3)),
        )

    def _told_state(self) -> PrivilegedState | None:
        """What the observation tells of the true state, if anything."""
        return self.truth.state if "privileged" in self._obs else None

    def _fronts(self) -> tuple[FrontState, ...]:
        """The doors and drawers of the episode, where the observation tells of them."""
        state = self._told_state()
        return () if state is None else state.fronts

    @property
    def _told(self) -> ToldPlaces:
        assert self._places is not None, "nothing was seen yet"
        return self._places

    @property
    def _shoulder_m(self) -> Array:
        return _at(self.world_from_base, SHOULDER_M)

    def _world_from_ee(self) -> Array:
        return self.world_from_base @ self._arm.ee_pose(self.arm_qpos)

    def _in_hand(self, points_m: Array, margin_m: float) -> NDArray[np.bool_]:
        """Whether points (K, 3) of the world are of what is held."""
        if self._hand is None:
            return np.zeros(len(points_m), dtype=bool)
        return self._hand.contains(points_m, self._world_from_ee(), margin_m)

    def _took(self) -> None:
        """Believes that the hand took what it wanted, in the pose that it had."""
        if any(front.held for front in self._fronts()) or self._wanted is None:
            return
        # It stands where it stood until now, and was seen better on the way.
        self.grasp_points_m(self._wanted)
        self._held = self._wanted
        box, config = self._boxes[self._wanted], self.config
        self._hand = HeldBox(
            ee_from_box=invert_pose(self._world_from_ee()) @ box.world_from_box,
            half_size_m=box.half_size_m,
        )
        self.map.remove(box, config.held_margin_m if box.seen else config.unseen_m)

    def _find_held(self, points_m: Array) -> None:
        """Finds what the hand holds when an episode begins: all that is near it (K, 3)."""
        ee_from_world = invert_pose(self._world_from_ee())
        local_m = points_m @ ee_from_world[:3, :3].T + ee_from_world[:3, 3]
        local_m = local_m[np.linalg.norm(local_m, axis=1) < self.config.held_reach_m]
        if len(local_m) >= self.config.box.fewest:
            self._hand = HeldBox.around(local_m)


def _at(pose: Array, point_m: Array) -> Array:
    return pose[:3, :3] @ point_m + pose[:3, 3]
