"""Contact of the rigid body: the barrier law of the particles (`springgym.rigid.bounce`), joined.

In a flight of τ seconds each particle near a surface receives an impulse J along the normal: the share s
where the flight begins and the rest where it ends; between them the body flies freely. The particle gives
way along n by the ease A = 1/M + (r × n) · I⁻¹ (r × n) per impulse. What remains is its motion along the
normal,

    h₁ = h₀ + τ (u + A s),    u = n · v + (curvature of the flight)/τ, without its own s,

in which `bounce` finds J and s, as for a particle of mass 1/A: the law is the same, and so is that nothing
gets through. Friction p acts with either impulse: it stops the particle's motion along the surface if the
size it needs is within μ times that impulse, else it is that, against the motion. So what rests stays
where it is.

All particles act on each other through the motion of the body. They are taken one after the other until
none changes (Gauss and Seidel; without friction and loss, the solution is the minimum of a convex
function), then the flight is flown and its curvature put right, until that does not change either.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from springgym.compiling import compiled
from springgym.forces.barrier import surfaces
from springgym.forces.ledger import CONTACT, FRICTION, record
from springgym.kinds import Ledger, Number, Numbers, Vector
from springgym.lanes import any_lane, load, maximum, minimum, select, sqrt
from springgym.rigid.bounce import bounce
from springgym.rigid.flight import angular_velocity, combine, components, fly, turned
from springgym.surfaces import NEAREST
from springgym.vectors import TINY, choose, cross, dot, minus, plus, row, set_row, times, vector

if TYPE_CHECKING:
    from springgym.forces import Particles
    from springgym.forces.barrier import HollowSphere, Planes
    from springgym.rigid.motion import Rigid


FLIGHTS = 12
"""How often the flight is flown with new impulses, at the most; what is left of the effect of its curvature
shrinks by the angle turned in it each time."""

FLAT = 1e-5
"""Change of the curvature, as a share of Δ, at which it is right."""

SWEEPS = 6
"""How often the particles are taken in turn, at the most. Where that is too seldom, the next step goes on
from there: what stays in touch finds its balance over some steps."""

CONVERGED = 1e-4
"""Change of the particles' speeds, relative to what J gives, at which the impulses are found."""

SURFACES = 7
"""How many surfaces there may be. For each the workspace has `ARRAYS` arrays, a row a particle:"""

PUSH, RUB, NORMAL, GAP = range(4)
"""(J, s, A), friction, n, (h₀ and curvature of the flight, least height − Δ); what is not near has J = 0."""

ARRAYS = 4


