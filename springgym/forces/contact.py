"""Contact with surfaces: an inverse-square barrier (equation 8 of the paper) that nothing gets through.

A particle at height h < Δ is pushed along the surface's normal with F = (c/h² − c/Δ²)(1 − d ḣ)₊, whose
conservative part has the energy U(h) = c (Δ − h)²/(h Δ²). The second factor is the loss of Hunt and
Crossley, J. Appl. Mech. 42 (1975) 440, doi:10.1115/1.3423596. Friction is Coulomb's.

Contact is no force that an integrator samples; it stands in place of the drift. Without loss, a move by
the exact discrete gradient F̄ = −(U₁ − U₀)/(h₁ − h₀) = c/(h₀h₁) − c/Δ² takes

    h₁ = h₀ + τ (v₀ + v₁)/2,    v₁ = v₀ + (τ/m) F̄:

a quadratic in h₁ whose roots have a negative product. So h₁ > 0 for every step and speed, and
m v²/2 + U is kept to round-off. Loss leaves this structure: with the impulse per mass J = (τ/m) F̄ in
place of the velocity, dJ = F dt/m and v(J) = v₀ + (1 − d v₀)(1 − exp(−dJ))/d, and

    h₁ = h₀ + τ V̄,    V̄ = (1/J) ∫ v dJ,

keeps the integral of motion ∫ m v dv/(1 − d v) + U. It is what fixes the rebound, so restitution too is
exact for every step. (Gonzalez, J. Nonlinear Sci. 6 (1996) 449, doi:10.1007/BF02440162, for discrete
gradients.) Outside Δ particles fly straight; steps are split where they enter or leave.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from springgym.compiling import compiled
from springgym.forces.ledger import CONTACT, FRICTION, record
from springgym.lanes import any_lane, load, maximum, minimum, select, sqrt
from springgym.vectors import TINY, choose, dot, minus, plus, row, set_row, times, unit, vector

CONVERGED = 5e-4
"""Relative change at which Newton's method, which squares it each time, has the impulse."""

ITERATIONS = 40
"""More than Newton's method takes: some 30 at most in 100 000 impacts over ten decades of c, d and v."""

NORMALS = 3
"""How often the normal of a curved surface is found."""


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
    oblique: bool
    """whether two of them meet at another than a right angle"""


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
def decay_means(x: Any) -> Any:
    """φ = (1 − e⁻ˣ)/x and ψ = (1 − φ)/x for x ≥ 0, to 1e-7 up to x = 2, without cancellation.

    For y = x/16, e^y is its Taylor polynomial D of degree 5, and φ and ψ what follows from it; then
    e⁻²ʸ = (e⁻ʸ)², φ(2y) = φ (1 + e⁻ʸ)/2 and ψ(2y) = ψ/2 + φ²/4, four times.
    """
    y = 0.0625 * x
    numerator = 1.0 + y * (1 / 2 + y * (1 / 6 + y * (1 / 24 + y * (1 / 120))))
    decay = 1.0 / (1.0 + y * numerator)
    phi = numerator * decay
    psi = (1 / 2 + y * (1 / 3 + y * (1 / 8 + y * (1 / 30 + y * (1 / 120))))) * decay
    for _ in range(4):
        psi = 0.5 * psi + 0.25 * phi * phi
        phi = 0.5 * phi * (1.0 + decay)
        decay = decay * decay
    return phi, psi


@compiled
def squeeze(reached: Any, gain: Any, pull: Any, static: Any, inverse_start: Any) -> Any:
    """The height h₁ > 0 with h₁ = reached + gain · J, and J = pull/(h₀ h₁) − static."""
    half = 0.5 * (reached - gain * static)
    product = gain * pull * inverse_start
    rising = half > 0.0
    size = sqrt(half * half + product) + select(rising, half, -half)
    end = select(rising, size, product) / select(rising, 1.0, size)
    return end, pull * inverse_start / end - static


@compiled
def escape(linear: Any, square: Any, energy: Any) -> Any:
    """The J > 0 with linear · J + square · J² = energy."""
    root = sqrt(linear * linear + 4.0 * square * energy)
    return select(linear > 0.0, 2.0 * energy / (linear + root), (root - linear) / (2.0 * square))


