"""Between planned skills: the arm comes to rest; an oracle or policy drives the base (S H.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from hab_eval.run.agents import load_agent
from hab_plans.belief import point_of
from hab_plans.executor import MotionLog
from hab_plans.motion import Failure, Motion
from hab_plans.protocols import BasePose, NavigationRequest
from hab_plans.stage import Stage

from hab_spa.motion.drive import DriveConfig, drive_to, leave
from hab_spa.motion.moves import rest
from hab_spa.motion.robot import Robot
from hab_spa.shapes import Array, invert_pose
from hab_spa.tasks.planned_skills import fold
from hab_tasks.agent import AgentSetup, AgentSpec, TargetFrame
from hab_tasks.constants import (
    NAVIGATE_HORIZON_STEPS,
    REST_RADIUS_M,
    SKILL_HORIZON_STEPS,
)
from hab_tasks.episodes.robot_start import in_base_frame
from hab_tasks.robots.control import BASE_CELLS, STOP_SHARE
from hab_tasks.skills.navigate import NAVIGATE_ID

ORACLES = ("oracle", "perfect")


@dataclass(frozen=True, kw_only=True)
class OracleNavigator:
    """Follows the shortest path on the ground-truth map, with the simulated base drive."""

    horizon_steps: int = NAVIGATE_HORIZON_STEPS

    def go(self, robot: Robot, request: NavigationRequest) -> Motion:
        """Drives to a base pose that was chosen with ground truth."""
        pose = request.choose_base_pose()
        if pose is None:
            return Failure.TARGET_PLAN
        yield from fold(robot, pose)
        return (yield from self.drive(robot, pose))

    def drive(self, robot: Robot, pose: BasePose) -> Motion:
        """Drives to a base pose, with the arm as it is."""
        robot.doing, config = "navigate", DriveConfig(turning_m=pose.turning_m)
        return (yield from drive_to(robot, robot.scene.floor_map(), pose.base, config))


class PolicyNavigator:
    """Drives with an agent of HabNavigate-v1 until its stop action.

    Attributes:
        spec: Spec of that agent.
    """

    horizon_steps = NAVIGATE_HORIZON_STEPS

    def __init__(self, reference: str, setup: AgentSetup) -> None:
        """Loads the agent.

        Args:
            reference: ``module:factory``.
            setup: Setup of the task's agent; only its option ``policy`` is passed on.

        Raises:
            HabError: The agent cannot be loaded.
        """
        options = {name: v for name, v in setup.options.items() if name == "policy"}
        self._agent = load_agent(reference, replace(setup, env_id=NAVIGATE_ID, options=options))
        self.spec: AgentSpec = self._agent.spec

    def go(self, robot: Robot, request: NavigationRequest) -> Motion:
        """Drives; returns `Failure.EXECUTION` if the agent does not stop in time."""
        robot.doing, point_m = "navigate by policy", point_of(robot.scene, request.stage)
        self._agent.reset(torch.ones(1, dtype=torch.bool), [robot.next_seed()])
        while robot.steps_left > 0:
            seen = observation(robot, point_m, self.spec.target_frame)
            share = self._share(self._agent.act(seen))
            yield robot.command(base=share)
            if max(abs(share[0]), abs(share[1])) <= STOP_SHARE:
                return None
        return Failure.EXECUTION

    def _share(self, action: torch.Tensor) -> tuple[float, float]:
        """Returns the base velocities of an action of one row, relative to their maximum."""
        if self.spec.control_mode == "base_discrete":
            return BASE_CELLS[int(action.reshape(-1)[0])]
        forward, turn = action.reshape(-1).tolist()
        return forward, turn


def observation(robot: Robot, point_m: Array, frame: TargetFrame) -> dict[str, Any]:
    """Returns HabNavigate-v1's observation of one row: images, `is_holding` and the target point.

    Args:
        robot: The robot.
        point_m: Target point (3,) in the world.
        frame: Frame of the point in the observation.
    """
    if frame == "ee":
        name, point = (
            "point_in_ee",
            (invert_pose(robot.world_from_ee) @ np.append(point_m, 1.0))[:3],
        )
    else:
        x, y, yaw = robot.base.tolist()
        name, point = "point_in_base", in_base_frame((x, y, yaw), point_m)
    return {
        **robot.obs,
        "agent": {"is_holding": torch.tensor([[float(robot.scene.holding)]])},
        "extra": {name: torch.tensor(point[None], dtype=torch.float32)},
    }


def navigator_of(setup: AgentSetup) -> OracleNavigator | PolicyNavigator:
    """Returns the navigator of the option ``navigation``: oracle, perfect or ``module:factory``.

    With ``perfect``, the agent's control mode is one of base poses.

    Raises:
        HabError: The agent ``module:factory`` cannot be loaded.
    """
    name = setup.options.get("navigation", "oracle")
    return OracleNavigator() if name in ORACLES else PolicyNavigator(name, setup)


@dataclass(frozen=True, eq=False)
class Folding:
    """Folds the arm of a robot with a scene model.

    Attributes:
        log: The robot's motions.
    """

    log: MotionLog[Robot]

    def prepare(self, stage: Stage, attempt: int) -> Motion:
        """Moves the arm to rest; backs off first if the arm has no room."""
        return fold_arm(self.log)

    def arrive(self, stage: Stage, request: NavigationRequest) -> Motion:
        """Does nothing."""
        yield from ()
        return None


def rests(robot: Robot) -> bool:
    """Returns whether the arm is at rest."""
    ee_m = robot.kinematics.ee_pose(robot.scene.arm_qpos)[:3, 3]
    return bool(np.linalg.norm(ee_m - robot.scene.robot.rest_position_m) < REST_RADIUS_M)


def fold_arm(log: MotionLog[Robot]) -> Motion:
    """Moves the arm to rest before driving; backs off first if the arm has no room."""
    robot = log.robot
    if rests(robot):
        return None
    failure = yield from log.timed("rest", rest(robot), SKILL_HORIZON_STEPS)
    if failure is None:
        return None
    yield from leave(robot, robot.scene.floor_map(), DriveConfig())
    return (yield from log.timed("rest", rest(robot), SKILL_HORIZON_STEPS))
