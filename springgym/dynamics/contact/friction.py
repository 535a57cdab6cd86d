"""How friction acts on touching bodies while it conserves angular momentum.

Friction is an impulse j ⊥ n. Between bodies that turn as one, or at a surface, it acts at one point. A side
of particles gets it by their weights w. The points of both sides are D = d n apart, so that a torque D × j is
left. It is cancelled by impulses along n,

    δvᵢ = (wᵢ j + (gᵢ · j) n)/mᵢ,    Σ gᵢ = 0,    Σ (gᵢ · j) xᵢ = d j + γ n for all j ⊥ n.

They are the pressure of a face with friction at the height d above it. With u and q two sides of the face, or
the two crossing edges, A = n · (u × q), G = d (q × n)/A and H = d (n × u)/A, the far end of u has g = G, that
of q has g = H, their near ends −G and −H. The slip is the velocity conjugate to such an impulse,

    slip = Σ (wᵢ (1 − n nᵀ) + gᵢ nᵀ) vᵢ:    the velocity of one body at the other's point, as both turn.

An impulse of 1 along a unit vector ŝ changes it by K = W + Σ (gᵢ · ŝ)²/mᵢ. Friction on a rod touched by a
vertex acts along the rod only. Two balls of one particle each are points here, without friction: no impulse
across the line of their centres conserves angular momentum.
"""

from __future__ import annotations

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Mask, Number, Rows, Vector
from springgym.core.language.lanes import maximum, select, sqrt
from springgym.core.language.memory import load, load_each, store
from springgym.core.language.vectors import (
    choose,
    cross,
    dot,
    plus_scaled,
    row,
    row_each,
    set_row,
    set_row_each,
)
from springgym.dynamics.contact.movers import inverse_mass_of, number_of, push, velocity_between
from springgym.dynamics.records import ContactRows, Problem

SHALLOW = 0.05
"""Least sine of the angle of n with a face's plane, or with a rod, for friction: d/A is unbounded."""

AWAY = 0.5
"""Least K as a fraction of that without the motion during half a step: a flat disk has less where its point
of contact runs away within half a step, and there friction waits for the next."""


@compiled
def set_tilt(k: int, problem: Problem) -> None:
    """Set ``grips`` of contact k, and its G and H if the torque of friction has to be cancelled."""
    contacts = problem.contacts
    x = problem.x
    single = problem.pairs.single
    members = contacts.members[k]
    n = row(contacts.normal, k)
    none = 0.0 * n[0]
    for side in range(2):
        set_row(contacts.tilt, 2 * k + side, 0.0 * n)
    if contacts.surface[k] < 0 and single[contacts.body[2 * k]] and single[contacts.body[2 * k + 1]]:
        store(contacts.grips, k, none)
    elif number_of(k, contacts.tilts) == 0:
        store(contacts.grips, k, 1.0 + none)
    else:
        first = row_of(x, k, 1, contacts)
        third = row_of(x, k, 2, contacts)
        d = load(contacts.height, k)
        if members == 4:
            crossed = crosses(k, contacts)
            u = choose(crossed, first - row_of(x, k, 0, contacts), third - first)
            q = row_of(x, k, 3, contacts) - choose(crossed, third, first)
            across = cross(u, q)
            area = dot(n, across)
            steep = area * area > (SHALLOW * SHALLOW) * dot(across, across)
            scale = select(steep, d / select(steep, area, 1.0), none)
            set_row(contacts.tilt, 2 * k, scale * cross(q, n))
            set_row(contacts.tilt, 2 * k + 1, scale * cross(n, u))
        else:
            u = third - first
            along = u - dot(u, n) * n
            square = dot(along, along)
            steep = square > (SHALLOW * SHALLOW) * dot(u, u)
            inverse = select(steep, 1.0 / select(steep, square, 1.0), none)
            set_row(contacts.tilt, 2 * k, (d * inverse) * along)
            set_row(contacts.tilt, 2 * k + 1, sqrt(inverse) * along)
        store(contacts.grips, k, select(steep, 1.0 + none, none))


