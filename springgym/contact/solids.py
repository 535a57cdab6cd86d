"""How contacts move rigid bodies: two of them, at one point.

At a node a rigid body has the velocity v of its point, the centre of mass or the pin, and the angular
momentum L about that point, in world coordinates. A contact sees two bodies a and b from one place, at the
arms r from their points, and gives them opposite impulses there:

    u = v_a + ω_a × r_a − v_b − ω_b × r_b,    ω = I⁻¹ L,
    an impulse j:  v_a += j/M_a, L_a += r_a × j,    v_b −= j/M_b, L_b −= r_b × j.

So momentum and angular momentum are kept to rounding. Along a unit vector s the relative velocity changes by
W j, W = Σ 1/M + (r × s) · I⁻¹ (r × s). Of a body that cannot move, or not turn, 1/M or I⁻¹ is 0.

The place is halfway between the two points of the contact. Of a ball, which has no inertia and is not turned,
it is the centre: that is on the same normal.

Impulses are found in turns until a copy's own agree, whatever other copies of its block need.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Rows, Vector
from springgym.core.lanes import load, maximum, select, sqrt, store
from springgym.core.vectors import choose, cross, dot, multiplied, plus_scaled, row, row_each, set_row

GOING, CHANGE = range(2)
"""Of a copy: 1 while its impulses are to change, else 0; and the largest change of a contact's speed since it
was set to 0, over its Δ [1/s]."""


class Solids(NamedTuple):
    """Rigid bodies as contacts see them at a node, where an array has v [m/s] and L [kg·m²/s] of each in two
    rows."""

    start: np.ndarray
    """(bodies + 1,) where the particles of each begin among all, and the end"""
    balls: np.ndarray
    """(bodies,) whether a body is a single particle"""
    lightness: Any
    """(bodies,) 1/M [1/kg]; 0 of what is pinned"""
    turn: Any
    """(2 bodies, 3) I⁻¹ about the body's point: xx, yy, zz; xy, xz, yz [1/(kg·m²)]"""
    point: Any
    """(bodies, 3) [m]"""
    arm: Any
    """(2 contacts, 3) from the points of both bodies to where they are pushed [m]"""
    turns: Any
    """(2,) `GOING`, `CHANGE`"""


@compiled
def face(x: Rows, k: int, pairs: Any, room: Any, solids: Solids) -> Any:
    """Find where contact k pushes its bodies, from the second towards the first; returns its W [1/kg]."""
    p = room.pair[k]
    a, b = pairs.first[p], pairs.second[p]
    n = row(room.toward, k)
    place = 0.0 * n
    for j in range(room.members[k]):
        weight = load(room.weight, 4 * k + j)
        half = 0.5 * maximum(weight, -1.0 * weight)
        place = plus_scaled(place, half, row_each(x, load(room.particle, 4 * k + j)))
    if solids.balls[a]:
        place = row(x, solids.start[a])
    elif solids.balls[b]:
        place = row(x, solids.start[b])
    first = load(room.particle, 4 * k) < 1.0 * solids.start[b]  # whose weights are positive
    n = choose(first, n, -1.0 * n)
    set_row(room.toward, k, n)
    set_row(solids.arm, 2 * k, place - row(solids.point, a))
    set_row(solids.arm, 2 * k + 1, place - row(solids.point, b))
    return yielding_of_both(n, k, pairs, room, solids)


@compiled
def velocity_at(v: Rows, body: Any, arm: Vector, solids: Solids) -> Any:
    """Velocity of a body at an arm from its point."""
    return row(v, 2 * body) + cross(turning_of(body, row(v, 2 * body + 1), solids), arm)


@compiled
def turning_of(body: Any, moment: Vector, solids: Solids) -> Any:
    """The angular velocity of a body with an angular momentum."""
    return multiplied(row(solids.turn, 2 * body), row(solids.turn, 2 * body + 1), moment)


@compiled
def between(v: Rows, k: int, pairs: Any, room: Any, solids: Solids) -> Any:
    """The velocity of the first body of contact k relative to the second."""
    p = room.pair[k]
    first = velocity_at(v, pairs.first[p], row(solids.arm, 2 * k), solids)
    return first - velocity_at(v, pairs.second[p], row(solids.arm, 2 * k + 1), solids)


@compiled
def yielding_of(body: Any, push: Vector, moment: Vector, solids: Solids) -> Any:
    """Twice the kinetic energy that a body at rest has from an impulse and a moment."""
    return load(solids.lightness, body) * dot(push, push) + dot(moment, turning_of(body, moment, solids))


@compiled
def yielding_of_both(along: Vector, k: int, pairs: Any, room: Any, solids: Solids) -> Any:
    """W of contact k along a unit vector [1/kg]; 0 along none."""
    p = room.pair[k]
    first = yielding_of(pairs.first[p], along, cross(row(solids.arm, 2 * k), along), solids)
    second = cross(row(solids.arm, 2 * k + 1), along)
    return first + yielding_of(pairs.second[p], along, second, solids)


@compiled
def push_body(
    v: Rows, body: Any, scale: Number, push: Vector, moment: Vector, on: Mask, solids: Solids
) -> None:
    """Give a body ``scale`` times an impulse and a moment, in some lanes; the others are left to the bit."""
    velocity, spin = row(v, 2 * body), row(v, 2 * body + 1)
    faster = plus_scaled(velocity, scale * load(solids.lightness, body), push)
    set_row(v, 2 * body, choose(on, faster, velocity))
    set_row(v, 2 * body + 1, choose(on, plus_scaled(spin, scale, moment), spin))


@compiled
def push_both(v: Rows, k: int, j: Vector, on: Mask, pairs: Any, room: Any, solids: Solids) -> None:
    """Give the bodies of contact k opposite impulses."""
    p = room.pair[k]
    push_body(v, pairs.first[p], 1.0, j, cross(row(solids.arm, 2 * k), j), on, solids)
    push_body(v, pairs.second[p], -1.0, j, cross(row(solids.arm, 2 * k + 1), j), on, solids)
    count_change(sqrt(dot(j, j)) * load(room.inverse, k) / pairs.reach[p], on, solids)


@compiled
def count_change(change: Number, on: Mask, solids: Solids) -> None:
    """Keep the largest `CHANGE`."""
    most = load(solids.turns, CHANGE)
    store(solids.turns, CHANGE, maximum(most, select(on, change, 0.0)))


@compiled
def wrenches(x: Rows, k: int, pushes: Any, pairs: Any, room: Any, solids: Solids) -> Any:
    """Add up impulses at the four particles of two edges, of which contact k is.

    Returns
    -------
    the impulse on the first body, and the moments of impulse on the first and against the second
    """
    p = room.pair[k]
    a, b = row(solids.point, pairs.first[p]), row(solids.point, pairs.second[p])
    g0, g1, g2, g3 = pushes
    first = cross(row_each(x, load(room.particle, 4 * k)) - a, g0)
    first = first + cross(row_each(x, load(room.particle, 4 * k + 1)) - a, g1)
    second = cross(row_each(x, load(room.particle, 4 * k + 2)) - b, g2)
    second = second + cross(row_each(x, load(room.particle, 4 * k + 3)) - b, g3)
    return g0 + g1, first, -1.0 * second


@compiled
def among_going(on: Mask, solids: Any) -> Any:
    """Where a mask holds in copies whose impulses are to change: in all, if no bodies are rigid."""
    if solids is not None:
        return select(on, load(solids.turns, GOING), 0.0) > 0.5
    return on
