"""Which features of the bodies are near each other: by boxes around bodies, then between two bodies.

Boxes are found anew at each node, so that bodies may change shape; the velocities have boxes, too, and
say how much farther than Δ to look. What is left of a pair is what lies in the slab between both along
the line of their centres. Every test is made for all copies of a block, and passed where one copy passes
it; which contacts a copy has does not depend on the others.
"""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.forces.pairs.features import ball_ball, edge_edge, vertex_faces, vertex_rods
from springgym.forces.pairs.terms import FAR
from springgym.kinds import Number, Numbers, Rows, Vector
from springgym.lanes import any_lane, load, maximum, minimum, sqrt, store
from springgym.vectors import TINY, cross, dot, minus, plus, row, set_row, times

SPARE = 1.05
"""Contacts are looked for up to this many Δ, and farther by the way of half a step."""

FARTHEST = 4.0
"""But not by more than so many Δ."""

MARGIN = 1.001
"""Features are kept a little farther than contacts are looked for: rounding decides nothing."""


@compiled
def larger(u: Vector, w: Vector) -> Any:
    return maximum(u[0], w[0]), maximum(u[1], w[1]), maximum(u[2], w[2])


@compiled
def smaller(u: Vector, w: Vector) -> Any:
    return minimum(u[0], w[0]), minimum(u[1], w[1]), minimum(u[2], w[2])


@compiled
def surround(x: Rows, w: Rows, shapes: Any, room: Any) -> None:
    """Find the boxes around all bodies and their velocities."""
    for body in range(shapes.radius.size):
        first, last = shapes.start[0, body], shapes.start[0, body + 1]
        low = row(x, shapes.vertices[first])
        slow = row(w, shapes.vertices[first])
        high, fast = low, slow
        for k in range(first + 1, last):
            place, velocity = row(x, shapes.vertices[k]), row(w, shapes.vertices[k])
            low, high = smaller(low, place), larger(high, place)
            slow, fast = smaller(slow, velocity), larger(fast, velocity)
        set_row(room.low, body, low)
        set_row(room.high, body, high)
        set_row(room.slow, body, slow)
        set_row(room.fast, body, fast)


@compiled
def widest(low: Rows, high: Rows, a: Any, b: Any) -> Any:
    """For each axis, the largest difference of what lies in the boxes of two bodies."""
    return larger(minus(row(high, a), row(low, b)), minus(row(high, b), row(low, a)))


@compiled
def outside(low: Vector, high: Vector, body: Any, room: Any) -> Any:
    """How far a box is outside that of a body, along the axis of its largest gap."""
    gap = larger(minus(low, row(room.high, body)), minus(row(room.low, body), high))
    return maximum(maximum(gap[0], gap[1]), gap[2])


@compiled
def find(x: Rows, w: Rows, span: Any, pairs: Any, room: Any, tally: Numbers) -> int:
    """List the contacts of all pairs, with velocities ``w`` (N, 3) before the node; how many there are.

    ``span`` is the time of the node.
    """
    shapes = pairs.shapes
    surround(x, w, shapes, room)
    store(room.have, 0, 0.0)
    count = 0
    for p in range(pairs.first.size):
        a, b = pairs.first[p], pairs.second[p]
        reach, radius = pairs.reach[p], shapes.radius[a] + shapes.radius[b]
        fast = widest(room.slow, room.fast, a, b)
        way = span.out * sqrt(dot(fast, fast))
        near = SPARE * reach + minimum(way, FARTHEST * reach) + radius
        if any_lane(outside(row(room.low, a), row(room.high, a), b, room) < near):
            last, first = slab(x, a, b, shapes, room)
            if any_lane(first - last < near):
                collect(x, MARGIN * near, last, first, a, b, shapes, shapes.triangles, shapes.edges, room)
                count = compare(
                    x,
                    w,
                    span.lead,
                    p,
                    near,
                    radius,
                    count,
                    pairs,
                    shapes.triangles,
                    shapes.edges,
                    room,
                    tally,
                )
    return count


@compiled
def slab(x: Rows, a: Number, b: Number, shapes: Any, room: Any) -> Any:
    """Place the vertices of two bodies along the line of the middles of their boxes.

    Returns
    -------
    the last place of the first body's, the first place of the second's
    """
    middle = plus(row(room.low, b), row(room.high, b))
    axis = minus(middle, plus(row(room.low, a), row(room.high, a)))
    axis = times(1.0 / sqrt(dot(axis, axis) + TINY), axis)
    last, first = -FAR + 0.0 * axis[0], FAR + 0.0 * axis[0]
    for k in range(shapes.start[0, a], shapes.start[0, a + 1]):
        i = shapes.vertices[k]
        place = dot(axis, row(x, i))
        store(room.along, i, place)
        last = maximum(last, place)
    for k in range(shapes.start[0, b], shapes.start[0, b + 1]):
        i = shapes.vertices[k]
        place = dot(axis, row(x, i))
        store(room.along, i, place)
        first = minimum(first, place)
    return last, first


