"""Statistics of runs: against closed forms."""

import numpy as np
import pytest
import results


def test_interquartile_mean_is_the_trimmed_one_and_blind_to_outliers():
    values = np.random.default_rng(0).normal(size=40)
    assert results.interquartile_mean(values) == pytest.approx(np.sort(values)[10:30].mean())
    values[np.argmax(values)] = 1e9
    assert results.interquartile_mean(values) == pytest.approx(np.sort(values)[10:30].mean())


def test_values_at_the_borders_count_in_part():
    """The middle half of three: a quarter of the first, all of the second, a quarter of the third."""
    assert results.interquartile_mean(np.array([0.0, 1.0, 8.0])) == pytest.approx(
        (0.0 * 1 + 1 * 4 + 8 * 1) / 6
    )


def test_profile():
    np.testing.assert_allclose(
        results.profile(np.array([0.0, 0.5, 0.5, 1.0]), np.array([0.0, 0.4, 0.5, 1.0])),
        [0.75, 0.75, 0.25, 0.0],
    )


@pytest.mark.parametrize("runs", [1, 3, 400])
def test_interval_of_a_mean_of_runs_and_episodes(runs):
    """Of one run, ±1.96 times the error of its episodes; of many, the scatter of runs counts besides."""
    means = np.random.default_rng(0).normal(size=runs)
    low, high = results.interval_of_mean(means, np.full(runs, 0.5))
    half = 1.96 * np.hypot(means.std(), 0.5) / np.sqrt(runs)
    assert (low, high) == pytest.approx((means.mean() - half, means.mean() + half), abs=0.15 * half)
    assert results.interval_of_mean(np.ones(runs), np.zeros(runs)) == (1.0, 1.0)


def test_interval_is_that_of_the_mean_of_normal_scores():
    """±1.96 σ/√n for one task; none at all where all seeds agree, however tasks differ."""
    values = np.random.default_rng(0).normal(size=400)
    low, high = results.interval([values], lambda x: float(np.mean(x)))
    error = 1.96 * values.std() / 20
    assert low == pytest.approx(values.mean() - error, abs=0.15 * error)
    assert high == pytest.approx(values.mean() + error, abs=0.15 * error)
    assert results.interval([np.zeros(5), np.ones(5)], lambda x: float(np.mean(x))) == (0.5, 0.5)
