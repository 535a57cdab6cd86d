"""Neighbour lists: features of bodies that are near each other, among which contacts are searched.

Row r of a list holds the r-th entry of each copy. A copy with fewer entries than others has `NO_ENTRY` there,
and the particles of another copy. So a list is as long as that of the copy with most entries, and a copy's
entries and their order do not depend on other copies.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike

from springgym.dynamics.arrays import allocate
from springgym.dynamics.records import Neighbours, Pairs

LISTED = 16
"""Capacity of the lists in rows, in units of all features of the scene: beyond it, lists are rebuilt at each
node."""

CANDIDATES_OF_A_ROW = 8
"""Capacity of the list of candidates, per row of the other lists: beyond it, all features are candidates."""


def new_lists(pairs: Pairs, particles: int, dtype: DTypeLike) -> Neighbours:
    """Return empty lists of the features of ``particles`` in all, on elements of ``dtype``."""
    shapes = pairs.shapes
    count = pairs.among
    features = np.diff(shapes.start, axis=1)
    of_pairs = features[:, pairs.first[:count]] + features[:, pairs.second[:count]]
    # space for the lists of all pairs, up to a limit, and at least for those of any one pair
    most = np.maximum(of_pairs.max(axis=1), np.minimum(of_pairs.sum(axis=1), LISTED * features.sum(axis=1)))
    vertices, triangles, edges = (int(n) + 1 for n in most)
    candidates = max(triangles, edges) + CANDIDATES_OF_A_ROW * (vertices + edges)
    extents = {
        "particles": particles,
        "bodies": len(shapes.radius),
        "pairs": count,
        "most": pairs.most,
        "V": vertices,
        "T": triangles,
        "E": edges,
    }
    return allocate(Neighbours, extents, dtype, candidate=np.arange(candidates))