@compiled
def response(impulse: Any, u: Any, damping: Any) -> Any:
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
def bounce(h: Any, u: Any, tau: Any, c: Any, reach: Any, damping: Any, touching: Any, kick: Any = 0.0) -> Any:
    """Move along a normal for ``tau`` seconds, from height ``h`` at speed ``u``.

    ``c`` is the strength per mass, ``damping`` d [s/m] or None. Lanes that are not ``touching`` get
    numbers without a meaning. ``kick`` is the speed that the potential forces gave along the normal since
    the last move. Where contact balances it, the particle does not move, so those forces do no work on it;
    what they would have done is subtracted from the loss. Newton's method approaches the impulse from below,
    lane by lane: only `response` is replaced by its tangent.

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
    loss = impulse * (u + more) - change * mean - kick * (mean - (u + more))
    return displacement, change, loss


@compiled
def keep_energy(velocity: Any, given: Any, gained: Any) -> Any:
    """The change of velocity along ``given`` that takes the kinetic energy ``gained`` elsewhere, per mass.

    Where there is not so much to take, none of the speed along ``given`` is left.
    """
    along = unit(given)
    before = dot(along, velocity)
    after = before + dot(along, given)
    speed = sqrt(maximum(before * before - 2.0 * gained, 0.0))
    return times(select(after > 0.0, speed, -speed) - before, along)


# --- Friction -----------------------------------------------------------------------------------------


@compiled
def hold_back(slip: Any, limit: Any, kick: Any) -> Any:
    """Friction that changes a speed by ``limit`` at most, against the tangential velocity ``slip``.

    It stops exactly, and what rests stays where it is: a particle moves with its velocity after friction,
    times (3 − s)/2 if friction leaves the share s of it, so that quick sliding is the mean of before and
    after, as uniform deceleration has it. ``kick`` is the velocity that the potential forces gave since the
    last move. Where friction balances it, the particle does not move, so those forces do no work on it; what
    they would have done is subtracted from the loss.

    Returns
    -------
    what is taken from the velocity; the velocity it moves with; energy lost per mass
    """
    share = maximum(1.0 - limit / sqrt(dot(slip, slip) + TINY), 0.0)
    taken, moving = times(1.0 - share, slip), times(share * (1.5 - 0.5 * share), slip)
    mean = times(0.5 + 0.5 * share, slip)
    return taken, moving, dot(taken, mean) - dot(kick, minus(mean, moving))


# --- Surfaces -----------------------------------------------------------------------------------------


@compiled
def height(position: Any, planes: Any, k: Any) -> Any:
    """Height above a plane [m]."""
    return dot(row(planes.normal, k), position) - load(planes.offset, k)


@compiled
def barrier_energy(h: Any, strength: Any, reach: Any) -> Any:
    """U(h) [J]."""
    depth = maximum(reach - h, 0.0)
    return strength * depth * depth / (h * reach * reach)


@compiled
def planes_energy(x: Any, particles: Any, planes: Any) -> Any:
    """Energy of the particles in the planes' barriers [J]."""
    energy = 0.0 * load(x, (0, 0))
    if planes is not None:
        for i in range(particles.mass.size):
            if particles.free[i]:
                for k in range(planes.offset.size):
                    h = height(row(x, i), planes, k)
                    energy = energy + barrier_energy(h, load(planes.strength, 0), planes.reach)
    return energy


@compiled
def move_above_planes(
    x: Any,
    v: Any,
    a: Any,
    tau: Any,
    ledger: Any,
    particles: Any,
    planes: Any,
    friction: Any,
    damping: Any,
) -> None:
    """Let the particles move for ``tau`` seconds, above planes."""
    if planes is not None:
        for i in range(particles.mass.size):
            start = row(x, i)
            move = times(tau, row(v, i))
            if particles.free[i]:
                margin = 1.0 + 0.0 * start[0]
                for k in range(planes.offset.size):
                    h = height(start, planes, k)
                    lowest = minimum(h, h + dot(row(planes.normal, k), move))
                    margin = minimum(margin, lowest - planes.reach)
                if any_lane(margin < 0.0):
                    move = push_off_planes(
                        i, start, move, margin, v, a, tau, ledger, particles, planes, friction, damping
                    )
            set_row(x, i, plus(start, move))


