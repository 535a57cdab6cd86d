"""How far particles are from where they should be, as a share of the body's size (`Body.size`).

There are two kinds, and each figure says which it is. The largest distance of a particle bounds the error of
all of them; the root mean square is smoother, for programs that are compared at equal error.
"""

from __future__ import annotations

import math

import numpy as np

from springgym.bodies.body import Body


def largest_distance(positions: np.ndarray, others: np.ndarray, body: Body) -> float:
    """The largest distance of a particle, over the body's size; infinite if one is not finite."""
    with np.errstate(all="ignore"):
        apart = np.linalg.norm(positions - others, axis=-1).max() / body.size
    return float(apart) if np.isfinite(apart) else math.inf


def rms_distance(positions: np.ndarray, others: np.ndarray, body: Body) -> float:
    """Root mean square of the distances between particles, over the body's size."""
    return float(math.sqrt(np.square(positions - others).sum(axis=-1).mean()) / body.size)


def rms_distances(positions: np.ndarray, others: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """The same of each copy (n,), for positions (n, N, 3); infinite where one is not finite.

    ``sizes`` (N,) [m] are those of the bodies that the particles are of.
    """
    with np.errstate(all="ignore"):
        apart = np.sqrt(np.square((positions - others) / sizes[:, None]).sum(axis=-1).mean(axis=-1))
    apart[~np.isfinite(apart)] = math.inf
    return apart
