"""The node of a step of bodies of springs that collide or roll, with rows of contact.

First, all other forces give every particle a velocity. Contacts are found from the positions of particles at
the node, and at the beginning and end of the step (`springgym.contact.search` between bodies,
`springgym.contact.ground` at surfaces), and solved together (`springgym.contact.solver`). Bodies without
contacts move as if there were no contact. Half of a pair's losses and half of the energy in its barriers are
recorded for each of its bodies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types
from numba.extending import overload

from springgym.contact.ground import Grounded, find_ground, shift_arms
from springgym.contact.law import Times
from springgym.contact.movers import find_inertia, gather, turned
from springgym.contact.records import (
    ENERGY,
    ENTRIES,
    MANY,
    MET,
    ROWS,
    Collisions,
    ContactRows,
    Neighbours,
    Problem,
    RowSpace,
    Surfaces,
    Turning,
)
from springgym.contact.round import Way
from springgym.contact.rows import describe
from springgym.contact.search import find
from springgym.contact.solver import add_totals, prepare, solve, start_totals
from springgym.contact.totals import entry_of, list_changing
from springgym.contact.warm import keep_impulses, start_warm
from springgym.core.compiling import OPTIONS, compiled
from springgym.core.kinds import Ledger, Ragged, Rows, Vector
from springgym.core.lanes import all_rows, bodies_of, load, of_body, store
from springgym.core.vectors import cross, dot, mass_centre, plus_scaled, row, set_row, vec
from springgym.forces.ledger import CONTACT, FRICTION, record
from springgym.integrators.node import (
    Bodies,
    act_and_damp,
    add_predicted,
    before_contact,
    free_velocity,
    record_cross_work,
    store_predicted,
    subtract_predicted,
)

SWEEPS = 2
"""Number of sweeps in which a node finds the impulses of its contacts, in alternating order."""

ENOUGH = 1e-3
"""Sweeps end when one changes no gap by more than this fraction of Δ. With more than `MANY` bodies all
`SWEEPS` are made, because the error of fewer sweeps shakes a pile."""

INLINE = {**OPTIONS, "forceinline": True}


# --- Rows of all bodies -----------------------------------------------------------------------------------


def first_row(rows: Any, body: int) -> int:
    """Return the index of a body's first row among all."""
    return int(rows.start[body]) if isinstance(rows, Ragged) else 0


@overload(first_row, jit_options=INLINE)
def _first_row(rows: Any, body: int) -> Callable[..., int]:
    def of_several(rows: Any, body: int) -> int:
        return rows.start[body]

    def of_one(rows: Any, body: int) -> int:
        return 0

    return of_several if isinstance(rows, types.BaseTuple) else of_one


# --- The node ---------------------------------------------------------------------------------------------


@compiled
def pass_rows(bodies: Bodies, span: Times, goes: bool, space: RowSpace) -> None:
    """Apply all forces to all bodies at a node, and drift to the end of the step.

    Unless ``goes``, only find which bodies of fresh copies touch.
    """
    collisions, contacts = bodies.terms.collisions, space.contacts
    velocity = space.velocity
    if goes:
        for n in range(bodies_of(bodies.x)):
            set_free(n, of_body(bodies, n), span, bodies.x, space)
    problem = problem_of(bodies, span, space)
    among = find_among(problem, space, space.lists)
    contacts.length[ROWS] = among
    if goes:
        for n in range(bodies_of(bodies.x)):
            own = of_body(bodies, n)
            find_below(n, own, span, bodies.x, space, own.terms.surfaces)
    list_changing(contacts, collisions.totals, collisions.changing)
    if not goes:
        enter_touching(problem, collisions)
        return
    rows = contacts.length[ROWS]
    for n in range(bodies_of(bodies.x)):
        space.active[n], space.rolls[n] = False, False
    if rows > 0:
        for k in range(rows):
            first = problem.pairs.first[contacts.pair[k]]
            space.active[first] = True
            if k < among:
                space.active[problem.pairs.second[contacts.pair[k]]] = True
            elif contacts.late[k] == 1:
                space.rolls[first] = True
        for n in range(bodies_of(bodies.x)):
            if space.active[n]:
                begin(n, of_body(bodies, n), span, bodies.x, space, contacts.turning)
        begin_rows(among, velocity, problem, collisions, space.lists)
        store(contacts.going, 0, 1.0)
        solve(velocity, SWEEPS, ENOUGH if bodies_of(bodies.x) <= MANY else 0.0, True, problem)
    add_totals(velocity, problem, collisions.changing)
    keep_impulses(problem, collisions.warm)
    for n in range(bodies_of(bodies.x)):
        leave(n, space.active[n], of_body(bodies, n), span, bodies.x, space, contacts.turning)


