"""Batches of rows as numpy arrays, and their conversion to ManiSkill's tensors.

A control step runs about a hundred small operations, and numpy takes a third of torch's time for an
operation on one number. Snapshots, goals and measures therefore hold numpy arrays, with the rows as
the first dimension; tensors are made where an observation or `info` leaves the environment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

T = TypeVar("T")

Floats: TypeAlias = NDArray[np.floating[Any]]
"""Float32, but for a product of bools and a weight, which is float64."""
Bools: TypeAlias = NDArray[np.bool_]
Ints: TypeAlias = NDArray[np.int64]
Batch: TypeAlias = NDArray[Any]
"""Any of these, (N, ...)."""


def norm(x: Floats) -> Floats:
    """Returns the length of vectors (..., D), (...)."""
    return np.sqrt(np.einsum("...i,...i->...", x, x))


def angle_between(a: Floats, b: Floats) -> Floats:
    """Returns the absolute difference of angles [rad], between 0 and pi."""
    difference = abs(a - b) % (2 * np.pi)
    return np.minimum(difference, 2 * np.pi - difference)


def row_mask(count: int, rows: Sequence[int]) -> Bools:
    """Returns which of `count` rows are chosen, (N,)."""
    mask = np.zeros(count, dtype=bool)
    mask[list(rows)] = True
    return mask


def put_rows(values: Batch, rows: Sequence[int], new: Any) -> Batch:
    """Returns a copy of a batch (N, ...) with `new` (R, ...) in its rows (R,)."""
    changed = values.copy()
    changed[list(rows)] = new
    return changed


def of_row(batch: T, row: int) -> T:
    """Returns one row of a dataclass of batches, as batches of one."""
    names = [field.name for field in fields(cast(Any, batch))]
    return type(batch)(**{name: getattr(batch, name)[row : row + 1] for name in names})


def to_tensor(x: Batch) -> Tensor:
    """Copies a batch to a tensor; float64 becomes float32."""
    # Comparing dtype objects takes longer than the copy.
    return torch.from_numpy(x.astype(np.float32) if x.dtype.char == "d" else x.copy())


def to_tensors(values: Mapping[str, Batch]) -> dict[str, Tensor]:
    """Copies batches to tensors."""
    return {name: to_tensor(value) for name, value in values.items()}


def shared_tensor(x: Batch | Tensor) -> Tensor:
    """Returns a tensor that shares the memory of a batch of float32 or bool; others are copied."""
    if isinstance(x, Tensor):
        return x
    kind = x.dtype.char  # comparing dtype objects takes longer than the conversion
    return torch.from_numpy(x if kind in "f?" else x.astype(np.float32))
