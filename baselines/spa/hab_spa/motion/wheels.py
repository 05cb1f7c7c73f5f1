"""Velocity commands of the base with limited acceleration, and detection of a stuck base."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from hab_plans.motion import Command

from hab_spa.motion.robot import Robot


@dataclass(frozen=True, kw_only=True)
class WheelsConfig:
    """Limits of the velocities, and thresholds of a stuck base.

    Attributes:
        way_share, turn_share: Maximum velocities, relative to the base's.
        ease: Maximum change of a relative velocity per step.
        still_m, still_rad, still_steps: The base is stuck when it has moved less than these
            thresholds in each of these steps.
    """

    way_share: float = 1.0
    turn_share: float = 1.0
    ease: float = 0.25
    still_m: float = 0.003
    still_rad: float = 0.01
    still_steps: int = 8


Config = TypeVar("Config", bound=WheelsConfig)


class Wheels(Generic[Config]):
    """Limits accelerations and detects a stuck base."""

    def __init__(self, robot: Robot, config: Config) -> None:
        self.robot, self.config = robot, config
        self._share, self._still, self._last = np.zeros(2), 0, robot.base

    @property
    def stuck(self) -> bool:
        """Whether the base is stuck, or no steps are left."""
        return self._still >= self.config.still_steps or self.robot.steps_left <= 0

    def free(self) -> None:
        """Resets the detection of a stuck base."""
        self._still = 0

    def roll(self, forward: float, turn: float) -> Command:
        """Returns the command nearest to these relative velocities, within the limits."""
        config, base = self.config, self.robot.base
        most = np.array((config.way_share, config.turn_share))
        wanted = np.clip((forward, turn), -most, most)
        self._share += np.clip(wanted - self._share, -config.ease, config.ease)
        distance_m = float(np.linalg.norm(base[:2] - self._last[:2]))
        moves = distance_m > config.still_m or abs(angle(base[2], self._last[2])) > config.still_rad
        self._still = 0 if moves else self._still + 1
        self._last = base
        return self.robot.command(base=(float(self._share[0]), float(self._share[1])))

    def stop(self) -> Generator[Command, None, None]:
        """Decelerates to a stop."""
        while np.abs(self._share).max() > 0:
            yield self.roll(0.0, 0.0)


def angle(to_rad: float, from_rad: float) -> float:
    """Returns the smallest turn [rad] from one heading to another."""
    return float((to_rad - from_rad + math.pi) % (2 * math.pi) - math.pi)
