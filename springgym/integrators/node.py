"""The node of a step: in scenes with surfaces, the place where all impulses of the step act at once.

Particles fly straight for half a step, receive the impulses of springs, gravity, actuators, dampers, surfaces
and friction, and fly straight for the other half. With v₋ and v₊ the velocities before and after the node, an
impulse p changes the kinetic energy by exactly p · (v₋ + v₊)/2: that is what the ledger enters, and what
surfaces take for the speed at which they give way (`springgym.contact.surfaces`). What rests has no such
mean, so that it loses nothing, and does not creep.

The state is read amid a node, with the mean of v₋ and v₊ for its velocity: that of velocity Verlet where
nothing touches. What is read has half of the node behind it. `springgym.forces.memory` keeps v₋, from which
the next call makes the node anew. A fresh copy begins with the second half of a node: it was placed where no
drift ended.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from springgym.contact.law import Span, meet, within_cone
from springgym.contact.round import RoundProblem, lifted_feature, roll, rolls
from springgym.contact.surfaces import (
    coefficient,
    count,
    energy_at,
    facing,
    height,
    lowest,
    standing,
    strength_and_reach,
)
from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Mask, Number, Numbers, Rows, Vector
from springgym.core.lanes import any_lane, epsilon, load, maximum, minimum, select, sqrt, store
from springgym.core.vectors import TINY, choose, dot, plus_scaled, row, set_row, unit, vec, vector
from springgym.forces import stored_energy
from springgym.forces.actuators import push
from springgym.forces.cycle import PHASE, relax_in_turn, relax_to_be_read
from springgym.forces.ledger import CONTACT, DAMPING, FRICTION, WORK, record
from springgym.forces.memory import STORED, halve, turn_drive
from springgym.forces.springs import damp

if TYPE_CHECKING:
    from springgym.contact.round import Rolling, Rounds
    from springgym.contact.surfaces import Surfaces
    from springgym.forces import Terms
    from springgym.forces.actuators import Thrust, Wrench
    from springgym.forces.cycle import Cycle
    from springgym.forces.springs import Dampers


TURNS = 40
"""How often the surfaces that know of each other are taken in turn, at the most."""

AGREED = 1e-9
"""Change of the way by the last turn, as a share of Δ, at which they agree."""


ALMOST = 1.1
"""Share of Δ below which a surface is near: where a way ends out of it, the next begins out of Δ, whatever is
rounded."""


LIFTS = 4
"""Newton's steps that lift a node: of ground that is bent, as much as Δ, they leave 1e-9 of it."""


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


class Space(NamedTuple):
    """The arrays that a node of a step is computed in."""

    a: Rows
    """(N, 3) accelerations by springs and gravity [m/s²]"""
    b: Rows
    """(N, 3) accelerations by actuators [m/s²]"""
    w: Rows
    """(N, 3) velocities amid the node, before contact [m/s]"""
    direction: Rows
    """(springs, 3) where each spring points"""
    given: Rows
    """(N, 3) half of what surfaces are going to give, as far as is known before dampers act [m/s]"""
    pushes: Rows
    """(surfaces, 3) change of velocity [m/s] of a particle by each surface, where these are coupled"""
    rolling: Rolling | None
    """`springgym.contact.round.Rolling`; None without round features"""


class Given(NamedTuple):
    """The impulses that surfaces give a particle at a node, as changes of its velocity."""

    change: Vector
    """change of velocity by the pushes of surfaces [m/s]"""
    rub: Vector
    """change of velocity by friction [m/s]"""
    force: Vector
    """Σ J n [m/s]: the work of the barriers is its product with the way, over the time"""


class Passage(NamedTuple):
    """The passage of a free particle through a node: its velocity before, what changes it, and after."""

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


# --- Surfaces -----------------------------------------------------------------------------------------


@compiled
def in_last_turn(turn: int, k: int, nothing: Vector, pushes: Numbers, surfaces: Surfaces) -> Vector:
    """Return the change of velocity by surface ``k`` in the last turn: ``nothing`` where one turn is all."""
    if surfaces.coupled is None or turn == 0:
        return nothing
    return row(pushes, k)


@compiled
def near(begin: Vector, free: Vector, surfaces: Surfaces) -> Mask:
    """Return where a way begins or ends within reach of a surface, or almost: by `ALMOST`."""
    return minimum(lowest(begin, surfaces), lowest(free, surfaces)) < ALMOST * surfaces.reach


