"""What bodies that collide do to each other at the node of a step, where all impulses act at once.

Particles fly straight for half a step, receive the impulses of springs, gravity, dampers, contact and
friction, and fly straight for the other half. As x₁ = x₀ + (h/2)(v₀ + v₁), the angular momentum changes
by exactly Σ (x₀ + h v₀/2) × p for the impulses p: those of a contact lie along D between the points of D,
at the positions of the node, so that they keep momentum and angular momentum to round-off, whatever their
size.

Each contact's impulse J follows from the heights h₀ = d − (h/2) u₀ and a = h₀ + h (u₀ + u)/2, with u the
speed along its normal after all other impulses (`springgym.contact.law`). Two sweeps, there and
back, find all.

The strength of an edge's contact depends on where it is met: the force of this energy's gradient acts,
too. Its size is q = h Ū/(1 + h² Ū G/2), G = Σ |∇ᵢΦ|²/mᵢ, so bounded that a step cannot gain more of it
than there is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from springgym.contact.law import barrier_energy, meet
from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.core.lanes import any_lane, load, load_each, maximum, minimum, select, sqrt, store, store_each
from springgym.core.vectors import (
    TINY,
    choose,
    cross,
    dot,
    plus_scaled,
    row,
    row_each,
    set_row,
    set_row_each,
    vec,
)
from springgym.contact.features import TAPER, smooth
from springgym.contact.friction import lay_out
from springgym.contact.solids import (
    among_going,
    between,
    count_change,
    face,
    push_body,
    push_both,
    wrenches,
    yielding_of,
)
from springgym.contact.pairs import (
    CONTACT,
    ENERGY,
    ENTRIES,
    FAR,
    FAST,
    FASTEST,
    GAP,
    IMPULSE,
    MET,
    MISSES,
    OVERFLOW,
    TOUCHING,
    entry_of,
    spend,
    tell,
)

if TYPE_CHECKING:
    from springgym.forces import Particles
    from springgym.contact.solids import Solids


LOW = 0.02
"""What begins a step nearer than this share of Δ was missed before. It is taken as this near: what sweeps
leave over brings contacts nearer than they were solved for, and their energy has no bound."""

QUICK = 0.2
"""Share of Δ that a contact may move by in a step, to be computed well."""

LIFTS = 8
"""Turns in which contacts are lifted, one after another, where a node is read."""


@compiled
def prepare(
    x: Rows,
    w: Rows,
    span: Any,
    count: Any,
    particles: Particles,
    pairs: Any,
    room: Any,
    tally: Numbers,
    met: Numbers,
) -> None:
    """Find the speeds that contacts come with, and how much an impulse changes them; ``met`` is set to 1 of
    their particles, if these move by themselves.

    ``w`` are velocities of particles, or what `springgym.contact.solids.Solids` says of rigid bodies.
    """
    for n in range(room.length[MET]):
        set_row(room.spent, room.met[n], vec(0.0, 0.0, 0.0))
    for k in range(count):
        store(room.inverse, k, weigh(x, k, particles, pairs, room, met, room.solids))
        u = speed(w, k, pairs, room, room.solids)
        store(room.before, k, u)
        store(room.push, k, 0.0)
        set_row(room.rub, k, vec(0.0, 0.0, 0.0))
        set_row(room.slide, k, vec(0.0, 0.0, 0.0))
        p = room.pair[k]
        missed = load(room.distance, k) - span.lead * u < LOW * pairs.reach[p]
        tell(tally, p, MISSES, select(missed, 1.0 + 0.0 * u, 0.0))


@compiled
def weigh(
    x: Rows, k: int, particles: Particles, pairs: Any, room: Any, met: Numbers, solids: Solids | None
) -> Any:
    """Return W of contact k [1/kg]; how it moves what it touches is stored."""
    if solids is not None:
        return face(x, k, pairs, room, solids)
    if met is not None:
        inverse, there = 0.0 * load(room.distance, k), load(room.distance, k) < 0.5 * FAR
        for j in range(room.members[k]):
            weight = load(room.weight, 4 * k + j)
            i = load(room.particle, 4 * k + j)
            gain = weight * load_each(particles.inverse_mass, i)
            store_each(met, i, select(there, 1.0 + 0.0 * weight, load_each(met, i)))
            store(room.gain, 4 * k + j, gain)
            inverse = inverse + weight * gain
        lay_out(x, k, pairs.friction, room)
        return inverse
    raise LookupError("neither rigid bodies nor particles that move by themselves")


@compiled
def speed(v: Rows, k: Number, pairs: Any, room: Any, solids: Solids | None) -> Any:
    """Return u of contact k."""
    if solids is not None:
        return dot(row(room.toward, k), between(v, k, pairs, room, solids))
    u = 0.0 * row(room.toward, k)
    for j in range(room.members[k]):
        u = plus_scaled(u, load(room.weight, 4 * k + j), row_each(v, load(room.particle, 4 * k + j)))
    return dot(row(room.toward, k), u)


@compiled
def give(v: Rows, i: Number, s: Number, u: Vector, on: Mask) -> None:
    """Add s u to the velocity of each copy's own particle, in some lanes; the others are left to the bit."""
    before = row_each(v, i)
    set_row_each(v, i, choose(on, plus_scaled(before, s, u), before))


