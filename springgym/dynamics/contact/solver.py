"""The impulses of contacts at the node of a step, where all impulses act at once.

A row k is a contact of two bodies, or of a body and a surface: a gap d with the normal n, from the second
side to the first, between two sides (`springgym.dynamics.contact.movers`). Its impulse J n changes the gap's
rate u = n · (v₁ − v₂) by W J, and follows from the gap h₀ where the step begins, and the gap a = h₀ + h (u₀ +
u)/2 where it would end without this contact (`springgym.dynamics.contact.law`). Friction is a tangential
impulse j that stops slip, as far as Coulomb's cone allows (`springgym.dynamics.contact.cone`), and a couple q
may resist turning. All depend on each other, and are found in alternating forward and backward sweeps
(symmetric Gauss–Seidel), from those of the last node (`springgym.dynamics.contact.warm`).

All impulses of a contact act at the positions of the node, along the line between its points or at one point,
so that they conserve momentum and angular momentum to rounding, whatever their size; each changes the kinetic
energy by its product with the mean velocity, before and after the node.

Where a round feature rolls on a surface, friction acts on the slip of the point that touches at the end of
the step, with the arm and the inertia of the body at that time. Otherwise static friction would be of first
order in h: a disk precesses 1.6 % too slowly.

The strength of an edge's contact depends on its place, which adds the force of its gradient. The impulse is q
∇Φ, q = h Ū/(1 + h² Ū G/2), G = Σ |∇ᵢΦ|²/mᵢ, bounded so that a step gains no more than this energy.
"""

