"""Narrow phase: contacts of vertex and face, vertex and rod, ball and ball, edge and edge.

A contact has up to four particles with weights w (sum 0; + on the first body, − on the second), a unit normal
n from the second to the first, a signed distance d and a factor Φ of the strength, such that Σ w x = d n
(less radii) and u = n · Σ w v = ḋ.

Vertex and face. The nearest triangle of a closed surface counts, by the key |D|² − 1e-6 h², with D from the
nearest point and h the height over its plane: among triangles that share this point the second term picks the
one that the vertex faces, whose sign of h is the sign of the distance. A vertex behind a triangle must have
passed through it since the step began, t seconds ago: h − t ḣ > 0. If it passed through another triangle,
that one counts, even if it is farther. Triangles that the vertex faces are searched a little farther, so that
the nearest is not left out while its neighbour, behind which the vertex lies, is found.

Edge and edge, or rods. The contact is at the closest points of the two lines, if they lie inside both edges.
Φ falls to 0 towards the ends and for parallel lines, where vertices take over. The normal has the direction
of the step's beginning: where the lines passed through each other since then, d is negative.
"""

from __future__ import annotations

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.core.language.lanes import any_lane, epsilon, filled, maximum, minimum, select, sqrt
from springgym.core.language.memory import load, load_each, store, store_each
from springgym.core.language.vectors import (
    GUARD,
    choose,
    cross,
    dot,
    row,
    row_each,
    set_row,
    set_row_each,
    unit,
    vec,
)
from springgym.dynamics.records import (
    FAR,
    NO_ENTRY,
    Closest,
    ContactRows,
    Near,
    Neighbours,
    Pairs,
    Quad,
    Search,
)

TIE = 1e-6
"""Factor of h² in the key of a triangle."""

ROUGH = 8192.0
"""Increase of `TIE` per `epsilon`: 1e-3 in single precision."""

TAPER = 0.5
"""Length over which Φ of an edge rises from its ends, as a share of Δ."""

LEAST_SHARE = 1e-6
"""Edges with a smaller Φ have no contact."""


@compiled
def smooth(y: Number) -> Number:
    """Return the smooth step 3y² − 2y³, which rises from 0 at y ≤ 0 to 1 at y ≥ 1."""
    y = minimum(maximum(y, 0.0), 1.0)
    return y * y * (3.0 - 2.0 * y)


@compiled
def within(y: Number) -> Number:
    """Return y clipped to 0…1."""
    return minimum(maximum(y, 0.0), 1.0)


@compiled
def on_sides(
    uu: Number, uw: Number, ww: Number, inverse: Number, e: Number, f: Number
) -> tuple[Number, Number]:
    """Return the weights of the second and third corner in the point of a triangle's sides nearest to r.

    The triangle is spanned by u and w, whose products are ``uu``, ``uw`` and ``ww``; ``inverse`` is 1 over
    the product of its sides' squares; ``e`` and ``f`` are u·r and w·r.
    """
    third = uu - 2.0 * uw + ww
    t1 = within(e * (ww * third * inverse))
    t2 = within(f * (uu * third * inverse))
    q1 = t1 * (t1 * uu - 2.0 * e)
    q2 = t2 * (t2 * ww - 2.0 * f)
    t3 = within((f - e + uu - uw) * (uu * ww * inverse))
    s3 = 1.0 - t3
    q3 = s3 * (s3 * uu + 2.0 * t3 * uw - 2.0 * e) + t3 * (t3 * ww - 2.0 * f)
    first = q1 <= minimum(q2, q3)
    second = q2 <= q3
    return select(first, t1, select(second, 0.0, s3)), select(first, 0.0, select(second, t2, t3))


# --- Lists --------------------------------------------------------------------------------------------


@compiled
def enlist(kind: Numbers, first: int, have: Number, what: Number, wanted: Mask) -> Number:
    """Append ``what`` to a list that begins at row ``first``, in the copies where it is ``wanted``.

    ``have`` is the number of entries of each copy; return the new number.
    """
    put_where(kind, filled(wanted, have + first), wanted, what + 0.0 * have)
    return have + select(wanted, 1.0, 0.0 * have)


@compiled
def put_where(array: Numbers, k: Number, wanted: Mask, what: Number) -> None:
    """Store ``what`` in each copy's row ``k`` of an array, where it is ``wanted``; all rows must exist."""
    store_each(array, k, select(wanted, what, load_each(array, k)))


@compiled
def grown(rows: int, have: Number) -> int:
    """Return the number of rows of a list after an entry was added: ``rows``, or one more."""
    return rows + (1 if any_lane(have > 1.0 * rows) else 0)


