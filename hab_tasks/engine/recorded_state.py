"""Conversion of an environment's state to a form that recorders and files can store.

ManiSkill's replay and its flat states expect every entry of a state to have rows and columns, like
the states of bodies. Scalars per row, (N,), become one column, (N, 1); several points, (N, P, 3),
become (N, 3 P). A flat state is float32, so larger numbers are split into words of 16 bits.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import torch
from torch import Tensor

from hab_tasks.errors import EpisodeError

WORD_BITS = 16

START_ITS_EPISODE = (
    "Start the episode of the state first: env.reset(seed=...) or "
    "env.reset(options={'episode': ...})."
)

State = dict[str, Any]
"""Nested names -> (N, ...) tensors."""


def with_columns(state: State) -> State:
    """Returns nested tensors (N, ...) with all dimensions but the first as columns, (N, C)."""
    return {
        name: with_columns(value)
        if isinstance(value, dict)
        else (value[:, None] if value.dim() == 1 else value.flatten(1))
        for name, value in state.items()
    }


def from_flat(flat: Any, example: State) -> State:
    """Inverts ManiSkill's `get_state`: returns nested tensors (1, C) of a state (1, D) or (D,).

    `example` is a state of the environment with its names, order and widths.

    Raises:
        EpisodeError: It is not as wide as the example, or of other bodies.
    """
    columns = torch.as_tensor(flat)
    columns = columns[None] if columns.dim() == 1 else columns
    widths = list(_widths(example))
    if columns.dim() != 2 or columns.shape[1] != sum(widths):
        found = tuple(columns.shape)
        raise EpisodeError(
            f"The flat state has the shape {found}; a row of the current episode has {sum(widths)} "
            f"numbers. {START_ITS_EPISODE}"
        )
    state = _filled(example, iter(columns.split(widths, dim=1)))
    present = example["hab"]["bodies"][:1]
    if (state["hab"]["bodies"] != present).any():
        raise EpisodeError(f"The flat state is of other furniture or objects. {START_ITS_EPISODE}")
    return state


def _widths(state: State) -> Iterator[int]:
    for value in state.values():
        yield from _widths(value) if isinstance(value, dict) else (value.shape[1],)


def _filled(example: State, parts: Iterator[Tensor]) -> State:
    return {
        name: _filled(value, parts) if isinstance(value, dict) else next(parts)
        for name, value in example.items()
    }


def words_of(numbers: Iterable[int], count: int) -> Tensor:
    """Splits integers of N rows into words, (N, count) int64, the lowest first."""
    mask = (1 << WORD_BITS) - 1
    return torch.tensor([[n >> WORD_BITS * i & mask for i in range(count)] for n in numbers])


def joined(words: Tensor) -> list[int]:
    """Inverts `words_of`."""
    rows = words.long().tolist()
    return [sum(word << WORD_BITS * i for i, word in enumerate(row)) for row in rows]


def shaped_like(state: State, example: State) -> State:
    """Inverts `with_columns`, also after a recorder has stored the state.

    The state of one row may lack the first dimension. `example` (1, ...) has the types to return;
    other entries are dropped.

    Raises:
        EpisodeError: An entry is missing or has another size, as in states of other versions.
    """
    result: State = {}
    for name, present in example.items():
        if name not in state:
            raise EpisodeError(
                f"The state has no {name!r}: it is of another environment, or of one with other "
                "options, or of another version of hab-tasks."
            )
        if isinstance(present, dict):
            result[name] = shaped_like(state[name], present)
        else:
            value = torch.as_tensor(state[name], dtype=present.dtype)
            if value.numel() != present.numel():
                raise EpisodeError(f"{name!r} of the state has another size. {START_ITS_EPISODE}")
            result[name] = value.reshape(present.shape)
    return result
