"""The node of a step where bodies collide: all of them pass it together.

As in `springgym.integrators.node`, all impulses act at once, amid a step, and the state is read there. Here
what bodies give each other acts, too. Which contacts there are is found once a node, from positions and the
velocities before it; what they give follows from all else, as for surfaces. Dampers must see the mean
velocity: they act with half of what contact gave at the last node. Surfaces and pairs are all else to each
other, and take turns: surfaces, the pairs there and back, surfaces again, friction between bodies there and
back, each followed by the surfaces, which have the last word.

An impulse p changes the kinetic energy by p · (v₋ + v₊)/2. Of a pair, half of what it loses and half of the
energy in its barriers is entered for each of its bodies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from springgym.contact.friction import SWEEPS, TURNS, rub
from springgym.contact.lists import Lists
from springgym.contact.round import RoundProblem, lifted_feature, roll_on, rolls
from springgym.contact.rows import MET, ContactRows, Problem
from springgym.contact.search import find_contacts
from springgym.contact.solver import add_totals, lift_apart, prepare, start_totals, sweep, taper
from springgym.contact.spheres import as_seen, put_together, share_first, share_touched, take_apart
from springgym.contact.surfaces import coefficient
from springgym.contact.totals import ENERGY, ENTRIES, Collisions, entry_of, list_changing
from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Numbers, Rows, Vector
from springgym.core.lanes import Ragged, any_lane, bodies_of, load, of_body, select, store
from springgym.core.vectors import choose, dot, plus_scaled, row, set_row, vec
from springgym.forces.ledger import CONTACT, FRICTION, record
from springgym.forces.memory import PHASE, STORED, Memory, halve
from springgym.integrators.node import (
    READS,
    STARTS,
    Given,
    Node,
    Passage,
    Space,
    act_and_damp,
    add_kicks,
    impulses,
    losses,
    mean_velocity,
    near,
    needs_expected,
    no_kicks,
    nothing_given,
    pushed,
    record_cross_work,
    store_energy,
    stored_by_surfaces,
)

if TYPE_CHECKING:
    from springgym.contact.law import Span
    from springgym.contact.round import Rounds
    from springgym.contact.surfaces import Surfaces
    from springgym.forces import Particles, Terms


START = -1
"""As a number of steps: none, but it is told which bodies of fresh copies touch."""

LOOK = -2
"""As a number of steps: none, but the node where the state was read is made anew, to look at its contacts."""


class Bodies(NamedTuple):
    """The arrays in which a thread computes bodies that collide.

    They are `Ragged` rows (N, 3) of all bodies, if nothing else is said.
    """

    space: Space
    """the arrays of a node; its w is only set where anything but contact acts amid the node"""
    in_contact: Numbers
    """(N,) 1 where a copy has the particle in a contact of bodies, else 0"""
    touched: Numbers
    """(N,) whether any copy of the block has the particle in a contact of bodies"""
    busy: Numbers
    """(N,) whether bodies touch the particle or surfaces are near; at first as it was at the last node"""
    free: Rows
    """velocities of busy particles after the node, but for contact [m/s]"""
    velocity: Rows
    """velocities after the node, with as much of contact as is known [m/s]"""
    known: Rows
    """these velocities when surfaces had their last turn [m/s]"""
    by_bodies: Rows
    """change of velocity that bodies gave each other until that turn [m/s]"""
    change: Rows
    """change of velocity by surfaces, by their pushes; see `springgym.integrators.node.Given` [m/s]"""
    rub: Rows
    """change of velocity by surfaces, by friction [m/s]"""
    force: Rows
    """Σ J n of surfaces [m/s]"""
    shift: Rows
    """how far a particle is lifted off other bodies where a node is read [m]"""
    any_busy: np.ndarray
    """(bodies,) whether any particle of a body is busy"""
    lists: Lists
    """the features that are near each other"""
    contacts: ContactRows
    """the contacts of the node"""


# --- Contact ------------------------------------------------------------------------------------------


@compiled
def push_by_surfaces(
    x: Rows, v: Rows, span: Span, first: bool, last: bool, own: Bodies, terms: Terms
) -> None:
    """Let surfaces give a body's particles what follows from all else, and bodies' pushes among it.

    After the ``first`` turn only those of copies whose velocity changed since. Before the ``last`` one, they
    also wait where a surface gave nothing and is not near. A body with round features is pushed by these.
    """
    if rolls(terms.rounds):
        roll_by_surfaces(x, v, span, own, terms, terms.rounds)
        return
    for i in range(x.shape[0]):
        if not own.busy[i]:
            continue
        velocity = row(own.velocity, i)
        more = velocity - row(own.known, i)
        moved = select(dot(more, more) > 0.0, 1.0, 0.0 * load(terms.memory.marks, PHASE))
        if first or any_lane(moved > 0.5):
            place, start = row(x, i), row(v, i)
            if not (first or last):
                calm = waiting(i, place, start, velocity, span, own, terms.surfaces)
                moved = select(calm > 0.5, 0.0, moved)
            turns = moved > (-1.0 if first else 0.5)
            if any_lane(turns):
                before = row(own.by_bodies, i)
                by_bodies = before + more
                now = row(own.free, i) + by_bodies
                given = by_surfaces(i, place, start, now, span, own.space, terms, terms.surfaces)
                now = now + (given.change + given.rub)
                set_row(own.by_bodies, i, choose(turns, by_bodies, before))
                set_row(own.velocity, i, choose(turns, now, velocity))
                set_row(own.known, i, choose(turns, now, row(own.known, i)))
                set_row(own.change, i, choose(turns, given.change, row(own.change, i)))
                set_row(own.rub, i, choose(turns, given.rub, row(own.rub, i)))
                set_row(own.force, i, choose(turns, given.force, row(own.force, i)))


@compiled
def roll_by_surfaces(x: Rows, v: Rows, span: Span, own: Bodies, terms: Terms, rounds: Rounds | None) -> None:
    """Let surfaces give a body with round features what follows from all else."""
    if rounds is not None:
        rolling = own.space.rolling
        for i in range(x.shape[0]):
            more = row(own.velocity, i) - row(own.known, i)
            set_row(own.by_bodies, i, row(own.by_bodies, i) + more)
            set_row(rolling.velocity, i, row(own.free, i) + row(own.by_bodies, i))
        roll_on(v, RoundProblem(x, span, rolling, rounds, terms))
        for i in range(x.shape[0]):
            change, rubbed = row(rolling.change, i), row(rolling.rub, i)
            now = (row(own.free, i) + row(own.by_bodies, i)) + (change + rubbed)
            set_row(own.velocity, i, now)
            set_row(own.known, i, now)
            set_row(own.change, i, change)
            set_row(own.rub, i, rubbed)
            set_row(own.force, i, row(rolling.force, i))


@compiled
def waiting(
    i: int, place: Vector, start: Vector, velocity: Vector, span: Span, own: Bodies, surfaces: Surfaces | None
) -> Number:
    """Return 1 where surfaces gave particle ``i`` nothing and are not near, else 0."""
    change = row(own.change, i)
    calm = select(dot(change, change) > 0.0, 0.0, 1.0 + 0.0 * span.out)
    if surfaces is not None:
        begin = plus_scaled(place, -1.0 * span.lead, start)
        end = plus_scaled(place, span.out, velocity)
        calm = select(near(begin, end, surfaces), 0.0, calm)
    return calm


@compiled
def by_surfaces(
    i: int,
    place: Vector,
    start: Vector,
    after: Vector,
    span: Span,
    space: Space,
    terms: Terms,
    surfaces: Surfaces | None,
) -> Given:
    """Return what surfaces, if there are any, give particle ``i``, whose velocity all else changes from
    ``start`` to ``after``."""
    given = nothing_given(start)
    if surfaces is not None:
        begin = plus_scaled(place, -1.0 * span.lead, start)
        end = plus_scaled(place, span.out, after)
        if reached(i, begin, end, terms.particles, surfaces):
            given = impulses(i, (begin, end), start, after - start, span, space.pushes, terms)
    return given


@compiled
def reached(i: int, begin: Vector, end: Vector, particles: Particles, surfaces: Surfaces | None) -> bool:
    """Tell whether surfaces, if there are any, are near the way of particle ``i`` in any copy."""
    if surfaces is not None:
        return particles.free[i] and any_lane(near(begin, end, surfaces))
    return False


@compiled
def surfaces_take(turn: int, count: int, surfaces: Surfaces | None, friction: Numbers) -> bool:
    """Tell whether surfaces take a turn: the last one always, as it sums up, others if something changed."""
    last = turn == TURNS
    if surfaces is None:
        return last
    if friction is None and turn == SWEEPS:
        return False
    return last or count > 0


@compiled
def find_impulses(x: Ragged, v: Ragged, problem: Problem, work: Bodies, terms: Terms) -> None:
    """Find what surfaces and bodies give at a node that is reached with velocities ``v``."""
    pairs, velocity = problem.pairs, work.velocity.values
    spheres, mass = work.contacts.spheres, terms.particles.mass.values
    first = True
    for turn in range(TURNS + 1):  # in one loop, as each call is compiled where it stands
        if surfaces_take(turn, problem.rows, terms.surfaces, pairs.friction):
            for body in range(bodies_of(x)):
                if not work.any_busy[body]:
                    continue
                own, here, start = of_body(work, body), of_body(x, body), of_body(v, body)
                push_by_surfaces(here, start, problem.span, first, turn == TURNS, own, of_body(terms, body))
            first = False
        put_together(x.values, velocity, mass, problem.rows, spheres)
        if turn < 2:
            sweep(velocity, turn == 1, problem)
        if turn == 1:
            taper(velocity, problem, pairs.shapes.edges)
        if turn > 0:
            rub(velocity, turn - 1, problem, pairs.friction)
        take_apart(x.values, velocity, problem.rows, spheres)


# --- The node -----------------------------------------------------------------------------------------


@compiled
def note_touched(contacts: int, own: Bodies) -> None:
    """Find which of a body's particles are in contacts in any copy."""
    for i in range(own.busy.size):
        touched = False
        if contacts > 0:
            touched = any_lane(load(own.in_contact, i) > 0.5)
            store(own.in_contact, i, 0.0)
        own.touched[i] = touched