@compiled
def begin(contacts: ContactRows) -> None:
    """Start the next contacts of all copies in the same row."""
    store(contacts.counts, 1, 0.0)


@compiled
def leave_out(pair: int, one: Number, contacts: ContactRows) -> None:
    """Count a contact for which there is no space, where ``one`` is 1."""
    store(contacts.left_out, pair, load(contacts.left_out, pair) + one)


@compiled
def add_contact(count: int, first: int, members: int, touch: Closest, near: Near, seen: Search) -> int:
    """Add a contact of each copy after its others, from row ``first`` on; return the number of rows."""
    contacts = seen.contacts
    whole = load(contacts.counts, 0)
    own = load(contacts.counts, 1)
    wanted = touch.share > 0.0
    fits = select(wanted, whole, FAR) < 1.0 * seen.pairs.most
    one = select(fits, 1.0, 0.0 * whole)
    leave_out(near.pair, select(wanted, 1.0 - one, 0.0), contacts)
    if any_lane(fits):
        store(contacts.counts, 0, whole + one)
        store(contacts.counts, 1, own + one)
        none = 0.0 * whole
        i, j, m, n = touch.particles
        particles = (i + none, j + none, m + none, n + none)
        opens = select(fits, own, NO_ENTRY) > count - first - 0.5
        if any_lane(opens):
            clear(count, near.pair, members, particles, opens, contacts)
            count += 1
        k = filled(fits, own + first)
        for end in range(4):
            put_where(contacts.particle, 4.0 * k + end, fits, particles[end])
            put_where(contacts.weight, 4.0 * k + end, fits, touch.weights[end])
        set_row_each(contacts.normal, k, choose(fits, touch.normal, row_each(contacts.normal, k)))
        put_where(contacts.gap, k, fits, touch.gap)
        put_where(contacts.share, k, fits, touch.share)
    return count


@compiled
def clear(k: int, pair: int, members: int, particles: Quad, opens: Mask, contacts: ContactRows) -> None:
    """Initialise a new row of contacts, with the particles of a copy that ``opens`` it."""
    contacts.pair[k] = pair
    contacts.members[k] = members
    for end in range(4):
        store(contacts.particle, 4 * k + end, filled(opens, particles[end]))
        store(contacts.weight, 4 * k + end, 0.0)
    set_row(contacts.normal, k, vec(0.0, 0.0, 1.0))
    store(contacts.gap, k, FAR)
    store(contacts.share, k, 0.0)


# --- Contacts -----------------------------------------------------------------------------------------


@compiled
def vertex_faces(count: int, first: int, m: int, near: Near, seen: Search) -> int:
    """List the contact of a vertex in row ``m`` with the nearest of its candidates, triangles of the other.

    Distant triangles are rejected early: first by their plane, then by their sides.
    """
    lists = seen.lists
    i = load(lists.vertex_particle, m)
    point = row(lists.point, m)
    tie = TIE + ROUGH * epsilon(point[0])
    limit = near.reach * near.reach
    wide = (1.0 + tie) * limit
    best = FAR + 0.0 * i
    face = 0.0 * i
    side_of = 0.0 * i
    second = 0.0 * i
    third = 0.0 * i
    away = 0.0 * point
    for candidate in range(lists.faces[m, 0], lists.faces[m, 1]):
        k = lists.candidate[candidate]
        normal = row(lists.normal, k)
        square = load(lists.square, k)
        r = point - row(lists.corner, k)
        height = dot(normal, r)  # times |normal|
        close = height * height < wide * square
        if any_lane(close):
            u = row(lists.first, k)
            q = row(lists.second, k)
            products = row(lists.products, k)
            sizes = row(lists.sizes, k)
            uu = products[0]
            uw = products[1]
            ww = products[2]
            inverse = sizes[0]
            of_sides = sizes[1]
            longest = sizes[2]
            e = dot(u, r)
            f = dot(q, r)
            wb = (ww * e - uw * f) * inverse
            wc = (uu * f - uw * e) * inverse
            side = minimum(minimum(wb, wc), 1.0 - wb - wc)
            past = minimum(side, 0.0)
            close = select(close, past * past * square, FAR) < wide * longest
            if any_lane(close):
                if any_lane(select(close, side, 0.0) < 0.0):
                    sb, sc = on_sides(uu, uw, ww, of_sides, e, f)
                    wb = select(side < 0.0, sb, wb)
                    wc = select(side < 0.0, sc, wc)
                apart = r - wb * u - wc * q
                behind = select(close, height, 1.0) < 0.0
                squared = select(close, dot(apart, apart), FAR)
                key = squared - tie * (height * height * inverse)
                key = select(squared < select(behind, limit, wide), key, FAR)
                if any_lane(select(behind, key, FAR) < best):
                    w = seen.w
                    a, b, c = corners(0.0 * i + k, lists)
                    own = row_each(w, i)
                    across = own - weighted(w, a, 1.0 - wb - wc, b, wb, c, wc)
                    credible = select(behind, height - near.lead * dot(normal, across), 1.0) > 0.0
                    key = select(credible, key, key + 4.0 * limit)  # after all credible ones
                better = key < best
                best = select(better, key, best)
                face = select(better, 1.0 * k, face)
                second = select(better, wb, second)
                third = select(better, wc, third)
                away = choose(better, apart, away)
                side_of = select(better, height, side_of)
    won = best < 5.0 * limit
    if any_lane(won):
        face = filled(won, face)
        d = sqrt(dot(away, away) + GUARD)
        n = 1.0 / select(side_of < 0.0, -d, d) * away
        touching = d < 1e-9 * near.reach
        if any_lane(touching):
            n = choose(touching, unit(row_each(lists.normal, face)), n)
        d = select(side_of < 0.0, -d, d)
        one = side_of_vertex(m, near, lists) + 0.0 * d
        a, b, c = corners(face, lists)
        particles = (i, a, b, c)
        weights = (one, one * (second + third - 1.0), -one * second, -one * third)
        touch = Closest(particles, weights, one * n, d - near.radius, select(won, 1.0 + 0.0 * d, 0.0))
        count = add_contact(count, first, 4, touch, near, seen)
    return count


