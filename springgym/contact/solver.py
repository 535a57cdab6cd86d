"""The impulses of bodies that collide, at the node of a step, where all impulses act at once.

Particles fly straight for half a step, receive the impulses of springs, gravity, dampers, contact and
friction, and fly straight for the other half. As x₁ = x₀ + (h/2)(v₀ + v₁), the angular momentum changes
by exactly Σ (x₀ + h v₀/2) × p for the impulses p: those of a contact lie along D between the points of D,
at the positions of the node, so that they keep momentum and angular momentum to round-off, whatever their
size.

Each contact's impulse J follows from the gaps h₀ = d − (h/2) u₀ and a = h₀ + h (u₀ + u)/2, with u the
speed along its normal after all other impulses (`springgym.contact.law`). Sweeps, there and back, find all
(Gauss and Seidel's); among many bodies they start from what the last node gave (`springgym.contact.warm`).

The strength of an edge's contact depends on where it is met: the force of this energy's gradient acts,
too. Its size is q = h Ū/(1 + h² Ū G/2), G = Σ |∇ᵢΦ|²/mᵢ, so bounded that a step cannot gain more of it
than there is.
"""

from __future__ import annotations

import numpy as np

from springgym.contact.features import TAPER, smooth
from springgym.contact.friction import lay_out
from springgym.contact.law import barrier_energy, meet
from springgym.contact.records import (
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
    ContactRows,
    Ends,
    Problem,
    Solids,
)
from springgym.contact.rows import add_loss
from springgym.contact.solids import (
    among_going,
    between,
    gradient_impulse,
    push_body,
    push_both,
    push_ends_of_both,
    set_arms,
)
from springgym.contact.totals import add_to, entry_of
from springgym.contact.turning import begin_couple
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

LOW = 0.02
"""What begins a step nearer than this share of Δ was missed before. It is taken as this near: what sweeps
leave over brings contacts nearer than they were solved for, and their energy has no bound."""

QUICK = 0.2
"""Share of Δ that a contact may move by in a step, to be computed well."""

LIFTS = 8
"""Turns in which contacts are lifted, one after another, where a node is read."""


# --- Impulses along normals ---------------------------------------------------------------------------


@compiled
def prepare(problem: Problem, touched: Numbers) -> None:
    """Find the speeds that contacts come with, and how much an impulse changes them.

    Of particles that move by themselves, ``touched`` is set to 1 where they are in a contact.
    """
    contacts = problem.contacts
    for n in range(contacts.length[MET]):
        set_row(contacts.losses, contacts.met[n], vec(0.0, 0.0, 0.0))
    for k in range(problem.rows):
        store(contacts.inverse_mass, k, weigh(k, problem, touched, contacts.solids))
        u = speed(problem.before, k, problem, contacts.solids)
        store(contacts.approach, k, u)
        store(contacts.impulse, k, 0.0)
        set_row(contacts.friction, k, vec(0.0, 0.0, 0.0))
        set_row(contacts.taper, k, vec(0.0, 0.0, 0.0))
        begin_couple(k, contacts, problem.pairs.resistance)
        p = contacts.pair[k]
        missed = load(contacts.gap, k) - problem.span.lead * u < LOW * problem.pairs.reach[p]
        add_to(problem.totals, p, MISSES, select(missed, 1.0 + 0.0 * u, 0.0))


@compiled
def weigh(k: int, problem: Problem, touched: Numbers, solids: Solids | None) -> Number:
    """Return W of contact k [1/kg]; how it moves what it touches is stored."""
    if solids is not None:
        return set_arms(k, problem, solids)
    if touched is not None:
        contacts = problem.contacts
        inverse, there = 0.0 * load(contacts.gap, k), load(contacts.gap, k) < 0.5 * FAR
        for j in range(contacts.members[k]):
            weight = load(contacts.weight, 4 * k + j)
            i = load(contacts.particle, 4 * k + j)
            gain = weight * load_each(problem.inverse_mass, i)
            store_each(touched, i, select(there, 1.0 + 0.0 * weight, load_each(touched, i)))
            store(contacts.gain, 4 * k + j, gain)
            inverse = inverse + weight * gain
        lay_out(k, problem, problem.pairs.friction, contacts.spheres)
        return inverse
    raise LookupError("neither rigid bodies nor particles that move by themselves")


