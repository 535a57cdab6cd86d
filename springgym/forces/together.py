"""The node of a step where bodies collide: all of them pass it together.

As in `springgym.forces.node`, all impulses act at once, amid a step, and the state is read there. Here what
bodies give each other acts, too. It is found once a node, from positions and the velocities before it; what
it gives follows from all else, as for surfaces: once as if there were no dampers, so that these see the
mean velocity, and once for good, beginning with what was given then. Surfaces and pairs are all else to each
other, and take turns: surfaces, the pairs there and back, surfaces again, friction between bodies there and
back, each followed by the surfaces, which have the last word.

An impulse p changes the kinetic energy by p · (v₋ + v₊)/2. Of a pair, half of what it loses and half of the
energy in its barriers is entered for each of its bodies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from springgym.compiling import compiled
from springgym.forces import Particles, stored_energy
from springgym.forces.barrier import FORESEEN, FOUND, coefficient, energy_at
from springgym.forces.ledger import CONTACT, FRICTION, record
from springgym.forces.memory import HELD, PHASE, halve
from springgym.forces.node import (
    Given,
    Space,
    act_and_damp,
    bow,
    foreseen,
    impulses,
    lifted,
    near,
    nothing_given,
    pushed,
    record_stray,
    record_swing,
    span_of,
)
from springgym.forces.pairs import terms as told
from springgym.forces.pairs.friction import SWEEPS, TURNS, rub
from springgym.forces.pairs.impulses import account, account_start, prepare, sweep, taper
from springgym.forces.pairs.search import find
from springgym.forces.pairs.terms import ENERGY, ENTRIES, IMPULSE, Room
from springgym.kinds import Ledger, Number, Numbers, Rows, Vector
from springgym.lanes import Ragged, any_lane, bodies_of, load, of_body, select, store
from springgym.vectors import choose, dot, minus, plus, plus_scaled, row, set_row, times

if TYPE_CHECKING:
    from springgym.forces import Terms
    from springgym.forces.barrier import HollowSphere, Planes


START = -1
"""As a number of steps: none, but it is told which bodies of fresh copies touch."""


class Bodies(NamedTuple):
    """What a thread computes in, (N, 3) of all bodies if nothing else is said."""

    a: Ragged
    """accelerations by springs and gravity [m/s²]"""
    b: Ragged
    """and by actuators"""
    space: Space
    soon: Ragged
    """velocities after the node, but for contact [m/s]"""
    velocity: Ragged
    """and with as much of it as is known"""
    base: Ragged
    """these before bodies gave each other more"""
    pairs: Ragged
    """what bodies gave each other [m/s]"""
    change: Ragged
    """what surfaces give: see `springgym.forces.node.Given`"""
    rub: Ragged
    force: Ragged
    bends: Ragged
    bowed: np.ndarray
    """(bodies,) energy that belongs to the next node [J]"""
    room: Room


# --- Contact ------------------------------------------------------------------------------------------


@compiled
def lean(x: Rows, span: Any, found: Any, fresh: Any, last: Any, own: Any, terms: Terms) -> None:
    """Let surfaces give a body's particles what follows from all else, and bodies' pushes among it.

    After the ``fresh`` turn only those of copies whose velocity changed since. Before the ``last`` one, they
    also wait where a surface gave nothing and is not near.
    """
    arrived = terms.memory.arrived
    for i in range(x.shape[0]):
        velocity = row(own.velocity, i)
        more = minus(velocity, row(own.base, i))
        moved = select(dot(more, more) > 0.0, 1.0, 0.0 * load(terms.memory.marks, PHASE))
        if fresh or any_lane(moved > 0.5):
            place, start = row(x, i), row(arrived, i)
            if not (fresh or last):
                calm = waiting(i, place, start, velocity, span, own, terms.planes, terms.bowl)
                moved = select(calm > 0.5, 0.0, moved)
            turns = moved > (-1.0 if fresh else 0.5)
            if any_lane(turns):
                before = row(own.pairs, i)
                by_bodies = plus(before, more)
                now = plus(row(own.soon, i), by_bodies)
                given = lean_on(
                    i, place, start, now, span, found, own.space.pushes, terms, terms.planes, terms.bowl
                )
                now = plus(now, plus(given.change, given.rub))
                set_row(own.pairs, i, choose(turns, by_bodies, before))
                set_row(own.velocity, i, choose(turns, now, velocity))
                set_row(own.base, i, choose(turns, now, row(own.base, i)))
                set_row(own.change, i, choose(turns, given.change, row(own.change, i)))
                set_row(own.rub, i, choose(turns, given.rub, row(own.rub, i)))
                set_row(own.force, i, choose(turns, given.force, row(own.force, i)))
                set_row(own.bends, i, choose(turns, given.bend, row(own.bends, i)))


@compiled
def waiting(
    i: int,
    place: Vector,
    start: Vector,
    velocity: Vector,
    span: Any,
    own: Any,
    planes: Planes | None,
    bowl: HollowSphere | None,
) -> Any:
    """1 where surfaces gave particle ``i`` nothing and are not near, else 0."""
    change = row(own.change, i)
    calm = select(dot(change, change) > 0.0, 0.0, 1.0 + 0.0 * span.out)
    if planes is not None or bowl is not None:
        begin = plus_scaled(place, -1.0 * span.lead, start)
        end = plus_scaled(place, span.out, velocity)
        calm = select(near(begin, end, planes, bowl), 0.0, calm)
    return calm


@compiled
def lean_on(
    i: int,
    place: Vector,
    start: Vector,
    soon: Vector,
    span: Any,
    found: Any,
    pushes: Numbers,
    terms: Terms,
    planes: Planes | None,
    bowl: HollowSphere | None,
) -> Given:
    """What surfaces, if there are any, give particle ``i``; all else changes its velocity from ``start``
    to ``soon``."""
    given = nothing_given(start)
    if planes is not None or bowl is not None:
        begin = plus_scaled(place, -1.0 * span.lead, start)
        end = plus_scaled(place, span.out, soon)
        if terms.particles.free[i] and any_lane(near(begin, end, planes, bowl)):
            given = impulses(i, begin, end, start, minus(soon, start), span, found, pushes, terms)
    return given


@compiled
def leans(
    turn: int, count: Number, planes: Planes | None, bowl: HollowSphere | None, friction: Numbers
) -> bool:
    """Whether surfaces have a turn: the last one always, as it sums up, others if something changed."""
    last = turn == TURNS
    if planes is None and bowl is None:
        return last
    if friction is None and turn == SWEEPS:
        return False
    return last or count > 0


@compiled
def touch(
    x: Any, w: Any, span: Any, count: Number, last: Any, particles: Particles, work: Any, terms: Terms
) -> None:
    """Find what surfaces and bodies give at a node, for good at the ``last`` time."""
    meets, room = terms.meets, work.room
    pairs = meets.pairs
    found = FOUND if last else FORESEEN
    v = work.velocity.values
    fresh = True
    for turn in range(TURNS + 1):  # in one loop, as each call is compiled where it stands
        if leans(turn, count, terms.planes, terms.bowl, pairs.friction):
            for body in range(bodies_of(x)):
                own = of_body(work, body)
                lean(of_body(x, body), span, found, fresh, turn == TURNS, own, of_body(terms, body))
            fresh = False
        if turn < 2:
            sweep(v, span, count, turn == 1, pairs, room)
        if turn == 1 and last:
            taper(x.values, v, span, count, particles, pairs, room, pairs.shapes.edges)
        if 0 < turn <= SWEEPS or (last and turn > SWEEPS):
            rub(w, v, turn - 1, count, pairs, pairs.friction, room, meets.tally)


# --- The node -----------------------------------------------------------------------------------------


@compiled
def arrive(v: Rows, span: Any, own: Any, foresees: bool, memory: Any) -> None:
    """Keep how a body's particles come, and kick them with what leads to the node."""
    for i in range(v.shape[0]):
        start = row(v, i)
        set_row(memory.arrived, i, start)
        set_row(v, i, plus_scaled(start, span.lead, row(own.a, i)))
        if not foresees:
            set_row(own.space.given, i, (0.0, 0.0, 0.0))
        set_row(own.pairs, i, (0.0, 0.0, 0.0))