@compiled
def push_apart(
    v: Rows, k: int, impulse: Vector, on: Mask, pairs: Any, room: Any, solids: Solids | None
) -> None:
    """Give contact k an impulse along its normal, in some lanes."""
    if solids is not None:
        push_both(v, k, impulse, on, pairs, room, solids)
    else:
        for j in range(room.members[k]):
            give(v, load(room.particle, 4 * k + j), load(room.gain, 4 * k + j), impulse, on)


@compiled
def sweep(v: Rows, span: Any, count: Number, backward: bool, pairs: Any, room: Any) -> None:
    """Solve one contact after another for its impulse, given all others' as they are by now."""
    for m in range(count):
        k = count - 1 - m if backward else m
        p = room.pair[k]
        reach, inverse, old = pairs.reach[p], load(room.inverse, k), load(room.push, k)
        u0, d = load(room.before, k), load(room.distance, k)
        u = speed(v, k, pairs, room, room.solids) - inverse * old
        start = maximum(d - span.lead * u0, LOW * reach)
        free = start + span.lead * u0 + span.out * u
        meets = select(inverse > 0.0, minimum(start, free), FAR) < reach
        if any_lane(select(meets, 1.0, old) > 0.0):  # what the first sweep gave may have to be taken back
            c = load(pairs.strength, p) * load(room.share, k) * inverse
            change, _ = meet(start, free, span, c, reach, loss_of(pairs.loss, p, inverse), meets)
            on = among_going(d < 0.5 * FAR, room.solids)
            new = select(on, select(meets, change / (inverse + TINY), 0.0), old)
            store(room.push, k, new)
            push_apart(v, k, (new - old) * row(room.toward, k), on, pairs, room, room.solids)


@compiled
def loss_of(loss: Numbers, pair: Any, like: Number) -> Any:
    """Return β of a pair: 0 if none loses anything."""
    beta = 0.0 * like
    if loss is not None:
        beta = beta + load(loss, pair)
    return beta


@compiled
def lost_by(v: Rows, span: Any, k: Number, given: Number, pairs: Any, room: Any, loss: Numbers) -> Any:
    """Return the energy [J] that contact k lost: what the barrier gave, less the work of the impulse.

    Without loss they differ by what sweeps leave over, which is an error, and is not entered.
    """
    lost = 0.0 * given
    if loss is not None:
        rate = (
            span.lead * load(room.before, k) + span.out * speed(v, k, pairs, room, room.solids)
        ) / span.whole
        lossy = load(loss, room.pair[k]) + lost > 0.0
        lost = select(lossy, given - load(room.push, k) * rate, 0.0)
    return lost


