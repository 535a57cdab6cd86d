"""The law of contact: an inverse-square barrier with a constant restitution, solved for the end of a step.

Whatever touches, at a gap h < Δ and a gap's rate ḣ, is pushed apart along the normal with

    F = F_el(h) L(ḣ),    F_el = c/h² − c/Δ²,    L(v) = 1 − β v/√(v² + w²),    β = (1 − e²)/(1 + e²).

F_el is equation 8 of McDonald's paper; its energy is U(h) = c (Δ − h)²/(h Δ²). L is the loss. Far above the
speed w, L is 1 + β on the way in and 1 − β on the way out: half of m v₀² is (1 + β) U at the turn, and half
of m v₁² is (1 − β) U, so that v₁/v₀ = √((1 − β)/(1 + β)) = e, at every speed and for every c, Δ and m. Below
w the loss is that of a damper, so that what is slow comes to rest. As 0 ≤ L ≤ 2, contact never pulls, and a
restitution of 0 is a finite loss. (Hunt and Crossley's loss, J. Appl. Mech. 42 (1975) 440, which grows with
ḣ, has a restitution that falls with the speed of impact.)

No integrator samples this force. In a step of τ seconds from gap h₀ to h₁ it has the size of the exact
discrete gradient F̄ = −(U(h₁) − U(h₀))/(h₁ − h₀), so that its work is −(U(h₁) − U(h₀)) whatever else acts
(Gonzalez, J. Nonlinear Sci. 6 (1996) 449, doi:10.1007/BF02440162), and the loss is that of the mean rate. An
impulse acts at the node of the step; t seconds after it the step ends: half of τ, or τ of a copy that was
just placed. With W the inverse of the effective mass and a the gap that all else would end with,

    h₁ = a + G F̄(h₀, h₁) L((h₁ − h₀)/τ),    G = t τ W.

F̄ and L fall as h₁ rises and are not negative: there is one root, and h₁ > 0 for every step and speed. The
energy of the step changes by −J V (1 − L), with J = τ F̄ and the mean rate V = (h₁ − h₀)/τ: a loss, or 0.
"""

from __future__ import annotations

from typing import NamedTuple

from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number
from springgym.core.lanes import any_lane, epsilon, inverse_sqrt, maximum, minimum, select, sqrt

SLOW = 0.004
"""w [m/s]: what is in contact and slower than this is slowed as by a damper, and does not rebound."""

LEAST = 1e-9
"""The least gap of a step's beginning and end, as a share of Δ; 1e-6 in single precision."""

ROUNDS = 60
"""The most rounds of Newton's method for a gap; it takes some three where it need not halve its bracket."""

FOUND = 1e-7
"""The relative change of a gap at which Newton's method, which squares the error each time, has it."""


class Span(NamedTuple):
    """The time of a node: that of the drifts before and after it that are its own [s]."""

    lead: Number
    """h/2, or 0 of a fresh copy"""
    out: Number
    """h/2"""
    whole: Number
    """the sum"""


@compiled
def least_gap(reach: Number, like: Number) -> Number:
    """Return the gap [m] below which gaps are taken for it; ``like`` is any number of the step."""
    return (LEAST + 8 * epsilon(like)) * reach


@compiled
def positive_root(linear: Number, product: Number) -> Number:
    """Return the h > 0 with h² + linear h = product ≥ 0, without cancellation."""
    root = sqrt(linear * linear + 4.0 * product)
    rising = linear > 0.0
    size = select(rising, linear, -linear) + root
    return select(rising, 2.0 * product, size) / select(rising, size, 2.0)


@compiled
def mean_force(start: Number, end: Number, reach: Number, on: Mask) -> tuple[Number, Number]:
    """Return F̄/c [1/m²] between two gaps, and its derivative by the second, where a contact is ``on``."""
    flat, first, last = 1.0 / (reach * reach), 1.0 / start, 1.0 / end
    mean, slope = first * last - flat, -1.0 * first * last * last
    farther = select(on, maximum(start, end), 0.0)
    if any_lane(farther >= reach):
        before, after = maximum(reach - start, 0.0), maximum(reach - end, 0.0)
        way = end - start
        way = 1.0 / select(way < 0.0, minimum(way, -1e-30), maximum(way, 1e-30))
        across = (before * before * flat * first - after * after * flat * last) * way
        steep = (after * (reach + end) * flat * last * last - across) * way
        inside = farther < reach
        mean, slope = select(inside, mean, across), select(inside, slope, steep)
    return maximum(mean, 0.0), slope