@compiled
def unmet(contacts: Number, last: Any, planes: Planes | None, bowl: HollowSphere | None) -> bool:
    """Whether nothing touches anything at a node, so that it is two kicks; the last one is read, too."""
    if planes is None and bowl is None:
        return contacts == 0 and not last
    return False


@compiled
def kick_on(v: Rows, time: Number, a: Rows) -> None:
    """Kick a body's particles; a sum with zero is never −0, as where contacts of other copies add theirs."""
    for i in range(v.shape[0]):
        set_row(v, i, plus(plus_scaled(row(v, i), time, row(a, i)), (0.0, 0.0, 0.0)))


@compiled
def look_ahead(v: Rows, span: Any, last: Any, own: Any, terms: Terms) -> None:
    """Find a body's velocities after the node, but for contact: as if there were no dampers, at first.

    Less what surfaces are foreseen to give, at first, too, though it is not given yet: it is found again by
    what leans on them, and blocks that slide together keep closer to their friction so (0.03 %; else 0.4 %).
    """
    for i in range(v.shape[0]):
        now = row(v, i)
        now = minus(now, row(own.space.given, i))
        soon = plus_scaled(now, span.out, row(own.a, i))
        if not last:
            force = pushed(own.b, i, soon, terms.wrench, terms.thrust)
            soon = plus_scaled(soon, span.whole, force)
        with_pairs = plus(soon, row(own.pairs, i))
        set_row(own.soon, i, soon)
        set_row(own.velocity, i, with_pairs)
        set_row(own.base, i, with_pairs)


