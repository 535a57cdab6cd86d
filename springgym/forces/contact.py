"""Contact with surfaces: an inverse-square barrier (equation 8 of the paper) that nothing gets through.

A particle at height h < Δ is pushed along the surface's normal with F = (c/h² − c/Δ²)(1 − d ḣ)₊, whose
conservative part has the energy U(h) = c (Δ − h)²/(h Δ²), and 0 from Δ on. The second factor is the loss of
Hunt and Crossley, J. Appl. Mech. 42 (1975) 440, doi:10.1115/1.3423596. Friction is Coulomb's.

Contact is an impulse at the node of a step (`springgym.forces.node`), where springs, gravity and all else
act, too: a particle flies straight for half a step before the node and half a step after it. With h₀ and h₁
the heights where the step begins and ends, and u₀ and u₁ the speeds along the normal before and after the
node, h₁ = h₀ + τ (u₀ + u₁)/2. The impulse is τ times the discrete gradient of the barrier,

    F̄ = −(U(h₁) − U(h₀))/(h₁ − h₀),    J = τ F̄ (1 − d (h₁ − h₀)/τ)₊,

so that without loss its work, J (u₀ + u₁)/2, is exactly −(U(h₁) − U(h₀)), whatever else acts at the node
(Gonzalez, J. Nonlinear Sci. 6 (1996) 449, doi:10.1007/BF02440162, for discrete gradients). With a the height
that would be reached without contact, h₁ is the one root of

    h₁ = a + (τ/2m) J(h₀, h₁),

positive for every a: nothing that starts in front of a surface ends behind it, whatever step and speed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from springgym.compiling import compiled
from springgym.lanes import any_lane, load, maximum, minimum, select, sqrt, store
from springgym.vectors import TINY, choose, dot, minus, plus, plus_scaled, row, times, vector

ROUNDS = 12
"""Most rounds of Newton's method for a particle that enters a barrier; it squares the error each time."""

CONVERGED = 1e-7
"""Change of the height, as a share of Δ, at which Newton's method has it: the error left is the square."""

TURNS = 20
"""How often planes at a wide angle are taken in turn, at the most."""

NORMALS = 4
"""How often the end of a step in a dish is found: each time the error shrinks by some (τ v/R)²."""


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


class Bowl(NamedTuple):
    """The inside of a sphere."""

    centre: np.ndarray
    """(3,) [m]"""
    radius: float
    """[m]: the height of x is radius − |x − centre|"""
    strength: np.ndarray
    """c [N·m²], (1,)"""
    reach: float
    """Δ [m]"""


# --- The law along one normal ---------------------------------------------------------------------------


@compiled
def positive_root(square: Any, linear: Any, product: Any) -> Any:
    """The smallest h > 0 with square h² + linear h = product, for product > 0, without cancellation."""
    root = sqrt(maximum(linear * linear + 4.0 * square * product, 0.0))
    rising = linear > 0.0
    size = select(rising, linear, -linear) + root
    return select(rising, 2.0 * product, size) / select(rising, size, 2.0 * square)


@compiled
def loss_rate(like: Any, tau: Any, damping: Any) -> Any:
    """d/τ [1/m]"""
    if damping is None:
        return 0.0 * like
    return 0.0 * like + load(damping, 0) / tau


