"""Looking around: the free arm is put where the head's camera does not see it (S App. D, SPA)."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np

from hab_spa.arm_plan import Ends, PlanConfig, plan_path
from hab_spa.moves import follow
from hab_spa.robot import Command, Robot
from hab_spa.seen_scene import SeenScene

ASIDE_RAD = (
    (-0.93, -1.22, 0.15, 0.75, -0.01, 2.16, -0.01),
    (-1.05, -1.22, -0.06, 0.84, -0.07, 2.16, -0.01),
    (-1.10, -1.22, 0.30, 0.48, 0.19, 2.16, -0.01),
)
"""Arm poses next to the resting one that leave the view of the head's camera free."""


@dataclass(frozen=True, kw_only=True)
class LookConfig:
    """The numbers of looking around.

    Attributes:
        every_steps: On its way the hand's camera looks this often.
        share: Of the time left that the arm's way may take.
        plan: Of this way; when it is not easily found, what is seen so far has to do.
    """

    every_steps: int = 5
    share: float = 0.2
    plan: PlanConfig = field(default_factory=lambda: PlanConfig(time_limit_s=1.0))


def look_around(
    robot: Robot, scene: SeenScene, config: LookConfig
) -> Generator[Command, None, None]:
    """Looks; then, with a free hand, moves the arm out of the picture and looks again."""
    robot.doing = "look"
    scene.look()
    if scene.holding:
        return
    collision, start = scene.collision(), scene.arm_qpos.copy()
    ends = [Ends(open=start, tight=np.array(aside)) for aside in ASIDE_RAD]
    result = plan_path(collision, robot.kinematics, ends, robot.next_seed(), config.plan)
    robot.spend("motion", result.seconds)
    if result.path is None:
        return
    for step, command in enumerate(follow(robot, result.path, config.share)):
        if step % config.every_steps == 0:
            scene.look()
        yield command
    scene.look()
