"""The goal network: where the goal pose may be, given the map around the point to go to.

Navigate's goal is a start pose of another skill; which one is not observed, but how such poses lie
to furniture, open doors and drawers can be learned. The network has the form of a U-Net (arXiv
1505.04597) and gives a logit for each cell of the map and each heading there.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from hab_navigator.robot_map import CELL_M
from hab_navigator.views import CHANNELS, FACTS, SIDE

WIDTHS = (16, 32, 48, 64)
"""Channels at full resolution, and at each half of it."""

HIDDEN = 32
"""Units of the layer that reads the facts."""

FARTHEST_M = 2.6
"""Goals are no farther from the point."""

ASIDE_RAD = 0.4
HEADINGS = 7
"""Width [rad] and number of the bins of the heading at a goal, measured from the direction to the
point. The outer ones hold all that is farther aside."""


class GoalNetwork(nn.Module):
    """A U-Net.

    The facts scale and shift its features (FiLM, arXiv 1709.07871): as channels that are the same
    everywhere, they would not pass its normalisation.
    """

    _far: Tensor

    def __init__(self) -> None:
        super().__init__()
        widths = (CHANNELS, *WIDTHS)
        self.down = nn.ModuleList(
            _block(widths[k], widths[k + 1], stride=2 if k else 1) for k in range(len(WIDTHS))
        )
        self.up = nn.ModuleList(
            _block(WIDTHS[k] + WIDTHS[k + 1], WIDTHS[k]) for k in range(len(WIDTHS) - 1)
        )
        self.told = nn.ModuleList(nn.Linear(HIDDEN, 2 * WIDTHS[k]) for k in range(len(WIDTHS)))
        self.facts = nn.Sequential(nn.Linear(FACTS, HIDDEN), nn.ReLU())
        self.last = nn.Conv2d(WIDTHS[0], HEADINGS, 1)
        steps = (torch.arange(SIDE) - (SIDE - 1) / 2) * CELL_M
        far = steps[:, None].square() + steps[None].square() > FARTHEST_M**2
        self.register_buffer("_far", far, persistent=False)

    def forward(self, seen: Tensor) -> Tensor:
        """Returns logits (N, HEADINGS, SIDE, SIDE) for inputs (N, CHANNELS, SIDE, SIDE).

        They are those of a categorical distribution of the goal pose.
        """
        told = self.facts(seen[:, -FACTS:, 0, 0].float())
        passed: list[Tensor] = []
        x = seen
        for block, linear in zip(self.down, self.told, strict=True):
            scale, shift = linear(told)[:, :, None, None].to(x.dtype).chunk(2, dim=1)
            x = (1.0 + scale) * block(x) + shift
            passed.append(x)
        for level in range(len(WIDTHS) - 2, -1, -1):
            wide = interpolate(x, scale_factor=2.0, mode="nearest")
            x = self.up[level](torch.cat((passed[level], wide), dim=1))
        return self.last(x).float().masked_fill(self._far, -math.inf)


def _block(before: int, after: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(before, after, 3, stride, 1),
        nn.GroupNorm(4, after),
        nn.ReLU(inplace=True),
        nn.Conv2d(after, after, 3, 1, 1),
        nn.GroupNorm(4, after),
        nn.ReLU(inplace=True),
    )