@compiled
def give_half(v: Rows, own: Any) -> None:
    """Give half of what contact is going to give, as far as is known, before dampers act: what surfaces gave
    at the last node, and what bodies give as if there were no dampers."""
    for i in range(v.shape[0]):
        half = plus(row(own.space.given, i), times(0.5, row(own.pairs, i)))
        set_row(own.space.given, i, half)
        set_row(v, i, plus(row(v, i), half))


@compiled
def leave(
    x: Rows, v: Rows, body: Any, span: Any, last: Any, ledger: Ledger, work: Any, own: Any, terms: Terms
) -> bool:
    """Let a body's particles go on, and enter what they lost; or, at the ``last`` node, read them.

    Whether a way was bent.
    """
    particles, memory = terms.particles, terms.memory
    none = 0.0 * load(memory.marks, PHASE)
    share = span.out * (1.0 / span.whole)
    fresh = span.lead <= 0.0
    lossy = select(fresh, 1.0, coefficient(terms.impact_damping, none)) > 0.0
    stray, lost, rubbed, bowed, held = none, none, none, none, none
    swung, thrown = none, none
    bent, raised = False, False
    for i in range(v.shape[0]):
        place, start, acceleration = row(x, i), row(memory.arrived, i), row(own.a, i)
        half, by_bodies, bend = row(own.space.given, i), row(own.pairs, i), row(own.bends, i)
        change, slowed, force = row(own.change, i), row(own.rub, i), row(own.force, i)
        total = plus(by_bodies, plus(change, slowed))
        kicked = plus(plus_scaled(start, span.lead, acceleration), half)
        others = minus(row(v, i), kicked)
        after, mass = row(own.velocity, i), load(particles.mass, i)
        if particles.free[i]:
            if any_lane(dot(half, half) + dot(total, total) + dot(force, force) > 0.0):
                stray = stray + mass * dot(others, minus(times(0.5, total), half))
                mean = plus_scaled(start, span.lead, acceleration)
                mean = plus_scaled(mean, 0.5, plus(others, total))
                way = plus(plus_scaled(times(span.lead, start), span.out, after), bend)
                gone = mass * (dot(force, way) / span.whole - dot(change, mean))
                lost = lost + select(lossy, gone, 0.0)
                lost = lost - select(fresh, mass * dot(by_bodies, mean), 0.0)
                rubbed = rubbed - mass * dot(slowed, mean)
                bowed = bowed + 0.5 * mass * dot(acceleration, bend)
                if any_lane(dot(bend, bend) > 0.0):
                    bent = True
                set_row(x, i, plus(place, bend))
            if last:
                given = times(span.whole, pushed(own.b, i, start, terms.wrench, terms.thrust))
                thrown = thrown + mass * dot(given, given)
                swung = swung + mass * dot(others, others)
                held = held + (0.125 * mass) * dot(total, plus_scaled(total, 2.0, others))
                more, lift = held_at(place, start, after, bend, span, terms, terms.planes, terms.bowl)
                held = held + more
                if any_lane(dot(lift, lift) > 0.0):
                    raised = True
                set_row(x, i, plus(place, lift))
        if last:
            set_row(v, i, times(0.5, plus(start, after)))
        else:
            set_row(v, i, after)
            set_row(own.space.bends, i, bend)
            set_row(own.space.given, i, times(share, plus(change, slowed)))
    store(work.bowed, body, bowed)
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
        store(memory.marks, HELD, held)
    return bent


