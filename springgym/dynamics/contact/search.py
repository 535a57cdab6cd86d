"""Search for contacts: broad phase by boxes around bodies, then neighbour lists of features.

Broad phase. Pairs of bodies that are not far apart are watched until a body has moved by its margin: until
then no other pair can have come near. For watched bodies whose boxes are near each other, features are listed
that lie in the slab between both, along the line of their centres, and near the other's box; and among these,
the candidates: vertices and triangles, or edges and edges, that are near each other.

Lists are reused like neighbour lists in molecular dynamics (Verlet 1967, doi:10.1103/PhysRev.159.98). They
extend beyond the search distance by a margin. Two points of two bodies approach by no more than the relative
displacement of the bodies plus the largest displacement of vertices relative to their body: as long as this
is less than the margin, all features that may touch are in the lists. The positions of vertices at listing
are stored, so it does not matter whose lists they are.

Narrow phase. At each node candidates are compared (`springgym.dynamics.contact.features`), and those that are
near enough make contacts: bit-identical however many more features are listed. The search distance follows
from the speed of the bodies.

Contacts, and features for one node alone, are listed copy by copy (`springgym.dynamics.contact.rows`): a
block has as many rows as its copy with most contacts. Every test is made for all copies of a block, and the
results of one copy do not depend on another."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number, Numbers, Rows, Vector
from springgym.core.language.lanes import any_lane, filled, maximum, minimum, select, sqrt
from springgym.core.language.memory import load, load_each, store
from springgym.core.language.vectors import GUARD, choose, cross, dot, row, row_each, set_row, unit, vec
from springgym.dynamics.contact.features import (
    ball_ball,
    begin,
    crossing,
    edge_edge,
    enlist,
    grown,
    vertex_faces,
    vertex_rods,
)
from springgym.dynamics.records import (
    FAR,
    NO_ENTRY,
    ContactCount,
    ContactRows,
    Near,
    Neighbours,
    PairList,
    Pairs,
    Search,
    Shapes,
    Times,
)
from springgym.model.collisions.overlap import BEYOND_ROUNDING

Indices: TypeAlias = "np.ndarray | None"
"""The features of a kind, by the indices of their particles; None if no body has any."""

SPARE = 1.05
"""The search distance of contacts is this many Δ plus the relative motion in half a step, however long."""

FARTHEST = 4.0
"""Relative motion of two bodies in half a step, in Δ, that distant pairs are allowed without a check of their
speed: for a body that moves by more than half of it, the excess counts as motion already made."""

WIDEST = 1e3
"""Largest search distance of contacts [m], less than `FAR`. If a pair moves farther in half a step, one
contact is counted as left out."""

MARGIN = 1.0
"""Margin of lists that are reused, in Δ."""

LASTING = 3.0
"""Least number of steps for which a margin must be expected to last; else lists have none."""

ROOMY = 0.25
"""Least margin of a body in watched pairs, as a fraction of its box's longest side: until a body has moved by
its margin, no other pairs are checked."""

PATIENT = 20.0
"""Least number of steps in which a body moves by its margin in watched pairs."""

SKEW = 1e-3
"""Least sin² of the angle between two edges for which the distance of their lines is used."""

VERTICES = 0
"""Index of the list of vertices."""

TRIANGLES = 1
"""Index of the list of triangles."""

EDGES = 2
"""Index of the list of edges."""

CANDIDATES = 3
"""Index of the list of candidates, in `Neighbours.used`."""


@compiled
def larger(u: Vector, w: Vector) -> Vector:
    return vec(maximum(u[0], w[0]), maximum(u[1], w[1]), maximum(u[2], w[2]))


@compiled
def smaller(u: Vector, w: Vector) -> Vector:
    return vec(minimum(u[0], w[0]), minimum(u[1], w[1]), minimum(u[2], w[2]))


@compiled
def box_gap(low: Vector, high: Vector, other_low: Vector, other_high: Vector) -> Number:
    """Return the gap [m] between two boxes on the axis where it is largest; negative if they overlap."""
    gap = larger(low - other_high, other_low - high)
    return maximum(maximum(gap[0], gap[1]), gap[2])


@compiled
def outside(low: Vector, high: Vector, body: int, lists: Neighbours) -> Number:
    """Return the gap [m] between a box and the box of a body."""
    return box_gap(low, high, row(lists.low, body), row(lists.high, body))


@compiled
def find(x: Rows, w: Rows, span: Times, pairs: Pairs, lists: Neighbours, contacts: ContactRows) -> int:
    """List the contacts of all pairs of bodies, and return their number.

    Particles are at ``x`` (N, 3) and reach the node with velocities ``w`` (N, 3); ``span`` is its time.
    """
    shapes = pairs.shapes
    seen = Search(x, w, pairs, lists, contacts)
    measure_moved(x, w, span, pairs, lists)
    fresh = not all_far_are_far(lists)
    if fresh:
        watch(x, w, span, pairs, lists)
    relist = not lists_hold(w, span, pairs, lists) or fresh
    if relist:
        begin_lists(x, fresh, pairs, lists)
    store(contacts.counts, 0, 0.0)
    count = 0
    contacts.length[ContactCount.PAIRS] = 0
    for n in range(lists.length[PairList.CLOSE]):
        p = lists.close[n]
        a = pairs.first[p]
        b = pairs.second[p]
        near = Near(p, (a, b), span.lead, load(lists.reach, p), shapes.radius[a] + shapes.radius[b])
        before = count
        store(contacts.left_out, p, select(near.reach > WIDEST, 1.0 + 0.0 * near.reach, 0.0))
        brief = relist and list_features(near, span, seen, shapes.triangles, shapes.edges)
        needed = relist or any_lane(load(lists.nearest, p) < BEYOND_ROUNDING * near.reach)
        if needed and (is_listed(VERTICES, p, lists) or is_listed(EDGES, p, lists)):
            locate(p, seen, shapes.triangles, shapes.edges)
            if relist:
                list_candidates(p, brief, seen, shapes.triangles, shapes.edges)
            count = compare(count, near, seen, shapes.triangles, shapes.edges)
        if count > before or any_lane(load(contacts.left_out, p) > 0.0):
            contacts.touching_pairs[contacts.length[ContactCount.PAIRS]] = p
            contacts.length[ContactCount.PAIRS] += 1
    return count


@compiled
def is_listed(kind: int, p: int, lists: Neighbours) -> bool:
    """Return whether features of a kind are listed for a pair."""
    return lists.ends[p, kind, 0] < lists.ends[p, kind, 2]


# --- Pairs that are watched ---------------------------------------------------------------------------


@compiled
def all_far_are_far(lists: Neighbours) -> bool:
    """Return whether all pairs outside the list of close pairs are still too far apart to touch."""
    for body in range(lists.margin.size):
        gone = load(lists.travelled, body) + load(lists.moved, body)
        margin = load(lists.margin, body)
        if any_lane(select(gone <= margin, 0.0, 1.0 + 0.0 * margin) > 0.5):  # also if not a number
            return False
    return True


@compiled
def watch(x: Rows, w: Rows, span: Times, pairs: Pairs, lists: Neighbours) -> None:
    """List the pairs of bodies that may come near each other before one of them has used up its margin."""
    shapes = pairs.shapes
    count = 0
    measure_boxes(x, shapes, lists)
    average(w, shapes, lists.mean, lists.turning)
    for body in range(shapes.radius.size):
        sides = row(lists.high, body) - row(lists.low, body)
        mean = row(lists.mean, body)
        longest = maximum(maximum(sides[0], sides[1]), sides[2]) + 2.0 * shapes.radius[body]
        half = span.out * (sqrt(dot(mean, mean)) + load(lists.turning, body))  # motion in half a step
        store(lists.margin, body, minimum(maximum(ROOMY * longest, PATIENT * 2.0 * half), 0.5 * FAR))
        ahead = maximum(half - 0.5 * FARTHEST * pairs.least_reach, 0.0)  # as in `measure_moved`
        store(lists.ahead, body, ahead)
    for p in range(pairs.among):
        a = pairs.first[p]
        b = pairs.second[p]
        gap = outside(row(lists.low, a), row(lists.high, a), b, lists)
        margin = load(lists.margin, a) + load(lists.margin, b)
        ahead = load(lists.ahead, a) + load(lists.ahead, b)
        if any_lane(gap - maximum(margin, ahead) <= near_enough(p, a, b, pairs)):
            store(lists.listed, p, (gap - ahead) + (load(lists.moved, a) + load(lists.moved, b)))
            lists.watched[count] = p
            count += 1
    lists.length[PairList.WATCHED] = count


@compiled
def near_enough(p: int, a: int, b: int, pairs: Pairs) -> Number:
    """Return the distance [m] below which two bodies are checked."""
    radius = pairs.shapes.radius[a] + pairs.shapes.radius[b]
    return BEYOND_ROUNDING * ((SPARE + FARTHEST) * pairs.reach[p] + radius)


@compiled
def measure_boxes(x: Rows, shapes: Shapes, lists: Neighbours) -> None:
    """Compute the boxes around all bodies."""
    for body in range(shapes.radius.size):
        low = row(x, shapes.vertices[shapes.start[VERTICES, body], 0])
        high = low
        for k in range(shapes.start[VERTICES, body], shapes.start[VERTICES, body + 1]):
            place = row(x, shapes.vertices[k, 0])
            low = smaller(low, place)
            high = larger(high, place)
        set_row(lists.low, body, low)
        set_row(lists.high, body, high)


# --- Lists that last ----------------------------------------------------------------------------------


@compiled
def measure_moved(x: Rows, w: Rows, span: Times, pairs: Pairs, lists: Neighbours) -> None:
    """Compute the displacements of each body's vertices since features were listed.

    Fast bodies count as displaced farther, see `FARTHEST`, so that no pair that may touch is left out.
    """
    shapes = pairs.shapes
    usual = 0.5 * FARTHEST * pairs.least_reach
    for body in range(shapes.radius.size):
        farthest = 0.0 * load(x, (0, 0))
        fastest = farthest
        for k in range(shapes.start[VERTICES, body], shapes.start[VERTICES, body + 1]):
            i = shapes.vertices[k, 0]
            speed = row(w, i)
            fastest = maximum(dot(speed, speed), fastest)
            shift = row(x, i) - row(lists.origin, i)
            set_row(lists.shift, i, shift)
            farthest = maximum(dot(shift, shift), farthest)
        ahead = maximum(span.out * sqrt(fastest) - usual, 0.0)
        store(lists.moved, body, sqrt(farthest) + ahead)


@compiled
def lists_hold(w: Rows, span: Times, pairs: Pairs, lists: Neighbours) -> bool:
    """Return whether the lists hold all that may touch, and set the search distance of close pairs."""
    shapes = pairs.shapes
    hold = lists.kept[0]
    averaged = False
    shifted = False
    close = 0
    for n in range(lists.length[PairList.WATCHED]):
        p = lists.watched[n]
        a = pairs.first[p]
        b = pairs.second[p]
        reach = pairs.reach[p]
        radius = shapes.radius[a] + shapes.radius[b]
        listed = load(lists.listed, p)
        moved = load(lists.moved, a) + load(lists.moved, b)
        if any_lane(listed - moved <= near_enough(p, a, b, pairs)):
            lists.close[close] = p
            close += 1
            if not averaged:
                average(w, shapes, lists.mean, lists.turning)
                averaged = True
            way = minimum(span.out * approach(a, b, lists.mean, lists.turning), WIDEST)
            far = SPARE * reach + way + radius
            store(lists.reach, p, far)
            if any_lane(listed - moved <= BEYOND_ROUNDING * far):  # unless both moved together
                if not shifted:
                    average(lists.shift, shapes, lists.mean_shift, lists.bend)
                    shifted = True
                moved = approach(a, b, lists.mean_shift, lists.bend)
                hold = hold and not any_lane(listed - moved <= BEYOND_ROUNDING * far)
            store(lists.nearest, p, load(lists.gap, p) - moved)
    lists.length[PairList.CLOSE] = close
    return hold


@compiled
def average(u: Rows, shapes: Shapes, mean: Rows, rest: Numbers) -> None:
    """Compute the mean velocity or shift of each body's vertices, and the largest difference from it."""
    for body in range(shapes.radius.size):
        first = shapes.start[VERTICES, body]
        behind = shapes.start[VERTICES, body + 1]
        middle = row(u, shapes.vertices[first, 0])
        for k in range(first + 1, behind):
            middle = middle + row(u, shapes.vertices[k, 0])
        middle = 1.0 / (behind - first) * middle
        largest = 0.0 * middle[0]
        for k in range(first, behind):
            own = row(u, shapes.vertices[k, 0]) - middle
            largest = maximum(largest, dot(own, own))
        set_row(mean, body, middle)
        store(rest, body, sqrt(largest))