@compiled
def speed(v: Rows, k: int, problem: Problem, solids: Solids | None) -> Number:
    """Return u of contact k [m/s]."""
    contacts = problem.contacts
    if solids is not None:
        return dot(row(contacts.normal, k), between(v, k, problem, solids))
    u = 0.0 * row(contacts.normal, k)
    for j in range(contacts.members[k]):
        u = plus_scaled(u, load(contacts.weight, 4 * k + j), row_each(v, load(contacts.particle, 4 * k + j)))
    return dot(row(contacts.normal, k), u)


@compiled
def push_one(v: Rows, i: Number, s: Number, u: Vector, on: Mask) -> None:
    """Add s u to the velocity of each copy's own particle, in some lanes; the others are left to the bit."""
    before = row_each(v, i)
    set_row_each(v, i, choose(on, plus_scaled(before, s, u), before))


@compiled
def push_apart(v: Rows, k: int, impulse: Vector, on: Mask, problem: Problem, solids: Solids | None) -> None:
    """Give contact k an impulse along its normal, in some lanes."""
    if solids is not None:
        push_both(v, k, impulse, on, problem, solids)
    else:
        push_members(v, k, impulse, on, problem.contacts)


@compiled
def push_members(v: Rows, k: int, impulse: Vector, on: Mask, contacts: ContactRows) -> None:
    """Give the particles of contact k an impulse by their weights, in some lanes."""
    for j in range(contacts.members[k]):
        i = load(contacts.particle, 4 * k + j)
        push_one(v, i, load(contacts.gain, 4 * k + j), impulse, on)


@compiled
def sweep(v: Rows, backward: bool, problem: Problem) -> None:
    """Solve one contact after another for its impulse, given all others' as they are by now."""
    span, pairs, contacts = problem.span, problem.pairs, problem.contacts
    for m in range(problem.rows):
        k = problem.rows - 1 - m if backward else m
        p = contacts.pair[k]
        reach, inverse, old = pairs.reach[p], load(contacts.inverse_mass, k), load(contacts.impulse, k)
        u0, d = load(contacts.approach, k), load(contacts.gap, k)
        u = speed(v, k, problem, contacts.solids) - inverse * old
        start = maximum(d - span.lead * u0, LOW * reach)
        free = start + span.lead * u0 + span.out * u
        meets = select(inverse > 0.0, minimum(start, free), FAR) < reach
        if any_lane(select(meets, 1.0, old) > 0.0):  # what the first sweep gave may have to be taken back
            c = load(pairs.strength, p) * load(contacts.share, k) * inverse
            change, _ = meet(start, free, span, c, reach, loss_of(pairs.loss, p, inverse), meets)
            on = among_going(d < 0.5 * FAR, contacts.solids)
            new = select(on, select(meets, change / (inverse + TINY), 0.0), old)
            store(contacts.impulse, k, new)
            push_apart(v, k, (new - old) * row(contacts.normal, k), on, problem, contacts.solids)


@compiled
def loss_of(loss: Numbers, pair: int, like: Number) -> Number:
    """Return β of a pair: 0 if none loses anything."""
    beta = 0.0 * like
    if loss is not None:
        beta = beta + load(loss, pair)
    return beta


@compiled
def ends(v: Rows, k: int, reach: Number, problem: Problem) -> tuple[Number, Number]:
    """Return the gaps of contact k when the step begins and when it ends [m]."""
    span, contacts = problem.span, problem.contacts
    d = load(contacts.gap, k)
    first = maximum(d - span.lead * load(contacts.approach, k), LOW * reach)
    return first, maximum(d + span.out * speed(v, k, problem, contacts.solids), LOW * reach)


# --- Where edges meet ---------------------------------------------------------------------------------


@compiled
def taper(v: Rows, problem: Problem, edges: np.ndarray | None) -> None:
    """Let the force of the gradient of Φ act, where edges meet."""
    if edges is not None:
        pairs, contacts = problem.pairs, problem.contacts
        for k in range(problem.rows):
            share = load(contacts.share, k)
            partly = select(share < 1.0, share, 0.0) > 0.0
            if contacts.members[k] == 4 and any_lane(partly):
                p = contacts.pair[k]
                reach = pairs.reach[p]
                first, last = ends(v, k, reach, problem)
                c = load(pairs.strength, p) + 0.0 * share
                mean = 0.5 * (barrier_energy(first, c, reach) + barrier_energy(last, c, reach))
                on = select(partly, mean, 0.0) > 0.0
                if any_lane(on):
                    pushes = gradient_of_share(k, on, problem)
                    push_ends(v, k, pushes, mean, on, problem, contacts.solids)