@compiled
def enter_touching(problem: Problem, collisions: Collisions) -> None:
    """Record in the totals which bodies touch in copies that were just placed."""
    start_totals(load(collisions.fresh, 0) > 0.5, problem, collisions.changing)
    store(collisions.fresh, 0, 0.0)


@compiled
def begin_rows(n: int, v: Rows, problem: Problem, collisions: Collisions, lists: Neighbours | None) -> None:
    """Prepare all contacts, the first ``n`` of which join two bodies, and warm-start their impulses."""
    contacts = problem.contacts
    for k in range(contacts.length[ROWS]):
        if lists is not None and k < n:
            describe(k, problem)
        else:
            shift_arms(k, contacts, contacts.turning)
        prepare(k, v, problem)
    start_warm(v, problem, collisions.warm)


@compiled
def problem_of(bodies: Bodies, span: Times, space: RowSpace) -> Problem:
    """Return the `Problem` of a node, before its contacts are found."""
    particles, collisions = bodies.terms.particles, bodies.terms.collisions
    fetch(bodies.x, particles.mass, all_rows(bodies.x), all_rows(bodies.v), space, space.lists)
    return Problem(
        span,
        space.places,
        space.before,
        all_rows(particles.inverse_mass),
        collisions.pairs,
        space.contacts,
        collisions.totals,
    )


@compiled
def fetch(of: Any, mass: Any, x: Rows, v: Rows, space: RowSpace, lists: Neighbours | None) -> None:
    """Copy positions and velocities of all particles in the form of contacts, if bodies collide."""
    if lists is not None:
        for i in range(x.shape[0]):
            set_row(space.places, i, row(x, i))
            set_row(space.speeds, i, row(v, i))
        see_balls(of, mass, space, space.contacts.turning)


@compiled
def see_balls(of: Any, mass: Any, space: RowSpace, turning: Turning | None) -> None:
    """Move the first particle of each ball to its centre of mass, in the arrays of contacts."""
    if turning is not None:
        for n in range(bodies_of(of)):
            if turning.balls[n]:
                own, first = of_body(mass, n), first_row(of, n)
                for rows in (space.places, space.speeds):
                    set_row(rows, first, mass_centre(rows[first : first + own.size], own))


@compiled
def set_free(n: int, own: Bodies, span: Times, x: Rows, space: RowSpace) -> None:
    """Apply all forces except contact to a body."""
    add_predicted(own, own.terms.last)
    act_and_damp(own, span.whole)
    subtract_predicted(own, span, own.terms.last)
    first = first_row(x, n)
    for i in range(own.x.shape[0]):
        # avoids −0, to which contacts of other copies would add 0
        set_row(space.velocity, first + i, free_velocity(i, span, own) + vec(0.0, 0.0, 0.0))


@compiled
def find_among(problem: Problem, space: RowSpace, lists: Neighbours | None) -> int:
    """List the contacts between bodies, if they collide, and return the number of rows."""
    if lists is None:
        space.contacts.length[MET] = 0
        return 0
    return find(problem.x, space.speeds, problem.span, problem.pairs, lists, space.contacts)


@compiled
def find_below(n: int, own: Bodies, span: Times, x: Rows, space: RowSpace, surfaces: Surfaces | None) -> None:
    """List the contacts of a body with surfaces, if there are any."""
    if surfaces is not None:
        first, terms, contacts = first_row(x, n), own.terms, space.contacts
        free = space.velocity[first : first + own.x.shape[0]]
        begin, end = Way(own.x, own.v, -1.0 * span.lead), Way(own.x, free, span.out)
        pair, moves = terms.collisions.pairs.among + n, terms.particles.free
        ground = Grounded(pair, n, first, own.x, begin, end, moves, surfaces, contacts)
        contacts.length[ROWS] = find_ground(contacts.length[ROWS], ground, terms.rounds)