@compiled
def approach(a: int, b: int, mean: Rows, rest: Numbers) -> Number:
    """Return an upper bound on the approach of two bodies' particles [m], or on its speed [m/s]."""
    apart = row(mean, a) - row(mean, b)
    return sqrt(dot(apart, apart)) + load(rest, a) + load(rest, b)


# --- Lists --------------------------------------------------------------------------------------------


@compiled
def begin_lists(x: Rows, fresh: bool, pairs: Pairs, lists: Neighbours) -> None:
    """Empty the lists of features, store the positions of vertices, and compute the boxes around all bodies.

    The known distance of a pair that is not close decreases by the motion of its bodies. If the watched pairs
    are ``fresh``, the margins of all bodies begin again. A position that is NaN is stored as one far from any
    later position.
    """
    shapes = pairs.shapes
    lists.kept[0] = True
    empty(lists)
    for n in range(lists.length[PairList.WATCHED]):
        p = lists.watched[n]
        for kind in range(3):
            for side in range(3):
                lists.ends[p, kind, side] = 0
        moved = load(lists.moved, pairs.first[p]) + load(lists.moved, pairs.second[p])
        store(lists.listed, p, load(lists.listed, p) - moved)
    measure_boxes(x, shapes, lists)
    for body in range(shapes.radius.size):
        if fresh:
            store(lists.travelled, body, 0.0)
        else:
            store(lists.travelled, body, load(lists.travelled, body) + load(lists.moved, body))
        for k in range(shapes.start[VERTICES, body], shapes.start[VERTICES, body + 1]):
            i = shapes.vertices[k, 0]
            place = row(x, i)
            most = vec(FAR, FAR, FAR) + 0.0 * row(lists.origin, i)
            set_row(lists.origin, i, smaller(larger(place, -most), most))


