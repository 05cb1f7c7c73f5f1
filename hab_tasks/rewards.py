"""Reward terms shared by skills: each a named summand of the paper's equations."""

from __future__ import annotations

import torch
from torch import Tensor


def force_penalty(force_n: Tensor, weight: float, cap: float) -> Tensor:
    """Returns -min(weight * C_t, cap), (N,).

    The paper prints ``- max(0.001 C_t, 1.0)``; a penalty that is never below 1 rewards hitting
    things, and Habitat's code takes the minimum (docs/deviations.md).
    """
    return -(weight * force_n).clamp(max=cap)


def total(terms: dict[str, Tensor]) -> Tensor:
    """Returns the sum of the terms, (N,)."""
    return torch.stack(tuple(terms.values())).sum(dim=0)