@compiled
def impulses(
    i: int,
    way: tuple[Vector, Vector],
    speed: Vector,
    smooth: Vector,
    span: Span,
    pushes: Numbers,
    terms: Terms,
) -> Given:
    """Return what surfaces and friction give particle ``i`` at a node.

    Without them, its ``way`` would have these two ends. It begins with the velocity ``speed``, which all else
    changes by ``smooth``. What one surface gives is all else to the others: they are taken in turn until they
    agree. Where a normal depends on the end of the way, that is found in the same turns. Friction acts along
    what the surfaces that touch leave free, so that it moves nothing towards one, and stops what it can stop.
    """
    begin, free = way
    nothing = 0.0 * speed
    given, rub, force = nothing, nothing, nothing
    strength, reach = strength_and_reach(terms.surfaces)
    c = strength * load(terms.particles.inverse_mass, i)
    mu, beta = coefficient(terms.friction, nothing[0]), coefficient(terms.loss, nothing[0])
    enough = (AGREED + 64 * epsilon(speed[0])) * reach
    active = select(near(begin, free, terms.surfaces), 1.0 + nothing[0], 0.0)
    for turn in range(TURNS):
        now, pressing = given, nothing
        left, first = speed + smooth, nothing
        pressed, touched = nothing[0], nothing[0]
        end = plus_scaled(free, span.out, given + rub)
        for k in range(count(terms.surfaces.kinds)):
            n, square, start = facing(k, begin, end, terms.surfaces)
            inverse_square = 1.0 / square
            own = in_last_turn(turn, k, nothing, pushes, terms.surfaces)
            by_others = now - own
            others = smooth + (by_others + rub)
            u, s = dot(n, speed), dot(n, others)
            ahead = start + (span.whole * u + span.out * s)
            touching = minimum(start, ahead) < reach
            gain, impulse = nothing[0], nothing[0]
            if any_lane(touching):
                gain, impulse = meet(start, ahead, span, c * square, reach, beta, touching)
                gain, impulse = select(touching, gain, 0.0), select(touching, impulse, 0.0)
                if terms.friction is not None:
                    one, length = select(touching, 1.0 + nothing[0], 0.0), sqrt(inverse_square)
                    across = nothing + length * n
                    if k > 0:
                        across = unit(across - dot(across, first) * first)
                    left = left - one * dot(across, left) * across
                    first = choose(touched > 0.0, first, one * across)
                    touched = touched + one
                    pressed = pressed + length * maximum(gain, 0.0)
            if terms.surfaces.coupled is not None:
                set_row(pushes, k, choose(active > 0.5, gain * inverse_square * n, own))
            now = plus_scaled(by_others, gain * inverse_square, n)
            pressing = plus_scaled(pressing, impulse * inverse_square, n)
        rubbing = nothing
        if terms.friction is not None:
            left = choose(touched > 2.0, nothing, left)
            rubbing = -1.0 * within_cone(left, mu * pressed)
        if terms.surfaces.coupled is None:
            return Given(now, rubbing, pressing)
        going = active > 0.5
        more = now - given
        far = span.whole * span.whole * dot(more, more) > enough * enough
        given, rub = choose(going, now, given), choose(going, rubbing, rub)
        force = choose(going, pressing, force)
        active = select(far, active, 0.0)
        if not any_lane(active > 0.5):
            break
    return Given(given, rub, force)


@compiled
def lifted(place: Vector, first: Vector, last: Vector, terms: Terms) -> Vector:
    """Return how far a node is lifted [m] to be read: to half of the lower of the heights around it, or of Δ.

    Where a step is too coarse for an impact, the node is behind the surface though no way begins or ends
    there. From a curved one it is lifted by Newton's method.
    """
    lift, surfaces = 0.0 * place, terms.surfaces
    for k in range(count(surfaces.kinds)):
        lowest_end = minimum(height(k, first, surfaces), height(k, last, surfaces))
        for _ in range(1 if surfaces.coupled is None else LIFTS):
            n, square, here = standing(k, place + lift, surfaces)
            short = maximum(0.5 * minimum(lowest_end, surfaces.reach) - here, 0.0)
            if not any_lane(short > 0.0):
                break
            lift = plus_scaled(lift, short / square, n)
    return lift


