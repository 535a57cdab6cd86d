"""Ellipsoids, disks among them, meet other bodies, and contacts turn them.

A body is an ellipsoid here if all its particles carry its one round feature, with the centre ξc and the
semi-axes aₖ along qₖ in the rest shape, and if that is no sphere about the centre of mass. Contacts see it as
a sphere that turns (`springgym.contact.spheres`): by its centre of mass c, its velocity and ω, and all of an
impulse is distributed as on a rigid body. What is its own is where the ellipsoid is. With the weights of
`springgym.bodies.round`, F = Σ xᵢ ⊗ Bᵢ is how the particles turned and stretched. The ellipsoid is turned by
a rotation R, and does not stretch:

    e = c + R (ξc − X̄),    axes R qₖ,    Σ mᵢ R (Xᵢ − X̄) × xᵢ = 0.

X̄ is the centre of mass of the masses that the copy has. By the last condition, Eckart's (Phys. Rev. 47 (1935)
552, doi:10.1103/PhysRev.47.552), vibrations have no angular momentum to first order, so that R turns with the
ω = I⁻¹ L of the contacts. It is found from the rotation of the polar decomposition F = R U, by Newton and
Schulz's iteration F ← F (3 − Fᵀ F)/2, and turned on by I⁻¹ times what the sum is.

A contact's distance and normal follow from `springgym.core.ellipsoids`. One pair has one contact: of all
faces of the other body, with their sides and corners, and of all its rods, the nearest counts. Two convex
bodies have one nearest place, and it moves continuously. A face counts if the ellipsoid's centre is in front
of it, or was when the step began.

A contact touches the ellipsoid at the arm r from c, which is not along n. So its normal impulse turns it,

    u = n · (v + ω × r) − …,    W = 1/M + (r × n) · I⁻¹ (r × n) + …,    δω = I⁻¹ (r × j),

and so does friction. The arm follows from the normal. Opposite a face the place is on the ellipsoid's skin,
and what is left of the gap is up to the face, as of a sphere. Of two bodies that turn it is halfway between
both skins, and opposite a rope or a ball, which do not turn, at their middle: there both have one place. All
of these lie on the line along n through the other body's point, so that momenta are kept to rounding.

The gaps of a step are those of straight ways at the speed of the node, though the place that touches moves
over the skin within the step. So an impulse does just the work that its barrier gives. With the gap where the
step really begins, as at surfaces, the energy balance of impacts is several times as far off.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from springgym.bodies import Body
from springgym.bodies.round import weights
from springgym.contact.features import add_contact, corners, tips
from springgym.contact.lists import Near, Search, Touch
from springgym.contact.rows import FAR
from springgym.contact.spheres import (
    Spheres,
    arm_of_ellipsoid,
    body_of,
    meets_ellipsoid,
    side_of,
    spin_of,
    turn_ellipsoid,
    turned,
    turning_of_ellipsoid,
)
from springgym.core.blocks import aligned_zeros
from springgym.core.compiling import compiled
from springgym.core.ellipsoids import (
    Ellipsoid,
    gap_to_ellipsoid,
    gap_to_point,
    gap_to_segment,
    gap_to_triangle,
    support,
)
from springgym.core.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.core.lanes import any_lane, filled, load, maximum, select, sqrt, store
from springgym.core.vectors import (
    choose,
    cross,
    dot,
    plus_scaled,
    row,
    row_each,
    set_row,
    vec,
)

if TYPE_CHECKING:
    from springgym.collisions import Shape
    from springgym.contact.rows import Problem

ROUNDS, TURNS = 5, 2
"""Turns in which axes are made upright, from strains of a tenth to rounding, and in which they turn on."""


class Ellipsoids(NamedTuple):
    """The ellipsoids among bodies that collide, at a node, and what contacts with them have of their own."""

    there: np.ndarray
    """(bodies,) whether a body is one"""
    semi: np.ndarray
    """(bodies, 3) semi-axes [m]; 0 of others"""
    rest: np.ndarray
    """(N, 3) particles from the ellipsoid's centre in the rest shape, along its axes [m]"""
    slope: np.ndarray
    """(N, 3) the slope B of each particle's weight, along the ellipsoid's axes [1/m]"""
    centre: Rows
    """(bodies, 3) e of each body [m]"""
    axes: Rows
    """(3 bodies, 3) its axes"""
    turning: Numbers
    """(bodies,) the speed at which the skin of each ellipsoid turns, at most [m/s]"""
    place: Rows
    """(rows, 3) where contacts act [m]"""
    middle: Rows
    """(rows, 3) halfway between the points of both bodies that are nearest to each other [m]"""
    left: Numbers
    """(rows,) what of the gap is left to a face [m]"""
    straight: Numbers
    """(rows,) the inverse mass W of each contact if it turned no ellipsoid [1/kg]"""


