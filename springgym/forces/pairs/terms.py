"""Bodies that collide as compiled functions take them, what these compute in, and what they tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from springgym.blocks import aligned_zeros
from springgym.collisions import Meeting, Shape
from springgym.compiling import compiled
from springgym.kinds import Number, Numbers
from springgym.lanes import load, store

FAR = 1e9
"""Distance [m] of what is no contact, in a lane where another copy has one."""

MOST_CONTACTS = 64
"""Contacts of a copy, for each of its bodies: beyond, they are counted and left out."""

PARALLEL = 2.0
"""σ of edges, the sine of the angle from which they count in full: this times Δ over the longest edge."""

MOST_PARALLEL = 0.2


class Span(NamedTuple):
    """The time of a node: that of the drifts before and after it that are its own [s]."""

    lead: Any
    out: Any
    whole: Any
    """the sum"""


class Shapes(NamedTuple):
    """Features of all bodies, one body after another, by the numbers of the scene's particles."""

    vertices: np.ndarray
    """(V,)"""
    triangles: np.ndarray | None
    """(T, 3)"""
    edges: np.ndarray | None
    """(E, 2) sharp edges, and the rods of bodies without triangles"""
    start: np.ndarray
    """(3, bodies + 1) where each body's vertices, triangles and edges begin, and the end"""
    radius: np.ndarray
    """(bodies,) [m] of balls and rods"""
    rods: np.ndarray | None
    """(bodies,) whether a body is of rods; None if none is"""
    balls: np.ndarray | None
    """(bodies,) whether a body is a ball; None if none is"""


class Pairs(NamedTuple):
    """Pairs of bodies that may meet, each array of shape (pairs,)."""

    first: np.ndarray
    second: np.ndarray
    reach: np.ndarray
    """Δ [m]"""
    parallel: np.ndarray
    """σ² of edges [1]"""
    strength: np.ndarray
    """c [N·m²]"""
    friction: np.ndarray | None
    """μ [1]"""
    damping: np.ndarray | None
    """δ [s/m]"""
    shapes: Shapes
    most: int
    """contacts of a copy"""


class Room(NamedTuple):
    """What a thread finds contacts in. Those of a block's copies are in one list of rows."""

    low: np.ndarray
    """(bodies, 3) boxes around the bodies [m]"""
    high: np.ndarray
    slow: np.ndarray
    """(bodies, 3) and around their velocities [m/s]"""
    fast: np.ndarray
    along: np.ndarray
    """(particles,) places along the line of a pair's centres [m]"""
    between: np.ndarray
    """(particles,) whether a place is in the slab between both, in any copy"""
    near: np.ndarray
    """(3, ·) vertices, triangles and edges of a pair that lie between the two bodies, the first's before"""
    ends: np.ndarray
    """(3, 3) where they begin and end"""
    normal: np.ndarray
    """(T, 3) of those triangles, as long as twice their area [m²]"""
    square: np.ndarray
    """(T,) squares of these lengths [m⁴]"""
    key: np.ndarray
    """(T or E,) how near they are to a vertex"""
    first: np.ndarray
    """(T,) weights of their second corner in the nearest point"""
    second: np.ndarray
    """(T,) and of their third"""
    have: np.ndarray
    """(1,) contacts of each copy"""
    pair: np.ndarray
    """(rows,) whose contact it is"""
    particles: np.ndarray
    """(rows, 4)"""
    members: np.ndarray
    """(rows,) how many of them there are"""
    weight: np.ndarray
    """(4 rows,) w: they sum to 0"""
    toward: np.ndarray
    """(rows, 3) the normal, from the second body to the first"""
    distance: np.ndarray
    """(rows,) d [m], `FAR` where there is no contact"""
    share: np.ndarray
    """(rows,) Φ"""
    before: np.ndarray
    """(rows,) u₀, the speed along the normal before the node [m/s]"""
    inverse: np.ndarray
    """(rows,) W [1/kg]"""
    push: np.ndarray
    """(rows,) J [N·s]"""
    lost: np.ndarray
    """(rows,) energy lost to the damping [J]"""
    rub: np.ndarray
    """(rows, 3) the impulse of friction [N·s]"""
    spent: np.ndarray
    """(pairs, 3) energy lost to damping, and to friction, and given by the barriers, at this node [J]"""


TOUCHING, IMPULSE, GAP, ENERGY, CONTACT, FRICTION, MISSES, FAST, OVERFLOW = range(9)
"""What a tally holds of each pair: whether it touches; the sum of J [N·s] and the least distance [m] since it
was emptied; the energy in the barriers [J]; what was lost to damping and to friction [J]; and how often a
contact was found too late, was faster than it is computed well for, or had no room."""

ENTRIES = 9


