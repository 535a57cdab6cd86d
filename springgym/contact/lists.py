"""Lists of which features of which bodies are near each other, in which contacts are looked for.

Rows of lists hold something of each copy, its own: row r of a list the r-th of each. A copy that has less
than others has `NONE` there, and the particles of another. So a list is as long as the longest of a copy, and
what a copy has, and in which order, does not depend on the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike

from springgym.contact.records import Lists, Pairs
from springgym.core.blocks import aligned_zeros

LISTED, CANDIDATES = 16, 8
"""Rows of features that lists have space for, in all of the scene's features: more are listed anew at each
node; and candidates for each row, or all are."""


def new_lists(pairs: Pairs, particles: int, dtype: DTypeLike) -> Lists:
    """Return empty lists of the features of ``particles`` in all, on elements of ``dtype``."""
    shapes = pairs.shapes
    bodies, count = len(shapes.radius), pairs.among
    features = np.diff(shapes.start, axis=1)
    of_pairs = features[:, pairs.first[:count]] + features[:, pairs.second[:count]]
    # lists of all pairs, unless that is absurd; at least those of any one
    most = np.maximum(of_pairs.max(axis=1), np.minimum(of_pairs.sum(axis=1), LISTED * features.sum(axis=1)))
    vertices, triangles, edges = (int(n) + 1 for n in most)
    candidates = max(triangles, edges) + CANDIDATES * (vertices + edges)

    def lanes(*shape: int) -> np.ndarray:
        return aligned_zeros(shape, dtype)

    return Lists(
        origin=lanes(particles, 3),
        shift=lanes(particles, 3),
        moved=lanes(bodies),
        mean_shift=lanes(bodies, 3),
        bend=lanes(bodies),
        mean=lanes(bodies, 3),
        turning=lanes(bodies),
        low=lanes(bodies, 3),
        high=lanes(bodies, 3),
        along=lanes(particles),
        listed=lanes(count),
        gap=lanes(count),
        nearest=lanes(count),
        reach=lanes(count),
        watched=np.zeros(count, np.int64),
        margin=lanes(bodies),
        ahead=lanes(bodies),
        travelled=lanes(bodies),
        close=np.zeros(count, np.int64),
        kept=np.zeros(1, np.bool_),
        used=np.zeros(4, np.int64),
        ends=np.zeros((count, 3, 3), np.int64),
        vertex=lanes(vertices),
        vertex_particle=lanes(vertices),
        point=lanes(vertices, 3),
        triangle=lanes(triangles),
        triangle_particles=lanes(3 * triangles),
        corner=lanes(triangles, 3),
        first=lanes(triangles, 3),
        second=lanes(triangles, 3),
        normal=lanes(triangles, 3),
        square=lanes(triangles),
        products=lanes(triangles, 3),
        sizes=lanes(triangles, 3),
        edge=lanes(edges),
        edge_particles=lanes(2 * edges),
        start=lanes(edges, 3),
        way=lanes(edges, 3),
        candidate=np.arange(candidates),
        faces=np.zeros((vertices, 2), np.int64),
        partners=np.zeros((edges, 2), np.int64),
        crossed=lanes(pairs.most),
        crossing=lanes(pairs.most),
        length=np.zeros(2, np.int64),
    )