@compiled
def side_of_vertex(m: int, near: Near, lists: Neighbours) -> float:
    """Return 1 if the vertex in row ``m`` is of the first body, and −1 if it is of the second."""
    return 1.0 if m < lists.ends[near.pair, 0, 1] else -1.0


@compiled
def corners(n: Number, lists: Neighbours) -> tuple[Number, Number, Number]:
    """Return the particles of the triangles in rows ``n`` of the copies' lists."""
    of = lists.triangle_particles
    k = 3.0 * n
    return load_each(of, k), load_each(of, k + 1.0), load_each(of, k + 2.0)


@compiled
def weighted(x: Rows, i: Number, wi: Number, j: Number, wj: Number, k: Number, wk: Number) -> Vector:
    """Return the weighted sum of three rows, with row indices of each copy."""
    return wi * row_each(x, i) + wj * row_each(x, j) + wk * row_each(x, k)


@compiled
def vertex_rods(
    count: int, first: int, m: int, other: int, near: Near, seen: Search, rods: np.ndarray | None
) -> int:
    """List the contact of a vertex in row ``m`` with the nearest of the rods of the ``other`` body."""
    if rods is not None:
        lists = seen.lists
        w = seen.w
        i = load(lists.vertex_particle, m)
        point = row(lists.point, m)
        best = FAR + 0.0 * i
        rod = 0.0 * i
        t = 0.0 * i
        away = 0.0 * point
        for k in range(lists.ends[near.pair, 2, other], lists.ends[near.pair, 2, other + 1]):
            way = row(lists.way, k)
            r = point - row(lists.start, k)
            share = within(dot(r, way) / (dot(way, way) + GUARD))
            apart = r - share * way
            key = dot(apart, apart)
            better = key < best
            best = select(better, key, best)
            rod = select(better, 1.0 * k, rod)
            t = select(better, share, t)
            away = choose(better, apart, away)
        won = best < near.reach * near.reach
        if any_lane(won):
            a, b = tips(filled(won, rod), lists)
            d = sqrt(dot(away, away) + GUARD)
            n = 1.0 / d * away
            along = (1.0 - t) * row_each(w, a) + t * row_each(w, b)
            through = d - near.lead * dot(n, row_each(w, i) - along) < 0.0
            n = choose(through, -1.0 * n, n)
            d = select(through, -d, d)
            one = side_of_vertex(m, near, lists) + 0.0 * d
            weights = (one, one * (t - 1.0), -one * t, 0.0 * d)
            touch = Closest((i, a, b, i), weights, one * n, d - near.radius, select(won, 1.0 + 0.0 * d, 0.0))
            count = add_contact(count, first, 3, touch, near, seen)
    return count


@compiled
def tips(n: Number, lists: Neighbours) -> tuple[Number, Number]:
    """Return the particles of the edges in rows ``n`` of the copies' lists."""
    return load_each(lists.edge_particles, 2.0 * n), load_each(lists.edge_particles, 2.0 * n + 1.0)


