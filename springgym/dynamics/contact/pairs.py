"""Bodies that may collide, and their features, in the form of compiled functions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import DTypeLike

from springgym.dynamics.records import Shapes
from springgym.model.bodies import Body
from springgym.model.collisions import Meetings, Shape

MOST_CONTACTS = 64
"""Largest number of contacts of a copy per body: more are counted and left out."""

PARALLEL = 2.0
"""Sine σ of the angle from which edges have full strength, in units of Δ over the longest edge."""

MOST_PARALLEL = 0.2


def packed_shapes(shapes: Sequence[Shape], first: np.ndarray) -> Shapes:
    """Return the features of all bodies, whose particles begin at ``first`` among those of the scene."""
    (vertices, triangles, edges), start = joined(shapes, first, ("vertices", "triangles", "edges"), np.uint32)
    rods = np.array([not len(shape.triangles) and len(shape.edges) > 0 for shape in shapes])
    balls = np.array([not len(shape.triangles) and not len(shape.edges) for shape in shapes])
    return Shapes(
        vertices[:, None],
        triangles if len(triangles) else None,
        edges if len(edges) else None,
        start,
        np.array([shape.radius for shape in shapes]),
        rods if rods.any() else None,
        balls if balls.any() else None,
    )


def joined(
    shapes: Sequence[Shape], first: np.ndarray, kinds: Sequence[str], dtype: DTypeLike
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the features of all bodies, by kind and by particles of the scene, and where each begins.

    The latter (kinds, bodies + 1) says where each body's features begin among all, and the end.
    """
    each = [[getattr(of, kind) + n for of, n in zip(shapes, first, strict=True)] for kind in kinds]
    start = np.array([np.cumsum([0, *map(len, features)]) for features in each])
    return [np.concatenate(features).astype(dtype) for features in each], start


def longest_edge(body: Body, shape: Shape) -> float:
    """Return the length [m] of a body's longest edge that can touch others; 0 if it has none."""
    ends = body.positions[shape.edges]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max(initial=0.0))


def parallel(met: Meetings, longest: Sequence[float]) -> np.ndarray:
    """Return σ² (pairs,), below which edges count as parallel, given the longest edge of each body [m]."""
    both = np.maximum(np.array(longest)[met.first], np.array(longest)[met.second])
    sine = np.full(len(both), 1.0)
    np.divide(PARALLEL * met.reach, both, out=sine, where=both > 0)
    return np.where(both > 0, np.minimum(sine, MOST_PARALLEL) ** 2, 1.0)


def most_contacts(met: Meetings, shapes: Sequence[Shape]) -> tuple[int, int]:
    """Return the largest numbers of a copy's contacts and of rows: one for each vertex and each two edges."""
    vertices, edges = (np.array([len(getattr(of, name)) for of in shapes]) for name in ("vertices", "edges"))
    found = int((vertices[met.first] + vertices[met.second] + edges[met.first] * edges[met.second]).sum())
    return min(found, MOST_CONTACTS * len(shapes)), found
