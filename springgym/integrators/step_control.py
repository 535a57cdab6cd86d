"""Gustafsson's PI control chooses the length of the next step, for methods that estimate their error.

The next step is 0.9 e_n^(−3/16) e_(n−1)^(1/16) times this one, e the error in tolerances: exponents that need
square roots only.

Source: Gustafsson 1991, doi:10.1145/210232.210242.
"""

from __future__ import annotations

from springgym.core.compiling import compiled
from springgym.core.kinds import Number
from springgym.core.lanes import select, sqrt

SHRINK, GROW, SAFETY = 0.2, 5.0, 0.9

LEAST = 1e-4
"""Smaller errors count as this one [tolerances]."""


@compiled
def sixteenth_root(value: Number) -> Number:
    return sqrt(sqrt(sqrt(sqrt(value))))


@compiled
def next_step(tau: Number, error: Number, last_error: Number, rejections: Number) -> Number:
    """Return the step after one of ``tau`` seconds, at least a fifth and at most five times as long.

    It is no longer than the last where that, or the one before, was rejected: ``rejections`` of the two.
    """
    root = sixteenth_root(error)
    change = SAFETY * sixteenth_root(last_error) / (root * root * root)
    change = select(change > SHRINK, change, SHRINK)  # also where it is not a number
    change = select(change < GROW, change, GROW)
    change = select(rejections > 0.0, select(change < 1.0, change, 1.0), change)
    return tau * change
