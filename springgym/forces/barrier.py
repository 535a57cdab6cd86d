"""Surfaces: an inverse-square barrier (equation 8 of the paper) that nothing gets through, and friction.

A particle at height h < Δ is pushed along the surface's normal with F = (c/h² − c/Δ²)(1 − d ḣ)₊, whose
conservative part has the energy U(h) = c (Δ − h)²/(h Δ²). The second factor is the loss of Hunt and
Crossley, J. Appl. Mech. 42 (1975) 440, doi:10.1115/1.3423596. Friction is Coulomb's.

No integrator samples this force. In a step of τ seconds from height h₀ to h₁ it has the size of the exact
discrete gradient of U, F̄ = −(U(h₁) − U(h₀))/(h₁ − h₀), so that its work is −(U(h₁) − U(h₀)) whatever else
acts (Gonzalez, J. Nonlinear Sci. 6 (1996) 449, doi:10.1007/BF02440162). With J = τ F̄/m, with u the speed
along the normal and s its change by all else, everything acts evenly over the step:

    dv/dθ = s + J (1 − d v),   θ = 0 … 1;    h₁ = h₀ + τ V̄,    V̄ the mean of v.

J falls with h₁ and V̄ rises with J: there is one root, and h₁ > 0 for every step and speed. Without loss m
v²/2 + U changes by the work of s, to round-off. With loss J V̄ is still the work of the barrier; so the
rebound is that of theory for every step, and what rests is in balance at every step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Numbers, Vector
from springgym.core.lanes import any_lane, epsilon, load, maximum, minimum, select, sqrt
from springgym.core.vectors import TINY, dot, row, vector

if TYPE_CHECKING:
    from springgym.forces import Particles


LEAST = 1e-6
"""A step begins and ends at this share of Δ or higher."""

ROUNDS = 60
"""Most rounds of Newton's method for a height: some ten where it need not halve its bracket."""

FOUND, CLOSE, FORESEEN = 1e-7, 1e-4, 1e-3
"""Change of a height, as a share of it, at which Newton's method, which squares the error each time, has it;
with loss, where what is entered follows from what is found; and where the dampers are not known yet."""


class Planes(NamedTuple):
    """Planes that bound where particles may be; any two meet at a right angle or a wider one."""

    normal: np.ndarray
    """(planes, 3) unit vectors"""
    offset: np.ndarray
    """(planes,) [m]: the height of x is normal · x − offset"""
    strength: np.ndarray
    """c [N·m²], (1,)"""
    reach: float
    """Δ [m]"""
    oblique: bool | None
    """True if two of them meet at another than a right angle; else None, so that no turns are compiled"""


class HollowSphere(NamedTuple):
    """The inside of a sphere."""

    centre: np.ndarray
    """(3,) [m]"""
    radius: float
    """[m]: the height of x is radius − |x − centre|"""
    strength: np.ndarray
    """c [N·m²], (1,)"""
    reach: float
    """Δ [m]"""


# --- The motion along one normal ----------------------------------------------------------------------


@compiled
def decay_means(x: Number) -> Any:
    """φ = (1 − e⁻ˣ)/x and ψ = (1 − φ)/x for x ≥ 0, to 1e-7 up to x = 4, without cancellation.

    For y up to 1/2, eʸ is its Taylor polynomial D of degree 7, and φ and ψ what follows from it. For a larger
    x, y is x/8; then e⁻²ʸ = (e⁻ʸ)², φ(2y) = φ (1 + e⁻ʸ)/2 and ψ(2y) = ψ/2 + φ²/4, three times.
    """
    large = x > 0.5
    y = select(large, 0.125 * x, x)
    rest = 1 / 24 + y * (1 / 120 + y * (1 / 720 + y * (1 / 5040)))
    numerator = 1.0 + y * (1 / 2 + y * (1 / 6 + y * rest))
    decay = 1.0 / (1.0 + y * numerator)
    phi = numerator * decay
    rest = 1 / 30 + y * (1 / 144 + y * (1 / 840 + y * (1 / 5040)))
    psi = (1 / 2 + y * (1 / 3 + y * (1 / 8 + y * rest))) * decay
    if any_lane(large):
        for _ in range(3):
            psi = select(large, 0.5 * psi + 0.25 * phi * phi, psi)
            phi = select(large, 0.5 * phi * (1.0 + decay), phi)
            decay = decay * decay
    return phi, psi