@compiled
def acts_amid(terms: Terms) -> bool:
    """Tell whether anything but contact acts between the two kicks of a node."""
    driven = terms.wrench is not None or terms.thrust is not None or terms.drive is not None
    return driven or terms.dampers is not None


@compiled
def before_contact(i: int, v: Rows, span: Span, own: Bodies, terms: Terms) -> Vector:
    """Return the velocity of a particle amid a node, before contact is given [m/s]."""
    if acts_amid(terms):
        return row(own.space.w, i)
    return plus_scaled(row(v, i), span.lead, row(own.space.a, i))


@compiled
def free_velocity(i: int, v: Rows, span: Span, own: Bodies, terms: Terms) -> Vector:
    """Return the velocity of a particle after a node, but for contact [m/s]."""
    now = before_contact(i, v, span, own, terms)
    if needs_expected(terms.dampers):
        now = now - row(own.space.given, i)
    return plus_scaled(now, span.out, row(own.space.a, i))


@compiled
def begin_contact(i: int, free: Vector, own: Bodies) -> None:
    """Let contact begin with this velocity of a particle, and with nothing given."""
    for rows in (own.free, own.velocity, own.known):
        set_row(rows, i, free)
    set_row(own.by_bodies, i, vec(0.0, 0.0, 0.0))


