"""Layers of the networks: an LSTM over rollouts, and products that do not depend on the batch.

Rollouts are split at episode starts into sequences, in the packed order of torch's
`PackedSequence`: the first steps of all sequences, then the second steps, and so on, longest
sequence first. Nothing is padded, and the LSTM runs over all sequences at once.

A product of a few rows with a matrix is rounded otherwise than one of many, by 1e-7 on a CPU. Over
an episode such differences grow, and it would end otherwise beside other episodes than alone.
Products are therefore of a multiple of `ROWS` rows, unless gradients are needed.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.rnn import PackedSequence

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


class Sequences(NamedTuple):
    """The Q sequences of a rollout of T steps in N rows.

    Attributes:
        order: (T N,) index of each packed step in the flattened (T, N) rollout.
        batch_sizes: (L,) number of sequences that have an l-th step, L the longest's length.
        row: (Q,) row of each sequence, longest first.
        continued: (Q,) bool, whether the sequence continues an earlier rollout.
        last: (Q,) bool, whether the sequence is the last of its row.
    """

    order: Tensor
    batch_sizes: Tensor
    row: Tensor
    continued: Tensor
    last: Tensor

    @classmethod
    def of(cls, starts: Tensor) -> Sequences:
        """Returns the sequences of `starts` (T, N) bool, true where an episode starts."""
        steps, rows = starts.shape
        begins = starts.clone()
        begins[0] = True
        row, first = begins.T.nonzero(as_tuple=True)  # row by row, in time order
        last_of_row = torch.cat((row[1:] != row[:-1], torch.ones(1, dtype=torch.bool)))
        following = torch.cat((first[1:], first[:1]))
        length = torch.where(last_of_row, steps, following) - first
        length, by_length = length.sort(descending=True, stable=True)
        row, first, last_of_row = row[by_length], first[by_length], last_of_row[by_length]
        time = torch.arange(int(length[0]))[:, None]  # (L, 1)
        exists = time < length  # (L, Q)
        order = ((first + time) * rows + row)[exists]
        continued = (first == 0) & ~starts[0, row]
        return cls(order, exists.sum(dim=1), row, continued, last_of_row)


def run_lstm(
    lstm: nn.LSTM, inputs: Tensor, starts: Tensor, memory: Tensor
) -> tuple[Tensor, Tensor]:
    """Runs an LSTM over a rollout; its state is zero at the start of each episode.

    Args:
        lstm: One layer.
        inputs: (T, N, F).
        starts: (T, N) bool.
        memory: (2, N, H) hidden and cell state before the rollout.

    Returns:
        Outputs (T, N, H), and the state (2, N, H) after the rollout.
    """
    steps, rows = starts.shape
    sequences = Sequences.of(starts.cpu())
    order, row = sequences.order.to(inputs.device), sequences.row.to(inputs.device)
    initial = memory[:, row] * sequences.continued.to(memory)[:, None]
    packed = PackedSequence(inputs.flatten(0, 1)[order], sequences.batch_sizes)
    hidden, cell = initial[:, None].contiguous()
    outputs, state = lstm(packed, (hidden, cell))
    unpacked = torch.empty_like(outputs.data).index_copy(0, order, outputs.data)
    last = sequences.last.to(inputs.device)
    after = torch.zeros_like(memory)
    # Autocast may give the state in bfloat16.
    after[:, row[last]] = torch.cat(state)[:, last].to(after)
    return unpacked.view(steps, rows, -1), after


def half_precision(device: torch.device, wanted: bool = True) -> torch.autocast:
    """Returns a context that computes layers in bfloat16 if that is `wanted` and not slower.

    A CPU with AMX fits images 2.5 times as fast with it; one that only has AVX2 takes seven to nine
    times as long, and an LSTM may fail.
    """
    enabled = wanted and has_bfloat16(device.type)
    return torch.autocast(device.type, torch.bfloat16, enabled=enabled)


@functools.cache
def has_bfloat16(device_type: str) -> bool:
    """Whether ``cpu`` or ``cuda`` has instructions for bfloat16."""
    if device_type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    return torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()
