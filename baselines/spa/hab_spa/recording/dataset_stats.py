"""Feature statistics of a LeRobot dataset: minimum, maximum, mean and standard deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Stats:
    """Statistics of one feature.

    Attributes:
        least, largest, mean, deviation: Per entry, (n,); of images per channel, (C, 1, 1), of
            colour in [0, 1], of depth in mm.
        count: Number of frames.
    """

    least: Array
    largest: Array
    mean: Array
    deviation: Array
    count: int


def stats_of(values: NDArray[Any]) -> Stats:
    """Returns the statistics of a feature over frames, (T, n) or (T, H, W, C) uint8 or uint16."""
    over, shape = (0,), values.shape[1:]
    if values.ndim == 4:
        over, shape = (0, 1, 2), (values.shape[3], 1, 1)
    if values.dtype == np.uint8:
        values = values / 255.0
    numbers = values.astype(np.float64)
    least, largest = numbers.min(axis=over), numbers.max(axis=over)
    return Stats(
        least=least.reshape(shape),
        largest=largest.reshape(shape),
        mean=numbers.mean(axis=over).reshape(shape),
        deviation=numbers.std(axis=over).reshape(shape),
        count=len(values),
    )


def merge_stats(parts: Sequence[Stats]) -> Stats:
    """Merges the statistics of episodes."""
    counts = np.array([part.count for part in parts], dtype=np.float64)
    share = (counts / counts.sum()).reshape(-1, *[1] * parts[0].mean.ndim)
    means = np.stack([part.mean for part in parts])
    mean = (share * means).sum(axis=0)
    # Total variance: within the episodes, plus between their means.
    within = np.stack([part.deviation**2 for part in parts])
    variance = (share * (within + (means - mean) ** 2)).sum(axis=0)
    return Stats(
        least=np.min([part.least for part in parts], axis=0),
        largest=np.max([part.largest for part in parts], axis=0),
        mean=mean,
        deviation=np.sqrt(variance),
        count=int(counts.sum()),
    )


def nested(stats: Stats) -> dict[str, Any]:
    """Returns the statistics with LeRobot's names, as nested lists."""
    return {
        "min": stats.least.tolist(),
        "max": stats.largest.tolist(),
        "mean": stats.mean.tolist(),
        "std": stats.deviation.tolist(),
        "count": [stats.count],
    }
