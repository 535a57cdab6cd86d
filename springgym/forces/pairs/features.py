"""Where the features of two bodies meet: vertex and face, vertex and rod, ball and ball, edge and edge.

A contact has up to four particles with weights w (sum 0; + on one body, − on the other), a unit normal n,
a signed distance d and a share Φ of the strength, such that Σ w x = d n (less radii) and u = n · Σ w v =
ḋ.

Vertex and face. Of the triangles of a closed surface the nearest counts, by the key |D|² − 1e-6 h², with
D from the nearest point and h the height over its plane: of triangles that share this point the second
term picks the one that the vertex faces, whose sign of h is that of the distance. A vertex behind a
triangle must have come through it since the step began, in t seconds: h − t ḣ > 0. If it came through
another, that one counts, be it farther.

Edge and edge, or rods. At the critical point of the two lines, if it lies inside both. Φ falls to 0
towards the ends and towards parallel lines, where vertices take over. The normal is that of the step's
beginning: where the lines passed through each other since then, d is negative.
"""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.forces.pairs.terms import FAR, OVERFLOW, tell
from springgym.kinds import Number, Numbers, Rows, Vector
from springgym.lanes import any_lane, epsilon, load, maximum, minimum, select, sqrt, store
from springgym.vectors import TINY, choose, cross, dot, minus, plus, row, set_row, times, unit

TIE, ROUGH = 1e-6, 8192.0
"""Share of h² in the key of a triangle, and what each `epsilon` adds: 1e-3 in single precision."""

TAPER = 0.5
"""Length over which Φ of an edge rises from its ends, as a share of Δ."""

LEAST_SHARE = 1e-6
"""Of less, there is no contact."""


@compiled
def smooth(y: Number) -> Any:
    """From 0 to 1 for y from 0 to 1, flat at both ends."""
    y = minimum(maximum(y, 0.0), 1.0)
    return y * y * (3.0 - 2.0 * y)


@compiled
def within(y: Number) -> Any:
    """The nearest number from 0 to 1."""
    return minimum(maximum(y, 0.0), 1.0)


@compiled
def weighted(x: Rows, i: int, wi: Number, j: Any, wj: Number, k: int, wk: Number) -> Any:
    """The sum of three rows, each times a number."""
    return plus(plus(times(wi, row(x, i)), times(wj, row(x, j))), times(wk, row(x, k)))


@compiled
def on_sides(uu: Number, uw: Number, ww: Number, e: Number, f: Number) -> Any:
    """Weights of the far corners in the point of a triangle's sides nearest to r.

    It is spanned by u and w, whose products are ``uu``, ``uw`` and ``ww``; ``e`` and ``f`` are u·r and w·r.
    """
    third = uu - 2.0 * uw + ww
    inverse = 1.0 / (uu * ww * third + TINY)
    t1, t2 = within(e * (ww * third * inverse)), within(f * (uu * third * inverse))
    q1, q2 = t1 * (t1 * uu - 2.0 * e), t2 * (t2 * ww - 2.0 * f)
    t3 = within((f - e + uu - uw) * (uu * ww * inverse))
    s3 = 1.0 - t3
    q3 = s3 * (s3 * uu + 2.0 * t3 * uw - 2.0 * e) + t3 * (t3 * ww - 2.0 * f)
    first, second = q1 <= minimum(q2, q3), q2 <= q3
    return select(first, t1, select(second, 0.0, s3)), select(first, 0.0, select(second, t2, t3))


@compiled
def add_contact(
    k: Number,
    p: Number,
    count: Any,
    i: Vector,
    w: Vector,
    n: Vector,
    d: Number,
    share: Number,
    pairs: Any,
    room: Any,
    tally: Numbers,
) -> Any:
    """Add a contact of particles i with weights w in the lanes where ``share`` is positive; the new count."""
    have = load(room.have, 0)
    wanted = share > 0.0
    fits = select(wanted, have, FAR) < 1.0 * pairs.most
    tell(tally, p, OVERFLOW, select(fits, 0.0, select(wanted, 1.0, 0.0 * have)))
    if any_lane(fits):
        store(room.have, 0, have + select(fits, 1.0, 0.0 * have))
        room.pair[k], room.members[k] = p, count
        room.particles[k, 0], room.particles[k, 1] = i[0], i[1]
        room.particles[k, 2], room.particles[k, 3] = i[2], i[3]
        store(room.weight, 4 * k, select(fits, w[0], 0.0))
        store(room.weight, 4 * k + 1, select(fits, w[1], 0.0))
        store(room.weight, 4 * k + 2, select(fits, w[2], 0.0))
        store(room.weight, 4 * k + 3, select(fits, w[3], 0.0))
        set_row(room.toward, k, n)
        store(room.distance, k, select(fits, d, FAR))
        store(room.share, k, select(fits, share, 0.0))
        k += 1
    return k


