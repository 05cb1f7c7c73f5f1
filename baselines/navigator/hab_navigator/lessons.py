"""Lessons of the goal network, views of the map and where the goal was, and the fit to them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import torch
from hab_ppo.layers import half_precision
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from hab_navigator.navigator import Navigator
from hab_navigator.network import ASIDE_RAD, HEADINGS, GoalNetwork
from hab_navigator.robot_map import CELL_M, RobotMap
from hab_navigator.views import SIDE, View, inputs, middle_m
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


BATCH = 128
LEARNING_RATE = 2e-3
WEIGHT_DECAY = 1e-4


def fit(network: GoalNetwork, lessons: Lessons, epochs: int, seed: int) -> float:
    """Fits a network, on its device; every lesson is turned and mirrored anew in each epoch.

    Returns:
        The mean cross-entropy [nat] of the last epoch.
    """
    device = next(network.parameters()).device
    lessons = lessons.to(device)
    count = len(lessons.goals)
    generator = torch.Generator().manual_seed(seed)
    optimizer = torch.optim.AdamW(network.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    steps = epochs * math.ceil(count / BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, LEARNING_RATE, total_steps=steps)
    network.train()
    total = torch.zeros((), device=device)
    for _ in range(epochs):
        total.zero_()
        for numbers in torch.randperm(count, generator=generator).split(BATCH):
            angles = 2 * math.pi * torch.rand(len(numbers), generator=generator)
            flips = torch.rand(len(numbers), generator=generator) < 0.5
            batch = lessons.chosen(numbers.to(device))
            loss = _loss(network, batch, angles.to(device), flips.to(device))
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimizer.step()
            schedule.step()
            total += len(numbers) * loss.detach()
    network.eval()
    return float(total) / count


@torch.no_grad()
def misfit(network: GoalNetwork, lessons: Lessons) -> float:
    """Returns the mean cross-entropy [nat] of lessons as they are."""
    device = next(network.parameters()).device
    total, count = 0.0, len(lessons.goals)
    for numbers in torch.arange(count).split(BATCH):
        loss = _loss(network, lessons.chosen(numbers).to(device), None, None)
        total += len(numbers) * float(loss)
    return total / count


def _loss(
    network: GoalNetwork, batch: Lessons, angles_rad: Tensor | None, flips: Tensor | None
) -> Tensor:
    seen, goals = inputs(batch.view, angles_rad, flips), batch.goals
    if angles_rad is not None and flips is not None:
        goals = turned_goals(goals, angles_rad, flips)
    with half_precision(seen.device):
        logits = network(seen.contiguous(memory_format=torch.channels_last))
    losses = cross_entropy(logits.flatten(1), goal_bins(goals), reduction="none")
    # A goal farther from the point than the network believes in has no finite loss.
    return losses[losses.isfinite()].mean()