@compiled
def empty(lists: Neighbours) -> None:
    """Reset all lists to their first rows; candidates begin after the list of all rows."""
    for kind in range(3):
        lists.used[kind] = 0
    lists.used[CANDIDATES] = max(lists.triangle.size, lists.edge.size)


@compiled
def list_features(near: Near, span: Times, seen: Search, triangles: Indices, edges: Indices) -> bool:
    """List the features of two bodies near the other; return whether the lists are for this node only.

    They are if the margin would not last: then lists without a margin are cheaper.
    """
    x = seen.x
    lists = seen.lists
    shapes = seen.pairs.shapes
    p = near.pair
    a, b = near.bodies
    margin = MARGIN * seen.pairs.reach[p]
    wide = BEYOND_ROUNDING * near.reach + margin
    gap = outside(row(lists.low, a), row(lists.high, a), b, lists)
    brief = False
    if any_lane(gap < wide):
        gap = maximum(measure_slab(x, a, b, shapes, lists), gap)
        way = LASTING * 2.0 * span.out * approach(a, b, lists.mean, lists.turning)
        brief = any_lane(select(gap < wide, way, 0.0) > margin)
        wide = wide - (margin if brief else 0.0)
        if any_lane(gap < wide):
            make_space(a, b, shapes, lists)
            for side in range(2):
                list_kind(VERTICES, side, wide, brief, near, seen, shapes.vertices)
                list_kind(TRIANGLES, side, wide, brief, near, seen, triangles)
                list_kind(EDGES, side, wide, brief, near, seen, edges)
    store(lists.gap, p, gap)
    store(lists.nearest, p, gap)
    far = BEYOND_ROUNDING * ((SPARE + FARTHEST) * seen.pairs.reach[p] + near.radius)  # as in `lists_hold`
    store(lists.listed, p, minimum(maximum(gap, minimum(wide, far)), 0.5 * FAR))
    return brief


