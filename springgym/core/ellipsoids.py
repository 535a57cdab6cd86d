"""Distances of ellipsoids from points, segments, triangles and each other.

An ellipsoid has a centre c, unit vectors e₁, e₂, e₃ along its axes and semi-axes a₁, a₂, a₃. With
S = Σ aᵢ² eᵢ eᵢᵀ its farthest point along n is c + S n/w, and w = √(n · S n) is how far it reaches: its width.

Every function returns a unit normal that points away from the ellipsoid, out of its nearest point, and the
distance along it, negative where both overlap. The nearest point follows from the normal alone (`support`).

Point. With y = q − c the nearest point p = c + (S + λ)⁻¹ S y has the normal (S + λ)⁻¹ y, where

    Σ bᵢ²/(aᵢ² + λ)² = 1,    bᵢ = aᵢ y · eᵢ,    d = λ |(S + λ)⁻¹ y|.

Newton's method for 1/√Σ, which is nearly straight, comes from below and never passes the root, as in the
subproblem of trust regions (Moré & Sorensen 1983, doi:10.1137/0904038).

Line. Seen along the line, an ellipsoid is an ellipse and the line is a point. The axes of the ellipse are
those of a symmetric 2 × 2 matrix, of which trace and determinant are sums of positive terms in the
ellipsoid's axes. Beyond the ends of a segment the nearest point is an end: the distance is convex. A line
that goes through the ellipsoid is nearest at the middle of its chord.

Triangle. Its plane is nearest at c + S n/w, if that lies over the triangle; if the plane cuts the ellipsoid,
by an ellipse, at its centre. Else a side is.

Ellipsoid. The distance is the largest separation s(n) = n · (c₂ − c₁) − w₁(n) − w₂(n) of all unit vectors n.
As s is concave in n, Newton's method in the plane across n climbs. Of some shares of each step the best is
taken: thin disks and needles turn their width within a small angle. It begins with the best of three: the way
between the centres, and the normals of both towards the other's centre. If both overlap by a stationary n,
all n with a larger separation lie on its other side, and the search begins anew there, from the best of the
normals across an axis of each.

Numbers of turns are bounded, and a copy that has found its number keeps it, whatever other copies need.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.core.blocks import aligned_zeros, numbers
from springgym.core.compiling import compiled, kernel
from springgym.core.kinds import Mask, Number, Rows, Vector
from springgym.core.lanes import any_lane, block_dtype, epsilon, maximum, minimum, select, sqrt
from springgym.core.vectors import TINY, choose, cross, dot, plus_scaled, row, set_row, unit, vec

TURNS = 30
"""The most turns of Newton's method; it takes some four to eight, where ellipsoids meet edge on some more."""

ANEW = 4
"""How often the search for the normal between two ellipsoids begins anew, at the most."""

POINT, SEGMENT, TRIANGLE, ELLIPSOID = range(4)
"""What `gaps` takes the distance from."""

FINE = 3e-5
"""Length of a step up to which Newton's method squares its error."""

FAR = 1e30
"""More than any distance [m]."""

AT_ONCE = 8
"""Ellipsoids of which `gaps` finds the distances at once."""

SHARES = (4.0, 0.3, 0.1, 0.03, 0.01, 1e-3, 1e-4)
"""Shares of Newton's step that are tried beside all of it."""


class Ellipsoid(NamedTuple):
    """An ellipsoid in space."""

    centre: Vector
    """c [m]"""
    axes: tuple[Vector, Vector, Vector]
    """e₁, e₂, e₃"""
    semi: Vector
    """a₁, a₂, a₃ [m]"""


@compiled
def absolute(a: Number) -> Number:
    """Return |a|."""
    return maximum(a, -1.0 * a)


@compiled
def times(u: Vector, w: Vector) -> Vector:
    """Return the products of the components of two vectors."""
    return vec(u[0] * w[0], u[1] * w[1], u[2] * w[2])


@compiled
def along_axes(u: Vector, of: Ellipsoid) -> Vector:
    """Return the components of a vector along an ellipsoid's axes."""
    return vec(dot(u, of.axes[0]), dot(u, of.axes[1]), dot(u, of.axes[2]))


