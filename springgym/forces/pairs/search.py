"""Which features of the bodies are near each other: by boxes around bodies, then between two bodies.

Boxes are found anew at each node, so that bodies may change shape; how fast bodies move says how much farther
than Δ to look. What is left of a pair is what lies in the slab between both along the line of their centres.
It is listed copy by copy (`springgym.forces.pairs.terms.Room`): copies of a block that touch in different
places have as many rows of candidates, and of contacts, as the one that has most. Every test is made for all
copies of a block, and none knows of another.
"""

from __future__ import annotations

from typing import Any

from springgym.core.compiling import compiled
from springgym.core.kinds import Number, Rows, Vector
from springgym.core.lanes import any_lane, load, maximum, minimum, select, sqrt, store
from springgym.core.vectors import (
    TINY,
    choose,
    cross,
    dot,
    row,
    row_each,
    set_row,
    unit,
    vec,
)
from springgym.forces.pairs.features import (
    ball_ball,
    begin,
    corners,
    crossing,
    edge_edge,
    enlist,
    grown,
    tips,
    vertex_faces,
    vertex_rods,
)
from springgym.forces.pairs.terms import FAR, NONE, Near, Search

SPARE = 1.05
"""Contacts are looked for up to this many Δ, and farther by the way of half a step."""

FARTHEST = 4.0
"""But not by more than so many Δ."""

MARGIN = 1.001
"""Features are kept a little farther than contacts are looked for: rounding decides nothing."""


@compiled
def larger(u: Vector, w: Vector) -> Any:
    return vec(maximum(u[0], w[0]), maximum(u[1], w[1]), maximum(u[2], w[2]))


@compiled
def smaller(u: Vector, w: Vector) -> Any:
    return vec(minimum(u[0], w[0]), minimum(u[1], w[1]), minimum(u[2], w[2]))


@compiled
def surround(x: Rows, shapes: Any, room: Any) -> None:
    """Find the boxes around all bodies."""
    for body in range(shapes.radius.size):
        first, last = shapes.start[0, body], shapes.start[0, body + 1]
        low = row(x, shapes.vertices[first])
        high = low
        for k in range(first + 1, last):
            place = row(x, shapes.vertices[k])
            low, high = smaller(low, place), larger(high, place)
        set_row(room.low, body, low)
        set_row(room.high, body, high)


@compiled
def outside(low: Vector, high: Vector, body: Any, room: Any) -> Any:
    """How far a box is outside that of a body, along the axis of its largest gap."""
    gap = larger(low - row(room.high, body), row(room.low, body) - high)
    return maximum(maximum(gap[0], gap[1]), gap[2])


@compiled
def closing(w: Rows, a: Number, b: Number, shapes: Any) -> Any:
    """A bound on how fast particles of two bodies come nearer: both move, and what they are of turns."""
    first, turning = motion(w, a, shapes)
    second, other = motion(w, b, shapes)
    apart = first - second
    return sqrt(dot(apart, apart)) + turning + other


@compiled
def motion(w: Rows, body: Number, shapes: Any) -> Any:
    """The mean velocity of a body's vertices, and the largest difference from it."""
    first, last = shapes.start[0, body], shapes.start[0, body + 1]
    mean = row(w, shapes.vertices[first])
    for k in range(first + 1, last):
        mean = mean + row(w, shapes.vertices[k])
    mean = 1.0 / (last - first) * mean
    fastest = 0.0 * mean[0]
    for k in range(first, last):
        own = row(w, shapes.vertices[k]) - mean
        fastest = maximum(fastest, dot(own, own))
    return mean, sqrt(fastest)