@compiled
def ends(v: Rows, span: Any, k: Number, reach: Number, pairs: Any, room: Any) -> Any:
    """The heights of contact k when the step begins and when it ends."""
    d = load(room.distance, k)
    first = maximum(d - span.lead * load(room.before, k), LOW * reach)
    return first, maximum(d + span.out * speed(v, k, pairs, room, room.solids), LOW * reach)


@compiled
def lift_apart(shift: Rows, v: Rows, span: Any, count: int, pairs: Any, room: Any) -> bool:
    """Find how far to shift what is read [m], so that bodies are not shown in each other; whether at all.

    A node lies amid two ways. Where these are long, a contact may be closed there that is open at both ends
    of the step: it is shown with half of the lower of both distances, or of Δ. ``shift`` (N, 3) is 0 at
    first; of rigid bodies it has two rows for each, of which the first is used.
    """
    shifted = False
    for _ in range(LIFTS):
        again = False
        for k in range(count):
            reach, inverse = pairs.reach[room.pair[k]], room.inverse
            first, last = ends(v, span, k, reach, pairs, room)
            here = load(room.distance, k) + speed(shift, k, pairs, room, room.solids)
            short = 0.5 * minimum(minimum(first, last), reach) - here
            on = select(load(inverse, k) > 0.0, short, 0.0) > 0.0
            if any_lane(on):
                shift_apart(shift, k, short, on, pairs, room, room.solids)
                again = True
        shifted = shifted or again
        if not again:
            break
    return shifted


@compiled
def shift_apart(
    shift: Rows, k: int, short: Number, on: Mask, pairs: Any, room: Any, solids: Solids | None
) -> None:
    """Shift what contact k touches by ``short`` [m] in all along its normal, in some lanes: the heavier less.

    Rigid bodies are not turned.
    """
    n = row(room.toward, k)
    if solids is not None:
        a, b = pairs.first[room.pair[k]], pairs.second[room.pair[k]]
        both = load(solids.lightness, a) + load(solids.lightness, b)
        size = select(both > 0.0, short / (both + TINY), 0.0)
        push_body(shift, a, size, n, 0.0 * n, on, solids)
        push_body(shift, b, -1.0 * size, n, 0.0 * n, on, solids)
    else:
        push_apart(shift, k, short / (load(room.inverse, k) + TINY) * n, on, pairs, room, solids)


@compiled
def taper(
    x: Rows, v: Rows, span: Any, count: Any, particles: Particles, pairs: Any, room: Any, edges: Any
) -> None:
    """Let the force of the gradient of Φ act, where edges meet."""
    if edges is not None:
        for k in range(count):
            share = load(room.share, k)
            partly = select(share < 1.0, share, 0.0) > 0.0
            if room.members[k] == 4 and any_lane(partly):
                p = room.pair[k]
                reach = pairs.reach[p]
                first, last = ends(v, span, k, reach, pairs, room)
                c = load(pairs.strength, p) + 0.0 * share
                mean = 0.5 * (barrier_energy(first, c, reach) + barrier_energy(last, c, reach))
                on = select(partly, mean, 0.0) > 0.0
                if any_lane(on):
                    push_along_gradient(x, v, span, k, mean, on, particles, pairs, room)


