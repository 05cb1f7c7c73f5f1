"""What the arm can do to the fridge's door from the base poses around it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hab_spa.motion.robot import Robot
from hab_spa.planning.joint_goal import GoalConfig, sample_reaching_goals
from hab_spa.shapes import Array
from hab_spa.skills.fridge_arc import ArcConfig, Arcs, Lead, Pull, best_first
from hab_spa.skills.fridge_door import Door
from hab_spa.skills.fridge_tow import Free, tows
from hab_tasks.privileged import FrontState
from hab_tasks.robots.fetch_spec import REST_QPOS_RAD


@dataclass(frozen=True, kw_only=True)
class LeadConfig:
    """The numbers of looking for ways of leading the door.

    Attributes:
        resting_rad: An arm that is no farther from rest in any joint rests.
        rest_m: Clearance of the resting arm.
        around_m: The collision model has all within this of the shoulder in the middle of the
            places.
        glance, judging, doing: How the hand's ways to the handle are looked for at first sight,
            while places are compared, and where the robot stands at last.
        arc: How the handle's arc is followed.
    """

    resting_rad: float = 0.6
    rest_m: float = 0.005
    around_m: float = 2.2
    glance: GoalConfig = field(
        default_factory=lambda: GoalConfig(
            starts_per_point=20, round_starts=20, enough=10, goals=3, same_goal_rad=0.3
        )
    )
    judging: GoalConfig = field(
        default_factory=lambda: GoalConfig(
            starts_per_point=60, round_starts=60, enough=30, goals=8, same_goal_rad=0.2
        )
    )
    doing: GoalConfig = field(
        default_factory=lambda: GoalConfig(
            starts_per_point=300, round_starts=150, enough=120, goals=30, same_goal_rad=0.2
        )
    )
    arc: ArcConfig = field(default_factory=ArcConfig)


class Leads:
    """Looks for ways of leading a door as it is now, with one collision model for all places.

    Attributes:
        collision: That model; robot and door are moved in it.
    """

    def __init__(
        self,
        robot: Robot,
        front: FrontState,
        pull: Pull,
        free: Free,
        middle: Array,
        config: LeadConfig,
    ) -> None:
        """Builds the model.

        Args:
            robot: Whose arm.
            front: The door.
            pull: How it is to be moved.
            free: Where the base may go with the door.
            middle: Base pose (3,) in the middle of those that will be asked for.
            config: The numbers.
        """
        self._robot, self._front, self._pull = robot, front, pull
        self._free, self._config = free, config
        self._door = Door(front)
        self._arcs = Arcs(front, robot.kinematics, pull, config.arc)
        scene = robot.scene
        self.collision = scene.collision(base=middle, reach_m=config.around_m)
        # A door that closes gives way to a hand before it.
        self._yielding = (
            self.collision
            if pull.way_out
            else scene.collision(base=middle, without=front.body, reach_m=config.around_m)
        )

    def find(self, pose: Array | None, goal: GoalConfig) -> list[Lead]:
        """Returns what the arm can do at a base pose (3,), or where it is, the best first.

        The base goes along where the arm alone does not get all the way.

        Args:
            pose: Where the robot is thought to stand; None for where it is.
            goal: How the hand's ways to the handle are looked for.
        """
        scene = self._robot.scene
        base = self._robot.base if pose is None else pose
        self._stand_at(base)
        if pose is not None:
            self.collision.set_margin(self._config.rest_m)
            if not self.collision.is_free(scene.arm_qpos):
                return []
        goals = self._goals(goal)
        if not len(goals):
            return []
        standing = np.repeat(base[None, None], len(self._arcs.joints), axis=1)
        leads = best_first(self._along(goals, standing))
        if leads and leads[0].whole:
            return leads
        tow = self._config.arc.tow
        short = [not self._pull.all_the_way(float(joint)) for joint in self._arcs.joints]
        whole = min(1 + sum(short), len(short))
        moving = tows(base, self._arcs.joints, whole, self._door, self._free, tow)
        return best_first(leads + self._along(goals[: tow.goals], moving))

    def _stand_at(self, base: Array) -> None:
        """Puts the robot to a base pose (3,), and the door to where it is."""
        for model in (self.collision, self._yielding):
            model.stand_at(base)
            model.move(self._front.body, np.eye(4))

    def _goals(self, config: GoalConfig) -> Array:
        """Returns arm poses (G, 7) that take the handle."""
        robot, door = self._robot, self._door
        points_m = np.array([door.point(door.joint, *grasp) for grasp in self._pull.grasps_m])
        seed, here, arm = robot.next_seed(), robot.scene.arm_qpos, robot.kinematics
        goals = sample_reaching_goals(points_m, self.collision, arm, seed, config).goals
        if np.abs(here - REST_QPOS_RAD).max() > self._config.resting_rad:
            # A hand that has just led the door may go on with little motion.
            near = sample_reaching_goals(points_m, self.collision, arm, seed, config, here)
            goals = np.concatenate((goals, near.goals))
        return goals

    def _along(self, goals: Array, moving: Array) -> list[Lead]:
        """Returns the ways of leading the door from arm poses (G, 7), with the base (T, K, 3)."""
        arcs, here = self._arcs, self._robot.scene.arm_qpos
        if self._pull.way_out or not len(goals) or not len(moving):
            return arcs.leads(here, goals, self.collision, moving)
        self._stand_at(moving[0, 0])
        before = arcs.are_before(goals, self.collision)
        leads = arcs.leads(here, goals[~before], self.collision, moving)
        return leads + arcs.leads(here, goals[before], self._yielding, moving)
