"""Lists of which features of which bodies are near each other, in which contacts are looked for.

Rows of lists hold something of each copy, its own: row r of a list the r-th of each. A copy that has less
than others has `NONE` there, and the particles of another. So a list is as long as the longest of a copy, and
what a copy has, and in which order, does not depend on the others.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import DTypeLike

from springgym.contact.pairs import Pairs
from springgym.contact.rows import ContactRows
from springgym.core.blocks import aligned_zeros
from springgym.core.kinds import Number, Rows, Vector

NONE = -1.0
"""Of a list, in a copy that has less than others."""

LISTED, CANDIDATES = 16, 8
"""Rows of features that lists have space for, in all of the scene's features: more are listed anew at each
node; and candidates for each row, or all are."""

WATCHED, CLOSE = range(2)
"""Lists of pairs."""


class Lists(NamedTuple):
    """The lists of features that are near each other: the workspace of `springgym.contact.search`.

    Lists of features stay from node to node, one pair's behind another's.
    """

    origin: np.ndarray
    """(particles, 3) where vertices were when features were listed [m]"""
    shift: np.ndarray
    """(particles, 3) how far they moved since then [m]"""
    moved: np.ndarray
    """(bodies,) the farthest that a vertex moved [m]"""
    mean_shift: np.ndarray
    """(bodies, 3) the mean of how far vertices moved [m]"""
    bend: np.ndarray
    """(bodies,) the largest difference from it [m]"""
    mean: np.ndarray
    """(bodies, 3) the mean velocity of vertices [m/s]"""
    turning: np.ndarray
    """(bodies,) the largest difference from it [m/s]"""
    low: np.ndarray
    """(bodies, 3) lower corners of the boxes around the bodies, when features were listed [m]"""
    high: np.ndarray
    """(bodies, 3) and their upper corners [m]"""
    along: np.ndarray
    """(particles,) how far vertices are from the other body of a pair, along the line between both [m]"""
    listed: np.ndarray
    """(pairs,) all features of a pair that were nearer than this were listed; 0 before any were [m]"""
    gap: np.ndarray
    """(pairs,) no features of the pair were nearer than this when they were listed [m]"""
    nearest: np.ndarray
    """(pairs,) nor are any nearer than this at this node [m]"""
    reach: np.ndarray
    """(pairs,) how far to look for contacts at this node [m]"""
    watched: np.ndarray
    """(pairs,) list: pairs of bodies that are not far apart in some copy, ascending"""
    ahead: np.ndarray
    """(bodies,) by how much the way in half a step exceeds what is allowed for, as pairs were watched [m]"""
    margin: np.ndarray
    """(bodies,) the distance that a body may move before the search lists the watched pairs anew [m]"""
    travelled: np.ndarray
    """(bodies,) how far it moved at most since pairs were watched, up to when features were listed [m]"""
    close: np.ndarray
    """(pairs,) list of the watched pairs that may touch at this node"""
    length: np.ndarray
    """(2,) how many are `WATCHED`, and how many `CLOSE`"""
    kept: np.ndarray
    """(1,) whether the lists of all pairs are there"""
    used: np.ndarray
    """(4,) how many rows of vertices, triangles, edges and candidates are in use"""
    ends: np.ndarray
    """(pairs, 3, 3) where vertices, triangles and edges begin of the first body, of the second, and end"""
    vertex: np.ndarray
    """(V,) list: vertices of a pair that lie between the two bodies, the first's before"""
    vertex_particle: np.ndarray
    """(V,) which particles they are"""
    point: np.ndarray
    """(V, 3) where they are [m]"""
    triangle: np.ndarray
    """(T,) list of the triangles of a pair that lie between both bodies: those of the first body, then of the
    second"""
    triangle_particles: np.ndarray
    """(3 T,) the particles at the corners of these triangles"""
    corner: np.ndarray
    """(T, 3) the first corner of each triangle [m]"""
    first: np.ndarray
    """(T, 3) the side u of each triangle, from its first corner to its second [m]"""
    second: np.ndarray
    """(T, 3) the side w of each triangle, from its first corner to its third [m]"""
    normal: np.ndarray
    """(T, 3) the cross product u × w, whose length is twice the area of the triangle [m²]"""
    square: np.ndarray
    """(T,) |u × w|², the square of twice the area [m⁴]; −1 in rows without a triangle"""
    products: np.ndarray
    """(T, 3) the products |u|², u·w and |w|² of the sides [m²]"""
    sizes: np.ndarray
    """(T, 3) 1 over ``square`` [m⁻⁴], 1 over the product of all sides' squares [m⁻⁶], the largest of
    these [m²]"""
    edge: np.ndarray
    """(E,) list of the edges of a pair that lie between both bodies: those of the first body, then of the
    second"""
    edge_particles: np.ndarray
    """(2 E,) the particles at the ends of these edges"""
    start: np.ndarray
    """(E, 3) the first end of each edge [m]"""
    way: np.ndarray
    """(E, 3) the way from the first end of each edge to its second [m]; 0 in rows without an edge"""
    candidate: np.ndarray
    """rows of triangles and edges: first all of them, in turn; then those near a vertex or an edge"""
    faces: np.ndarray
    """(V, 2) where the candidates of a vertex begin there, and end: triangles of the other body"""
    partners: np.ndarray
    """(E, 2) where the candidates of an edge of the first body begin there, and end: edges of the second"""
    crossed: np.ndarray
    """(most,) list of the rows of edges of one body that cross edges of the other"""
    crossing: np.ndarray
    """(most,) the rows of the edges that they cross"""


Quad: TypeAlias = tuple[Number, Number, Number, Number]
"""A number of each of four particles."""


class Near(NamedTuple):
    """Two bodies near each other at a node."""

    pair: int
    bodies: tuple[int, int]
    lead: Number
    """time since the step began [s]"""
    reach: Number
    """how far to look for contacts [m]"""
    radius: Number
    """the radii of what lies around their features, both together [m]"""


class Touch(NamedTuple):
    """A contact of each copy, where its ``share`` is positive."""

    particles: Quad
    """the numbers of up to four particles"""
    weights: Quad
    """w of each: they sum to 0"""
    normal: Vector
    """n, from the second body to the first"""
    gap: Number
    """d [m]"""
    share: Number
    """Φ of the strength"""


class Search(NamedTuple):
    """All that a search for contacts reads and writes."""

    x: Rows
    """positions (N, 3) [m]"""
    w: Rows
    """velocities (N, 3) before the node [m/s]"""
    pairs: Pairs
    lists: Lists
    contacts: ContactRows


def new_lists(pairs: Pairs, particles: int, dtype: DTypeLike) -> Lists:
    """Return empty lists of the features of ``particles`` in all, on elements of ``dtype``."""
    shapes = pairs.shapes
    bodies, count = len(shapes.radius), len(pairs.first)
    features = np.diff(shapes.start, axis=1)
    of_pairs = features[:, pairs.first] + features[:, pairs.second]
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