def new_ellipsoids(
    start: np.ndarray, shapes: Sequence[Shape], bodies: Sequence[Body], rows: int, dtype: DTypeLike
) -> Ellipsoids | None:
    """Return a workspace for the ellipsoids among ``bodies``; None without any. Contacts have ``rows``."""
    there = np.array([shape.ellipsoid for shape in shapes])
    if not there.any():
        return None
    semi, rest, slope = np.zeros((len(shapes), 3)), np.zeros((start[-1], 3)), np.zeros((start[-1], 3))
    for n in np.flatnonzero(there).tolist():
        body, own = bodies[n], slice(start[n], start[n + 1])
        feature = body.rounds[0]
        semi[n], axes = feature.principal()
        carriers = feature.carriers(len(body.masses))
        rest[own] = (body.positions - feature.centre) @ axes
        slope[own][carriers] = weights(body.masses, body.positions, carriers)[1] @ axes

    def lanes(*shape: int) -> np.ndarray:
        return aligned_zeros(shape, dtype)

    return Ellipsoids(
        there=there,
        semi=semi,
        rest=rest,
        slope=slope,
        centre=lanes(len(shapes), 3),
        axes=lanes(3 * len(shapes), 3),
        turning=lanes(len(shapes)),
        place=lanes(rows, 3),
        middle=lanes(rows, 3),
        left=lanes(rows),
        straight=lanes(rows),
    )


# --- Where they are ---------------------------------------------------------------------------------------


@compiled
def find_ellipsoids(x: Rows, mass: Numbers, spheres: Spheres | None, ellipsoids: Ellipsoids | None) -> None:
    """Find where all ellipsoids are at a node of particles at ``x`` (N, 3)."""
    if ellipsoids is not None and spheres is not None:
        for body in range(ellipsoids.there.size):
            if ellipsoids.there[body]:
                first, behind = spheres.start[body], spheres.start[body + 1]
                middle = row(spheres.centre, body)
                total, off = 0.0 * middle[0], 0.0 * middle
                for i in range(first, behind):
                    total = total + load(mass, i)
                    off = plus_scaled(off, -1.0 * load(mass, i), row(ellipsoids.rest, i))
                off = 1.0 / total * off
                f, g, h = turned_axes(first, behind, x, ellipsoids)
                for _ in range(TURNS):
                    f, g, h = turned_on(body, (f, g, h), off, x, mass, spheres, ellipsoids)
                set_row(ellipsoids.axes, 3 * body, f)
                set_row(ellipsoids.axes, 3 * body + 1, g)
                set_row(ellipsoids.axes, 3 * body + 2, h)
                middle = plus_scaled(plus_scaled(middle, off[0], f), off[1], g)
                set_row(ellipsoids.centre, body, plus_scaled(middle, off[2], h))
                spin = row(spheres.before, first + 1)
                store(ellipsoids.turning, body, spheres.radius[body] * sqrt(dot(spin, spin)))