from __future__ import annotations

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.core.language.lanes import any_lane, maximum, minimum, select, sqrt
from springgym.core.language.memory import load, load_each, store
from springgym.core.language.vectors import (
    GUARD,
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
from springgym.dynamics.contact.cone import part_resisted, within_cone
from springgym.dynamics.contact.features import TAPER, smooth
from springgym.dynamics.contact.friction import inverse_mass_along, push_across, set_tilt, slip_of
from springgym.dynamics.contact.law import barrier_energy, solve_gap
from springgym.dynamics.contact.movers import (
    inverse_mass_of,
    number_of,
    push,
    push_turning,
    slip_by_couple,
    spin_between,
    spun_by,
    turned,
    turns_as_one,
    velocity_between,
)
from springgym.dynamics.contact.totals import add_to, clear_current, set_fastest, set_least_gap, set_touching
from springgym.dynamics.records import (
    FAR,
    LEAST,
    PASSES,
    ContactCount,
    ContactRows,
    Ends,
    PairTotal,
    Problem,
    Resistance,
    Shapes,
    Turning,
)

LOW = 0.02
"""A gap below this fraction of Δ at a step's beginning counts as a missed contact, and is raised to it:
residuals of sweeps can bring contacts nearer than solved for, and their energy is unbounded."""

ROLLED = 1e-5
"""A gap of a rolling contact below this fraction of Δ is raised, others remain: its point of contact moved so
far over the skin in a step, as on a coin that falls flat, that it is behind the surface."""

TAKEN = 0.2
"""The fraction of Δ to which such a gap is raised: it is pushed out gently, and not within a step."""


# --- What rows follow from ----------------------------------------------------------------------------


@compiled
def prepare(k: int, free: Rows, problem: Problem) -> None:
    """Compute the approach of contact k, its inverse mass, and its gaps; reset its impulses.

    ``free`` are the velocities after the node without contact. Before the call, the gap of a contact with a
    surface is that at the end of the step without contact.
    """
    span = problem.span
    contacts = problem.contacts
    n = row(contacts.normal, k)
    store(contacts.inverse_mass, k, prepare_row(k, problem))
    u0 = dot(n, velocity_between(problem.before, k, 0, problem))
    store(contacts.approach, k, u0)
    store(contacts.impulse, k, 0.0)
    set_row(contacts.friction, k, vec(0.0, 0.0, 0.0))
    set_row(contacts.taper, k, vec(0.0, 0.0, 0.0))
    clear_couple(k, contacts, problem.pairs.resistance)
    d = load(contacts.gap, k)
    low = LOW * reach_of(k, problem)
    if contacts.surface[k] >= 0:
        store(contacts.gap, k, d - span.out * dot(n, velocity_between(free, k, 0, problem)))
        before = load(contacts.start, k)
    else:
        before = d - span.lead * u0
    missed = before < low
    add_to(problem.totals, contacts.pair[k], PairTotal.MISSES, select(missed, 1.0 + 0.0 * u0, 0.0))
    if contacts.at_end[k] == 1:
        taken = select(before < ROLLED * reach_of(k, problem), TAKEN * reach_of(k, problem), before)
    else:
        taken = maximum(before, low)
    store(contacts.start, k, taken)
    store(contacts.shift, k, taken - before)
    store(contacts.gap, k, load(contacts.gap, k) + (taken - before))


@compiled
def clear_couple(k: int, contacts: ContactRows, resistance: Resistance | None) -> None:
    """Set the couple of contact k to zero, if any turning is resisted."""
    if resistance is not None:
        set_row(contacts.couple, k, vec(0.0, 0.0, 0.0))


@compiled
def prepare_row(k: int, problem: Problem) -> Number:
    """Return the effective inverse mass W [1/kg] of contact k, and store how its impulse moves particles."""
    contacts = problem.contacts
    n = row(contacts.normal, k)
    total = inverse_mass_of(n, 0, k, problem, contacts.turning)
    only = contacts.only[k]
    if only >= 0:
        gain = load(problem.inverse_mass, only)
        store(contacts.gain, 4 * k, gain)
        return gain * dot(n, n)
    for m in range(number_of(k, contacts.loose)):
        weight = load(contacts.weight, 4 * k + m)
        gain = weight * load_each(problem.inverse_mass, load(contacts.particle, 4 * k + m))
        store(contacts.gain, 4 * k + m, gain)
        total = total + weight * gain
    set_tilt(k, problem)
    return total


# --- Sweeps -------------------------------------------------------------------------------------------


@compiled
def solve(v: Rows, sweeps: int, enough: float, tapers: bool, problem: Problem) -> None:
    """Find all impulses, and apply them to the velocities ``v``.

    A copy's sweeps end after one that changes no gap by more than ``enough`` Δ. If ``tapers``, gradients of Φ
    act after the first.
    """
    contacts = problem.contacts
    for turn in range(sweeps):
        store(contacts.change, 0, 0.0)
        for m in range(contacts.length[ContactCount.ROWS]):
            k = contacts.length[ContactCount.ROWS] - 1 - m if turn % 2 == 1 else m
            solve_row(v, k, problem)
        if turn == 0 and tapers:
            taper(v, problem, problem.pairs.shapes)
        going = select(load(contacts.change, 0) > enough, load(contacts.going, 0), 0.0)
        store(contacts.going, 0, going)
        if not any_lane(going > 0.5):
            break


@compiled
def solve_row(v: Rows, k: int, problem: Problem) -> None:
    """Find the impulses of contact k from the current ones of all others."""
    span = problem.span
    contacts = problem.contacts
    reach = reach_of(k, problem)
    inverse = load(contacts.inverse_mass, k)
    old = load(contacts.impulse, k)
    n = row(contacts.normal, k)
    start = load(contacts.start, k)
    last = load(contacts.gap, k) + span.out * dot(n, velocity_between(v, k, 0, problem))
    free = last - span.out * inverse * old
    going = select(inverse > 0.0, load(contacts.going, 0), 0.0)
    meets = select(going > 0.5, minimum(start, free), FAR) < reach
    if any_lane(select(meets, 1.0, going * old) > 0.0):  # an earlier impulse may have to be taken back
        c = strength_of(k, problem) * inverse
        beta = beta_of(k, inverse, problem, problem.pairs.loss)
        gaps = start, free, select(old > 0.0, last, 0.0)
        change, _ = solve_gap(gaps, span, c, reach, beta, meets)
        new = select(meets, change / (inverse + GUARD), 0.0)
        new = select(going > 0.5, new, old)
        store(contacts.impulse, k, new)
        push(v, k, (new - old) * n, problem)
        moved = span.whole * inverse * maximum(new - old, old - new) / reach
        store(contacts.change, 0, maximum(load(contacts.change, 0), moved))
        apply_friction(v, k, going > 0.5, problem, problem.pairs.friction)


@compiled
def reach_of(k: int, problem: Problem) -> float:
    """Return the range Δ of contact k [m]: the gap below which its barrier acts."""
    return problem.pairs.reach[problem.contacts.pair[k]]


@compiled
def strength_of(k: int, problem: Problem) -> Number:
    """Return c Φ of contact k [N·m²]."""
    return load(problem.pairs.strength, problem.contacts.pair[k]) * load(problem.contacts.share, k)


@compiled
def beta_of(k: int, like: Number, problem: Problem, loss: Numbers | None) -> Number:
    """Return the loss factor β [1] of contact k; 0 if no contact of the scene loses energy."""
    beta = 0.0 * like
    if loss is not None:
        beta = beta + load(loss, problem.contacts.pair[k])
    return beta


@compiled
def ends(v: Rows, k: int, problem: Problem) -> tuple[Number, Number]:
    """Return the gaps of contact k when the step begins and when it ends [m]."""
    contacts = problem.contacts
    u = dot(row(contacts.normal, k), velocity_between(v, k, 0, problem))
    last = load(contacts.gap, k) + problem.span.out * u
    return load(contacts.start, k), maximum(last, LOW * reach_of(k, problem))


# --- Friction -----------------------------------------------------------------------------------------


@compiled
def apply_friction(v: Rows, k: int, going: Mask, problem: Problem, mu: Numbers | None) -> None:
    """Apply friction, and a couple if turning is resisted, against slip and turning in contact k.

    The limit of friction, μ J, is constant within a call.
    """
    if mu is not None:
        contacts = problem.contacts
        n = row(contacts.normal, k)
        pressed = sqrt(dot(n, n)) * load(contacts.grips, k) * load(contacts.impulse, k)
        limit = load(mu, contacts.pair[k]) * pressed
        friction = row(contacts.friction, k)
        acts = select(going, maximum(limit, dot(friction, friction)), 0.0) > 0.0
        if any_lane(acts):  # earlier friction may have to be taken back
            resists = resisted(k, contacts, problem.pairs.resistance)
            if resists:
                begin_to_hold(v, k, limit, acts, problem, problem.pairs.resistance)
            for _ in range(PASSES if resists else 1):
                if resists:
                    stop_turning(v, k, pressed, acts, problem, problem.pairs.resistance)
                stop_slip(v, k, limit, acts, problem)


@compiled
def stop_slip(v: Rows, k: int, limit: Number, acts: Mask, problem: Problem) -> None:
    """Apply the friction that stops the slip of contact k, or as much as the ``limit`` allows [N·s]."""
    contacts = problem.contacts
    friction = row(contacts.friction, k)
    slip = slip_of(v, k, contacts.at_end[k], problem)
    along = 1.0 / (sqrt(dot(slip, slip)) + GUARD) * slip
    inverse = inverse_mass_along(along, k, problem)
    change = within_cone(friction - 1.0 / (inverse + GUARD) * slip, limit) - friction
    change = choose(acts, change, 0.0 * change)
    set_row(contacts.friction, k, friction + change)
    push_across(v, k, change, problem)
    moved = problem.span.whole * inverse * sqrt(dot(change, change)) / reach_of(k, problem)
    store(contacts.change, 0, maximum(load(contacts.change, 0), moved))


@compiled
def resisted(k: int, contacts: ContactRows, resistance: Resistance | None) -> bool:
    """Return whether the turning of contact k is resisted."""
    if resistance is None:
        return False
    p = contacts.pair[k]
    turns = turns_as_one(contacts.body[2 * k], contacts.turning)
    turns = turns or turns_as_one(contacts.body[2 * k + 1], contacts.turning)
    return turns and resistance.rolling[p] + resistance.torsional[p] > 0.0


@compiled
def begin_to_hold(
    v: Rows, k: int, limit: Number, acts: Mask, problem: Problem, resistance: Resistance | None
) -> None:
    """Start friction of contact k with the impulse that stops its slip if a couple stops its rolling.

    With that couple, an impulse of 1 along s changes the slip by K and by the effect of the couple that stops
    the rolling due to s.
    """
    if resistance is not None:
        contacts = problem.contacts
        turning = problem.contacts.turning
        friction = row(contacts.friction, k)
        couple = row(contacts.couple, k)
        fresh = select(acts, dot(friction, friction) + dot(couple, couple), 1.0) <= 0.0
        if any_lane(fresh):
            slip = slip_of(v, k, contacts.at_end[k], problem)
            slip = without_rolling(slip, spin_between(v, k, problem, turning), k, problem)
            along = 1.0 / (sqrt(dot(slip, slip)) + GUARD) * slip
            whole = inverse_mass_along(along, k, problem)
            by_rolling = without_rolling(0.0 * along, spun_by(along, True, k, problem, turning), k, problem)
            inverse = maximum(whole + dot(along, by_rolling), LEAST * whole)
            j = within_cone(-1.0 / (inverse + GUARD) * slip, limit)
            j = choose(fresh, j, 0.0 * j)
            push_across(v, k, j, problem)
            set_row(contacts.friction, k, friction + j)


@compiled
def without_rolling(slip: Vector, rate: Vector, k: int, problem: Problem) -> Vector:
    """Return the slip at contact k after a couple that stops all rolling at an angular velocity ``rate``."""
    n = row(problem.contacts.normal, k)
    square = dot(n, n)
    rolls = rate - dot(rate, n) / square * n
    slip = slip + slip_by_couple(couple_against(rolls, k, problem), k, problem, problem.contacts.turning)
    return slip - dot(slip, n) / square * n


@compiled
def couple_against(rate: Vector, k: int, problem: Problem) -> Vector:
    """Return the couple that stops an angular velocity along its own direction."""
    direction = 1.0 / (sqrt(dot(rate, rate)) + GUARD) * rate
    gives = dot(direction, spun_by(direction, False, k, problem, problem.contacts.turning)) + GUARD
    return -1.0 / gives * rate


@compiled
def stop_turning(
    v: Rows, k: int, pressed: Number, acts: Mask, problem: Problem, resistance: Resistance | None
) -> None:
    """Apply couples that stop rolling and then spinning in contact k, as far as ``pressed`` allows."""
    if resistance is not None:
        contacts = problem.contacts
        turning = problem.contacts.turning
        n = row(contacts.normal, k)
        n = 1.0 / sqrt(dot(n, n)) * n
        for part in range(2):
            old = row(contacts.couple, k)
            rate, resisting, limit = part_resisted(
                part, spin_between(v, k, problem, turning), old, n, pressed, resistance, contacts.pair[k]
            )
            change = within_cone(resisting + couple_against(rate, k, problem), limit) - resisting
            change = choose(acts, change, 0.0 * change)
            set_row(contacts.couple, k, old + change)
            push_turning(v, k, 0.0 * change, change, problem, turning)
            slip = slip_by_couple(change, k, problem, turning)
            moved = problem.span.whole * sqrt(dot(slip, slip)) / reach_of(k, problem)
            store(contacts.change, 0, maximum(load(contacts.change, 0), moved))


# --- Where edges meet ---------------------------------------------------------------------------------


@compiled
def taper(v: Rows, problem: Problem, shapes: Shapes | None) -> None:
    """Apply the force of the gradient of Φ, where edges touch."""
    if shapes is not None:
        contacts = problem.contacts
        for k in range(problem.contacts.length[ContactCount.ROWS]):
            share = load(contacts.share, k)
            partly = select(share < 1.0, share, 0.0) > 0.0
            if contacts.members[k] == 4 and any_lane(partly):
                reach = reach_of(k, problem)
                first, last = ends(v, k, problem)
                c = strength_of(k, problem) / select(partly, share, 1.0)
                mean = 0.5 * (barrier_energy(first, c, reach) + barrier_energy(last, c, reach))
                on = select(partly, mean, 0.0) > 0.0
                if any_lane(on):
                    push_ends(v, k, gradient_of_share(k, on, problem), mean, on, problem)


@compiled
def gradient_of_share(k: int, on: Mask, problem: Problem) -> Ends:
    """Return ∇Φ by each of the four ends of the two edges in contact k [1/m].

    With D = r + s a − t b, D·a = D·b = 0 determines the changes of s and t with the four points; lengths are
    constant.
    """
    contacts = problem.contacts
    x = problem.x
    parallel = problem.pairs.parallel[problem.contacts.pair[k]]
    i = load(contacts.particle, 4 * k)
    j = load(contacts.particle, 4 * k + 1)
    m = load(contacts.particle, 4 * k + 2)
    n = load(contacts.particle, 4 * k + 3)
    here = row_each(x, i)
    there = row_each(x, m)
    a = row_each(x, j) - here
    b = row_each(x, n) - there
    r = here - there
    across = cross(a, b)
    square = select(on, dot(across, across), 1.0)
    inverse = 1.0 / square
    aa = dot(a, a)
    ab = dot(a, b)
    bb = dot(b, b)
    ar = dot(a, r)
    br = dot(b, r)
    s = (ab * br - bb * ar) * inverse
    t = (aa * br - ab * ar) * inverse
    scale = 1.0 / (TAPER * reach_of(k, problem))
    la = sqrt(aa) * scale
    lb = sqrt(bb) * scale
    sine = 1.0 / parallel
    s0 = smooth(s * la)
    s1 = smooth((1.0 - s) * la)
    t0 = smooth(t * lb)
    t1 = smooth((1.0 - t) * lb)
    both = 1.0 / (aa * bb + GUARD)
    angle = square * both * sine
    turned = smooth(angle)
    by_s = (steepness(s * la) * s1 - s0 * steepness((1.0 - s) * la)) * la * t0 * t1 * turned
    by_t = (steepness(t * lb) * t1 - t0 * steepness((1.0 - t) * lb)) * lb * s0 * s1 * turned
    by_angle = -2.0 * ab * both * (s0 * s1 * t0 * t1 * steepness(angle) * sine)
    by_a = by_angle * (b - ab / (aa + GUARD) * a)
    by_b = by_angle * (a - ab / (bb + GUARD) * b)
    # derivatives of Φ, through s and t, by D·a and D·b
    along_a = -(bb * by_s + ab * by_t) * inverse
    along_b = (ab * by_s + aa * by_t) * inverse
    apart = r + (s * a - t * b)
    lever = along_a * a + along_b * b
    g0 = (1.0 - s) * lever - along_a * apart - by_a
    g1 = s * lever + along_a * apart + by_a
    g2 = (t - 1.0) * lever - along_b * apart - by_b
    g3 = -t * lever + along_b * apart + by_b
    return g0, g1, g2, g3


@compiled
def push_ends(v: Rows, k: int, pushes: Ends, mean: Number, on: Mask, problem: Problem) -> None:
    """Apply −q times ``pushes`` to the ends of the edges of contact k; ``mean`` is the energy Ū per Φ [J]."""
    contacts = problem.contacts
    span = problem.span
    turning = problem.contacts.turning
    g0, g1, g2, g3 = pushes
    size = moved_by(0, k, g0, g1, problem, turning) + moved_by(1, k, g2, g3, problem, turning)
    q = (-1.0 * span.whole) * mean / (1.0 + (span.out * span.whole) * mean * size)
    q = select(on, q, 0.0)
    set_row(contacts.taper, k, q * choose(on, g0 + g1, 0.0 * g0))
    nothing = 0.0 * g0
    push_edge(v, 0, k, choose(on, q * g0, nothing), choose(on, q * g1, nothing), problem, turning)
    push_edge(v, 1, k, choose(on, q * g2, nothing), choose(on, q * g3, nothing), problem, turning)
    moved = span.whole * sqrt(q * q * select(on, size, 0.0) * load(contacts.inverse_mass, k))
    store(contacts.change, 0, maximum(load(contacts.change, 0), moved / reach_of(k, problem)))


@compiled
def moment_of(side: int, k: int, first: Vector, second: Vector, problem: Problem, turning: Turning) -> Vector:
    """Return the moment [N·m·s] of two impulses at the ends of one side's edge, about its body's point."""
    particle = problem.contacts.particle
    point = row(turning.point, problem.contacts.body[2 * k + side])
    i = load(particle, 4 * k + 2 * side)
    j = load(particle, 4 * k + 2 * side + 1)
    return cross(row_each(problem.x, i) - point, first) + cross(row_each(problem.x, j) - point, second)


@compiled
def moved_by(
    side: int, k: int, first: Vector, second: Vector, problem: Problem, turning: Turning | None
) -> Number:
    """Return twice the kinetic energy [J] that two impulses at the ends of an edge give a side at rest."""
    contacts = problem.contacts
    body = problem.contacts.body[2 * k + side]
    if turning is not None and turns_as_one(body, turning):
        both = first + second
        moment = moment_of(side, k, first, second, problem, turning)
        return load(turning.lightness, body) * dot(both, both) + dot(moment, turned(body, 0, moment, turning))
    i = load(contacts.particle, 4 * k + 2 * side)
    j = load(contacts.particle, 4 * k + 2 * side + 1)
    one = load_each(problem.inverse_mass, i)
    other = load_each(problem.inverse_mass, j)
    return one * dot(first, first) + other * dot(second, second)


@compiled
def push_edge(
    v: Rows, side: int, k: int, first: Vector, second: Vector, problem: Problem, turning: Turning | None
) -> None:
    """Apply two impulses [N·s] to the ends of one side's edge."""
    contacts = problem.contacts
    body = problem.contacts.body[2 * k + side]
    if turning is not None and turns_as_one(body, turning):
        n = turning.first[body]
        set_row(v, n, plus_scaled(row(v, n), load(turning.lightness, body), first + second))
        set_row(v, n + 1, row(v, n + 1) + moment_of(side, k, first, second, problem, turning))
    else:
        for end in range(2):
            i = load(contacts.particle, 4 * k + 2 * side + end)
            impulse = first if end == 0 else second
            set_row_each(v, i, plus_scaled(row_each(v, i), load_each(problem.inverse_mass, i), impulse))


@compiled
def steepness(y: Number) -> Number:
    """Return the slope of `smooth`."""
    y = minimum(maximum(y, 0.0), 1.0)
    return 6.0 * y * (1.0 - y)


# --- Totals -------------------------------------------------------------------------------------------


@compiled
def add_totals(v: Rows, problem: Problem, changing: np.ndarray) -> None:
    """Add the results of the contacts at this node to the totals, and compute the losses of bodies."""
    contacts = problem.contacts
    totals = problem.totals
    clear_current(True, totals, changing)
    for m in range(contacts.length[ContactCount.PAIRS]):
        p = contacts.touching_pairs[m]
        add_to(totals, p, PairTotal.OVERFLOW, load(contacts.left_out, p))
    for k in range(problem.contacts.length[ContactCount.ROWS]):
        p = contacts.pair[k]
        impulse = load(contacts.impulse, k)
        n = row(contacts.normal, k)
        u0 = load(contacts.approach, k)
        reach = reach_of(k, problem)
        c = strength_of(k, problem)
        u1 = dot(n, velocity_between(v, k, 0, problem))
        first, last = ends(v, k, problem)
        there = load(contacts.gap, k) < 0.5 * FAR
        touches = impulse > 0.0
        before = barrier_energy(first, c, reach)
        after = barrier_energy(last, c, reach)
        add_to(totals, p, PairTotal.IMPULSE, impulse)
        set_least_gap(select(there, last, FAR), p, totals)
        if contacts.surface[k] < 0:
            set_touching(touches, p, totals)
            add_to(totals, p, PairTotal.ENERGY, select(there, after, 0.0))
        # without loss they differ by the residual of the sweeps, an error that is not entered
        lossy = select(there, beta_of(k, impulse, problem, problem.pairs.loss), 0.0) > 0.0
        lost = select(lossy, before - after - 0.5 * impulse * (u0 + u1), 0.0)
        rubbed = lost_to_friction(v, k, problem, problem.pairs.friction)
        add_losses(k, lost, rubbed, problem)
        fast = select(touches, maximum(u0, -u0), 0.0)
        set_fastest(fast, p, totals)
        add_to(
            totals, p, PairTotal.COARSE, select(fast > problem.pairs.coarse_from[p], 1.0 + 0.0 * impulse, 0.0)
        )


@compiled
def lost_to_friction(v: Rows, k: int, problem: Problem, mu: Numbers | None) -> Number:
    """Return the energy dissipated by friction and couple of contact k [J], by their mean rates."""
    lost = 0.0 * load(problem.contacts.gap, k)
    if mu is not None:
        friction = row(problem.contacts.friction, k)
        if any_lane(dot(friction, friction) > 0.0):
            slip = slip_of(v, k, 0, problem) + slip_of(problem.before, k, 0, problem)
            lost = lost - 0.5 * dot(friction, slip)
        lost = lost + lost_to_couple(v, k, problem, problem.pairs.resistance)
    return lost


@compiled
def lost_to_couple(v: Rows, k: int, problem: Problem, resistance: Resistance | None) -> Number:
    """Return the energy that the couple of contact k dissipates [J]."""
    lost = 0.0 * load(problem.contacts.gap, k)
    if resistance is not None:
        turning = problem.contacts.turning
        rate = spin_between(v, k, problem, turning) + spin_between(problem.before, k, problem, turning)
        lost = -0.5 * dot(row(problem.contacts.couple, k), rate)
    return lost


@compiled
def add_losses(k: int, lost: Number, rubbed: Number, problem: Problem) -> None:
    """Add the losses of contact k to restitution and to friction [J] to its pair and to its bodies.

    Each of two bodies takes half; at a surface the body takes all.
    """
    contacts = problem.contacts
    add_to(problem.totals, contacts.pair[k], PairTotal.CONTACT, lost)
    add_to(problem.totals, contacts.pair[k], PairTotal.FRICTION, rubbed)
    among = contacts.surface[k] < 0
    share = 0.5 if among else 1.0
    for side in range(2 if among else 1):
        body = contacts.body[2 * k + side]
        store(contacts.losses, (body, 0), load(contacts.losses, (body, 0)) + share * lost)
        store(contacts.losses, (body, 1), load(contacts.losses, (body, 1)) + share * rubbed)


@compiled
def start_totals(fresh: Mask, problem: Problem, changing: np.ndarray) -> None:
    """Set the totals of ``fresh`` copies from their contacts before any step."""
    contacts = problem.contacts
    totals = problem.totals
    clear_current(fresh, totals, changing)
    for k in range(problem.contacts.length[ContactCount.ROWS]):
        p = contacts.pair[k]
        d = load(contacts.gap, k)
        reach = reach_of(k, problem)
        gap = maximum(d, LOW * reach)
        there = select(d < 0.5 * FAR, select(fresh, 1.0 + 0.0 * d, 0.0), 0.0) > 0.5
        energy = select(there, barrier_energy(gap, strength_of(k, problem), reach), 0.0)
        set_touching(energy > 0.0, p, totals)
        set_least_gap(select(there, gap, FAR), p, totals)
        add_to(totals, p, PairTotal.ENERGY, energy)
