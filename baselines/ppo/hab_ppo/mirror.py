"""Mirrored examples of policies with maps: a room with left and right exchanged is a room too."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from hab_ppo.examples import Examples
from hab_tasks.robots.control_modes import BASE_CELLS

POINT_Y = 2
"""Index of the point's y in the state: after ``is_holding`` and x."""

MIRRORED_CELLS = torch.tensor([BASE_CELLS.index((ahead, -turn)) for ahead, turn in BASE_CELLS])
"""Cell of ``base_discrete`` -> the one that turns to the other side."""


def mirrored(examples: Examples, chosen: Tensor) -> Examples:
    """Returns examples of a policy with `EnvConfig.map_memory`, some of them mirrored.

    Args:
        examples: The examples.
        chosen: (M,) bool, which steps are mirrored.
    """
    assert examples.images is not None
    state, images, actions = examples.state.clone(), examples.images.clone(), examples.actions
    state[chosen, POINT_Y] *= -1.0
    images[chosen] = images[chosen].flip(-1)
    actions = torch.where(chosen, MIRRORED_CELLS[actions], actions)
    return replace(examples, state=state, images=images, actions=actions)
