"""How the arm follows the arc of the fridge's handle."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hab_spa.planning.arm_plan import path_rad
from hab_spa.planning.collision import ArmCollision, shared_arm_model
from hab_spa.planning.ik import BatchArm
from hab_spa.shapes import Array, invert_pose
from hab_spa.skills.fridge_door import Door
from hab_spa.skills.fridge_tow import TowConfig, with_base
from hab_tasks.privileged import FrontState
from hab_tasks.robots.fetch_spec import REST_QPOS_RAD

ELBOW = 4
"""Number of the elbow's joint in the arm's model; from here on the arm reaches out."""


@dataclass(frozen=True, kw_only=True)
class ArcConfig:
    """The numbers of following the handle.

    Attributes:
        step_rad: The arc is followed in such steps of the door.
        ways: How the hand turns on the way: a share of the door's turn, and what a radian off
            that is worth in metres off the arc.
        margin_m: Clearance on the way.
        steps: Each step takes so many of inverse kinematics ...
        missed_m: ... and may miss the arc by this much.
        pace_rad: A joint moves this far in a control step, for the length of a motion.
        detour: The way of the arm to a handle is so many times the straight one.
        again_steps: To take the handle once more costs so many steps, and so many for each radian
            that the door is then to be led.
        behind_rad: A door that is opened stays so far behind a hand at its edge or behind it: the
            handle is drawn in until the fingers touch the door's other side.
        before_m: A hand that is so much farther off the door than its handle is before it.
        tow: How the base moves along.
    """

    step_rad: float = 0.08
    ways: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.5, 0.05), (1.0, 0.05))
    margin_m: float = 0.003
    steps: int = 4
    missed_m: float = 0.01
    pace_rad: float = 0.05
    detour: float = 2.0
    again_steps: tuple[float, float] = (60.0, 60.0)
    behind_rad: float = 0.09
    before_m: float = 0.01
    tow: TowConfig = field(default_factory=TowConfig)


@dataclass(frozen=True, kw_only=True)
class Pull:
    """How the door is to be moved.

    Attributes:
        end: As far as the hand is to take it [rad].
        need: It will do to take it so far ...
        whole: ... and nothing remains to be done from here.
        swept: From where to where it swings, with the robot out of its way.
        grasps_m: (along, out) beside the door where the hand may take the handle.
        way_out: Whether it is opened.
    """

    end: float
    need: float
    whole: float
    swept: tuple[float, float]
    grasps_m: tuple[tuple[float, float], ...]
    way_out: bool

    def enough(self, joint: float) -> bool:
        """Whether it will do to take the door as far as this."""
        return joint >= self.need if self.way_out else joint <= self.need

    def all_the_way(self, joint: float) -> bool:
        """Whether nothing remains to be done when the door is as far as this."""
        return joint >= self.whole if self.way_out else joint <= self.whole


@dataclass(frozen=True, kw_only=True, eq=False)
class Lead:
    """One way of leading the door.

    Attributes:
        goal: (7,) arm pose that takes the handle.
        arc: (K, 7) arm poses along the handle's arc, ...
        bases: ... (K, 3) base poses, which are all the same where the robot stands, ...
        joints: ... and how far the door is open at each (K,) [rad].
        enough: Whether the door gets far enough ...
        whole: ... and all the way.
        share: The part of the way that the door needs to be led.
        cost: About how many steps it takes, and then to rest.
    """

    goal: Array
    arc: Array
    bases: Array
    joints: Array
    enough: bool
    whole: bool
    share: float
    cost: float

    @property
    def towed(self) -> bool:
        """Whether the base goes along."""
        return bool(np.ptp(self.bases, axis=0).any())


class Arcs:
    """Follows the handle of a door as it is now, from arm poses that take it."""

    def __init__(self, front: FrontState, arm: BatchArm, pull: Pull, config: ArcConfig) -> None:
        self._front, self._arm, self._pull, self._config = front, arm, pull, config
        self.door = Door(front)
        count = 1 + round(abs(pull.end - front.joint) / config.step_rad)
        self._joints = np.linspace(front.joint, pull.end, count)

    @property
    def joints(self) -> Array:
        """How far the door is open on the way (K,) [rad]."""
        return self._joints

    def leads(self, here: Array, goals: Array, collision: ArmCollision, tows: Array) -> list[Lead]:
        """Returns the ways of leading the door from arm poses (G, 7).

        Args:
            here: The arm now (7,).
            goals: Arm poses that take the handle.
            collision: Tells what is free; door and robot are moved in it.
            tows: Motions of the base (T, K, 3), all from where it stands.
        """
        if not len(goals) or not len(tows):
            return []
        collision.set_margin(self._config.margin_m)
        entries = list(product(range(len(tows)), goals, self._config.ways))
        starts = np.stack([goal for _, goal, _ in entries])
        towed = np.array([tow for tow, _, _ in entries])
        collision.stand_at(tows[0, 0])
        before = self.are_before(starts, collision)
        arcs = self._follow(
            starts, np.array([way for _, _, way in entries]), towed, tows, collision
        )
        lags = np.where(before | (not self._pull.way_out), 0.0, self._config.behind_rad)
        return [
            self._lead(here, start, np.array(arc), tows[tow, : len(arc)], lag)
            for start, arc, tow, lag in zip(starts, arcs, towed, lags, strict=True)
            if len(arc) > 1
        ]

    def are_before(self, goals: Array, collision: ArmCollision) -> NDArray[np.bool_]:
        """Whether hands of arm poses (G, 7) are before the door, and not at its edge or behind."""
        if not len(goals):
            return np.zeros(0, dtype=bool)
        return self._before(
            self._beside(np.stack([self._arm.ee_pose(g) for g in goals]), collision)
        )

    def _follow(
        self,
        starts: Array,
        ways: Array,
        towed: NDArray[np.int64],
        tows: Array,
        collision: ArmCollision,
    ) -> list[list[Array]]:
        """Returns the arm poses along the arc from each start (E, 7), as long as they are free.

        Args:
            starts: Arm poses that take the handle.
            ways: How the hand turns from each (E, 2).
            towed: With which motion of the base (E,) ...
            tows: ... of these (T, K, 3).
            collision: Tells what is free.
        """
        arcs: list[list[Array]] = [[] for _ in starts]
        poses, going = starts, np.arange(len(starts))
        hands = np.stack([self._arm.ee_pose(pose) for pose in starts])
        places = self._places(hands, collision)
        hands = invert_pose(collision.arm_from_world) @ hands
        for number, joint in enumerate(self._joints):
            motion = self._front.moved(float(joint))
            collision.move(self._front.body, motion)
            goals = self._goals(float(joint), hands[going], places[going], ways[going, 0])
            seen = np.stack([collision.arm_from_world_at(base) for base in tows[:, number]])
            goals = seen[towed[going]] @ goals
            poses = self._arm.track_poses(poses, goals, self._config.steps, ways[going, 1])
            reached, _ = self._arm.position_and_jacobian(poses)
            missed_m = np.linalg.norm(reached - goals[:, :3, 3], axis=1)
            on = missed_m <= self._config.missed_m
            for entry in np.nonzero(on)[0]:
                collision.stand_at(tows[towed[going[entry]], number])
                on[entry] = collision.is_free(poses[entry])
            going, poses = going[on], poses[on]
            for entry, pose in zip(going, poses, strict=True):
                arcs[entry].append(pose)
            if not len(going):
                break
        return arcs

    def _goals(self, joint: float, hands: Array, places: Array, shares: Array) -> Array:
        """Returns where hands (E, 4, 4) go in the world when the door is open so far.

        Args:
            joint: How far the door is open.
            hands: Where they took it.
            places: Where beside the door they go along (E, 2).
            shares: Of the door's turn with which they turn (E,).
        """
        axis = Rotation.from_matrix(self._front.moved(joint)[:3, :3]).as_rotvec()
        turns = Rotation.from_rotvec(shares[:, None] * axis).as_matrix()
        goals = hands.copy()
        goals[:, :3, :3] = turns @ goals[:, :3, :3]
        goals[:, :3, 3] = [self.door.point(joint, *place) for place in places]
        return goals

    def _places(self, hands: Array, collision: ArmCollision) -> Array:
        """Returns (along, out) (G, 2) at which hands (G, 4, 4) go along with the door.

        A handle is drawn into a hand before it; a hand at the door's edge or behind it stays there.
        """
        places = self._beside(hands, collision)
        return np.where(self._before(places)[:, None], self.door.handle_m, places)

    def _beside(self, hands: Array, collision: ArmCollision) -> Array:
        """Returns where hands (G, 4, 4) are beside the door, (G, 2)."""
        world_from_arm = invert_pose(collision.arm_from_world)
        points = hands[:, :3, 3] @ world_from_arm[:3, :3].T + world_from_arm[:3, 3]
        return self.door.beside(points, self._front.joint)

    def _before(self, places: Array) -> NDArray[np.bool_]:
        return places[:, 1] > self.door.handle_m[1] + self._config.before_m

    def _lead(self, here: Array, goal: Array, arc: Array, bases: Array, lag_rad: float) -> Lead:
        config, joints = self._config, self._joints[: len(arc)]
        last = float(joints[-1]) - lag_rad
        enough, whole = self._pull.enough(last), self._pull.all_the_way(last)
        cost = config.detour * float(np.abs(goal - here).max())
        cost += path_rad(with_base(arc, bases, config.tow))
        cost += float(np.abs(arc[-1] - REST_QPOS_RAD).max())
        cost /= config.pace_rad
        if not whole:
            once, for_a_radian = config.again_steps
            cost += once + for_a_radian * abs(last - self._pull.whole)
        if not enough:
            cost += 1000.0 * abs(last - self._pull.need)
        share = float((last - joints[0]) / (self._pull.need - joints[0]))
        return Lead(
            goal=goal,
            arc=arc,
            bases=bases,
            joints=joints,
            enough=enough,
            whole=whole,
            share=share,
            cost=cost,
        )


def best_first(leads: list[Lead]) -> list[Lead]:
    """Sorts ways of leading a door: those that go far enough first, then by what they cost."""
    return sorted(leads, key=lambda lead: (not lead.enough, lead.cost))


def arm_points_m(qpos: Array) -> Array:
    """Returns points (K, P, 3) along the reaching part of arms (K, 7), in the arm's root frame."""
    model, frame = shared_arm_model()
    data, found = model.createData(), []
    for pose in qpos:
        pin.forwardKinematics(model, data, pose)
        ee = pin.updateFramePlacement(model, data, frame).translation
        joints = [data.oMi[number].translation for number in range(ELBOW, model.njoints)]
        corners = np.array([*joints, ee])
        middles = (corners[1:] + corners[:-1]) / 2
        points = np.empty((2 * len(corners) - 1, 3))
        points[::2], points[1::2] = corners, middles
        found.append(points)
    return np.array(found)
