"""The node of a step: the place where, in scenes with surfaces, all impulses of the step act at once.

Particles fly straight for half a step, receive the impulses of springs, gravity, actuators, dampers, surfaces
and friction, and fly straight for the other half. With v₋ and v₊ the velocities before and after the node,
the kinetic energy changes by exactly Σ p · (v₋ + v₊)/2 over all impulses p: so the ledger enters for each
kind of impulse its product with that mean velocity. What rests has no mean velocity, hence loses nothing.

Contact is an impulse along the normal. With h₀ and h₁ the heights half a step before and after the node,
h₁ = h₀ + τ (u₀ + u₁)/2, and the impulse per mass is τ times the discrete gradient of the barrier,

    F̄ = −(U(h₁) − U(h₀))/(h₁ − h₀),    J = τ F̄ (1 − d (h₁ − h₀)/τ)₊,

so that without loss its work, J (u₀ + u₁)/2, is exactly −(U(h₁) − U(h₀)), whatever else acts at the node
(Gonzalez, J. Nonlinear Sci. 6 (1996) 449, doi:10.1007/BF02440162).

The state is read at a node, with the velocity v̄ = (v₋ + v₊)/2: that of velocity Verlet where nothing
touches. v̄ says all: h₁ − h₀ = τ v̄, so that only the mean of both heights is unknown. The second half of a node
(`LEAVE`) finds the impulse from x and v̄ alone, the same that the first half (`ARRIVE`) found from v₋:

    h₀ = s + τ J/4,    h₁ = e + τ J/4,

with e = x + τ/2 (v̄ + all half impulses but J/2), s = e − τ v̄: one root, with both heights positive.
"""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.forces.actuators import driven_acceleration
from springgym.forces.contact import height
from springgym.forces.ledger import CONTACT, DAMPING, FRICTION, WORK, record
from springgym.forces.springs import damp
from springgym.lanes import any_lane, load, maximum, minimum, select, sqrt, store
from springgym.vectors import TINY, choose, dot, minus, plus, plus_scaled, row, set_row, times, vector

WHOLE, LEAVE, ARRIVE = range(3)
"""Which part of a node: all of it, or what comes after or before the state is read."""

ROUNDS = 30
"""Most rounds of Newton's method for a height; it squares the error each time."""

CONVERGED = 1e-7
"""Change of a height, as a share of Δ, at which Newton's method has it: the error left is the square."""

TURNS = 20
"""How often planes at a wide angle are taken in turn, at the most."""

NORMALS = 4
"""How often the ends of a step in a dish are found: each time the error shrinks by some (τ v/R)²."""

LEAST = 1e-6
"""A step begins and ends at this share of Δ or higher."""


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
    start = maximum(start, LEAST * reach)
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
            here = maximum(guess, LEAST * reach)
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


@compiled
def between(start: Any, end: Any, tau: Any, c: Any, reach: Any, damping: Any) -> Any:
    """As `meet`, where a change J of the speed moves both ends of the step, each by τ J/4.

    ``start`` and ``end`` are the heights without it. The lower height y solves
    y (y − lower) = τ²c/4 (1 − d v̄)₊ y F̄(y, y + w), with w the distance of the two, which J does not change.
    """
    way = end - start
    lower, width = minimum(start, end), maximum(maximum(way, -way), 1e-30)
    follow = 1.0 + 0.0 * way
    if damping is not None:
        follow = maximum(1.0 - load(damping, 0) / tau * way, 0.0)
    gain, flat = (0.25 * tau * tau) * c * follow, 1.0 / (reach * reach)
    low, high = maximum(lower, 0.0), reach + 0.0 * way
    y = select(lower > 0.0, lower, 0.5 * reach)
    active = select(lower < reach, 1.0 + 0.0 * way, 0.0)
    for _ in range(ROUNDS):
        depth, far = reach - y, y + width
        partly = far > reach
        push = select(partly, depth * depth * flat / width, 1.0 / far - y * flat)  # y F̄
        slope = select(partly, -2.0 * depth * flat / width, -1.0 / (far * far) - flat)
        wrong = y * (y - lower) - gain * push
        above = wrong > 0.0
        high, low = select(above, y, high), select(above, low, y)
        new = y - wrong / (2.0 * y - lower - gain * slope)
        outside = minimum(new - low, high - new) < 0.0
        new = select(outside, 0.5 * (low + high), new)
        change = maximum(new - y, y - new)
        y = select(active > 0.5, new, y)
        active = select(change > CONVERGED * reach, active, 0.0)
        if not any_lane(active > 0.5):
            break
    y = maximum(y, LEAST * reach)
    depth, far = reach - y, y + width
    mean = select(far > reach, depth * depth * flat / (width * y), 1.0 / (y * far) - flat)
    full = tau * c * maximum(mean, 0.0)
    return full * follow, full * (1.0 - follow) * way / tau