@compiled
def touch(i: int, k: int, pose: Any, rigid: Rigid, planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """Height of particle i above surface k, and the normal there in body coordinates.

    A pose is the position of the body's point and the principal axes, in world coordinates.
    """
    position, axes = pose
    place = row(rigid.shape, i)
    normal = times(0.0, position)
    height = normal[0]
    if planes is not None:
        normal = components(axes, row(planes.normal, k))
        height = dot(row(planes.normal, k), position) - load(planes.offset, k) + dot(normal, place)
    if bowl is not None:
        here = plus(components(axes, minus(position, vector(bowl.centre))), place)
        distance = sqrt(dot(here, here) + TINY)
        normal = times(-1.0 / distance, here)
        height = bowl.radius - distance
    return height, normal


@compiled
def law(nothing: Number, planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """Strength and reach of the barrier; ``nothing`` is a zero in every lane."""
    strength, reach = nothing, 0.0
    if planes is not None:
        strength, reach = nothing + load(planes.strength, 0), planes.reach
    if bowl is not None:
        strength, reach = nothing + load(bowl.strength, 0), bowl.reach
    return strength, reach


@compiled
def ease(arm: Vector, lightness: Number, rigid: Rigid) -> Any:
    """1/M + (r × n) · I⁻¹ (r × n): speed along n per impulse along n."""
    return lightness + dot(arm, angular_velocity(arm, rigid))


@compiled
def velocity_of(place: Vector, motion: Vector, rigid: Rigid) -> Any:
    """Velocity of a particle. A motion is velocity and angular momentum, both in body coordinates."""
    return plus(motion[0], cross(angular_velocity(motion[1], rigid), place))


@compiled
def pushed(motion: Vector, place: Vector, push: Vector, lightness: Number) -> Any:
    """The motion after an impulse at a particle; ``lightness`` is 1/M, or 0 of a pinned body."""
    return plus(motion[0], times(lightness, push)), plus(motion[1], cross(place, push))


@compiled
def stick(
    place: Vector,
    n: Vector,
    old: Vector,
    limit: Number,
    motion: Vector,
    active: Any,
    lightness: Number,
    rigid: Rigid,
) -> Any:
    """Friction that stops a particle along a surface or, at its limit, works against its motion.

    ``old`` is the friction that is in the motion already. Returns the new one, the motion, and the change
    of speed.
    """
    slip = velocity_of(place, motion, rigid)
    slip = minus(slip, times(dot(n, slip), n))
    along = times(1.0 / sqrt(dot(slip, slip) + TINY), slip)
    a = ease(cross(place, along), lightness, rigid) + TINY
    new = minus(old, times(1.0 / a, slip))
    new = times(minimum(limit / sqrt(dot(new, new) + TINY), 1.0), new)
    change = choose(active > 0.5, minus(new, old), times(0.0, old))
    return plus(old, change), pushed(motion, place, change, lightness), a * sqrt(dot(change, change))


@compiled
def start_over(
    workspace: np.ndarray,
    nothing: Vector,
    particles: Particles,
    planes: Planes | None,
    bowl: HollowSphere | None,
) -> None:
    """Forget all impulses."""
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            set_row(workspace[ARRAYS * k + PUSH], i, nothing)
            set_row(workspace[ARRAYS * k + RUB], i, nothing)


@compiled
def approach(
    workspace: np.ndarray,
    begin: Vector,
    lightness: Number,
    rigid: Rigid,
    particles: Particles,
    planes: Planes | None,
    bowl: HollowSphere | None,
) -> None:
    """Set what the flight begins with: heights, normals and eases."""
    _, reach = law(0.0 * begin[0][0], planes, bowl)
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            h, n = touch(i, k, begin, rigid, planes, bowl)
            h = select(h > 0.0, h, NEAREST * reach)  # thrown behind by a flight that bent too much
            impulse, share, _ = row(workspace[ARRAYS * k + PUSH], i)
            a = ease(cross(row(rigid.shape, i), n), lightness, rigid)
            set_row(workspace[ARRAYS * k + PUSH], i, (impulse, share, a))
            set_row(workspace[ARRAYS * k + NORMAL], i, n)
            set_row(workspace[ARRAYS * k + GAP], i, (h, h, h))


@compiled
def bend(
    workspace: np.ndarray,
    tau: Number,
    end: Any,
    motion: Vector,
    margin: Number,
    rigid: Rigid,
    particles: Particles,
    planes: Planes | None,
    bowl: HollowSphere | None,
) -> Any:
    """Set what the flight adds: curvatures and gaps, given the motion that it begins with.

    Returns the largest change of the curvatures of what is near.
    """
    _, reach = law(0.0 * margin, planes, bowl)
    changed = 0.0 * margin
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            ahead, _ = touch(i, k, end, rigid, planes, bowl)
            n = row(workspace[ARRAYS * k + NORMAL], i)
            h, before, _ = row(workspace[ARRAYS * k + GAP], i)
            curvature = ahead - h - tau * dot(n, velocity_of(row(rigid.shape, i), motion, rigid))
            gap = select(margin < 0.0, minimum(h, ahead) - reach, 1.0)
            set_row(workspace[ARRAYS * k + GAP], i, (h, curvature, gap))
            change = maximum(curvature - before, before - curvature)
            changed = maximum(changed, select(gap < 0.0, change, 0.0))
    return changed


@compiled
def resume(
    motion: Any,
    workspace: np.ndarray,
    margin: Any,
    lightness: Any,
    rigid: Rigid,
    particles: Particles,
    planes: Planes | None,
    bowl: HollowSphere | None,
) -> Any:
    """The motion with the impulses of the step before, as a guess; they are dropped where none is near."""
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            impulse, share, a = row(workspace[ARRAYS * k + PUSH], i)
            if any_lane(impulse > 0.0):
                near = margin < 0.0
                impulse, share = select(near, impulse, 0.0), select(near, share, 0.0)
                held = row(workspace[ARRAYS * k + RUB], i)
                held = choose(near, held, times(0.0, held))
                set_row(workspace[ARRAYS * k + PUSH], i, (impulse, share, a))
                set_row(workspace[ARRAYS * k + RUB], i, held)
                push = plus(held, times(share, row(workspace[ARRAYS * k + NORMAL], i)))
                motion = pushed(motion, row(rigid.shape, i), push, lightness)
    return motion


@compiled
def push_apart(
    motion: Vector,
    tau: Number,
    active: Number,
    workspace: np.ndarray,
    lightness: Number,
    rigid: Rigid,
    particles: Particles,
    planes: Planes | None,
    bowl: HollowSphere | None,
    friction: Numbers,
    damping: Numbers,
) -> Any:
    """Find J, s and the friction with s where ``active`` is 1; returns the motion with s and friction."""
    strength, reach = law(0.0 * active, planes, bowl)
    for _ in range(SWEEPS):
        changed, fastest = 0.0 * active, 0.0 * active
        for k in range(surfaces(planes, bowl)):
            for i in range(particles.mass.size):
                impulse, share, a = row(workspace[ARRAYS * k + PUSH], i)
                h, curvature, gap = row(workspace[ARRAYS * k + GAP], i)
                near = minimum(gap, -impulse)
                if particles.free[i] and any_lane(near < 0.0):
                    place = row(rigid.shape, i)
                    n = row(workspace[ARRAYS * k + NORMAL], i)
                    u = dot(n, velocity_of(place, motion, rigid)) - a * share + curvature / tau
                    touching = maximum(near, minimum(h, h + tau * u) - reach) < 0.0
                    displacement, change, _ = bounce(h, u, tau, strength * a, reach, damping, touching)
                    total = select(touching, change / a, 0.0)
                    early = select(total > 0.0, (displacement / tau - u) / a, 0.0)
                    total = select(active > 0.5, total, impulse)
                    early = select(active > 0.5, early, share)
                    set_row(workspace[ARRAYS * k + PUSH], i, (total, early, a))
                    motion = pushed(motion, place, times(early - share, n), lightness)
                    changed = maximum(changed, a * maximum(early - share, share - early))
                    fastest = maximum(fastest, a * total)
                    if friction is not None:
                        held, motion, change = stick(
                            place,
                            n,
                            row(workspace[ARRAYS * k + RUB], i),
                            load(friction, 0) * early,
                            motion,
                            active,
                            lightness,
                            rigid,
                        )
                        set_row(workspace[ARRAYS * k + RUB], i, held)
                        changed = maximum(changed, change)
        active = select(changed > CONVERGED * fastest, active, 0.0)
        if not any_lane(active > 0.5):
            break
    return motion


@compiled
def account(
    before: Vector,
    motion: Vector,
    tau: Number,
    ledger: Ledger,
    workspace: np.ndarray,
    lightness: Any,
    rigid: Rigid,
    particles: Particles,
    planes: Planes | None,
    bowl: HollowSphere | None,
    friction: Any,
    damping: Numbers,
) -> None:
    """Enter what was lost in contact, and by friction that acted just before s, on the motion ``before``.

    In this order s and J − s do the work of J over the flight that `bounce` has.
    """
    rubbed = before
    if friction is not None:
        for k in range(surfaces(planes, bowl)):
            for i in range(particles.mass.size):
                push = row(workspace[ARRAYS * k + RUB], i)
                rubbed = pushed(rubbed, row(rigid.shape, i), push, lightness)
    strength, reach = law(0.0 * tau * before[0][0], planes, bowl)
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            impulse, share, a = row(workspace[ARRAYS * k + PUSH], i)
            h, curvature, gap = row(workspace[ARRAYS * k + GAP], i)
            near = minimum(gap, -impulse)
            if particles.free[i] and any_lane(near < 0.0):
                place = row(rigid.shape, i)
                if damping is not None:
                    n = row(workspace[ARRAYS * k + NORMAL], i)
                    u = dot(n, velocity_of(place, motion, rigid)) - a * share + curvature / tau
                    touching = maximum(near, minimum(h, h + tau * u) - reach) < 0.0
                    _, _, loss = bounce(h, u, tau, strength * a, reach, damping, touching)
                    record(ledger, CONTACT, select(touching, loss / a, 0.0))
                if friction is not None:
                    mean = plus(velocity_of(place, before, rigid), velocity_of(place, rubbed, rigid))
                    record(ledger, FRICTION, -0.5 * dot(row(workspace[ARRAYS * k + RUB], i), mean))


@compiled
def slide(
    q: Vector,
    spin: Vector,
    position: Vector,
    velocity: Vector,
    tau: Number,
    warm: Any,
    ledger: Ledger,
    workspace: np.ndarray,
    axes: Any,
    lightness: Number,
    rigid: Rigid,
    asymmetry: Numbers,
    particles: Particles,
    planes: Planes | None,
    bowl: HollowSphere | None,
    friction: Numbers,
    damping: Numbers,
) -> Any:
    """Fly for ``tau`` seconds, with the impulses of surfaces.

    If ``warm``, the workspace has those of the step before. Returns q, spin, position, velocity, and a
    number that is negative where surfaces are near.
    """
    begin = (position, turned(axes, q))
    q_end, spin_end, position_end = fly(q, spin, position, velocity, tau, rigid, asymmetry)
    end = (position_end, turned(axes, q_end))
    _, reach = law(0.0 * spin[0], planes, bowl)
    margin = 1.0 + 0.0 * spin[0]
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            if particles.free[i]:
                h, _ = touch(i, k, begin, rigid, planes, bowl)
                ahead, _ = touch(i, k, end, rigid, planes, bowl)
                margin = minimum(margin, minimum(h, ahead) - reach)
    if any_lane(margin < 0.0):
        if not warm:
            start_over(workspace, times(0.0, spin), particles, planes, bowl)
        before = (components(begin[1], velocity), spin)
        approach(workspace, begin, lightness, rigid, particles, planes, bowl)
        bend(workspace, tau, end, before, margin, rigid, particles, planes, bowl)
        motion = resume(before, workspace, margin, lightness, rigid, particles, planes, bowl)
        active = select(margin < 0.0, 1.0 + 0.0 * margin, 0.0)
        for flight in range(FLIGHTS):
            if flight > 0:
                changed = bend(workspace, tau, end, motion, margin, rigid, particles, planes, bowl)
                active = select(changed > FLAT * reach, active, 0.0)
                if not any_lane(active > 0.5):
                    break
            motion = push_apart(
                motion,
                tau,
                active,
                workspace,
                lightness,
                rigid,
                particles,
                planes,
                bowl,
                friction,
                damping,
            )
            # What is not near keeps its velocity to the bit.
            velocity = choose(margin < 0.0, combine(begin[1], motion[0]), velocity)
            q_end, spin_end, position_end = fly(q, motion[1], position, velocity, tau, rigid, asymmetry)
            end = (position_end, turned(axes, q_end))
        if ledger is not None:
            account(
                before,
                motion,
                tau,
                ledger,
                workspace,
                lightness,
                rigid,
                particles,
                planes,
                bowl,
                friction,
                damping,
            )
        motion = (components(end[1], velocity), spin_end)
        for k in range(surfaces(planes, bowl)):
            for i in range(particles.mass.size):
                impulse, share, _ = row(workspace[ARRAYS * k + PUSH], i)
                if any_lane(impulse > 0.0):
                    _, n = touch(i, k, end, rigid, planes, bowl)
                    motion = pushed(motion, row(rigid.shape, i), times(impulse - share, n), lightness)
        velocity = choose(margin < 0.0, combine(end[1], motion[0]), velocity)
        spin_end = motion[1]
    return q_end, spin_end, position_end, velocity, margin


@compiled
def rub(
    q: Vector,
    spin: Any,
    position: Any,
    velocity: Vector,
    margin: Number,
    ledger: Ledger,
    workspace: np.ndarray,
    axes: Any,
    lightness: Number,
    rigid: Rigid,
    particles: Particles,
    planes: Planes | None,
    bowl: HollowSphere | None,
    friction: Numbers,
) -> Any:
    """Friction with the impulses J − s at the end of a flight; returns spin and velocity."""
    pose = (position, turned(axes, q))
    before = (components(pose[1], velocity), spin)
    motion = before
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            impulse, share, _ = row(workspace[ARRAYS * k + PUSH], i)
            if any_lane(impulse > 0.0):
                # The friction that the flight began with is a good guess.
                place = row(rigid.shape, i)
                _, n = touch(i, k, pose, rigid, planes, bowl)
                held = row(workspace[ARRAYS * k + RUB], i)
                held = minus(held, times(dot(n, held), n))
                limit = load(friction, 0) * (impulse - share)
                held = times(minimum(limit / sqrt(dot(held, held) + TINY), 1.0), held)
                set_row(workspace[ARRAYS * k + RUB], i, held)
                set_row(workspace[ARRAYS * k + NORMAL], i, n)
                motion = pushed(motion, place, held, lightness)
    active = select(margin < 0.0, 1.0 + 0.0 * margin, 0.0)
    for _ in range(SWEEPS):
        changed, fastest = 0.0 * margin, 0.0 * margin
        for k in range(surfaces(planes, bowl)):
            for i in range(particles.mass.size):
                impulse, share, a = row(workspace[ARRAYS * k + PUSH], i)
                if any_lane(impulse > 0.0):
                    held, motion, change = stick(
                        row(rigid.shape, i),
                        row(workspace[ARRAYS * k + NORMAL], i),
                        row(workspace[ARRAYS * k + RUB], i),
                        load(friction, 0) * (impulse - share),
                        motion,
                        active,
                        lightness,
                        rigid,
                    )
                    set_row(workspace[ARRAYS * k + RUB], i, held)
                    changed = maximum(changed, change)
                    fastest = maximum(fastest, a * impulse)
        active = select(changed > CONVERGED * fastest, active, 0.0)
        if not any_lane(active > 0.5):
            break
    if ledger is not None:
        for k in range(surfaces(planes, bowl)):
            for i in range(particles.mass.size):
                impulse, _, _ = row(workspace[ARRAYS * k + PUSH], i)
                if any_lane(impulse > 0.0):
                    place = row(rigid.shape, i)
                    mean = plus(velocity_of(place, before, rigid), velocity_of(place, motion, rigid))
                    record(ledger, FRICTION, -0.5 * dot(row(workspace[ARRAYS * k + RUB], i), mean))
    return motion[1], choose(margin < 0.0, combine(pose[1], motion[0]), velocity)
