"""Estimates with their uncertainty: Wilson intervals for rates, bootstrap intervals for means."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

DRAWN_AT_ONCE = 1_000_000
"""Values drawn at once by the bootstrap: 16 MB of indices and values."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A mean over `n` episodes with its 95 % interval."""

    mean: float
    n: int
    ci95: tuple[float, float]


def wilson_interval(successes: int, n: int) -> tuple[float, float]:
    """Returns the 95 % Wilson score interval of a success rate.

    Unlike the normal interval, it stays within [0, 1] and is not degenerate at rates of 0 and 1.
    """
    if not 0 <= successes <= n or n == 0:
        raise ValueError(f"{successes} successes of {n} episodes is not a rate")
    interval = _binomtest(successes, n).proportion_ci(confidence_level=0.95, method="wilson")
    return float(interval.low), float(interval.high)


@functools.cache
def exact_mcnemar(only_a: int, only_b: int) -> float:
    """Returns the two-sided p-value of McNemar's exact test for paired outcomes.

    Under the hypothesis of equal success rates, an episode that only one of two agents solves is
    solved by either with probability 1/2.

    Args:
        only_a: Number of episodes that only the first agent solves.
        only_b: Number of episodes that only the second agent solves.
    """
    if only_a < 0 or only_b < 0:
        raise ValueError(f"{only_a} and {only_b} are not numbers of episodes")
    if only_a + only_b == 0:
        return 1.0
    return float(_binomtest(only_a, only_a + only_b).pvalue)


def _binomtest(successes: int, n: int) -> Any:
    """Returns SciPy's result for the hypothesis of a rate of 1/2."""
    from scipy.stats import binomtest  # takes a second, and results are read without it

    return binomtest(successes, n)


def rate(outcomes: Sequence[bool]) -> Estimate:
    """Returns the fraction of true outcomes with its Wilson interval."""
    n, successes = len(outcomes), sum(outcomes)
    return Estimate(mean=successes / n, n=n, ci95=wilson_interval(successes, n))


def mean(values: Sequence[float]) -> float:
    """Returns the arithmetic mean; with `math.fsum`, it does not depend on the order."""
    return math.fsum(values) / len(values)


def bootstrap_mean(values: Sequence[float], *, seed: int = 0, resamples: int = 2000) -> Estimate:
    """Returns the mean with its percentile bootstrap interval."""
    data = np.asarray(values, dtype=np.float64)
    generator = np.random.default_rng(seed)
    rows = max(1, DRAWN_AT_ONCE // len(data))
    means = np.empty(resamples)
    for first in range(0, resamples, rows):  # the same draws and sums as all at once
        part = means[first : first + rows]
        picks = generator.integers(0, len(data), size=(len(part), len(data)))
        part[:] = data[picks].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return Estimate(mean=mean(values), n=len(data), ci95=(float(low), float(high)))
