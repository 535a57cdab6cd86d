"""The node of a step: where all impulses of the step act at once, if there are surfaces or bodies collide.

Particles fly straight for half a step, receive the impulses of springs, gravity, actuators, dampers,
surfaces, other bodies and friction, and fly straight for the other half. With v₋ and v₊ the velocities
before and after the node, an impulse p changes the kinetic energy by exactly p · (v₋ + v₊)/2: that is what
the ledger enters, and what a contact takes for the speed at which it gives way (`springgym.contact.law`).
What rests has no such mean, so that it loses nothing, and does not creep.

The state is read amid a node, with the mean of v₋ and v₊ for its velocity: that of velocity Verlet where
nothing touches. What is read has half of the node behind it. `springgym.forces.memory` keeps v₋, from which
the next call makes the node anew. A fresh copy begins with the second half of a node: it was placed where no
drift ended.

Forces act in this order: a kick to the node, half of what contact is expected to give, actuators and dampers,
less that half, a kick from the node, and contact. Dampers must see the mean velocity, with what contact does
to it, else rest looks like stretching. It is expected that contact gives as much as at the last node.

Surfaces push each particle by itself (`springgym.contact.points`), or a body by its round features
(`springgym.contact.round`). Where bodies collide, what they give each other, and what surfaces give then,
follows from all else. So both take turns: surfaces, the pairs of bodies there and back, surfaces again,
friction between bodies there and back, each followed by the surfaces, which have the last word. Of a pair,
half of what it loses and half of the energy in its barriers is entered for each of its bodies. A scene whose
bodies do not collide has no `Exchange`, and none of this is compiled for it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.contact.friction import rub
from springgym.contact.law import Span
from springgym.contact.points import impulses, lifted, near, nothing_given
from springgym.contact.records import (
    ENERGY,
    ENTRIES,
    MET,
    Collisions,
    ContactRows,
    Given,
    Lists,
    Problem,
    Rolling,
    Rounds,
    Surfaces,
)
from springgym.contact.round import RoundProblem, lifted_feature, roll, rolls
from springgym.contact.search import find_contacts
from springgym.contact.solver import add_totals, lift_apart, prepare, start_totals, sweep, taper
from springgym.contact.spheres import as_seen, put_together, share_first, share_touched, take_apart
from springgym.contact.surfaces import coefficient, energy_at
from springgym.contact.totals import entry_of, list_changing
from springgym.contact.warm import keep_impulses, start_warm
from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Numbers, Rows, Vector
from springgym.core.lanes import any_lane, bodies_of, load, maximum, of_body, select, store
from springgym.core.vectors import TINY, choose, dot, plus_scaled, row, set_row, vec, vector
from springgym.forces import stored_energy
from springgym.forces.actuators import push
from springgym.forces.cycle import relax_in_turn
from springgym.forces.ledger import CONTACT, DAMPING, FRICTION, WORK, record
from springgym.forces.memory import PHASE, STORED, halve, turn_drive
from springgym.forces.springs import damp
from springgym.terms import Cycle, Dampers, Memory, Terms, Thrust, Wrench

START = -1
"""As a number of steps: none, but it is told which bodies of fresh copies touch."""

LOOK = -2
"""As a number of steps: none, but the node where the state was read is made anew, to look at its contacts."""

STARTS, PASSES, READS = range(3)
"""What a node is for: to tell what touches in fresh copies, to go on to the next, or to read the state."""


class Node(NamedTuple):
    """A node of a step."""

    phase: Number
    """0 of a fresh copy, else 1 or 2, see `springgym.forces.memory`"""
    span: Span
    h: Number
    """the step [s]"""
    stage: int
    """`STARTS`, `PASSES` or `READS`"""


class Exchange(NamedTuple):
    """The arrays in which a thread computes what bodies that collide, and surfaces with them, give.

    They are `Ragged` rows (N, 3) of all bodies, if nothing else is said.
    """

    in_contact: Numbers
    """(N,) 1 where a copy has the particle in a contact of bodies, else 0"""
    touched: Numbers
    """(N,) whether any copy of the block has the particle in a contact of bodies"""
    free: Rows
    """velocities of busy particles after the node, but for contact [m/s]"""
    velocity: Rows
    """velocities after the node, with the impulses of contact found so far [m/s]"""
    known: Rows
    """these velocities when surfaces had their last turn [m/s]"""
    by_bodies: Rows
    """change of velocity that bodies gave each other until that turn [m/s]"""
    change: Rows
    """change of velocity by surfaces, by their pushes; see `springgym.contact.records.Given` [m/s]"""
    rub: Rows
    """change of velocity by surfaces, by friction [m/s]"""
    force: Rows
    """Σ J n of surfaces [m/s]"""
    shift: Rows
    """how far a particle is lifted off other bodies where a node is read [m]"""
    any_busy: np.ndarray
    """(bodies,) True if any particle of a body is busy"""
    lists: Lists
    """the features that are near each other"""
    contacts: ContactRows
    """the contacts of the node"""


class Space(NamedTuple):
    """The arrays that a thread computes a node in."""

    a: Rows
    """(N, 3) accelerations by springs and gravity [m/s²]"""
    b: Rows
    """(N, 3) accelerations by actuators [m/s²]"""
    w: Rows
    """(N, 3) velocities amid the node, before contact [m/s]; unused if contact alone acts there"""
    direction: Rows
    """(springs, 3) where each spring points"""
    given: Rows
    """(N, 3) half of what surfaces are going to give, as far as is known before dampers act [m/s]"""
    pushes: Rows
    """(surfaces, 3) change of velocity [m/s] of a particle by each surface, where these are coupled"""
    rolling: Rolling | None
    """`springgym.contact.records.Rolling`; None without round features"""
    busy: np.ndarray
    """(N,) whether contact may act on the particle in any copy; at first as it was at the last node"""
    exchange: Exchange | None
    """what bodies give each other; None if they do not collide"""


class Bodies(NamedTuple):
    """Bodies at a node, or one of them: `springgym.core.lanes.of_body` picks it from all fields."""

    x: Rows
    """(N, 3) positions at the node [m]"""
    v: Rows
    """(N, 3) velocities [m/s]: v₋ until contact has acted on the particle, then v₊"""
    ledger: Ledger
    space: Space
    terms: Terms


class Passage(NamedTuple):
    """The passage of a particle through a node: its velocity before, what changes it, and after."""

    mass: Number
    """m [kg]"""
    start: Vector
    """velocity v₋ before the node [m/s]"""
    acceleration: Vector
    """acceleration by springs and gravity [m/s²]"""
    others: Vector
    """change of velocity by actuators and dampers [m/s]"""
    contact: Vector
    """change of velocity by contact [m/s]"""
    after: Vector
    """velocity v₊ after the node [m/s]"""


class Kicks(NamedTuple):
    """Sums over the kicks that a body's particles get at a node, for the energies that are read there."""

    others: Number
    """Σ m |δv|² of actuators and dampers [J]"""
    thrown: Number
    """Σ m |δv|² of actuators alone [J]"""
    stored: Number
    """what the mean velocity lacks of the energy with v₋ and v₊, by impulses of contact [J]"""
    touched: Number
    """Σ |δv|² of contact [m²/s²]"""
    springs: Number
    """Σ m |a|², beyond gravity's [J/s²]"""