@compiled
def meet(start: Any, free: Any, tau: Any, c: Any, reach: Any, damping: Any) -> Any:
    """What a barrier does in a step of ``tau`` seconds.

    ``start`` is the height h₀ [m] at the start of the step, ``free`` the height a that is reached at its end
    without the barrier, of which at least one must be less than ``reach``; ``c`` is the strength per mass
    [m³/s²], ``damping`` d [s/m] or None.

    Returns
    -------
    the change of speed [m/s], and the energy lost per mass [m²/s²]
    """
    loss = loss_rate(start, tau, damping)
    lossy = 1.0 + loss * start
    gain, flat = (0.5 * tau * tau) * c, 1.0 / (reach * reach)
    inverse = 1.0 / start
    end = positive_root(
        1.0 - gain * loss * flat, gain * (lossy * flat + loss * inverse) - free, gain * lossy * inverse
    )
    slack = loss * free > lossy  # leaves faster than the surface's force follows
    end = select(slack, free, end)
    mean = inverse / end - flat
    inside = start < reach
    leaving = select(inside, end, 0.0) > reach
    if any_lane(leaving):
        depth = reach - start
        energy = depth * depth * inverse * flat
        # (h - a)(h - h₀) = q E (A - B h), for the way s = h - h₀ > 0
        away = start - free + gain * energy * loss
        way = positive_root(1.0 + 0.0 * away, away, gain * energy * (lossy - loss * start))
        way = select(slack, free - start, way)
        end = select(leaving, start + way, end)
        mean = select(leaving, energy / way, mean)
    entering = start >= reach
    if any_lane(entering):
        low, high = maximum(free, 0.0), reach + 0.0 * free
        guess = minimum(maximum(end, low), high)
        active = select(entering, 1.0 + 0.0 * free, 0.0)
        for _ in range(ROUNDS):
            here = maximum(guess, 1e-6 * reach)
            depth, gap = reach - here, start - here
            share = flat * depth * depth / (here * gap)
            factor = maximum(lossy - loss * here, 0.0)
            wrong = here - free - gain * share * factor
            above = wrong > 0.0
            high, low = select(above, here, high), select(above, low, here)
            # d share/dh = share (1/gap - 2/depth - 1/h)
            slope = share * (1.0 / gap - 1.0 / here) - 2.0 * flat * depth / (here * gap)
            new = here - wrong / (1.0 - gain * (slope * factor - share * loss))
            outside = minimum(new - low, high - new) < 0.0
            new = select(outside, 0.5 * (low + high), new)
            change = maximum(new - here, here - new)
            guess = select(active > 0.5, new, guess)
            active = select(change > CONVERGED * reach, active, 0.0)
            if not any_lane(active > 0.5):
                break
        depth = reach - guess
        end = select(entering, guess, end)
        mean = select(entering, flat * depth * depth / (guess * (start - guess)), mean)
    full = tau * c * maximum(mean, 0.0)
    if damping is None:
        return full, 0.0 * full
    change = full * maximum(lossy - loss * end, 0.0)
    return change, (full - change) * (end - start) / tau


# --- Friction -----------------------------------------------------------------------------------------