@compiled
def find(x: Rows, w: Rows, span: Any, pairs: Any, room: Any) -> int:
    """List the contacts of all pairs, with velocities ``w`` (N, 3) before the node; how many rows that makes.

    ``span`` is the time of the node, a `springgym.forces.node.Span`.
    """
    shapes, seen = pairs.shapes, Search(x, w, pairs, room)
    surround(x, shapes, room)
    store(room.have, 0, 0.0)
    count = 0
    for p in range(pairs.first.size):
        store(room.left_out, p, 0.0)
        a, b = pairs.first[p], pairs.second[p]
        reach, radius = pairs.reach[p], shapes.radius[a] + shapes.radius[b]
        between = outside(row(room.low, a), row(room.high, a), b, room)
        if any_lane(between < (SPARE + FARTHEST) * reach + radius):
            way = minimum(span.out * closing(w, a, b, shapes), FARTHEST * reach)
            near = Near(p, (a, b), span.lead, SPARE * reach + way + radius, radius)
            if any_lane(between < near.reach):
                last, first = slab(x, a, b, shapes, room)
                if any_lane(first - last < near.reach):
                    collect(last, first, near, seen, shapes.triangles, shapes.edges)
                    count = compare(count, near, seen, shapes.triangles, shapes.edges)
    return count


@compiled
def slab(x: Rows, a: Number, b: Number, shapes: Any, room: Any) -> Any:
    """Place the vertices of two bodies along the line of the middles of their boxes.

    Returns
    -------
    the last place of the first body's, the first place of the second's
    """
    middle = row(room.low, b) + row(room.high, b)
    axis = middle - (row(room.low, a) + row(room.high, a))
    axis = unit(axis)
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
def collect(last: Number, first: Number, near: Near, seen: Search, triangles: Any, edges: Any) -> None:
    """List what of two bodies is in the slab and the other's box, and find where it is."""
    room = seen.room
    vs = ts = es = 0
    for side in range(2):
        body = near.bodies[0] if side == 0 else near.bodies[1]
        other = near.bodies[1] if side == 0 else near.bodies[0]
        room.ends[0, side], room.ends[1, side], room.ends[2, side] = vs, ts, es
        vs += list_vertices(vs, side, body, other, last if side == 1 else first, near, seen)
        ts += list_triangles(ts, body, other, near, seen, triangles)
        es += list_edges(es, body, other, near, seen, edges)
    room.ends[0, 2], room.ends[1, 2], room.ends[2, 2] = vs, ts, es


@compiled
def list_vertices(
    first: Number, side: Any, body: Number, other: Any, end: Number, near: Near, seen: Search
) -> Any:
    """List the vertices of a body from row ``first`` on; ``end`` of the other body along the slab's axis."""
    x, room, shapes = seen.x, seen.room, seen.pairs.shapes
    reach = MARGIN * near.reach
    have, rows = 0.0 * reach, 0
    for k in range(shapes.start[0, body], shapes.start[0, body + 1]):
        i = shapes.vertices[k]
        place = load(room.along, i)
        gap = end - place if side == 0 else place - end
        store(room.along, i, gap)
        if any_lane(gap < reach):
            wanted = maximum(gap, outside(row(x, i), row(x, i), other, room)) < reach
            if any_lane(wanted):
                have = enlist(room.vertex, first, have, 1.0 * i, wanted)
                rows = grown(rows, have)
    for m in range(rows):
        there = have > 1.0 * m
        i = select(there, load(room.vertex, first + m), NONE)
        store(room.vertex, first + m, i)
        set_row(room.point, first + m, row_each(x, maximum(i, 0.0)))
    return rows


