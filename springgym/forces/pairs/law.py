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

from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number
from springgym.core.lanes import any_lane, maximum, minimum, select, sqrt

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
def meet(start: Number, free: Number, span: Any, c: Number, reach: Number, damping: Number) -> Any:
    """The change of speed [m/s] by a barrier with loss δ [s/m], and the energy lost per mass [m²/s²].

    ``start`` is the height h₀ [m], ``free`` the height a, of which at least one must be less than ``reach``;
    ``c`` is the strength per mass [m³/s²]. With κ = δ/τ and G = t τ c, the heights h₀ and h₁ both in reach
    make a quadratic of the law,

        (1 − G κ/Δ²) h₁² + (G (κ/h₀ + (1 + κ h₀)/Δ²) − a) h₁ = G (1 + κ h₀)/h₀,

    and so does a way y out of reach, with U in units of c: y² + (h₀ − a + G κ U(h₀)) y = G U(h₀). Only what
    enters takes Newton's method, with the factors h₁ (h₀ − h₁) multiplied out.
    """
    start = maximum(start, LEAST * reach)
    gain, flat, kappa = (span.out * span.whole) * c, 1.0 / (reach * reach), damping / span.whole
    inverse, inside = 1.0 / start, start < reach
    most, nearest = 1.0 + kappa * start, maximum(inverse, 1.0 / reach)
    square = 1.0 - (gain * kappa) * flat
    linear = gain * (kappa * nearest + flat * most) - free
    product = gain * most * nearest
    slack = kappa * (free - start) >= 1.0  # what leaves so fast is not held
    end = select(slack, free, positive_root(square, linear, product))
    mean, loss = inverse / end - flat, 1.0 - kappa * (end - start)
    beyond = select(slack, reach - free, (square * reach + linear) * reach - product)
    leaving = select(inside, beyond, 1.0) < 0.0
    if any_lane(leaving):
        depth = reach - start
        energy = depth * depth * inverse * flat
        way = positive_root(1.0 + 0.0 * start, start - free + (gain * kappa) * energy, gain * energy)
        way = select(slack, free - start, way)
        mean, loss = select(leaving, energy / way, mean), select(leaving, 1.0 - kappa * way, loss)
    entering = select(inside, reach, free) < reach
    if any_lane(entering):
        end = entry(start, free, gain, flat, kappa, reach, end, entering)
        depth, gap = reach - end, maximum(start - end, 1e-30)
        mean = select(entering, flat * depth * depth / (end * gap), mean)
        loss = select(entering, 1.0 + kappa * gap, loss)
    loss = maximum(loss, 0.0)
    push = span.whole * c * maximum(mean, 0.0)
    speed = (free + span.out * (push * loss) - start) / span.whole
    return push * loss, push * speed * (1.0 - loss)


@compiled
def entry(
    start: Number,
    free: Number,
    gain: Number,
    flat: float,
    kappa: Number,
    reach: Number,
    guess: Number,
    entering: Mask,
) -> Any:
    """The height where a step ends that begins out of reach, between 0 or ``free`` and Δ."""
    low, high = maximum(free, LEAST * reach), reach + 0.0 * free
    guess = minimum(maximum(guess, low), high)
    active = select(entering, 1.0 + 0.0 * free, 0.0)
    strength = gain * flat
    for _ in range(ROUNDS):
        gap, depth = start - guess, reach - guess
        way, loss, pull = (guess - free) * guess, 1.0 + kappa * gap, strength * depth
        wrong = way * gap - pull * depth * loss
        steep = (2.0 * guess - free) * gap - way + pull * (2.0 * loss + kappa * depth)
        above = wrong > 0.0
        high, low = select(above, guess, high), select(above, low, guess)
        new = guess - wrong / steep
        new = select(minimum(new - low, high - new) >= 0.0, new, 0.5 * (low + high))
        change = maximum(new - guess, guess - new)
        going = active > 0.5
        active = select(change > CONVERGED * guess, active, 0.0)
        guess = select(going, new, guess)
        if not any_lane(active > 0.5):
            break
    return guess


@compiled
def energy(height: Number, c: Number, reach: Number) -> Any:
    """U of the barrier, cut off at ``reach``."""
    depth = maximum(reach - height, 0.0)
    return c * depth * depth / (maximum(height, LEAST * reach) * (reach * reach))