# --- All but contact ------------------------------------------------------------------------------------


@compiled
def span_of(phase: Number, h: Number) -> Span:
    """Return the time of a node: a fresh copy has no drift before it."""
    out = 0.5 * h + 0.0 * phase
    lead = select(phase < 0.5, 0.0, out)
    return Span(lead, out, lead + out)


@compiled
def node_at(phase: Number, h: Number, stage: int) -> Node:
    """Return a node of a phase, for a stage."""
    return Node(phase, span_of(phase, h), h, stage)


@compiled
def next_phase(phase: Number) -> Number:
    """Return the phase after a node: the dampers' sweeps take turns in direction."""
    return select((phase - 1.0) * (phase - 1.0) < 0.25, 2.0 + 0.0 * phase, 1.0)


@compiled
def act_and_damp(own: Bodies, node: Node) -> None:
    """Let actuators and dampers act: a sweep of a whole step, or one of half of it before and one after.

    Copies of a block whose sweeps differ in direction have theirs one after the other. The second half of a
    node, of a fresh copy, has the sweep after the actuators, of half a step. In cycles, dampers act where it
    is their turn, see `springgym.forces.cycle`.
    """
    w, b, terms, ledger = own.space.w, own.space.b, own.terms, own.ledger
    for part in range(3):
        if part == 1:
            push(w, b, node.span.whole, terms.particles, terms.wrench, terms.thrust, ledger)
            turn_drive(w, b, node.span.whole, terms.memory, terms.drive, ledger)
        relax_at(part, node, own, terms.cycle)


@compiled
def relax_at(part: int, node: Node, own: Bodies, cycle: Cycle | None) -> None:
    """Let the dampers act before the actuators, after them, or on fresh copies; or in cycles."""
    if cycle is None:
        relax_some(part, node.phase, own, own.terms.dampers)
    elif part < 2:
        relax_in_turn(own.space.w, own.space.direction, part == 1, own.ledger, own.terms)


@compiled
def relax_some(part: int, phase: Number, own: Bodies, dampers: Dampers | None) -> None:
    """Let the dampers act on the copies whose turn it is: before the actuators, after them, or fresh ones."""
    if dampers is not None:
        if dampers.paired:
            among = phase > (0.5 if part == 0 else (-1.0 if part == 1 else 9.0))
        else:
            off = phase - (1.0 if part == 0 else (2.0 if part == 1 else 0.0))
            among = off * off < 0.25
        if any_lane(among):
            whole, w, direction = not dampers.paired and part < 2, own.space.w, own.space.direction
            springs, drive, ledger = own.terms.springs, own.terms.drive, own.ledger
            if any_lane(select(among, 0.0, 1.0 + 0.0 * phase) > 0.5):
                damp(w, direction, springs, dampers, drive, ledger, part == 0, whole, among)
            else:
                damp(w, direction, springs, dampers, drive, ledger, part == 0, whole)


