"""Conversion of an environment's state to a form that recorders and files can store.

ManiSkill's replay expects every entry of a recorded state to have rows and columns, like the states
of bodies. Scalars per row, (N,), become one column, (N, 1).
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

State = dict[str, Any]
"""Nested names -> (N, ...) tensors."""


def with_columns(state: State) -> State:
    """Returns nested tensors (N, ...) with every (N,) expanded to (N, 1)."""
    return {
        name: with_columns(value)
        if isinstance(value, dict)
        else (value[:, None] if value.dim() == 1 else value)
        for name, value in state.items()
    }


def shaped_like(state: State, example: State, count: int, device: Any) -> State:
    """Inverts `with_columns`, also after a recorder has stored the state.

    Args:
        state: Tensors or arrays of `count` rows; a single row may lack the first dimension.
        example: Current state (N, ...) before `with_columns`; other entries are dropped.
        count: Number of rows in `state`.
        device: Device of the returned tensors.
    """
    result: State = {}
    for name, present in example.items():
        if isinstance(present, dict):
            result[name] = shaped_like(state[name], present, count, device)
        else:
            value: Tensor = torch.as_tensor(state[name], device=device)
            result[name] = value.reshape(count, *present.shape[1:])
    return result