@compiled
def give_expected(own: Bodies) -> None:
    """Give half of what contact is expected to give, as much as at the last node, before dampers act."""
    for i in range(own.busy.size):
        if own.busy[i]:
            set_row(own.space.w, i, row(own.space.w, i) + row(own.space.given, i))


@compiled
def was_given(i: int, own: Bodies, terms: Terms) -> bool:
    """Tell whether something was expected of particle ``i`` in any copy, which is to be entered."""
    if needs_expected(terms.dampers):
        half = row(own.space.given, i)
        return any_lane(dot(half, half) > 0.0)
    return False


@compiled
def pass_free(x: Rows, v: Rows, node: Node, own: Bodies, terms: Terms) -> bool:
    """Let a body's particles that nothing is near go on to the next node; tell whether any are left, busy.

    The way of what was not busy begins where that of the last node ended, out of reach. Where a node is
    read, all are busy. A sum with zero is never −0, as where contacts of other copies add theirs.
    """
    any_busy, span, last = False, node.span, node.stage == READS
    whole = rolls(terms.rounds)
    for i in range(x.shape[0]):
        place, was = row(x, i), own.busy[i]
        after = free_velocity(i, v, span, own, terms)
        end = plus_scaled(place, span.out, after)
        begin = end
        if was:
            begin = plus_scaled(place, -1.0 * span.lead, row(v, i))
        busy = last or whole or own.touched[i] or (was and was_given(i, own, terms))
        busy = busy or reached(i, begin, end, terms.particles, terms.surfaces)
        own.busy[i] = busy
        if busy:
            any_busy = True
            begin_contact(i, after, own)
        else:
            after = after + vec(0.0, 0.0, 0.0)
            set_row(v, i, after)
            set_row(x, i, place + node.h * after)
    return any_busy


