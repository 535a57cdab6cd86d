"""Position errors of particles, relative to the size of their body (`Scene.sizes`).

There are two measures, and every reported number says which one it is. The largest distance of a particle
bounds the error of all of them; the root mean square is smoother, for programs that are compared at equal
error. Positions are (…, N, 3), sizes (N,) [m]; a position that is not finite is infinitely far.
"""

from __future__ import annotations

import math

import numpy as np


def largest_distance(positions: np.ndarray, others: np.ndarray, sizes: np.ndarray) -> float:
    """Return the largest distance of a particle from its position in ``others``, over its body's size [1]."""
    return float(_shares(positions, others, sizes).max())


def largest_distances(positions: np.ndarray, others: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the `largest_distance` [1] in each copy (n,), for positions (n, N, 3)."""
    return np.asarray(_shares(positions, others, sizes).max(axis=-1))


def rms_distance(positions: np.ndarray, others: np.ndarray, sizes: np.ndarray) -> float:
    """Return the root mean square of these distances, over the sizes of their bodies [1]."""
    return math.sqrt(np.square(_shares(positions, others, sizes)).mean())


def _shares(positions: np.ndarray, others: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):
        shares = np.linalg.norm(positions - others, axis=-1) / sizes
    return np.where(np.isfinite(shares), shares, np.inf)
