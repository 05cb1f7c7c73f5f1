"""Placement sandbox: a physics scene without an environment, to generate and check episodes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import numpy as np
import sapien

from hab_tasks.constants import SIM_HZ
from hab_tasks.episodes.layout_memory import BodyState, LayoutMemory, body_states
from hab_tasks.episodes.sandbox_robot import TOUCH_DEPTH_M, JointPositions, SandboxRobot, set_joints
from hab_tasks.episodes.schema import POSE_DIGITS, rounded, template_of
from hab_tasks.geometry import Array, Pose7
from hab_tasks.privileged import CollisionBody
from hab_tasks.robots import DEFAULT_ROBOT
from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.robots.spec import RobotSpec
from hab_tasks.simulator import sapien_object
from hab_tasks.world.scenes.build import to_sapien
from hab_tasks.world.scenes.floor import FreeFloor, body_points, bounding_ball, distance_along
from hab_tasks.world.scenes.physics import bare_scene, renew_physics
from hab_tasks.world.scenes.pool import BodyPool, SceneBodies, components, matrix
from hab_tasks.world.scenes.spec import ObjectTemplate, SceneSpec

LOOSE_SETTLE_S = 5.0

STILL_S, STILL_M, STILL_M_S = 2.0, 0.005, 0.01
"""A body that moves less and slower than this during this time is at rest."""

BEAT_S, FIRST_S = 0.25, 0.5
"""Check interval of speeds, and grace period in which started objects may swing."""


Remembered = tuple[list[tuple[Any, sapien.Pose]], list[tuple[Any, JointPositions]]]
"""Poses of movable objects, and joint positions of furniture."""

_AT_REST = np.zeros(3, dtype=np.float32)


class PlacementSandbox:
    """One layout with movable objects and the robot, on the CPU.

    Attributes:
        settled: Name of each loose object of the layout -> pose after settling.
        bodies: Body name -> collision shapes (without the robot).
        scene_bodies: Bodies of the scene.
    """

    scene_bodies: SceneBodies
    bodies: dict[str, CollisionBody]

    def __init__(
        self,
        spec: SceneSpec,
        templates: dict[str, ObjectTemplate],
        memory: LayoutMemory | None = None,
        robot: RobotSpec = DEFAULT_ROBOT,
    ) -> None:
        """Builds the layout without movable objects, and settles its loose objects.

        `memory` is that of earlier sandboxes with the same dataset and objects.
        """
        self.templates = templates
        self.memory = LayoutMemory() if memory is None else memory
        self._scene = bare_scene()
        self._pool = BodyPool(self._scene, templates, self.memory.bodies)
        self._robot = SandboxRobot(self._scene, robot)
        self._agent, self.robot = self._robot.agent, robot
        self._begin(spec)

    def begin_again(self, spec: SceneSpec) -> None:
        """Loads another layout in a new simulation, as a new sandbox does; keeps the bodies."""
        self._pool.leave()
        self._robot.leave()
        renew_physics(self._scene)
        self._robot.enter()
        self._begin(spec)

    def _begin(self, spec: SceneSpec) -> None:
        self._px: Any = self._scene.px
        self.load(spec)

    def load(self, spec: SceneSpec) -> None:
        """Loads another layout without movable objects, and settles its loose objects."""
        self.spec, self.settled = spec, {}
        self._floors: dict[str, FreeFloor] = {}
        self.show(())
        if self.scene_bodies.loose:
            self.settle(LOOSE_SETTLE_S)
            self.settled = {name: rounded(self.pose(name)) for name in self.scene_bodies.loose}
            self._floors = {}

    def show(self, objects: Iterable[str]) -> None:
        """Resets the scene with these movable objects, furniture closed and the robot parked."""
        self.scene_bodies = self._pool.show(self.spec, objects)
        self._components = {
            name: (group, body) for name, group, body in components(self.scene_bodies)
        }
        self.bodies = {body.name: body for body in self._pool.bodies()}
        for name in self.scene_bodies.movable:
            self.place(name, self.settled.get(name, self.pose(name)))
        self._furniture = {
            name: sapien_object(furniture)
            for name, furniture in self.scene_bodies.articulations.items()
        }
        for furniture in self._furniture.values():
            set_joints(furniture, np.zeros_like(furniture.qpos))
        self.send_robot_away()

    def set_joint(self, furniture: str, joint: str, value: float) -> None:
        """Sets one joint [m or rad]; it keeps its position."""
        articulation = self.scene_bodies.articulations[furniture]
        index = [j.name for j in articulation.active_joints].index(joint)
        qpos = self._furniture[furniture].qpos.copy()
        qpos[index] = value
        set_joints(self._furniture[furniture], qpos)

    def open_joints(self, joints: dict[str, dict[str, float]]) -> None:
        """Sets furniture -> joint -> position [m or rad]; other joints are unchanged."""
        for furniture, positions in joints.items():
            for joint, value in positions.items():
                self.set_joint(furniture, joint, value)

    def joint_limits(self, furniture: str, joint: str) -> tuple[float, float]:
        """Returns the (lower, upper) limits of a joint [m or rad]."""
        articulation = self.scene_bodies.articulations[furniture]
        index = [j.name for j in articulation.active_joints].index(joint)
        low, high = articulation.get_qlimits()[0, index].tolist()
        return low, high

    def place(self, name: str, pose: Pose7) -> None:
        """Sets the pose of a movable object, at rest."""
        _set_pose(self._components[name][1], to_sapien(pose))

    def pose(self, name: str) -> Pose7:
        """Returns the pose of a movable object."""
        pose = self._components[name][1].entity_pose
        return (*pose.p.tolist(), *pose.q.tolist())

    def com_m(self, name: str) -> Array:
        """Returns a movable object's centre of mass (3,) in the world."""
        body = self._components[name][1]
        return np.asarray((body.entity_pose * body.cmass_local_pose).p, dtype=float)

    def graspable_m(self) -> Array:
        """Returns the centres of mass (K, 3) of all graspable objects."""
        return np.array([self.com_m(name) for name in self.scene_bodies.movable]).reshape(-1, 3)

    def com_in_object_m(self, name: str) -> Array:
        """Returns a movable object's centre of mass (3,) in its own frame."""
        return np.asarray(self._components[name][1].cmass_local_pose.p, dtype=float)

    def points_m(self, name: str) -> Array:
        """Returns the corners (P, 3) of a body's shapes in its own frame."""
        return np.concatenate([body_points(one)[:3].T for one in self.bodies[name].shapes])

    def _speed_m_s(self, name: str) -> float:
        """Returns the speed of a movable object's centre of mass."""
        return float(np.linalg.norm(self._components[name][1].linear_velocity))

    def asleep(self, name: str) -> bool:
        """Whether a movable object sleeps."""
        return bool(self._components[name][1].is_sleeping)

    def box_m(self, name: str) -> tuple[Array, Array]:
        """Returns the lower and upper corner (3,) of a body's bounding box in the world."""
        low, high = self._components[name][1].compute_global_aabb_tight()
        return np.asarray(low, dtype=float), np.asarray(high, dtype=float)

    def top_m(self, name: str) -> float:
        """Returns the height of a body's highest point."""
        return float(self.box_m(name)[1][2])

    def root_of(self, furniture: str) -> str:
        """Returns the name of a piece of furniture's root link."""
        return self.scene_bodies.articulations[furniture].links[0].name

    def world_from(self, body: str) -> Array:
        """Returns the (4, 4) pose of any body."""
        return matrix(self._components[body][1].entity_pose)

    def settle(self, seconds: float, names: tuple[str, ...] = ()) -> None:
        """Steps physics until `names` (empty: all loose objects) sleep, `seconds` at most."""
        bodies = [self._components[n][1] for n in (names or tuple(self.scene_bodies.loose))]
        for step in range(round(seconds * SIM_HZ)):
            self._px.step()
            if step % 30 == 29 and all(body.is_sleeping for body in bodies):
                break

    def restless(self, poses: dict[str, Pose7], *, ends: bool = False) -> set[str]:
        """Starts objects from rest at `poses`; returns those that move.

        The layout's loose objects start at their settled poses and are included. The test takes
        two seconds, as an uneven box may rock for more than one second before it topples. Where
        everything sleeps, only the parked robot goes on, which affects what is simulated later.

        Args:
            poses: Object name -> pose.
            ends: Whether nothing is simulated later if nothing moves.
        """
        start = {**self.settled, **poses}
        for name, pose in start.items():
            self.place(name, pose)

        def fast() -> set[str]:
            return {name for name in start if self._speed_m_s(name) > STILL_M_S}

        def away() -> set[str]:
            return {n for n, p in start.items() if math.dist(self.pose(n)[:3], p[:3]) > STILL_M}

        moved: set[str] = set()
        for beat in range(1, round(STILL_S / BEAT_S) + 1):
            self.settle(BEAT_S, tuple(start))
            if beat * BEAT_S > FIRST_S:
                moved |= fast()
            if ends and self._all_sleep() and not moved | fast() | away():
                return set()
        return moved | away()

    def _all_sleep(self) -> bool:
        """Whether all bodies sleep, except the robot."""
        links = (link for piece in self._furniture.values() for link in piece.links)
        return all(map(self.asleep, self.scene_bodies.movable)) and all(
            link.sleeping for link in links
        )

    def footprint(self, name: str) -> tuple[Array, float, float]:
        """Measures an object standing upright.

        Returns:
            The centre (3,) of its outline in its own frame, at the height of its origin; the
            outline's radius [m]; its extent below its origin [m].
        """
        return _footprint(self.bodies[name], tuple(self.templates[template_of(name)].up))

    def joint_of(self, furniture: str, link: str) -> str | None:
        """Returns the joint that moves a link, None for a fixed link."""
        for joint in self.scene_bodies.articulations[furniture].active_joints:
            if joint.child_link is not None and joint.child_link.name == link:
                return joint.name
        return None

    def link_of(self, furniture: str, joint: str) -> str:
        """Returns the link that a joint moves."""
        joints = {j.name: j for j in self.scene_bodies.articulations[furniture].active_joints}
        link = joints[joint].child_link
        assert link is not None
        return link.name

    def furniture(self, template: str) -> str | None:
        """Returns the name of the first piece of furniture of a template, None without one."""
        names = sorted(self.scene_bodies.articulations)
        return next((name for name in names if template_of(name) == template), None)

    def joints(self) -> dict[str, dict[str, float]]:
        """Returns furniture -> joint -> position [m or rad] of all joints that are not closed."""
        found = {}
        for name, furniture in self.scene_bodies.articulations.items():
            positions = self._furniture[name].qpos.tolist()
            values = zip(furniture.active_joints, positions, strict=True)
            moved = {joint.name: round(value, POSE_DIGITS) for joint, value in values}
            moved = {joint: value for joint, value in moved.items() if value}
            if moved:
                found[name] = moved
        return found

    def floor(self) -> FreeFloor:
        """Returns the free floor with the furniture in its current state."""
        key = repr(self.joints())
        if key not in self._floors:
            fixed = self._fixed()
            poses = [self.world_from(body.name) for body in fixed]
            self._floors[key] = self.memory.floor(fixed, poses)
        return self._floors[key]

    def floor_known(self) -> bool:
        """Whether the floor was mapped with the furniture in its current state."""
        return repr(self.joints()) in self._floors

    def state(self) -> tuple[BodyState, ...]:
        """Returns a key of the furniture's geometry and poses in `memory`."""
        fixed = self._fixed()
        return body_states(fixed, [self.world_from(body.name) for body in fixed])

    def free_height_m(self, points_m: Array) -> float:
        """Returns the largest free height [m] vertically above any of the points (K, 3)."""
        free = np.full(len(points_m), np.inf)
        middle = points_m.mean(axis=0)
        spread_m = np.linalg.norm(points_m - middle, axis=1).max()
        for body in self._fixed():
            world_from_body = self.world_from(body.name)
            centre, radius_m = bounding_ball(body)
            aside = world_from_body[:2] @ np.append(centre, 1.0) - middle[:2]
            if np.linalg.norm(aside) > radius_m + spread_m:
                continue
            # Row vectors times a rotation are column vectors times its inverse.
            local = (points_m - world_from_body[:3, 3]) @ world_from_body[:3, :3]
            up: Array = world_from_body[2, :3]
            for shape in body.shapes:
                free = np.minimum(free, distance_along(shape, local, up))
        return float(free.max())

    def _fixed(self) -> list[CollisionBody]:
        """All bodies except the movable objects; loose furniture is included."""
        pickables = self.scene_bodies.pickables
        return [b for name, b in self.bodies.items() if b.shapes and name not in pickables]

    def touching(self, name: str, others: frozenset[str] = frozenset()) -> bool:
        """Whether an object overlaps any body other than `others`."""
        body = self._components[name][1]
        spared = {self._components[other][1] for other in others}
        remembered = self._remember()
        self._px.step()
        hit = any(
            body in contact.bodies
            and not spared & set(contact.bodies)
            and any(point.separation < -TOUCH_DEPTH_M for point in contact.points)
            for contact in self._px.get_contacts()
        )
        self._restore(remembered)
        return hit

    def _remember(self) -> Remembered:
        bodies = [self._components[name][1] for name in self.scene_bodies.movable]
        poses = [(body, body.entity_pose) for body in bodies]
        return poses, [(piece, piece.qpos.copy()) for piece in self._furniture.values()]

    def _restore(self, remembered: Remembered) -> None:
        poses, joints = remembered
        for body, pose in poses:
            _set_pose(body, pose)
        for piece, qpos in joints:
            set_joints(piece, qpos)

    def robot_touches(
        self, base: tuple[float, float, float], arm_qpos_rad: Array, clearance_m: float = 0.0
    ) -> bool:
        """Whether a robot pose is in self-collision, or closer than `clearance_m` to a body.

        Afterwards the robot is parked again, and the bodies it pushed are restored.
        """
        remembered = self._remember()
        self._robot.stand(base, arm_qpos_rad)
        self._px.step()
        touches = self._robot.in_contact(self._px.get_contacts(), clearance_m)
        self.send_robot_away()
        poses, joints = remembered
        # Furniture under load gives way slightly in every step.
        self._restore((poses if touches else [], joints))
        return touches

    def stand_robot(
        self, base: tuple[float, float, float], arm_qpos_rad: Array
    ) -> MobileManipulator:
        """Sets the robot to a pose, held until `send_robot_away`; returns the robot."""
        self._robot.stand(base, arm_qpos_rad)
        self._agent.controller.reset()
        return self._agent

    def send_robot_away(self) -> None:
        """Parks the robot outside the layout."""
        self._robot.park()


def _set_pose(body: Any, pose: sapien.Pose) -> None:
    """Sets the pose of a SAPIEN body, at rest."""
    body.entity.pose = pose
    body.linear_velocity = _AT_REST
    body.angular_velocity = _AT_REST


@lru_cache(maxsize=1024)
def _footprint(body: CollisionBody, up: tuple[float, ...]) -> tuple[Array, float, float]:
    axis = np.array(up)
    points = np.concatenate([body_points(s)[:3] for s in body.shapes], axis=1)
    heights = axis @ points
    flat = points - np.outer(axis, heights)
    middle = (flat.min(axis=1) + flat.max(axis=1)) / 2
    radius = np.linalg.norm(flat - middle[:, None], axis=0).max()
    return middle, float(radius), float(-heights.min())
