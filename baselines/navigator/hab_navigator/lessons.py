"""Lessons of the goal network: views of the map on the way, and where the goal was."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor

from hab_navigator.navigator import Navigator
from hab_navigator.network import ASIDE_RAD, HEADINGS
from hab_navigator.robot_map import CELL_M, RobotMap
from hab_navigator.views import SIDE, View, middle_m
from hab_tasks.privileged import Array


class Lessons(NamedTuple):
    """N views with their goals.

    Attributes:
        view: The views.
        goals: (N, 3) float32 x, y [m] of the goal from the middle of the view, and its heading
            [rad] from the direction to the point.
    """

    view: View
    goals: Tensor

    @classmethod
    def of(cls, navigator: Navigator, height_m: float, holding: bool, goal: Array) -> Lessons:
        """Returns one lesson; `goal` is the goal pose (3,) in the map's frame."""
        return cls(navigator.view(height_m, holding), from_middle(navigator.map, goal)[None])

    @classmethod
    def joined(cls, several: list[Lessons]) -> Lessons:
        """Returns several lessons in one."""
        maps = torch.cat([one.view.maps for one in several])
        view = View(maps, torch.cat([one.view.facts for one in several]))
        return cls(view, torch.cat([one.goals for one in several]))

    def chosen(self, numbers: Tensor) -> Lessons:
        """Returns some of them, by their numbers (K,)."""
        view = View(self.view.maps[numbers], self.view.facts[numbers])
        return Lessons(view, self.goals[numbers])

    def to(self, device: torch.device | str) -> Lessons:
        """Returns them on a device."""
        view = View(self.view.maps.to(device), self.view.facts.to(device))
        return Lessons(view, self.goals.to(device))

    def tensors(self) -> dict[str, Tensor]:
        """Returns the tensors by name."""
        return {"maps": self.view.maps, "facts": self.view.facts, "goals": self.goals}

    @classmethod
    def of_tensors(cls, tensors: Mapping[str, Tensor]) -> Lessons:
        """Returns the lessons in what `tensors` returned."""
        return cls(View(tensors["maps"], tensors["facts"]), tensors["goals"])


def from_middle(map_: RobotMap, goal: Array) -> Tensor:
    """Returns a goal (3,) in the map's frame as `Lessons.goals` has it."""
    x, y = goal[:2] - middle_m(map_)
    ahead = map_.point_m - goal[:2]
    aside = math.remainder(goal[2] - math.atan2(ahead[1], ahead[0]), 2 * math.pi)
    return torch.tensor((x, y, aside), dtype=torch.float32)


def goal_bins(goals: Tensor) -> Tensor:
    """Returns the bins (N,) of a flat distribution (HEADINGS, SIDE, SIDE) for goals (N, 3)."""
    cells = ((goals[:, :2] / CELL_M).floor().long() + SIDE // 2).clamp(0, SIDE - 1)
    headings = ((goals[:, 2] / ASIDE_RAD).round().long() + HEADINGS // 2).clamp(0, HEADINGS - 1)
    return (headings * SIDE + cells[:, 0]) * SIDE + cells[:, 1]


def turned_goals(goals: Tensor, angles_rad: Tensor, flips: Tensor) -> Tensor:
    """Returns goals in views that were turned and mirrored as `views.inputs` does it."""
    cosine, sine = angles_rad.cos(), angles_rad.sin()
    x = cosine * goals[:, 0] - sine * goals[:, 1]
    y = sine * goals[:, 0] + cosine * goals[:, 1]
    sign = torch.where(flips, -1.0, 1.0)
    return torch.stack((x, sign * y, sign * goals[:, 2]), dim=1)