@compiled
def held_at(
    place: Vector,
    start: Vector,
    after: Vector,
    bend: Vector,
    span: Any,
    terms: Terms,
    planes: Planes | None,
    bowl: HollowSphere | None,
) -> Any:
    """What surfaces' barriers hold around a node beside what they hold where it is read, and its lift."""
    energy, lift = 0.0 * place[0], times(0.0, place)
    if planes is not None or bowl is not None:
        begin = plus_scaled(place, -1.0 * span.lead, start)
        finish = plus(plus_scaled(place, span.out, after), bend)
        lift = lifted(place, begin, finish, terms)
        energy = 0.5 * (energy_at(begin, planes, bowl) + energy_at(finish, planes, bowl))
        energy = energy - energy_at(plus(place, lift), planes, bowl)
    return energy, lift


@compiled
def enter(span: Any, ledger: Ledger, pairs: Any, room: Any) -> None:
    """Enter what pairs lost, half for each body; of the half node of a fresh copy, all that it lost."""
    for p in range(pairs.first.size):
        rubbed = load(room.spent, (p, 1))
        lost = select(span.lead > 0.0, load(room.spent, (p, 0)), load(room.spent, (p, 2)) - rubbed)
        for side in range(2):
            entries = of_body(ledger, pairs.first[p] if side == 0 else pairs.second[p])
            record(entries, CONTACT, 0.5 * lost)
            record(entries, FRICTION, 0.5 * rubbed)


@compiled
def hold(pairs: Any, tally: Numbers, memory: Any, share: Number) -> None:
    """Let each body of a pair hold a share, half, of the energy in its barriers."""
    for p in range(pairs.first.size):
        half = share * load(tally, p * ENTRIES + ENERGY)
        for side in range(2):
            marks = of_body(memory, pairs.first[p] if side == 0 else pairs.second[p]).marks
            store(marks, HELD, load(marks, HELD) + half)


@compiled
def begin(phase: Number, contacts: Number, meets: Any, room: Any, memory: Any) -> None:
    """Tell of fresh copies which of their bodies touch, and let them hold what is in the barriers between."""
    fresh, none = phase < 0.5, 0.0 * phase
    account_start(fresh, contacts, meets.pairs, room, meets.tally)
    for body in range(bodies_of(memory.marks)):
        marks = of_body(memory, body).marks
        store(marks, HELD, select(fresh, none, load(marks, HELD)))
    hold(meets.pairs, meets.tally, memory, select(fresh, 0.5 + none, 0.0))