@compiled
def pushed(b: Rows, i: int, like: Vector, wrench: Wrench | None, thrust: Thrust | None) -> Vector:
    """Return the acceleration of particle ``i`` by actuators, if there are any."""
    if wrench is None and thrust is None:
        return 0.0 * like
    return row(b, i)


@compiled
def acts_amid(terms: Terms) -> bool:
    """Tell whether anything but contact acts between the two kicks of a node."""
    driven = terms.wrench is not None or terms.thrust is not None or terms.drive is not None
    return driven or terms.dampers is not None


@compiled
def before_contact(i: int, before: Rows, span: Span, own: Bodies) -> Vector:
    """Return the velocity of a particle amid a node before contact, of its row ``before`` the node [m/s]."""
    if acts_amid(own.terms):
        return row(own.space.w, i)
    return plus_scaled(row(before, i), span.lead, row(own.space.a, i))


@compiled
def free_velocity(i: int, span: Span, own: Bodies) -> Vector:
    """Return the velocity of a particle after a node, but for contact [m/s]."""
    return plus_scaled(before_contact(i, own.v, span, own), span.out, row(own.space.a, i))


# --- What contact is expected to give -------------------------------------------------------------------


@compiled
def needs_expected(dampers: Dampers | None) -> bool:
    """Tell whether it is to be expected, before dampers act, what contact is going to give."""
    return dampers is not None


@compiled
def give_expected(own: Bodies, dampers: Dampers | None) -> None:
    """Give busy particles half of what contact is expected to give, before dampers act."""
    if needs_expected(dampers):
        space = own.space
        for i in range(own.x.shape[0]):
            if space.busy[i]:
                set_row(space.w, i, row(space.w, i) + row(space.given, i))


@compiled
def take_back_expected(own: Bodies, span: Span, dampers: Dampers | None) -> None:
    """Take that back, when all but contact have acted, and enter its product with what they did."""
    if needs_expected(dampers):
        space, work = own.space, 0.0 * span.out
        for i in range(own.x.shape[0]):
            if space.busy[i]:
                half = row(space.given, i)
                now = row(space.w, i) - half
                set_row(space.w, i, now)
                others = now - plus_scaled(row(own.v, i), span.lead, row(space.a, i))
                work = work - load(own.terms.particles.mass, i) * dot(others, half)
        record_cross_work(own.ledger, work, dampers)


@compiled
def expect(i: int, half: Vector, own: Bodies, dampers: Dampers | None) -> None:
    """Expect that contact gives particle ``i`` as much at the next node: half of it is ``half``."""
    if needs_expected(dampers):
        set_row(own.space.given, i, half)


@compiled
def record_cross_work(ledger: Ledger, work: Number, dampers: Dampers | None) -> None:
    """Enter the work of what acted before contact, by the change that contact makes to the mean velocity."""
    if dampers is None:
        record(ledger, WORK, work)
    else:
        record(ledger, DAMPING, -1.0 * work)


# --- Passing --------------------------------------------------------------------------------------------


@compiled
def pass_node(bodies: Bodies, node: Node, problem: Problem | None) -> None:
    """Let all act on all bodies at a node, and go on to the next, or read it.

    The ``problem`` is `find_touching`'s.
    """
    exchange = bodies.space.exchange
    if node.stage == STARTS:
        start_together(bodies.terms.collisions, bodies.terms.memory, node.phase, problem)
        return
    note_touched(bodies, problem, exchange)
    for n in range(bodies_of(bodies.x)):
        own = of_body(bodies, n)
        note_busy(n, pass_free(own, node, own.space.exchange), exchange)
    meet_each_other(bodies, node, problem, exchange)
    if node.stage == READS:
        for n in range(bodies_of(bodies.x)):
            own = of_body(bodies, n)
            halve(own.ledger, own.terms.memory)
            read_amid(own, node.span, own.space.exchange)
        store_energy_of_pairs(bodies.terms.collisions, bodies.terms.memory, 0.5)


