"""The node of a step where bodies collide: all of them pass it together.

As in `springgym.integrators.node`, all impulses act at once, amid a step, and the state is read there. Here what
bodies give each other acts, too. Which contacts there are is found once a node, from positions and the
velocities before it; what they give follows from all else, as for surfaces. Dampers must see the mean
velocity: they act with half of what contact gave at the last node. Surfaces and pairs are all else to each
other, and take turns: surfaces, the pairs there and back, surfaces again, friction between bodies there and
back, each followed by the surfaces, which have the last word.

An impulse p changes the kinetic energy by p · (v₋ + v₊)/2. Of a pair, half of what it loses and half of the
energy in its barriers is entered for each of its bodies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Numbers, Rows, Vector
from springgym.core.lanes import Ragged, any_lane, bodies_of, load, of_body, select, store
from springgym.core.vectors import choose, dot, plus_scaled, row, set_row, vec
from springgym.forces import Particles, stored_energy
from springgym.contact.surfaces import coefficient, energy_at
from springgym.forces.ledger import CONTACT, FRICTION, record
from springgym.forces.memory import HELD, PHASE, halve
from springgym.integrators.node import (
    Given,
    Space,
    act_and_damp,
    begun_in_touch,
    foreseen,
    impulses,
    lifted,
    near,
    nothing_given,
    pushed,
    record_stray,
    record_swing,
    span_of,
    swing_of,
)
from springgym.contact import pairs as told
from springgym.contact.friction import SWEEPS, TURNS, rub
from springgym.contact.solver import account, account_start, lift_apart, prepare, sweep, taper
from springgym.contact.search import find
from springgym.contact.pairs import (
    ENERGY,
    ENTRIES,
    IMPULSE,
    MET,
    TOUCHING,
    Room,
    entry_of,
    note,
    set_entry,
)

if TYPE_CHECKING:
    from springgym.forces import Terms
    from springgym.contact.surfaces import Surfaces


START = -1
"""As a number of steps: none, but it is told which bodies of fresh copies touch."""

LOOK = -2
"""As a number of steps: none, but the node where the state was read is made anew, to look at its contacts."""


class Bodies(NamedTuple):
    """What a thread computes in, (N, 3) of all bodies if nothing else is said."""

    a: Ragged
    """accelerations by springs and gravity [m/s²]"""
    b: Ragged
    """and by actuators"""
    space: Space
    w: Ragged
    """velocities amid the node, before contact, if anything else acts there [m/s]"""
    met: Ragged
    """(N,) 1 where a copy has the particle in a contact of bodies, else 0"""
    touched: Ragged
    """(N,) whether any copy of the block has"""
    busy: Ragged
    """(N,) whether bodies touch the particle or surfaces are near; at first as it was at the last node"""
    soon: Ragged
    """of what is busy: velocities after the node, but for contact [m/s]"""
    velocity: Ragged
    """and with as much of it as is known"""
    base: Ragged
    """these before bodies gave each other more"""
    pairs: Ragged
    """what bodies gave each other [m/s]"""
    change: Ragged
    """what surfaces give: see `springgym.integrators.node.Given`"""
    rub: Ragged
    force: Ragged
    shift: Ragged
    """how far off others a particle is shown where a node is read [m]"""
    stirred: np.ndarray
    """(bodies,) whether anything of a body is busy"""
    room: Room


# --- Contact ------------------------------------------------------------------------------------------


@compiled
def lean(x: Rows, v: Rows, span: Any, fresh: Any, last: Any, own: Any, terms: Terms) -> None:
    """Let surfaces give a body's particles what follows from all else, and bodies' pushes among it.

    After the ``fresh`` turn only those of copies whose velocity changed since. Before the ``last`` one, they
    also wait where a surface gave nothing and is not near.
    """
    for i in range(x.shape[0]):
        if not own.busy[i]:
            continue
        velocity = row(own.velocity, i)
        more = velocity - row(own.base, i)
        moved = select(dot(more, more) > 0.0, 1.0, 0.0 * load(terms.memory.marks, PHASE))
        if fresh or any_lane(moved > 0.5):
            place, start = row(x, i), row(v, i)
            if not (fresh or last):
                calm = waiting(i, place, start, velocity, span, own, terms.surfaces)
                moved = select(calm > 0.5, 0.0, moved)
            turns = moved > (-1.0 if fresh else 0.5)
            if any_lane(turns):
                before = row(own.pairs, i)
                by_bodies = before + more
                now = row(own.soon, i) + by_bodies
                given = lean_on(i, place, start, now, span, own.space.pushes, terms, terms.surfaces)
                now = now + (given.change + given.rub)
                set_row(own.pairs, i, choose(turns, by_bodies, before))
                set_row(own.velocity, i, choose(turns, now, velocity))
                set_row(own.base, i, choose(turns, now, row(own.base, i)))
                set_row(own.change, i, choose(turns, given.change, row(own.change, i)))
                set_row(own.rub, i, choose(turns, given.rub, row(own.rub, i)))
                set_row(own.force, i, choose(turns, given.force, row(own.force, i)))


@compiled
def waiting(
    i: int,
    place: Vector,
    start: Vector,
    velocity: Vector,
    span: Any,
    own: Any,
    surfaces: Surfaces | None,
) -> Any:
    """1 where surfaces gave particle ``i`` nothing and are not near, else 0."""
    change = row(own.change, i)
    calm = select(dot(change, change) > 0.0, 0.0, 1.0 + 0.0 * span.out)
    if surfaces is not None:
        begin = plus_scaled(place, -1.0 * span.lead, start)
        end = plus_scaled(place, span.out, velocity)
        calm = select(near(begin, end, surfaces), 0.0, calm)
    return calm


@compiled
def lean_on(
    i: int,
    place: Vector,
    start: Vector,
    soon: Vector,
    span: Any,
    pushes: Numbers,
    terms: Terms,
    surfaces: Surfaces | None,
) -> Given:
    """What surfaces, if there are any, give particle ``i``; all else changes its velocity from ``start``
    to ``soon``."""
    given = nothing_given(start)
    if surfaces is not None:
        begin = plus_scaled(place, -1.0 * span.lead, start)
        end = plus_scaled(place, span.out, soon)
        if reached(i, begin, end, terms.particles, surfaces):
            given = impulses(i, begin, end, start, soon - start, span, pushes, terms)
    return given


@compiled
def reached(
    i: int,
    begin: Vector,
    end: Vector,
    particles: Particles,
    surfaces: Surfaces | None,
) -> bool:
    """Whether surfaces, if there are any, are near the way of particle ``i`` in any copy."""
    if surfaces is not None:
        return particles.free[i] and any_lane(near(begin, end, surfaces))
    return False


@compiled
def leans(turn: int, count: Number, surfaces: Surfaces | None, friction: Numbers) -> bool:
    """Whether surfaces have a turn: the last one always, as it sums up, others if something changed."""
    last = turn == TURNS
    if surfaces is None:
        return last
    if friction is None and turn == SWEEPS:
        return False
    return last or count > 0


@compiled
def touch(x: Any, w: Any, span: Any, count: Number, particles: Particles, work: Any, terms: Terms) -> None:
    """Find what surfaces and bodies give at a node that is reached with velocities ``w``."""
    meets, room = terms.meets, work.room
    pairs = meets.pairs
    v = work.velocity.values
    fresh = True
    for turn in range(TURNS + 1):  # in one loop, as each call is compiled where it stands
        if leans(turn, count, terms.surfaces, pairs.friction):
            for body in range(bodies_of(x)):
                if not work.stirred[body]:
                    continue
                own = of_body(work, body)
                here, start, other = of_body(x, body), of_body(w, body), of_body(terms, body)
                lean(here, start, span, fresh, turn == TURNS, own, other)
            fresh = False
        if turn < 2:
            sweep(v, span, count, turn == 1, pairs, room)
        if turn == 1:
            taper(x.values, v, span, count, particles, pairs, room, pairs.shapes.edges)
        if turn > 0:
            rub(w.values, v, turn - 1, count, particles, pairs, pairs.friction, room, meets.tally)


# --- The node -----------------------------------------------------------------------------------------


@compiled
def arrive(contacts: Number, own: Any) -> None:
    """Find which of a body's particles are in contacts."""
    for i in range(own.busy.size):
        touched = False
        if contacts > 0:
            touched = any_lane(load(own.met, i) > 0.5)
            store(own.met, i, 0.0)
        own.touched[i] = touched


