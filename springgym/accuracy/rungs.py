"""A method at a step or tolerance, ready to be run: springgym's own, or another program's."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

SAMPLES = 4
"""Times at which positions are taken: a quarter, half, three quarters and the end."""


class Rung(NamedTuple):
    """A method at a step or tolerance, ready to be run."""

    method: str
    step: float
    """h [s]; of an adaptive method, its tolerance"""
    run: Callable[[], tuple[np.ndarray, float, float]]
    """gives positions (samples, N, 3) [m], force evaluations per simulated second, wall time [s] of it"""
    begin: Callable[[], None]
    """puts it to its start"""
    piece: Callable[[float], tuple[Callable[[], object], float]]
    """of the wall time of the whole: a part to time, and how long it is in simulated time [s]"""