@compiled
def in_space(u: Vector, of: Ellipsoid) -> Vector:
    """Return the vector that has components along an ellipsoid's axes."""
    return plus_scaled(plus_scaled(u[0] * of.axes[0], u[1], of.axes[1]), u[2], of.axes[2])


@compiled
def pulled(n: Vector, of: Ellipsoid) -> Vector:
    """Return S n [m²]."""
    return in_space(times(times(of.semi, of.semi), along_axes(n, of)), of)


@compiled
def width(n: Vector, of: Ellipsoid) -> Number:
    """Return how far an ellipsoid reaches from its centre along a unit vector [m]."""
    u = times(of.semi, along_axes(n, of))
    return sqrt(dot(u, u) + TINY)


@compiled
def support(n: Vector, of: Ellipsoid) -> Vector:
    """Return the farthest point of an ellipsoid along a unit vector [m]."""
    return plus_scaled(of.centre, 1.0 / width(n, of), pulled(n, of))


@compiled
def tangents(n: Vector) -> tuple[Vector, Vector]:
    """Return two unit vectors across n and each other (Duff et al. 2017, JCGT 6, 1)."""
    sign = select(n[2] < 0.0, -1.0 + 0.0 * n[2], 1.0)
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    return vec(1.0 + sign * n[0] * n[0] * a, sign * b, -1.0 * sign * n[0]), vec(
        b, sign + n[1] * n[1] * a, -n[1]
    )


# --- A point ----------------------------------------------------------------------------------------------


@compiled
def divided(u: Vector, w: Vector) -> Vector:
    """Return the quotients of the components of two vectors; none of the second is negative."""
    return vec(u[0] / (w[0] + TINY), u[1] / (w[1] + TINY), u[2] / (w[2] + TINY))


@compiled
def from_point(y: Vector, semi: Vector) -> tuple[Vector, Number]:
    """Return normal and distance of a point y of the frame in which an ellipsoid is about the origin."""
    b, squares = times(semi, y), times(semi, semi)
    low = vec(absolute(b[0]), absolute(b[1]), absolute(b[2])) - squares
    shift = maximum(maximum(low[0], low[1]), low[2])
    least = -1.0 * minimum(minimum(squares[0], squares[1]), squares[2])
    active, enough = 1.0 + 0.0 * shift, 4.0 * epsilon(shift)
    for _ in range(TURNS):
        below = squares + vec(shift, shift, shift)
        p = divided(b, below)
        size = dot(p, p)
        steep = dot(times(p, p), divided(vec(1.0, 1.0, 1.0) + 0.0 * p, below))
        root = sqrt(size + TINY)
        step = maximum((root - 1.0) * size / (steep + TINY), 0.0)
        new = maximum(shift + step, least)
        shift = select(active > 0.5, new, shift)
        active = select(step > enough * (absolute(shift) - least), active, 0.0)
        if not any_lane(active > 0.5):
            break
    raw = divided(y, squares + vec(shift, shift, shift))
    length = sqrt(dot(raw, raw) + TINY)
    return 1.0 / length * raw, shift * length


@compiled
def gap_to_point(q: Vector, of: Ellipsoid) -> tuple[Vector, Number]:
    """Return normal and distance of a point [m]."""
    n, d = from_point(along_axes(q - of.centre, of), of.semi)
    return in_space(n, of), d


# --- A segment ----------------------------------------------------------------------------------------------