@compiled
def stored_by_features(
    x: Rows, span: Span, own: Bodies, terms: Terms, rounds: Rounds | None
) -> tuple[Number, Vector]:
    """Return what `springgym.contact.round.lifted_feature` does; nothing without features."""
    if rounds is None:
        return 0.0 * span.out, 0.0 * row(x, 0)
    problem = RoundProblem(x, span, own.space.rolling, rounds, terms)
    return lifted_feature(row(own.shift, 0), own.velocity, problem)


@compiled
def pass_busy(x: Rows, v: Rows, node: Node, ledger: Ledger, own: Bodies, terms: Terms) -> None:
    """Let what is busy of a body go on, and enter what it lost; or read it, where the node is for that."""
    particles, memory, span, last = terms.particles, terms.memory, node.span, node.stage == READS
    none = 0.0 * load(memory.marks, PHASE)
    share = span.out * (1.0 / span.whole)
    fresh = span.lead <= 0.0
    lossy = select(fresh, 1.0, coefficient(terms.loss, none)) > 0.0
    work, lost, rubbed, stored = none, none, none, none
    sums, raised, whole = no_kicks(none), False, rolls(terms.rounds)
    raising = none * row(x, 0)
    if last and whole:
        stored, raising = stored_by_features(x, span, own, terms, terms.rounds)
    for i in range(v.shape[0]):
        if not own.busy[i]:
            continue
        place, start, acceleration = row(x, i), row(v, i), row(own.space.a, i)
        half, by_bodies = row(own.space.given, i), row(own.by_bodies, i)
        given = Given(row(own.change, i), row(own.rub, i), row(own.force, i))
        total = by_bodies + (given.change + given.rub)
        others = before_contact(i, v, span, own, terms) - half
        others = others - plus_scaled(start, span.lead, acceleration)
        after = row(own.velocity, i)
        if particles.free[i]:
            passed = Passage(load(particles.mass, i), start, acceleration, others, total, after)
            if any_lane(dot(half, half) + dot(total, total) + dot(given.force, given.force) > 0.0):
                work = work + passed.mass * dot(others, 0.5 * total - half)
                of_surfaces, of_friction = losses(passed, given, by_bodies + given.change, span)
                lost = lost + select(lossy, of_surfaces, 0.0)
                by_pairs = passed.mass * dot(by_bodies, mean_velocity(passed, span))
                lost = lost - select(fresh, by_pairs, 0.0)
                rubbed = rubbed + of_friction
            if last:
                thrown = span.whole * pushed(own.space.b, i, start, terms.wrench, terms.thrust)
                sums = add_kicks(sums, passed, thrown, terms.gravity)
                lift = raising
                if not whole:
                    shift = row(own.shift, i)
                    more, lift = stored_by_surfaces(place, shift, passed, span, terms, terms.surfaces)
                    stored = stored + more
                if any_lane(dot(lift, lift) > 0.0):
                    raised = True
                place = place + lift
        if last:
            set_row(x, i, place)
            set_row(memory.arrived, i, start)
            set_row(v, i, 0.5 * (start + after))
        else:
            set_row(x, i, place + node.h * after)
            set_row(v, i, after)
            if needs_expected(terms.dampers):
                set_row(own.space.given, i, share * total)
    record_cross_work(ledger, work, terms.dampers)
    record(ledger, CONTACT, lost)
    record(ledger, FRICTION, rubbed)
    if last:
        halve(ledger, memory)
        store_energy(x, stored, raised, sums, span, ledger, terms)


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
def store_energy_of_pairs(collisions: Collisions, memory: Memory, share: Number) -> None:
    """Let each body of a pair store a share, half, of the energy in its barriers."""
    pairs = collisions.pairs
    for n in range(1, entry_of(collisions.changing, 0) + 1):
        p = entry_of(collisions.changing, n)
        half = share * load(collisions.totals, p * ENTRIES + ENERGY)
        for side in range(2):
            marks = of_body(memory, pairs.first[p] if side == 0 else pairs.second[p]).marks
            store(marks, STORED, load(marks, STORED) + half)