# --- The node -------------------------------------------------------------------------------------------


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
def act_and_damp(v: Rows, node: Node, space: Space, ledger: Ledger, terms: Terms) -> None:
    """Let actuators and dampers act: a sweep of a whole step, or one of half of it before and one after.

    Copies of a block whose sweeps differ in direction have theirs one after the other. The second half of a
    node, of a fresh copy, has the sweep after the actuators, of half a step. In cycles, dampers act where it
    is their turn, see `springgym.forces.cycle`.
    """
    for sweep in range(3):
        if sweep == 1:
            push(v, space.b, node.span.whole, terms.particles, terms.wrench, terms.thrust, ledger)
            turn_drive(v, space.b, node.span.whole, terms.memory, terms.drive, ledger)
        relax_at(sweep, v, node, space.direction, ledger, terms, terms.cycle)


@compiled
def relax_at(
    sweep: int, v: Rows, node: Node, direction: Rows, ledger: Ledger, terms: Terms, cycle: Cycle | None
) -> None:
    """Let the dampers act before the actuators, after them, or on fresh copies; or in cycles."""
    if cycle is None:
        relax_some(sweep, v, node.phase, direction, terms.dampers, ledger, terms)
    else:
        phase = load(cycle.marks, PHASE)
        if node.stage != READS and sweep < 2:
            relax_in_turn(v, direction, sweep == 1, phase, ledger, terms)
        elif sweep == 1:
            relax_to_be_read(v, direction, phase, ledger, terms)


@compiled
def relax_some(
    sweep: int, v: Rows, phase: Number, direction: Rows, dampers: Dampers | None, ledger: Ledger, terms: Terms
) -> None:
    """Let the dampers act on the copies whose turn it is: before the actuators, after them, or fresh ones."""
    if dampers is not None:
        if dampers.paired:
            among = phase > (0.5 if sweep == 0 else (-1.0 if sweep == 1 else 9.0))
        else:
            off = phase - (1.0 if sweep == 0 else (2.0 if sweep == 1 else 0.0))
            among = off * off < 0.25
        if any_lane(among):
            whole = not dampers.paired and sweep < 2
            if any_lane(select(among, 0.0, 1.0 + 0.0 * phase) > 0.5):
                damp(v, direction, terms.springs, dampers, terms.drive, ledger, sweep == 0, whole, among)
            else:
                damp(v, direction, terms.springs, dampers, terms.drive, ledger, sweep == 0, whole)


@compiled
def pushed(b: Rows, i: int, like: Vector, wrench: Wrench | None, thrust: Thrust | None) -> Vector:
    """Return the acceleration of particle ``i`` by actuators, if there are any."""
    if wrench is None and thrust is None:
        return 0.0 * like
    return row(b, i)


@compiled
def needs_expected(dampers: Dampers | None) -> bool:
    """Tell whether it is to be expected, before dampers act, what contact is going to give."""
    return dampers is not None


@compiled
def nothing_given(like: Vector) -> Given:
    """Return what is given where no surface is near."""
    nothing = 0.0 * like
    return Given(nothing, nothing, nothing)


@compiled
def record_cross_work(ledger: Ledger, work: Number, dampers: Dampers | None) -> None:
    """Enter the work of what acted before contact, by the change that contact makes to the mean velocity."""
    if dampers is None:
        record(ledger, WORK, work)
    else:
        record(ledger, DAMPING, -1.0 * work)


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
def give_expected(among: tuple[int, int], space: Space, dampers: Dampers | None) -> None:
    """Give the particles ``among`` which some were touched what is expected."""
    if needs_expected(dampers):
        for i in range(among[0], among[1]):
            set_row(space.w, i, row(space.w, i) + row(space.given, i))


@compiled
def take_back_expected(
    v: Rows, span: Span, among: tuple[int, int], space: Space, ledger: Ledger, terms: Terms
) -> None:
    """Take that back, when all but the surfaces have acted, and enter its product with what they did."""
    if needs_expected(terms.dampers):
        work = 0.0 * span.out
        for i in range(among[0], among[1]):
            half = row(space.given, i)
            now = row(space.w, i) - half
            set_row(space.w, i, now)
            others = now - plus_scaled(row(v, i), span.lead, row(space.a, i))
            work = work - load(terms.particles.mass, i) * dot(others, half)
        record_cross_work(ledger, work, terms.dampers)


@compiled
def losses(passed: Passage, given: Given, pushed: Vector, span: Span) -> tuple[Number, Number]:
    """Return what a particle loses at a node to the restitution of surfaces, and to friction [J].

    The first is what barriers gave less the work of their impulses. ``pushed`` is the change of velocity by
    all pushes, also those of other bodies.
    """
    way = plus_scaled(span.lead * passed.start, span.out, passed.after)
    mean = mean_velocity(passed, span)
    late = 0.5 * (span.out - span.lead) * passed.acceleration
    lost = dot(given.force, way) / span.whole - dot(given.change, mean) + begun_in_touch(pushed, late)
    return passed.mass * lost, -1.0 * passed.mass * dot(given.rub, mean + late)