@compiled
def vertex_faces(
    k: Number,
    p: Number,
    i: int,
    first: Any,
    last: Any,
    x: Rows,
    w: Rows,
    lead: Number,
    near: Number,
    radius: Number,
    triangles: Any,
    pairs: Any,
    room: Any,
    tally: Numbers,
) -> Any:
    """The contact of particle i with the nearest of the triangles ``first`` … ``last`` of those near.

    Each triangle is asked no more than it takes to know that it is not near: first its plane, then its sides.
    """
    if triangles is not None:
        point = row(x, i)
        limit = near * near
        best = FAR + 0.0 * point[0]
        for m in range(first, last):
            t = room.near[1, m]
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            normal, square, corner = row(room.normal, m), load(room.square, m), row(x, a)
            r = minus(point, corner)
            height = dot(normal, r)  # times |normal|
            close = height * height < limit * square
            key = FAR + 0.0 * height
            if any_lane(close):
                u, q = minus(row(x, b), corner), minus(row(x, c), corner)
                uu, uw, ww, e, f = dot(u, u), dot(u, q), dot(q, q), dot(u, r), dot(q, r)
                inverse = 1.0 / (square + TINY)
                wb, wc = (ww * e - uw * f) * inverse, (uu * f - uw * e) * inverse
                side = minimum(minimum(wb, wc), 1.0 - wb - wc)
                past = minimum(side, 0.0)
                longest = maximum(maximum(uu, ww), uu - 2.0 * uw + ww)
                close = select(close, past * past * square, FAR) < limit * longest
                if any_lane(close):
                    if any_lane(select(close, side, 0.0) < 0.0):
                        sb, sc = on_sides(uu, uw, ww, e, f)
                        wb, wc = select(side < 0.0, sb, wb), select(side < 0.0, sc, wc)
                    apart = minus(minus(r, times(wb, u)), times(wc, q))
                    key = dot(apart, apart) - (TIE + ROUGH * epsilon(r[0])) * (height * height * inverse)
                    key = select(select(close, key, FAR) < limit, key, FAR)
                    behind = select(close, height, 1.0) < 0.0
                    if any_lane(behind):
                        rate = dot(normal, minus(row(w, i), weighted(w, a, 1.0 - wb - wc, b, wb, c, wc)))
                        credible = select(behind, height - lead * rate, 1.0) > 0.0
                        key = select(credible, key, key + 4.0 * limit)  # after all that are
                    store(room.first, m, wb)
                    store(room.second, m, wc)
            store(room.key, m, key)
            best = minimum(best, key)
        best = select(best < 5.0 * limit, best, -FAR)
        if any_lane(best > -1.0):
            for m in range(first, last):
                won = load(room.key, m) <= best
                if any_lane(won):
                    t = room.near[1, m]
                    a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
                    normal, wb, wc = row(room.normal, m), load(room.first, m), load(room.second, m)
                    apart = minus(point, weighted(x, a, 1.0 - wb - wc, b, wb, c, wc))
                    d = sqrt(dot(apart, apart) + TINY)
                    touching = d < 1e-9 * near
                    d = select(dot(normal, minus(point, row(x, a))) < 0.0, -d, d)
                    n = choose(touching, unit(normal), times(1.0 / d, apart))
                    k = add_contact(
                        k,
                        p,
                        4,
                        (i, a, b, c),
                        (1.0 + 0.0 * d, wb + wc - 1.0, -wb, -wc),
                        n,
                        d - radius,
                        select(won, 1.0 + 0.0 * d, 0.0),
                        pairs,
                        room,
                        tally,
                    )
                    best = select(won, -FAR, best)
    return k


