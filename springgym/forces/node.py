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
from springgym.forces.contact import barrier_energy, height
from springgym.forces.ledger import CONTACT, DAMPING, FRICTION, HELD, WORK, record
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
    place: Any,
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

    ``place`` is where it is; ``first`` and ``last`` are its positions half a step before and after the node, without the surfaces, and
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
                i, place, first, last, slip, tau, leave, particles, bowl, friction, damping
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
    place: Any,
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

    The impulse acts along the normal n at the node. With d from the centre and r = |d|, the
    heights at the ends of the step differ by exactly n̄ · (d₁ − d₀), n̄ = −(d₀ + d₁)/(r₀ + r₁), s = n̄ · n: the
    motion along n̄ is that above a plane. What the impulse does to the ends is found by iteration.
    """
    begin, free = minus(first, vector(bowl.centre)), minus(last, vector(bowl.centre))
    early, late = (0.25 * tau, 0.25 * tau) if leave else (0.0 * tau, 0.5 * tau)
    near, far = sqrt(dot(begin, begin) + TINY), sqrt(dot(free, free) + TINY)
    touching = maximum(near, far) > bowl.radius - bowl.reach
    push, lost = 0.0 * near, 0.0 * near
    n = minus(place, vector(bowl.centre))
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
def set_out(x: Any, v: Any, a: Any, b: Any, h: Any, space: Any, terms: Any) -> None:
    """Begin a node: kick h/2, and half of what the surfaces are going to give, as far as is known.

    Dampers must see the mean velocity of before and after the node, else rest looks like stretching to them.
    ``a`` and ``b`` (N, 3) are the accelerations by springs and gravity, and by actuators. ``space`` are
    workspace arrays: velocities before, and as left here, what of them the surfaces gave, one for the surfaces.
    """
    before, middle, given, pushes = space
    surfaces = (terms.particles, terms.planes, terms.bowl, terms.friction, terms.impact_damping)
    for i in range(v.shape[0]):
        start = row(v, i)
        set_row(before, i, start)
        change = foreseen(
            i, row(x, i), start, row(a, i), b, h, pushes, terms.dampers, terms.wrench, terms.thrust, *surfaces
        )
        half = times(0.5, change)
        kicked = plus(plus_scaled(start, 0.5 * h, row(a, i)), half)
        set_row(given, i, half)
        set_row(middle, i, kicked)
        set_row(v, i, kicked)


@compiled
def foreseen(
    i: Any,
    place: Any,
    start: Any,
    acceleration: Any,
    b: Any,
    h: Any,
    pushes: Any,
    dampers: Any,
    wrench: Any,
    thrust: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """The change of velocity [m/s] by the surfaces as it is without dampers, if there are any."""
    if dampers is None:
        return times(0.0, start)
    free = plus_scaled(start, h, with_actuators(acceleration, b, i, wrench, thrust))
    first, last = plus_scaled(place, -0.5 * h, start), plus_scaled(place, 0.5 * h, free)
    change, _, _ = surfaces_change(
        i, place, first, last, free, h, False, pushes, particles, planes, bowl, friction, damping
    )
    return change


@compiled
def with_actuators(acceleration: Any, b: Any, i: Any, wrench: Any, thrust: Any) -> Any:
    """An acceleration with that by actuators, if there are any."""
    if wrench is None and thrust is None:
        return acceleration
    return plus(acceleration, row(b, i))


@compiled
def keep(v: Any, space: Any) -> None:
    """Begin the second half of a node: nothing is given yet."""
    for i in range(v.shape[0]):
        start = row(v, i)
        set_row(space[0], i, start)
        set_row(space[1], i, start)
        set_row(space[2], i, times(0.0, start))


@compiled
def meet_surfaces(x: Any, v: Any, a: Any, h: Any, part: Any, space: Any, ledger: Any, terms: Any) -> None:
    """Give what the surfaces give at a node, or at a ``part`` of it.

    All else has been given but the last kick by ``a``, of h/2; ``space`` as in `set_out`.
    """
    before, middle, given, pushes = space
    particles = terms.particles
    surfaces = (particles, terms.planes, terms.bowl, terms.friction, terms.impact_damping)
    leave = part == LEAVE
    share = 1.0 if part == WHOLE else 0.5
    stray = 0.0 * load(v, (0, 0))
    rubbed, lost, held = stray, stray, stray
    for i in range(v.shape[0]):
        start, place, now = row(before, i), row(x, i), row(v, i)
        soon = minus(now, row(given, i))
        if part == ARRIVE:
            slip = plus(soon, minus(soon, start))
        else:
            slip = plus_scaled(soon, 0.5 * h, row(a, i))
        last = plus_scaled(place, 0.5 * h, slip)
        if leave:
            first = plus_scaled(last, -h, start)
        else:
            first = plus_scaled(place, -0.5 * h, start)
        change, rub, loss = surfaces_change(i, place, first, last, slip, h, leave, pushes, *surfaces)
        more = minus(times(share, change), row(given, i))
        end = plus(now, more)
        set_row(v, i, end)
        if ledger is not None:
            mass = load(particles.mass, i)
            other = minus(now, row(middle, i))
            if part == WHOLE:
                stray = stray + mass * dot(other, minus(times(0.5, change), row(given, i)))
                mean = times(0.5, plus_scaled(plus(start, end), 0.5 * h, row(a, i)))
            elif part == ARRIVE:
                stray = stray + mass * dot(other, more)
                mean = end
                swing = times(0.5, change)
                held = held + mass * dot(swing, plus(times(0.25, change), other))
                after = plus(end, minus(end, start))
                last = plus_scaled(place, 0.5 * h, after)
                held = held + 0.5 * (
                    energy_at(i, first, particles, terms.planes, terms.bowl)
                    + energy_at(i, last, particles, terms.planes, terms.bowl)
                )
                held = held - energy_at(i, place, particles, terms.planes, terms.bowl)
            else:
                mean = start
            rubbed = rubbed - mass * dot(rub, mean)
            lost = lost + loss
    if ledger is not None:
        record_stray(ledger, stray, terms.dampers)
        record(ledger, CONTACT, share * lost)
        record(ledger, FRICTION, share * rubbed)
        store(ledger, HELD, held)


@compiled
def record_stray(ledger: Any, stray: Any, dampers: Any) -> None:
    """The work of what acted before the surfaces' share was known, by the change that they made to it."""
    if dampers is None:
        record(ledger, WORK, stray)
    else:
        record(ledger, DAMPING, -1.0 * stray)


@compiled
def energy_at(i: Any, place: Any, particles: Any, planes: Any, bowl: Any) -> Any:
    """Energy of particle ``i`` in the surfaces' barriers [J], at a ``place``."""
    energy = 0.0 * place[0]
    if particles.free[i]:
        if planes is not None:
            for k in range(planes.offset.size):
                energy = energy + barrier_energy(
                    height(place, planes, k), load(planes.strength, 0), planes.reach
                )
        if bowl is not None:
            from_centre = minus(place, vector(bowl.centre))
            h = bowl.radius - sqrt(dot(from_centre, from_centre))
            energy = energy + barrier_energy(h, load(bowl.strength, 0), bowl.reach)
    return energy
