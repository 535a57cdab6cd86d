"""Step-size control by Gustafsson's PI controller, for methods that estimate their error.

The next step is 0.9 e_n^(−3/16) e_(n−1)^(1/16) times this one, e the error in tolerances; these exponents
need only square roots.

Source: Gustafsson 1991, doi:10.1145/210232.210242.
"""

from __future__ import annotations

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number
from springgym.core.language.lanes import select, sqrt

SHRINK = 0.2
GROW = 5.0
SAFETY = 0.9

LEAST = 1e-4
"""Least error that is used [tolerances]."""


@compiled
def sixteenth_root(value: Number) -> Number:
    return sqrt(sqrt(sqrt(sqrt(value))))


@compiled
def next_step(tau: Number, error: Number, last_error: Number, rejections: Number) -> Number:
    """Return the step after one of ``tau`` seconds, between a fifth and five times as long.

    It is no longer than the last step where ``rejections``, of the last two steps, is more than 0.
    """
    root = sixteenth_root(error)
    change = SAFETY * sixteenth_root(last_error) / (root * root * root)
    change = select(change > SHRINK, change, SHRINK)  # also if it is NaN
    change = select(change < GROW, change, GROW)
    change = select(rejections > 0.0, select(change < 1.0, change, 1.0), change)
    return tau * change
