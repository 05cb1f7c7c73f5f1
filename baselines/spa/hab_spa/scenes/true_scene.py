"""Scene of SPA-Priv: the simulator's ground-truth state (S App. D)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from hab_plans.belief import known_opening
from numpy.typing import NDArray

from hab_spa.planning.antipodal import AntipodalConfig, antipodal_grasps
from hab_spa.planning.collision import ArmCollision, within
from hab_spa.planning.joint_goal import GraspConfig, sphere_m
from hab_spa.shapes import Array, body_bounds_m, invert_pose, standing
from hab_tasks.constants import GRASP_RADIUS_M
from hab_tasks.privileged import ArticulationState, PrivilegedState
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.world.navigation import NavigationMap


class TrueScene:
    """Scene from the observation's privileged group; see `hab_spa.scenes.scene.Scene`."""

    place_error_m = 0.0

    def __init__(self, robot: RobotSpec, config: GraspConfig | None = None) -> None:
        """Creates the scene of one row."""
        self.robot, self._config = robot, config or GraspConfig()
        self._floor: tuple[PrivilegedState, NavigationMap] | None = None
        self._obs: Mapping[str, Any] = {}
        self._row = 0

    def forget(self) -> None:
        """Starts a new episode; there is nothing to reset."""

    def see(self, obs: Mapping[str, Any], row: int) -> None:
        """Notes an observation; the ground-truth state of its row is read when it is needed."""
        self._obs, self._row = obs, row

    @property
    def state(self) -> PrivilegedState:
        """The state at this step."""
        return self._obs["privileged"][self._row]

    @property
    def arm_qpos(self) -> Array:
        """Joint positions of the arm (J,) [rad]."""
        return self.state.arm_qpos

    @property
    def world_from_base(self) -> Array:
        """(4, 4) pose of the base frame."""
        return self.state.world_from_base

    @property
    def holding(self) -> bool:
        """Whether the hand holds an object."""
        return self.state.held is not None

    def holds(self, number: int) -> bool:
        """Whether the hand holds this object."""
        return self.state.held == self.state.targets[number]

    def object_m(self, number: int) -> Array:
        """Returns an object's centre of mass (3,)."""
        return self.state.object_com_m[self.state.targets[number]]

    def goal_m(self, number: int) -> Array:
        """Returns the goal (3,) of its centre of mass."""
        return self.state.goals_m[number]

    def grasp_points_m(self, number: int, *, around: bool = False) -> Array:
        """Returns the points (P, 3) at which the hand can grasp an object.

        They are the face centres of its bounding box, or points `around` its centre of mass.
        """
        name, config = self.state.targets[number], self._config
        if around:
            com_m = self.object_m(number)
            spheres = [sphere_m(com_m, radius_m, config.sides) for radius_m in config.around_m]
            points_m = np.concatenate(spheres)
        else:
            points_m = face_centres_m(self.state, name)
        return points_m[would_grasp(self.state, name, points_m, config)]

    def name_of(self, number: int) -> str:
        """Returns the name of an object of the episode."""
        return self.state.targets[number]

    def grasps(self, number: int) -> Array:
        """Returns end-effector poses (G, 4, 4) at which fingers grasp an object by friction.

        Raises:
            ValueError: The robot has no driven fingers.
        """
        if self.robot.fingers is None:
            raise ValueError(f"grasps: {self.robot.uid} has no driven fingers.")
        name = self.name_of(number)
        hand_from_ee = np.eye(4)
        hand_from_ee[0, 3] = self.robot.ee_offset_m
        body = next(body for body in self.state.bodies if body.name == name)
        body_from_hand = antipodal_grasps(body, self.robot.fingers, 0, AntipodalConfig())
        return self.state.world_from_body[name] @ body_from_hand @ hand_from_ee

    def ee_from_held(self) -> Array:
        """Returns the centre of mass (3,) of the held object, in the end-effector's frame.

        Raises:
            ValueError: The hand is empty.
        """
        if self.state.held is None:
            raise ValueError("ee_from_held: the hand is empty.")
        point = np.append(self.state.object_com_m[self.state.held], 1.0)
        return (invert_pose(self._world_from_ee()) @ point)[:3]

    def articulation(self, number: int) -> ArticulationState:
        """Returns a door or drawer of the episode."""
        return self.state.articulations[number]

    def was_let_go(self, number: int) -> bool:
        """Returns False: where an object is makes no difference to what is known of it."""
        return False

    opening = known_opening

    def collision(
        self, *, base: Array | None = None, without: str | None = None, reach_m: float | None = None
    ) -> ArmCollision:
        """Returns the collision model with the simulator's own shapes; see `Scene.collision`."""
        state = self.state if base is None else standing_at(self.state, base)
        if without is not None:
            poses = {n: pose for n, pose in state.world_from_body.items() if n != without}
            state = replace(state, world_from_body=poses)
        return ArmCollision(self.robot, state, held=state.held, config=within(reach_m))

    def taking(self, number: int, world_from_ee: Array) -> ArmCollision:
        """Returns the collision model with an object grasped at an end-effector pose (4, 4)."""
        name, poses = self.state.targets[number], dict(self.state.world_from_body)
        # The model needs the object's pose relative to the current hand.
        poses[name] = self._world_from_ee() @ invert_pose(world_from_ee) @ poses[name]
        state = replace(self.state, world_from_body=poses)
        return ArmCollision(self.robot, state, held=name)

    def drives_into(self, bases: Array) -> bool:
        """Returns False: the scene is known."""
        return False

    def in_the_way(self, path: Array) -> bool:
        """Returns False: all obstacles were known when the path was planned."""
        return False

    def met(self, path: Array) -> None:
        """Does nothing: all obstacles are known."""

    def missed(self) -> None:
        """Does nothing: where handles are is known."""

    def floor_map(self, joints: Mapping[int, float] | None = None) -> NavigationMap:
        """Returns the floor map without robot and held object; see `Scene.floor_map`."""
        if joints:
            return self._map(joints)
        if self._floor is None or self._floor[0] is not self.state:
            self._floor = self.state, self._map({})
        return self._floor[1]

    def _map(self, joints: Mapping[int, float]) -> NavigationMap:
        poses = dict(self.state.world_from_body)
        for number, joint in joints.items():
            articulation = self.articulation(number)
            poses[articulation.body] = articulation.moved(joint) @ poses[articulation.body]
        bodies = [b for b in self.state.bodies if b.group != "robot" and b.name in poses]
        return NavigationMap.of_bodies([b for b in bodies if b.name != self.state.held], poses)

    def _world_from_ee(self) -> Array:
        poses = self.state.world_from_body
        gripper = next(
            pose for name, pose in poses.items() if name.rsplit("/", 1)[-1] == self.robot.ee_link
        )
        ee = gripper.copy()
        ee[:3, 3] += gripper[:3, 0] * self.robot.ee_offset_m
        return ee


