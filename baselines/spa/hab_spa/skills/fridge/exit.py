"""Opening angle that frees a robot enclosed by the door that it has opened."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hab_spa.motion.robot import Robot
from hab_spa.skills.fridge.config import FridgeConfig


@dataclass(frozen=True, kw_only=True)
class ExitConfig:
    """Parameters of the search.

    Attributes:
        enclosed_m: A base farther than this from the room's free floor is enclosed.
        spacing_rad: Spacing of the joint positions searched.
        beyond_rad: Additional opening beyond the first joint position that frees the robot.
    """

    enclosed_m: float = 0.5
    spacing_rad: float = 0.1
    beyond_rad: float = 0.1


def wider(
    robot: Robot, number: int, config: FridgeConfig, exit_: ExitConfig
) -> FridgeConfig | None:
    """Returns the parameters for opening the door farther, so that the robot can leave.

    Returns:
        None if the robot is not enclosed, or if no joint position frees it.
    """
    if not _is_enclosed(robot, number, None, exit_):
        return None
    articulation = robot.scene.articulation(number)
    most = articulation.limits[1] - exit_.beyond_rad
    for joint in np.arange(
        articulation.joint + exit_.spacing_rad, most, exit_.spacing_rad
    ).tolist():
        if not _is_enclosed(robot, number, joint, exit_):
            opened = joint + exit_.beyond_rad / 2
            return replace(config, opened=opened, let_go=opened, open_to=joint + exit_.beyond_rad)
    return None


def _is_enclosed(robot: Robot, number: int, joint: float | None, config: ExitConfig) -> bool:
    """Whether the base is cut off from the room with the door at a joint position."""
    map_ = robot.scene.floor_map(None if joint is None else {number: joint})
    here_m = robot.base[:2]
    return float(np.linalg.norm(map_.nearest_free(here_m) - here_m)) > config.enclosed_m