@compiled
def pass_free(own: Bodies, node: Node, exchange: Exchange | None) -> bool:
    """Let a body's particles that contact cannot act on go on to the next node; tell whether any are busy.

    The way of what was not busy begins where that of the last node ended, out of reach. Busy particles meet
    surfaces at once, unless bodies collide: then they wait until it is found what these give each other.
    """
    x, v, space, span, terms = own.x, own.v, own.space, node.span, own.terms
    last = node.stage == READS
    tau = 0.0 if last else node.h
    give_expected(own, terms.dampers)
    act_and_damp(own, node)
    take_back_expected(own, span, terms.dampers)
    if last:
        for i in range(x.shape[0]):
            set_row(terms.memory.arrived, i, row(v, i))
    any_busy, whole = False, rolls(terms.rounds)
    rolling = begin_to_roll(own, span, terms.rounds, exchange)
    for i in range(x.shape[0]):
        place, was, free = row(x, i), space.busy[i], free_velocity(i, span, own)
        end = plus_scaled(place, span.out, free)
        begin = end
        if was:
            begin = plus_scaled(place, -1.0 * span.lead, row(v, i))
        busy = rolling or meets_bodies(i, exchange)
        busy = busy or (not whole and reached(i, begin, end, own, terms.surfaces))
        space.busy[i] = busy
        if busy:
            any_busy = True
            begin_contact(i, free, node, own, exchange)
        else:
            free = without_minus_zero(free, exchange)
            set_row(v, i, free)
            set_row(x, i, place + tau * free)
            if was:
                expect(i, vec(0.0, 0.0, 0.0), own, terms.dampers)
    return any_busy


@compiled
def without_minus_zero(free: Vector, exchange: Exchange | None) -> Vector:
    """Return a velocity without −0, where bodies collide: contacts of other copies would add 0 to it."""
    if exchange is None:
        return free
    return free + vec(0.0, 0.0, 0.0)


@compiled
def reached(i: int, begin: Vector, end: Vector, own: Bodies, surfaces: Surfaces | None) -> bool:
    """Tell whether surfaces, if there are any, are near the way of particle ``i`` in any copy."""
    if surfaces is not None:
        return own.terms.particles.free[i] and any_lane(near(begin, end, surfaces))
    return False


@compiled
def begin_contact(i: int, free: Vector, node: Node, own: Bodies, exchange: Exchange | None) -> None:
    """Let contact begin, all else giving the velocity ``free``: surfaces act now, unless bodies collide."""
    if exchange is None:
        given = by_surfaces(i, free, node.span, own, own.terms.surfaces)
        total = given.change + given.rub
        passed = passage(i, own.v, total, free + total, node.span, own)
        go_on(i, passed, given, None, node, own)
    else:
        for rows in (exchange.free, exchange.velocity, exchange.known):
            set_row(rows, i, free)
        set_row(exchange.by_bodies, i, vec(0.0, 0.0, 0.0))


@compiled
def by_surfaces(i: int, free: Vector, span: Span, own: Bodies, surfaces: Surfaces | None) -> Given:
    """Return what surfaces, if there are any, give a particle that all else gives the velocity ``free``."""
    start = row(own.v, i)
    if surfaces is None:
        return nothing_given(start)
    if rolls(own.terms.rounds):
        return of_features(i, start, own.space.rolling)
    place = row(own.x, i)
    way = plus_scaled(place, -1.0 * span.lead, start), plus_scaled(place, span.out, free)
    return impulses(i, way, start, free - start, span, own.space.pushes, own.terms)


@compiled
def passage(i: int, before: Rows, contact: Vector, after: Vector, span: Span, own: Bodies) -> Passage:
    """Return the `Passage` of a particle from its row of velocities ``before`` to ``after``."""
    start, acceleration = row(before, i), row(own.space.a, i)
    others = before_contact(i, before, span, own) - plus_scaled(start, span.lead, acceleration)
    return Passage(load(own.terms.particles.mass, i), start, acceleration, others, contact, after)


@compiled
def go_on(i: int, passed: Passage, given: Given, by_bodies: Vector | None, node: Node, own: Bodies) -> None:
    """Let particle ``i`` go on, and enter what it lost in contact.

    What barriers gave less the work of their impulses is lost to restitution; of bodies, it is entered for
    the pair (`record_losses`), but for what they give in the half node of a fresh copy.
    """
    span, ledger, mass, terms = node.span, own.ledger, passed.mass, own.terms
    record_cross_work(ledger, 0.5 * mass * dot(passed.others, passed.contact), terms.dampers)
    way = plus_scaled(span.lead * passed.start, span.out, passed.after)
    kicked = plus_scaled(passed.start, span.lead, passed.acceleration)
    mean = plus_scaled(kicked, 0.5, passed.others + passed.contact)
    late = 0.5 * (span.out - span.lead) * passed.acceleration
    fresh = span.lead <= 0.0
    # A whole node without loss keeps the energy; what rounding leaves of that is not entered.
    lossy = select(fresh, 1.0, coefficient(terms.loss, 0.0 * node.phase)) > 0.0
    pushes = all_pushes(given.change, by_bodies)
    lost = dot(given.force, way) / span.whole - dot(given.change, mean) + begun_in_touch(pushes, late)
    lost = select(lossy, mass * lost, 0.0) - select(fresh, mass * work_of(by_bodies, mean), 0.0)
    record(ledger, CONTACT, lost)
    record(ledger, FRICTION, -1.0 * mass * dot(given.rub, mean + late))
    set_row(own.v, i, passed.after)
    if node.stage != READS:
        set_row(own.x, i, row(own.x, i) + node.h * passed.after)
        expect(i, span.out * (1.0 / span.whole) * passed.contact, own, terms.dampers)


