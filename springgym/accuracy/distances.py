"""How far particles are from where they should be, as a share of the body's size (`Body.size`).

There are two, and each figure says which it is. The largest distance of a particle bounds the error of all of
them; the root mean square is smoother, for programs that are compared at equal error.
"""

from __future__ import annotations

import math

import numpy as np

from springgym.bodies import Body


def largest_distance(positions: np.ndarray, others: np.ndarray, body: Body) -> float:
    """The largest distance of a particle, over the body's size; infinite if one is not finite."""
    with np.errstate(all="ignore"):
        apart = np.linalg.norm(positions - others, axis=-1).max() / body.size
    return float(apart) if np.isfinite(apart) else math.inf


def rms_distance(positions: np.ndarray, others: np.ndarray, body: Body) -> float:
    """Root mean square of the distances between particles, over the body's size."""
    return float(math.sqrt(np.square(positions - others).sum(axis=-1).mean()) / body.size)