@compiled
def push_along_gradient(
    x: Rows, v: Rows, span: Any, k: int, mean: Number, on: Mask, particles: Particles, pairs: Any, room: Any
) -> None:
    """Give contact k, whose energy is ``mean`` per Φ, what the gradient of Φ gives.

    With D = r + s a − t b, D·a = D·b = 0 says how s and t change as the four points move; lengths stay.
    """
    p = room.pair[k]
    i, j = load(room.particle, 4 * k), load(room.particle, 4 * k + 1)
    m, n = load(room.particle, 4 * k + 2), load(room.particle, 4 * k + 3)
    here, there = row_each(x, i), row_each(x, m)
    a, b, r = row_each(x, j) - here, row_each(x, n) - there, here - there
    across = cross(a, b)
    square = select(on, dot(across, across), 1.0)
    inverse = 1.0 / square
    aa, ab, bb, ar, br = dot(a, a), dot(a, b), dot(b, b), dot(a, r), dot(b, r)
    s, t = (ab * br - bb * ar) * inverse, (aa * br - ab * ar) * inverse
    scale = 1.0 / (TAPER * pairs.reach[p])
    la, lb, sine = sqrt(aa) * scale, sqrt(bb) * scale, 1.0 / pairs.parallel[p]
    s0, s1, t0, t1 = smooth(s * la), smooth((1.0 - s) * la), smooth(t * lb), smooth((1.0 - t) * lb)
    both = 1.0 / (aa * bb + TINY)
    angle = square * both * sine
    turned = smooth(angle)
    by_s = (steepness(s * la) * s1 - s0 * steepness((1.0 - s) * la)) * la * t0 * t1 * turned
    by_t = (steepness(t * lb) * t1 - t0 * steepness((1.0 - t) * lb)) * lb * s0 * s1 * turned
    by_angle = -2.0 * ab * both * (s0 * s1 * t0 * t1 * steepness(angle) * sine)
    by_a = by_angle * (b - ab / (aa + TINY) * a)
    by_b = by_angle * (a - ab / (bb + TINY) * b)
    # by how much Φ changes, through s and t, with D·a and D·b
    along_a, along_b = -(bb * by_s + ab * by_t) * inverse, (ab * by_s + aa * by_t) * inverse
    apart = r + (s * a - t * b)
    lever = along_a * a + along_b * b
    g0 = (1.0 - s) * lever - along_a * apart - by_a
    g1 = s * lever + along_a * apart + by_a
    g2 = (t - 1.0) * lever - along_b * apart - by_b
    g3 = -t * lever + along_b * apart + by_b
    push_ends(x, v, span, k, mean, (g0, g1, g2, g3), on, particles, pairs, room, room.solids)


@compiled
def push_ends(
    x: Rows,
    v: Rows,
    span: Any,
    k: int,
    mean: Number,
    pushes: Any,
    on: Mask,
    particles: Particles,
    pairs: Any,
    room: Any,
    solids: Solids | None,
) -> None:
    """Give the four particles of contact k -q times ``pushes``, or the rigid bodies that they are of."""
    if solids is not None:
        p = room.pair[k]
        a, b = pairs.first[p], pairs.second[p]
        push, first, second = wrenches(x, k, pushes, pairs, room, solids)
        size = yielding_of(a, push, first, solids) + yielding_of(b, push, second, solids)
        q = gradient_impulse(span, mean, size)
        set_row(room.slide, k, choose(on, q * push, 0.0 * push))
        push_body(v, a, q, push, first, on, solids)
        push_body(v, b, -1.0 * q, push, second, on, solids)
        count_change(sqrt(q * q * size * load(room.inverse, k)) / pairs.reach[p], on, solids)
    else:
        g0, g1, g2, g3 = pushes
        i, j = load(room.particle, 4 * k), load(room.particle, 4 * k + 1)
        m, n = load(room.particle, 4 * k + 2), load(room.particle, 4 * k + 3)
        mi, mj = load_each(particles.inverse_mass, i), load_each(particles.inverse_mass, j)
        mm, mn = load_each(particles.inverse_mass, m), load_each(particles.inverse_mass, n)
        size = mi * dot(g0, g0) + mj * dot(g1, g1) + mm * dot(g2, g2) + mn * dot(g3, g3)
        q = gradient_impulse(span, mean, size)
        set_row(room.slide, k, choose(on, q * (g0 + g1), 0.0 * g0))
        give(v, i, q * mi, g0, on)
        give(v, j, q * mj, g1, on)
        give(v, m, q * mm, g2, on)
        give(v, n, q * mn, g3, on)


