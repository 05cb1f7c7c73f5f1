"""Sleeping objects: objects at rest and out of reach are kinematic, which saves solver time.

A sleeping (kinematic) body has no contacts with furniture and takes no solver time, so a step costs
the same with ten and with a hundred objects. A body becomes dynamic again before anything can touch
it: near the arm, the held object, a moving door or drawer, or a displaced object. It is put to
sleep again once it is at rest and out of reach.
"""

from __future__ import annotations

import numpy as np
from mani_skill.utils.structs import Actor, Articulation
from numpy.typing import NDArray
from sapien.physx import PhysxRigidDynamicComponent

from hab_tasks.robots.mobile_manipulator import MobileManipulator
from hab_tasks.simulator import rigid_body, sapien_object
from hab_tasks.world.scenes.physics import FROZEN, MOVING, set_groups

MOVED = 1e-4
"""Joint displacement [m or rad] since the last check from which a joint counts as moved."""


class MovingLinks:
    """Tracks the joints of all furniture in one scene."""

    def __init__(self, furniture: list[Articulation]) -> None:
        self._furniture = [sapien_object(piece) for piece in furniture]
        joints = [joint for piece in furniture for joint in piece.active_joints]
        self._links = [sapien_object(joint.child_link) for joint in joints]
        self._seen: NDArray[np.float32] = self._joints()

    def look_again(self) -> None:
        """Takes the current joint positions as the reference."""
        self._seen = self._joints()

    def boxes_m(self) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Returns lower and upper corner (3,) of every link that moved since the last check."""
        joints = self._joints()
        moved = np.abs(joints - self._seen) > MOVED
        if not moved.any():
            return []
        self._seen = joints
        links = [self._links[index] for index in np.flatnonzero(moved).tolist()]
        return [(low, high) for low, high in (link.compute_global_aabb_tight() for link in links)]

    def _joints(self) -> NDArray[np.float32]:
        parts = [piece.qpos for piece in self._furniture]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=np.float32)


WAKE_DISTANCE_M = 0.1
"""Distance to a moving body at which a body is woken; the arm moves up to 10 cm per action."""

HEAVY_KG = 10.0
HEAVY_WAKE_DISTANCE_M = -0.03
"""Wake distance of tables and chairs, which hardly yield, so that they may be asleep at first
contact: the spheres around the arm are this much larger than the arm."""

MOVED_M = 0.01
"""Displacement since falling asleep from which an object can push others."""

RESTING_SPEED = 1e-4
"""Maximum restored velocity [m/s and rad/s] of an object at rest."""

CHECK_EVERY_STEPS = 10
"""Maximum number of actions between searches for objects at rest."""

_ARM_RADIUS_M = 0.1
_HAND_RADIUS_M = 0.14
"""Radius of spheres at the arm's joints and midway between them, which enclose the arm."""

_BODY_RADIUS_M = 0.5


