"""Array operations on tensors or, in the CPU simulation with its single row, numpy arrays.

A control step runs about a hundred small operations, and numpy takes a third of torch's time for an
operation on one number. Snapshots, goals and measures therefore hold numpy arrays in CPU simulation
and tensors on a GPU, always with the batch dimension first. These functions accept either type and
return the same type.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor

BatchArray: TypeAlias = Any
"""A batch (N, ...): a tensor or a numpy array."""


def is_numpy(x: BatchArray) -> bool:
    """Whether a batch is a numpy array."""
    return isinstance(x, np.ndarray)


def where(condition: BatchArray, a: Any, b: Any) -> BatchArray:
    """Returns `a` where the condition holds and `b` elsewhere."""
    return np.where(condition, a, b) if is_numpy(condition) else torch.where(condition, a, b)


def norm(x: BatchArray) -> BatchArray:
    """Returns the length of vectors (..., D), (...)."""
    if is_numpy(x):
        return np.sqrt(np.einsum("...i,...i->...", x, x))
    return torch.linalg.vector_norm(x, dim=-1)


def stack(parts: Sequence[BatchArray], axis: int = 0) -> BatchArray:
    """Joins batches along a new axis."""
    if not is_numpy(parts[0]):
        return torch.stack(tuple(parts), axis)
    return np.stack(parts, axis) if axis else np.array(parts)  # in a third of the time


def concat(parts: Sequence[BatchArray], axis: int) -> BatchArray:
    """Joins batches along an axis."""
    return np.concatenate(parts, axis) if is_numpy(parts[0]) else torch.cat(tuple(parts), axis)


def sin(x: BatchArray) -> BatchArray:
    """Returns the sine of angles [rad]."""
    return np.sin(x) if is_numpy(x) else torch.sin(x)


def cos(x: BatchArray) -> BatchArray:
    """Returns the cosine of angles [rad]."""
    return np.cos(x) if is_numpy(x) else torch.cos(x)


def angle_between(a: BatchArray, b: BatchArray) -> BatchArray:
    """Returns the absolute difference of angles [rad], between 0 and pi."""
    difference = abs(a - b) % (2 * np.pi)
    return minimum(difference, 2 * np.pi - difference)


def minimum(a: BatchArray, b: Any) -> BatchArray:
    """Returns the smaller of a batch and a batch or number."""
    if is_numpy(a):
        return np.minimum(a, b)
    return torch.minimum(a, b) if isinstance(b, Tensor) else a.clamp(max=b)


def maximum(a: BatchArray, b: Any) -> BatchArray:
    """Returns the larger of a batch and a batch or number."""
    if is_numpy(a):
        return np.maximum(a, b)
    return torch.maximum(a, b) if isinstance(b, Tensor) else a.clamp(min=b)


def whole(x: BatchArray) -> BatchArray:
    """Truncates to int64."""
    return x.astype(np.int64) if is_numpy(x) else x.to(torch.long)


def zeros(*shape: int, like: BatchArray) -> BatchArray:
    """Returns zeros with the array type, dtype and device of a batch."""
    if is_numpy(like):
        return np.zeros(shape, dtype=like.dtype)
    return torch.zeros(*shape, dtype=like.dtype, device=like.device)


def rows_of(x: BatchArray, chosen: Sequence[int] | Tensor) -> BatchArray:
    """Returns a mask of the chosen rows of `x` (N, ...), (N,) bool."""
    numbers = chosen.tolist() if isinstance(chosen, Tensor) else list(chosen)
    mask = np.zeros(len(x), dtype=bool)
    mask[numbers] = True
    return mask if is_numpy(x) else torch.from_numpy(mask).to(x.device)


def to_tensor(x: BatchArray) -> Tensor:
    """Copies a batch to a tensor; float64 becomes float32."""
    if not is_numpy(x):
        return x.clone()
    # Comparing dtype objects takes longer than the copy.
    return torch.from_numpy(x.astype(np.float32) if x.dtype.char == "d" else x.copy())


def as_kind_of(value: Any, example: BatchArray) -> BatchArray:
    """Converts values to the array type, dtype and device of `example`."""
    if is_numpy(example):
        found = value.cpu().numpy() if isinstance(value, Tensor) else np.asarray(value)
        return found.astype(example.dtype)
    return torch.as_tensor(value, dtype=example.dtype, device=example.device)


def put_rows(values: BatchArray, rows: Sequence[int] | Tensor, new: Any) -> BatchArray:
    """Returns a copy of a batch (N, ...) with `new` (R, ...) in its rows (R,)."""
    numbers = rows.tolist() if isinstance(rows, Tensor) else list(rows)
    changed = values.copy() if is_numpy(values) else values.clone()
    changed[numbers] = as_kind_of(new, values)
    return changed


def to_info(parts: dict[str, dict[str, BatchArray]]) -> dict[str, dict[str, Tensor]]:
    """Converts dicts of batches (N,) to dicts of tensors that share the arrays' memory."""
    return {
        part: {name: _shared(value) for name, value in values.items()}
        for part, values in parts.items()
    }


def _shared(value: BatchArray) -> Tensor:
    if not isinstance(value, np.ndarray):
        return value
    kind = value.dtype.char  # comparing dtype objects takes longer than the conversion
    return torch.from_numpy(value if kind in _KEPT else value.astype(np.float32))


_KEPT = "f?"
"""Characters of float32 and bool."""