@compiled
def pass_together(
    x: Any, v: Any, phase: Number, h: Number, last: Any, goes: Any, ledger: Ledger, work: Any, terms: Any
) -> bool:
    """Let all act on all bodies at a node: `springgym.forces.node.pass_node` where they collide.

    If nothing ``goes`` on, only tell which bodies touch in fresh copies. Whether a way was bent.
    """
    span, meets, room = span_of(phase, h), terms.meets, work.room
    every, w = terms.particles, terms.memory.arrived.values
    particles = Particles(every.mass.values, every.inverse_mass.values, every.free.values)
    count = bodies_of(x)
    contacts = find(x.values, v.values, span, meets.pairs, room)
    if not goes:
        begin(phase, contacts, meets, room, terms.memory)
        return False
    alone = unmet(contacts, last, terms.planes, terms.bowl)
    for body in range(count):
        own = of_body(work, body)
        if alone:
            kick_on(of_body(v, body), span.lead, own.a)
        else:
            arrive(of_body(v, body), span, own, foreseen(terms.dampers), of_body(terms.memory, body))
    prepare(x.values, w, span, contacts, particles, meets.pairs, room, meets.tally)
    for part in range(2):
        if part == 1:
            for body in range(count):
                own = of_body(terms, body)
                direction = of_body(work.space.direction, body)
                act_and_damp(
                    of_body(v, body),
                    of_body(work.b, body),
                    phase,
                    span,
                    direction,
                    of_body(ledger, body),
                    own,
                )
        if alone:
            continue
        if part == 1 or (foreseen(terms.dampers) and contacts > 0):
            for body in range(count):
                look_ahead(of_body(v, body), span, part == 1, of_body(work, body), of_body(terms, body))
            touch(x, w, span, contacts, part == 1, particles, work, terms)
        if part == 0 and foreseen(terms.dampers):
            for body in range(count):
                give_half(of_body(v, body), of_body(work, body))
    account(work.velocity.values, span, contacts, meets.pairs, room, meets.tally)
    if alone:
        for body in range(count):
            kick_on(of_body(v, body), span.out, of_body(work, body).a)
        return False
    enter(span, ledger, meets.pairs, room)
    bent = False
    for body in range(count):
        own = of_body(work, body)
        if leave(
            of_body(x, body),
            of_body(v, body),
            body,
            span,
            last,
            of_body(ledger, body),
            work,
            own,
            of_body(terms, body),
        ):
            bent = True
    if last:
        hold(meets.pairs, meets.tally, terms.memory, 0.5)
    return bent


@compiled
def bow_together(bent: Any, ledger: Ledger, work: Any, terms: Terms) -> None:
    """`springgym.forces.node.bow` for all bodies."""
    if bent:
        for body in range(bodies_of(work.a)):
            own, entries = of_body(work, body), of_body(ledger, body)
            record(entries, CONTACT, load(work.bowed, body))
            bow(own.a, (0, own.a.shape[0]), own.space, entries, of_body(terms, body))


# --- The tally ------------------------------------------------------------------------------------------


@compiled
def resume_tally(phase: Any, meets: Any) -> None:
    """Put the tally back to what it was before the last node; that of fresh copies stays."""
    for n in range(meets.pairs.first.size * ENTRIES):
        store(meets.tally, n, select(phase < 0.5, load(meets.tally, n), load(meets.before, n)))


@compiled
def remember_tally(meets: Any) -> None:
    for n in range(meets.pairs.first.size * ENTRIES):
        store(meets.before, n, load(meets.tally, n))


@compiled
def halve_tally(meets: Any) -> None:
    """Leave half of the impulses and losses that the node added."""
    for p in range(meets.pairs.first.size):
        for entry in (IMPULSE, told.CONTACT, told.FRICTION):
            n = p * ENTRIES + entry
            store(meets.tally, n, 0.5 * (load(meets.before, n) + load(meets.tally, n)))
