"""The clock of the copies, set by the compiled call that advances them.

Python handles Ctrl-C when a compiled call returns, before the next line. A clock set in that line would miss
the steps of the call.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.core.compiler.decorators import compiled


class Clock(NamedTuple):
    """The times of all copies, and the step by which they advance."""

    time: np.ndarray
    """(copies,) time of each copy [s]"""
    step: float
    """h [s]"""
    width: int
    """number of copies in a block"""


@compiled
def tick(clock: Clock, block: int, steps: int) -> None:
    """Add the time of ``steps`` steps to the clock of a block."""
    for copy in range(block * clock.width, min((block + 1) * clock.width, clock.time.size)):
        clock.time[copy] += steps * clock.step
