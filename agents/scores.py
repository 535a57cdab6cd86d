"""Statistics over few seeds of several tasks, as Agarwal et al. (2021, arXiv:2108.13264) recommend.

A table of scores (seeds, tasks) belongs to one algorithm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

REPETITIONS = 2000
CONFIDENCE = 0.95

Statistic = Callable[[np.ndarray], float]
"""A function of scores (n,)."""


def interquartile_mean(scores: np.ndarray) -> float:
    """Return the mean of the middle half; values at its borders count by the part that is inside."""
    ordered = np.sort(np.ravel(scores))
    edges = np.arange(len(ordered) + 1) / len(ordered)
    inside = np.clip(np.minimum(edges[1:], 0.75) - np.maximum(edges[:-1], 0.25), 0.0, None)
    return float(np.sum(inside * ordered) / np.sum(inside))


def profile(scores: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Share of the runs that score more than each level."""
    return np.array([np.mean(np.ravel(scores) > level) for level in levels])


def interval(
    by_task: Sequence[np.ndarray], statistic: Statistic, repetitions: int = REPETITIONS
) -> tuple[float, float]:
    """Return the interval of a statistic of all scores over draws of seeds: percentiles of a bootstrap.

    It is stratified: for every task, as many of its own seeds (n,) are drawn as there are, with replacement.
    """
    rng = np.random.default_rng(0)
    values = [
        statistic(np.concatenate([scores[rng.integers(0, len(scores), len(scores))] for scores in by_task]))
        for _ in range(repetitions)
    ]
    return percentiles(values)


def interval_of_mean(
    means: np.ndarray, errors: np.ndarray, repetitions: int = REPETITIONS
) -> tuple[float, float]:
    """Return the interval of the mean of runs (n,), each the mean of episodes with a standard error (n,).

    Runs are drawn with replacement, and the mean of each from a normal distribution: many episodes stand for
    it. Of a single run, only the episodes count.
    """
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, len(means), (repetitions, len(means)))
    values = means[drawn] + errors[drawn] * rng.standard_normal(drawn.shape)
    return percentiles(values.mean(axis=1))


def percentiles(values: Sequence[float] | np.ndarray) -> tuple[float, float]:
    """Return the ends between which the middle of the values lies, as large a share as `CONFIDENCE`."""
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(values, (tail, 100 - tail))
    return float(low), float(high)