def face_centres_m(state: PrivilegedState, name: str) -> Array:
    """Returns the face centres (6, 3) [m] of a body's bounding box, in the world.

    The box is aligned with the body's frame and contains all its collision shapes.
    """
    body = next(body for body in state.bodies if body.name == name)
    lower, upper = body_bounds_m(body)
    centre, half = (lower + upper) / 2, (upper - lower) / 2
    local = centre + np.concatenate((np.diag(half), -np.diag(half)))
    world_from_body = state.world_from_body[name]
    return local @ world_from_body[:3, :3].T + world_from_body[:3, 3]


def would_grasp(
    state: PrivilegedState, name: str, points_m: Array, config: GraspConfig
) -> NDArray[np.bool_]:
    """Whether the snap grasp at end-effector positions (B, 3) in the world grasps an object: (B,).

    It grasps the object whose centre of mass is nearest, so being within its radius is not enough.
    """
    own = np.linalg.norm(points_m - state.object_com_m[name], axis=1)
    allowed = own <= GRASP_RADIUS_M - config.reach_safety_m
    for other_name, com_m in state.object_com_m.items():
        if other_name != name:
            other = np.linalg.norm(points_m - com_m, axis=1)
            allowed &= other >= own + config.runner_up_m
    return allowed


def standing_at(state: PrivilegedState, base: Array) -> PrivilegedState:
    """Returns a state with the robot and its held object at another base pose (3,)."""
    world_from_base = standing(base, float(state.world_from_base[2, 3]))
    motion = world_from_base @ invert_pose(state.world_from_base)
    robot = {body.name for body in state.bodies if body.group == "robot"} | {state.held}
    poses = {
        name: motion @ pose if name in robot else pose
        for name, pose in state.world_from_body.items()
    }
    return replace(state, world_from_base=world_from_base, world_from_body=poses)