@compiled
def push_off_planes(
    i: Any,
    start: Any,
    move: Any,
    margin: Any,
    v: Any,
    a: Any,
    tau: Any,
    ledger: Any,
    particles: Any,
    planes: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """The move of particle ``i`` where its ``margin`` is negative; its velocity is set.

    Plane after plane. At a right angle they do not know of each other. At a wider angle what one gives
    moves the particle from the other, too: a plane acts on the velocity changed by half of what the
    planes before it gave, and lifts the particle to the height it asks for if it is not there yet, so
    that no plane is ever pierced; then the energy is put right. Friction acts along what the planes that
    are touched leave free.
    """
    velocity, mass = row(v, i), load(particles.mass, i)
    c = load(planes.strength, 0) * load(particles.inverse_mass, i)
    slip = velocity
    given, first = times(0.0, velocity), times(0.0, velocity)
    touched, pressed = 0.0 * velocity[0], 0.0 * velocity[0]
    lost, gained = touched, touched
    for k in range(planes.offset.size):
        n = row(planes.normal, k)
        h = height(start, planes, k)
        ahead = dot(n, move)
        u = dot(n, velocity) + 0.5 * dot(n, given)
        lowest = minimum(h, h + minimum(ahead, tau * u))
        touching = maximum(margin, lowest - planes.reach) < 0.0
        if any_lane(touching):
            displacement, change, loss = bounce(
                h, u, tau, c, planes.reach, damping, touching, tau * dot(n, row(a, i))
            )
            change = select(touching, change, 0.0)
            move = plus(move, times(select(touching, maximum(displacement - ahead, 0.0), 0.0), n))
            given = plus(given, times(change, n))
            lost = lost + select(touching, loss, 0.0)
            if planes.oblique:
                assumed = barrier_energy(h + displacement, c, planes.reach)
                gained = gained - select(touching, change * (u + 0.5 * change) + assumed, 0.0)
            if friction is not None:
                across = minus(n, times(dot(n, first), first))
                if k > 0:
                    across = times(1.0 / sqrt(dot(across, across) + TINY), across)
                slip = minus(slip, times(select(touching, dot(across, slip), 0.0), across))
                first = choose(touched > 0.0, first, times(select(touching, 1.0 + 0.0 * h, 0.0), n))
                touched = touched + select(touching, 1.0 + 0.0 * h, 0.0)
                pressed = pressed + change
    if planes.oblique:
        for k in range(planes.offset.size):
            end = height(start, planes, k) + dot(row(planes.normal, k), move)
            gained = gained + barrier_energy(end, c, planes.reach)
        given = keep_energy(velocity, given, gained)
    velocity = plus(velocity, given)
    if damping is not None:
        record(ledger, CONTACT, mass * lost)
    if friction is not None:
        slip = choose(touched > 2.0, times(0.0, slip), slip)
        taken, moving, loss = hold_back(slip, load(friction, 0) * pressed, times(tau, row(a, i)))
        velocity = minus(velocity, taken)
        move = minus(move, times(tau, minus(slip, moving)))
        record(ledger, FRICTION, mass * loss)
    set_row(v, i, velocity)
    return move


@compiled
def bowl_energy(x: Any, particles: Any, bowl: Any) -> Any:
    """Energy of the particles in the bowl's barrier [J]."""
    energy = 0.0 * load(x, (0, 0))
    if bowl is not None:
        for i in range(particles.mass.size):
            if particles.free[i]:
                from_centre = minus(row(x, i), vector(bowl.centre))
                h = bowl.radius - sqrt(dot(from_centre, from_centre))
                energy = energy + barrier_energy(h, load(bowl.strength, 0), bowl.reach)
    return energy


@compiled
def move_in_bowl(
    x: Any,
    v: Any,
    a: Any,
    tau: Any,
    ledger: Any,
    particles: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> None:
    """Let the particles move for ``tau`` seconds, in a bowl."""
    if bowl is not None:
        free = bowl.radius - bowl.reach
        for i in range(particles.mass.size):
            start = row(x, i)
            move = times(tau, row(v, i))
            if particles.free[i]:
                here = minus(start, vector(bowl.centre))
                there = plus(here, move)
                near = maximum(dot(here, here), dot(there, there)) > free * free
                if any_lane(near):
                    move = push_off_bowl(
                        i, here, move, near, v, a, tau, ledger, particles, bowl, friction, damping
                    )
            set_row(x, i, plus(start, move))


@compiled
def push_off_bowl(
    i: Any,
    here: Any,
    move: Any,
    near: Any,
    v: Any,
    a: Any,
    tau: Any,
    ledger: Any,
    particles: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """The move of particle ``i``, ``here`` from the centre, where it is ``near``; its velocity is set.

    With the normal n̄ = −(d₀ + d₁)/(r₀ + r₁), d = x − centre, r = |d|, the heights differ by exactly
    n̄ · (d₁ − d₀), and the motion along n̄ is that above a plane. n̄ is found by iteration; an error of it
    shrinks by about τ v/r a time.
    """
    velocity, mass = row(v, i), load(particles.mass, i)
    c = load(bowl.strength, 0) * load(particles.inverse_mass, i)
    distance = sqrt(dot(here, here) + TINY)
    h = bowl.radius - distance
    straight, there, farther = move, here, distance
    kick = times(tau, row(a, i))
    for _ in range(NORMALS):
        n = times(-1.0 / (distance + farther), plus(here, there))
        u = dot(n, velocity)
        touching = minimum(h, h + tau * u) < bowl.reach
        displacement, change, loss = bounce(h, u, tau, c, bowl.reach, damping, touching, dot(n, kick))
        displacement = select(touching, displacement, tau * u)
        change, loss = select(touching, change, 0.0), select(touching, loss, 0.0)
        slip = minus(velocity, times(u, n))
        move = plus(times(tau, slip), times(displacement, n))
        if friction is not None:
            taken, moving, rubbed = hold_back(slip, load(friction, 0) * change, kick)
            move = minus(move, times(tau, minus(slip, moving)))
        there = plus(here, move)
        farther = sqrt(dot(there, there) + TINY)
    assumed = barrier_energy(h + displacement, c, bowl.reach)
    gained = barrier_energy(bowl.radius - farther, c, bowl.reach) - assumed
    gained = gained - change * (u + 0.5 * change)
    new = plus(velocity, keep_energy(velocity, times(change, n), gained))
    if damping is not None:
        record(ledger, CONTACT, select(near, mass * loss, 0.0))
    if friction is not None:
        new = minus(new, taken)
        record(ledger, FRICTION, select(near, mass * rubbed, 0.0))
    set_row(v, i, choose(near, new, velocity))
    return choose(near, move, straight)
