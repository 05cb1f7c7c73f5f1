"""The goal network: where the goal pose may be, given the map around the target; its files.

Navigate's goal is a start pose of another skill; which one is not observed, but how such poses lie
to furniture, open doors and drawers can be learned. The network has the form of a U-Net (arXiv
1505.04597) and gives a logit for each cell of the map and each heading there.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import hab_ppo
import torch
from hab_ppo import checkpoint
from hab_ppo.checkpoint import PolicyFileError
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


NAVIGATOR = "navigator"
"""Name of the agent."""

WEIGHTS = "navigator.safetensors"
"""File of weights in a run's folder, and in the package."""

SHIPPED = Path(hab_ppo.__file__).parent / "navigation"
"""Submissions name the file there."""

KIND = "navigator"
"""Entry ``kind`` of the description of such a file."""


def save(path: Path, network: GoalNetwork, about: dict[str, Any]) -> None:
    """Writes a file of weights."""
    checkpoint.save(path, dict(network.state_dict()), about)


def load(path: Path) -> tuple[GoalNetwork, dict[str, Any]]:
    """Returns the network of a file, and the file's description.

    Raises:
        PolicyFileError: Not such a file.
    """
    tensors, about = checkpoint.load(path)
    network = GoalNetwork()
    shapes = {name: value.shape for name, value in network.state_dict().items()}
    if about.get("kind") != KIND or {n: v.shape for n, v in tensors.items()} != shapes:
        raise PolicyFileError(f"{path} is not a file of weights of this version's navigator.")
    network.load_state_dict(tensors)
    return network.eval(), about


def shipped_navigator() -> Path:
    """Returns the weights that ship."""
    return SHIPPED / WEIGHTS


def is_navigator(path: Path) -> bool:
    """Whether a file holds weights of a navigator.

    Raises:
        PolicyFileError: It is not a file of weights.
    """
    return checkpoint.load(path)[1].get("kind") == KIND


def is_run(folder: Path) -> bool:
    """Whether a folder is that of a navigator's run."""
    return (folder / WEIGHTS).is_file()


def ship(run: Path) -> Path:
    """Copies the weights of a run to the package; returns the file.

    Raises:
        PolicyFileError: The file cannot be used.
    """
    network, about = load(run / WEIGHTS)
    save(shipped_navigator(), network, about)
    return shipped_navigator()