@compiled
def mean_velocity(passed: Passage, span: Span) -> Vector:
    """Return the mean of the velocities before and after contact [m/s]."""
    kicked = plus_scaled(passed.start, span.lead, passed.acceleration)
    return plus_scaled(kicked, 0.5, passed.others + passed.contact)


@compiled
def begun_in_touch(pushed: Vector, late: Vector) -> Number:
    """Return what the half node of a fresh copy does not lose [m²/s²], though pushes before a kick say so.

    There pushes act against the kick by springs and gravity, not amid two: what rests is at rest. ``late``
    is half of what the kick behind the node gives more than the one before it: 0 in a whole node.
    """
    along = dot(late, pushed)
    return 2.0 * along * along / (dot(pushed, pushed) + TINY)


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
def pass_node(
    x: Rows, v: Rows, node: Node, among: tuple[int, int], space: Space, ledger: Ledger, terms: Terms
) -> tuple[int, int]:
    """Let all act at a node, and go on to the next, or read it; ``v`` goes from v₋ to v₊.

    The velocities w of the ``space`` are v₋ after the kick that leads to the node. There follow, in this
    order: half of what surfaces are expected to give, actuators and dampers, what surfaces give less that
    half, a kick of h/2. Dampers must see the mean velocity, with what surfaces do to it, else rest looks like
    stretching. It is expected that a surface gives as much as at the last node.

    ``among`` says near which particles surfaces were before: the first of them, and the one behind the last.
    The way of the others begins where that of the last node ended, out of reach.

    A body with round features meets surfaces with them alone, see `springgym.contact.round`.

    Returns among which particles surfaces are near now.
    """
    particles, memory, span, last = terms.particles, terms.memory, node.span, node.stage == READS
    a, w = space.a, space.w
    # A whole node without loss keeps the energy; what rounding leaves of that is not entered.
    lossy = select(span.lead > 0.0, coefficient(terms.loss, 0.0 * node.phase), 1.0) > 0.0
    share = span.out * (1.0 / span.whole)
    give_expected(among, space, terms.dampers)
    act_and_damp(w, node, space, ledger, terms)
    take_back_expected(v, span, among, space, ledger, terms)
    if last:
        for i in range(v.shape[0]):
            set_row(memory.arrived, i, row(v, i))
    tau = 0.0 if last else node.h
    whole = rolls(terms.rounds)
    touched = whole and rolled(x, v, span, space, terms, terms.rounds)
    first, behind = v.shape[0], 0
    for i in range(v.shape[0]):
        place, now, acceleration = row(x, i), row(w, i), row(a, i)
        soon = plus_scaled(now, span.out, acceleration)
        end = plus_scaled(place, span.out, soon)
        begin = end
        if among[0] <= i < among[1]:
            begin = plus_scaled(place, -1.0 * span.lead, row(v, i))
        if not (touched or (not whole and particles.free[i] and any_lane(near(begin, end, terms.surfaces)))):
            set_row(v, i, soon)
            set_row(x, i, place + tau * soon)
            continue
        for between in range(max(first, behind), i):
            set_row(space.given, between, vec(0.0, 0.0, 0.0))
        first, behind = min(first, i), i + 1
        start = row(v, i)
        begin = plus_scaled(place, -1.0 * span.lead, start)
        if whole:
            given = of_features(i, start, space.rolling)
        else:
            given = impulses(i, (begin, end), start, soon - start, span, space.pushes, terms)
        total = given.change + given.rub
        after = soon + total
        others = now - plus_scaled(start, span.lead, acceleration)
        passed = Passage(load(particles.mass, i), start, acceleration, others, total, after)
        record_cross_work(ledger, 0.5 * passed.mass * dot(others, total), terms.dampers)
        lost, rubbed = losses(passed, given, given.change, span)
        record(ledger, CONTACT, select(lossy, lost, 0.0))
        record(ledger, FRICTION, rubbed)
        set_row(v, i, after)
        if not last:
            set_row(x, i, place + tau * after)
            if needs_expected(terms.dampers):
                set_row(space.given, i, share * total)
    if last:
        halve(ledger, memory)
        read_amid(x, v, span, space, ledger, terms)
    return first, behind


