"""Bodies of springs in a step in which they may touch something, see `springgym.dynamics.step`.

Particles fly straight for half a step, to the node. There they receive the impulses of springs, gravity,
actuators, dampers and contact, and then they fly straight for the other half.

Forces act in this order: a kick to the node, half of the predicted impulse of contact, actuators and dampers,
minus that half, a kick from the node, and contact. Dampers must use the mean velocity with contact; else
resting bodies would seem to stretch. The prediction is the impulse of the last node, which is stored
(`springgym.dynamics.terms.LastNode`).

`SPRINGS` are bodies that collide or roll, whose contacts are solved together. `PARTICLES` touch surfaces one
by one (`springgym.dynamics.contact.points`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.bodies import all_rows, bodies_of, first_row, of_body
from springgym.core.language.kinds import Ledger, Number, Rows, Vector
from springgym.core.language.lanes import any_lane, select
from springgym.core.language.memory import load, store
from springgym.core.language.vectors import cross, dot, plus_scaled, row, set_row, vec
from springgym.dynamics.contact.ground import Grounded, find_ground
from springgym.dynamics.contact.movers import find_inertia, gather, turned
from springgym.dynamics.contact.points import impulses, near
from springgym.dynamics.contact.round import Way
from springgym.dynamics.contact.solver import solve
from springgym.dynamics.contact.surfaces import coefficient
from springgym.dynamics.forces import actuate, divide_and_kick, divide_by_mass, drift, set_forces
from springgym.dynamics.forces.actuators import move_drive, push
from springgym.dynamics.forces.cycle import count_step, damps_somewhere, relax_in_turn
from springgym.dynamics.forces.ledger import LedgerEntry, record
from springgym.dynamics.forces.springs import damp
from springgym.dynamics.records import (
    MOST_ITERATED,
    ContactCount,
    ContactRows,
    Problem,
    RowSpace,
    Surfaces,
    Times,
    Turning,
)
from springgym.dynamics.step import Alone, Bodies, Kind
from springgym.dynamics.terms import Cycle, Dampers, LastNode, Terms

SWEEPS = 2
"""Number of sweeps in which a node finds the impulses of its contacts, in alternating order."""

ENOUGH = 1e-3
"""Change of a gap, over Δ, below which sweeps end. With more than `MOST_ITERATED` bodies, all `SWEEPS` are
made: the error of fewer sweeps shakes a pile."""


class Space(NamedTuple):
    """The arrays in which a thread computes a node."""

    a: Rows
    """(N, 3) accelerations by springs and gravity [m/s²]"""
    b: Rows
    """(N, 3) accelerations by actuators [m/s²]"""
    w: Rows
    """(N, 3) velocities between the kicks, before contact [m/s]; unused if only contact acts there"""
    direction: Rows
    """(springs, 3) unit vector along each spring"""
    pushes: Rows
    """(surfaces, 3) change of velocity [m/s] of a particle by each surface, where these are coupled"""
    busy: np.ndarray
    """(N,) whether contact may act on the particle in any copy; before it is set, that of the last node"""
    rows: RowSpace | None
    """workspace of the contacts of bodies that collide or roll; None if no body does"""


# --- To the node ------------------------------------------------------------------------------------------


@compiled
def expect_contact(body: int, bodies: Bodies) -> None:
    """Mark all particles of a body as those that contact may act on."""
    own = of_body(bodies, body)
    for i in range(own.x.shape[0]):
        own.space.busy[i] = True


@compiled
def arrive(body: int, bodies: Bodies, span: Times) -> None:
    """Drift a body to the node, and find the velocities of its particles there without contact."""
    own = of_body(bodies, body)
    drift_to_node(own, span)
    add_predicted(own, own.terms.last)
    act_and_damp(own, span.whole)
    subtract_predicted(own, span, own.terms.last)


@compiled
def drift_to_node(own: Bodies, span: Times) -> None:
    """Drift to a node, and compute the forces on a body there."""
    x = own.x
    space = own.space
    terms = own.terms
    drift(x, own.v, span.lead)
    set_forces(x, space.a, space.direction, damps_somewhere(terms.cycle), terms)
    actuate(x, space.b, terms)
    if acts_between_kicks(terms):
        divide_and_kick(space.a, own.v, space.w, span.lead, terms.particles)
    else:
        divide_by_mass(space.a, terms.particles)


@compiled
def act_and_damp(own: Bodies, h: Number) -> None:
    """Apply actuators and dampers for a step.

    Dampers act in a sweep of half a step before the actuators and one after them; or in one of a full step,
    alternately before and after them. Copies of a block that differ in this are treated one group after the
    other. In cycles, dampers act as in `springgym.dynamics.forces.cycle`.
    """
    w = own.space.w
    b = own.space.b
    terms = own.terms
    ledger = own.ledger
    for part in range(2):
        if part == 1:
            push(w, b, h, terms.particles, terms.wrench, terms.thrust, ledger)
            move_drive(w, b, h, terms.drive, ledger)
        relax_at(part, own, terms.cycle)


@compiled
def relax_at(part: int, own: Bodies, cycle: Cycle | None) -> None:
    """Apply the dampers before (``part`` 0) or after (1) the actuators, or in cycles."""
    if cycle is None:
        relax_some(part, own, own.terms.dampers, own.terms.last)
    else:
        relax_in_turn(own.space.w, own.space.direction, part == 1, own.ledger, own.terms)


@compiled
def relax_some(part: int, own: Bodies, dampers: Dampers | None, last: LastNode | None) -> None:
    """Apply the dampers before or after the actuators, to the copies in which they act there."""
    if dampers is not None:
        w = own.space.w
        direction = own.space.direction
        springs = own.terms.springs
        drive = own.terms.drive
        sweep = load(last.sweep, 0)
        among = (sweep if part == 1 else 1.0 - sweep) > (-1.0 if dampers.paired else 0.5)
        if any_lane(select(among, 0.0, 1.0 + 0.0 * sweep) > 0.5):
            if any_lane(among):
                damp(w, direction, springs, dampers, drive, own.ledger, part == 0, True, among)
        else:
            damp(w, direction, springs, dampers, drive, own.ledger, part == 0, not dampers.paired)
        if part == 1:
            store(last.sweep, 0, 1.0 - sweep)


@compiled
def acts_between_kicks(terms: Terms) -> bool:
    """Return whether actuators or dampers act between the two kicks of a node."""
    driven = terms.wrench is not None or terms.thrust is not None or terms.drive is not None
    return driven or terms.dampers is not None


@compiled
def before_contact(i: int, before: Rows, span: Times, own: Bodies) -> Vector:
    """Return the velocity of a particle between the kicks of a node, before contact [m/s]."""
    if acts_between_kicks(own.terms):
        return row(own.space.w, i)
    return plus_scaled(row(before, i), span.lead, row(own.space.a, i))


@compiled
def free_velocity(i: int, span: Times, own: Bodies) -> Vector:
    """Return the velocity of a particle after a node without contact [m/s]."""
    return plus_scaled(before_contact(i, own.v, span, own), span.out, row(own.space.a, i))


# --- Predicted impulses of contact ----------------------------------------------------------------------


@compiled
def add_predicted(own: Bodies, last: LastNode | None) -> None:
    """Add half of the predicted change by contact to the velocities of busy particles."""
    if last is not None:
        space = own.space
        for i in range(own.x.shape[0]):
            if space.busy[i]:
                set_row(space.w, i, row(space.w, i) + row(last.half_change, i))


@compiled
def subtract_predicted(own: Bodies, span: Times, last: LastNode | None) -> None:
    """Subtract it before contact acts, and record its cross work with the impulses in between."""
    if last is not None:
        space = own.space
        work = 0.0 * span.out
        for i in range(own.x.shape[0]):
            if space.busy[i]:
                half = row(last.half_change, i)
                now = row(space.w, i) - half
                set_row(space.w, i, now)
                others = now - plus_scaled(row(own.v, i), span.lead, row(space.a, i))
                work = work - load(own.terms.particles.mass, i) * dot(others, half)
        record_cross_work(own.ledger, work, own.terms.dampers)


@compiled
def store_predicted(i: int, half: Vector, last: LastNode | None) -> None:
    """Store ``half`` of the change of velocity of particle ``i`` by contact for the next node."""
    if last is not None:
        set_row(last.half_change, i, half)


@compiled
def record_cross_work(ledger: Ledger, work: Number, dampers: Dampers | None) -> None:
    """Record the work of actuators and dampers that contact adds, by changing the mean velocity."""
    if dampers is None:
        record(ledger, LedgerEntry.WORK, work)
    else:
        record(ledger, LedgerEntry.DAMPING, -1.0 * work)


# --- Particles that touch surfaces one by one ---------------------------------------------------------------


@compiled
def leave_surfaces(body: int, bodies: Bodies, span: Times) -> None:
    """Apply surfaces to each particle of a body, and drift to the end of the step.

    The path of a particle that was beyond Δ of all surfaces begins where that of the last node ended.
    """
    own = of_body(bodies, body)
    x = own.x
    v = own.v
    space = own.space
    terms = own.terms
    for i in range(x.shape[0]):
        place = row(x, i)
        was = space.busy[i]
        after = free_velocity(i, span, own)
        end = plus_scaled(place, span.out, after)
        begin = end
        if was:
            begin = plus_scaled(place, -1.0 * span.lead, row(v, i))
        space.busy[i] = terms.particles.free[i] and any_lane(near(begin, end, terms.surfaces))
        if space.busy[i]:
            after = kick_by_surfaces(i, after, span, own)
        elif was:
            store_predicted(i, vec(0.0, 0.0, 0.0), terms.last)
        set_row(v, i, after)
        set_row(x, i, plus_scaled(place, span.out, after))
    count_step(terms.cycle)


@compiled
def kick_by_surfaces(i: int, free: Vector, span: Times, own: Bodies) -> Vector:
    """Return the velocity of particle ``i`` after surfaces have acted, and record its losses.

    The energy from the barriers minus the work of their impulses is lost to restitution. Without loss, only a
    rounding error remains, which is not recorded.
    """
    ledger = own.ledger
    mass = load(own.terms.particles.mass, i)
    terms = own.terms
    start = row(own.v, i)
    place = row(own.x, i)
    way = plus_scaled(place, -1.0 * span.lead, start), plus_scaled(place, span.out, free)
    given = impulses(i, way, start, free - start, span, own.space.pushes, terms)
    change = given.change + given.rub
    after = free + change
    kicked = plus_scaled(start, span.lead, row(own.space.a, i))
    others = before_contact(i, own.v, span, own) - kicked
    record_cross_work(ledger, 0.5 * mass * dot(others, change), terms.dampers)
    mean = plus_scaled(kicked, 0.5, others + change)
    gone = plus_scaled(span.lead * start, span.out, after)
    lost = dot(given.force, gone) / span.whole - dot(given.change, mean)
    record(ledger, LedgerEntry.CONTACT, select(coefficient(terms.loss, 0.0 * lost) > 0.0, mass * lost, 0.0))
    record(ledger, LedgerEntry.FRICTION, -1.0 * mass * dot(given.rub, mean))
    store_predicted(i, 0.5 * change, terms.last)
    return after


# --- Bodies whose contacts are solved together --------------------------------------------------------------


@compiled
def arrive_together(body: int, bodies: Bodies, span: Times) -> None:
    """Drift a body to the node, as `arrive` does, and store its free velocities in the form of contacts."""
    arrive(body, bodies, span)
    own = of_body(bodies, body)
    space = bodies.space.rows
    space.active[body] = False
    space.rolls[body] = False
    first = first_row(bodies.x, body)
    for i in range(own.x.shape[0]):
        # avoids −0, to which contacts of other copies would add 0
        set_row(space.velocity, first + i, free_velocity(i, span, own) + vec(0.0, 0.0, 0.0))


@compiled
def at_node(bodies: Bodies, placed: bool) -> tuple[Rows, Rows]:
    """Return positions and velocities of all particles: at the node, or where they were ``placed``."""
    return all_rows(bodies.x), all_rows(bodies.v)


@compiled
def find_at_surfaces(body: int, bodies: Bodies, span: Times) -> None:
    """List the contacts of a body with surfaces."""
    own = of_body(bodies, body)
    list_ground(body, first_row(bodies.x, body), own, span, bodies.space.rows, own.terms.surfaces)


@compiled
def list_ground(
    body: int, first: int, own: Bodies, span: Times, space: RowSpace, surfaces: Surfaces | None
) -> None:
    """List the contacts of a body with surfaces, if there are any."""
    if surfaces is not None:
        terms = own.terms
        contacts = space.contacts
        free = space.velocity[first : first + own.x.shape[0]]
        begin = Way(own.x, own.v, -1.0 * span.lead)
        end = Way(own.x, free, span.out)
        pair = terms.collisions.pairs.among + body
        ground = Grounded(pair, body, first, own.x, begin, end, terms.particles.free, surfaces, contacts)
        contacts.length[ContactCount.ROWS] = find_ground(
            contacts.length[ContactCount.ROWS], ground, terms.rounds
        )


@compiled
def join(bodies: Bodies, span: Times, problem: Problem, between: int) -> None:
    """Set the velocities before the node of all bodies that have contacts, in the form of contacts."""
    space = bodies.space.rows
    contacts = space.contacts
    for k in range(contacts.length[ContactCount.ROWS]):
        first = problem.pairs.first[contacts.pair[k]]
        space.active[first] = True
        if k < between:
            space.active[problem.pairs.second[contacts.pair[k]]] = True
        elif contacts.at_end[k] == 1:
            space.rolls[first] = True
    for body in range(bodies_of(bodies.x)):
        if space.active[body]:
            first = first_row(bodies.x, body)
            join_body(body, first, of_body(bodies, body), span, space, contacts.turning)


@compiled
def join_body(
    body: int, first: int, own: Bodies, span: Times, space: RowSpace, turning: Turning | None
) -> None:
    """Set the velocities of a body before the node; if it turns as one, those without contact, too."""
    if turning is not None and turning.turns[body]:
        mass = own.terms.particles.mass
        inverse_mass = own.terms.particles.inverse_mass
        free = space.velocity[first : first + own.x.shape[0]]
        ends = space.free[first : first + own.x.shape[0]]
        for i in range(own.x.shape[0]):
            set_row(ends, i, plus_scaled(row(own.x, i), span.out, row(free, i)))
        for at_end in range(2 if space.rolls[body] else 1):
            find_inertia(body, at_end, own.x if at_end == 0 else ends, mass, inverse_mass, turning)
        gather(body, space.before, own.x, own.v, mass, turning)
        gather(body, space.free, own.x, free, mass, turning)
        for part in range(2):
            set_row(space.velocity, first + part, row(space.free, first + part))
    else:
        for i in range(own.x.shape[0]):
            set_row(space.before, first + i, row(own.v, i))


@compiled
def find_impulses(bodies: Bodies, span: Times, problem: Problem, between: int) -> None:
    """Find all impulses by `SWEEPS` sweeps, or fewer if they change little."""
    space = bodies.space.rows
    store(space.contacts.going, 0, 1.0)
    enough = ENOUGH if bodies_of(bodies.x) <= MOST_ITERATED else 0.0
    solve(space.velocity, SWEEPS, enough, True, problem)


@compiled
def leave(body: int, bodies: Bodies, span: Times) -> None:
    """Drift a body to the end of the step with the velocity that contact gave it, and record its losses."""
    space = bodies.space.rows
    own = of_body(bodies, body)
    first = first_row(bodies.x, body)
    drift_on(body, first, space.active[body], own, span, space, space.contacts.turning)
    count_step(own.terms.cycle)


@compiled
def drift_on(
    body: int, first: int, active: bool, own: Bodies, span: Times, space: RowSpace, turning: Turning | None
) -> None:
    """Drift a body to the end of the step; if contact is ``active``, with its changes and losses."""
    last = own.terms.last
    mass = own.terms.particles.mass
    turns = turning is not None and turning.turns[body]
    faster, spin, point = motion_by_contact(body, first, space, turning)
    work = 0.0 * span.out
    for i in range(own.x.shape[0]):
        was = own.space.busy[i]
        own.space.busy[i] = active
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
        record_losses(body, own.ledger, space.contacts)


@compiled
def motion_by_contact(
    body: int, first: int, space: RowSpace, turning: Turning | None
) -> tuple[Vector, Vector, Vector]:
    """Return the changes by contact of v [m/s] and ω [rad/s] of a body that rotates, and its point X [m]."""
    faster = 0.0 * row(space.velocity, first)
    spin = faster
    point = faster
    if turning is not None and turning.turns[body] and space.active[body]:
        faster = row(space.velocity, first) - row(space.free, first)
        twist = row(space.velocity, first + 1) - row(space.free, first + 1)
        spin = turned(body, 0, twist, turning)
        point = row(turning.point, body)
    return faster, spin, point


@compiled
def record_losses(body: int, ledger: Ledger, contacts: ContactRows) -> None:
    """Record the losses of a body to restitution and friction."""
    record(ledger, LedgerEntry.CONTACT, load(contacts.losses, (body, 0)))
    record(ledger, LedgerEntry.FRICTION, load(contacts.losses, (body, 1)))
    for entry in range(2):
        store(contacts.losses, (body, entry), 0.0)


SPRINGS = Kind(expect_contact, arrive_together, leave, at_node, find_at_surfaces, join, find_impulses)
"""Bodies of springs that collide or roll."""

PARTICLES = Alone(expect_contact, arrive, leave_surfaces)
"""Bodies of springs whose particles touch surfaces one by one."""
