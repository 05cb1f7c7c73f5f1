"""Batches of numbers: tensors, or numpy arrays for the one row of the CPU simulation.

A control step asks a hundred small questions, and a numpy operation on one number takes a third of
the time of torch's. So snapshots, goals and measures hold numpy arrays where the CPU simulates and
tensors on a GPU, always with the batch first. These functions take either kind and return the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor

Rows: TypeAlias = Any
"""A batch (N, ...): a tensor or a numpy array."""


def is_numpy(x: Rows) -> bool:
    """Whether a batch is a numpy array."""
    return isinstance(x, np.ndarray)


def where(condition: Rows, a: Any, b: Any) -> Rows:
    """Returns `a` where the condition holds and `b` elsewhere."""
    return np.where(condition, a, b) if is_numpy(condition) else torch.where(condition, a, b)


def norm(x: Rows) -> Rows:
    """Returns the length of vectors (..., D), (...)."""
    if is_numpy(x):
        return np.sqrt(np.einsum("...i,...i->...", x, x))
    return torch.linalg.vector_norm(x, dim=-1)


def stack(parts: Sequence[Rows], axis: int = 0) -> Rows:
    """Joins batches along a new axis."""
    return np.stack(parts, axis) if is_numpy(parts[0]) else torch.stack(tuple(parts), axis)


def concat(parts: Sequence[Rows], axis: int) -> Rows:
    """Joins batches along an axis."""
    return np.concatenate(parts, axis) if is_numpy(parts[0]) else torch.cat(tuple(parts), axis)


def sin(x: Rows) -> Rows:
    """Returns the sine of angles [rad]."""
    return np.sin(x) if is_numpy(x) else torch.sin(x)


def cos(x: Rows) -> Rows:
    """Returns the cosine of angles [rad]."""
    return np.cos(x) if is_numpy(x) else torch.cos(x)


def angle_between(a: Rows, b: Rows) -> Rows:
    """Returns the absolute difference of angles [rad], between 0 and pi."""
    difference = abs(a - b) % (2 * np.pi)
    return minimum(difference, 2 * np.pi - difference)


def minimum(a: Rows, b: Any) -> Rows:
    """Returns the smaller of a batch and a batch or number."""
    if is_numpy(a):
        return np.minimum(a, b)
    return torch.minimum(a, b) if isinstance(b, Tensor) else a.clamp(max=b)


def maximum(a: Rows, b: Any) -> Rows:
    """Returns the larger of a batch and a batch or number."""
    if is_numpy(a):
        return np.maximum(a, b)
    return torch.maximum(a, b) if isinstance(b, Tensor) else a.clamp(min=b)


def whole(x: Rows) -> Rows:
    """Returns numbers without their fractions, as integers."""
    return x.astype(np.int64) if is_numpy(x) else x.to(torch.long)


def zeros(*shape: int, like: Rows) -> Rows:
    """Returns zeros of the kind, type and device of a batch."""
    if is_numpy(like):
        return np.zeros(shape, dtype=like.dtype)
    return torch.zeros(*shape, dtype=like.dtype, device=like.device)


def rows_of(x: Rows, chosen: Sequence[int] | Tensor) -> Rows:
    """Returns which of the rows of `x` (N, ...) are among the chosen ones, (N,) bool."""
    numbers = chosen.tolist() if isinstance(chosen, Tensor) else list(chosen)
    mask = np.zeros(len(x), dtype=bool)
    mask[numbers] = True
    return mask if is_numpy(x) else torch.from_numpy(mask).to(x.device)


def to_tensor(x: Rows) -> Tensor:
    """Returns a batch as a tensor of its own; float64 becomes float32."""
    if not is_numpy(x):
        return x.clone()
    # Comparing whole dtypes takes longer than the copy.
    return torch.from_numpy(x.astype(np.float32) if x.dtype.char == "d" else x.copy())


def as_kind_of(value: Any, example: Rows) -> Rows:
    """Returns numbers as the kind, type and device of `example`."""
    if is_numpy(example):
        found = value.cpu().numpy() if isinstance(value, Tensor) else np.asarray(value)
        return found.astype(example.dtype)
    return torch.as_tensor(value, dtype=example.dtype, device=example.device)


def put_rows(values: Rows, rows: Sequence[int] | Tensor, new: Any) -> Rows:
    """Returns a copy of a batch (N, ...) with `new` (R, ...) in its rows (R,)."""
    numbers = rows.tolist() if isinstance(rows, Tensor) else list(rows)
    changed = values.copy() if is_numpy(values) else values.clone()
    changed[numbers] = as_kind_of(new, values)
    return changed


def to_info(parts: dict[str, dict[str, Rows]]) -> dict[str, dict[str, Tensor]]:
    """Returns dicts of batches (N,) as dicts of tensors, which share the arrays' memory."""
    return {
        part: {name: _shared(value) for name, value in values.items()}
        for part, values in parts.items()
    }


def _shared(value: Rows) -> Tensor:
    if not isinstance(value, np.ndarray):
        return value
    kind = value.dtype.char  # comparing whole dtypes takes longer than the conversion
    return torch.from_numpy(value if kind in _KEPT else value.astype(np.float32))


_KEPT = "f?"
"""Characters of float32 and bool."""
