"""The form in which an environment's own state leaves it, so that recorders and files can hold it.

ManiSkill's replay takes every entry of a recorded state for an array with rows and columns, as the
states of bodies are: plain numbers for each row, (N,), become one column, (N, 1).
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

State = dict[str, Any]
"""Nested names -> (N, ...) tensors."""


def with_columns(state: State) -> State:
    """Returns nested tensors (N, ...) with (N, 1) for each of (N,)."""
    return {
        name: with_columns(value)
        if isinstance(value, dict)
        else (value[:, None] if value.dim() == 1 else value)
        for name, value in state.items()
    }


def shaped_like(state: State, example: State, count: int, device: Any) -> State:
    """Returns what `with_columns` gave, or a recorder made of it, as tensors shaped as at first.

    Args:
        state: Tensors or arrays of `count` rows; of one row also without the first dimension.
        example: The present state (N, ...), before `with_columns`; other entries are left out.
        count: Number of rows in `state`.
        device: Where the tensors go.
    """
    result: State = {}
    for name, present in example.items():
        if isinstance(present, dict):
            result[name] = shaped_like(state[name], present, count, device)
        else:
            value: Tensor = torch.as_tensor(state[name], device=device)
            result[name] = value.reshape(count, *present.shape[1:])
    return result