@compiled
def all_pushes(by_surfaces: Vector, by_bodies: Vector | None) -> Vector:
    """Return the change of velocity by pushes of surfaces, and of bodies if these collide."""
    if by_bodies is None:
        return by_surfaces
    return by_bodies + by_surfaces


@compiled
def work_of(by_bodies: Vector | None, mean: Vector) -> Number:
    """Return the work per mass [m²/s²] of what bodies, if they collide, give at a mean velocity."""
    if by_bodies is None:
        return 0.0 * mean[0]
    return dot(by_bodies, mean)


@compiled
def begun_in_touch(pushed: Vector, late: Vector) -> Number:
    """Return what the half node of a fresh copy does not lose [m²/s²], though pushes before a kick say so.

    There pushes act against the kick by springs and gravity, not amid two: what rests is at rest. ``late``
    is half of what the kick behind the node gives more than the one before it: 0 in a whole node.
    """
    along = dot(late, pushed)
    return 2.0 * along * along / (dot(pushed, pushed) + TINY)


# --- Round features -------------------------------------------------------------------------------------


@compiled
def begin_to_roll(own: Bodies, span: Span, rounds: Rounds | None, exchange: Exchange | None) -> bool:
    """Tell whether contact may act on a body by its round features; surfaces do so unless bodies collide."""
    if rounds is None:
        return False
    if exchange is not None:
        return rolls(rounds)
    if rolls(rounds):
        for i in range(own.x.shape[0]):
            set_row(own.space.rolling.velocity, i, free_velocity(i, span, own))
        return roll(RoundProblem(own.x, own.v, span, own.space.rolling, rounds, own.terms, None), False)
    return False


@compiled
def of_features(i: int, like: Vector, rolling: Rolling) -> Given:
    """Return what surfaces give particle ``i`` by round features."""
    if rolling is None:
        return nothing_given(like)
    return Given(row(rolling.change, i), row(rolling.rub, i), row(rolling.force, i))


# --- Bodies that collide --------------------------------------------------------------------------------


@compiled
def find_touching(bodies: Bodies, node: Node, exchange: Exchange | None) -> Problem | None:
    """Find what bodies give each other at a node follows from; None if they do not collide."""
    if exchange is None:
        return None
    particles, contacts = bodies.terms.particles, exchange.contacts
    places, before, inverse_mass = as_seen(
        bodies.x.values,
        bodies.v.values,
        particles.mass.values,
        particles.inverse_mass.values,
        contacts.spheres,
    )
    found_in = exchange.lists, contacts
    return find_contacts(places, before, before, inverse_mass, node.span, bodies.terms.collisions, found_in)


@compiled
def start_together(collisions: Collisions, memory: Memory, phase: Number, problem: Problem | None) -> None:
    """Tell which bodies of fresh copies touch, and let them store what is in the barriers between them."""
    if problem is not None:
        fresh, none = phase < 0.5, 0.0 * phase
        list_changing(problem.contacts, collisions.changing)
        start_totals(fresh, problem, collisions.changing)
        for body in range(bodies_of(memory.marks)):
            marks = of_body(memory, body).marks
            store(marks, STORED, select(fresh, none, load(marks, STORED)))
        store_energy_of_pairs(collisions, memory, select(fresh, 0.5 + none, 0.0))


@compiled
def note_touched(bodies: Bodies, problem: Problem | None, exchange: Exchange | None) -> None:
    """Find which particles are in contacts of bodies in any copy."""
    if problem is not None:
        rows, contacts = problem.rows, problem.contacts
        list_changing(contacts, bodies.terms.collisions.changing)
        if rows > 0:
            prepare(problem, exchange.in_contact.values)
            share_touched(exchange.in_contact.values, contacts.spheres)
        for n in range(bodies_of(bodies.x)):
            if rows > 0 or exchange.any_busy[n]:
                own = of_body(exchange, n)
                for i in range(own.touched.size):
                    touched = False
                    if rows > 0:
                        touched = any_lane(load(own.in_contact, i) > 0.5)
                        store(own.in_contact, i, 0.0)
                    own.touched[i] = touched


@compiled
def meets_bodies(i: int, exchange: Exchange | None) -> bool:
    """Tell whether another body touches particle ``i`` in any copy."""
    if exchange is None:
        return False
    return exchange.touched[i]


@compiled
def note_busy(n: int, any_busy: bool, exchange: Exchange | None) -> None:
    """Note whether contact may act on body ``n``, if bodies collide."""
    if exchange is not None:
        exchange.any_busy[n] = any_busy