@compiled
def positive_root(linear: Number, product: Number) -> Any:
    """The h > 0 with h² + linear h = product ≥ 0, without cancellation."""
    root = sqrt(linear * linear + 4.0 * product)
    rising = linear > 0.0
    size = select(rising, linear, -linear) + root
    return select(rising, 2.0 * product, size) / select(rising, size, 2.0)


@compiled
def gradient(start: Number, end: Number, reach: Number, touching: Mask) -> Any:
    """F̄/c [1/m²] between two heights, and its derivative by the second, where something is ``touching``."""
    flat, first, last = 1.0 / (reach * reach), 1.0 / start, 1.0 / end
    mean, slope = first * last - flat, -1.0 * first * last * last
    farther = select(touching, maximum(start, end), 0.0)
    if any_lane(farther >= reach):
        before, after = maximum(reach - start, 0.0), maximum(reach - end, 0.0)
        gap = end - start
        gap = 1.0 / select(gap < 0.0, minimum(gap, -1e-30), maximum(gap, 1e-30))
        across = (before * before * flat * first - after * after * flat * last) * gap
        steep = (after * (reach + end) * flat * last * last - across) * gap
        inside = farther < reach
        mean, slope = select(inside, mean, across), select(inside, slope, steep)
    return maximum(mean, 0.0), slope


@compiled
def meet(
    start: Number,
    u: Number,
    s: Number,
    span: Any,
    c: Number,
    reach: Number,
    d: Number,
    touching: Mask,
    found: Number,
) -> Any:
    """What a barrier does in a step to a speed ``u`` along its normal, which all else changes by ``s``.

    ``start`` is the height h₀ that the step begins at; the `Span` says how long it is, ``c`` is the strength
    per mass, ``d`` [s/m] the loss. With x = d J, φ = (1 − e⁻ˣ)/x, ψ = (1 − φ)/x and e = s + J (1 − d u), the
    step ends with the speed u + e φ, and V̄ = u + e ψ. What the drifts around the node lack of τ V̄ is a bend
    of the way at the node: none in a whole node without loss, where ψ is φ/2. Lanes that are not ``touching``
    get numbers without a meaning.

    Returns
    -------
    the change of speed [m/s], the bend [m], J [m/s]
    """
    tau, least, flat = span.whole, LEAST * reach, 1.0 / (reach * reach)
    start = maximum(start, least)
    # What leaves faster than the surface's force follows feels none of it.
    slack = maximum(1.0 - d * u, 1.0 - d * (u + s)) <= 0.0
    follow = maximum(1.0 - d * u, 0.0)
    depth = maximum(reach - start, 0.0)
    energy = depth * depth * flat / start  # U/c
    free = start + tau * (u + 0.5 * s)
    # Without loss, what begins inside ends at the root of a quadratic.
    gain = (0.5 * tau * tau) * c * follow
    end = positive_root(gain * flat - free, gain / start)
    inside = start < reach
    guess = select(inside, end, minimum(end, reach))
    if any_lane(select(touching, guess, 0.0) > reach):
        guess = select(guess > reach, start + positive_root(start - free, gain * energy), guess)
    low = maximum(start + tau * (u + 0.5 * minimum(s, 0.0)), 0.0)
    # √(2 c U) is what the barrier gives at the most, and 2 τ √q ≤ τ² q/Δ + Δ.
    farthest = 2.0 * tau * (maximum(u, -u) + maximum(s, -s)) + tau * tau * c * energy * (2.0 / reach)
    high = select(inside, 2.0 * reach + farthest, reach)
    guess = minimum(maximum(guess, low), high)
    enough = select(d > 0.0, max(found, CLOSE) + 0.0 * u, found) + 16 * epsilon(u)
    active = select(slack, 0.0, select(touching, 1.0 + 0.0 * u, 0.0))
    for _ in range(ROUNDS):
        here = maximum(guess, least)
        mean, slope = gradient(start, here, reach, touching)
        impulse = tau * c * mean
        phi, psi = decay_means(select(touching, d * impulse, 0.0))
        e = s + impulse * follow
        wrong = here - start - tau * (u + e * psi)
        above = wrong > 0.0
        high, low = select(above, here, high), select(above, low, here)
        # (xψ)' is φ − ψ, and ψ' is −2/3 ψ², nearly
        rise = follow * (phi - psi) - (2 / 3) * d * s * psi * psi
        new = here - wrong / (1.0 - (tau * tau) * c * slope * maximum(rise, 0.0))
        new = select(minimum(new - low, high - new) < 0.0, 0.5 * (low + high), new)
        change = maximum(new - here, here - new)
        guess = select(active > 0.5, new, guess)
        active = select(change > enough * here, active, 0.0)
        if not any_lane(active > 0.5):
            break
    here = maximum(select(slack, free, guess), least)
    mean, _ = gradient(start, here, reach, touching)
    impulse = tau * c * mean
    phi, psi = decay_means(select(touching, d * impulse, 0.0))
    e = select(slack, s, s + impulse * follow)
    phi, psi = select(slack, 1.0, phi), select(slack, 0.5, psi)
    return e * phi - s, e * (tau * psi - span.out * phi), impulse