# --- Surfaces -----------------------------------------------------------------------------------------


@compiled
def slowed(slip: Any, limit: Any) -> Any:
    """What friction takes from the tangential velocity ``slip``: ``limit`` [m/s] of it, or all there is."""
    return times(minimum(limit / sqrt(dot(slip, slip) + TINY), 1.0), slip)


@compiled
def surfaces_change(
    i: Any,
    first: Any,
    last: Any,
    slip: Any,
    tau: Any,
    leave: Any,
    space: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """The change of velocity [m/s] of particle ``i`` by the surfaces and their friction, at a whole node.

    ``first`` and ``last`` are its positions half a step before and after the node, without the surfaces, and
    ``slip`` its velocity without them; ``leave`` as in `LEAVE`. ``space`` (surfaces, 3) is workspace. Returns
    also what of that is friction, and the energy lost in the contact [J].
    """
    change, rub = times(0.0, slip), times(0.0, slip)
    lost = change[0]
    if particles.free[i]:
        if planes is not None:
            change, rub, lost = planes_change(
                i, first, last, slip, tau, leave, space, particles, planes, friction, damping
            )
        if bowl is not None:
            change, rub, lost = bowl_change(
                i, first, last, slip, tau, leave, particles, bowl, friction, damping
            )
    return change, rub, lost


@compiled
def planes_change(
    i: Any,
    first: Any,
    last: Any,
    slip: Any,
    tau: Any,
    leave: Any,
    pushes: Any,
    particles: Any,
    planes: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """`surfaces_change` of planes.

    At a right angle they do not know of each other. At a wider one what one gives moves the particle from
    the other, too: they are taken in turn until they agree. Friction acts along what the planes that are
    touched leave free, so that it moves nothing towards a plane.
    """
    nothing = times(0.0, slip)
    given, lost = nothing, nothing[0]
    c = load(planes.strength, 0) * load(particles.inverse_mass, i)
    early, late = (0.25 * tau, 0.25 * tau) if leave else (0.0 * tau, 0.5 * tau)
    share = 0.5 if leave else 1.0
    for turn in range(TURNS if planes.oblique else 1):
        lost, changed = nothing[0], nothing[0]
        for k in range(planes.offset.size):
            n = row(planes.normal, k)
            start, free = height(first, planes, k), height(last, planes, k)
            own = nothing[0]
            if planes.oblique:
                if turn > 0:
                    own = load(pushes, (k, 0))
                others = dot(n, given) - own
                start, free = start + early * others, free + late * others
            touching = minimum(start, free) < planes.reach
            push = nothing[0]
            if any_lane(touching):
                if leave:
                    push, loss = between(start, free, tau, c, planes.reach, damping)
                else:
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
        left, normal, pressed, touched = slip, nothing, nothing[0], nothing[0]
        for k in range(planes.offset.size):
            push = load(pushes, (k, 0))
            touching = push > 0.0
            if any_lane(touching):
                n = row(planes.normal, k)
                across = minus(n, times(dot(n, normal), normal))
                if k > 0:
                    across = times(1.0 / sqrt(dot(across, across) + TINY), across)
                left = minus(left, times(select(touching, dot(across, left), 0.0), across))
                one = select(touching, 1.0 + nothing[0], 0.0)
                normal = choose(touched > 0.0, normal, times(one, n))
                touched = touched + one
                pressed = pressed + push
        left = choose(touched > 2.0, nothing, left)
        rub = times(-1.0 / share, slowed(left, load(friction, 0) * (share * pressed)))
    return plus(given, rub), rub, load(particles.mass, i) * lost


@compiled
def bowl_change(
    i: Any,
    first: Any,
    last: Any,
    slip: Any,
    tau: Any,
    leave: Any,
    particles: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """`surfaces_change` of a bowl.

    The impulse acts along the normal n at the middle of first and last. With d from the centre and r = |d|, the
    heights at the ends of the step differ by exactly n̄ · (d₁ − d₀), n̄ = −(d₀ + d₁)/(r₀ + r₁), s = n̄ · n: the
    motion along n̄ is that above a plane. What the impulse does to the ends is found by iteration.
    """
    begin, free = minus(first, vector(bowl.centre)), minus(last, vector(bowl.centre))
    early, late = (0.25 * tau, 0.25 * tau) if leave else (0.0 * tau, 0.5 * tau)
    near, far = sqrt(dot(begin, begin) + TINY), sqrt(dot(free, free) + TINY)
    touching = maximum(near, far) > bowl.radius - bowl.reach
    push, lost = 0.0 * near, 0.0 * near
    n = plus(begin, free)
    n = times(-1.0 / sqrt(dot(n, n) + TINY), n)
    c = load(bowl.strength, 0) * load(particles.inverse_mass, i)
    if any_lane(touching):
        for _ in range(NORMALS):
            d0, d1 = plus_scaled(begin, early * push, n), plus_scaled(free, late * push, n)
            near, far = sqrt(dot(d0, d0) + TINY), sqrt(dot(d1, d1) + TINY)
            mean = times(-1.0 / (near + far), plus(d0, d1))
            s = dot(mean, n)
            start = bowl.radius - near - (early * push) * s
            reached = start + dot(mean, minus(d1, d0)) - ((late - early) * push) * s
            meeting = minimum(start, reached) < bowl.reach
            if leave:
                push, lost = between(start, reached, tau, c * s * s, bowl.reach, damping)
            else:
                push, lost = meet(start, reached, tau, c * s * s, bowl.reach, damping)
            push = select(meeting, push / s, 0.0)
            lost = select(meeting, lost / (s * s), 0.0)
        push, lost = select(touching, push, 0.0), select(touching, lost, 0.0)
    rub = times(0.0, slip)
    if friction is not None:
        share = 0.5 if leave else 1.0
        left = minus(slip, times(dot(n, slip), n))
        rub = times(-1.0 / share, slowed(left, load(friction, 0) * (share * push)))
    return plus(times(push, n), rub), rub, load(particles.mass, i) * lost


# --- The node -------------------------------------------------------------------------------------------


@compiled
def act_at_node(
    x: Any, v: Any, a: Any, b: Any, h: Any, part: Any, backward: Any, space: Any, ledger: Any, terms: Any
) -> None:
    """Change the velocities by all that acts at a node, or in a ``part`` of it.

    ``a`` and ``b`` (N, 3) are the accelerations by springs and gravity, and by actuators. The dampers are
    taken in reverse order if ``backward``. ``space`` are workspace arrays: directions of the springs, v₋,
    velocities that dampers start from, one for the surfaces.
    """
    direction, before, middle, pushes = space
    particles, dampers = terms.particles, terms.dampers
    share = 1.0 if part == WHOLE else 0.5
    leave = part == LEAVE
    tau = share * h
    surfaces = (particles, terms.planes, terms.bowl, terms.friction, terms.impact_damping)
    for i in range(v.shape[0]):
        start = row(v, i)
        set_row(before, i, start)
        kick = with_actuators(row(a, i), b, i, terms.wrench, terms.thrust)
        kick = unless_driven(kick, start, i, tau, terms.drive)
        set_row(a, i, kick)
        show_dampers(i, x, v, start, kick, h, leave, middle, pushes, dampers, *surfaces)
    sweep(v, direction, terms.springs, dampers, terms.drive, part, backward)
    work = 0.0 * load(v, (0, 0))
    damped, rubbed, lost = work, work, work
    for i in range(v.shape[0]):
        start, place = row(before, i), row(x, i)
        taken = taken_by_dampers(v, middle, i, dampers)
        smooth = plus_scaled(taken, tau, row(a, i))
        if leave:
            slip = plus(start, smooth)
            last = plus_scaled(place, 0.5 * h, slip)
            first = plus_scaled(last, -h, start)
        else:
            slip = plus_scaled(start, 1.0 / share, smooth)
            last = plus_scaled(place, 0.5 * h, slip)
            first = plus_scaled(place, -0.5 * h, start)
        change, rub, loss = surfaces_change(i, first, last, slip, h, leave, pushes, *surfaces)
        end = plus_scaled(plus(start, smooth), share, change)
        set_row(v, i, end)
        if ledger is not None:
            twice = times(load(particles.mass, i), plus(start, end))
            work = work + power_of_actuators(b, i, twice, terms.wrench, terms.thrust)
            damped = damped - dot(taken, twice)
            rubbed = rubbed - dot(rub, twice)
            lost = lost + loss
    if ledger is not None:
        record(ledger, WORK, (0.5 * tau) * (work + work_of_drive(before, v, b, terms.drive)))
        record(ledger, DAMPING, 0.5 * damped)
        record(ledger, CONTACT, share * lost)
        record(ledger, FRICTION, (0.5 * share) * rubbed)


@compiled
def with_actuators(acceleration: Any, b: Any, i: Any, wrench: Any, thrust: Any) -> Any:
    """An acceleration with that by actuators, if there are any."""
    if wrench is None and thrust is None:
        return acceleration
    return plus(acceleration, row(b, i))


@compiled
def power_of_actuators(b: Any, i: Any, twice: Any, wrench: Any, thrust: Any) -> Any:
    if wrench is None and thrust is None:
        return 0.0 * twice[0]
    return dot(row(b, i), twice)


@compiled
def unless_driven(acceleration: Any, velocity: Any, i: Any, tau: Any, drive: Any) -> Any:
    """An acceleration, or that of the drive for its particle: as asked for, up to its largest speed."""
    if drive is not None:
        if i == drive.particle:
            acceleration = driven_acceleration(velocity, tau, drive)
    return acceleration


@compiled
def show_dampers(
    i: Any,
    x: Any,
    v: Any,
    start: Any,
    kick: Any,
    h: Any,
    leave: Any,
    middle: Any,
    pushes: Any,
    dampers: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> None:
    """Set the velocity that dampers see: the mean of before and after the node, without them."""
    if dampers is not None:
        seen = start
        if not leave:
            free = plus_scaled(start, h, kick)
            first, last = plus_scaled(row(x, i), -0.5 * h, start), plus_scaled(row(x, i), 0.5 * h, free)
            change, _, _ = surfaces_change(
                i, first, last, free, h, leave, pushes, particles, planes, bowl, friction, damping
            )
            seen = plus(plus_scaled(start, 0.5 * h, kick), times(0.5, change))
        set_row(middle, i, seen)
        set_row(v, i, seen)


@compiled
def taken_by_dampers(v: Any, middle: Any, i: Any, dampers: Any) -> Any:
    """What dampers have done to a velocity."""
    if dampers is None:
        return times(0.0, row(v, i))
    return minus(row(v, i), row(middle, i))


@compiled
def work_of_drive(before: Any, v: Any, holding: Any, drive: Any) -> Any:
    work = 0.0 * load(v, (0, 0))
    if drive is not None:
        if drive.particle >= 0:
            i = drive.particle
            work = dot(row(holding, i), plus(row(before, i), row(v, i)))
    return work


@compiled
def sweep(v: Any, direction: Any, springs: Any, dampers: Any, drive: Any, part: Any, backward: Any) -> None:
    """Let the dampers act for a whole step, or for the half of it that belongs to a ``part``."""
    if dampers is not None:
        if part == LEAVE:
            damp(v, direction, springs, dampers, drive, None, False, False)
        elif part == ARRIVE:
            damp(v, direction, springs, dampers, drive, None, True, False)
        elif dampers.paired:
            damp(v, direction, springs, dampers, drive, None, True, False)
            damp(v, direction, springs, dampers, drive, None, False, False)
        else:
            damp(v, direction, springs, dampers, drive, None, backward, True)
