"""The law of contact: an inverse-square barrier with a constant restitution, solved for the end of a step.

At a gap h < Δ with the rate ḣ, both sides of a contact are pushed apart along the normal with

    F = F_el(h) L(ḣ),    F_el = c/h² − c/Δ²,    L(v) = 1 − β v/√(v² + w²),    β = (1 − e²)/(1 + e²).

F_el is equation 8 of McDonald's paper; its energy is U(h) = c (Δ − h)²/(h Δ²). L is the loss. Far above the
speed w, L is 1 + β on the way in and 1 − β on the way out: half of m v₀² is (1 + β) U at the turn, and half
of m v₁² is (1 − β) U, so that v₁/v₀ = √((1 − β)/(1 + β)) = e, for every c, Δ and m. Near the turn, and below
w, the loss is that of a damper: slow impacts lose less, and resting contact is damped. As 0 ≤ L ≤ 2, contact
never pulls, and a restitution of 0 is a finite loss. (Hunt and Crossley's loss, J. Appl. Mech. 42 (1975) 440,
which grows with ḣ, has a restitution that falls with the speed of impact.)

No integrator samples this force. In a step of τ seconds from gap h₀ to h₁ it has the size of the exact
discrete gradient F̄ = −(U(h₁) − U(h₀))/(h₁ − h₀), so that its work is −(U(h₁) − U(h₀)) whatever other forces
act (Gonzalez, J. Nonlinear Sci. 6 (1996) 449, doi:10.1007/BF02440162), and the loss is that of the mean rate.
An impulse acts at the node of the step, and the step ends t = τ/2 later. With W the inverse of the effective
mass and a the gap at the end without this contact,

    h₁ = a + G F̄(h₀, h₁) L((h₁ − h₀)/τ),    G = t τ W.

F̄ and L fall as h₁ rises and are not negative: there is one root, and h₁ > 0 for every step and speed. The
energy of the step changes by −J V (1 − L), with J = τ F̄ and the mean rate V = (h₁ − h₀)/τ: a loss, or 0.
"""

from __future__ import annotations

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Mask, Number
from springgym.core.language.lanes import any_lane, epsilon, maximum, minimum, select, sqrt
from springgym.dynamics.records import Times

SLOW = 0.004
"""Speed w [m/s] of approach or retreat below which the loss is that of a linear damper."""

LEAST = 1e-9
"""The least gap at a step's beginning and end, in units of Δ; 1e-6 in single precision."""

ITERATIONS = 60
"""Largest number of Newton iterations for a gap; about three suffice where the bracket is not halved."""

FOUND = 1e-5
"""Relative change of a gap at which Newton's method ends, which squares the error each time."""

EXACT = 1e-7
"""The same of contacts without loss, which conserve energy to rounding."""


@compiled
def least_gap(like: Number) -> Number:
    """Return the least gap in units of Δ, which replaces smaller ones; ``like`` gives the precision."""
    return LEAST + 8 * epsilon(like)


@compiled
def positive_root(linear: Number, product: Number) -> Number:
    """Return the h > 0 with h² + linear h = product ≥ 0, without cancellation."""
    root = sqrt(linear * linear + 4.0 * product)
    rising = linear > 0.0
    size = select(rising, linear, -linear) + root
    return select(rising, 2.0 * product, size) / select(rising, size, 2.0)


@compiled
def mean_force(start: Number, end: Number, on: Mask) -> tuple[Number, Number, Number, Number]:
    """Return N and D of the mean force F̄ = c/Δ² N/D between two gaps, and their derivatives by ``end``.

    Gaps are in units of Δ. The results are valid only where a contact is ``on``.
    """
    product = start * end
    n = 1.0 - product
    d = product
    n_slope = -1.0 * start
    d_slope = start
    if any_lane(select(on, maximum(start, end), 0.0) >= 1.0):
        before = maximum(1.0 - start, 0.0)
        after = maximum(1.0 - end, 0.0)
        way = end - start
        leaves = end >= 1.0
        enters = start >= 1.0
        n = select(leaves, before * before, n)
        n_slope = select(leaves, 0.0, n_slope)
        d = select(leaves, start * way, d)
        n = select(enters, after * after, n)
        n_slope = select(enters, -2.0 * after, n_slope)
        d = select(enters, -1.0 * end * way, d)
        d_slope = select(enters, start - 2.0 * end, d_slope)
        d = select(minimum(start, end) >= 1.0, 1.0, d)  # out of reach; n is 0
    return n, d, n_slope, d_slope


@compiled
def first_guess(start: Number, free: Number, gain: Number, pace: Number, beta: Number, on: Mask) -> Number:
    """Return a first guess of the gap that `last_gap` finds: exact without loss if the step begins below Δ.

    It is that of one Newton iteration from σ, where ρ = 0, if this gives |ρ| < 1, as for resting contacts;
    else that for rates far above w, with L = 1 + β or 1 − β, on the side of σ where the solution is.
    """
    inside = start < 1.0
    nearer = maximum(1.0 - start, 0.0)
    closing = closes(start, free, gain)
    energy = nearer * nearer / start
    strength = gain * select(closing, 1.0 + beta, 1.0 - beta)
    end = positive_root(strength - free, strength / start)
    leaving = select(on, select(inside, end, 0.0), 0.0) > 1.0
    if any_lane(leaving):
        end = select(leaving, start + positive_root(start - free, strength * energy), end)
    force = gain * (1.0 - start * start)
    square = start * start
    moved = start - free
    calm = (force - moved * square) / (square + (moved + gain) * start + force * beta * pace)
    rests = select(inside, select(beta > 0.0, maximum(calm, -1.0 * calm) * pace, 1.0), 1.0) < 1.0
    return select(rests, start + calm, end)