@compiled
def gap_to_segment(start: Vector, way: Vector, of: Ellipsoid) -> tuple[Vector, Number, Number]:
    """Return normal and distance of a segment [m], and the share of its way at which it is nearest."""
    y, a, squares = along_axes(start - of.centre, of), along_axes(way, of), times(of.semi, of.semi)
    square = dot(a, a) + TINY
    k = 1.0 / sqrt(square) * a
    kk = times(k, k)
    others = vec(squares[1] * squares[2], squares[0] * squares[2], squares[0] * squares[1])
    area = dot(kk, others)  # of the ellipse, over π, squared
    e, f = tangents(k)
    ee, ef, ff = dot(times(squares, e), e), dot(times(squares, e), f), dot(times(squares, f), f)
    less = 0.5 * (ee - ff)
    half = sqrt(less * less + ef * ef)
    far = 0.5 * (ee + ff) + half
    near = area / (far + TINY)
    cosine, sine, wide = less / (half + TINY), ef / (half + TINY), less > 0.0
    first = unit(select(wide, 1.0 + cosine, sine) * e + select(wide, sine, 1.0 - cosine) * f)
    second = cross(k, first)
    none = 0.0 * square
    flat = vec(dot(y, first), dot(y, second), none)
    m, d = from_point(flat, vec(sqrt(far), sqrt(near), 1.0 + none))
    n = m[0] * first + m[1] * second
    p = 1.0 / sqrt(dot(times(squares, n), n) + TINY) * times(squares, n)
    steep = divided(a, squares)
    t = select(d < 0.0, -1.0 * dot(y, steep) / (dot(a, steep) + TINY), dot(p - y, a) / square)
    share = minimum(maximum(t, 0.0), 1.0)
    beyond = absolute(t - share) > 0.0
    if any_lane(beyond):
        end, apart = from_point(plus_scaled(y, share, a), of.semi)
        n, d = choose(beyond, end, n), select(beyond, apart, d)
    return in_space(n, of), d, share


# --- A triangle ---------------------------------------------------------------------------------------------


class Nearest(NamedTuple):
    """Where a triangle is nearest to an ellipsoid."""

    normal: Vector
    """unit vector away from the ellipsoid"""
    gap: Number
    """the distance [m]"""
    second: Number
    """weight of the triangle's second corner"""
    third: Number
    """and of its third"""


@compiled
def gap_to_triangle(corner: Vector, u: Vector, q: Vector, of: Ellipsoid) -> Nearest:
    """Return where a triangle is nearest, which has sides u and q from a corner, if it faces the centre."""
    across = cross(u, q)
    square = dot(across, across) + TINY
    face = -1.0 / sqrt(square) * across
    height, reach = dot(face, corner - of.centre), width(face, of)
    gap = height - reach
    foot = plus_scaled(of.centre - corner, minimum(height, reach) / (reach * reach), pulled(face, of))
    second, third = dot(across, cross(foot, q)) / square, dot(across, cross(u, foot)) / square
    outside = minimum(minimum(second, third), 1.0 - second - third) < 0.0
    found = Nearest(face, gap, second, third)
    if any_lane(outside):
        best, side = 0.0 * gap + 1e30, found
        for k in range(3):
            start = corner + u if k == 2 else corner
            way = u if k == 0 else (q if k == 1 else q - u)
            n, d, t = gap_to_segment(start, way, of)
            wb = t if k == 0 else (0.0 * t if k == 1 else 1.0 - t)
            wc = 0.0 * t if k == 0 else t
            better = d < best
            best = select(better, d, best)
            side = nearer(better, Nearest(n, d, wb, wc), side)
        found = nearer(outside, side, found)
    return found


@compiled
def nearer(mask: Mask, one: Nearest, other: Nearest) -> Nearest:
    """Return ``one`` in the lanes where the mask holds, and the ``other`` in all else."""
    return Nearest(
        choose(mask, one.normal, other.normal),
        select(mask, one.gap, other.gap),
        select(mask, one.second, other.second),
        select(mask, one.third, other.third),
    )


# --- Another ellipsoid --------------------------------------------------------------------------------------


@compiled
def separation(n: Vector, apart: Vector, first: Ellipsoid, second: Ellipsoid) -> Number:
    """Return s of a unit vector [m]."""
    return dot(n, apart) - width(n, first) - width(n, second)