@compiled
def row_of(rows: Rows, k: int, j: int, contacts: ContactRows) -> Vector:
    """Return the position or velocity, a row of ``rows``, of particle ``j`` of contact k."""
    return row_each(rows, load(contacts.particle, 4 * k + j))


@compiled
def crosses(k: int, contacts: ContactRows) -> Mask:
    """Return the mask of copies in which contact k is of two edges, not of a vertex and a face."""
    return load(contacts.crossed, k) > 0.0


@compiled
def slip_of(v: Rows, k: int, at_end: int, problem: Problem) -> Vector:
    """Return the slip of contact k [m/s]; ``at_end`` is as in
    `springgym.dynamics.contact.movers.velocity_between`."""
    contacts = problem.contacts
    n = row(contacts.normal, k)
    slip = velocity_between(v, k, at_end, problem)
    if number_of(k, contacts.tilts) == 0:
        return slip - dot(slip, n) / dot(n, n) * n
    first = row_of(v, k, 1, contacts)
    third = row_of(v, k, 2, contacts)
    if contacts.members[k] == 3:
        along = row(contacts.tilt, 2 * k + 1)
        return plus_scaled(dot(slip, along) * along, dot(n, third - first), row(contacts.tilt, 2 * k))
    crossed = crosses(k, contacts)
    turn = dot(n, choose(crossed, first - row_of(v, k, 0, contacts), third - first))
    other = dot(n, row_of(v, k, 3, contacts) - choose(crossed, third, first))
    slip = plus_scaled(slip - dot(slip, n) * n, turn, row(contacts.tilt, 2 * k))
    return plus_scaled(slip, other, row(contacts.tilt, 2 * k + 1))


@compiled
def normal_part(k: int, m: int, j: Vector, contacts: ContactRows) -> Number:
    """Return gᵢ · j of the contact's particle ``m``, for a tangential impulse j."""
    g = dot(row(contacts.tilt, 2 * k), j)
    if contacts.members[k] == 3:
        return g if m == 2 else (-1.0 * g if m == 1 else 0.0 * g)
    h = dot(row(contacts.tilt, 2 * k + 1), j)
    crossed = crosses(k, contacts)
    if m == 0:
        return select(crossed, -1.0 * g, 0.0)
    if m == 1:
        return select(crossed, g, -1.0 * (g + h))
    if m == 2:
        return select(crossed, -1.0 * h, g)
    return h


@compiled
def inverse_mass_along(along: Vector, k: int, problem: Problem) -> Number:
    """Return the effective inverse mass K [1/kg] of contact k along a tangential unit vector."""
    contacts = problem.contacts
    only = contacts.only[k]
    if only >= 0:
        return load(contacts.gain, 4 * k)
    total = inverse_mass_of(along, contacts.at_end[k], k, problem, contacts.turning)
    if contacts.at_end[k] == 1:
        return maximum(total, AWAY * inverse_mass_of(along, 0, k, problem, contacts.turning))
    for m in range(number_of(k, contacts.loose)):
        total = total + load(contacts.weight, 4 * k + m) * load(contacts.gain, 4 * k + m)
        if number_of(k, contacts.tilts) == 1:
            lift = normal_part(k, m, along, contacts)
            total = total + lift * lift * load_each(problem.inverse_mass, load(contacts.particle, 4 * k + m))
    return total


@compiled
def push_across(v: Rows, k: int, j: Vector, problem: Problem) -> None:
    """Apply a tangential impulse at contact k, and the impulses that cancel its torque."""
    contacts = problem.contacts
    push(v, k, j, problem)
    if number_of(k, contacts.tilts) == 1:
        n = row(contacts.normal, k)
        for m in range(contacts.members[k]):
            i = load(contacts.particle, 4 * k + m)
            lift = normal_part(k, m, j, contacts) * load_each(problem.inverse_mass, i)
            set_row_each(v, i, plus_scaled(row_each(v, i), lift, n))
