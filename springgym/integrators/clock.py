"""The clock of the copies, kept by the compiled call that moves them.

Python serves Ctrl-C when a compiled call returns, before its next line. A clock that is set there would miss
the steps of that call.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.core.compiling import compiled


class Clock(NamedTuple):
    """The times of all copies, and the step by which they advance."""

    time: np.ndarray
    """(copies,) [s]"""
    step: float
    """h [s]"""
    width: int
    """copies in a block"""


@compiled
def tick(clock: Clock, block: int, steps: int) -> None:
    """Count the steps that a block has taken."""
    for copy in range(block * clock.width, min((block + 1) * clock.width, clock.time.size)):
        clock.time[copy] += steps * clock.step