@compiled
def meet_each_other(bodies: Bodies, node: Node, problem: Problem | None, exchange: Exchange | None) -> None:
    """Let bodies that collide, and surfaces with them, give their impulses, and let what is busy go on."""
    if problem is not None:
        find_impulses(bodies, node, problem, exchange)
        for n in range(bodies_of(bodies.x)):
            if exchange.any_busy[n]:
                own = of_body(bodies, n)
                pass_busy(own, node, own.space.exchange)


@compiled
def pass_busy(own: Bodies, node: Node, exchange: Exchange) -> None:
    """Let what is busy of a body that collides go on."""
    for i in range(own.x.shape[0]):
        if own.space.busy[i]:
            by_bodies = row(exchange.by_bodies, i)
            given = Given(row(exchange.change, i), row(exchange.rub, i), row(exchange.force, i))
            total = by_bodies + (given.change + given.rub)
            passed = passage(i, own.v, total, row(exchange.velocity, i), node.span, own)
            go_on(i, passed, given, by_bodies, node, own)


@compiled
def find_impulses(bodies: Bodies, node: Node, problem: Problem, exchange: Exchange) -> None:
    """Find what surfaces and bodies give at a node that is reached with velocities v₋, and enter it."""
    pairs, velocity, terms = problem.pairs, exchange.velocity.values, bodies.terms
    x, spheres = bodies.x.values, problem.contacts.spheres
    first, last = True, pairs.sweeps + 1
    for turn in range(-1, last + 2):  # in one loop, as each call is compiled where it stands
        if 0 <= turn <= last and surfaces_take(last - turn, problem.rows, terms.surfaces, pairs.friction):
            for n in range(bodies_of(bodies.x)):
                if exchange.any_busy[n]:
                    own = of_body(bodies, n)
                    push_by_surfaces(own, problem.span, first, turn == last, own.space.exchange)
            first = False
        put_together(x, velocity, problem.rows, spheres)
        if turn < 0:
            start_warm(velocity, problem, terms.collisions.warm)
        elif turn < pairs.sweeps:
            sweep(velocity, turn % 2 == 1, problem)
        if turn == 1:
            taper(velocity, problem, pairs.shapes.edges)
        if 0 < turn <= last:
            rub(velocity, turn - 1, problem, pairs.friction)
        elif turn > last:
            enter_pairs(velocity, bodies, node, problem, exchange)
        take_apart(x, velocity, problem.rows, spheres)


@compiled
def enter_pairs(v: Rows, bodies: Bodies, node: Node, problem: Problem, exchange: Exchange) -> None:
    """Enter what pairs gave and lost at a node, and find how far to lift bodies that are read there."""
    collisions = bodies.terms.collisions
    add_totals(v, problem, collisions.changing)
    if problem.rows > 0:
        record_losses(bodies.ledger, problem)
    if node.stage == PASSES:
        keep_impulses(problem, collisions.warm)
    if node.stage == READS:
        shift = exchange.shift.values
        for i in range(shift.shape[0]):
            set_row(shift, i, vec(0.0, 0.0, 0.0))
        lift_apart(shift, v, problem)
        share_first(shift, problem.contacts.spheres)


@compiled
def surfaces_take(left: int, count: int, surfaces: Surfaces | None, friction: Numbers) -> bool:
    """Tell whether surfaces take a turn: the last one always, as it sums up, others if something changed.

    ``left`` is the number of turns after this one.
    """
    if surfaces is None:
        return left == 0
    if friction is None and left == 1:
        return False
    return left == 0 or count > 0


@compiled
def push_by_surfaces(own: Bodies, span: Span, first: bool, last: bool, exchange: Exchange) -> None:
    """Let surfaces give a body's particles what follows from all else, and bodies' pushes among it.

    After the ``first`` turn only those of copies whose velocity changed since. Before the ``last`` one, they
    also wait where a surface gave nothing and is not near. A body with round features is pushed by these.
    """
    terms = own.terms
    if rolls(terms.rounds):
        roll_by_surfaces(own, span, first, exchange, terms.rounds)
        return
    for i in range(own.x.shape[0]):
        if not own.space.busy[i]:
            continue
        velocity = row(exchange.velocity, i)
        more = velocity - row(exchange.known, i)
        moved = select(dot(more, more) > 0.0, 1.0, 0.0 * load(terms.memory.marks, PHASE))
        if first or any_lane(moved > 0.5):
            if not (first or last):
                calm = waiting(i, velocity, span, own, terms.surfaces)
                moved = select(calm > 0.5, 0.0, moved)
            turns = moved > (-1.0 if first else 0.5)
            if any_lane(turns):
                before = row(exchange.by_bodies, i)
                by_bodies = before + more
                now = row(exchange.free, i) + by_bodies
                given = by_near_surfaces(i, now, span, own, terms.surfaces)
                now = now + (given.change + given.rub)
                set_row(exchange.by_bodies, i, choose(turns, by_bodies, before))
                set_row(exchange.velocity, i, choose(turns, now, velocity))
                set_row(exchange.known, i, choose(turns, now, row(exchange.known, i)))
                set_row(exchange.change, i, choose(turns, given.change, row(exchange.change, i)))
                set_row(exchange.rub, i, choose(turns, given.rub, row(exchange.rub, i)))
                set_row(exchange.force, i, choose(turns, given.force, row(exchange.force, i)))