@compiled
def gradient_impulse(span: Any, mean: Number, size: Number) -> Any:
    """Return -q, of the force of the gradient of an energy that is ``mean`` per Φ; ``size`` is G."""
    return (-1.0 * span.whole) * mean / (1.0 + (span.out * span.whole) * mean * size)


@compiled
def steepness(y: Number) -> Any:
    """The slope of `smooth`."""
    y = minimum(maximum(y, 0.0), 1.0)
    return 6.0 * y * (1.0 - y)


@compiled
def account(v: Rows, span: Any, count: Any, pairs: Any, room: Any, tally: Numbers, told: np.ndarray) -> None:
    """Tell what the contacts did at this node."""
    for n in range(1, entry_of(told, 0) + 1):
        p = entry_of(told, n)
        store(tally, p * ENTRIES + TOUCHING, 0.0)
        store(tally, p * ENTRIES + ENERGY, 0.0)
    for n in range(room.length[MET]):
        p = room.met[n]
        tell(tally, p, OVERFLOW, load(room.left_out, p))
    for k in range(count):
        p = room.pair[k]
        push, reach, d, u0 = (
            load(room.push, k),
            pairs.reach[p],
            load(room.distance, k),
            load(room.before, k),
        )
        first, last = ends(v, span, k, reach, pairs, room)
        c = load(pairs.strength, p) * load(room.share, k)
        before, after = barrier_energy(first, c, reach), barrier_energy(last, c, reach)
        there = d < 0.5 * FAR
        at = p * ENTRIES
        touches = push > 0.0
        store(tally, at + TOUCHING, select(touches, 1.0, load(tally, at + TOUCHING)))
        gap = select(there, last, FAR)
        store(tally, at + GAP, minimum(load(tally, at + GAP), gap))
        tell(tally, p, IMPULSE, push)
        tell(tally, p, ENERGY, select(there, 0.5 * (before + after), 0.0))
        given = select(there, before - after, 0.0)
        lost = lost_by(v, span, k, given, pairs, room, pairs.loss)
        tell(tally, p, CONTACT, lost)
        spend(room, p, 0, lost)
        spend(room, p, 2, given)
        fast = select(touches, maximum(u0, -u0), 0.0)
        store(tally, at + FASTEST, maximum(load(tally, at + FASTEST), fast))
        quick = fast * span.whole > QUICK * reach
        tell(tally, p, FAST, select(quick, 1.0 + 0.0 * push, 0.0))


@compiled
def account_start(fresh: Mask, count: Any, pairs: Any, room: Any, tally: Numbers, told: np.ndarray) -> None:
    """Tell what the contacts of ``fresh`` copies are before any step."""
    for m in range(1, entry_of(told, 0) + 1):
        p = entry_of(told, m)
        for entry in (TOUCHING, ENERGY):
            n = p * ENTRIES + entry
            store(tally, n, select(fresh, 0.0, load(tally, n)))
    for k in range(count):
        p = room.pair[k]
        at, d, reach = p * ENTRIES, load(room.distance, k), pairs.reach[p]
        height = maximum(d, LOW * reach)
        there = select(d < 0.5 * FAR, select(fresh, 1.0 + 0.0 * d, 0.0), 0.0) > 0.5
        stored = barrier_energy(height, load(pairs.strength, p) * load(room.share, k), reach)
        stored = select(there, stored, 0.0)
        store(tally, at + TOUCHING, select(stored > 0.0, 1.0, load(tally, at + TOUCHING)))
        store(tally, at + GAP, minimum(load(tally, at + GAP), select(there, height, FAR)))
        tell(tally, p, ENERGY, stored)