@compiled
def ball_ball(
    count: int, first: int, i: int, j: int, near: Near, seen: Search, balls: np.ndarray | None
) -> int:
    """List the contact of two balls."""
    if balls is not None:
        apart = row(seen.x, i) - row(seen.x, j)
        d = sqrt(dot(apart, apart) + GUARD)
        meets = d < near.reach
        if any_lane(meets):
            one = 1.0 + 0.0 * d
            weights = (one, -one, 0.0 * d, 0.0 * d)
            normal = 1.0 / d * apart
            touch = Closest((i, j, i, j), weights, normal, d - near.radius, select(meets, one, 0.0))
            count = add_contact(count, first, 2, touch, near, seen)
    return count


@compiled
def crossing(near: Near, seen: Search) -> tuple[int, Number]:
    """List edges or rods that cross inside both; return the number of rows, and that of each copy."""
    lists = seen.lists
    have = 0.0 * near.reach
    rows = 0
    for m in range(lists.ends[near.pair, 2, 0], lists.ends[near.pair, 2, 1]):
        start = row(lists.start, m)
        a = row(lists.way, m)
        for candidate in range(lists.partners[m, 0], lists.partners[m, 1]):
            n = lists.candidate[candidate]
            b = row(lists.way, n)
            r = start - row(lists.start, n)
            across = cross(a, b)
            square = dot(across, across)
            h = dot(r, across)
            spare = near.reach * near.reach * square - h * h
            if any_lane(spare > 0.0):
                aa = dot(a, a)
                ab = dot(a, b)
                bb = dot(b, b)
                ar = dot(a, r)
                br = dot(b, r)
                s, t = ab * br - bb * ar, aa * br - ab * ar  # times |a × b|²
                inside = minimum(minimum(minimum(s, square - s), minimum(t, square - t)), spare) > 0.0
                if any_lane(inside):
                    fits = select(inside, have, FAR) < 1.0 * seen.pairs.most
                    one = 1.0 + 0.0 * have
                    leave_out(near.pair, select(inside, select(fits, 0.0, one), 0.0), seen.contacts)
                    if any_lane(fits):
                        enlist(lists.crossed, 0, have, 1.0 * m, fits)
                        have = enlist(lists.crossing, 0, have, 1.0 * n, fits)
                        rows = grown(rows, have)
    return rows, have


@compiled
def edge_edge(count: int, first: int, k: int, have: Number, near: Near, seen: Search) -> int:
    """Add the contact of the crossing edges or rods in row ``k``; copies ``have`` so many."""
    lists = seen.lists
    w = seen.w
    there = have > 1.0 * k
    one = filled(there, load(lists.crossed, k))
    other = filled(there, load(lists.crossing, k))
    i, j = tips(one, lists)
    m, n = tips(other, lists)
    a = row_each(lists.way, one)
    b = row_each(lists.way, other)
    r = row_each(lists.start, one) - row_each(lists.start, other)
    across = cross(a, b)
    square = dot(across, across)
    h = dot(r, across)
    aa = dot(a, a)
    ab = dot(a, b)
    bb = dot(b, b)
    ar = dot(a, r)
    br = dot(b, r)
    inverse = 1.0 / (square + GUARD)
    s = (ab * br - bb * ar) * inverse
    t = (aa * br - ab * ar) * inverse
    share = edge_share(s, t, aa, bb, square, near.pair, seen.pairs)
    share = select(select(there, share, 0.0) > LEAST_SHARE, share, 0.0)
    if any_lane(share > 0.0):
        scale = sqrt(inverse)
        scale = select(h < 0.0, -scale, scale)
        normal = scale * across
        d = h * scale
        speed = (
            (1.0 - s) * row_each(w, i)
            + s * row_each(w, j)
            - ((1.0 - t) * row_each(w, m) + t * row_each(w, n))
        )
        through = d - near.lead * dot(normal, speed) < 0.0
        normal = choose(through, -1.0 * normal, normal)
        d = select(through, -d, d)
        touch = Closest((i, j, m, n), (1.0 - s, s, t - 1.0, -t), normal, d - near.radius, share)
        count = add_contact(count, first, 4, touch, near, seen)
    return count


@compiled
def edge_share(s: Number, t: Number, aa: Number, bb: Number, square: Number, p: int, pairs: Pairs) -> Number:
    """Return Φ of two edges that cross at s and t, with |a|², |b|² and |a × b|²."""
    taper = 1.0 / (TAPER * pairs.reach[p])
    la = sqrt(aa) * taper
    lb = sqrt(bb) * taper
    share = smooth(s * la) * smooth((1.0 - s) * la) * smooth(t * lb) * smooth((1.0 - t) * lb)
    return share * smooth(square / (aa * bb + GUARD) * (1.0 / pairs.parallel[p]))