@compiled
def slowed(slip: Vector, limit: Number) -> Any:
    """What friction takes from the velocity ``slip`` along a surface: ``limit`` of it, or all there is."""
    return minimum(limit / sqrt(dot(slip, slip) + TINY), 1.0) * slip


@compiled
def coefficient(of: Numbers, none: Number) -> Any:
    """The one number of friction or loss, or ``none`` if the scene has no such thing."""
    if of is not None:
        none = none + load(of, 0)
    return none


# --- Surfaces -----------------------------------------------------------------------------------------


@compiled
def height(position: Vector, planes: Planes, k: int) -> Any:
    """Height above a plane [m]."""
    return dot(row(planes.normal, k), position) - load(planes.offset, k)


@compiled
def surfaces(planes: Planes | None, bowl: HollowSphere | None) -> int:
    """How many there are: planes or a bowl."""
    count = 0
    if planes is not None:
        count += planes.offset.size
    if bowl is not None:
        count += 1
    return count


@compiled
def strength_and_reach(planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """c [N·m²] and Δ [m] of all surfaces."""
    if planes is not None:
        return load(planes.strength, 0), planes.reach
    if bowl is not None:
        return load(bowl.strength, 0), bowl.reach
    raise LookupError("no surfaces")


@compiled
def facing(k: int, begin: Vector, end: Vector, planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """The normal n̄ of surface ``k`` for a way, and the height at which that begins.

    n̄ · (end − begin) is exactly the difference of both heights: in a bowl, with d from its centre and r =
    |d|, n̄ = −(d₀ + d₁)/(r₀ + r₁).
    """
    if planes is not None:
        return row(planes.normal, k), height(begin, planes, k)
    if bowl is not None:
        first, last = begin - vector(bowl.centre), end - vector(bowl.centre)
        near, far = sqrt(dot(first, first) + TINY), sqrt(dot(last, last) + TINY)
        return -1.0 / (near + far) * (first + last), bowl.radius - near
    raise LookupError("no surfaces")


@compiled
def standing(k: int, position: Any, planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """The normal of surface ``k`` at a position, and the height there."""
    return facing(k, position, position, planes, bowl)


@compiled
def barrier_energy(h: Number, strength: Number, reach: Number) -> Any:
    """U(h) [J]."""
    depth = maximum(reach - h, 0.0)
    return strength * depth * depth / (h * reach * reach)


@compiled
def energy_at(position: Vector, planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """Energy of a free particle in the barriers of all surfaces [J]."""
    energy = 0.0 * position[0]
    if planes is not None:
        for k in range(planes.offset.size):
            h = height(position, planes, k)
            energy = energy + barrier_energy(h, load(planes.strength, 0), planes.reach)
    if bowl is not None:
        from_centre = position - vector(bowl.centre)
        h = bowl.radius - sqrt(dot(from_centre, from_centre))
        energy = energy + barrier_energy(h, load(bowl.strength, 0), bowl.reach)
    return energy


@compiled
def contact_energy(x: Numbers, particles: Particles, planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """Energy of the particles in the barriers of all surfaces [J]."""
    energy = 0.0 * load(x, (0, 0))
    for i in range(particles.mass.size):
        if particles.free[i]:
            energy = energy + energy_at(row(x, i), planes, bowl)
    return energy
