"""Detect bodies that overlap, from the positions of their particles alone.

Contacts are of corners, faces and sharp edges. Overlaps of other features, such as edges that are flat at
rest and crease as the body bends, and those due to too coarse steps, are detected here when a state is read.

Two bodies overlap if a line of one goes through a face of the other, or if one is completely inside the
other. The test uses signs of volumes of tetrahedra, without tolerances: a line p q goes through a face a b c
if p and q are on different sides of its plane, and p q passes all of its sides in the same sense.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from springgym.core.compiler.decorators import compiled, kernel
from springgym.core.language.kinds import Vector
from springgym.core.language.vectors import cross, dot, row, vec
from springgym.dynamics.contact.pairs import joined
from springgym.model.collisions import Shape

ASKEW = (0.31, 0.47, 3.1)
"""A ray out of a body, in units of its size: along no plane or edge that a body is likely to have."""


class Outlines(NamedTuple):
    """Faces and lines of all bodies, by the numbers of the scene's particles, one body after another."""

    faces: np.ndarray
    """(F, 3) the particles at the corners of each face"""
    lines: np.ndarray
    """(L, 2) the particles at the ends of each edge of faces, including flat ones, or rod of a body without
    faces"""
    start: np.ndarray
    """(3, bodies + 1) index of each body's first face, line and particle; the last column is their number"""


def outlines(shapes: Sequence[Shape], starts: np.ndarray) -> Outlines:
    """Return the outlines of all bodies, whose particles begin at ``starts`` (bodies + 1,), with the end."""
    (faces, lines), start = joined(shapes, starts[:-1], ("triangles", "lines"), np.int64)
    return Outlines(faces, lines, np.vstack([start, starts]))


@compiled
def volume(a: Vector, b: Vector, c: Vector, d: Vector) -> float:
    """Return six times the signed volume of a tetrahedron [m³]."""
    return dot(b - a, cross(c - a, d - a))


@compiled
def goes_through(p: Vector, q: Vector, a: Vector, b: Vector, c: Vector) -> bool:
    """Return whether the line p q goes through the face a b c."""
    for axis in range(3):
        if max(p[axis], q[axis]) < min(a[axis], b[axis], c[axis]):
            return False
        if min(p[axis], q[axis]) > max(a[axis], b[axis], c[axis]):
            return False
    if (volume(a, b, c, p) > 0.0) == (volume(a, b, c, q) > 0.0):
        return False
    side = volume(p, q, a, b) > 0.0
    return side == (volume(p, q, b, c) > 0.0) and side == (volume(p, q, c, a) > 0.0)


@compiled
def inside(p: Vector, x: np.ndarray, body: int, size: float, of: Outlines) -> bool:
    """Return whether a point is inside a body of ``size`` [m], by counting crossings of a ray."""
    out = p + size * vec(ASKEW[0], ASKEW[1], ASKEW[2])
    times = 0
    for n in range(of.start[0, body], of.start[0, body + 1]):
        a = row(x, of.faces[n, 0])
        b = row(x, of.faces[n, 1])
        c = row(x, of.faces[n, 2])
        if goes_through(p, out, a, b, c):
            times += 1
    return times % 2 == 1


@compiled
def reaches_into(x: np.ndarray, own: int, other: int, box: np.ndarray, of: Outlines) -> bool:
    """Return whether a line of body ``own`` goes through a face of ``other``, in a ``box`` (2, 3)."""
    for k in range(of.start[1, own], of.start[1, own + 1]):
        p = row(x, of.lines[k, 0])
        q = row(x, of.lines[k, 1])
        near = True
        for axis in range(3):
            near = near and max(p[axis], q[axis]) >= box[0, axis] and min(p[axis], q[axis]) <= box[1, axis]
        if near:
            for n in range(of.start[0, other], of.start[0, other + 1]):
                a = row(x, of.faces[n, 0])
                b = row(x, of.faces[n, 1])
                c = row(x, of.faces[n, 2])
                if goes_through(p, q, a, b, c):
                    return True
    return False


@kernel
def find_overlaps(
    x: np.ndarray, first: np.ndarray, second: np.ndarray, of: Outlines, boxes: np.ndarray, found: np.ndarray
) -> bool:
    """Find the pairs of bodies that overlap, ``found`` (copies, pairs), and return whether any does.

    Positions ``x`` are (copies, N, 3) [m]; ``boxes`` (bodies + 1, 2, 3) is a work array for the boxes around
    bodies and the common box of two.
    """
    whether = False
    bodies = of.start.shape[1] - 1
    both = boxes[bodies]
    for copy in range(x.shape[0]):
        here = x[copy]
        for body in range(bodies):
            for axis in range(3):
                low = high = here[of.start[2, body], axis]
                for i in range(of.start[2, body] + 1, of.start[2, body + 1]):
                    low = min(low, here[i, axis])
                    high = max(high, here[i, axis])
                boxes[body, 0, axis] = low
                boxes[body, 1, axis] = high
        for p in range(first.size):
            found[copy, p] = False
            a = first[p]
            b = second[p]
            near = True
            for axis in range(3):
                both[0, axis] = max(boxes[a, 0, axis], boxes[b, 0, axis])
                both[1, axis] = min(boxes[a, 1, axis], boxes[b, 1, axis])
                near = near and both[0, axis] <= both[1, axis]
            if near:
                for side in range(2):
                    own, other = (a, b) if side == 0 else (b, a)
                    if of.start[0, other] < of.start[0, other + 1] and not found[copy, p]:
                        size = 0.0
                        for axis in range(3):
                            size = max(size, boxes[other, 1, axis] - boxes[other, 0, axis])
                        point = row(here, of.start[2, own])
                        through = reaches_into(here, own, other, both, of)
                        found[copy, p] = through or inside(point, here, other, size, of)
                whether = whether or found[copy, p]
    return whether