@compiled
def vertex_rods(
    k: Number,
    p: Number,
    i: int,
    first: Any,
    last: Any,
    x: Rows,
    w: Rows,
    lead: Number,
    near: Number,
    radius: Number,
    edges: Any,
    rods: Any,
    pairs: Any,
    room: Any,
    tally: Numbers,
) -> Any:
    """The contact of particle i with the nearest of the rods ``first`` … ``last`` of those near."""
    if rods is not None:
        point = row(x, i)
        best = FAR + 0.0 * point[0]
        for m in range(first, last):
            e = room.near[2, m]
            start = row(x, edges[e, 0])
            way, r = minus(row(x, edges[e, 1]), start), minus(point, start)
            apart = minus(r, times(within(dot(r, way) / (dot(way, way) + TINY)), way))
            key = dot(apart, apart)
            store(room.key, m, key)
            best = minimum(best, key)
        best = select(best < near * near, best, -FAR)
        if any_lane(best > -1.0):
            for m in range(first, last):
                won = load(room.key, m) <= best
                if any_lane(won):
                    e = room.near[2, m]
                    a, b = edges[e, 0], edges[e, 1]
                    way, r = minus(row(x, b), row(x, a)), minus(point, row(x, a))
                    t = within(dot(r, way) / (dot(way, way) + TINY))
                    apart = minus(r, times(t, way))
                    d = sqrt(dot(apart, apart) + TINY)
                    n = times(1.0 / d, apart)
                    speed = dot(n, minus(row(w, i), plus(times(1.0 - t, row(w, a)), times(t, row(w, b)))))
                    through = d - lead * speed < 0.0
                    n = choose(through, times(-1.0, n), n)
                    d = select(through, -d, d)
                    k = add_contact(
                        k,
                        p,
                        3,
                        (i, a, b, i),
                        (1.0 + 0.0 * d, t - 1.0, -t, 0.0 * d),
                        n,
                        d - radius,
                        select(won, 1.0 + 0.0 * d, 0.0),
                        pairs,
                        room,
                        tally,
                    )
                    best = select(won, -FAR, best)
    return k


@compiled
def ball_ball(
    k: Number,
    p: Number,
    i: int,
    j: Any,
    x: Rows,
    near: Any,
    radius: Number,
    balls: Any,
    pairs: Any,
    room: Any,
    tally: Numbers,
) -> Any:
    """The contact of two balls."""
    if balls is not None:
        apart = minus(row(x, i), row(x, j))
        d = sqrt(dot(apart, apart) + TINY)
        meets = d < near
        if any_lane(meets):
            one = 1.0 + 0.0 * d
            k = add_contact(
                k,
                p,
                2,
                (i, j, i, j),
                (one, -one, 0.0 * d, 0.0 * d),
                times(1.0 / d, apart),
                d - radius,
                select(meets, one, 0.0),
                pairs,
                room,
                tally,
            )
    return k


@compiled
def edge_edge(
    k: Number,
    p: Number,
    ends: Any,
    start: Vector,
    a: Vector,
    x: Rows,
    w: Rows,
    lead: Number,
    near: Number,
    radius: Number,
    pairs: Any,
    room: Any,
    tally: Numbers,
) -> Any:
    """The contact of two edges or rods inside both; the first begins at ``start`` and goes along ``a``."""
    i, j, m, n = ends
    corner = row(x, m)
    b, r = minus(row(x, n), corner), minus(start, corner)
    across = cross(a, b)
    square, h = dot(across, across), dot(r, across)
    spare = near * near * square - h * h
    if any_lane(spare > 0.0):
        aa, ab, bb, ar, br = dot(a, a), dot(a, b), dot(b, b), dot(a, r), dot(b, r)
        inverse = 1.0 / (square + TINY)
        s, t = (ab * br - bb * ar) * inverse, (aa * br - ab * ar) * inverse
        inside = minimum(minimum(minimum(s, 1.0 - s), minimum(t, 1.0 - t)), spare) > 0.0
        if any_lane(inside):
            share = edge_share(s, t, aa, bb, square, p, pairs)
            share = select(select(inside, share, 0.0) > LEAST_SHARE, share, 0.0)
            scale = sqrt(inverse)
            scale = select(h < 0.0, -scale, scale)
            normal, d = times(scale, across), h * scale
            speed = minus(
                plus(times(1.0 - s, row(w, i)), times(s, row(w, j))),
                plus(times(1.0 - t, row(w, m)), times(t, row(w, n))),
            )
            through = d - lead * dot(normal, speed) < 0.0
            normal = choose(through, times(-1.0, normal), normal)
            d = select(through, -d, d)
            if any_lane(share > 0.0):
                k = add_contact(
                    k,
                    p,
                    4,
                    (i, j, m, n),
                    (1.0 - s, s, t - 1.0, -t),
                    normal,
                    d - radius,
                    share,
                    pairs,
                    room,
                    tally,
                )
    return k


@compiled
def edge_share(s: Number, t: Number, aa: Number, bb: Number, square: Number, p: Any, pairs: Any) -> Any:
    """Φ of two edges that meet at s and t, with |a|², |b|² and |a × b|²."""
    taper = 1.0 / (TAPER * pairs.reach[p])
    la, lb = sqrt(aa) * taper, sqrt(bb) * taper
    share = smooth(s * la) * smooth((1.0 - s) * la) * smooth(t * lb) * smooth((1.0 - t) * lb)
    return share * smooth(square / (aa * bb + TINY) * (1.0 / pairs.parallel[p]))