@compiled
def turned_axes(first: int, behind: int, x: Rows, ellipsoids: Ellipsoids) -> tuple[Vector, Vector, Vector]:
    """Return the axes of the ellipsoid that particles ``first`` to ``behind`` carry, by F."""
    f = 0.0 * row(x, first)
    g, h = f, f
    for i in range(first, behind):
        place, slope = row(x, i), row(ellipsoids.slope, i)
        f = plus_scaled(f, slope[0], place)
        g = plus_scaled(g, slope[1], place)
        h = plus_scaled(h, slope[2], place)
    for _ in range(ROUNDS):
        f, g, h = more_upright(f, g, h)
    return f, g, h


@compiled
def more_upright(f: Vector, g: Vector, h: Vector) -> tuple[Vector, Vector, Vector]:
    """Return three vectors that are nearer to unit vectors across each other: of lengths 1 + ε, to 3/2 ε²."""
    ff, gg, hh, fg, fh, gh = dot(f, f), dot(g, g), dot(h, h), dot(f, g), dot(f, h), dot(g, h)
    return (
        (1.5 - 0.5 * ff) * f - (0.5 * fg) * g - (0.5 * fh) * h,
        (1.5 - 0.5 * gg) * g - (0.5 * fg) * f - (0.5 * gh) * h,
        (1.5 - 0.5 * hh) * h - (0.5 * fh) * f - (0.5 * gh) * g,
    )


@compiled
def turned_on(
    body: int,
    axes: tuple[Vector, Vector, Vector],
    off: Vector,
    x: Rows,
    mass: Numbers,
    spheres: Spheres,
    ellipsoids: Ellipsoids,
) -> tuple[Vector, Vector, Vector]:
    """Return the axes of an ellipsoid, turned on by what Σ mᵢ (R Xᵢ) × xᵢ says, which is to be 0."""
    f, g, h = axes
    twist = 0.0 * f
    for i in range(spheres.start[body], spheres.start[body + 1]):
        rest = row(ellipsoids.rest, i) + off
        arm = plus_scaled(plus_scaled(rest[0] * f, rest[1], g), rest[2], h)
        twist = plus_scaled(twist, load(mass, i), cross(arm, row(x, i)))
    turn = turned(body, twist, spheres)
    return more_upright(f + cross(turn, f), g + cross(turn, g), h + cross(turn, h))


@compiled
def ellipsoid_at(body: int, ellipsoids: Ellipsoids) -> Ellipsoid:
    """Return the ellipsoid of a body at the node."""
    none = 0.0 * load(ellipsoids.turning, body)
    axes = (
        row(ellipsoids.axes, 3 * body),
        row(ellipsoids.axes, 3 * body + 1),
        row(ellipsoids.axes, 3 * body + 2),
    )
    semi = vec(
        none + ellipsoids.semi[body, 0], none + ellipsoids.semi[body, 1], none + ellipsoids.semi[body, 2]
    )
    return Ellipsoid(row(ellipsoids.centre, body), axes, semi)


# --- Contacts ---------------------------------------------------------------------------------------------


@compiled
def is_ellipsoid(body: int, ellipsoids: Ellipsoids | None) -> bool:
    """Tell whether a body is an ellipsoid that meets others."""
    if ellipsoids is None:
        return False
    return ellipsoids.there[body]


@compiled
def farthest(near: Near) -> Number:
    """Return up to which distance a contact counts [m]."""
    return select(near.reach > 0.0, near.reach - near.radius, -FAR)


