"""Collision model of the robot's arm and the scene (S App. D, SPA-Priv).

The shapes, including those of the robot's links, come from the physics engine
(`hab_tasks.privileged`), so the model has the simulator's own convex hulls. Only the arm and the
held object move; everything else, including the rest of the robot, is a static obstacle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from xml.etree import ElementTree

import coal  # pyright: ignore[reportMissingImports]  # compiled, no stubs
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from numpy.typing import NDArray

from hab_spa.planning.shape_cache import ShapeCache
from hab_spa.shapes import Array, box_distance_m, invert_pose, standing, within_body
from hab_tasks.privileged import CollisionBody, PrivilegedState
from hab_tasks.robots.fetch import FETCH
from hab_tasks.robots.kinematics import arm_model

FINGER_LINKS = tuple(name.replace("_joint", "_link") for name in FETCH.finger_joints)
MOVING_LINKS = (*FETCH.arm_links, FETCH.ee_link, *FINGER_LINKS)
TORSO_JOINT = "torso_lift_joint"


@dataclass(frozen=True, kw_only=True)
class CollisionConfig:
    """Parameters of the collision model.

    Attributes:
        reach_m: Maximum distance of shapes from the shoulder.
        margin_m: Clearance between the arm or the held object and the scene.
    """

    reach_m: float = 1.4
    margin_m: float = 0.02


def within(reach_m: float | None) -> CollisionConfig:
    """Returns the default parameters with another reach; None for the default reach."""
    return CollisionConfig() if reach_m is None else CollisionConfig(reach_m=reach_m)


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Two shapes closer than their margin; `distance_m` is negative when they penetrate."""

    pair: int
    first: str
    second: str
    distance_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Obstacle:
    """An obstacle that is not a body of the simulator, e.g. one seen by a camera.

    Attributes:
        name: Name in reports of contacts.
        geometry: Geometry of Coal, in the world frame.
        lower_m: Lower corner (3,) of its bounding box in the world.
        upper_m: Upper corner (3,) of its bounding box in the world.
    """

    name: str
    geometry: coal.CollisionGeometry
    lower_m: Array
    upper_m: Array


@dataclass(eq=False)
class _SceneItem:
    """A shape of the scene: its body, and its world pose in the initial state and now."""

    body: str
    geometry: pin.GeometryObject
    stated: pin.SE3
    placed: pin.SE3


@lru_cache(maxsize=1)
def shared_arm_model() -> tuple[pin.Model, int]:
    """Returns the arm's model and the id of its frame ``ee``; built once, do not modify."""
    return arm_model(FETCH)


