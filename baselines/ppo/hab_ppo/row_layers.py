"""Layers whose result for a row depends neither on the number of rows nor on the others.

A product of a few rows with a matrix is rounded otherwise than one of many, by 1e-7 on a CPU. Over
an episode such differences grow, and it would end otherwise beside other episodes than alone.
Products are therefore of a multiple of `ROWS` rows, unless gradients are needed.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

ROWS = 8
"""Products of a multiple of so many rows are rounded alike: measured on a CPU with AVX2."""


class RowLinear(nn.Linear):
    """A linear layer for inputs (N, F)."""

    def forward(self, input: Tensor) -> Tensor:
        """Returns the outputs (N, O)."""
        spare = -len(input) % ROWS
        if spare == 0 or torch.is_grad_enabled():
            return super().forward(input)
        return super().forward(functional.pad(input, (0, 0, 0, spare)))[: len(input)]


class RowEncoder(nn.Sequential):
    """Convolutions of images (N, C, H, W), and layers after them; one image is encoded twice."""

    def forward(self, input: Tensor) -> Tensor:
        """Returns the encodings (N, F)."""
        if len(input) > 1 or torch.is_grad_enabled():
            return super().forward(input)
        return super().forward(input.repeat(2, 1, 1, 1))[:1]