@compiled
def begin(n: int, own: Bodies, span: Times, x: Rows, space: RowSpace, turning: Turning | None) -> None:
    """Set the velocities before the node of a body that has contacts, in the form of contacts."""
    first, mass = first_row(x, n), own.terms.particles.mass
    if turning is not None and turning.turns[n]:
        free = space.velocity[first : first + own.x.shape[0]]
        inverse_mass = own.terms.particles.inverse_mass
        ends = space.free[first : first + own.x.shape[0]]
        for i in range(own.x.shape[0]):
            set_row(ends, i, plus_scaled(row(own.x, i), span.out, row(free, i)))
        for late in range(2 if space.rolls[n] else 1):
            find_inertia(n, late, own.x if late == 0 else ends, mass, inverse_mass, turning)
        gather(n, space.before, own.x, own.v, mass, turning)
        gather(n, space.free, own.x, free, mass, turning)
        for part in range(2):
            set_row(space.velocity, first + part, row(space.free, first + part))
    else:
        for i in range(own.x.shape[0]):
            set_row(space.before, first + i, row(own.v, i))


@compiled
def leave(
    n: int, active: bool, own: Bodies, span: Times, x: Rows, space: RowSpace, turning: Turning | None
) -> None:
    """Drift a body to the end of the step, and record its losses."""
    first, last, mass = first_row(x, n), own.terms.last, own.terms.particles.mass
    turns = turning is not None and turning.turns[n]
    faster, spin, point = motion_given(n, first, space, turning)
    work = 0.0 * span.out
    for i in range(own.x.shape[0]):
        was, own.space.busy[i] = own.space.busy[i], active
        after = row(space.velocity, first + i)
        if active:
            free = free_velocity(i, span, own)
            if turns:
                after = free + (faster + cross(spin, row(own.x, i) - point))
            change = after - free
            others = before_contact(i, own.v, span, own)
            others = others - plus_scaled(row(own.v, i), span.lead, row(own.space.a, i))
            work = work + load(mass, i) * dot(others, change)
            store_predicted(i, 0.5 * change, last)
        elif was:
            store_predicted(i, vec(0.0, 0.0, 0.0), last)
        set_row(own.v, i, after)
        set_row(own.x, i, plus_scaled(row(own.x, i), span.out, after))
    if active:
        record_cross_work(own.ledger, 0.5 * work, own.terms.dampers)
        record_losses(n, own.ledger, space.contacts)


@compiled
def record_losses(n: int, ledger: Ledger, contacts: ContactRows) -> None:
    """Record the losses of a body to restitution and friction."""
    record(ledger, CONTACT, load(contacts.losses, (n, 0)))
    record(ledger, FRICTION, load(contacts.losses, (n, 1)))
    for entry in range(2):
        store(contacts.losses, (n, entry), 0.0)


@compiled
def motion_given(
    n: int, first: int, space: RowSpace, turning: Turning | None
) -> tuple[Vector, Vector, Vector]:
    """Return the changes by contact of v [m/s] and ω [rad/s] of a body that rotates, and its point X [m]."""
    faster = 0.0 * row(space.velocity, first)
    spin, point = faster, faster
    if turning is not None and turning.turns[n] and space.active[n]:
        faster = row(space.velocity, first) - row(space.free, first)
        twist = row(space.velocity, first + 1) - row(space.free, first + 1)
        spin, point = turned(n, 0, twist, turning), row(turning.point, n)
    return faster, spin, point


@compiled
def store_energy_of_pairs(collisions: Collisions | None) -> None:
    """Assign half of the energy in a pair's barriers to each of its bodies, if bodies collide."""
    if collisions is not None:
        pairs = collisions.pairs
        for body in range(collisions.stored.shape[0]):
            store(collisions.stored, body, 0.0)
        for n in range(1, entry_of(collisions.changing, 0) + 1):
            p = entry_of(collisions.changing, n)
            if p < pairs.among:
                half = 0.5 * load(collisions.totals, p * ENTRIES + ENERGY)
                for side in range(2):
                    body = pairs.first[p] if side == 0 else pairs.second[p]
                    store(collisions.stored, body, load(collisions.stored, body) + half)