@compiled
def measure_slab(x: Rows, a: int, b: int, shapes: Shapes, lists: Neighbours) -> Number:
    """Compute the distances of two bodies' vertices from the other body, along the line of their boxes'
    centres, and return the gap between the bodies [m]."""
    axis = unit(row(lists.low, b) + row(lists.high, b) - (row(lists.low, a) + row(lists.high, a)))
    last = -FAR + 0.0 * axis[0]
    first = FAR + 0.0 * axis[0]
    for k in range(shapes.start[VERTICES, a], shapes.start[VERTICES, a + 1]):
        last = maximum(last, dot(axis, row(x, shapes.vertices[k, 0])))
    for k in range(shapes.start[VERTICES, b], shapes.start[VERTICES, b + 1]):
        i = shapes.vertices[k, 0]
        place = dot(axis, row(x, i))
        first = minimum(first, place)
        store(lists.along, i, place - last)
    for k in range(shapes.start[VERTICES, a], shapes.start[VERTICES, a + 1]):
        i = shapes.vertices[k, 0]
        store(lists.along, i, first - dot(axis, row(x, i)))
    return first - last


@compiled
def make_space(a: int, b: int, shapes: Shapes, lists: Neighbours) -> None:
    """Reset all lists if those of two bodies may not fit after the others; then no list is reused."""
    sizes = (lists.vertex.size, lists.triangle.size, lists.edge.size)
    fits = True
    for kind in range(3):
        start = shapes.start
        count = start[kind, a + 1] - start[kind, a] + (start[kind, b + 1] - start[kind, b])
        fits = fits and lists.used[kind] + count <= sizes[kind]
    if not fits:
        lists.kept[0] = False
        empty(lists)


