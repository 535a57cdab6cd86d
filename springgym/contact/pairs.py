"""Bodies that may collide, and their features, as compiled functions take them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from springgym.bodies import Body
from springgym.collisions import Meetings, Shape
from springgym.contact.cone import Resistance

MOST_CONTACTS = 64
"""Contacts of a copy, for each of its bodies: beyond, they are counted and left out."""

PARALLEL = 2.0
"""σ of edges, the sine of the angle from which they count in full: this times Δ over the longest edge."""

MOST_PARALLEL = 0.2


SWEEPS = 2
"""Sweeps, there and back, in which the impulses of contacts are found."""


class Shapes(NamedTuple):
    """The features of all bodies, one body after another, by the numbers of the scene's particles."""

    vertices: np.ndarray
    """(V, 1) the particle at each vertex"""
    triangles: np.ndarray | None
    """(T, 3) the particles at the corners of each triangle; None if no body has triangles"""
    edges: np.ndarray | None
    """(E, 2) the particles at the ends of each sharp edge, or rod of a body without triangles; None if no
    body has any"""
    start: np.ndarray
    """(3, bodies + 1) where each body's vertices, triangles and edges begin, and the end"""
    radius: np.ndarray
    """(bodies,) [m] of balls and rods"""
    rods: np.ndarray | None
    """(bodies,) whether a body is of rods; None if none is"""
    balls: np.ndarray | None
    """(bodies,) whether a body is a ball; None if none is"""


class Pairs(NamedTuple):
    """The pairs of bodies that may meet; each array has shape (pairs,)."""

    first: np.ndarray
    """the index of the first body of each pair"""
    second: np.ndarray
    """the index of the second body of each pair"""
    reach: np.ndarray
    """the reach Δ, the gap below which contact repels both bodies [m]"""
    least_reach: float
    """the least Δ of all pairs [m]"""
    parallel: np.ndarray
    """σ², the square of the sine below which two edges count as parallel [1]"""
    strength: np.ndarray
    """c of the barrier [N·m²]"""
    friction: np.ndarray | None
    """μ [1]; None if no pair rubs"""
    resistance: Resistance | None
    """the coefficients of rolling and torsional resistance of all pairs; None if all are zero"""
    loss: np.ndarray | None
    """β of restitution [1]; None if no pair loses any energy by it"""
    shapes: Shapes
    most: int
    """how many contacts a copy can have"""
    sweeps: int
    """in how many sweeps impulses are found"""


def packed_shapes(shapes: Sequence[Shape], first: Sequence[int]) -> Shapes:
    """Return the features of all bodies, whose particles begin at ``first`` among those of the scene."""
    kinds = [
        [getattr(shape, name) + n for shape, n in zip(shapes, first, strict=True)]
        for name in ("vertices", "triangles", "edges")
    ]
    start = np.array([np.cumsum([0, *map(len, kind)]) for kind in kinds])
    vertices, triangles, edges = (np.concatenate(kind).astype(np.uint32) for kind in kinds)
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


def longest_edge(body: Body, shape: Shape) -> float:
    """Return the length [m] of the longest edge of a body that others meet; 0 if it has none."""
    ends = body.positions[shape.edges]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max(initial=0.0))


def parallel(met: Meetings, longest: Sequence[float]) -> np.ndarray:
    """Return σ² (pairs,), below which edges count as parallel, given the longest edge of each body [m]."""
    both = np.maximum(np.array(longest)[met.first], np.array(longest)[met.second])
    sine = np.full(len(both), 1.0)
    np.divide(PARALLEL * met.reach, both, out=sine, where=both > 0)
    return np.where(both > 0, np.minimum(sine, MOST_PARALLEL) ** 2, 1.0)


def most_contacts(met: Meetings, shapes: Sequence[Shape]) -> tuple[int, int]:
    """Return how many contacts a copy may have, and how many rows a list: for each vertex, each two edges."""
    vertices, edges = (np.array([len(getattr(of, name)) for of in shapes]) for name in ("vertices", "edges"))
    found = int((vertices[met.first] + vertices[met.second] + edges[met.first] * edges[met.second]).sum())
    return min(found, MOST_CONTACTS * len(shapes)), found