@compiled
def newton_step(n: Vector, apart: Vector, first: Ellipsoid, second: Ellipsoid) -> tuple[Vector, Number]:
    """Return Newton's step across n, and s [m]."""
    pull, other = pulled(n, first), pulled(n, second)
    w, z = sqrt(dot(n, pull) + TINY), sqrt(dot(n, other) + TINY)
    iw, iz = 1.0 / w, 1.0 / z
    slope = apart - iw * pull - iz * other
    s, size = dot(n, slope), sqrt(dot(apart, apart) + TINY)
    floor = maximum(s, 1e-6 * size)
    e, f = tangents(n)
    se, sf, ze, zf = pulled(e, first), pulled(f, first), pulled(e, second), pulled(f, second)
    pe, pf, oe, of = dot(pull, e), dot(pull, f), dot(other, e), dot(other, f)
    cw, cz = iw * iw * iw, iz * iz * iz
    ee = floor + iw * dot(e, se) - cw * pe * pe + iz * dot(e, ze) - cz * oe * oe
    ff = floor + iw * dot(f, sf) - cw * pf * pf + iz * dot(f, zf) - cz * of * of
    ef = iw * dot(e, sf) - cw * pe * pf + iz * dot(e, zf) - cz * oe * of
    ge, gf = dot(e, slope), dot(f, slope)
    inverse = 1.0 / maximum(ee * ff - ef * ef, 1e-6 * floor * floor + TINY)
    step = (inverse * (ff * ge - ef * gf)) * e + (inverse * (ee * gf - ef * ge)) * f
    return step, s


@compiled
def climb(n: Vector, among: Mask, first: Ellipsoid, second: Ellipsoid) -> Vector:
    """Return the normal at which the separation of two ellipsoids is stationary, from n on, in some lanes."""
    apart = second.centre - first.centre
    active = select(among, 1.0 + 0.0 * n[0], 0.0)
    enough = min(10.0 * sqrt(epsilon(n[0])), FINE)
    for _ in range(TURNS):
        step, s = newton_step(n, apart, first, second)
        length = sqrt(dot(step, step) + TINY)
        step = select(length > 1.0, 1.0 / length, 1.0) * step
        full = unit(n + step)
        value = separation(full, apart, first, second)
        found, high = choose(value > s, full, n), maximum(value, s)
        fine = length < enough
        if any_lane(select(fine, 0.0, active) > 0.5):
            for share in SHARES:
                other = unit(plus_scaled(n, share, step))
                value = separation(other, apart, first, second)
                found, high = choose(value > high, other, found), maximum(value, high)
        stuck = high <= s
        rounded = select(stuck, length, FAR) < FINE
        going = active > 0.5
        n = choose(going, choose(fine, full, choose(rounded, full, found)), n)
        active = select(fine, 0.0, select(stuck, 0.0, active))
        if not any_lane(active > 0.5):
            break
    step, _ = newton_step(n, apart, first, second)
    return choose(select(among, dot(step, step), FAR) < FINE * FINE, unit(n + step), n)


@compiled
def better_start(
    n: Vector, s: Number, one: Vector, apart: Vector, first: Ellipsoid, second: Ellipsoid
) -> tuple[Vector, Number]:
    """Return one of two normals, and its separation: the one with the larger, where that of n is ``s``."""
    value = separation(one, apart, first, second)
    return choose(value > s, one, n), maximum(value, s)


@compiled
def begun_anew(n: Vector, apart: Vector, first: Ellipsoid, second: Ellipsoid) -> Vector:
    """Return a normal on the other side of a stationary n along which two ellipsoids overlap."""
    start = unit(apart)
    start = unit(start - (2.0 * absolute(dot(start, n))) * n)
    s = separation(start, apart, first, second)
    for axis in first.axes:
        for other in second.axes:
            one = cross(axis, other)
            size = sqrt(dot(one, one) + TINY)
            one = select(dot(one, n) > 0.0, -1.0 / size, 1.0 / size) * one
            parallel = size < 1e-3
            start, s = better_start(start, s, choose(parallel, start, one), apart, first, second)
    return start