@compiled
def loss_factor(rate: Number, beta: Number) -> tuple[Number, Number]:
    """Return L at a gap's rate [m/s], and its slope [s/m]."""
    inverse = inverse_sqrt(rate * rate + SLOW * SLOW)
    return 1.0 - beta * rate * inverse, -1.0 * beta * (SLOW * SLOW) * inverse * inverse * inverse


@compiled
def last_gap(
    start: Number, free: Number, gain: Number, tau: Number, reach: Number, beta: Number, on: Mask
) -> Number:
    """Return the gap h₁ [m] at which a step ends: the root of the equation at the head of this file.

    ``start`` is h₀, ``free`` is a, ``gain`` is c G [m³]. Whether h₁ < h₀ is known from both sides at h₀. If
    not, h − a − G F̄ L is concave, as F̄ and L are convex there; if so, (h − a)/(G F̄) − L is convex. So
    Newton's method, kept on its side of h₀, finds the root of every step. It begins with L at the rate
    without loss, and the root that follows from it: what neither enters nor loses is found by then.
    """
    flat, least = 1.0 / (reach * reach), least_gap(reach, free)
    inverse, pace, inside = 1.0 / start, 1.0 / tau, start < reach
    depth = maximum(reach - start, 0.0)
    energy = depth * depth * flat * inverse
    farthest = maximum(free - start, start - free) + sqrt(2.0 * gain * energy)
    closing = start - free > gain * maximum(inverse * inverse - flat, 0.0)
    low = select(closing, maximum(free, 0.0), start)
    high = select(closing, minimum(start, reach), maximum(start + farthest, reach))
    keep, end = 1.0 + 0.0 * free, start
    for attempt in range(2):
        strength = gain * keep
        end = positive_root(strength * flat - free, strength * inverse)
        leaving = select(on, select(inside, end, 0.0), 0.0) > reach
        if any_lane(leaving):
            end = select(leaving, start + positive_root(start - free, strength * energy), end)
        end = minimum(maximum(end, low), high)
        if attempt == 0:
            if not any_lane(select(on, beta, 0.0) > 0.0):
                break
            keep, _ = loss_factor((end - start) * pace, beta)
    enough, finest, slow = FOUND + 16 * epsilon(free), 4 * epsilon(free), SLOW * tau
    hard = select(inside, beta, 1.0) > 0.0
    active = select(on, select(hard, 1.0 + 0.0 * free, 0.0), 0.0)
    if any_lane(active > 0.5):
        for _ in range(ROUNDS):
            here = maximum(end, least)
            mean, slope = mean_force(start, here, reach, on)
            keep, less = loss_factor((here - start) * pace, beta)
            wrong = here - free - gain * mean * keep
            above = wrong > 0.0
            high, low = select(above, here, high), select(above, low, here)
            pull = select(closing, (here - free) / maximum(mean, 1e-30), gain * keep)
            new = here - wrong / (1.0 - minimum(slope, 0.0) * pull - gain * mean * less * pace)
            new = select(minimum(new - low, high - new) < 0.0, 0.5 * (low + high), new)
            change = maximum(new - here, here - new)
            end = select(active > 0.5, new, end)
            bend = maximum(maximum(here - start, start - here), slow)  # the way over which L changes
            fine = maximum(enough * minimum(here, select(beta > 0.0, bend, here)), finest * here)
            active = select(change > fine, active, 0.0)
            if not any_lane(active > 0.5):
                break
    return maximum(end, least)


@compiled
def meet(
    start: Number, free: Number, span: Span, c: Number, reach: Number, beta: Number, on: Mask
) -> tuple[Number, Number]:
    """Solve one contact for a step, where it is ``on``; elsewhere the numbers have no meaning.

    ``start`` is the gap h₀ [m] that the step begins with, ``free`` the gap a [m] that all else would end it
    with; ``c`` is the strength times W [m³/s²], ``beta`` is β. The `Span` says how long
    the step is, and how long it lasts after the node.

    Returns
    -------
    J L W, the change of the gap's rate, and J W, what it would be without loss [m/s]
    """
    start = maximum(start, least_gap(reach, free))
    end = last_gap(start, free, (span.out * span.whole) * c, span.whole, reach, beta, on)
    mean, _ = mean_force(start, end, reach, on)
    keep, _ = loss_factor((end - start) / span.whole, beta)
    push = span.whole * c * mean
    return push * keep, push


@compiled
def barrier_energy(gap: Number, c: Number, reach: Number) -> Number:
    """Return U [J] at a gap [m]; 0 out of reach."""
    depth = maximum(reach - gap, 0.0)
    return c * depth * depth / (maximum(gap, least_gap(reach, gap)) * (reach * reach))