@compiled
def list_triangles(first: Number, body: Number, other: Any, near: Near, seen: Search, triangles: Any) -> Any:
    """List the triangles of a body from row ``first`` on."""
    rows = 0
    if triangles is not None:
        x, room, shapes = seen.x, seen.room, seen.pairs.shapes
        reach = MARGIN * near.reach
        have = 0.0 * reach
        for t in range(shapes.start[1, body], shapes.start[1, body + 1]):
            i, j, m = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            gap = minimum(minimum(load(room.along, i), load(room.along, j)), load(room.along, m))
            if any_lane(gap < reach):
                a, b, c = row(x, i), row(x, j), row(x, m)
                low, high = smaller(smaller(a, b), c), larger(larger(a, b), c)
                wanted = maximum(gap, outside(low, high, other, room)) < reach
                if any_lane(wanted):
                    have = enlist(room.triangle, first, have, 1.0 * t, wanted)
                    rows = grown(rows, have)
        for n in range(rows):
            there = have > 1.0 * n
            k = first + n
            store(room.triangle, k, select(there, load(room.triangle, k), NONE))
            i, j, m = corners(k + 0.0 * have, room, triangles)
            corner = row_each(x, i)
            u, q = row_each(x, j) - corner, row_each(x, m) - corner
            across = cross(u, q)
            set_row(room.corner, k, corner)
            set_row(room.first, k, u)
            set_row(room.second, k, q)
            set_row(room.normal, k, across)
            square = select(there, dot(across, across), NONE)
            store(room.square, k, square)
            uu, uw, ww = dot(u, u), dot(u, q), dot(q, q)
            third = uu - 2.0 * uw + ww
            inverse, of_sides = 1.0 / (square + TINY), 1.0 / (uu * ww * third + TINY)
            set_row(room.products, k, (uu, uw, ww))
            set_row(room.sizes, k, (inverse, of_sides, maximum(maximum(uu, ww), third)))
    return rows


@compiled
def list_edges(first: Number, body: Number, other: Any, near: Near, seen: Search, edges: Any) -> Any:
    """List the edges of a body from row ``first`` on."""
    rows = 0
    if edges is not None:
        x, room, shapes = seen.x, seen.room, seen.pairs.shapes
        reach = MARGIN * near.reach
        have = 0.0 * reach
        for e in range(shapes.start[2, body], shapes.start[2, body + 1]):
            i, j = edges[e, 0], edges[e, 1]
            gap = minimum(load(room.along, i), load(room.along, j))
            if any_lane(gap < reach):
                here, there = row(x, i), row(x, j)
                wanted = maximum(gap, outside(smaller(here, there), larger(here, there), other, room)) < reach
                if any_lane(wanted):
                    have = enlist(room.edge, first, have, 1.0 * e, wanted)
                    rows = grown(rows, have)
        for n in range(rows):
            listed = have > 1.0 * n
            k = first + n
            store(room.edge, k, select(listed, load(room.edge, k), NONE))
            i, j = tips(k + 0.0 * have, room, edges)
            start = row_each(x, i)
            way = row_each(x, j) - start
            far = FAR + 0.0 * have
            set_row(room.start, k, choose(listed, start, vec(far, far, far)))
            set_row(room.way, k, choose(listed, way, 0.0 * way))
    return rows


@compiled
def compare(count: Number, near: Near, seen: Search, triangles: Any, edges: Any) -> int:
    """List the contacts of a pair behind ``count`` others."""
    pairs, room = seen.pairs, seen.room
    shapes, ends = pairs.shapes, room.ends
    rods, balls = shapes.rods, shapes.balls
    begin(room)
    first = count
    for side in range(2):
        for m in range(ends[0, side], ends[0, side + 1]):
            count = vertex_faces(count, first, m, 1 - side, near, seen, triangles)
    if edges is not None:
        for k in range(crossing(near, seen)):
            count = edge_edge(count, first, k, near, seen, edges)
    if rods is not None:
        begin(room)
        first = count
        for side in range(2):
            if is_of(near.bodies[1 - side], rods):
                for m in range(ends[0, side], ends[0, side + 1]):
                    count = vertex_rods(count, first, m, 1 - side, near, seen, edges, rods)
    if is_of(near.bodies[0], balls) and is_of(near.bodies[1], balls):
        i = shapes.vertices[shapes.start[0, near.bodies[0]]]
        j = shapes.vertices[shapes.start[0, near.bodies[1]]]
        begin(room)
        count = ball_ball(count, count, i, j, near, seen, balls)
    return count


@compiled
def is_of(body: Any, kind: Any) -> bool:
    """Whether a body is of a kind."""
    if kind is None:
        return False
    return kind[body]
