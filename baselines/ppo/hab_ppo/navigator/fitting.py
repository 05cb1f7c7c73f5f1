"""Fits the goal network to lessons."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from hab_ppo.navigator.lessons import Lessons, goal_cells, turned_goals
from hab_ppo.navigator.network import MOST_ASIDE_RAD, GoalNetwork, Guess
from hab_ppo.navigator.views import inputs

BATCH = 128
LEARNING_RATE = 2e-3
WEIGHT_DECAY = 1e-4
HEADING_WEIGHT = 1.0


class Misfit(NamedTuple):
    """How wrong a network is.

    Attributes:
        place: Cross-entropy of the goal's cell [nat].
        heading_rad: Mean error of the heading there.
    """

    place: float
    heading_rad: float


def fit(network: GoalNetwork, lessons: Lessons, epochs: int, seed: int) -> Misfit:
    """Fits a network, on its device; every lesson is turned and mirrored anew in each epoch.

    Returns:
        The mean misfit of the last epoch.
    """
    device = next(network.parameters()).device
    lessons = lessons.to(device)
    count = len(lessons.goals)
    generator = torch.Generator().manual_seed(seed)
    optimizer = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    steps = epochs * math.ceil(count / BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, LEARNING_RATE, total_steps=steps)
    network.train()
    sums = torch.zeros(2, device=device)
    for _ in range(epochs):
        sums.zero_()
        for numbers in torch.randperm(count, generator=generator).split(BATCH):
            angles = 2 * math.pi * torch.rand(len(numbers), generator=generator)
            flips = torch.rand(len(numbers), generator=generator) < 0.5
            batch = lessons.chosen(numbers.to(device))
            place, heading = _losses(network, batch, angles.to(device), flips.to(device))
            optimizer.zero_grad()
            (place + HEADING_WEIGHT * heading).backward()
            nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimizer.step()
            schedule.step()
            sums += len(numbers) * torch.stack((place, heading)).detach()
    network.eval()
    place, heading = (sums / count).tolist()
    return Misfit(place, heading)


@torch.no_grad()
def misfit(network: GoalNetwork, lessons: Lessons) -> Misfit:
    """Returns the mean misfit of a network on lessons as they are."""
    device = next(network.parameters()).device
    sums = torch.zeros(2, device=device)
    for numbers in torch.arange(len(lessons.goals)).split(BATCH):
        batch = lessons.chosen(numbers).to(device)
        losses = _losses(network, batch, None, torch.zeros(len(numbers), device=device) > 0)
        sums += len(numbers) * torch.stack(losses)
    place, heading = (sums / len(lessons.goals)).tolist()
    return Misfit(place, heading)


def _losses(
    network: GoalNetwork, batch: Lessons, angles_rad: Tensor | None, flips: Tensor
) -> tuple[Tensor, Tensor]:
    """Returns the mean losses of place and heading."""
    seen = inputs(batch.view, angles_rad, flips)
    goals = batch.goals
    if angles_rad is not None:
        goals = turned_goals(goals, angles_rad, flips)
    with torch.autocast(seen.device.type, torch.bfloat16):
        guess: Guess = network(seen.contiguous(memory_format=torch.channels_last))
    cells = goal_cells(goals)
    place = cross_entropy(guess.logits.flatten(1), cells, reduction="none")
    aside_rad = guess.aside_rad.flatten(1).gather(1, cells[:, None])[:, 0]
    wanted_rad = goals[:, 2].clamp(-MOST_ASIDE_RAD, MOST_ASIDE_RAD)
    # A goal farther from the point than the network believes in has no finite loss.
    return place[place.isfinite()].mean(), (aside_rad - wanted_rad).abs().mean()
