"""Estimates with their uncertainty: Wilson intervals for rates, bootstrap intervals for means."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Z95 = 1.959963984540054
"""97.5 % quantile of the standard normal distribution."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A mean over `n` episodes with its 95 % interval."""

    mean: float
    n: int
    ci95: tuple[float, float]


def wilson_interval(successes: int, n: int) -> tuple[float, float]:
    """Returns the 95 % Wilson score interval of a success rate.

    With p = successes / n:  (p + z^2/2n +- z sqrt(p(1-p)/n + z^2/4n^2)) / (1 + z^2/n).
    Unlike the normal interval it stays in [0, 1] and has width at p = 0 and p = 1.
    """
    if not 0 <= successes <= n or n == 0:
        raise ValueError(f"{successes} successes of {n} episodes is not a rate")
    p = successes / n
    scale = 1.0 + Z95**2 / n
    centre = (p + Z95**2 / (2 * n)) / scale
    half = Z95 * math.sqrt(p * (1 - p) / n + Z95**2 / (4 * n**2)) / scale
    low = 0.0 if successes == 0 else centre - half  # exact values, free of rounding
    high = 1.0 if successes == n else centre + half
    return low, high


def rate(outcomes: Sequence[bool]) -> Estimate:
    """Returns the share of true outcomes with its Wilson interval."""
    n, successes = len(outcomes), sum(outcomes)
    return Estimate(mean=successes / n, n=n, ci95=wilson_interval(successes, n))


def mean(values: Sequence[float]) -> float:
    """Returns the arithmetic mean; `math.fsum` makes it independent of the order."""
    return math.fsum(values) / len(values)


def bootstrap_mean(values: Sequence[float], *, seed: int = 0, resamples: int = 2000) -> Estimate:
    """Returns the mean with its percentile bootstrap interval, from a generator of its own."""
    data = np.asarray(values, dtype=np.float64)
    generator = np.random.default_rng(seed)
    picks = generator.integers(0, len(data), size=(resamples, len(data)))
    low, high = np.percentile(data[picks].mean(axis=1), [2.5, 97.5])
    return Estimate(mean=mean(values), n=len(data), ci95=(float(low), float(high)))
