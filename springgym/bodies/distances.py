"""How far particles are from where they should be, as a share of the size of their body (`Scene.sizes`).

There are two kinds, and each figure says which it is. The largest distance of a particle bounds the error of
all of them; the root mean square is smoother, for programs that are compared at equal error. Both are of each
copy, for positions (…, N, 3) and sizes (N,) [m], and infinite where a position is not finite.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def largest_distance(positions: np.ndarray, others: np.ndarray, sizes: np.ndarray) -> Any:
    """The largest distance of a particle."""
    return _finite(_shares(positions, others, sizes).max(axis=-1))


def rms_distance(positions: np.ndarray, others: np.ndarray, sizes: np.ndarray) -> Any:
    """Root mean square of the distances between particles."""
    with np.errstate(all="ignore"):
        return _finite(np.sqrt(np.square(_shares(positions, others, sizes)).mean(axis=-1)))


def _shares(positions: np.ndarray, others: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):
        return np.linalg.norm(positions - others, axis=-1) / sizes


def _finite(apart: np.ndarray) -> Any:
    return np.where(np.isfinite(apart), apart, np.inf)[()]