@compiled
def list_kind(
    kind: int, side: int, wide: Number, brief: bool, near: Near, seen: Search, members: Indices
) -> None:
    """List the features of a kind of one body that are near the other's box, and in the slab.

    Lists to be reused have the same features in all copies, which makes rows fast to load.
    """
    body = near.bodies[side]
    other = near.bodies[1 - side]
    x = seen.x
    lists = seen.lists
    start = seen.pairs.shapes.start
    p = near.pair
    first = lists.used[kind]
    lists.ends[p, kind, side] = lists.ends[p, kind, side + 1] = first
    if members is not None:
        of, particles = listed_as(kind, lists)
        have = 0.0 * wide
        rows = 0
        count = members.shape[1]
        for n in range(start[kind, body], start[kind, body + 1]):
            gap = load(lists.along, members[n, 0])
            for k in range(1, count):
                gap = minimum(gap, load(lists.along, members[n, k]))
            if any_lane(gap < wide):
                low = row(x, members[n, 0])
                high = low
                for k in range(1, count):
                    low = smaller(low, row(x, members[n, k]))
                    high = larger(high, row(x, members[n, k]))
                wanted = maximum(gap, outside(low, high, other, lists)) < wide
                if any_lane(wanted):
                    if not brief:
                        wanted = have >= 0.0
                    have = enlist(of, first, have, 1.0 * n, wanted)
                    rows = grown(rows, have)
        for m in range(first, first + rows):
            there = have > 1.0 * (m - first)
            feature = load(of, m)
            store(of, m, select(there, feature, NO_ENTRY))
            feature = filled(there, feature)
            for k in range(count):
                store(particles, count * m + k, load_each(members, (feature, k)))
        lists.used[kind] = lists.ends[p, kind, side + 1] = first + rows


