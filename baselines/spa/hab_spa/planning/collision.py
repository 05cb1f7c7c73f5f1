"""Collision model of the robot's arm and the scene (S App. D, SPA-Priv).

The shapes, including those of the robot's links, come from the physics engine
(`hab_tasks.privileged`), so the model has the simulator's own convex hulls. Only the arm and the
held object move; everything else, including the rest of the robot, is a static obstacle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from numpy.typing import NDArray

from hab_spa.planning import batch
from hab_spa.planning.items import CoalModel, Contact, Items, Obstacle, collect
from hab_spa.shapes import Array, invert_pose, standing, within_body
from hab_tasks.privileged import PrivilegedState
from hab_tasks.robots.description import ignored_pairs
from hab_tasks.robots.kinematics import arm_model
from hab_tasks.robots.spec import RobotSpec


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


class ArmCollision:
    """Checks arm poses for collisions, for one scene and one held object.

    A compiled kernel answers where it is certain, coal elsewhere (`CoalModel`).

    Attributes:
        robot: The robot.
        limits_rad: Lower and upper limits (J,) of its arm.
        checks: Number of collision checks so far.
        base_from_arm: (4, 4) pose of the arm model's root (as at `robot.locked_qpos`) in
            the base frame; differs from the identity when `robot.lift_joint` stands elsewhere.
        arm_from_world: (4, 4) pose of the world in the frame of that root.
    """

    def __init__(
        self,
        robot: RobotSpec,
        state: PrivilegedState,
        held: str | None = None,
        config: CollisionConfig | None = None,
        obstacles: Sequence[Obstacle] = (),
    ) -> None:
        """Builds the model.

        Args:
            robot: The robot.
            state: Its state, and the bodies around it.
            held: Name of the body that moves with the gripper.
            config: Parameters.
            obstacles: Additional obstacles.

        Raises:
            ValueError: A shape or pose is not finite, or the arm has no shapes.
        """
        self.config = config or CollisionConfig()
        self.robot, self.checks = robot, 0
        self.limits_rad = np.array(robot.arm_lower_rad), np.array(robot.arm_upper_rad)
        self._state, (self._model, _) = state, arm_model(robot)
        # By body; what lies in a drawer is looked up in the initial state, once.
        self._moving: dict[str, NDArray[np.intp]] = {}
        self.base_from_arm = np.eye(4)
        if (lift := robot.lift_joint) is not None:
            self.base_from_arm[2, 3] = state.locked_qpos[lift] - robot.locked_qpos[lift]
        self.arm_from_world = invert_pose(state.world_from_base @ self.base_from_arm)
        # The scene's shapes stay in the frame where the root stands first, as placing all of them
        # takes longer than a check.
        self._first_from_world, self._root = self.arm_from_world, np.eye(4)
        reach_m = self.config.reach_m
        self._items = collect(robot, state, held, obstacles, self.arm_from_world, reach_m)
        self._scene = np.flatnonzero(self._items.role == "scene")
        # Motions of bodies are relative to the initial poses, so that they do not add up.
        self._stated = invert_pose(self.arm_from_world) @ self._items.pose[self._scene]
        self._make_shapes()
        self.set_margin(self.config.margin_m)

    def is_free(self, qpos: Array) -> bool:
        """Whether the arm pose (J,) [rad] keeps every pair's margin."""
        return self.free_until(qpos[None]) == 1

    def free_until(self, poses: Array) -> int:
        """Returns the number of arm poses (B, J) [rad] before the first that is not free."""
        first = 0
        while first < len(poses):
            # The kernel stops at the first pose that it does not call free; coal is
            # asked about that.
            answers = self._answers(poses[first:], until_other=True)
            first += len(answers)
            if not self._confirmed(answers[-1], poses[first - 1]):
                self.checks += first
                return first - 1
        self.checks += first
        return first

    @property
    def items(self) -> Items:
        """The shapes, with their current poses."""
        return self._items

    def pairs(self) -> tuple[NDArray[np.int64], Array]:
        """Returns the pairs (P, 2) of shapes that are checked, and their margins (P,) [m]."""
        return self._pairs, self._margins_m

    @property
    def shapes(self) -> batch.Shapes:
        """The arrays of the compiled kernel."""
        return self._shapes

    def are_clear(self, poses: Array) -> bool:
        """Whether all arm poses (B, J) are free by the kernel's answer alone."""
        self.checks += len(poses)
        return bool((self._answers(poses) == batch.FREE).all())

    def are_free(self, poses: Array, bases: Array | None = None) -> NDArray[np.bool_]:
        """Whether arm poses (B, J) [rad] keep every pair's margin, (B,).

        Args:
            poses: The arm poses.
            bases: Base pose of each (B, 3), instead of the current one for all.
        """
        self.checks += len(poses)
        roots = None if bases is None else self._roots(bases)
        answers = self._answers(poses, roots)
        free, stood = answers == batch.FREE, self._root
        for number in np.flatnonzero(answers == batch.UNSURE):
            if roots is not None:
                self._set_root(roots[number])
            free[number] = self._confirmed(batch.UNSURE, poses[number])
        self._set_root(stood)
        return free

    def contacts(self, qpos: Array) -> list[Contact]:
        """Returns all pairs of shapes closer than their margin at an arm pose (J,)."""
        found = []
        for pair in self._undecided(qpos, (batch.HIT, batch.UNSURE)):
            first, second = self._pair(pair)
            if self._coal.collides(qpos, first, second, self._margins_m[pair]):
                gap_m = self._coal.distance_m(qpos, first, second)
                names = self._items.name(first), self._items.name(second)
                found.append(Contact(pair=pair, first=names[0], second=names[1], distance_m=gap_m))
        return found

    def _confirmed(self, answer: int, qpos: Array) -> bool:
        """Whether an arm pose is free, by the kernel's answer or else by coal."""
        if answer != batch.UNSURE:
            return answer == batch.FREE
        margins_m = self._margins_m
        return not any(
            self._coal.collides(qpos, *self._pair(pair), margins_m[pair])
            for pair in self._undecided(qpos, (batch.UNSURE,))
        )

    def _pair(self, pair: int) -> tuple[int, int]:
        return int(self._pairs[pair, 0]), int(self._pairs[pair, 1])

    def _undecided(self, qpos: Array, answers: tuple[int, ...]) -> list[int]:
        """Returns the pairs that the kernel answers in one of some ways."""
        pairs = np.empty((len(self._pairs), 2), dtype=np.int64)
        given = np.empty(len(pairs), dtype=np.uint8)
        qpos = np.ascontiguousarray(qpos[None], dtype=np.float64)
        found = batch.kernel().undecided(self._shapes, qpos, pairs, given)
        numbers = self._number[pairs[:found, 0] - self._statics, pairs[:found, 1]].tolist()
        said = zip(numbers, given[:found].tolist(), strict=True)
        # Sorted, so that the order does not depend on how the kernel goes through bodies.
        return sorted(number for number, answer in said if answer in answers)

    def set_margin(self, margin_m: float, less: Mapping[int, float] | None = None) -> None:
        """Sets the margin of pairs with the scene; pairs within the robot have none.

        Args:
            margin_m: The margin [m].
            less: Pair -> upper bound of its margin [m].
        """
        margins_m = np.where(self._with_scene, margin_m, 0.0)
        for pair, pair_m in (less or {}).items():
            margins_m[pair] = min(pair_m, margins_m[pair])
        self._set_margins(margins_m)

    def relax(self, qpos: Array, touch_m: float = 0.001) -> list[Contact]:
        """Lowers the margins violated at an arm pose (J,), so that the pose is free.

        Args:
            qpos: The arm pose [rad].
            touch_m: Tolerance: these pairs may be this much closer than at the pose.

        Returns:
            The violated contacts.
        """
        contacts, margins_m = self.contacts(qpos), self._margins_m.copy()
        for contact in contacts:
            margins_m[contact.pair] = contact.distance_m - touch_m
        self._set_margins(margins_m)
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
            names = [name, *self._lying_in(name)]
            self._moving[name] = np.flatnonzero(np.isin(self._items.body[self._scene], names))
        chosen = self._moving[name]
        items, numbers = self._items, self._scene[chosen]
        items.pose[numbers] = self._first_from_world @ (motion @ self._stated[chosen])
        ranks = self._rank[numbers]
        self._shapes.place[ranks] = batch.rows_of(items.pose[numbers])
        self._shapes.box_m[:, ranks] = batch.boxes_of(items.local_m[numbers], items.pose[numbers])
        return bool(len(chosen))

    def world_from_arms(self, bases: Array) -> Array:
        """Returns the poses (..., 4, 4) of the arm's root at base poses (..., 3)."""
        height_m = float(self._state.world_from_base[2, 3])
        return standing(np.asarray(bases), height_m) @ self.base_from_arm

    def stand_at(self, base: Array) -> None:
        """Sets the robot, with its held object, to a base pose (3,) in the world.

        The model still contains only shapes within `reach_m` of the initial shoulder position.
        """
        world_from_arm = self.world_from_arms(base)
        self.arm_from_world = invert_pose(world_from_arm)
        self._set_root(self._roots(base))

    def _roots(self, bases: Array) -> Array:
        """Returns the poses (..., 4, 4) of the arm's root in the scene's frame at base poses."""
        return self._first_from_world @ self.world_from_arms(bases)

    def _set_root(self, root: Array) -> None:
        """Sets the pose (4, 4) of the arm's root in the scene's frame."""
        if root is not self._root:
            self._root = root
            self._shapes.root[:] = batch.rows_of(root[None])
            self._coal.root = pin.SE3(root)

    def _lying_in(self, name: str) -> list[str]:
        """Returns the loose objects whose centre of mass is in a body's bounding box."""
        body = next((body for body in self._state.bodies if body.name == name), None)
        if body is None or name not in self._state.world_from_body or not self._state.object_com_m:
            return []
        names, points_m = zip(*self._state.object_com_m.items(), strict=True)
        lies = within_body(body, self._state.world_from_body[name], np.array(points_m))
        return [other for other, lies_in in zip(names, lies, strict=True) if lies_in]

    def _set_margins(self, margins_m: Array) -> None:
        """Sets the margins (P,) of all pairs."""
        # Coal supports no negative margins for octrees.
        self._margins_m = np.where(self._with_octree, np.maximum(margins_m, 0.0), margins_m)
        self._shapes.margin_m[self._entries] = self._margins_m

    def _answers(
        self, poses: Array, roots: Array | None = None, *, until_other: bool = False
    ) -> NDArray[np.uint8]:
        """Returns the kernel's answers for arm poses (B, J), or for the first ones of them."""
        answers = np.empty(len(poses), dtype=np.uint8)
        poses = np.ascontiguousarray(poses, dtype=np.float64)
        rows = self._shapes.root if roots is None else batch.rows_of(roots)
        return answers[: batch.kernel().check(self._shapes, poses, rows, until_other, answers)]

    @cached_property
    def _coal(self) -> CoalModel:
        return CoalModel(self._model, self._items)

    def _make_shapes(self) -> None:
        """Makes the kernel's arrays, and chooses the pairs that are checked."""
        items, moving = self._items, np.isin(self._items.role, ("arm", "held"))
        # The scene, the rest of the robot, moving shapes: the kernel tells them by their number.
        order = np.argsort(np.where(moving, 2, items.role == "robot"), kind="stable")
        self._rank = np.argsort(order, kind="stable")
        statics = int((~moving).sum())
        place, local_m = items.pose[order], items.local_m[order]
        kind, joint = items.kind[order], items.joint[order]
        own_m = [items.vertices_m[number] for number in order]
        vertices_m, ranges = batch.packed(own_m)
        block_m, blocks = batch.blocks_of(own_m, kind, local_m[:, 8])
        span = np.column_stack((ranges, kind, joint, blocks))
        one_voxel = np.array(((0, 0, batch.BOX, 0, 0),), dtype=np.int64)
        spheres_m, members = batch.groups_of(
            items.body[order][statics:].tolist(),
            joint[statics:],
            local_m[statics:],
            place[statics:],
        )
        self._shapes = batch.Shapes(
            chain=batch.chain_of(self.robot),
            root=batch.rows_of(self._root[None]),
            box_m=batch.boxes_of(local_m[:statics], place[:statics]),
            place=np.concatenate((batch.rows_of(place), np.zeros((1, 12)))),
            local_m=np.concatenate((local_m, np.zeros((1, 9)))),
            span=np.concatenate((span, one_voxel)),
            vertices_m=vertices_m,
            block_m=block_m,
            group_m=spheres_m,
            member=members,
            own=np.zeros((0, 2), dtype=np.int64),
            margin_m=np.full((len(items.joint) - statics, len(items.joint)), batch.NO_PAIR),
        )
        self._statics = statics
        scene = items.role == "scene"
        with_scene = np.logical_and.outer(moving, scene)
        with_scene = np.argwhere(np.triu(with_scene | with_scene.T, 1))
        self._use_pairs(np.concatenate((self._own_pairs(), with_scene)))

    def _use_pairs(self, pairs: NDArray[np.int64]) -> None:
        """Sets the pairs (P, 2) that are checked."""
        self._pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
        self._with_scene = (self._items.role == "scene")[self._pairs].any(axis=1)
        self._with_octree = (self._items.kind == batch.VOXELS)[self._pairs].any(axis=1)
        # The kernel numbers static shapes first, and moving ones lead a pair.
        ranks = np.sort(self._rank[self._pairs], axis=1)[:, ::-1]
        self._entries = ranks[:, 0] - self._statics, ranks[:, 1]
        self._number = np.zeros(self._shapes.margin_m.shape, dtype=np.int64)
        self._number[self._entries] = np.arange(len(ranks))
        own = np.ascontiguousarray(ranks[ranks[:, 1] >= self._statics])
        self._shapes.margin_m[:] = batch.NO_PAIR
        self._shapes = self._shapes._replace(own=own)
        self._set_margins(np.zeros(len(ranks)))

    def _own_pairs(self) -> NDArray[np.int64]:
        """Returns the self-collision pairs (P, 2), without pairs in contact at the rest pose."""
        items, allowed = self._items, ignored_pairs(self.robot)
        # Of the robot's shapes only, as comparing names is slow.
        own = np.flatnonzero((items.role == "arm") | (items.role == "robot"))
        arm, link = items.role[own] == "arm", items.link[own]
        paired = arm[:, None] & (link[:, None] != link)
        pairs = own[np.argwhere(np.triu(paired | paired.T, 1))]
        pairs = pairs[[frozenset(both) not in allowed for both in items.link[pairs].tolist()]]
        # In use for a moment, as the kernel answers for pairs in use only.
        self._use_pairs(pairs)
        # Convex hulls overlap where links do not; the rest pose is known to be free.
        rest = np.array(self.robot.rest_qpos_rad)
        touching = [
            pair
            for pair in self._undecided(rest, (batch.UNSURE,))
            if self._coal.collides(rest, *self._pair(pair), 0.0)
        ]
        touching += self._undecided(rest, (batch.HIT,))
        return np.delete(self._pairs, touching, axis=0)