@compiled
def start_together(phase: Number, problem: Problem, collisions: Collisions, memory: Memory) -> None:
    """Tell which bodies of fresh copies touch, and let them store what is in the barriers between them."""
    fresh, none = phase < 0.5, 0.0 * phase
    list_changing(problem.contacts, collisions.changing)
    start_totals(fresh, problem, collisions.changing)
    for body in range(bodies_of(memory.marks)):
        marks = of_body(memory, body).marks
        store(marks, STORED, select(fresh, none, load(marks, STORED)))
    store_energy_of_pairs(collisions, memory, select(fresh, 0.5 + none, 0.0))


@compiled
def pass_together(x: Ragged, v: Ragged, node: Node, ledger: Ledger, work: Bodies, terms: Terms) -> None:
    """Let all act on all bodies at a node: `springgym.integrators.node.pass_node` where they collide."""
    collisions, contacts, last = terms.collisions, work.contacts, node.stage == READS
    particles, spheres = terms.particles, contacts.spheres
    places, before, inverse_mass = as_seen(
        x.values, v.values, particles.mass.values, particles.inverse_mass.values, spheres
    )
    found_in = work.lists, contacts
    problem = find_contacts(places, before, before, inverse_mass, node.span, collisions, found_in)
    rows = problem.rows
    if node.stage == STARTS:
        start_together(node.phase, problem, collisions, terms.memory)
        return
    list_changing(contacts, collisions.changing)
    if rows > 0:
        prepare(problem, work.in_contact.values)
        share_touched(work.in_contact.values, spheres)
    count = bodies_of(x)
    for body in range(count):
        if rows > 0 or work.any_busy[body]:
            note_touched(rows, of_body(work, body))
    for body in range(count):
        own, of = of_body(work, body), of_body(terms, body)
        if needs_expected(terms.dampers) and work.any_busy[body]:
            give_expected(own)
        act_and_damp(own.space.w, node, own.space, of_body(ledger, body), of)
        work.any_busy[body] = pass_free(of_body(x, body), of_body(v, body), node, own, of)
    find_impulses(x, v, problem, work, terms)
    put_together(x.values, work.velocity.values, particles.mass.values, rows, spheres)
    add_totals(work.velocity.values, problem, collisions.changing)
    if rows > 0:
        record_losses(ledger, problem)
    if last:
        shift = work.shift.values
        for i in range(shift.shape[0]):
            set_row(shift, i, vec(0.0, 0.0, 0.0))
        lift_apart(shift, work.velocity.values, problem)
        share_first(shift, spheres)
    take_apart(x.values, work.velocity.values, rows, spheres)
    for body in range(count):
        if work.any_busy[body]:
            own, entries, of = of_body(work, body), of_body(ledger, body), of_body(terms, body)
            pass_busy(of_body(x, body), of_body(v, body), node, entries, own, of)
    if last:
        store_energy_of_pairs(collisions, terms.memory, 0.5)
