"""Coulomb's friction of bodies that touch.

Opposite tangential forces at two points a distance D apart would leave a torque, and see slip where both
bodies turn together. So slip is seen, and forces act, as in axes that turn with the contact's own
particles: with their centre of mass x_c, inertia I and angular momentum L,

    slip = P (Σ w v − (I⁻¹ L) × D),    an impulse j ⊥ n:  δvᵢ = wᵢ j/mᵢ − θ × (xᵢ − x_c),  θ = I⁻¹ (D × j),

with P = 1 − n nᵀ: no momentum, no angular momentum, and along a unit vector ŝ the slip changes by K j, K
= W − (D × ŝ)·I⁻¹(D × ŝ). Of a pinned particle the mass counts as infinite, so that x_c is there; with two
pinned, nothing turns. Two balls alone never slip: points cannot roll, nor be held back without a torque.

Rigid bodies are pushed at one point (`springgym.forces.pairs.solids`), where a tangential impulse needs no
turn to keep the angular momentum.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.core.lanes import any_lane, load, load_each, maximum, minimum, select, sqrt, store
from springgym.core.vectors import (
    TINY,
    choose,
    cross,
    dot,
    inverse_symmetric,
    multiplied,
    plus_scaled,
    row,
    row_each,
    set_row,
    set_row_each,
    vec,
)
from springgym.forces.pairs.solids import among_going, between, push_both, yielding_of_both
from springgym.forces.pairs.terms import FRICTION, spend, tell

if TYPE_CHECKING:
    from springgym.forces import Particles
    from springgym.forces.pairs.solids import Solids


FIRM = 1e-6
"""Where K is less than this share of W, there is nothing to hold back."""


SWEEPS, TURNS = 2, 3
"""Turns of `rub` that hold back what slips, and all."""


@compiled
def lay_out(x: Rows, k: Number, particles: Particles, friction: Numbers, room: Any) -> None:
    """Find what the particles of contact k turn about, and how hard they are to turn."""
    if friction is not None:
        none = 0.0 * load(room.distance, k)
        pins, whole = none, none + TINY
        centre, pin = vec(none, none, none), vec(none, none, none)
        for j in range(room.members[k]):
            i = load(room.particle, 4 * k + j)
            place, free = row_each(x, i), load_each(particles.inverse_mass, i) > 0.0
            m = select(free, load_each(particles.mass, i), none)
            pins, pin = pins + select(free, none, 1.0), choose(free, pin, place)
            whole, centre = whole + m, plus_scaled(centre, m, place)
            store(room.mass, 4 * k + j, m)
        centre = choose(pins > 0.0, pin, 1.0 / whole * centre)
        apart = vec(none, none, none)
        xx, yy, zz, xy, xz, yz = none, none, none, none, none, none
        for j in range(room.members[k]):
            r = row_each(x, load(room.particle, 4 * k + j)) - centre
            m = load(room.mass, 4 * k + j)
            apart = plus_scaled(apart, load(room.weight, 4 * k + j), r)
            xx, yy, zz = xx + m * r[0] * r[0], yy + m * r[1] * r[1], zz + m * r[2] * r[2]
            xy, xz, yz = xy + m * r[0] * r[1], xz + m * r[0] * r[2], yz + m * r[1] * r[2]
            set_row(room.arm, 4 * k + j, r)
        set_row(room.apart, k, apart)
        total = vec(none, none, none)
        for j in range(room.members[k]):
            total = plus_scaled(total, load(room.mass, 4 * k + j), row(room.arm, 4 * k + j))
        for j in range(room.members[k]):
            m = load(room.mass, 4 * k + j)
            lever = choose(m > 0.0, m * row(room.arm, 4 * k + j), -1.0 * total)
            set_row(room.lever, 4 * k + j, lever)
        diagonal, across = inverse_symmetric((yy + zz, xx + zz, xx + yy, -xy, -xz, -yz))
        turns = pins < 1.5
        set_row(room.turn, 2 * k, choose(turns, diagonal, vec(none, none, none)))
        set_row(room.turn, 2 * k + 1, choose(turns, across, vec(none, none, none)))


@compiled
def rub(
    w: Rows, v: Rows, turn: Any, count: Number, pairs: Any, friction: Numbers, room: Any, tally: Numbers
) -> None:
    """Hold back what slips, in two turns; in the third tell the loss, j times the mean of the slips before
    and after."""
    if friction is not None:
        for m in range(count):
            k = count - 1 - m if turn == 1 else m
            p = room.pair[k]
            limit, given = load(friction, p) * load(room.push, k), row(room.rub, k)
            acts = limit > 0.0
            if turn < SWEEPS:
                acts = maximum(limit, dot(given, given)) > 0.0  # what was given may have to be taken back
            acts = among_going(acts, room.solids)
            if any_lane(acts):
                slip = slipping(v, k, pairs, room, room.solids)
                if turn < SWEEPS:
                    j = held_back(slip, k, given, limit, pairs, room)
                    push_across(v, k, j - given, acts, pairs, room, room.solids)
                    set_row(room.rub, k, choose(acts, j, given))
                else:
                    slip = slip + slipping(w, k, pairs, room, room.solids)
                    lost = select(acts, -0.5 * dot(given, slip), 0.0)
                    spend(room, p, 1, lost)
                    tell(tally, p, FRICTION, lost)


@compiled
def slipping(v: Rows, k: Number, pairs: Any, room: Any, solids: Solids | None) -> Any:
    """How contact k slips (3,)."""
    n = row(room.toward, k)
    if solids is not None:
        slip = between(v, k, pairs, room, solids)
        return slip - dot(slip, n) * n
    slip = slipping_particles(v, k, room)
    return slip - dot(slip, n) * n


@compiled
def slipping_particles(v: Rows, k: Number, room: Any) -> Any:
    """How the particles of contact k slip in axes that turn with them."""
    none = 0.0 * load(room.distance, k)
    slip, spin = vec(none, none, none), vec(none, none, none)
    for j in range(room.members[k]):
        u = row_each(v, load(room.particle, 4 * k + j))
        slip = plus_scaled(slip, load(room.weight, 4 * k + j), u)
        spin = spin + cross(row(room.lever, 4 * k + j), u)
    return slip - cross(turning(k, spin, room), row(room.apart, k))


@compiled
def turning(k: Number, moment: Vector, room: Any) -> Any:
    """The angular velocity of a contact's particles with a moment of momentum; with two pinned, none."""
    return multiplied(row(room.turn, 2 * k), row(room.turn, 2 * k + 1), moment)