@lru_cache(maxsize=1)
def allowed_link_pairs() -> frozenset[frozenset[str]]:
    """Returns the link pairs that are not checked: adjacent links, and those of the SRDF."""
    pairs = set()
    for joint in ElementTree.parse(FETCH.urdf_path()).getroot().iter("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            pairs.add(frozenset((parent.get("link", ""), child.get("link", ""))))
    srdf = ElementTree.parse(FETCH.urdf_path().with_suffix(".srdf")).getroot()
    for entry in srdf.iter("disable_collisions"):
        pairs.add(frozenset((entry.get("link1", ""), entry.get("link2", ""))))
    return frozenset(pairs)


class ArmCollision:
    """Checks arm poses for collisions, for one scene and one held object.

    Attributes:
        checks: Number of collision checks so far.
        base_from_arm: (4, 4) pose of the arm model's root (torso as in `FETCH.locked_qpos`) in
            the base frame; differs from the identity when the torso stands elsewhere.
        arm_from_world: (4, 4) pose of the world in the frame of that root.
    """

    def __init__(
        self,
        state: PrivilegedState,
        held: str | None = None,
        config: CollisionConfig | None = None,
        cache: ShapeCache | None = None,
        obstacles: Sequence[Obstacle] = (),
    ) -> None:
        """Builds the model.

        Args:
            state: The robot and the bodies around it.
            held: Name of the body that moves with the gripper.
            config: Parameters.
            cache: Cache of shapes.
            obstacles: Additional obstacles.
        """
        self.config = config or CollisionConfig()
        self.checks = 0
        self._state, self._cache = state, cache or ShapeCache()
        self._model, _ = shared_arm_model()
        self._data = self._model.createData()
        self._geometry = pin.GeometryModel()
        self._scene: list[_SceneItem] = []
        # By body; what lies in a drawer is looked up in the initial state, once.
        self._moving: dict[str, list[_SceneItem]] = {}
        self.base_from_arm = np.eye(4)
        self.base_from_arm[2, 3] = state.locked_qpos[TORSO_JOINT] - FETCH.locked_qpos[TORSO_JOINT]
        self.arm_from_world = invert_pose(state.world_from_base @ self.base_from_arm)
        self._add_bodies(held)
        for obstacle in obstacles:
            self._add_obstacle(obstacle)
        self._finish()

    def is_free(self, qpos: Array) -> bool:
        """Whether the arm pose (7,) [rad] keeps every pair's margin."""
        self.checks += 1
        return not pin.computeCollisions(self._model, self._data, self._broad, qpos, True)

    def contacts(self, qpos: Array) -> list[Contact]:
        """Returns all pairs of shapes closer than their margin at an arm pose (7,)."""
        pin.computeCollisions(self._model, self._data, self._geometry, self._pairs, qpos, False)
        found = []
        for i, pair in enumerate(self._geometry.collisionPairs):
            if self._pairs.collisionResults[i].isCollision():
                pin.computeDistance(self._geometry, self._pairs, i)
                objects = self._geometry.geometryObjects
                found.append(
                    Contact(
                        pair=i,
                        first=objects[pair.first].name,
                        second=objects[pair.second].name,
                        distance_m=float(self._pairs.distanceResults[i].min_distance),
                    )
                )
        return found

    def set_margin(self, margin_m: float, less: Mapping[int, float] | None = None) -> None:
        """Sets the margin of pairs with the scene; pairs within the robot have none.

        Args:
            margin_m: The margin [m].
            less: Pair -> upper bound of its margin [m].
        """
        for i, with_scene in enumerate(self._with_scene):
            self._set_pair_margin(i, margin_m if with_scene else 0.0)
        for i, pair_m in (less or {}).items():
            self._set_pair_margin(i, min(pair_m, self._margins_m[i]))

    def relax(self, qpos: Array, touch_m: float = 0.001) -> list[Contact]:
        """Lowers the margins violated at an arm pose (7,), so that the pose is free.

        Args:
            qpos: The arm pose [rad].
            touch_m: Tolerance: these pairs may be this much closer than at the pose.

        Returns:
            The violated contacts.
        """
        contacts = self.contacts(qpos)
        for contact in contacts:
            self._set_pair_margin(contact.pair, contact.distance_m - touch_m)
        return contacts

    def move(self, name: str, motion: Array) -> bool:
        """Moves a body of the scene, and the objects in it, relative to the initial state.

        Args:
            name: The body.
            motion: (4, 4) motion of its points in the world.

        Returns:
            Whether the model contains the body.
        """
        if name not in self._moving:
            names = {name, *self._lying_in(name)}
            self._moving[name] = [item for item in self._scene if item.body in names]
        items, moved = self._moving[name], pin.SE3(motion)
        for item in items:
            item.placed = moved * item.stated
        self._place(items)
        return bool(items)

    def arm_from_world_at(self, base: Array) -> Array:
        """Returns the pose (4, 4) of the world in the arm's root frame at a base pose (3,)."""
        world_from_base = standing(base, float(self._state.world_from_base[2, 3]))
        return invert_pose(world_from_base @ self.base_from_arm)

    def stand_at(self, base: Array) -> None:
        """Sets the robot, with its held object, to a base pose (3,) in the world.

        The model still contains only shapes within `reach_m` of the initial shoulder position.
        """
        arm_from_world = self.arm_from_world_at(base)
        if not np.array_equal(arm_from_world, self.arm_from_world):
            self.arm_from_world = arm_from_world
            self._place(self._scene)

    def _place(self, items: Sequence[_SceneItem]) -> None:
        """Updates the placements of shapes in the arm's root frame."""
        arm_from_world = pin.SE3(self.arm_from_world)
        for item in items:
            item.geometry.placement = arm_from_world * item.placed

    def _lying_in(self, name: str) -> list[str]:
        """Returns the loose objects whose centre of mass is in a body's bounding box."""
        body = next((body for body in self._state.bodies if body.name == name), None)
        if body is None or name not in self._state.world_from_body or not self._state.object_com_m:
            return []
        names, points_m = zip(*self._state.object_com_m.items(), strict=True)
        lies = within_body(body, self._state.world_from_body[name], np.array(points_m))
        return [other for other, lies_in in zip(names, lies, strict=True) if lies_in]

    def _set_pair_margin(self, pair: int, margin_m: float) -> None:
        if self._with_octree[pair]:
            margin_m = max(margin_m, 0.0)  # Coal supports no negative margins for octrees
        if self._margins_m[pair] == margin_m:
            return
        self._margins_m[pair] = margin_m
        self._pairs.collisionRequests[pair].security_margin = margin_m
        # The broad phase has data of its own, and would keep the old margin.
        self._broad.getGeometryData().collisionRequests[pair].security_margin = margin_m

    def _add_bodies(self, held: str | None) -> None:
        self._kinds: list[str] = []
        self._links: list[str] = []
        self._bodies: list[str] = []
        for body in self._state.bodies:
            if body.name not in self._state.world_from_body:
                continue
            link = body.name.rsplit("/", 1)[-1]
            if body.name == held:
                self._add(body, "held", link)
            elif body.group != "robot":
                self._add(body, "scene", link)
            else:
                self._add(body, "arm" if link in MOVING_LINKS else "robot", link)

    def _add(self, body: CollisionBody, kind: str, link: str) -> None:
        """Adds a body's shapes to its joint: an arm joint, the wrist if held, or else the root."""
        joint, joint_from_body = 0, self.arm_from_world @ self._state.world_from_body[body.name]
        # Fingers are placed as they are, like a held object: the model has the arm's joints only.
        if kind == "arm" and link not in FINGER_LINKS:
            frame = self._model.frames[self._model.getFrameId(link)]
            joint, joint_from_body = frame.parentJoint, frame.placement.homogeneous
        elif kind == "held" or link in FINGER_LINKS:
            gripper = self._model.frames[self._model.getFrameId(FETCH.ee_link)]
            joint = gripper.parentJoint
            joint_from_body = gripper.placement.homogeneous @ self._gripper_from(body.name)
        chosen = range(len(body.shapes)) if kind != "scene" else self._near(body, joint_from_body)
        shapes = self._cache.shapes(self._state, body) if len(chosen) else []
        for i in chosen:
            geometry, shape_offset = shapes[i]
            joint_from_shape = joint_from_body @ body.shapes[i].body_from_shape
            placement = pin.SE3(joint_from_shape @ shape_offset)
            item = pin.GeometryObject(f"{body.name}#{i}", joint, placement, geometry)
            self._add_item(item, kind, link, body.name)

    def _add_obstacle(self, obstacle: Obstacle) -> None:
        """Adds a static obstacle if it is within reach."""
        shoulder_m = self._shoulder_in(self.arm_from_world)
        gap_m = box_distance_m(shoulder_m, obstacle.lower_m, obstacle.upper_m)
        if gap_m >= self.config.reach_m:
            return
        placement = pin.SE3(self.arm_from_world)
        item = pin.GeometryObject(obstacle.name, 0, placement, obstacle.geometry)
        self._add_item(item, "scene", obstacle.name, obstacle.name)

    def _add_item(self, item: pin.GeometryObject, kind: str, link: str, body: str) -> None:
        self._geometry.addGeometryObject(item)
        self._kinds.append(kind)
        self._links.append(link)
        self._bodies.append(body)

    def _gripper_from(self, name: str) -> Array:
        poses = self._state.world_from_body
        gripper = next(key for key in poses if key.rsplit("/", 1)[-1] == FETCH.ee_link)
        return invert_pose(poses[gripper]) @ poses[name]

    def _near(self, body: CollisionBody, arm_from_body: Array) -> NDArray[np.intp]:
        """Returns the numbers of a body's shapes that are within reach of the shoulder."""
        if not body.shapes:
            return np.zeros(0, dtype=np.intp)
        shoulder_m, reach_m = self._shoulder_in(arm_from_body), self.config.reach_m
        return np.flatnonzero(self._cache.within(self._state, body, shoulder_m, reach_m))

    def _shoulder_in(self, arm_from_frame: Array) -> Array:
        """Returns the shoulder (3,) in a frame whose pose in the arm's root is given."""
        shoulder_m = self._model.jointPlacements[1].translation
        return arm_from_frame[:3, :3].T @ (shoulder_m - arm_from_frame[:3, 3])

    def _finish(self) -> None:
        """Defines the collision pairs and builds the broad phase."""
        kinds = np.array(self._kinds)
        moving = np.isin(kinds, ("arm", "held"))
        with_scene = np.logical_and.outer(moving, kinds == "scene")
        self._geometry.setCollisionPairs(self._own_pairs() | with_scene | with_scene.T)
        pairs = self._geometry.collisionPairs
        self._with_scene = ["scene" in (kinds[p.first], kinds[p.second]) for p in pairs]
        octrees = [isinstance(g.geometry, coal.OcTree) for g in self._geometry.geometryObjects]
        self._with_octree = [octrees[p.first] or octrees[p.second] for p in pairs]
        self._pairs = self._geometry.createData()
        self._broad = pin.BroadPhaseManager_SSaPCollisionManager(
            self._model, self._geometry, self._geometry.createData()
        )
        world_from_arm = pin.SE3(invert_pose(self.arm_from_world))
        for body, kind, item in zip(
            self._bodies, kinds, self._geometry.geometryObjects, strict=True
        ):
            if kind == "scene":
                placed = world_from_arm * item.placement
                self._scene.append(_SceneItem(body, item, placed, placed))
        # NaN equals nothing, so that the first call sets every pair.
        self._margins_m = [float("nan")] * len(pairs)
        self.set_margin(self.config.margin_m)

    def _own_pairs(self) -> NDArray[np.bool_]:
        """Returns the self-collision pairs (S, S), without pairs in contact at the rest pose."""
        allowed, kinds, links = allowed_link_pairs(), self._kinds, self._links
        paired = np.zeros((len(kinds), len(kinds)), dtype=bool)
        arm, own = (
            [i for i, k in enumerate(kinds) if k in of] for of in (("arm",), ("arm", "robot"))
        )
        for i, j in product(arm, own):
            meet = links[i] != links[j] and frozenset((links[i], links[j])) not in allowed
            paired[i, j] = paired[j, i] = meet
        self._geometry.setCollisionPairs(paired)
        data = self._geometry.createData()
        rest = np.array(FETCH.rest_qpos_rad)
        pin.computeCollisions(self._model, self._data, self._geometry, data, rest, False)
        for pair, result in zip(self._geometry.collisionPairs, data.collisionResults, strict=True):
            # Convex hulls overlap where links do not; the rest pose is known to be free.
            if result.isCollision():
                paired[pair.first, pair.second] = paired[pair.second, pair.first] = False
        return paired