@compiled
def ellipsoid_faces(
    count: int, first: int, m: int, side: int, near: Near, seen: Search, ellipsoids: Ellipsoids
) -> int:
    """List the contact of the ellipsoid in row ``m``, of a ``side``, with the nearest of its candidates."""
    lists, w = seen.lists, seen.w
    i, limit, of = load(lists.vertex_particle, m), farthest(near), ellipsoid_at(near.bodies[side], ellipsoids)
    wide = 2.0 * (maximum(limit, 0.0) + maximum(maximum(of.semi[0], of.semi[1]), of.semi[2]))
    best, face, second, third = 0.0 * i + FAR, 0.0 * i, 0.0 * i, 0.0 * i
    normal = 0.0 * row(lists.point, m)
    for candidate in range(lists.faces[m, 0], lists.faces[m, 1]):
        n = lists.candidate[candidate]
        corner, across, square = row(lists.corner, n), row(lists.normal, n), load(lists.square, n)
        height = dot(across, of.centre - corner)  # times |across|
        close = height * height < wide * wide * square
        if any_lane(close):
            a, _, _ = corners(0.0 * i + n, lists)
            earlier = height - near.lead * dot(across, row_each(w, i) - row_each(w, a))
            nearest = gap_to_triangle(corner, row(lists.first, n), row(lists.second, n), of)
            better = select(select(close, maximum(height, earlier), -1.0) > 0.0, nearest.gap, FAR) < best
            best, face = select(better, nearest.gap, best), select(better, 1.0 * n, face)
            second, third = select(better, nearest.second, second), select(better, nearest.third, third)
            normal = choose(better, -1.0 * nearest.normal, normal)
    won = best < limit
    if any_lane(won):
        a, b, c = corners(filled(won, face), lists)
        one = 1.0 + 0.0 * best
        weights = (one, second + third - 1.0, -1.0 * second, -1.0 * third)
        met = Touch((i, a, b, c), weights, normal, best, select(won, one, 0.0))
        count = add_contact(count, first, 4, met, near, seen)
    return count


@compiled
def ellipsoid_rods(
    count: int, first: int, m: int, side: int, near: Near, seen: Search, ellipsoids: Ellipsoids
) -> int:
    """List the contact of the ellipsoid in row ``m``, of a ``side``, with the nearest rod of the other."""
    lists, other = seen.lists, 1 - side
    i, limit, of = load(lists.vertex_particle, m), farthest(near), ellipsoid_at(near.bodies[side], ellipsoids)
    best, rod, t, normal = 0.0 * i + FAR, 0.0 * i, 0.0 * i, 0.0 * row(lists.point, m)
    for n in range(lists.ends[near.pair, 2, other], lists.ends[near.pair, 2, other + 1]):
        away, d, share = gap_to_segment(row(lists.start, n), row(lists.way, n), of)
        gap = d - seen.pairs.shapes.radius[near.bodies[other]]
        better = gap < best
        best, rod = select(better, gap, best), select(better, 1.0 * n, rod)
        t, normal = select(better, share, t), choose(better, -1.0 * away, normal)
    won = best < limit
    if any_lane(won):
        a, b = tips(filled(won, rod), lists)
        one = 1.0 + 0.0 * best
        weights = (one, t - 1.0, -1.0 * t, 0.0 * t)
        met = Touch((i, a, b, i), weights, normal, best, select(won, one, 0.0))
        count = add_contact(count, first, 3, met, near, seen)
    return count


@compiled
def ellipsoid_ball(count: int, i: int, j: int, near: Near, seen: Search, ellipsoids: Ellipsoids) -> int:
    """List the contact of an ellipsoid with another, or with a sphere or a ball, by their particles."""
    a, b = near.bodies
    if not ellipsoids.there[a]:
        a, b, i, j = b, a, j, i
    of = ellipsoid_at(a, ellipsoids)
    if ellipsoids.there[b]:
        away, gap = gap_to_ellipsoid(of, ellipsoid_at(b, ellipsoids))
    else:
        away, d = gap_to_point(row(seen.x, j), of)
        gap = d - seen.pairs.shapes.radius[b]
    meets = gap < farthest(near)
    if any_lane(meets):
        one = 1.0 + 0.0 * gap
        weights = (one, -1.0 * one, 0.0 * one, 0.0 * one)
        met = Touch((i, j, i, j), weights, -1.0 * away, gap, select(meets, one, 0.0))
        count = add_contact(count, count, 2, met, near, seen)
    return count


