"""Neighbour lists: features of bodies that are near each other, among which contacts are searched.

Row r of a list holds the r-th entry of each copy. A copy with fewer entries than others has `NO_ENTRY` there, and
the particles of another copy. So a list is as long as that of the copy with most entries, and a copy's
entries and their order do not depend on other copies.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from springgym.core.language.blocks import aligned_zeros
from springgym.dynamics.records import Neighbours, Pairs

LISTED = 16
"""Capacity of the lists in rows, in units of all features of the scene: beyond it, lists are rebuilt at each
node."""

CANDIDATES_OF_A_ROW = 8
"""Capacity of the list of candidates, per row of the other lists: beyond it, all features are candidates."""


def new_lists(pairs: Pairs, particles: int, dtype: DTypeLike) -> Neighbours:
    """Return empty lists of the features of ``particles`` in all, on elements of ``dtype``."""
    shapes = pairs.shapes
    bodies = len(shapes.radius)
    count = pairs.among
    features = np.diff(shapes.start, axis=1)
    of_pairs = features[:, pairs.first[:count]] + features[:, pairs.second[:count]]
    # space for the lists of all pairs, up to a limit, and at least for those of any one pair
    most = np.maximum(of_pairs.max(axis=1), np.minimum(of_pairs.sum(axis=1), LISTED * features.sum(axis=1)))
    vertices, triangles, edges = (int(n) + 1 for n in most)
    candidates = max(triangles, edges) + CANDIDATES_OF_A_ROW * (vertices + edges)

    of_copies: tuple[tuple[Any, ...], ...] = (
        ("origin shift", particles, 3),
        ("along", particles),
        ("moved bend turning margin ahead travelled", bodies),
        ("mean_shift mean low high", bodies, 3),
        ("listed gap nearest reach", count),
        ("vertex vertex_particle", vertices),
        ("point", vertices, 3),
        ("triangle square", triangles),
        ("triangle_particles", 3 * triangles),
        ("corner first second normal products sizes", triangles, 3),
        ("edge", edges),
        ("edge_particles", 2 * edges),
        ("start way", edges, 3),
        ("crossed crossing", pairs.most),
    )
    numbers = {"watched": count, "close": count, "used": 4, "length": 2}
    ends = {"ends": (count, 3, 3), "faces": (vertices, 2), "partners": (edges, 2)}
    return Neighbours(
        **{name: aligned_zeros(tuple(shape), dtype) for names, *shape in of_copies for name in names.split()},
        **{name: np.zeros(shape, np.int64) for name, shape in (numbers | ends).items()},
        kept=np.zeros(1, np.bool_),
        candidate=np.arange(candidates),
    )