@compiled
def gradient_of_share(k: int, on: Mask, problem: Problem) -> Ends:
    """Return ∇Φ by each of the four ends of the edges that meet in contact k [1/m].

    With D = r + s a − t b, D·a = D·b = 0 says how s and t change as the four points move; lengths stay.
    """
    pairs, contacts, x = problem.pairs, problem.contacts, problem.x
    p = contacts.pair[k]
    i, j = load(contacts.particle, 4 * k), load(contacts.particle, 4 * k + 1)
    m, n = load(contacts.particle, 4 * k + 2), load(contacts.particle, 4 * k + 3)
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
    return g0, g1, g2, g3


@compiled
def push_ends(
    v: Rows, k: int, pushes: Ends, mean: Number, on: Mask, problem: Problem, solids: Solids | None
) -> None:
    """Give the ends of the edges of contact k, or the rigid bodies that they are of, −q times ``pushes``.

    ``mean`` is the energy Ū per Φ [J].
    """
    contacts = problem.contacts
    nothing = 0.0 * pushes[0]
    if solids is not None:
        push = push_ends_of_both(v, k, pushes, mean, on, problem, solids)
        set_row(contacts.taper, k, choose(on, push, nothing))
    else:
        g0, g1, g2, g3 = pushes
        i, j = load(contacts.particle, 4 * k), load(contacts.particle, 4 * k + 1)
        m, n = load(contacts.particle, 4 * k + 2), load(contacts.particle, 4 * k + 3)
        mi, mj = load_each(problem.inverse_mass, i), load_each(problem.inverse_mass, j)
        mm, mn = load_each(problem.inverse_mass, m), load_each(problem.inverse_mass, n)
        size = mi * dot(g0, g0) + mj * dot(g1, g1) + mm * dot(g2, g2) + mn * dot(g3, g3)
        q = gradient_impulse(problem.span, mean, size)
        set_row(contacts.taper, k, choose(on, q * (g0 + g1), nothing))
        push_one(v, i, q * mi, g0, on)
        push_one(v, j, q * mj, g1, on)
        push_one(v, m, q * mm, g2, on)
        push_one(v, n, q * mn, g3, on)


@compiled
def steepness(y: Number) -> Number:
    """Return the slope of `smooth`."""
    y = minimum(maximum(y, 0.0), 1.0)
    return 6.0 * y * (1.0 - y)


# --- What is told of pairs ----------------------------------------------------------------------------


@compiled
def add_totals(v: Rows, problem: Problem, changing: np.ndarray) -> None:
    """Add what the contacts did at this node to the totals, and find what pairs lost."""
    pairs, contacts, totals = problem.pairs, problem.contacts, problem.totals
    clear_current(True, totals, changing)
    for n in range(contacts.length[MET]):
        p = contacts.met[n]
        add_to(totals, p, OVERFLOW, load(contacts.left_out, p))
    for k in range(problem.rows):
        p = contacts.pair[k]
        push, reach, d = load(contacts.impulse, k), pairs.reach[p], load(contacts.gap, k)
        u0 = load(contacts.approach, k)
        first, last = ends(v, k, reach, problem)
        c = load(pairs.strength, p) * load(contacts.share, k)
        before, after = barrier_energy(first, c, reach), barrier_energy(last, c, reach)
        there, touches = d < 0.5 * FAR, push > 0.0
        set_touching(touches, p, totals)
        set_least_gap(select(there, last, FAR), p, totals)
        add_to(totals, p, IMPULSE, push)
        add_to(totals, p, ENERGY, select(there, 0.5 * (before + after), 0.0))
        given = select(there, before - after, 0.0)
        lost = lost_by(v, k, given, problem, pairs.loss)
        add_to(totals, p, CONTACT, lost)
        add_loss(contacts, p, 0, lost)
        add_loss(contacts, p, 2, given)
        fast = select(touches, maximum(u0, -u0), 0.0)
        at = p * ENTRIES + FASTEST
        store(totals, at, maximum(load(totals, at), fast))
        quick = fast * problem.span.whole > QUICK * reach
        add_to(totals, p, FAST, select(quick, 1.0 + 0.0 * push, 0.0))


