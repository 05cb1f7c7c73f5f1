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


def phi_coefficient(both: int, only_a: int, only_b: int, neither: int) -> float:
    """Returns the correlation of paired outcomes, with Newcombe's continuity correction.

    Newcombe, Statistics in Medicine 17:2635, 1998, method 10.
    """
    product = (both + only_a) * (only_b + neither) * (both + only_b) * (only_a + neither)
    if product == 0:
        return 0.0
    concordant = both * neither - only_a * only_b
    n = both + only_a + only_b + neither
    corrected = max(concordant - n / 2, 0.0) if concordant > 0 else float(concordant)
    return corrected / math.sqrt(product)


def difference_interval(
    a: tuple[int, int], b: tuple[int, int], phi: float = 0.0
) -> tuple[float, tuple[float, float]]:
    """Returns the difference of two success rates, a minus b, and its 95 % interval.

    Newcombe's hybrid score method: Statistics in Medicine 17:873 (unpaired) and 17:2635 (paired),
    1998. Like Wilson's interval, it is not degenerate where all outcomes are equal.

    Args:
        a: Successes and episodes of the first.
        b: Of the second.
        phi: Correlation of paired outcomes, see `phi_coefficient`; 0 if the episodes are others.
    """
    (p_a, p_b), (low_a, high_a) = (a[0] / a[1], b[0] / b[1]), wilson_interval(*a)
    low_b, high_b = wilson_interval(*b)
    difference = p_a - p_b

    def width(one: float, other: float) -> float:
        return math.sqrt(max(one**2 - 2 * phi * one * other + other**2, 0.0))

    low = difference - width(p_a - low_a, high_b - p_b)
    return difference, (low, difference + width(high_a - p_a, p_b - low_b))


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