@compiled
def listed_as(kind: int, lists: Neighbours) -> tuple[Numbers, Numbers]:
    """Return the list of features of a kind, and that of their particles."""
    if kind == VERTICES:
        return lists.vertex, lists.vertex_particle
    if kind == TRIANGLES:
        return lists.triangle, lists.triangle_particles
    return lists.edge, lists.edge_particles


@compiled
def locate(p: int, seen: Search, triangles: Indices, edges: Indices) -> None:
    """Compute positions of a pair's listed features; entries that a copy lacks are far from all others."""
    x = seen.x
    lists = seen.lists
    far = FAR + 0.0 * load(lists.reach, p)
    for k in range(lists.ends[p, VERTICES, 0], lists.ends[p, VERTICES, 2]):
        point = row_each(x, load(lists.vertex_particle, k))
        set_row(lists.point, k, choose(load(lists.vertex, k) < 0.0, vec(far, far, far), point))
    if triangles is not None:
        for k in range(lists.ends[p, TRIANGLES, 0], lists.ends[p, TRIANGLES, 2]):
            corner = row_each(x, load(lists.triangle_particles, 3 * k))
            u = row_each(x, load(lists.triangle_particles, 3 * k + 1)) - corner
            q = row_each(x, load(lists.triangle_particles, 3 * k + 2)) - corner
            across = cross(u, q)
            set_row(lists.corner, k, corner)
            set_row(lists.first, k, u)
            set_row(lists.second, k, q)
            set_row(lists.normal, k, across)
            square = select(load(lists.triangle, k) < 0.0, NO_ENTRY, dot(across, across))
            store(lists.square, k, square)
            uu = dot(u, u)
            uw = dot(u, q)
            ww = dot(q, q)
            third = uu - 2.0 * uw + ww
            inverse = 1.0 / (square + GUARD)
            of_sides = 1.0 / (uu * ww * third + GUARD)
            set_row(lists.products, k, vec(uu, uw, ww))
            set_row(lists.sizes, k, vec(inverse, of_sides, maximum(maximum(uu, ww), third)))
    if edges is not None:
        for k in range(lists.ends[p, EDGES, 0], lists.ends[p, EDGES, 2]):
            start = row_each(x, load(lists.edge_particles, 2 * k))
            way = row_each(x, load(lists.edge_particles, 2 * k + 1)) - start
            none, away = load(lists.edge, k) < 0.0, (k + 2.0) * far  # all in different places
            set_row(lists.start, k, choose(none, vec(away, away, away), start))
            set_row(lists.way, k, choose(none, 0.0 * way, way))


@compiled
def list_candidates(p: int, every: bool, seen: Search, triangles: Indices, edges: Indices) -> None:
    """List the candidates of a pair: vertices and triangles, or two edges, that are near in any copy.

    If ``every``, or if there is no space for more, all listed features are candidates.
    """
    lists = seen.lists
    ends = seen.lists.ends
    if triangles is not None:
        for side in range(2):
            of = ends[p, VERTICES, side], ends[p, VERTICES, side + 1]
            others = ends[p, TRIANGLES, 1 - side], ends[p, TRIANGLES, 2 - side]
            list_near(p, of, others, every, lists, lists.faces, face_is_near)
    if edges is not None:
        of = ends[p, EDGES, 0], ends[p, EDGES, 1]
        others = ends[p, EDGES, 1], ends[p, EDGES, 2]
        list_near(p, of, others, every, lists, lists.partners, edge_is_near)


