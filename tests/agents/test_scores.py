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


def row(algorithm, mean, steps=0, seconds=0.0, used=(), task=results.SUITE[0]):
    curve = [[100_000, 0.4 * seconds, 0.1, 0.0], [300_000, 0.8 * seconds, 0.3, 0.0]]
    own = {"algorithm": algorithm, "mean_return": mean, "steps": steps, "seconds": seconds, "used": used}
    return {**own, "task": task, "curve": curve}


def test_scores_are_shares_of_the_way_to_the_reference():
    """Scores at equal seconds are of a run's end, at equal steps of its curve; imitation stands apart."""
    references = [row("random", 0.1), row("classical", 0.5), row("planner", 0.7)]
    learned = [row("ppo", mean, 400_000, 602.0) for mean in (0.4, 0.7)]
    learned += [row("ppo", 0.5, 350_000, 600.0, ("imitation",)), row("sac", 0.9, 150_000, 300.0)]
    learned += [
        row("sac", 0.9, 400_000, 600.0, task=results.SUITE[1]),
        row("ppo", 0.9, 9, 9.0, task="Own-v0"),
    ]
    rows = references + learned
    first = results.SUITE[0]
    found = {name: own[first].tolist() for name, own in results.scores(rows, 1, 600.0).items()}
    assert found == {("ppo",): pytest.approx([0.5, 1.0]), ("ppo", "imitation"): pytest.approx([2 / 3])}
    found = {name: own[first].tolist() for name, own in results.scores(rows, 0, 200_000).items()}
    assert found == {("ppo",): pytest.approx([1 / 6, 1 / 6]), ("ppo", "imitation"): pytest.approx([1 / 6])}


@pytest.mark.parametrize(
    ("what", "at_its_end", "between"), [("success_rate", 0.7, 0.25), ("steps", 400_000, 200_000)]
)
def test_what_a_run_had_reached_after_a_budget(what, at_its_end, between):
    run = row("ppo", 0.4, 400_000, 600.0) | {"success_rate": 0.7}
    run["curve"] = [[100_000, 240.0, 0.1, 0.0], [300_000, 480.0, 0.3, 0.5]]
    assert results.reached(run, 1, 600.0, what) == at_its_end
    assert results.reached(run, 1, 360.0, what) == pytest.approx(between)
    assert results.reached(run, 1, 700.0, what) is None


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