@compiled
def roll_by_surfaces(own: Bodies, span: Span, first: bool, exchange: Exchange, rounds: Rounds | None) -> None:
    """Let surfaces push a body at its round features, if a velocity has changed since they did so last."""
    if rounds is not None:
        rolling, changed = own.space.rolling, first
        for i in range(own.x.shape[0]):
            more = row(exchange.velocity, i) - row(exchange.known, i)
            changed = changed or any_lane(dot(more, more) > 0.0)
            set_row(exchange.by_bodies, i, row(exchange.by_bodies, i) + more)
            set_row(rolling.velocity, i, row(exchange.free, i) + row(exchange.by_bodies, i))
        if not changed:
            return
        roll(RoundProblem(own.x, own.v, span, rolling, rounds, own.terms, None), not first)
        for i in range(own.x.shape[0]):
            change, rubbed = row(rolling.change, i), row(rolling.rub, i)
            now = (row(exchange.free, i) + row(exchange.by_bodies, i)) + (change + rubbed)
            set_row(exchange.velocity, i, now)
            set_row(exchange.known, i, now)
            set_row(exchange.change, i, change)
            set_row(exchange.rub, i, rubbed)
            set_row(exchange.force, i, row(rolling.force, i))


@compiled
def waiting(i: int, velocity: Vector, span: Span, own: Bodies, surfaces: Surfaces | None) -> Number:
    """Return 1 where surfaces gave particle ``i`` nothing and are not near, else 0."""
    change = row(own.space.exchange.change, i)
    calm = select(dot(change, change) > 0.0, 0.0, 1.0 + 0.0 * span.out)
    if surfaces is not None:
        begin = plus_scaled(row(own.x, i), -1.0 * span.lead, row(own.v, i))
        end = plus_scaled(row(own.x, i), span.out, velocity)
        calm = select(near(begin, end, surfaces), 0.0, calm)
    return calm


@compiled
def by_near_surfaces(i: int, free: Vector, span: Span, own: Bodies, surfaces: Surfaces | None) -> Given:
    """Return `by_surfaces` of a particle if surfaces are near its way in any copy, else nothing."""
    begin = plus_scaled(row(own.x, i), -1.0 * span.lead, row(own.v, i))
    end = plus_scaled(row(own.x, i), span.out, free)
    given = nothing_given(begin)
    if reached(i, begin, end, own, surfaces):
        given = by_surfaces(i, free, span, own, surfaces)
    return given


@compiled
def record_losses(ledger: Ledger, problem: Problem) -> None:
    """Enter what pairs lost, half for each body; of the half node of a fresh copy, all that it lost."""
    pairs, contacts = problem.pairs, problem.contacts
    for n in range(contacts.length[MET]):
        p = contacts.met[n]
        rubbed = load(contacts.losses, (p, 1))
        lost = load(contacts.losses, (p, 0))
        lost = select(problem.span.lead > 0.0, lost, load(contacts.losses, (p, 2)) - rubbed)
        for side in range(2):
            entries = of_body(ledger, pairs.first[p] if side == 0 else pairs.second[p])
            record(entries, CONTACT, 0.5 * lost)
            record(entries, FRICTION, 0.5 * rubbed)


@compiled
def store_energy_of_pairs(collisions: Collisions | None, memory: Memory, share: Number) -> None:
    """Let each body of a pair store a share, half, of the energy in its barriers, if bodies collide."""
    if collisions is not None:
        pairs = collisions.pairs
        for n in range(1, entry_of(collisions.changing, 0) + 1):
            p = entry_of(collisions.changing, n)
            half = share * load(collisions.totals, p * ENTRIES + ENERGY)
            for side in range(2):
                marks = of_body(memory, pairs.first[p] if side == 0 else pairs.second[p]).marks
                store(marks, STORED, load(marks, STORED) + half)


# --- Reading --------------------------------------------------------------------------------------------


@compiled
def record_kicks(ledger: Ledger, others: Number, thrown: Number, dampers: Dampers | None) -> None:
    """Enter the difference between what half of all kicks of a node do and half of their work.

    ``others`` is that of all kicks but contact, and ``thrown`` that of the actuators' alone [J].
    """
    if dampers is None:
        record(ledger, WORK, -1.0 * others)
    else:
        record(ledger, WORK, -1.0 * thrown)
        record(ledger, DAMPING, others - thrown)


@compiled
def no_kicks(none: Number) -> Kicks:
    """Return sums of nothing."""
    none = 0.0 * none
    return Kicks(none, none, none, none, none)