@compiled
def rolled(x: Rows, v: Rows, span: Span, space: Space, terms: Terms, rounds: Rounds | None) -> bool:
    """Ask surfaces what they give a body by round features; tell whether they touch it in any copy."""
    if rounds is None:
        return False
    return roll(v, space.w, space.a, RoundProblem(x, span, space.rolling, rounds, terms))


@compiled
def of_features(i: int, like: Vector, rolling: Rolling) -> Given:
    """Return what surfaces give particle ``i`` by round features."""
    if rolling is None:
        return nothing_given(like)
    return Given(row(rolling.change, i), row(rolling.rub, i), row(rolling.force, i))


@compiled
def stored_by_features(
    x: Rows, v: Rows, span: Span, rolling: Rolling, terms: Terms, rounds: Rounds | None
) -> tuple[Number, Vector]:
    """Return what `springgym.contact.round.lifted_feature` does; nothing without features."""
    if rounds is None:
        return 0.0 * span.out, 0.0 * row(x, 0)
    return lifted_feature(0.0 * row(x, 0), v, RoundProblem(x, span, rolling, rounds, terms))


@compiled
def read_amid(x: Rows, v: Rows, span: Span, space: Space, ledger: Ledger, terms: Terms) -> None:
    """Read a node that is passed but for the drift after it: lift it, take the mean velocity, enter what half
    of it lacks, and keep what contact holds.

    The velocity is the mean of v₋ and v₊. Of the energy with either, that of the mean lacks m/8 times the
    square of the impulses between them. Springs that push against contact take their share of that back.
    """
    particles, memory = terms.particles, terms.memory
    raised, whole = False, rolls(terms.rounds)
    stored, raising = stored_by_features(x, v, span, space.rolling, terms, terms.rounds)
    sums = no_kicks(stored)
    for i in range(v.shape[0]):
        place, start, after = row(x, i), row(memory.arrived, i), row(v, i)
        set_row(v, i, 0.5 * (start + after))
        if particles.free[i]:
            now, acceleration = row(space.w, i), row(space.a, i)
            total = after - plus_scaled(now, span.out, acceleration)
            others = now - plus_scaled(start, span.lead, acceleration)
            passed = Passage(load(particles.mass, i), start, acceleration, others, total, after)
            thrown = span.whole * pushed(space.b, i, start, terms.wrench, terms.thrust)
            sums = add_kicks(sums, passed, thrown, terms.gravity)
            lift = raising
            if not whole:
                more, lift = stored_by_surfaces(place, lift, passed, span, terms, terms.surfaces)
                stored = stored + more
            if any_lane(dot(lift, lift) > 0.0):
                raised = True
            set_row(x, i, place + lift)
    store_energy(x, stored, raised, sums, span, ledger, terms)


@compiled
def stored_by_surfaces(
    place: Vector, shift: Vector, passed: Passage, span: Span, terms: Terms, surfaces: Surfaces | None
) -> tuple[Number, Vector]:
    """Return what surfaces' barriers store around a node beside what they store where it is read [J], and how
    far that is off the node [m]: by a ``shift``, and lifted off surfaces."""
    energy, lift = 0.0 * place[0], shift
    if surfaces is not None:
        begin = plus_scaled(place, -1.0 * span.lead, passed.start)
        finish = plus_scaled(place, span.out, passed.after)
        lift = shift + lifted(place + shift, begin, finish, terms)
        energy = 0.5 * (energy_at(begin, surfaces) + energy_at(finish, surfaces))
        energy = energy - energy_at(place + lift, surfaces)
    return energy, lift


@compiled
def store_energy(
    x: Rows, stored: Number, raised: bool, sums: Kicks, span: Span, ledger: Ledger, terms: Terms
) -> None:
    """Store what contact has of a body's energy where a node is read, and enter what half of it lacks.

    ``stored`` is that of barriers, ``x`` where the body is shown: ``raised``, its weight and its springs take
    some of it. Springs that push against contact take their share, the shadow energy of their kicks, back.
    """
    memory = terms.memory
    record_kicks(ledger, 0.125 * sums.others, 0.125 * sums.thrown, terms.dampers)
    stored = stored + sums.stored
    if raised:
        weight, elastic, _ = stored_energy(memory.place, terms)
        stored = stored + (weight + elastic)
        weight, elastic, _ = stored_energy(x, terms)
        stored = stored - (weight + elastic)
    shadow = 0.125 * span.whole * span.whole * sums.springs
    store(memory.marks, STORED, stored - select(sums.touched > 0.0, shadow, 0.0))
