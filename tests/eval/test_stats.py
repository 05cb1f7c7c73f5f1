import tracemalloc

import numpy as np
import pytest
from hab_eval.records.stats import (
    bootstrap_mean,
    difference_interval,
    exact_mcnemar,
    mean,
    phi_coefficient,
    wilson_interval,
)


def test_wilson_interval_of_4_in_5_by_hand():
    # z^2 = 3.841459; p = 0.8; n = 5
    # scale  = 1 + 3.841459/5                 = 1.768292
    # centre = (0.8 + 3.841459/10) / scale    = 1.184146 / 1.768292 = 0.669655
    # root   = sqrt(0.8*0.2/5 + 3.841459/100) = sqrt(0.032 + 0.038415) = 0.265358
    # half   = 1.959964 * 0.265358 / scale    = 0.520092 / 1.768292 = 0.294121
    low, high = wilson_interval(4, 5)
    assert (low + high) / 2 == pytest.approx(0.669655, abs=1e-5)
    assert low == pytest.approx(0.375534, abs=1e-5)
    assert high == pytest.approx(0.963776, abs=1e-5)


def test_wilson_interval_at_the_ends_is_exact_and_not_empty():
    for n in (1, 1000):
        assert wilson_interval(0, n)[0] == 0.0
        assert wilson_interval(n, n)[1] == 1.0
        # At p = 0 the upper bound is z^2/n / (1 + z^2/n) = z^2 / (n + z^2).
        assert wilson_interval(0, n)[1] == pytest.approx(3.841459 / (n + 3.841459), abs=1e-6)
        # Mirror image.
        assert wilson_interval(n, n)[0] == pytest.approx(1 - wilson_interval(0, n)[1])
    for successes, n in ((0, 0), (3, 2), (-1, 2)):
        with pytest.raises(ValueError, match=f"{successes} successes of {n}"):
            wilson_interval(successes, n)


def test_the_interval_of_a_difference_is_newcombes():
    # Newcombe 1998, Statistics in Medicine 17:873, Table II (a): 56/70 - 48/80, method 10.
    difference, interval = difference_interval((56, 70), (48, 80))
    assert difference == pytest.approx(0.2)
    assert interval == pytest.approx((0.0524, 0.3339), abs=1e-4)
    # Paired: of 10, 6 both, 2 only a, 1 only b, 1 neither. 6*1 - 2*1 = 4 < 10/2: no correlation.
    assert phi_coefficient(6, 2, 1, 1) == 0.0
    # 40 both, 5, 5, 50: (2000 - 25 - 50) / sqrt(45 * 55 * 45 * 55) = 1925 / 2475.
    assert phi_coefficient(40, 5, 5, 50) == pytest.approx(1925 / 2475)
    # 5 both, 20, 25, 10: discordant pairs are not corrected; -450 / sqrt(25 * 35 * 30 * 30).
    assert phi_coefficient(5, 20, 25, 10) == pytest.approx(-450 / 787500**0.5)
    low, high = difference_interval((10, 10), (10, 10), phi_coefficient(10, 0, 0, 0))[1]
    assert low == -high < -0.25  # ten equal outcomes are no proof


def test_means():
    values = [1e16, 1.0, -1e16, 1.0]
    assert mean(values) == mean(values[::-1]) == 0.5  # whatever the order
    first = bootstrap_mean([1.0, 2.0, 4.0])
    assert bootstrap_mean([1.0, 2.0, 4.0]) == first
    assert first.mean == pytest.approx(7 / 3)
    assert first.ci95[0] < first.mean < first.ci95[1]
    assert bootstrap_mean([3.0, 3.0]).ci95 == (3.0, 3.0)


def test_a_bootstrap_in_parts_has_the_numbers_of_one_at_once():
    values = np.random.default_rng(1).normal(size=1501)
    picks = np.random.default_rng(0).integers(0, 1501, size=(2000, 1501))
    at_once = np.percentile(values[picks].mean(axis=1), [2.5, 97.5])
    assert bootstrap_mean(values.tolist()).ci95 == tuple(at_once)
    tracemalloc.start()
    bootstrap_mean(np.zeros(100_000).tolist(), resamples=100)
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()


def test_mcnemar_by_hand():
    for only_a, only_b, p_value in (
        (0, 0, 1.0),
        (5, 0, 0.0625),  # 2 * C(5,0) / 2^5 = 2/32
        (8, 2, 0.109375),  # 2 * (C(10,0) + C(10,1) + C(10,2)) / 2^10 = 2 * 56 / 1024
        (4, 4, 1.0),  # symmetric: every outcome is at least as extreme
    ):
        assert exact_mcnemar(only_a, only_b) == pytest.approx(p_value)
        assert exact_mcnemar(only_b, only_a) == pytest.approx(p_value)
    with pytest.raises(ValueError, match="-1"):
        exact_mcnemar(-1, 2)