@compiled
def add_kicks(sums: Kicks, passed: Passage, thrown: Vector, gravity: Numbers) -> Kicks:
    """Add those of a particle; ``thrown`` is the change of its velocity by actuators [m/s]."""
    mass, others, contact = passed.mass, passed.others, passed.contact
    lacking = (0.125 * mass) * dot(contact, plus_scaled(contact, 2.0, others))
    more = dot(passed.acceleration, passed.acceleration)
    if gravity is not None:
        g = vector(gravity)
        more = more - dot(g, g)
    return Kicks(
        sums.others + mass * dot(others, others),
        sums.thrown + mass * dot(thrown, thrown),
        sums.stored + lacking,
        sums.touched + dot(contact, contact),
        sums.springs + mass * more,
    )


@compiled
def read_amid(own: Bodies, span: Span, exchange: Exchange | None) -> None:
    """Read a node that is passed but for the drift after it: lift it, take the mean velocity, enter what half
    of it lacks, and keep what contact holds.

    The velocity is the mean of v₋ and v₊. Of the energy with either, that of the mean lacks m/8 times the
    square of the impulses between them. Springs that push against contact take their share of that back.
    """
    x, v, terms = own.x, own.v, own.terms
    arrived, whole = terms.memory.arrived, rolls(terms.rounds)
    stored, lift_of_all = stored_by_features(span, own, terms.rounds, exchange)
    raised, sums = 0.0 * stored, no_kicks(stored)
    for i in range(v.shape[0]):
        after = row(v, i)
        total = after - plus_scaled(before_contact(i, arrived, span, own), span.out, row(own.space.a, i))
        passed = passage(i, arrived, total, after, span, own)
        set_row(v, i, 0.5 * (passed.start + after))
        if terms.particles.free[i]:
            thrown = span.whole * pushed(own.space.b, i, after, terms.wrench, terms.thrust)
            sums = add_kicks(sums, passed, thrown, terms.gravity)
            lift = lift_of_all
            if not whole:
                shift = shift_of(i, lift, exchange)
                more, lift = stored_by_surfaces(row(x, i), shift, passed, span, own, terms.surfaces)
                stored = stored + more
            raised = maximum(raised, dot(lift, lift))
            set_row(x, i, row(x, i) + lift)
    store_energy(stored, raised, sums, span, own)


@compiled
def shift_of(i: int, like: Vector, exchange: Exchange | None) -> Vector:
    """Return how far particle ``i`` is lifted off other bodies, if these collide [m]."""
    if exchange is None:
        return 0.0 * like
    return row(exchange.shift, i)


@compiled
def stored_by_features(
    span: Span, own: Bodies, rounds: Rounds | None, exchange: Exchange | None
) -> tuple[Number, Vector]:
    """Return what `springgym.contact.round.lifted_feature` does; nothing without features."""
    none = 0.0 * row(own.x, 0)
    if rounds is None:
        return 0.0 * span.out, none
    problem = RoundProblem(own.x, own.v, span, own.space.rolling, rounds, own.terms, None)
    return lifted_feature(shift_of(0, none, exchange), own.v, problem)


@compiled
def stored_by_surfaces(
    place: Vector, shift: Vector, passed: Passage, span: Span, own: Bodies, surfaces: Surfaces | None
) -> tuple[Number, Vector]:
    """Return what surfaces' barriers store around a node beside what they store where it is read [J], and how
    far that is off the node [m]: by a ``shift``, and lifted off surfaces."""
    energy, lift = 0.0 * place[0], shift
    if surfaces is not None:
        begin = plus_scaled(place, -1.0 * span.lead, passed.start)
        finish = plus_scaled(place, span.out, passed.after)
        lift = shift + lifted(place + shift, begin, finish, own.terms)
        energy = 0.5 * (energy_at(begin, surfaces) + energy_at(finish, surfaces))
        energy = energy - energy_at(place + lift, surfaces)
    return energy, lift


@compiled
def store_energy(stored: Number, raised: Number, sums: Kicks, span: Span, own: Bodies) -> None:
    """Store what contact has of a body's energy where a node is read, and enter what half of it lacks.

    ``stored`` is that of barriers. Where the body is shown ``raised`` (above 0), its weight and its springs
    take some of it. Springs that push against contact take their share, the shadow energy of their kicks,
    back.
    """
    memory, terms = own.terms.memory, own.terms
    record_kicks(own.ledger, 0.125 * sums.others, 0.125 * sums.thrown, terms.dampers)
    stored = stored + sums.stored
    if any_lane(raised > 0.0):
        weight, elastic, _ = stored_energy(memory.place, terms)
        both = stored + (weight + elastic)
        weight, elastic, _ = stored_energy(own.x, terms)
        stored = select(raised > 0.0, both - (weight + elastic), stored)
    shadow = 0.125 * span.whole * span.whole * sums.springs
    store(memory.marks, STORED, stored - select(sums.touched > 0.0, shadow, 0.0))
