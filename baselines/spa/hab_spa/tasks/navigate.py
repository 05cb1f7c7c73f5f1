"""The ways to come to where a skill can be done: oracle, teleport, a policy (S H.2, Navigate)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from hab_eval.load_agent import load_agent

from hab_spa.motion.drive import DriveConfig, drive_to
from hab_spa.motion.moves import wait
from hab_spa.motion.robot import Motion, Robot
from hab_spa.results import Failure
from hab_spa.shapes import Array, invert_pose
from hab_spa.tasks.standing import Standing, fold
from hab_tasks.agent import AgentSetup, AgentSpec, TargetFrame
from hab_tasks.episodes.robot_start import in_base_frame
from hab_tasks.navigation import NavigationMap
from hab_tasks.robots.control import BASE_CELLS, STOP_SHARE

SETTLE_STEPS = 3
NAVIGATE_ID = "HabNavigate-v1"


@dataclass(frozen=True, kw_only=True, eq=False)
class Errand:
    """Where to go.

    Attributes:
        point_m: (3,) what is to be reached from there, in the world.
        map: The true floor.
        place: Chooses where to stand to reach it; None if there is nowhere. It knows more than
            the robot may; a learned policy does without.
    """

    point_m: Array
    map: NavigationMap
    place: Callable[[], Standing | None]


Navigator = Callable[[Robot, Errand], Motion]


def oracle(robot: Robot, errand: Errand) -> Motion:
    """Follows the shortest way on the true floor, with the physics of the real base."""
    standing = errand.place()
    if standing is None:
        return Failure.TARGET_PLAN
    yield from fold(robot, standing)
    robot.doing = "navigate"
    return (yield from drive_to(robot, errand.map, standing.base, DriveConfig()))


def teleport(robot: Robot, errand: Errand) -> Motion:
    """Is there at once; needs a control mode that can set the base's pose."""
    standing = errand.place()
    if standing is None:
        return Failure.TARGET_PLAN
    yield from fold(robot, standing)
    robot.doing = "teleport"
    yield robot.command(pose=standing.base)
    yield from wait(robot, SETTLE_STEPS)
    return None


class PolicyNavigator:
    """Lets an agent of HabNavigate-v1 drive until it calls the stop action.

    Attributes:
        spec: What that agent needs.
    """

    def __init__(self, reference: str, setup: AgentSetup) -> None:
        """Loads the agent.

        Args:
            reference: ``module:factory``.
            setup: The task's; of its options, ``policy`` is handed on.

        Raises:
            HabError: There is no such agent.
        """
        options = {name: v for name, v in setup.options.items() if name == "policy"}
        self._agent = load_agent(reference, replace(setup, env_id=NAVIGATE_ID, options=options))
        self.spec: AgentSpec = self._agent.spec

    def __call__(self, robot: Robot, errand: Errand) -> Motion:
        """Drives; it is `Failure.EXECUTION` when the agent has not stopped in time."""
        robot.doing = "navigate by policy"
        self._agent.reset(torch.ones(1, dtype=torch.bool), [robot.next_seed()])
        while robot.steps_left > 0:
            share = self._share(
                self._agent.act(observation(robot, errand.point_m, self.spec.target_frame))
            )
            yield robot.command(base=share)
            if max(abs(share[0]), abs(share[1])) <= STOP_SHARE:
                return None
        return Failure.EXECUTION

    def _share(self, action: torch.Tensor) -> tuple[float, float]:
        """Returns the base's velocities, as shares, of an action of one row."""
        if self.spec.control_mode == "base_discrete":
            return BASE_CELLS[int(action.reshape(-1)[0])]
        forward, turn = action.reshape(-1).tolist()
        return forward, turn


def observation(robot: Robot, point_m: Array, frame: TargetFrame) -> dict[str, Any]:
    """Returns Navigate's observation of one row: images as they are, and the point in question.

    Args:
        robot: Whose observation it is.
        point_m: (3,) in the world.
        frame: In which frame the agent wants it.
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


def navigator_of(setup: AgentSetup) -> Navigator:
    """Returns what the option ``navigation`` asks for: oracle, teleport, or ``module:factory``.

    Raises:
        HabError: There is no such way to navigate.
    """
    name = setup.options.get("navigation", "oracle")
    return NAVIGATORS[name] if name in NAVIGATORS else PolicyNavigator(name, setup)


NAVIGATORS: dict[str, Navigator] = {"oracle": oracle, "teleport": teleport}
"""Option ``navigation`` -> how the robot gets about."""