@compiled
def acts_amid(terms: Terms) -> bool:
    """Whether anything but contact acts between the two kicks of a node."""
    driven = terms.wrench is not None or terms.thrust is not None or terms.drive is not None
    return driven or terms.dampers is not None


@compiled
def before_contact(i: int, v: Rows, span: Any, own: Any, terms: Terms) -> Any:
    """The velocity of a particle amid a node, before contact is given."""
    if acts_amid(terms):
        return row(own.w, i)
    return plus_scaled(row(v, i), span.lead, row(own.a, i))


@compiled
def expected(i: int, v: Rows, span: Any, own: Any, terms: Terms) -> Any:
    """The velocity of a particle after a node, but for contact."""
    now = before_contact(i, v, span, own, terms)
    if foreseen(terms.dampers):
        now = now - row(own.space.given, i)
    return plus_scaled(now, span.out, row(own.a, i))


@compiled
def expect(i: int, soon: Vector, own: Any) -> None:
    """Let contact begin with this velocity of a particle, and with nothing given."""
    for rows in (own.soon, own.velocity, own.base):
        set_row(rows, i, soon)
    set_row(own.pairs, i, vec(0.0, 0.0, 0.0))


@compiled
def give_half(own: Any) -> None:
    """Give half of what contact is going to give before dampers act: as far as it gave that at the last
    node."""
    for i in range(own.busy.size):
        if own.busy[i]:
            set_row(own.w, i, row(own.w, i) + row(own.space.given, i))


