"""Contact of the rigid body: the law of `springgym.forces.contact` for particles that move as one.

A step flies freely for half of it, receives all impulses at its node, and flies freely for the other half. A
particle near a surface gives way along the normal n by the ease A = 1/M + (r × n) · I⁻¹ (r × n) per impulse.
With h the height at the node, u the speed along n after it without the particle's own impulse J, and κ what
the second flight bends, the step ends at

    h₁ = h + τ/2 (u + A J) + κ:

`meet` finds J as for a particle of mass 1/A. Friction stops the particle's motion along the surface if the
impulse that this needs is within μ J, else it is that, against the motion. So what rests stays where it is.

All particles act on each other through the motion of the body. They are taken one after the other until none
changes (Gauss and Seidel; without friction and loss, the solution is the minimum of a convex function), then
the second flight is flown and κ put right, until that does not change either.
"""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.forces.contact import meet
from springgym.forces.ledger import CONTACT, FRICTION, record
from springgym.lanes import any_lane, load, maximum, minimum, select, sqrt
from springgym.rigid.flight import angular_velocity, combine, components, fly, turned
from springgym.surfaces import NEAREST
from springgym.vectors import TINY, choose, cross, dot, minus, plus, row, set_row, times, vector

FLIGHTS = 8
"""How often the flight after the node is flown, at the most; what is left of the effect of its curvature
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

PUSH, RUB, NORMAL, GAP, LOSS = range(5)
"""(J, A, h₀), friction, n, (h, κ, whether it may touch: least height − Δ), (energy lost, –, –); what is not
near has J = 0. Vectors are in body coordinates at the node."""

ARRAYS = 5


@compiled
def touch(i: Any, k: Any, pose: Any, rigid: Any, planes: Any, bowl: Any) -> Any:
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
def surfaces(planes: Any, bowl: Any) -> int:
    """How many there are: planes or a bowl."""
    count = 0
    if planes is not None:
        count += planes.offset.size
    if bowl is not None:
        count += 1
    return count


@compiled
def law(nothing: Any, planes: Any, bowl: Any) -> Any:
    """Strength and reach of the barrier; ``nothing`` is a zero in every lane."""
    strength, reach = nothing, 0.0
    if planes is not None:
        strength, reach = nothing + load(planes.strength, 0), planes.reach
    if bowl is not None:
        strength, reach = nothing + load(bowl.strength, 0), bowl.reach
    return strength, reach


@compiled
def ease(arm: Any, lightness: Any, rigid: Any) -> Any:
    """1/M + (r × n) · I⁻¹ (r × n): speed along n per impulse along n."""
    return lightness + dot(arm, angular_velocity(arm, rigid))


@compiled
def velocity_of(place: Any, motion: Any, rigid: Any) -> Any:
    """Velocity of a particle. A motion is velocity and angular momentum, both in body coordinates."""
    return plus(motion[0], cross(angular_velocity(motion[1], rigid), place))


@compiled
def pushed(motion: Any, place: Any, push: Any, lightness: Any) -> Any:
    """The motion after an impulse at a particle; ``lightness`` is 1/M, or 0 of a pinned body."""
    return plus(motion[0], times(lightness, push)), plus(motion[1], cross(place, push))


@compiled
def hold(
    place: Any, n: Any, old: Any, limit: Any, motion: Any, active: Any, lightness: Any, rigid: Any
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
def begin(workspace: Any, pose: Any, warm: Any, rigid: Any, particles: Any, planes: Any, bowl: Any) -> Any:
    """Set the heights that a step begins with; forget the impulses of the step before unless ``warm``.

    Returns the least of the heights of free particles.
    """
    nothing = 0.0 * pose[0][0]
    _, reach = law(nothing, planes, bowl)
    lowest = nothing + 1e300
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            h, _ = touch(i, k, pose, rigid, planes, bowl)
            h = select(h > 0.0, h, NEAREST * reach)  # thrown behind by a flight that bent too much
            impulse = nothing
            if warm:
                impulse, _, _ = row(workspace[ARRAYS * k + PUSH], i)
            else:
                set_row(workspace[ARRAYS * k + RUB], i, (nothing, nothing, nothing))
            set_row(workspace[ARRAYS * k + PUSH], i, (impulse, nothing, h))
            if particles.free[i]:
                lowest = minimum(lowest, h)
    return lowest


@compiled
def least_height(pose: Any, rigid: Any, particles: Any, planes: Any, bowl: Any) -> Any:
    """Of the free particles above the surfaces."""
    lowest = 0.0 * pose[0][0] + 1e300
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            if particles.free[i]:
                h, _ = touch(i, k, pose, rigid, planes, bowl)
                lowest = minimum(lowest, h)
    return lowest


@compiled
def approach(
    workspace: Any,
    pose: Any,
    near: Any,
    motion: Any,
    lightness: Any,
    rigid: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
) -> Any:
    """Set heights, normals and eases at the node; returns the motion with the impulses of the step before.

    They are a good guess, and dropped where nothing is ``near``.
    """
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            h, n = touch(i, k, pose, rigid, planes, bowl)
            place = row(rigid.shape, i)
            impulse, _, start = row(workspace[ARRAYS * k + PUSH], i)
            impulse = select(near, impulse, 0.0)
            held = row(workspace[ARRAYS * k + RUB], i)
            held = minus(held, times(dot(n, held), n))
            held = choose(near, held, times(0.0, held))
            a = ease(cross(place, n), lightness, rigid)
            set_row(workspace[ARRAYS * k + PUSH], i, (impulse, a, start))
            set_row(workspace[ARRAYS * k + RUB], i, held)
            set_row(workspace[ARRAYS * k + NORMAL], i, n)
            set_row(workspace[ARRAYS * k + GAP], i, (h, 0.0 * h, 0.0 * h))
            set_row(workspace[ARRAYS * k + LOSS], i, (0.0, 0.0, 0.0))
            if any_lane(impulse > 0.0):
                motion = pushed(motion, place, plus(held, times(impulse, n)), lightness)
    return motion


@compiled
def bend(
    workspace: Any,
    tau: Any,
    end: Any,
    motion: Any,
    near: Any,
    rigid: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
) -> Any:
    """Set what the second flight adds to the heights where it ends, given the motion that it begins with.

    Returns the largest change of that among what may touch.
    """
    nothing = 0.0 * tau * motion[0][0]
    _, reach = law(nothing, planes, bowl)
    changed = nothing
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            ahead, _ = touch(i, k, end, rigid, planes, bowl)
            n = row(workspace[ARRAYS * k + NORMAL], i)
            h, old, _ = row(workspace[ARRAYS * k + GAP], i)
            _, _, start = row(workspace[ARRAYS * k + PUSH], i)
            curvature = ahead - h - 0.5 * tau * dot(n, velocity_of(row(rigid.shape, i), motion, rigid))
            gap = select(near, minimum(start, ahead) - reach, 1.0)
            set_row(workspace[ARRAYS * k + GAP], i, (h, curvature, gap))
            change = maximum(curvature - old, old - curvature)
            changed = maximum(changed, select(gap < 0.0, change, 0.0))
    return changed


@compiled
def push_apart(
    motion: Any,
    tau: Any,
    active: Any,
    workspace: Any,
    lightness: Any,
    rigid: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """Find the impulses where ``active`` is 1; returns the motion after them."""
    strength, reach = law(0.0 * active, planes, bowl)
    for _ in range(SWEEPS):
        changed, fastest = 0.0 * active, 0.0 * active
        for k in range(surfaces(planes, bowl)):
            for i in range(particles.mass.size):
                impulse, a, start = row(workspace[ARRAYS * k + PUSH], i)
                h, curvature, gap = row(workspace[ARRAYS * k + GAP], i)
                if particles.free[i] and any_lane(minimum(gap, -impulse) < 0.0):
                    place = row(rigid.shape, i)
                    n = row(workspace[ARRAYS * k + NORMAL], i)
                    u = dot(n, velocity_of(place, motion, rigid)) - a * impulse
                    free = h + 0.5 * tau * u + curvature
                    touching = minimum(start, free) < reach
                    change, lost = meet(start, free, tau, strength * a, reach, damping)
                    new = select(touching, change / a, 0.0)
                    new = select(active > 0.5, new, impulse)
                    set_row(workspace[ARRAYS * k + PUSH], i, (new, a, start))
                    if damping is not None:
                        old, _, _ = row(workspace[ARRAYS * k + LOSS], i)
                        lost = select(active > 0.5, select(touching, lost / a, 0.0), old)
                        set_row(workspace[ARRAYS * k + LOSS], i, (lost, lost, lost))
                    motion = pushed(motion, place, times(new - impulse, n), lightness)
                    changed = maximum(changed, a * maximum(new - impulse, impulse - new))
                    fastest = maximum(fastest, a * new)
                    if friction is not None:
                        held, motion, change = hold(
                            place,
                            n,
                            row(workspace[ARRAYS * k + RUB], i),
                            load(friction, 0) * new,
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
    before: Any,
    motion: Any,
    ledger: Any,
    workspace: Any,
    rigid: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> None:
    """Enter what was lost in contact and, at the mean of the motions before and after, by friction."""
    for k in range(surfaces(planes, bowl)):
        for i in range(particles.mass.size):
            if particles.free[i]:
                if damping is not None:
                    lost, _, _ = row(workspace[ARRAYS * k + LOSS], i)
                    record(ledger, CONTACT, lost)
                if friction is not None:
                    place = row(rigid.shape, i)
                    twice = plus(velocity_of(place, before, rigid), velocity_of(place, motion, rigid))
                    record(ledger, FRICTION, -0.5 * dot(row(workspace[ARRAYS * k + RUB], i), twice))


@compiled
def bounce(
    q: Any,
    motion: Any,
    before: Any,
    position: Any,
    near: Any,
    end: Any,
    tau: Any,
    ledger: Any,
    workspace: Any,
    axes: Any,
    asymmetry: Any,
    lightness: Any,
    rigid: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """The motion after a node, given that without surfaces and the pose ``end`` to which it would lead.

    ``q`` and ``position`` are those of the node, ``before`` is the motion before it. Motions are of the
    body's point and in body coordinates; what is not ``near`` keeps its own to the bit.
    """
    pose = (position, turned(axes, q))
    free = motion
    motion = approach(workspace, pose, near, motion, lightness, rigid, particles, planes, bowl)
    bend(workspace, tau, end, free, near, rigid, particles, planes, bowl)
    _, reach = law(0.0 * tau * position[0], planes, bowl)
    active = select(near, 1.0 + 0.0 * position[0], 0.0)
    for _ in range(FLIGHTS):
        motion = push_apart(
            motion, tau, active, workspace, lightness, rigid, particles, planes, bowl, friction, damping
        )
        velocity = combine(pose[1], motion[0])
        q_end, _, position_end = fly(q, motion[1], position, velocity, 0.5 * tau, rigid, asymmetry)
        end = (position_end, turned(axes, q_end))
        changed = bend(workspace, tau, end, motion, near, rigid, particles, planes, bowl)
        active = select(changed > FLAT * reach, active, 0.0)
        if not any_lane(active > 0.5):
            break
    if ledger is not None:
        account(before, motion, ledger, workspace, rigid, particles, planes, bowl, friction, damping)
    return choose(near, motion[0], free[0]), choose(near, motion[1], free[1])