@compiled
def closes(start: Number, free: Number, gain: Number) -> Mask:
    """Return whether the gap shrinks during the step, from the signs of both sides of the equation at σ."""
    return (start - free) * start * start > gain * maximum(1.0 - start, 0.0) * (1.0 + start)


@compiled
def last_gap(
    start: Number, free: Number, gain: Number, pace: Number, beta: Number, guess: Number, on: Mask
) -> Number:
    """Return the gap y at which a step ends, the root of the equation at the head of this file.

    In units of Δ, ``start`` is σ = h₀/Δ, ``free`` is α = a/Δ, ``gain`` is γ = c G/Δ³, and ``pace`` is
    Δ/(τ w): ρ = (y − σ) pace is the gap's mean rate over w. With F̄ = c/Δ² N/D, the equation is

        (y − α) D = γ N (1 − β ρ/√q),    q = 1 + ρ².

    Its only quotient that depends on y is that with the root, so that a Newton iteration takes one division.
    The iteration starts from ``guess`` if that is above 0, else from `first_guess`. An iteration that would
    leave the bracket halves it instead.
    """
    inside = start < 1.0
    nearer = maximum(1.0 - start, 0.0)
    closing = closes(start, free, gain)
    low = select(closing, maximum(free, 0.0), start)
    farthest = maximum(start, free) + 0.5 + gain * nearer * nearer / start
    high = select(closing, minimum(start, 1.0), maximum(farthest, 1.0))
    hard = select(inside, beta, 1.0) > 0.0
    end = guess
    one = 1.0 + 0.0 * free
    unknown = select(on, select(hard, select(guess > 0.0, 0.0, one), one), 0.0) > 0.5
    if any_lane(unknown):
        end = select(unknown, first_guess(start, free, gain, pace, beta, on), end)
    end = minimum(maximum(end, low), high)
    least = least_gap(free)
    finest = 4 * epsilon(free)
    zero = 0.0 * free
    enough = select(beta > 0.0, zero + FOUND, EXACT) + 16 * epsilon(free)
    slow = select(beta > 0.0, zero + 1.0 / pace, 0.0)
    active = select(on, select(hard, one, 0.0), 0.0)
    if any_lane(active > 0.5):
        for _ in range(ITERATIONS):
            here = maximum(end, least)
            n, d, n_slope, d_slope = mean_force(start, here, on)
            rate = (here - start) * pace
            q = 1.0 + rate * rate
            root = sqrt(q)
            way = here - free
            given = gain * n
            lossy = beta * rate
            steep = gain * n_slope
            wrong = (way * d - given) * root + given * lossy
            slope = (d + way * d_slope - steep) * root * q + steep * lossy * q + given * beta * pace
            above = wrong > 0.0
            high = select(above, here, high)
            low = select(above, low, here)
            new = here - wrong * q / slope
            new = select(minimum(new - low, high - new) >= 0.0, new, 0.5 * (low + high))
            change = maximum(new - here, here - new)
            end = select(active > 0.5, new, end)
            bend = maximum(maximum(here - start, start - here), slow)  # the way over which L changes
            bend = minimum(bend, select(inside, here, 1.0 - here))  # and F̄
            fine = maximum(enough * minimum(here, bend), finest * here)
            active = select(change > fine, active, 0.0)
            if not any_lane(active > 0.5):
                break
    return maximum(end, least)


@compiled
def solve_gap(
    gaps: tuple[Number, Number, Number], span: Times, c: Number, reach: Number, beta: Number, on: Mask
) -> tuple[Number, Number]:
    """Solve one contact for a step, where it is ``on``; elsewhere the results are not valid.

    ``gaps`` are h₀ at the beginning of the step, a at its end without this contact, and a guess of the gap at
    its end, 0 if there is none [m]; ``c`` is the strength times W [m³/s²], ``beta`` is β. ``span`` has the
    length of the step, and how long it lasts after the node.

    Returns
    -------
    J L W, the change of the gap's rate, and J W, what it would be without loss [m/s]
    """
    unit = 1.0 / reach
    start, free, guess = gaps
    first = maximum(start * unit, least_gap(free))
    strength = span.whole * c * (unit * unit)
    pace = reach / (SLOW * span.whole)
    end = last_gap(first, free * unit, span.out * strength * unit, pace, beta, guess * unit, on)
    n, d, _, _ = mean_force(first, end, on)
    rate = (end - first) * pace
    root = sqrt(1.0 + rate * rate)
    both = 1.0 / (d * root)
    push = strength * n * (root * both)
    return push * (1.0 - beta * rate * (d * both)), push


@compiled
def barrier_energy(gap: Number, c: Number, reach: Number) -> Number:
    """Return U [J] at a gap [m]; 0 for gaps above Δ."""
    depth = maximum(reach - gap, 0.0)
    return c * depth * depth / (maximum(gap, least_gap(gap) * reach) * (reach * reach))
