"""Fits the goal network to lessons."""

from __future__ import annotations

import math

import torch
from hab_ppo.precision import half_precision
from torch import Tensor, nn
from torch.nn.functional import cross_entropy

from hab_navigator.lessons import Lessons, goal_bins, turned_goals
from hab_navigator.network import GoalNetwork
from hab_navigator.views import inputs

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
