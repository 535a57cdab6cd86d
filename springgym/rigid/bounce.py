"""The motion of the rigid body's particles along a normal: the barrier in place of the drift.

Without loss, a move by the exact discrete gradient F̄ = −(U₁ − U₀)/(h₁ − h₀) = c/(h₀h₁) − c/Δ² takes

    h₁ = h₀ + τ (v₀ + v₁)/2,    v₁ = v₀ + (τ/m) F̄:

a quadratic in h₁ whose roots have a negative product. So h₁ > 0 for every step and speed, and
m v²/2 + U is kept to round-off. Loss leaves this structure: with the impulse per mass J = (τ/m) F̄ in
place of the velocity, dJ = F dt/m and v(J) = v₀ + (1 − d v₀)(1 − exp(−dJ))/d, and

    h₁ = h₀ + τ V̄,    V̄ = (1/J) ∫ v dJ,

keeps the integral of motion ∫ m v dv/(1 − d v) + U. It is what fixes the rebound, so restitution too is
exact for every step. Outside Δ particles fly straight; steps are split where they enter or leave.
"""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.forces.barrier import decay_means
from springgym.kinds import Mask, Number, Numbers
from springgym.lanes import any_lane, load, maximum, minimum, select, sqrt

CONVERGED = 5e-4
"""Relative change at which Newton's method, which squares it each time, has the impulse."""

ITERATIONS = 40
"""More than Newton's method takes: some 30 at most in 100 000 impacts over ten decades of c, d and v."""


@compiled
def squeeze(reached: Number, gain: Number, pull: Number, static: Number, inverse_start: Number) -> Any:
    """The height h₁ > 0 with h₁ = reached + gain · J, and J = pull/(h₀ h₁) − static."""
    half = 0.5 * (reached - gain * static)
    product = gain * pull * inverse_start
    rising = half > 0.0
    size = sqrt(half * half + product) + select(rising, half, -half)
    end = select(rising, size, product) / select(rising, 1.0, size)
    return end, pull * inverse_start / end - static


@compiled
def escape(linear: Number, square: Number, energy: Number) -> Any:
    """The J > 0 with linear · J + square · J² = energy."""
    root = sqrt(linear * linear + 4.0 * square * energy)
    return select(linear > 0.0, 2.0 * energy / (linear + root), (root - linear) / (2.0 * square))


@compiled
def response(impulse: Number, u: Number, damping: Numbers) -> Any:
    """What an impulse J per mass does to a speed ``u``.

    Returns
    -------
    the change of speed averaged over the impulse, V̄ − u; its derivative by J; the change of speed
    """
    if damping is None:
        return 0.5 * impulse, 0.5 + 0.0 * u, impulse
    d = load(damping, 0)
    loss = maximum(1.0 - d * u, 0.0)
    phi, psi = decay_means(d * impulse)
    return loss * impulse * psi, loss * (phi - psi), loss * impulse * phi


@compiled
def rounds(damping: Any) -> int:
    """How many rounds of Newton's method to allow: without loss the first is exact."""
    return 1 if damping is None else ITERATIONS


@compiled
def bounce(
    h: Number, u: Number, tau: Number, c: Number, reach: Number, damping: Numbers, touching: Mask
) -> Any:
    """Move along a normal for ``tau`` seconds, from height ``h`` at speed ``u``.

    ``c`` is the strength per mass, ``damping`` d [s/m] or None. Lanes that are not ``touching`` get
    numbers without a meaning. Newton's method approaches the impulse from below, lane by lane: only
    `response` is replaced by its tangent.

    Returns
    -------
    displacement, change of speed, energy lost per mass
    """
    inside, start = tau + 0.0 * u, minimum(h, reach)
    entering = h > reach
    if any_lane(entering):
        left = tau - (reach - h) / u
        left = select(minimum(left, tau - left) > 0.0, left, 0.0)  # 0: not brought here by u
        inside = select(entering, left, inside)
    inverse_start = 1.0 / start
    pull = c * inside
    static = pull * (1.0 / (reach * reach))
    reached = start + inside * u
    end, impulse, moving = start, 0.0 * u, 1.0 + 0.0 * u
    for _ in range(rounds(damping)):
        more, slope, _ = response(impulse, u, damping)
        tangent = reached + inside * (more - slope * impulse)
        new_end, new = squeeze(tangent, inside * slope, pull, static, inverse_start)
        active = moving > 0.5
        moving = select(new - impulse > CONVERGED * new, moving, 0.0)
        end, impulse = select(active, new_end, end), select(active, new, impulse)
        if not any_lane(select(touching, moving, 0.0) > 0.5):
            break
    more, _, change = response(impulse, u, damping)
    displacement = end - h
    leaving = minimum(end - reach, reach - h) > 0.0
    if any_lane(leaving):
        depth = reach - start
        energy = c * depth * depth * inverse_start * (1.0 / (reach * reach))
        outward, moving = 0.0 * u, 1.0 + 0.0 * u
        for _ in range(rounds(damping)):
            more, slope, _ = response(outward, u, damping)
            new = escape(u + (more - slope * outward), slope, energy)
            active = moving > 0.5
            moving = select(new - outward > CONVERGED * new, moving, 0.0)
            outward = select(active, new, outward)
            if not any_lane(select(leaving, moving, 0.0) > 0.5):
                break
        impulse = select(leaving, outward, impulse)
        more, _, change = response(impulse, u, damping)
        aloft = tau - minimum(depth / (u + more), tau)
        displacement = select(leaving, depth + aloft * (u + change), displacement)
    mean = u + 0.5 * change
    loss = impulse * (u + more) - change * mean
    return displacement, change, loss
