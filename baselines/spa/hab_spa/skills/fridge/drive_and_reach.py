"""A base maneuver during which the arm moves as well, which saves the steps of the shorter one."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from itertools import count

import numpy as np
from hab_plans.motion import Command

from hab_spa.motion.follow import time_path
from hab_spa.motion.robot import Robot
from hab_spa.planning.arm_plan import PlanConfig
from hab_spa.shapes import Array
from hab_spa.skills.fridge.maneuver import BaseManeuver, ManeuverConfig, drive


@dataclass(frozen=True, kw_only=True)
class TogetherConfig:
    """Parameters of moving base and arm at once.

    Attributes:
        pace: Pace of the arm.
        delays: Starts of the arm that are tried, as shares of its latest one.
        margin_m: Clearance of the arm ...
        early_steps: ... for a base that is up to so much earlier or later than expected.
        around_m: Radius of the collision model around the shoulder at the end of the maneuver.
    """

    pace: float = 2.0
    delays: tuple[float, ...] = (0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9)
    margin_m: float = 0.02
    early_steps: int = 4
    around_m: float = 2.2


def drive_and_reach(
    robot: Robot,
    maneuver: BaseManeuver,
    goals: Array,
    config: ManeuverConfig,
    plan: PlanConfig,
) -> Generator[Command, None, bool]:
    """Executes a maneuver while the arm moves to a goal, see `drive`.

    The arm stays where it is if it has no free way to a goal, and starts later if that is needed
    for its clearance.

    Args:
        robot: The robot.
        maneuver: The maneuver.
        goals: (G, J) arm poses that are free at its end.
        config: Parameters of the maneuver.
        plan: Parameters of the planner.
    """
    targets = _arm_targets(robot, maneuver, goals, plan, TogetherConfig())
    driving, through, number = drive(robot, maneuver, config), True, 0
    for number in count():
        if number < len(targets):
            robot.command(targets[number])  # which the drive's command keeps
        try:
            command = next(driving)
        except StopIteration as stop:
            through = stop.value
            break
        yield command
    if not through:
        robot.relax()
        return False
    for target in targets[number:]:
        yield robot.command(target)
    return True


def _arm_targets(
    robot: Robot, maneuver: BaseManeuver, goals: Array, plan: PlanConfig, config: TogetherConfig
) -> Array:
    """Returns targets (T, J), one per step from the start of the maneuver; none without a way."""
    bases = maneuver.poses(robot.spec.base_step_m, robot.spec.base_step_rad)  # one a step
    collision = robot.scene.collision(base=bases[-1], reach_m=config.around_m)
    path = robot.plan(goals, collision, plan).path
    start = robot.scene.arm_qpos
    if path is None:
        return np.zeros((0, len(start)))
    moving = time_path(path, robot.config.timing, config.pace)
    collision.set_margin(config.margin_m)
    for share in config.delays:
        delay = round(share * len(bases))
        targets = np.concatenate((np.repeat(start[None], delay, axis=0), moving))
        steps = np.arange(len(targets))[:, None] + np.array((-1, 0, 1)) * config.early_steps
        at = bases[np.clip(steps, 0, len(bases) - 1)].reshape(-1, 3)
        if collision.are_free(np.repeat(targets, 3, axis=0), at).all():
            return targets
    return np.zeros((0, len(start)))