@compiled
def hold_back(slip: Any, limit: Any) -> Any:
    """What friction takes from the tangential velocity ``slip``: ``limit`` [m/s] of it, or all there is."""
    return times(minimum(limit / sqrt(dot(slip, slip) + TINY), 1.0), slip)


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
def contact_change(
    i: Any,
    position: Any,
    before: Any,
    velocity: Any,
    tau: Any,
    space: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """The change of velocity [m/s] of particle ``i`` by the surfaces and their friction, at a node.

    ``before`` is its velocity before the node, ``velocity`` the one after it without the surfaces; ``space``
    (surfaces, 3) is workspace. Returns also what of that is friction, and the energy lost in the contact [J].
    """
    change, rub = times(0.0, velocity), times(0.0, velocity)
    lost = change[0]
    if particles.free[i]:
        if planes is not None:
            change, rub, lost = planes_change(
                i, position, before, velocity, tau, space, particles, planes, friction, damping
            )
        if bowl is not None:
            change, rub, lost = bowl_change(
                i, position, before, velocity, tau, particles, bowl, friction, damping
            )
    return change, rub, lost


@compiled
def planes_change(
    i: Any,
    position: Any,
    before: Any,
    velocity: Any,
    tau: Any,
    pushes: Any,
    particles: Any,
    planes: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """`contact_change` of planes; ``pushes`` (planes, 3) is workspace.

    At a right angle they do not know of each other. At a wider one what one gives moves the particle from
    the other, too: they are taken in turn until they agree. Friction acts along what the planes that are
    touched leave free, so that it moves nothing towards a plane.
    """
    begin = plus_scaled(position, -0.5 * tau, before)
    end = plus_scaled(position, 0.5 * tau, velocity)
    nothing = times(0.0, velocity)
    given, lost = nothing, nothing[0]
    c = load(planes.strength, 0) * load(particles.inverse_mass, i)
    for turn in range(TURNS if planes.oblique else 1):
        lost, changed = nothing[0], nothing[0]
        for k in range(planes.offset.size):
            n = row(planes.normal, k)
            start, free = height(begin, planes, k), height(end, planes, k)
            own = nothing[0]
            if planes.oblique:
                if turn > 0:
                    own = load(pushes, (k, 0))
                free = free + (0.5 * tau) * (dot(n, given) - own)
            touching = minimum(start, free) < planes.reach
            push = nothing[0]
            if any_lane(touching):
                push, loss = meet(start, free, tau, c, planes.reach, damping)
                push = select(touching, push, 0.0)
                lost = lost + select(touching, loss, 0.0)
            store(pushes, (k, 0), push)
            given = plus_scaled(given, push - own, n)
            changed = maximum(changed, maximum(push - own, own - push))
        if not any_lane(tau * changed > CONVERGED * planes.reach):
            break
    rub = nothing
    if friction is not None:
        slip, first, pressed, touched = velocity, nothing, nothing[0], nothing[0]
        for k in range(planes.offset.size):
            push = load(pushes, (k, 0))
            touching = push > 0.0
            if any_lane(touching):
                n = row(planes.normal, k)
                across = minus(n, times(dot(n, first), first))
                if k > 0:
                    across = times(1.0 / sqrt(dot(across, across) + TINY), across)
                slip = minus(slip, times(select(touching, dot(across, slip), 0.0), across))
                one = select(touching, 1.0 + nothing[0], 0.0)
                first = choose(touched > 0.0, first, times(one, n))
                touched = touched + one
                pressed = pressed + push
        slip = choose(touched > 2.0, nothing, slip)
        rub = times(-1.0, hold_back(slip, load(friction, 0) * pressed))
    return plus(given, rub), rub, load(particles.mass, i) * lost


@compiled
def bowl_change(
    i: Any,
    position: Any,
    before: Any,
    velocity: Any,
    tau: Any,
    particles: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """`contact_change` of a bowl.

    The impulse acts along the normal n at the node. With d from the centre and r = |d|, the heights at the
    ends of the step differ by exactly n̄ · (d₁ − d₀), n̄ = −(d₀ + d₁)/(r₀ + r₁) = s n: the motion along n̄ is
    that above a plane. What the impulse does to d₁ is found by iteration.
    """
    here = minus(position, vector(bowl.centre))
    n = times(-1.0 / sqrt(dot(here, here) + TINY), here)
    first = plus_scaled(here, -0.5 * tau, before)
    free = plus_scaled(here, 0.5 * tau, velocity)
    near = sqrt(dot(first, first) + TINY)
    start = bowl.radius - near
    far = sqrt(dot(free, free) + TINY)
    touching = minimum(start, bowl.radius - far) < bowl.reach
    push, lost = 0.0 * start, 0.0 * start
    c = load(bowl.strength, 0) * load(particles.inverse_mass, i)
    if any_lane(touching):
        for _ in range(NORMALS):
            last = plus_scaled(free, 0.5 * tau * push, n)
            far = sqrt(dot(last, last) + TINY)
            mean = times(-1.0 / (near + far), plus(first, last))
            s = dot(mean, n)
            reached = start + dot(mean, minus(free, first))
            meeting = minimum(start, reached) < bowl.reach
            push, lost = meet(start, reached, tau, c * s * s, bowl.reach, damping)
            push = select(meeting, push / s, 0.0)
            lost = select(meeting, lost / (s * s), 0.0)
        push, lost = select(touching, push, 0.0), select(touching, lost, 0.0)
    rub = times(0.0, velocity)
    if friction is not None:
        slip = minus(velocity, times(dot(n, velocity), n))
        rub = times(-1.0, hold_back(slip, load(friction, 0) * push))
    return plus(times(push, n), rub), rub, load(particles.mass, i) * lost