class SleepingObjects:
    """Puts loose objects of one scene to sleep and wakes them.

    Attributes:
        com_m: (K, 3) centres of mass in the world, current after `refresh`.
        present: (K,) whether the object is part of the episode.
    """

    def __init__(
        self, objects: list[Actor], agent: MobileManipulator, furniture: list[Articulation]
    ) -> None:
        """Tracks the arm and the furniture, and the base if actions move it."""
        self._furniture = MovingLinks(furniture)
        self._bodies = [rigid_body(actor) for actor in objects]
        self._com = [body.cmass_local_pose for body in self._bodies]
        spec, mobile = agent.spec, agent.controller.config.base != "still"
        arm_links = (*spec.arm_links[1:], spec.ee_link)
        names = arm_links + spec.body_links if mobile else arm_links
        self._watched = [sapien_object(agent.link(name)) for name in names]
        self._arm = len(arm_links)
        # In the order of the centres in `_moving_balls`.
        between = [_ARM_RADIUS_M] * (self._arm - 1)
        arm = [_ARM_RADIUS_M] * (self._arm - 1) + [_HAND_RADIUS_M]
        self._link_radius_m = between + arm + [_BODY_RADIUS_M] * (len(names) - self._arm)
        count = len(objects)
        heavy = np.array([body.mass >= HEAVY_KG for body in self._bodies], dtype=bool)
        self._margin_m = np.where(heavy, HEAVY_WAKE_DISTANCE_M, WAKE_DISTANCE_M).reshape(count, 1)
        self._radius_m = np.zeros(count)
        self._low_m, self._high_m = np.zeros((count, 3)), np.zeros((count, 3))
        self._frozen_at_m = np.zeros((count, 3), dtype=np.float32)
        self._active: list[int] = []
        self._settled = np.zeros(count, dtype=bool)
        self._checked_at_m = np.zeros((len(names), 3))
        self._free_distance_m, self._checks_left, self._checked_held = 0.0, 0, -1
        self._doors_move = True
        self.com_m: NDArray[np.float32] = np.zeros((count, 3), dtype=np.float32)
        self.present = np.zeros(count, dtype=bool)

    def thaw_all(self) -> None:
        """Wakes all bodies, for a reset."""
        for index in range(len(self._bodies)):
            self._thaw(index)
        self._settled[:] = False
        self._active = list(range(len(self._bodies)))

    def undisturbed(self) -> list[int]:
        """Returns the sleeping objects that are at their start poses."""
        return np.flatnonzero(self._settled).tolist()

    def freeze_all(self, present: NDArray[np.bool_], placed: list[int] | None = None) -> None:
        """Puts bodies at rest to sleep at the start of an episode; moving bodies stay awake.

        `present` (K,): part of the episode; `placed`: moved since the last call, None for all.
        """
        self.present, self._checks_left = present.copy(), 0
        self._furniture.look_again()
        self._doors_move = True
        self._active = []
        for index in range(len(self._bodies)) if placed is None else placed:
            if present[index] and _moves(self._bodies[index]):
                self._measure(index)
                self._active.append(index)
            else:
                self._freeze(index)
                self._settled[index] = True

    def wake(self, index: int) -> None:
        """Wakes one body."""
        if index not in self._active:
            self._thaw(index)
            self._settled[index] = False
            self._active.append(index)

    def before_step(self, held: int, touching: bool) -> None:
        """Wakes objects that the robot, a door or a displaced object could touch in this action.

        `held` is the index of the held object, -1 for none; `touching` is whether the robot had
        contacts in the last action, or holds a handle.
        """
        if not self._bodies:
            return
        links = np.array([link.entity_pose.p for link in self._watched], dtype=np.float64)
        # Furniture is still while nothing pushes it and no door swings.
        self._doors_move = self._doors_move or touching or bool(self._active)
        doors = self._furniture.boxes_m() if self._doors_move else []
        self._doors_move = bool(doors)
        if not doors and self._nothing_new(links, held):
            return
        points, radius_m = self._moving_balls(links, held)
        # Distance of every sphere's centre to every body's box; np.clip takes twice as long.
        nearest = np.minimum(np.maximum(points, self._low_m[:, None]), self._high_m[:, None])
        nearest -= points
        distance_m = np.sqrt(np.einsum("kpi,kpi->kp", nearest, nearest))
        gap_m = (distance_m - radius_m - self._margin_m).min(axis=1)
        near = gap_m < 0
        for low, high in doors:
            apart_m = np.maximum(self._low_m - high, low - self._high_m).max(axis=1)
            near |= apart_m < WAKE_DISTANCE_M
        near &= self.present
        for index in np.flatnonzero(near).tolist():
            self.wake(index)
        for index in self._active[:]:
            # PhysX's own sleep tells what has been at rest for a while.
            if not near[index] and index != held and self._bodies[index].is_sleeping:
                self._freeze(index)
                self._active.remove(index)
        apart = gap_m[self.present & ~near]
        self._checked_at_m, self._free_distance_m = (
            links,
            float(apart.min()) if len(apart) else np.inf,
        )
        self._checks_left, self._checked_held = CHECK_EVERY_STEPS, held

    def _nothing_new(self, links_m: NDArray[np.float64], held: int) -> bool:
        """Whether the arm moved less since the last check than its clearance to all objects."""
        self._checks_left -= 1
        if self._checks_left <= 0 or held != self._checked_held or self._pushing(held):
            return False
        moved = links_m - self._checked_at_m
        # A held object rotates with the hand, so it can move farther than the hand's centre.
        free_distance_m = self._free_distance_m if held < 0 else self._free_distance_m / 2
        return float(np.einsum("pi,pi->p", moved, moved).max()) < free_distance_m**2

    def refresh(self) -> None:
        """Reads the centres of mass of bodies that may have moved."""
        for index in self._active:
            self._read(index)

    def _moving_balls(
        self, links_m: NDArray[np.float64], held: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns centres (P, 3) and radii (P,) [m] of spheres around all bodies that may push."""
        arm = links_m[: self._arm]
        pushing = set(self._pushing(held)) | ({held} if held >= 0 else set())
        others = sorted(pushing & set(self._active))
        centers = ((arm[:-1] + arm[1:]) / 2, links_m, self.com_m[others])
        radii = np.append(self._link_radius_m, self._radius_m[others])
        return np.concatenate(centers, dtype=np.float64), radii

    def _pushing(self, held: int) -> list[int]:
        """Returns objects displaced since they fell asleep, except the held one."""
        loose = [index for index in self._active if index != held]
        gone = [(index, self.com_m[index] - self._frozen_at_m[index]) for index in loose]
        return [index for index, moved in gone if float(moved @ moved) > MOVED_M**2]

    def _freeze(self, index: int) -> None:
        self._measure(index)
        body = self._bodies[index]
        if not body.kinematic:  # only this class makes bodies kinematic, so the groups are set
            body.kinematic = True
            set_groups(body, FROZEN)

    def _measure(self, index: int) -> None:
        """Stores pose and size of a body."""
        self._read(index)
        low, high = self._bodies[index].compute_global_aabb_tight()
        self._low_m[index], self._high_m[index] = low, high
        self._radius_m[index] = np.linalg.norm(np.subtract(high, low)) / 2
        self._frozen_at_m[index] = self.com_m[index]

    def _thaw(self, index: int) -> None:
        body = self._bodies[index]
        if body.kinematic:
            body.kinematic = False
            set_groups(body, MOVING)

    def _read(self, index: int) -> None:
        self.com_m[index] = (self._bodies[index].entity_pose * self._com[index]).p


def _moves(body: PhysxRigidDynamicComponent) -> bool:
    speeds = np.concatenate((body.linear_velocity, body.angular_velocity))
    return bool(np.abs(speeds).max() > RESTING_SPEED)
