import pytest
from hab_eval.stats import bootstrap_mean, exact_mcnemar, mean, rate, wilson_interval


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


@pytest.mark.parametrize("n", [1, 7, 1000])
def test_wilson_interval_at_the_ends_is_exact_and_not_empty(n):
    assert wilson_interval(0, n)[0] == 0.0
    assert wilson_interval(n, n)[1] == 1.0
    # At p = 0 the upper bound is z^2/n / (1 + z^2/n) = z^2 / (n + z^2).
    assert wilson_interval(0, n)[1] == pytest.approx(3.841459 / (n + 3.841459), abs=1e-6)
    # Mirror image.
    assert wilson_interval(n, n)[0] == pytest.approx(1 - wilson_interval(0, n)[1])


@pytest.mark.parametrize(("successes", "n"), [(1, 0), (0, 0), (3, 2), (-1, 2)])
def test_wilson_interval_refuses_what_is_no_rate(successes, n):
    with pytest.raises(ValueError, match=f"{successes} successes of {n}"):
        wilson_interval(successes, n)


def test_rate_counts():
    estimate = rate([True, False, True, True])
    assert (estimate.mean, estimate.n) == (0.75, 4)
    assert estimate.ci95[0] < 0.75 < estimate.ci95[1]


def test_mean_does_not_depend_on_the_order():
    values = [1e16, 1.0, -1e16, 1.0]
    assert mean(values) == mean(values[::-1]) == 0.5


def test_bootstrap_has_its_own_generator_and_covers_the_mean():
    first, second = bootstrap_mean([1.0, 2.0, 4.0]), bootstrap_mean([1.0, 2.0, 4.0])
    assert first == second
    assert first.mean == pytest.approx(7 / 3)
    assert first.ci95[0] < first.mean < first.ci95[1]
    assert bootstrap_mean([3.0, 3.0]).ci95 == (3.0, 3.0)


@pytest.mark.parametrize(
    ("only_a", "only_b", "p_value"),
    [
        (0, 0, 1.0),
        (1, 0, 1.0),  # 2 * 1/2
        (5, 0, 0.0625),  # 2 * C(5,0) / 2^5 = 2/32
        (0, 6, 0.03125),  # 2 / 64
        (8, 2, 0.109375),  # 2 * (C(10,0) + C(10,1) + C(10,2)) / 2^10 = 2 * 56 / 1024
        (4, 4, 1.0),  # symmetric: every outcome is at least as extreme
    ],
)
def test_mcnemar_by_hand(only_a, only_b, p_value):
    assert exact_mcnemar(only_a, only_b) == pytest.approx(p_value)
    assert exact_mcnemar(only_b, only_a) == pytest.approx(p_value)


def test_mcnemar_needs_counts():
    with pytest.raises(ValueError, match="-1"):
        exact_mcnemar(-1, 2)