class PairReadings(NamedTuple):
    """What a tally tells of pairs, (copies, pairs), in the order of `Scene.meetings`."""

    touching: np.ndarray
    """whether anything pushes at the node where the state is read"""
    impulse: np.ndarray
    """the sum of all impulses along normals, up to this node and half of what it gives [N·s]"""
    least_gap: np.ndarray
    """the least distance that any contact had [m]; infinite if none was near"""
    energy: np.ndarray
    """in the barriers between them, the mean before and after the node [J]"""
    contact_loss: np.ndarray
    """what was lost to restitution [J]"""
    friction_loss: np.ndarray
    """and to friction [J]"""
    misses: np.ndarray
    """how often a contact was found only when the bodies were in each other, or almost"""
    too_fast: np.ndarray
    """how often one came faster than it is computed well for: a fifth of Δ in a step"""
    overflow: np.ndarray
    """how often one was left out for want of room"""


class Meets(NamedTuple):
    """Bodies that collide, and what is told of them."""

    pairs: Pairs
    tally: np.ndarray
    """(pairs × `ENTRIES`,)"""
    before: np.ndarray
    """(pairs × `ENTRIES`,) the tally before the last node, which the next call makes anew"""


@compiled
def spend(room: Any, pair: Any, kind: Any, energy: Number) -> None:
    """Add to what a pair spent at this node: 0 damping, 1 friction, 2 given by its barriers [J]."""
    store(room.spent, (pair, kind), load(room.spent, (pair, kind)) + energy)


@compiled
def tell(tally: Numbers, pair: Number, entry: Number, value: Number) -> None:
    """Add to an entry of a pair; a tally of None keeps none."""
    if tally is not None:
        n = pair * ENTRIES + entry
        store(tally, n, load(tally, n) + value)


def packed_shapes(shapes: Sequence[Shape], first: Sequence[int]) -> Shapes:
    """Features of all bodies, whose particles begin at ``first`` among those of the scene."""
    kinds = [
        [getattr(shape, name) + n for shape, n in zip(shapes, first, strict=True)]
        for name in ("vertices", "triangles", "edges")
    ]
    start = np.array([np.cumsum([0, *map(len, kind)]) for kind in kinds])
    vertices, triangles, edges = (np.concatenate(kind).astype(np.uint32) for kind in kinds)
    rods = np.array([not len(shape.triangles) and len(shape.edges) > 0 for shape in shapes])
    balls = np.array([not len(shape.triangles) and not len(shape.edges) for shape in shapes])
    return Shapes(
        vertices,
        triangles if len(triangles) else None,
        edges if len(edges) else None,
        start,
        np.array([shape.radius for shape in shapes]),
        rods if rods.any() else None,
        balls if balls.any() else None,
    )


def parallel(meeting: Meeting, shapes: Sequence[Shape], positions: Sequence[np.ndarray]) -> float:
    """σ² of the edges of a pair's bodies, which have positions (N, 3) in their own numbers."""
    longest = 0.0
    for n in (meeting.first, meeting.second):
        ends = positions[n][shapes[n].edges]
        longest = max(longest, float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max(initial=0.0)))
    return min(PARALLEL * meeting.reach / longest, MOST_PARALLEL) ** 2 if longest else 1.0


def most_contacts(meetings: Sequence[Meeting], shapes: Sequence[Shape]) -> tuple[int, int]:
    """Contacts that a copy may have, and those there can be in a block: of each vertex with each triangle."""
    found = 0
    for met in meetings:
        a, b = shapes[met.first], shapes[met.second]
        for own, other in ((a, b), (b, a)):
            found += len(own.vertices) * max(len(other.triangles), len(other.edges), 1)
        found += len(a.edges) * len(b.edges)
    return min(found, MOST_CONTACTS * len(shapes)), found


def room(pairs: Pairs, particles: int, rows: int, dtype: Any) -> Room:
    """What a thread finds contacts in, on elements of ``dtype``; ``rows`` is the most a block can have."""
    shapes = pairs.shapes
    bodies = len(shapes.radius)
    triangles = 0 if shapes.triangles is None else len(shapes.triangles)
    edges = 0 if shapes.edges is None else len(shapes.edges)
    width = np.dtype(dtype)["lanes"].shape[0]
    rows = min(rows, pairs.most * width)

    def lanes(*shape: int) -> np.ndarray:
        return aligned_zeros(shape, dtype)

    return Room(
        low=lanes(bodies, 3),
        high=lanes(bodies, 3),
        slow=lanes(bodies, 3),
        fast=lanes(bodies, 3),
        along=lanes(particles),
        between=np.zeros(particles, bool),
        near=np.zeros((3, max(len(shapes.vertices), triangles, edges)), np.int32),
        ends=np.zeros((3, 3), np.int64),
        normal=lanes(triangles, 3),
        square=lanes(triangles),
        key=lanes(max(triangles, edges)),
        first=lanes(triangles),
        second=lanes(triangles),
        have=lanes(1),
        pair=np.zeros(rows, np.int32),
        particles=np.zeros((rows, 4), np.int32),
        members=np.zeros(rows, np.int32),
        weight=lanes(4 * rows),
        toward=lanes(rows, 3),
        distance=lanes(rows),
        share=lanes(rows),
        before=lanes(rows),
        inverse=lanes(rows),
        push=lanes(rows),
        lost=lanes(rows),
        rub=lanes(rows, 3),
        spent=lanes(len(pairs.first), 3),
    )