@compiled
def list_near(
    p: int,
    of: tuple[int, int],
    others: tuple[int, int],
    every: bool,
    lists: Neighbours,
    candidates: np.ndarray,
    is_near: Callable[[int, int, Number, Neighbours], bool],
) -> None:
    """List the ``others`` that are near each feature ``of`` a body in any copy, by ``is_near``.

    Both are half-open ranges of rows. The range of row m's candidates is written into row m of ``candidates``
    (rows, 2).
    """
    wide = load(lists.listed, p)
    used = lists.used[CANDIDATES]
    first, behind = others
    for m in range(of[0], of[1]):
        candidates[m, 0] = first
        candidates[m, 1] = behind
        if not every and used + behind - first <= lists.candidate.size:
            candidates[m, 0] = used
            for n in range(first, behind):
                if is_near(m, n, wide, lists):
                    lists.candidate[used] = n
                    used += 1
            candidates[m, 1] = used
    lists.used[CANDIDATES] = used


@compiled
def face_is_near(m: int, n: int, wide: Number, lists: Neighbours) -> bool:
    """Return whether a vertex may be near a triangle in any copy: near its plane and its box."""
    r = row(lists.point, m) - row(lists.corner, n)
    u = row(lists.first, n)
    q = row(lists.second, n)
    none, height = 0.0 * u, dot(row(lists.normal, n), r)  # times |normal|
    gap = box_gap(r, r, smaller(smaller(u, q), none), larger(larger(u, q), none))
    return any_lane(select(height * height <= wide * wide * load(lists.square, n), gap, FAR) < wide)


@compiled
def edge_is_near(m: int, n: int, wide: Number, lists: Neighbours) -> bool:
    """Return whether two edges may be near each other in any copy: their lines, if skew, and their boxes."""
    a = row(lists.way, m)
    b = row(lists.way, n)
    r = row(lists.start, m) - row(lists.start, n)
    none = 0.0 * a
    across = cross(a, b)
    square = dot(across, across)
    h = dot(r, across)
    gap = box_gap(smaller(r, r + a), larger(r, r + a), smaller(none, b), larger(none, b))
    skew = square > SKEW * (dot(a, a) * dot(b, b))
    return any_lane(select(select(skew, h * h, 0.0) > wide * wide * square, FAR, gap) < wide)


# --- Contacts -----------------------------------------------------------------------------------------


@compiled
def compare(count: int, near: Near, seen: Search, triangles: Indices, edges: Indices) -> int:
    """Add the contacts of a pair after ``count`` others, and return the number of rows."""
    lists = seen.lists
    p = near.pair
    contacts = seen.contacts
    shapes: Shapes = seen.pairs.shapes  # type: ignore[assignment]
    ends = lists.ends
    rods = shapes.rods
    balls = shapes.balls
    begin(contacts)
    first = count
    if triangles is not None:
        for m in range(ends[p, VERTICES, 0], ends[p, VERTICES, 2]):
            if lists.faces[m, 1] > lists.faces[m, 0]:
                count = vertex_faces(count, first, m, near, seen)
    if edges is not None:
        rows, have = crossing(near, seen)
        for k in range(rows):
            count = edge_edge(count, first, k, have, near, seen)
    if rods is not None:
        begin(contacts)
        first = count
        for side in range(2):
            if is_of(near.bodies[1 - side], rods):
                for m in range(ends[p, VERTICES, side], ends[p, VERTICES, side + 1]):
                    count = vertex_rods(count, first, m, 1 - side, near, seen, rods)
    if is_of(near.bodies[0], balls) and is_of(near.bodies[1], balls):
        i = shapes.vertices[shapes.start[VERTICES, near.bodies[0]], 0]
        j = shapes.vertices[shapes.start[VERTICES, near.bodies[1]], 0]
        begin(contacts)
        count = ball_ball(count, count, i, j, near, seen, balls)
    return count


@compiled
def is_of(body: int, kind: Indices) -> bool:
    """Return whether a body is of a kind."""
    if kind is None:
        return False
    return kind[body]