@compiled
def given_before(i: int, own: Any, terms: Terms) -> bool:
    """Whether half of something was given to particle ``i`` of any copy, which is to be entered."""
    if foreseen(terms.dampers):
        half = row(own.space.given, i)
        return any_lane(dot(half, half) > 0.0)
    return False


@compiled
def go_on(x: Rows, v: Rows, span: Any, h: Number, last: Any, own: Any, terms: Terms) -> bool:
    """Let a body's particles that nothing is near go on to the next node; whether any are left, busy.

    The way of what was not busy begins where that of the last node ended, out of reach. At the ``last`` node,
    all are busy. A sum with zero is never −0, as where contacts of other copies add theirs.
    """
    stirred = False
    for i in range(x.shape[0]):
        place, was = row(x, i), own.busy[i]
        soon = expected(i, v, span, own, terms)
        end = plus_scaled(place, span.out, soon)
        begin = end
        if was:
            begin = plus_scaled(place, -1.0 * span.lead, row(v, i))
        busy = last or own.touched[i] or (was and given_before(i, own, terms))
        busy = busy or reached(i, begin, end, terms.particles, terms.surfaces)
        own.busy[i] = busy
        if busy:
            stirred = True
            expect(i, soon, own)
        else:
            soon = soon + vec(0.0, 0.0, 0.0)
            set_row(v, i, soon)
            set_row(x, i, place + h * soon)
    return stirred