# --- Impulses ---------------------------------------------------------------------------------------------


@compiled
def set_place(
    k: int, inverse: Number, problem: Problem, spheres: Spheres | None, ellipsoids: Ellipsoids | None
) -> Number:
    """Find where contact k acts, if it is of an ellipsoid; returns W [1/kg] with what turns.

    ``inverse`` is W without. The normal points to the first particle, which is that of an ellipsoid.
    """
    if ellipsoids is not None and spheres is not None and meets_ellipsoid(k, problem, ellipsoids):
        contacts = problem.contacts
        body, other = body_of(0, k, problem), body_of(1, k, problem)
        if not ellipsoids.there[body]:
            body, other = other, body
        n = row(contacts.normal, k)
        skin = support(-1.0 * n, ellipsoid_at(body, ellipsoids))
        if ellipsoids.there[other]:
            place = 0.5 * (skin + support(n, ellipsoid_at(other, ellipsoids)))
            left, halfway = 0.0 * inverse, place
        else:
            middle = 0.0 * n
            for j in range(1, contacts.members[k]):
                weight, i = load(contacts.weight, 4 * k + j), load(contacts.particle, 4 * k + j)
                middle = plus_scaled(middle, -1.0 * weight, row_each(problem.x, i))
            left = dot(n, skin - middle)
            half = 0.5 * (left + problem.pairs.shapes.radius[other])
            share = 0.0 * left
            if contacts.members[k] == 4:
                share = left
            elif spheres.skin[other] > 0.0:
                share = half
            place, halfway = plus_scaled(middle, share, n), plus_scaled(middle, half, n)
        set_row(ellipsoids.place, k, place)
        set_row(ellipsoids.middle, k, halfway)
        store(ellipsoids.left, k, left)
        store(ellipsoids.straight, k, inverse)
        for side in range(2):
            body = body_of(side, k, problem)
            if ellipsoids.there[body]:
                inverse = inverse + turning_of_ellipsoid(n, body, k, spheres, ellipsoids)
    return inverse


@compiled
def with_turning(
    u: Number, v: Rows, k: int, problem: Problem, spheres: Spheres | None, ellipsoids: Ellipsoids | None
) -> Number:
    """Return the speed of contact k [m/s] with what the turning of ellipsoids adds to it."""
    if ellipsoids is not None and spheres is not None and meets_ellipsoid(k, problem, ellipsoids):
        n = row(problem.contacts.normal, k)
        for side in range(2):
            body = body_of(side, k, problem)
            if ellipsoids.there[body]:
                moment = cross(arm_of_ellipsoid(body, k, spheres, ellipsoids), n)
                u = u + side_of(side, k, problem, ellipsoids) * dot(
                    moment, spin_of(body, v, problem, spheres)
                )
    return u


@compiled
def turn_by_push(
    v: Rows,
    k: int,
    impulse: Vector,
    on: Mask,
    problem: Problem,
    spheres: Spheres | None,
    ellipsoids: Ellipsoids | None,
) -> None:
    """Turn the ellipsoids of contact k by an impulse along its normal, in some lanes."""
    if ellipsoids is not None and spheres is not None and meets_ellipsoid(k, problem, ellipsoids):
        for side in range(2):
            if ellipsoids.there[body_of(side, k, problem)]:
                turn_ellipsoid(v, side, k, impulse, on, problem, spheres, ellipsoids)


@compiled
def without_turning_by_push(k: int, problem: Problem, ellipsoids: Ellipsoids | None) -> Number:
    """Return W of contact k without what the turning of ellipsoids adds to it [1/kg]."""
    if ellipsoids is not None and meets_ellipsoid(k, problem, ellipsoids):
        return load(ellipsoids.straight, k)
    return load(problem.contacts.inverse_mass, k)
