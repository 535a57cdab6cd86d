"""Motion at contacts, of particles, bodies that turn as one, and rigid bodies. The world does not move.

A contact is between two sides, a first and a second body, or a body and a surface. It depends on the relative
velocity of two points, and applies opposite impulses j to them. A side of particles has a point Σ wᵢ xᵢ and
moves by δvᵢ = wᵢ j/mᵢ. A body that turns as one has the velocity v of its point X, the centre of mass or the
pin, and the angular momentum L about it. With the arm r from X to the point of contact,

    u = v + ω × r,    ω = I⁻¹ L,    δv = j/M,    δL = r × j,

so that momentum and angular momentum are conserved to rounding. Round bodies turn so, of springs or rigid: an
impulse strains no spring. If a body cannot move, or cannot turn, 1/M or I⁻¹ is 0. An array of velocities has
a row for each particle; v and L of a body that turns as one are in two of its rows.

The particles of a body of springs that turns as one get δv + I⁻¹ δL × (xᵢ − X).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number, Numbers, Rows, Vector
from springgym.core.language.lanes import select
from springgym.core.language.memory import load, store
from springgym.core.language.vectors import (
    angular_momentum,
    cross,
    dot,
    inertia,
    inverse_symmetric,
    mass_centre,
    multiplied,
    plus_scaled,
    row,
    row_each,
    set_row,
    set_row_each,
)
from springgym.dynamics.arrays import allocate
from springgym.dynamics.records import Problem, Turning


def new_turning(
    turns: np.ndarray, balls: np.ndarray, rows: np.ndarray, pivots: np.ndarray, dtype: DTypeLike
) -> Turning | None:
    """Return a workspace for the bodies that turn as one; None if none ``turns``.

    All are (bodies,): whether a body turns; whether its first particle stands for its centre of mass in
    contacts; the row of its velocity, before its angular momentum; and its pivot, or −1.
    """
    if not turns.any():
        return None
    return allocate(
        Turning,
        {"bodies": len(turns)},
        dtype,
        turns=turns,
        balls=balls,
        first=rows.astype(np.int64),
        pivot=pivots.astype(np.int64),
    )


@compiled
def turns_as_one(body: int, turning: Turning | None) -> bool:
    """Return whether contacts turn a body as one; the world is −1."""
    if turning is None:
        return False
    return body >= 0 and turning.turns[body]


@compiled
def number_of(k: int, numbers: np.ndarray | None) -> int:
    """Return the entry of contact k in an integer array; 0 if the scene has no such array."""
    if numbers is None:
        return 0
    return int(numbers[k])


# --- Motion of a body -------------------------------------------------------------------------------------


@compiled
def find_inertia(
    body: int, at_end: int, x: Rows, mass: Numbers, inverse_mass: Numbers, turning: Turning
) -> None:
    """Compute the point, 1/M and I⁻¹ of a body of springs whose particles are at ``x`` (N, 3).

    ``at_end`` is 0 for the node, and 1 for the end of the step. A pinned body turns about its pivot, if it
    has one, and else does not move.
    """
    count = turning.turns.size
    pivot = turning.pivot[body]
    whole = 0.0 * load(mass, 0)
    free = 1.0 + 0.0 * load(x, (0, 0))
    for i in range(mass.size):
        whole = whole + load(mass, i)
        free = select(load(inverse_mass, i) > 0.0, free, 0.0)
    point = row(x, pivot) if pivot >= 0 else mass_centre(x, mass)
    diagonal, across = inverse_symmetric(inertia(x, mass, point))
    if pivot < 0:
        diagonal = free * diagonal
        across = free * across
    store(turning.lightness, body, free / whole)
    set_row(turning.point, body + at_end * count, point)
    set_row(turning.turn, 2 * (body + at_end * count), diagonal)
    set_row(turning.turn, 2 * (body + at_end * count) + 1, across)


@compiled
def gather(body: int, out: Rows, x: Rows, v: Rows, mass: Numbers, turning: Turning) -> None:
    """Set the rows of a body that turns to v and L of its particles at ``x`` with velocities ``v`` (N, 3)."""
    n = turning.first[body]
    point = row(turning.point, body)
    mean = mass_centre(v, mass)
    set_row(out, n, 0.0 * mean if turning.pivot[body] >= 0 else mean)
    set_row(out, n + 1, angular_momentum(x, v, mass, point))


@compiled
def turned(body: int, at_end: int, moment: Vector, turning: Turning) -> Vector:
    """Return I⁻¹ times a vector, at the node or, if ``at_end``, at the end of the step."""
    n = 2 * (body + at_end * turning.turns.size)
    return multiplied(row(turning.turn, n), row(turning.turn, n + 1), moment)


@compiled
def spin(v: Rows, body: int, at_end: int, turning: Turning) -> Vector:
    """Return ω of a body that turns [rad/s]."""
    return turned(body, at_end, row(v, turning.first[body] + 1), turning)


# --- Motion at a contact ----------------------------------------------------------------------------------


@compiled
def velocity_between(v: Rows, k: int, at_end: int, problem: Problem) -> Vector:
    """Return the velocity of the first side of contact k relative to the second [m/s], (3,).

    If ``at_end`` is 1, it is that of the points which touch at the end of the step.
    """
    contacts = problem.contacts
    only = contacts.only[k]
    if only >= 0:
        return row(v, only)
    u = 0.0 * row(contacts.normal, k)
    for m in range(number_of(k, contacts.loose)):
        u = plus_scaled(u, load(contacts.weight, 4 * k + m), row_each(v, load(contacts.particle, 4 * k + m)))
    return plus_turning(u, v, k, at_end, problem, contacts.turning)


@compiled
def plus_turning(
    u: Vector, v: Rows, k: int, at_end: int, problem: Problem, turning: Turning | None
) -> Vector:
    """Add the velocities of the bodies of contact k that turn."""
    if turning is not None:
        contacts = problem.contacts
        for side in range(2):
            body = contacts.body[2 * k + side]
            if turns_as_one(body, turning):
                arm = row(contacts.arm, 4 * k + 2 * at_end + side)
                moves = row(v, turning.first[body]) + cross(spin(v, body, at_end, turning), arm)
                u = u + (moves if side == 0 else -1.0 * moves)
    return u


@compiled
def inverse_mass_of(along: Vector, at_end: int, k: int, problem: Problem, turning: Turning | None) -> Number:
    """Return the inverse mass of the bodies of contact k that turn, along a unit vector at the node [1/kg].

    An impulse of 1 changes their relative velocity by this; if ``at_end`` is 1, that of the points which
    touch at the end of the step. The result scales with the square of the vector's length.
    """
    total = 0.0 * along[0]
    if turning is not None:
        contacts = problem.contacts
        square = dot(along, along)
        for side in range(2):
            body = contacts.body[2 * k + side]
            if turns_as_one(body, turning):
                arm = row(contacts.arm, 4 * k + side)
                there = row(contacts.arm, 4 * k + 2 * at_end + side)
                spun = turned(body, at_end, cross(arm, along), turning)
                total = total + (load(turning.lightness, body) * square + dot(cross(there, along), spun))
    return total


@compiled
def push(v: Rows, k: int, j: Vector, problem: Problem) -> None:
    """Apply an impulse [N·s] to the first side of contact k, and its opposite to the second."""
    contacts = problem.contacts
    only = contacts.only[k]
    if only >= 0:
        set_row(v, only, plus_scaled(row(v, only), load(contacts.gain, 4 * k), j))
    else:
        for m in range(number_of(k, contacts.loose)):
            i = load(contacts.particle, 4 * k + m)
            set_row_each(v, i, plus_scaled(row_each(v, i), load(contacts.gain, 4 * k + m), j))
        push_turning(v, k, j, 0.0 * j, problem, contacts.turning)


@compiled
def push_turning(
    v: Rows, k: int, j: Vector, couple: Vector, problem: Problem, turning: Turning | None
) -> None:
    """Apply opposite impulses [N·s] and couples [N·m·s] to the bodies of contact k that turn as one."""
    if turning is not None:
        contacts = problem.contacts
        for side in range(2):
            body = contacts.body[2 * k + side]
            if turns_as_one(body, turning):
                n = turning.first[body]
                one = 1.0 if side == 0 else -1.0
                moment = cross(row(contacts.arm, 4 * k + side), j) + couple
                set_row(v, n, plus_scaled(row(v, n), one * load(turning.lightness, body), j))
                set_row(v, n + 1, plus_scaled(row(v, n + 1), one, moment))


@compiled
def spin_between(v: Rows, k: int, problem: Problem, turning: Turning | None) -> Vector:
    """Return ω of the first body of contact k less that of the second [rad/s], if they turn as one."""
    total = 0.0 * row(problem.contacts.normal, k)
    if turning is not None:
        for side in range(2):
            body = problem.contacts.body[2 * k + side]
            if turns_as_one(body, turning):
                omega = spin(v, body, 0, turning)
                total = total + (omega if side == 0 else -1.0 * omega)
    return total


@compiled
def spun_by(moment: Vector, across: bool, k: int, problem: Problem, turning: Turning | None) -> Vector:
    """Return the change of `spin_between` by the couple ``moment`` or, if ``across``, by an impulse."""
    total = 0.0 * moment
    if turning is not None:
        for side in range(2):
            body = problem.contacts.body[2 * k + side]
            if turns_as_one(body, turning):
                twist = cross(row(problem.contacts.arm, 4 * k + side), moment) if across else moment
                total = total + turned(body, 0, twist, turning)
    return total


@compiled
def slip_by_couple(q: Vector, k: int, problem: Problem, turning: Turning | None) -> Vector:
    """Return the change of the velocity between the sides of contact k [m/s] by a couple."""
    total = 0.0 * q
    if turning is not None:
        for side in range(2):
            body = problem.contacts.body[2 * k + side]
            if turns_as_one(body, turning):
                at_end = problem.contacts.at_end[k]
                arm = row(problem.contacts.arm, 4 * k + 2 * at_end + side)
                total = total + cross(turned(body, at_end, q, turning), arm)
    return total