@compiled
def start_totals(fresh: Mask, problem: Problem, changing: np.ndarray) -> None:
    """Set the totals of ``fresh`` copies to what their contacts are before any step."""
    pairs, contacts, totals = problem.pairs, problem.contacts, problem.totals
    clear_current(fresh, totals, changing)
    for k in range(problem.rows):
        p = contacts.pair[k]
        d, reach = load(contacts.gap, k), pairs.reach[p]
        gap = maximum(d, LOW * reach)
        there = select(d < 0.5 * FAR, select(fresh, 1.0 + 0.0 * d, 0.0), 0.0) > 0.5
        energy = barrier_energy(gap, load(pairs.strength, p) * load(contacts.share, k), reach)
        energy = select(there, energy, 0.0)
        set_touching(energy > 0.0, p, totals)
        set_least_gap(select(there, gap, FAR), p, totals)
        add_to(totals, p, ENERGY, energy)


@compiled
def clear_current(where: Mask, totals: Numbers, changing: np.ndarray) -> None:
    """Clear what is told of one node alone: who touches, and the energy in the barriers."""
    for m in range(1, entry_of(changing, 0) + 1):
        p = entry_of(changing, m)
        for entry in (TOUCHING, ENERGY):
            n = p * ENTRIES + entry
            store(totals, n, select(where, 0.0, load(totals, n)))


@compiled
def set_touching(touches: Mask, pair: int, totals: Numbers) -> None:
    """Say that a pair touches, where it does."""
    n = pair * ENTRIES + TOUCHING
    store(totals, n, select(touches, 1.0, load(totals, n)))


@compiled
def set_least_gap(gap: Number, pair: int, totals: Numbers) -> None:
    """Keep the least gap of a pair [m]."""
    n = pair * ENTRIES + GAP
    store(totals, n, minimum(load(totals, n), gap))


@compiled
def lost_by(v: Rows, k: int, given: Number, problem: Problem, loss: Numbers) -> Number:
    """Return the energy [J] that contact k lost: what the barrier gave, less the work of the impulse.

    Without loss they differ by what sweeps leave over, which is an error, and is not entered.
    """
    lost = 0.0 * given
    if loss is not None:
        span, contacts = problem.span, problem.contacts
        after = speed(v, k, problem, contacts.solids)
        rate = (span.lead * load(contacts.approach, k) + span.out * after) / span.whole
        lossy = load(loss, contacts.pair[k]) + lost > 0.0
        lost = select(lossy, given - load(contacts.impulse, k) * rate, 0.0)
    return lost


# --- Where a node is read -----------------------------------------------------------------------------


@compiled
def lift_apart(shift: Rows, v: Rows, problem: Problem) -> None:
    """Find how far to shift what is read [m], so that bodies are not shown in each other.

    A node lies amid two ways. Where these are long, a contact may be closed there that is open at both ends
    of the step: it is shown with half of the lower of both gaps, or of Δ. ``shift`` (N, 3) is 0 at first; of
    rigid bodies it has two rows for each, of which the first is used.
    """
    contacts = problem.contacts
    for _ in range(LIFTS):
        again = False
        for k in range(problem.rows):
            reach = problem.pairs.reach[contacts.pair[k]]
            first, last = ends(v, k, reach, problem)
            here = load(contacts.gap, k) + speed(shift, k, problem, contacts.solids)
            short = 0.5 * minimum(minimum(first, last), reach) - here
            on = select(load(contacts.inverse_mass, k) > 0.0, short, 0.0) > 0.0
            if any_lane(on):
                shift_apart(shift, k, short, on, problem, contacts.solids)
                again = True
        if not again:
            break


@compiled
def shift_apart(
    shift: Rows, k: int, short: Number, on: Mask, problem: Problem, solids: Solids | None
) -> None:
    """Shift what contact k touches by ``short`` [m] in all along its normal, in some lanes: the heavier less.

    What turns as one is not turned.
    """
    pairs, contacts = problem.pairs, problem.contacts
    n = row(contacts.normal, k)
    if solids is not None:
        a, b = pairs.first[contacts.pair[k]], pairs.second[contacts.pair[k]]
        both = load(solids.lightness, a) + load(solids.lightness, b)
        size = select(both > 0.0, short / (both + TINY), 0.0)
        push_body(shift, a, size, n, 0.0 * n, on, solids)
        push_body(shift, b, -1.0 * size, n, 0.0 * n, on, solids)
    else:
        inverse = load(contacts.inverse_mass, k)
        push_members(shift, k, short / (inverse + TINY) * n, on, contacts)
