"""The node of a step with surfaces or colliding bodies, where all impulses of the step act at once.

Particles fly straight for half a step, receive the impulses of springs, gravity, actuators, dampers,
surfaces, other bodies and friction, and fly straight for the other half. With v₋ and v₊ the velocities
before and after the node, an impulse p changes the kinetic energy by exactly p · (v₋ + v₊)/2: this is what
the ledger records, and a contact takes this mean for its rate of deformation (`springgym.contact.law`). The
mean is zero for resting bodies, so that they lose nothing, and do not creep.

States are those at the end of a drift, with positions and velocities of the same time. The impulses of
contact at the last node are stored (`springgym.terms.LastNode`).

Forces act in this order: a kick to the node, half of the predicted impulse of contact, actuators and dampers,
minus that half, a kick from the node, and contact. Dampers must use the mean velocity with contact; else
resting bodies would seem to stretch. The prediction is the impulse of the last node.

Surfaces act on each particle separately (`springgym.contact.points`). Bodies that collide or roll use
`springgym.integrators.rows`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.contact.law import Times
from springgym.contact.points import impulses, near
from springgym.contact.records import RowSpace
from springgym.contact.surfaces import coefficient
from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Rows, Vector
from springgym.core.lanes import any_lane, load, of_body, select, store
from springgym.core.vectors import dot, plus_scaled, row, set_row, vec
from springgym.forces.actuators import move_drive, push
from springgym.forces.cycle import relax_in_turn
from springgym.forces.ledger import CONTACT, DAMPING, FRICTION, WORK, record
from springgym.forces.springs import damp
from springgym.terms import Cycle, Dampers, LastNode, Terms

START = -1
"""Value for the number of steps for which a kernel only finds which bodies of fresh copies touch."""


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


class Bodies(NamedTuple):
    """Bodies at a node, or one of them: `springgym.core.lanes.of_body` selects it in all fields."""

    x: Rows
    """(N, 3) positions at the node [m]"""
    v: Rows
    """(N, 3) velocities [m/s]: v₋ until contact has acted on the particle, then v₊"""
    ledger: Ledger
    space: Space
    terms: Terms


# --- Forces except contact ------------------------------------------------------------------------------


@compiled
def span_of(h: Number, goes: bool, x: Rows) -> Times:
    """Return the times of a node in each lane; unless ``goes``, there is no drift before it."""
    whole = h + 0.0 * load(of_body(x, 0), (0, 0))
    half = 0.5 * whole
    return Times(half if goes else 0.0 * whole, half, whole if goes else half)


@compiled
def act_and_damp(own: Bodies, h: Number) -> None:
    """Apply actuators and dampers for a step.

    Dampers act in a sweep of half a step before the actuators and one after them; or in one of a full step,
    alternately before and after them. Copies of a block that differ in this are treated one group after the
    other. In cycles, dampers act as in `springgym.forces.cycle`.
    """
    w, b, terms, ledger = own.space.w, own.space.b, own.terms, own.ledger
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
        w, direction, springs, drive = own.space.w, own.space.direction, own.terms.springs, own.terms.drive
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
        space, work = own.space, 0.0 * span.out
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
        record(ledger, WORK, work)
    else:
        record(ledger, DAMPING, -1.0 * work)


# --- Particles at surfaces ------------------------------------------------------------------------------


@compiled
def pass_particles(own: Bodies, span: Times) -> None:
    """Apply all forces at a node to a body whose particles touch surfaces, and drift to the end of the step.

    The path of a particle that was beyond Δ of all surfaces begins where that of the last node ended.
    """
    x, v, space, terms = own.x, own.v, own.space, own.terms
    add_predicted(own, terms.last)
    act_and_damp(own, span.whole)
    subtract_predicted(own, span, terms.last)
    for i in range(x.shape[0]):
        place, was, after = row(x, i), space.busy[i], free_velocity(i, span, own)
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


@compiled
def kick_by_surfaces(i: int, free: Vector, span: Times, own: Bodies) -> Vector:
    """Return the velocity of particle ``i`` after surfaces have acted, and record its losses.

    The energy from the barriers minus the work of their impulses is lost to restitution. Without loss, only a
    rounding error remains, which is not recorded.
    """
    ledger, mass, terms = own.ledger, load(own.terms.particles.mass, i), own.terms
    start, place = row(own.v, i), row(own.x, i)
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
    record(ledger, CONTACT, select(coefficient(terms.loss, 0.0 * lost) > 0.0, mass * lost, 0.0))
    record(ledger, FRICTION, -1.0 * mass * dot(given.rub, mean))
    store_predicted(i, 0.5 * change, terms.last)
    return after