@compiled
def leave(
    x: Rows,
    v: Rows,
    span: Any,
    h: Number,
    last: Any,
    ledger: Ledger,
    own: Any,
    terms: Terms,
) -> None:
    """Let what is busy of a body go on, and enter what it lost; or, at the ``last`` node, read it."""
    particles, memory = terms.particles, terms.memory
    none = 0.0 * load(memory.marks, PHASE)
    share = span.out * (1.0 / span.whole)
    fresh = span.lead <= 0.0
    lossy = select(fresh, 1.0, coefficient(terms.loss, none)) > 0.0
    stray, lost, rubbed, held = none, none, none, none
    swung, thrown, touched, swing = none, none, none, none
    raised = False
    for i in range(v.shape[0]):
        if not own.busy[i]:
            continue
        place, start, acceleration = row(x, i), row(v, i), row(own.a, i)
        half, by_bodies = row(own.space.given, i), row(own.pairs, i)
        change, slowed, force = row(own.change, i), row(own.rub, i), row(own.force, i)
        total = by_bodies + (change + slowed)
        kicked = plus_scaled(start, span.lead, acceleration) + half
        others = before_contact(i, v, span, own, terms) - kicked
        after, mass = row(own.velocity, i), load(particles.mass, i)
        if particles.free[i]:
            if any_lane(dot(half, half) + dot(total, total) + dot(force, force) > 0.0):
                stray = stray + mass * dot(others, 0.5 * total - half)
                mean = plus_scaled(start, span.lead, acceleration)
                mean = plus_scaled(mean, 0.5, others + total)
                way = plus_scaled(span.lead * start, span.out, after)
                gone = mass * (dot(force, way) / span.whole - dot(change, mean))
                late = 0.5 * (span.out - span.lead) * acceleration
                gone = gone + mass * begun_in_touch(by_bodies + change, late)
                lost = lost + select(lossy, gone, 0.0)
                lost = lost - select(fresh, mass * dot(by_bodies, mean), 0.0)
                rubbed = rubbed - mass * dot(slowed, mean + late)
            if last:
                given = span.whole * pushed(own.b, i, start, terms.wrench, terms.thrust)
                thrown = thrown + mass * dot(given, given)
                swung = swung + mass * dot(others, others)
                held = held + (0.125 * mass) * dot(total, plus_scaled(total, 2.0, others))
                touched = touched + dot(total, total)
                swing = swing + mass * swing_of(acceleration, terms.gravity)
                more, lift = held_at(place, row(own.shift, i), start, after, span, terms, terms.surfaces)
                held = held + more
                if any_lane(dot(lift, lift) > 0.0):
                    raised = True
                place = place + lift
        if last:
            set_row(x, i, place)
            set_row(memory.arrived, i, start)
            set_row(v, i, 0.5 * (start + after))
        else:
            set_row(x, i, place + h * after)
            set_row(v, i, after)
            if foreseen(terms.dampers):
                set_row(own.space.given, i, share * total)
    record_stray(ledger, stray, terms.dampers)
    record(ledger, CONTACT, lost)
    record(ledger, FRICTION, rubbed)
    if last:
        halve(ledger, memory)
        record_swing(ledger, 0.125 * swung, 0.125 * thrown, terms.dampers)
        if raised:
            weight, elastic, _ = stored_energy(memory.place, terms)
            held = held + (weight + elastic)
            weight, elastic, _ = stored_energy(x, terms)
            held = held - (weight + elastic)
        held = held - select(touched > 0.0, 0.125 * span.whole * span.whole * swing, 0.0)
        store(memory.marks, HELD, held)


@compiled
def held_at(
    place: Vector,
    shift: Vector,
    start: Vector,
    after: Vector,
    span: Any,
    terms: Terms,
    surfaces: Surfaces | None,
) -> Any:
    """What surfaces' barriers hold around a node beside what they hold where it is read, and its lift.

    That is what it is lifted off surfaces by, beside the ``shift`` [m] off other bodies.
    """
    energy, lift = 0.0 * place[0], shift
    if surfaces is not None:
        begin = plus_scaled(place, -1.0 * span.lead, start)
        finish = plus_scaled(place, span.out, after)
        lift = shift + lifted(place + shift, begin, finish, terms)
        energy = 0.5 * (energy_at(begin, surfaces) + energy_at(finish, surfaces))
        energy = energy - energy_at(place + lift, surfaces)
    return energy, lift


@compiled
def shift_shown(span: Any, contacts: Number, pairs: Any, work: Any) -> None:
    """Find how far off others particles are shown at a node."""
    shift = work.shift.values
    for i in range(shift.shape[0]):
        set_row(shift, i, vec(0.0, 0.0, 0.0))
    lift_apart(shift, work.velocity.values, span, contacts, pairs, work.room)


@compiled
def enter(span: Any, ledger: Ledger, pairs: Any, room: Any) -> None:
    """Enter what pairs lost, half for each body; of the half node of a fresh copy, all that it lost."""
    for n in range(room.length[MET]):
        p = room.met[n]
        rubbed = load(room.spent, (p, 1))
        lost = select(span.lead > 0.0, load(room.spent, (p, 0)), load(room.spent, (p, 2)) - rubbed)
        for side in range(2):
            entries = of_body(ledger, pairs.first[p] if side == 0 else pairs.second[p])
            record(entries, CONTACT, 0.5 * lost)
            record(entries, FRICTION, 0.5 * rubbed)


@compiled
def hold(meets: Any, memory: Any, share: Number) -> None:
    """Let each body of a pair hold a share, half, of the energy in its barriers."""
    pairs = meets.pairs
    for n in range(1, entry_of(meets.told, 0) + 1):
        p = entry_of(meets.told, n)
        half = share * load(meets.tally, p * ENTRIES + ENERGY)
        for side in range(2):
            marks = of_body(memory, pairs.first[p] if side == 0 else pairs.second[p]).marks
            store(marks, HELD, load(marks, HELD) + half)