@compiled
def gap_to_ellipsoid(first: Ellipsoid, second: Ellipsoid) -> tuple[Vector, Number]:
    """Return normal, from the first to the second, and distance of two ellipsoids [m]."""
    apart = second.centre - first.centre
    n = unit(apart)
    s = separation(n, apart, first, second)
    other, _ = gap_to_point(second.centre, first)
    n, s = better_start(n, s, other, apart, first, second)
    other, _ = gap_to_point(first.centre, second)
    n, s = better_start(n, s, -1.0 * other, apart, first, second)
    best, most = n, 0.0 * s - FAR
    for _ in range(ANEW):
        among = most <= 0.0
        n = climb(n, among, first, second)
        s = separation(n, apart, first, second)
        better = select(among, s, -FAR) > most
        best, most = choose(better, n, best), select(better, s, most)
        if not any_lane(most <= 0.0):
            break
        n = begun_anew(n, apart, first, second)
    return best, most


# --- Of many ------------------------------------------------------------------------------------------------


@compiled
def ellipsoid_of_rows(rows: Rows, first: int) -> Ellipsoid:
    """Return the ellipsoid that five rows hold: its centre, its axes and its semi-axes."""
    axes = row(rows, first + 1), row(rows, first + 2), row(rows, first + 3)
    return Ellipsoid(row(rows, first), axes, row(rows, first + 4))


@kernel
def find_gaps(ellipsoids: Rows, others: Rows, kind: int, found: Rows) -> None:
    """Store in ``found`` (2 n, 3) the normals and distances of n ellipsoids (5 n, 3), each to another shape.

    A distance [m] has beside it, in a triangle, the weights of the second corner and the third, or along a
    segment the share. All other shapes are of one ``kind``.

    The others have the rows of their points, (n, 3), of their ends, (2 n, 3), of their corners, (3 n, 3), or
    are ellipsoids.
    """
    for k in range(found.shape[0] // 2):
        of = ellipsoid_of_rows(ellipsoids, 5 * k)
        none = 0.0 * of.centre[0]
        if kind == POINT:
            n, d = gap_to_point(row(others, k), of)
            tell(found, k, n, d, none, none)
        elif kind == SEGMENT:
            start = row(others, 2 * k)
            n, d, share = gap_to_segment(start, row(others, 2 * k + 1) - start, of)
            tell(found, k, n, d, share, none)
        elif kind == TRIANGLE:
            corner = row(others, 3 * k)
            u, q = row(others, 3 * k + 1) - corner, row(others, 3 * k + 2) - corner
            nearest = gap_to_triangle(corner, u, q, of)
            tell(found, k, nearest.normal, nearest.gap, nearest.second, nearest.third)
        else:
            n, d = gap_to_ellipsoid(of, ellipsoid_of_rows(others, 5 * k))
            tell(found, k, n, d, none, none)


@compiled
def tell(found: Rows, k: int, n: Vector, d: Number, second: Number, third: Number) -> None:
    """Store what `find_gaps` finds for one ellipsoid."""
    set_row(found, 2 * k, n)
    set_row(found, 2 * k + 1, vec(d, second, third))


def gaps(kind: int, ellipsoids: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return normals (n, 3) and, (n, 3), what `find_gaps` finds beside them, of one other of each ellipsoid.

    The ``ellipsoids`` (n, 5, 3) have rows for the centre, the axes and the semi-axes, and the ``others``
    (n, rows, 3) those of their kind: `POINT`, `SEGMENT`, `TRIANGLE` or `ELLIPSOID`.
    """
    count = len(ellipsoids)
    blocks = -(-count // AT_ONCE)

    def packed(rows: np.ndarray) -> np.ndarray:
        each = np.resize(rows, (blocks * AT_ONCE, *rows.shape[1:])).reshape(blocks, AT_ONCE, -1, 3)
        array = aligned_zeros((blocks * rows.shape[1], 3), block_dtype(float, AT_ONCE))
        numbers(array)[:] = each.transpose(0, 2, 3, 1).reshape(-1, 3, AT_ONCE)
        return array

    found = aligned_zeros((2 * blocks, 3), block_dtype(float, AT_ONCE))
    if count:
        find_gaps(packed(ellipsoids), packed(others), kind, found)
    each = numbers(found).reshape(blocks, 2, 3, AT_ONCE).transpose(0, 3, 1, 2).reshape(-1, 2, 3)[:count]
    return each[:, 0], each[:, 1]
