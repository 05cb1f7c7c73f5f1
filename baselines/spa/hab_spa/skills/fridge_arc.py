"""How the arm follows the arc of the fridge's handle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]  # compiled, no stubs
from scipy.spatial.transform import Rotation

from hab_spa.planning.arm_plan import path_rad
from hab_spa.planning.collision import ArmCollision, shared_arm_model
from hab_spa.planning.ik import BatchArm
from hab_spa.shapes import Array, invert_pose
from hab_spa.skills.fridge_door import Door
from hab_tasks.privileged import FrontState

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
        pad_m: The arm is out of the door's way this far beyond its edge ...
        way_out_steps: ... and a metre that it is short of that costs so many steps.
        swing_rad: A door that was let go swings on by so much in a step.
    """

    step_rad: float = 0.08
    ways: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.5, 0.05), (1.0, 0.05))
    margin_m: float = 0.003
    steps: int = 4
    missed_m: float = 0.01
    pace_rad: float = 0.05
    pad_m: float = 0.1
    way_out_steps: float = 100.0
    swing_rad: float = 0.025


@dataclass(frozen=True, kw_only=True)
class Pull:
    """How the door is to be moved.

    Attributes:
        end: As far as the hand is to take it [rad] ...
        need: ... and at least.
        swept: From where to where it swings, with the robot out of its way.
        grasps_m: (along, out) beside the door where the hand may take the handle.
        way_out: Whether the arm is in the door's way when the hand lets go.
    """

    end: float
    need: float
    swept: tuple[float, float]
    grasps_m: tuple[tuple[float, float], ...]
    way_out: bool

    def enough(self, joint: float) -> bool:
        """Whether it will do to take the door as far as this."""
        return joint >= self.need if self.way_out else joint <= self.need


@dataclass(frozen=True, kw_only=True, eq=False)
class Lead:
    """One way of leading the door.

    Attributes:
        goal: (7,) arm pose that takes the handle.
        arc: (K, 7) arm poses along the handle's arc ...
        joints: ... and how far the door is open at each (K,) [rad].
        enough: Whether the door gets far enough.
        share: The part of the way that the door needs to be led.
        cost: About how many steps it takes.
    """

    goal: Array
    arc: Array
    joints: Array
    enough: bool
    share: float
    cost: float


class Arcs:
    """Follows the handle of a door as it is now, from arm poses that take it."""

    def __init__(self, front: FrontState, arm: BatchArm, pull: Pull, config: ArcConfig) -> None:
        self._front, self._arm, self._pull, self._config = front, arm, pull, config
        self.door = Door(front)
        count = 1 + round(abs(pull.end - front.joint) / config.step_rad)
        self._joints = np.linspace(front.joint, pull.end, count)

    def leads(self, here: Array, goals: Array, collision: ArmCollision) -> list[Lead]:
        """Returns the ways of leading the door from arm poses (G, 7), the best first.

        Args:
            here: The arm now (7,).
            goals: Arm poses that take the handle.
            collision: Tells what is free; the door is moved in it.
        """
        collision.set_margin(self._config.margin_m)
        ways = self._config.ways
        starts = np.repeat(goals, len(ways), axis=0)
        arcs = self._follow(starts, ways * len(goals), collision)
        found = [
            self._lead(here, start, np.array(arc), collision)
            for start, arc in zip(starts, arcs, strict=True)
            if len(arc) > 1
        ]
        return sorted(found, key=lambda lead: (not lead.enough, lead.cost))

    def _follow(
        self, starts: Array, ways: tuple[tuple[float, float], ...], collision: ArmCollision
    ) -> list[list[Array]]:
        """Returns the arm poses along the arc from each start, as long as they are free."""
        arcs: list[list[Array]] = [[] for _ in starts]
        poses, hands = list(starts), [self._arm.ee_pose(pose) for pose in starts]
        going = list(range(len(starts)))
        for joint in self._joints:
            motion = self._front.moved(float(joint))
            collision.move(self._front.body, motion)
            axis = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
            axis = collision.arm_from_world[:3, :3] @ axis
            place = collision.arm_from_world @ np.append(self.door.handle(float(joint)), 1.0)
            for number in tuple(going):
                goal = np.eye(4)
                share, weight_m = ways[number]
                turn = Rotation.from_rotvec(share * axis).as_matrix()
                goal[:3, :3], goal[:3, 3] = turn @ hands[number][:3, :3], place[:3]
                poses[number] = self._arm.track_pose(
                    poses[number], goal, steps=self._config.steps, turn_weight_m=weight_m
                )
                missed_m = np.linalg.norm(self._arm.ee_pose(poses[number])[:3, 3] - place[:3])
                if missed_m > self._config.missed_m or not collision.is_free(poses[number]):
                    going.remove(number)
                    continue
                arcs[number].append(poses[number])
        return arcs

    def _lead(self, here: Array, goal: Array, arc: Array, collision: ArmCollision) -> Lead:
        config, joints = self._config, self._joints[: len(arc)]
        enough = self._pull.enough(float(joints[-1]))
        last = int(np.argmax([self._pull.enough(float(j)) for j in joints])) if enough else -1
        cost = float(np.abs(goal - here).max()) + path_rad(arc[: last or None])
        cost /= config.pace_rad
        if not enough:
            cost += 1000.0 * abs(float(joints[-1]) - self._pull.need)
        if self._pull.way_out:
            world_from_arm = invert_pose(collision.arm_from_world)
            points = arm_points_m(arc[last][None])[0][:-3]
            world = points @ world_from_arm[:3, :3].T + world_from_arm[:3, 3]
            out_m = np.linalg.norm(self.door.beside(world, 0.0), axis=1)
            short_m = np.maximum(self.door.edge_m + config.pad_m - out_m, 0.0)
            cost += config.way_out_steps * float(short_m.sum())
        else:
            cost += abs(float(joints[-1]) - self._pull.end) / config.swing_rad
        share = float((joints[-1] - joints[0]) / (self._pull.need - joints[0]))
        return Lead(goal=goal, arc=arc, joints=joints, enough=enough, share=share, cost=cost)


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
