"""Coulomb's friction of bodies that touch.

Opposite tangential forces at two points a distance D apart would leave a torque, and see slip where both
bodies turn together. So slip is seen, and forces act, as in axes that turn with the contact's own
particles: with their centre of mass x_c, inertia I and angular momentum L,

    slip = P (Σ w v − (I⁻¹ L) × D),    an impulse j ⊥ n:  δvᵢ = wᵢ j/mᵢ − θ × (xᵢ − x_c),  θ = I⁻¹ (D × j),

with P = 1 − n nᵀ: no momentum, no angular momentum, and along a unit vector ŝ the slip changes by K j, K
= W − (D × ŝ)·I⁻¹(D × ŝ). Of a pinned particle the mass counts as infinite, so that x_c is there; with two
pinned, nothing turns. Two balls alone never slip: points cannot roll, nor be held back without a torque.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from springgym.compiling import compiled
from springgym.forces.pairs.terms import FRICTION, spend, tell
from springgym.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.lanes import any_lane, load, maximum, minimum, select, sqrt
from springgym.vectors import (
    TINY,
    choose,
    cross,
    dot,
    minus,
    plus_scaled,
    row,
    set_row,
    solve_symmetric,
    times,
)

if TYPE_CHECKING:
    from springgym.forces import Particles


FIRM = 1e-6
"""Where K is less than this share of W, there is nothing to hold back."""


SWEEPS, TURNS = 2, 4
"""Turns of `rub` that hold back what slips, and all."""


@compiled
def rub(
    x: Rows,
    w: Any,
    v: Rows,
    turn: Any,
    count: Number,
    particles: Particles,
    pairs: Any,
    friction: Numbers,
    room: Any,
    tally: Numbers,
) -> None:
    """Hold back what slips, in two turns; in two more tell the loss, j times the mean of the slips before
    and after."""
    if friction is not None:
        velocities = w if turn == TURNS - 1 else v
        for m in range(count):
            k = count - 1 - m if turn == 1 else m
            p = room.pair[k]
            limit, given = load(friction, p) * load(room.push, k), row(room.rub, k)
            acts = limit > 0.0
            if turn < SWEEPS:
                acts = maximum(limit, dot(given, given)) > 0.0  # what was given may have to be taken back
            if any_lane(acts):
                slip, about, pins, centre, apart = slipping(x, velocities, k, particles, room)
                if turn < SWEEPS:
                    j = held_back(slip, about, pins, apart, given, limit, load(room.inverse, k))
                    change = minus(j, given)
                    turn_with(x, v, k, change, about, pins, centre, apart, acts, particles, room)
                    set_row(room.rub, k, choose(acts, j, given))
                else:
                    lost = select(acts, -0.5 * dot(given, slip), 0.0)
                    spend(room, p, 1, lost)
                    tell(tally, p, FRICTION, lost)


@compiled
def slipping(x: Rows, v: Rows, k: Number, particles: Particles, room: Any) -> Any:
    """How contact k slips, and what its particles turn about.

    Returns
    -------
    slip (3,); inertia (xx, yy, zz, xy, xz, yz); how many of them are pinned; centre (3,); D (3,)
    """
    pins, pin = 0, 0
    for j in range(room.members[k]):
        if not particles.free[room.particles[k, j]]:
            pins, pin = pins + 1, j
    first = room.particles[k, pin]
    centre, speed = row(x, first), row(v, first)
    if pins == 0:
        total = load(particles.mass, first) + 0.0 * centre[0]
        centre, speed = times(total, centre), times(total, speed)
        for j in range(1, room.members[k]):
            i = room.particles[k, j]
            m = load(particles.mass, i)
            total = total + m
            centre, speed = plus_scaled(centre, m, row(x, i)), plus_scaled(speed, m, row(v, i))
        centre, speed = times(1.0 / total, centre), times(1.0 / total, speed)
    zero = 0.0 * centre[0]
    apart, slip, spin = (zero, zero, zero), (zero, zero, zero), (zero, zero, zero)
    xx, yy, zz, xy, xz, yz = zero, zero, zero, zero, zero, zero
    for j in range(room.members[k]):
        i = room.particles[k, j]
        weight = load(room.weight, 4 * k + j)
        r, u = minus(row(x, i), centre), minus(row(v, i), speed)
        apart, slip = plus_scaled(apart, weight, r), plus_scaled(slip, weight, u)
        if particles.free[i]:
            m = load(particles.mass, i)
            xx, yy, zz = xx + m * r[0] * r[0], yy + m * r[1] * r[1], zz + m * r[2] * r[2]
            xy, xz, yz = xy + m * r[0] * r[1], xz + m * r[0] * r[2], yz + m * r[1] * r[2]
            spin = plus_scaled(spin, m, cross(r, u))
    about = (yy + zz, xx + zz, xx + yy, -xy, -xz, -yz)
    slip = minus(slip, cross(turning(about, pins, spin), apart))
    n = row(room.toward, k)
    return minus(slip, times(dot(slip, n), n)), about, pins, centre, apart


@compiled
def turning(about: Any, pins: Any, moment: Vector) -> Any:
    """The angular velocity of particles with a moment of momentum; with two of them pinned, none."""
    turn = times(0.0, moment)
    if pins < 2:
        turn = solve_symmetric(about, moment)
    return turn


@compiled
def held_back(
    slip: Vector, about: Any, pins: Any, apart: Vector, given: Vector, limit: Number, inverse: Number
) -> Any:
    """The impulse that stops a slip, besides what was ``given``, or as much of it as friction can give."""
    along = times(1.0 / (sqrt(dot(slip, slip)) + TINY), slip)
    lever = cross(apart, along)
    k = inverse - dot(lever, turning(about, pins, lever))
    firm = k > FIRM * inverse
    stop = select(firm, 1.0 / select(firm, k, 1.0), 0.0)
    wanted = minus(given, times(stop, slip))
    size = sqrt(dot(wanted, wanted)) + TINY
    return times(minimum(limit / size, 1.0), wanted)


@compiled
def turn_with(
    x: Rows,
    v: Rows,
    k: Number,
    j: Vector,
    about: Any,
    pins: Any,
    centre: Vector,
    apart: Vector,
    acts: Mask,
    particles: Particles,
    room: Any,
) -> None:
    """Give contact k an impulse across its normal, and the turn that takes its torque back."""
    turn = turning(about, pins, cross(apart, j))
    for n in range(room.members[k]):
        i = room.particles[k, n]
        if particles.free[i]:
            before = row(v, i)
            share = load(room.weight, 4 * k + n) * load(particles.inverse_mass, i)
            after = minus(plus_scaled(before, share, j), cross(turn, minus(row(x, i), centre)))
            set_row(v, i, choose(acts, after, before))