@compiled
def yielding_along(along: Vector, k: Number, pairs: Any, room: Any, solids: Solids | None) -> Any:
    """K of contact k along a unit vector."""
    if solids is not None:
        return yielding_of_both(along, k, pairs, room, solids)
    lever = cross(row(room.apart, k), along)
    return load(room.inverse, k) - dot(lever, turning(k, lever, room))


@compiled
def held_back(slip: Vector, k: Number, given: Vector, limit: Number, pairs: Any, room: Any) -> Any:
    """The impulse that stops a slip, besides what was ``given``, or as much of it as friction can give."""
    along = 1.0 / (sqrt(dot(slip, slip)) + TINY) * slip
    yielding = yielding_along(along, k, pairs, room, room.solids)
    firm = yielding > FIRM * load(room.inverse, k)
    stop = select(firm, 1.0 / select(firm, yielding, 1.0), 0.0)
    wanted = given - stop * slip
    size = sqrt(dot(wanted, wanted)) + TINY
    return minimum(limit / size, 1.0) * wanted


@compiled
def push_across(
    v: Rows, k: Number, j: Vector, acts: Mask, pairs: Any, room: Any, solids: Solids | None
) -> None:
    """Give contact k an impulse across its normal, in some lanes."""
    if solids is not None:
        push_both(v, k, j, acts, pairs, room, solids)
    else:
        turn_with(v, k, j, acts, room)


@compiled
def turn_with(v: Rows, k: Number, j: Vector, acts: Mask, room: Any) -> None:
    """Give contact k an impulse across its normal, and the turn that takes its torque back."""
    turn = turning(k, cross(row(room.apart, k), j), room)
    for n in range(room.members[k]):
        i = load(room.particle, 4 * k + n)
        before = row_each(v, i)
        after = plus_scaled(before, load(room.gain, 4 * k + n), j)
        after = after - cross(turn, row(room.arm, 4 * k + n))
        moves = select(acts, load(room.mass, 4 * k + n), 0.0) > 0.0
        set_row_each(v, i, choose(moves, after, before))
