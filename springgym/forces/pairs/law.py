"""What a barrier does along a normal at a node, without and with loss.

With the heights h₀ and h₁ where the node's time begins and ends, τ seconds apart, and a the height that
would be reached without the barrier, the change of speed is

    Δu = τ F̄/m (1 − δ (h₁ − h₀)/τ)₊,    h₁ = a + t Δu,    F̄ = −(U(h₁) − U(h₀))/(h₁ − h₀),

with U = c (Δ − h)²/(h Δ²) for h < Δ, else 0, and t the drift after the node: τ/2, or τ if it begins at
the node. Without loss and with t = τ/2 the work of the impulse is exactly −(U(h₁) − U(h₀)), whatever else
acts (Gonzalez, J. Nonlinear Sci. 6 (1996) 449, doi:10.1007/BF02440162), and the law is symmetric in time.
"""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.kinds import Number
from springgym.lanes import any_lane, maximum, minimum, select, sqrt

ROUNDS = 30
"""Most rounds of Newton's method for a height; it squares the error each time."""

CONVERGED = 1e-7
"""Change of a height, as a share of it, at which Newton's method has it: the error left is the square."""

LEAST = 1e-6
"""A step begins and ends at this share of Δ or higher."""


@compiled
def positive_root(square: Number, linear: Number, product: Number) -> Any:
    """The smallest h > 0 with square h² + linear h = product, for product > 0, without cancellation."""
    root = sqrt(maximum(linear * linear + 4.0 * square * product, 0.0))
    rising = linear > 0.0
    size = select(rising, linear, -linear) + root
    return select(rising, 2.0 * product, size) / select(rising, size, 2.0 * square)


@compiled
def meet(start: Number, free: Number, span: Any, c: Number, reach: Number) -> Any:
    """The change of speed [m/s] by a barrier without loss.

    ``start`` is the height h₀ [m], ``free`` the height a, of which at least one must be less than ``reach``;
    ``c`` is the strength per mass [m³/s²].
    """
    start = maximum(start, LEAST * reach)
    gain, flat = (span.out * span.whole) * c, 1.0 / (reach * reach)
    inverse = 1.0 / start
    end = positive_root(1.0 + 0.0 * start, gain * flat - free, gain * inverse)
    mean = inverse / end - flat
    inside = start < reach
    leaving = select(inside, end, 0.0) > reach
    if any_lane(leaving):
        depth = reach - start
        energy = depth * depth * inverse * flat
        away = start - free  # (h - a)(h - h₀) = gain U(h₀), for the way h - h₀ > 0
        way = positive_root(1.0 + 0.0 * away, away, gain * energy)
        mean = select(leaving, energy / way, mean)
    entering = start >= reach
    if any_lane(entering):
        low, high = maximum(free, 0.0), reach + 0.0 * free
        guess = minimum(maximum(end, low), high)
        active = select(entering, 1.0 + 0.0 * free, 0.0)
        for _ in range(ROUNDS):
            here = maximum(guess, LEAST * reach)
            depth, gap = reach - here, maximum(start - here, 1e-30)
            share = flat * depth * depth / (here * gap)
            wrong = here - free - gain * share
            above = wrong > 0.0
            high, low = select(above, here, high), select(above, low, here)
            slope = share * (1.0 / gap - 1.0 / here) - 2.0 * flat * depth / (here * gap)
            new = here - wrong / (1.0 - gain * slope)
            outside = minimum(new - low, high - new) < 0.0
            new = select(outside, 0.5 * (low + high), new)
            change = maximum(new - here, here - new)
            guess = select(active > 0.5, new, guess)
            active = select(change > CONVERGED * here, active, 0.0)
            if not any_lane(active > 0.5):
                break
        guess = maximum(guess, LEAST * reach)
        depth = reach - guess
        gap = maximum(start - guess, 1e-30)
        mean = select(entering, flat * depth * depth / (guess * gap), mean)
    return span.whole * c * maximum(mean, 0.0)


@compiled
def energy(height: Number, c: Number, reach: Number) -> Any:
    """U of the barrier, cut off at ``reach``."""
    depth = maximum(reach - height, 0.0)
    return c * depth * depth / (maximum(height, LEAST * reach) * (reach * reach))


@compiled
def mean_force(start: Number, end: Number, reach: Number) -> Any:
    """F̄ and its slope in the height at the end, both per c."""
    flat = 1.0 / (reach * reach)
    a, b = select(start < reach, 1.0 / start, 0.0), select(end < reach, 1.0 / end, 0.0)
    # inside at both ends the quotient cancels to this; else one of the energies is 0
    both = select(start < reach, select(end < reach, 1.0 + 0.0 * end, 0.0), 0.0) > 0.5
    way = end - start
    way = select(select(way < 0.0, -way, way) < 1e-30, 1e-30, way)
    before, after = flat * (reach - start) * (reach - start) * a, flat * (reach - end) * (reach - end) * b
    quotient = (before - after) / way
    slope = (select(end < reach, b * b - flat, 0.0) - quotient) / way
    return select(both, a * b - flat, quotient), select(both, -a * b * b, slope)


@compiled
def meet_losing(start: Number, free: Number, span: Any, c: Number, reach: Number, damping: Number) -> Any:
    """The change of speed [m/s] by a barrier with loss δ [s/m], and the energy lost per mass [m²/s²].

    The other arguments are those of `meet`. Loss pushes more on what comes, and less on what leaves: the end
    is not beyond the start or, if that is farther, the end without loss.
    """
    start = maximum(start, LEAST * reach)
    gain = (span.out * span.whole) * c
    elastic = free + span.out * meet(start, free, span, c, reach)
    low, high = maximum(free, 0.0), select(start < reach, maximum(elastic, start), reach)
    guess = maximum(minimum(elastic, high), low)
    active = 1.0 + 0.0 * free
    for _ in range(2 * ROUNDS):
        here = maximum(guess, LEAST * reach)
        mean, slope = mean_force(start, here, reach)
        loss = maximum(1.0 - damping * (here - start) / span.whole, 0.0)
        steep = select(loss > 0.0, damping / span.whole + 0.0 * loss, 0.0)
        wrong = here - free - gain * mean * loss
        above = wrong > 0.0
        high, low = select(above, here, high), select(above, low, here)
        new = here - wrong / (1.0 - gain * (slope * loss - mean * steep))
        inside = minimum(new - low, high - new) >= 0.0
        new = select(inside, new, 0.5 * (low + high))
        change = maximum(new - here, here - new)
        guess = select(active > 0.5, new, guess)
        active = select(change > CONVERGED * here, active, 0.0)
        if not any_lane(active > 0.5):
            break
    here = maximum(guess, LEAST * reach)
    mean, _ = mean_force(start, here, reach)
    speed = (here - start) / span.whole
    loss = maximum(1.0 - damping * speed, 0.0)
    push = span.whole * c * maximum(mean, 0.0)
    return push * loss, push * speed * (1.0 - loss)