@compiled
def collect(
    x: Rows,
    near: Any,
    last: Number,
    first: Number,
    a: Any,
    b: Any,
    shapes: Any,
    triangles: Any,
    edges: Any,
    room: Any,
) -> None:
    """List what of two bodies is in the slab and the other's box, and find the normals of its triangles."""
    vs = ts = es = 0
    for side in range(2):
        body, other = (a, b) if side == 0 else (b, a)
        for kind in range(3):
            room.ends[side, kind] = vs if kind == 0 else (ts if kind == 1 else es)
        for k in range(shapes.start[0, body], shapes.start[0, body + 1]):
            i = shapes.vertices[k]
            place = load(room.along, i)
            gap = first - place if side == 0 else place - last
            room.between[i] = any_lane(gap < near)
            if room.between[i] and any_lane(outside(row(x, i), row(x, i), other, room) < near):
                room.near[0, vs] = i
                vs += 1
        if triangles is not None:
            for t in range(shapes.start[1, body], shapes.start[1, body + 1]):
                i, j, m = triangles[t, 0], triangles[t, 1], triangles[t, 2]
                if room.between[i] or room.between[j] or room.between[m]:
                    room.near[1, ts] = t
                    corner = row(x, i)
                    across = cross(minus(row(x, j), corner), minus(row(x, m), corner))
                    set_row(room.normal, ts, across)
                    store(room.square, ts, dot(across, across))
                    ts += 1
        if edges is not None:
            for e in range(shapes.start[2, body], shapes.start[2, body + 1]):
                i, j = edges[e, 0], edges[e, 1]
                if room.between[i] or room.between[j]:
                    here, there = row(x, i), row(x, j)
                    if any_lane(outside(smaller(here, there), larger(here, there), other, room) < near):
                        room.near[2, es] = e
                        es += 1
    room.ends[2, 0], room.ends[2, 1], room.ends[2, 2] = vs, ts, es


@compiled
def compare(
    x: Rows,
    w: Rows,
    lead: Number,
    p: Number,
    near: Number,
    radius: Number,
    count: Number,
    pairs: Any,
    triangles: Any,
    edges: Any,
    room: Any,
    tally: Numbers,
) -> int:
    """List the contacts of a pair behind ``count`` others; ``lead`` is the time since the step began."""
    shapes, ends = pairs.shapes, room.ends
    for side in range(2):
        other = 1 - side
        for m in range(ends[side, 0], ends[side + 1, 0]):
            i = room.near[0, m]
            count = vertex_faces(
                count,
                p,
                i,
                ends[other, 1],
                ends[other + 1, 1],
                x,
                w,
                lead,
                near,
                radius,
                triangles,
                pairs,
                room,
                tally,
            )
            count = vertex_rods(
                count,
                p,
                i,
                ends[other, 2],
                ends[other + 1, 2] if is_of(pairs, p, other, shapes.rods) else 0,
                x,
                w,
                lead,
                near,
                radius,
                edges,
                shapes.rods,
                pairs,
                room,
                tally,
            )
    if is_of(pairs, p, 0, shapes.balls) and is_of(pairs, p, 1, shapes.balls):
        i, j = (
            shapes.vertices[shapes.start[0, pairs.first[p]]],
            shapes.vertices[shapes.start[0, pairs.second[p]]],
        )
        count = ball_ball(count, p, i, j, x, near, radius, shapes.balls, pairs, room, tally)
    if edges is not None:
        for m in range(ends[0, 2], ends[1, 2]):
            i, j = edges[room.near[2, m], 0], edges[room.near[2, m], 1]
            start = row(x, i)
            along = minus(row(x, j), start)
            for n in range(ends[1, 2], ends[2, 2]):
                these = (i, j, edges[room.near[2, n], 0], edges[room.near[2, n], 1])
                count = edge_edge(count, p, these, start, along, x, w, lead, near, radius, pairs, room, tally)
    return count


@compiled
def is_of(pairs: Any, p: Any, side: Any, kind: Any) -> bool:
    """Whether a body of a pair, the first or the second, is of rods or a ball."""
    if kind is None:
        return False
    return kind[pairs.first[p] if side == 0 else pairs.second[p]]