@compiled
def begin(phase: Number, contacts: Number, meets: Any, room: Any, memory: Any) -> None:
    """Tell of fresh copies which of their bodies touch, and let them hold what is in the barriers between."""
    fresh, none = phase < 0.5, 0.0 * phase
    note(room, meets.told)
    account_start(fresh, contacts, meets.pairs, room, meets.tally, meets.told)
    for body in range(bodies_of(memory.marks)):
        marks = of_body(memory, body).marks
        store(marks, HELD, select(fresh, none, load(marks, HELD)))
    hold(meets, memory, select(fresh, 0.5 + none, 0.0))


@compiled
def pass_together(
    x: Any, v: Any, phase: Number, h: Number, last: Any, goes: Any, ledger: Ledger, work: Any, terms: Any
) -> None:
    """Let all act on all bodies at a node: `springgym.integrators.node.pass_node` where they collide.

    If nothing ``goes`` on, only tell which bodies touch in fresh copies.
    """
    span, meets, room = span_of(phase, h), terms.meets, work.room
    every = terms.particles
    particles = Particles(every.mass.values, every.inverse_mass.values, every.free.values)
    count, foresees = bodies_of(x), foreseen(terms.dampers)
    contacts = find(x.values, v.values, span, meets.pairs, room)
    if not goes:
        begin(phase, contacts, meets, room, terms.memory)
        return
    note(room, meets.told)
    if contacts > 0:
        here, met = x.values, work.met.values
        prepare(here, v.values, span, contacts, particles, meets.pairs, room, meets.tally, met)
    for body in range(count):
        if contacts > 0 or work.stirred[body]:
            arrive(contacts, of_body(work, body))
    for body in range(count):
        own, terms_of = of_body(work, body), of_body(terms, body)
        if foresees and work.stirred[body]:
            give_half(own)
        direction, entries = own.space.direction, of_body(ledger, body)
        act_and_damp(own.w, own.b, phase, span, direction, entries, terms_of)
        here, velocities = of_body(x, body), of_body(v, body)
        work.stirred[body] = go_on(here, velocities, span, h, last, own, terms_of)
    touch(x, v, span, contacts, particles, work, terms)
    account(work.velocity.values, span, contacts, meets.pairs, room, meets.tally, meets.told)
    if contacts > 0:
        enter(span, ledger, meets.pairs, room)
    if last:
        shift_shown(span, contacts, meets.pairs, work)
    for body in range(count):
        own, entries = of_body(work, body), of_body(ledger, body)
        here, velocities, terms_of = of_body(x, body), of_body(v, body), of_body(terms, body)
        if work.stirred[body]:
            leave(here, velocities, span, h, last, entries, own, terms_of)
    if last:
        hold(meets, terms.memory, 0.5)


# --- The tally ------------------------------------------------------------------------------------------


@compiled
def resume_tally(phase: Any, meets: Any) -> None:
    """Put the tally back to what it was before the last node; that of fresh copies stays."""
    for m in range(1, entry_of(meets.told, 0) + 1):
        first = entry_of(meets.told, m) * ENTRIES
        for n in range(first, first + ENTRIES):
            store(meets.tally, n, select(phase < 0.5, load(meets.tally, n), load(meets.before, n)))


@compiled
def remember_tally(meets: Any) -> None:
    """Remember the tally before the last node; pairs that are apart then are told of when they meet again."""
    kept, tally = 0, meets.tally
    for m in range(1, entry_of(meets.told, 0) + 1):
        p = entry_of(meets.told, m)
        first = p * ENTRIES
        for n in range(first, first + ENTRIES):
            store(meets.before, n, load(tally, n))
        touching, energy = load(tally, first + TOUCHING), load(tally, first + ENERGY)
        if any_lane(select(energy <= 0.0, touching, 1.0 + 0.0 * touching) > 0.5):  # be it no number
            kept += 1
            set_entry(meets.told, kept, p)
    set_entry(meets.told, 0, kept)


@compiled
def halve_tally(meets: Any) -> None:
    """Leave half of the impulses and losses that the node added."""
    for m in range(1, entry_of(meets.told, 0) + 1):
        p = entry_of(meets.told, m)
        for entry in (IMPULSE, told.CONTACT, told.FRICTION):
            n = p * ENTRIES + entry
            store(meets.tally, n, 0.5 * (load(meets.before, n) + load(meets.tally, n)))
