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
from springgym.forces.contact import barrier_energy, decay_means, height
from springgym.forces.ledger import CONTACT, DAMPING, FRICTION, HELD, LIFTS, MET, WORK, record
from springgym.forces.springs import spring_energy
from springgym.lanes import any_lane, load, maximum, minimum, select, sqrt, store
from springgym.vectors import TINY, choose, dot, minus, plus, plus_scaled, row, set_row, times, vector

WHOLE, LEAVE, ARRIVE = range(3)
"""Which part of a node: all of it, or what comes after or before the state is read."""

ROUNDS = 30
"""Most rounds of Newton's method for a height; it squares the error each time."""

CONVERGED = 1e-7
"""Change of a height, as a share of it, at which Newton's method has it: the error left is the square."""

TURNS = 20
"""How often planes at a wide angle are taken in turn, at the most."""

NORMALS = 4
"""How often the ends of a step in a dish are found: each time the error shrinks by some (τ v/R)²."""

FOUND = 1e-12
"""As `CONVERGED`, where Newton's method does not square the error."""

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
def meet(start: Any, free: Any, tau: Any, c: Any, reach: Any) -> Any:
    """The change of speed [m/s] by a barrier without loss in a step of ``tau`` seconds.

    ``start`` is the height h₀ [m] at the start of the step, ``free`` the height a that is reached at its end
    without the barrier, of which at least one must be less than ``reach``; ``c`` is the strength per mass
    [m³/s²].
    """
    start = maximum(start, LEAST * reach)
    gain, flat = (0.5 * tau * tau) * c, 1.0 / (reach * reach)
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
    return tau * c * maximum(mean, 0.0)


@compiled
def between(start: Any, end: Any, tau: Any, c: Any, reach: Any) -> Any:
    """As `meet`, where a change J of the speed moves both ends of the step, each by τ J/4.

    ``start`` and ``end`` are the heights without it. The lower height y solves
    y (y − lower) = τ²c/4 y F̄(y, y + w), with w the distance of the two, which J does not change.
    """
    way = end - start
    lower, width = minimum(start, end), maximum(maximum(way, -way), 1e-30)
    gain, flat = (0.25 * tau * tau) * c, 1.0 / (reach * reach)
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
        active = select(change > CONVERGED * y, active, 0.0)
        if not any_lane(active > 0.5):
            break
    y = maximum(y, LEAST * reach)
    depth, far = reach - y, y + width
    mean = select(far > reach, depth * depth * flat / (width * y), 1.0 / (y * far) - flat)
    return tau * c * maximum(mean, 0.0)


@compiled
def gradient(start: Any, end: Any, reach: Any) -> Any:
    """F̄/c [1/m²] between two heights, the end inside the barrier or beyond it; and its derivative by the end."""
    flat = 1.0 / (reach * reach)
    before, after = maximum(reach - start, 0.0), maximum(reach - end, 0.0)
    gap = end - start
    gap = select(gap < 0.0, minimum(gap, -1e-30), maximum(gap, 1e-30))
    mean = (before * before * flat / start - after * after * flat / end) / gap
    slope = (after * (reach + end) * flat / (end * end) - mean) / gap
    inside = maximum(start, end) < reach
    mean = select(inside, 1.0 / (start * end) - flat, mean)
    return maximum(mean, 0.0), select(inside, -1.0 / (start * end * end), slope)


@compiled
def meet_with_loss(start: Any, u: Any, s: Any, tau: Any, c: Any, reach: Any, d: Any) -> Any:
    """What a barrier with loss does in a step of ``tau`` seconds, to a speed ``u`` that all else changes by ``s``.

    All acts evenly over the step: dv/dθ = s + J (1 − d v), θ = 0 … 1, J = τ F̄. With x = d J,
    φ = (1 − e⁻ˣ)/x, ψ = (1 − φ)/x and e = s + J (1 − d u) it ends at u + e φ, and the mean speed is V̄ = u + e ψ;
    the height reached is h₁ = h₀ + τ V̄. So J V̄ is exactly the work of the barrier: the rebound is that of
    theory for every step, and what rests has e = 0.

    Returns
    -------
    the change of speed [m/s]; V̄ less the mean of first and last speed [m/s]; J [m/s]
    """
    start = maximum(start, LEAST * reach)
    slack = maximum(1.0 - d * u, 1.0 - d * (u + s)) <= 0.0  # leaves faster than the surface's force follows
    follow = maximum(1.0 - d * u, 0.0)
    free = start + tau * (u + 0.5 * s)
    depth = maximum(reach - start, 0.0)
    energy = c * depth * depth / (start * reach * reach)
    low = maximum(free, 0.0)
    far = reach + maximum(free, -free) + tau * (maximum(u, -u) + maximum(s, -s) + sqrt(2.0 * energy))
    high = select(start < reach, far, reach + 0.0 * free)
    gain = (0.5 * tau * tau) * c * follow / (reach * reach)
    guess = positive_root(1.0 + 0.0 * start, gain - free, (gain * reach * reach) / start)
    guess = minimum(maximum(guess, low), high)
    active = select(slack, 0.0, 1.0 + 0.0 * free)
    for _ in range(2 * ROUNDS):
        here = maximum(guess, LEAST * reach)
        mean, slope = gradient(start, here, reach)
        impulse = tau * c * mean
        phi, psi = decay_means(d * impulse)
        e = s + impulse * follow
        wrong = here - start - tau * (u + e * psi)
        above = wrong > 0.0
        high, low = select(above, here, high), select(above, low, here)
        new = here - wrong / (1.0 - (tau * tau) * c * slope * (follow * psi - (2 / 3) * d * e * psi * psi))
        outside = minimum(new - low, high - new) < 0.0
        new = select(outside, 0.5 * (low + high), new)
        change = maximum(new - here, here - new)
        guess = select(active > 0.5, new, guess)
        active = select(change > FOUND * here, active, 0.0)
        if not any_lane(active > 0.5):
            break
    here = select(slack, maximum(free, LEAST * reach), maximum(guess, LEAST * reach))
    mean, slope = gradient(start, here, reach)
    impulse = tau * c * mean
    phi, psi = decay_means(d * impulse)
    e = s + impulse * follow
    changed, more = select(slack, s, e * phi), select(slack, 0.5 * s, e * psi)
    return changed - s, more - 0.5 * changed, impulse


@compiled
def between_with_loss(start: Any, u: Any, s: Any, tau: Any, c: Any, reach: Any, d: Any) -> Any:
    """As `meet_with_loss`, where ``u`` is the mean of first and last speed.

    ``start`` is the height at the start of the step without the barrier. With e (1 − x φ/2) = s + J (1 − d u),
    both heights follow from J; it is bracketed.
    """
    slack = maximum(1.0 - d * (u - 0.5 * s), 1.0 - d * (u + 0.5 * s)) <= 0.0
    follow = maximum(1.0 - d * u, 0.0)
    push = between(start, start + tau * u, tau, c * follow, reach)
    impulse = select(follow > 0.0, push, 0.0) / select(follow > 0.0, follow, 1.0)
    low, high = 0.0 * impulse, -1.0 + 0.0 * impulse
    active = select(slack, 0.0, 1.0 + 0.0 * impulse)
    for _ in range(2 * ROUNDS):
        wrong = excess(impulse, start, u, s, tau, c, reach, d, follow)
        step = 1e-6 * impulse + 1e-12 * reach / tau
        slope = (excess(impulse + step, start, u, s, tau, c, reach, d, follow) - wrong) / step
        above = wrong > 0.0
        high, low = select(above, impulse, high), select(above, low, impulse)
        new = impulse - wrong / maximum(slope, 1.0)
        middle = select(high < 0.0, 2.0 * low + reach / tau, 0.5 * (low + high))
        outside = select(high < 0.0, new - low, minimum(new - low, high - new)) < 0.0
        new = select(outside, middle, new)
        change = maximum(new - impulse, impulse - new)
        impulse = select(active > 0.5, new, impulse)
        active = select(change > FOUND * impulse, active, 0.0)
        if not any_lane(active > 0.5):
            break
    phi, psi = decay_means(d * impulse)
    e = (s + impulse * follow) / (1.0 - 0.5 * d * impulse * phi)
    changed, bend = select(slack, s, e * phi), select(slack, 0.0, e * (psi - 0.5 * phi))
    mean, _ = gradient(maximum(start, LEAST * reach), maximum(start + tau * u, LEAST * reach), reach)
    impulse = select(slack, tau * c * mean, impulse)
    return changed - s, bend, impulse


@compiled
def excess(
    impulse: Any, start: Any, u: Any, s: Any, tau: Any, c: Any, reach: Any, d: Any, follow: Any
) -> Any:
    """An impulse J less that of the heights that follow from it; negative where they are behind the surface."""
    phi, psi = decay_means(d * impulse)
    e = (s + impulse * follow) / (1.0 - 0.5 * d * impulse * phi)
    first = start + (0.25 * tau) * (e * phi - s)
    last = first + tau * (u + e * (psi - 0.5 * phi))
    least = LEAST * reach
    mean, _ = gradient(maximum(first, least), maximum(last, least), reach)
    return select(minimum(first, last) > least, impulse - tau * c * mean, -1.0 * impulse - reach / tau)


@compiled
def law(leave: Any, start: Any, u: Any, s: Any, tau: Any, c: Any, reach: Any, damping: Any) -> Any:
    """`meet` or, after the state was read, `between`: change of speed, bend of the way, J [m/s]."""
    if damping is None:
        if leave:
            push = between(start, start + tau * u, tau, c, reach)
        else:
            push = meet(start, start + tau * (u + 0.5 * s), tau, c, reach)
        return push, 0.0 * push, push
    d = load(damping, 0) + 0.0 * start
    elastic = d <= 0.0
    push, bend, impulse = 0.0 * start, 0.0 * start, 0.0 * start
    if any_lane(d > 0.0):
        if leave:
            push, bend, impulse = between_with_loss(start, u, s, tau, c, reach, d)
        else:
            push, bend, impulse = meet_with_loss(start, u, s, tau, c, reach, d)
    if any_lane(elastic):
        if leave:
            full = between(start, start + tau * u, tau, c, reach)
        else:
            full = meet(start, start + tau * (u + 0.5 * s), tau, c, reach)
        push = select(elastic, full, push)
        bend, impulse = select(elastic, 0.0, bend), select(elastic, full, impulse)
    return push, bend, impulse


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
    speed: Any,
    smooth: Any,
    tau: Any,
    leave: Any,
    space: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """The change of velocity [m/s] of particle ``i`` by the surfaces and their friction, in a step.

    ``place`` is where the node is, ``first`` where the step begins. ``speed`` is the velocity before the node
    or, to ``leave`` it, its mean with that after the node; ``smooth`` its change in all of the node by all
    else. ``space`` (surfaces, 3) is workspace. Returns also what of the change is friction, by how much the
    way is bent [m], and the energy lost in the contact [J].
    """
    change, rub, bend = times(0.0, speed), times(0.0, speed), times(0.0, speed)
    lost = change[0]
    if particles.free[i]:
        if planes is not None:
            change, rub, bend, lost = planes_change(
                i, first, speed, smooth, tau, leave, space, particles, planes, friction, damping
            )
        if bowl is not None:
            change, rub, bend, lost = bowl_change(
                i, place, first, speed, smooth, tau, leave, particles, bowl, friction, damping
            )
    return change, rub, bend, lost


@compiled
def planes_change(
    i: Any,
    first: Any,
    speed: Any,
    smooth: Any,
    tau: Any,
    leave: Any,
    pushes: Any,
    particles: Any,
    planes: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """`surfaces_change` of planes.

    At a right angle they do not know of each other. At a wider one what one gives is for the others as all
    else: they are taken in turn until they agree. Friction acts along what the planes that are touched leave
    free, so that it moves nothing towards a plane.
    """
    nothing = times(0.0, speed)
    given, bend, force = nothing, nothing, nothing
    c = load(planes.strength, 0) * load(particles.inverse_mass, i)
    share = 0.5 if leave else 1.0
    for turn in range(TURNS if planes.oblique else 1):
        changed, force = nothing[0], nothing
        for k in range(planes.offset.size):
            n = row(planes.normal, k)
            start, u, s = height(first, planes, k), dot(n, speed), dot(n, smooth)
            own, curve = nothing[0], nothing[0]
            if planes.oblique:
                if turn > 0:
                    own, curve = load(pushes, (k, 0)), load(pushes, (k, 1))
                others = dot(n, given) - own
                s, u = s + others, u + (dot(n, bend) - curve)
                if leave:
                    start = start + (0.25 * tau) * others
            free = start + tau * (u if leave else u + 0.5 * s)
            touching = minimum(start, free) < planes.reach
            push, bent = nothing[0], nothing[0]
            if any_lane(touching):
                push, bent, impulse = law(leave, start, u, s, tau, c, planes.reach, damping)
                push, bent = select(touching, push, 0.0), select(touching, bent, 0.0)
                force = plus_scaled(force, select(touching, impulse, 0.0), n)
            store(pushes, (k, 0), push)
            store(pushes, (k, 1), bent)
            given = plus_scaled(given, push - own, n)
            bend = plus_scaled(bend, bent - curve, n)
            changed = maximum(changed, maximum(push - own, own - push))
        if not any_lane(tau * changed > CONVERGED * planes.reach):
            break
    lost = nothing[0]
    if damping is not None:
        middle = plus(speed, bend)
        if not leave:
            middle = plus_scaled(middle, 0.5, plus(smooth, given))
        lost = dot(minus(force, given), middle) + dot(plus(smooth, given), bend)
    bend = times(tau, bend)
    rub = nothing
    if friction is not None:
        left, normal, pressed, touched = plus_scaled(speed, share, smooth), nothing, nothing[0], nothing[0]
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
    return plus(given, rub), rub, bend, load(particles.mass, i) * lost


@compiled
def bowl_change(
    i: Any,
    place: Any,
    first: Any,
    speed: Any,
    smooth: Any,
    tau: Any,
    leave: Any,
    particles: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """`surfaces_change` of a bowl.

    The impulse acts along the normal n at the node. With d from the centre and r = |d|, the heights at the
    ends of the step differ by exactly n̄ · (d₁ − d₀), n̄ = −(d₀ + d₁)/(r₀ + r₁), σ = n̄ · n: the motion along n̄
    is that above a plane. What the impulse does to the ends is found by iteration.
    """
    begin = minus(first, vector(bowl.centre))
    free = plus_scaled(begin, tau, speed)
    if not leave:
        free = plus_scaled(free, 0.5 * tau, smooth)
    early, late = (0.25 * tau, 0.25 * tau) if leave else (0.0 * tau, 0.5 * tau)
    near, far = sqrt(dot(begin, begin) + TINY), sqrt(dot(free, free) + TINY)
    touching = maximum(near, far) > bowl.radius - bowl.reach
    push, bent, lost = 0.0 * near, 0.0 * near, 0.0 * near
    n = minus(place, vector(bowl.centre))
    n = times(-1.0 / sqrt(dot(n, n) + TINY), n)
    c = load(bowl.strength, 0) * load(particles.inverse_mass, i)
    if any_lane(touching):
        for _ in range(NORMALS):
            d0, d1 = plus_scaled(begin, early * push, n), plus_scaled(free, late * push + tau * bent, n)
            near, far = sqrt(dot(d0, d0) + TINY), sqrt(dot(d1, d1) + TINY)
            mean = times(-1.0 / (near + far), plus(d0, d1))
            sigma = dot(mean, n)
            start = bowl.radius - near - (early * push) * sigma
            u, s = dot(mean, speed), dot(mean, smooth)
            meeting = minimum(start, start + tau * (u if leave else u + 0.5 * s)) < bowl.reach
            push, bent, impulse = law(leave, start, u, s, tau, c * sigma * sigma, bowl.reach, damping)
            middle = u + bent if leave else u + bent + 0.5 * (s + push)
            lost = (impulse - push) * middle + (s + push) * bent
            push = select(meeting, push / sigma, 0.0)
            bent = select(meeting, bent / sigma, 0.0)
            lost = select(meeting, lost / (sigma * sigma), 0.0)
        push, bent, lost = (
            select(touching, push, 0.0),
            select(touching, bent, 0.0),
            select(touching, lost, 0.0),
        )
    rub = times(0.0, speed)
    if friction is not None:
        share = 0.5 if leave else 1.0
        left = plus_scaled(speed, share, smooth)
        left = minus(left, times(dot(n, left), n))
        rub = times(-1.0 / share, slowed(left, load(friction, 0) * (share * push)))
    return plus(times(push, n), rub), rub, times(tau * bent, n), load(particles.mass, i) * lost


# --- The node -------------------------------------------------------------------------------------------


@compiled
def set_out(x: Any, v: Any, a: Any, b: Any, h: Any, space: Any, terms: Any) -> None:
    """Begin a node: kick h/2, and half of what the surfaces are going to give, as far as is known.

    Dampers must see the mean velocity of before and after the node, else rest looks like stretching to them.
    ``a`` and ``b`` (N, 3) are the accelerations by springs and gravity, and by actuators. ``space`` are
    workspace arrays: velocities before, and as left here, what of them the surfaces gave, one for the surfaces.
    """
    before, middle, given, pushes, _ = space
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
    smooth = times(h, with_actuators(acceleration, b, i, wrench, thrust))
    first = plus_scaled(place, -0.5 * h, start)
    change, _, _, _ = surfaces_change(
        i, place, first, start, smooth, h, False, pushes, particles, planes, bowl, friction, damping
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

    All else has been given but the last kick by ``a``, of h/2; ``space`` as in `set_out`. A state that was
    placed, not read off at a node, begins with half a step of its own: ``fresh``.
    """
    before, middle, given, pushes, bends = space
    particles = terms.particles
    surfaces = (particles, terms.planes, terms.bowl, terms.friction, terms.impact_damping)
    leave = part == LEAVE
    share = 1.0 if part == WHOLE else 0.5
    stray = 0.0 * load(v, (0, 0))
    rubbed, lost, held, curved = stray, stray, stray, stray
    fresh = is_fresh(stray, leave, ledger)
    for i in range(v.shape[0]):
        start, place, now = row(before, i), row(x, i), row(v, i)
        soon = minus(now, row(given, i))
        if part == ARRIVE:
            smooth = times(2.0, minus(soon, start))
        else:
            smooth = minus(plus_scaled(soon, 0.5 * h, row(a, i)), start)
        first = plus_scaled(place, -0.5 * h, start)
        if leave:
            first = plus_scaled(first, 0.5 * h, smooth)
            smooth = times(2.0, smooth)
        change, rub, bend, loss = surfaces_change(i, place, first, start, smooth, h, leave, pushes, *surfaces)
        curve = bend
        if any_lane(fresh):
            curve = choose(fresh, times(0.0, bend), bend)
            own = half_step(i, place, start, times(0.5, smooth), 0.5 * h, pushes, *surfaces)
            change, rub = choose(fresh, own[0], change), choose(fresh, own[1], rub)
            bend, loss = choose(fresh, own[2], bend), select(fresh, own[3], loss)
        more = minus(times(share, change), row(given, i))
        end = plus(now, more)
        set_row(v, i, end)
        if part != ARRIVE:
            set_row(x, i, plus(place, bend))
        if ledger is not None:
            mass = load(particles.mass, i)
            if part != LEAVE:  # the springs' work on a bend is that of the forces at both of its ends
                curved = curved + 0.5 * mass * dot(row(bends, i), row(a, i))
            if part != ARRIVE:
                curved = curved - 0.5 * mass * dot(curve, row(a, i))
                set_row(bends, i, curve)
            other = minus(now, row(middle, i))
            mean = start
            if part == WHOLE:
                stray = stray + mass * dot(other, minus(times(0.5, change), row(given, i)))
                mean = times(0.5, plus_scaled(plus(start, end), 0.5 * h, row(a, i)))
            elif part == ARRIVE:
                stray = stray + mass * dot(other, more)
                mean = end
                swing = times(0.5, change)
                held = held + mass * dot(swing, plus(times(0.25, change), other))
                after = plus(end, minus(end, start))
                last = plus(plus_scaled(place, 0.5 * h, after), bend)
                lift = lifted(i, place, first, last, *surfaces)
                for axis in range(3):
                    store(ledger, LIFTS + 3 * i + axis, lift[axis])
                held = held + 0.5 * (
                    energy_at(i, first, particles, terms.planes, terms.bowl)
                    + energy_at(i, last, particles, terms.planes, terms.bowl)
                )
                held = held - energy_at(i, plus(place, lift), particles, terms.planes, terms.bowl)
            elif any_lane(fresh):
                mean = choose(fresh, times(0.5, plus_scaled(plus(start, end), 0.5 * h, row(a, i))), mean)
            rubbed = rubbed - mass * dot(rub, mean)
            lost = lost + loss
    if ledger is not None:
        record_stray(ledger, stray, terms.dampers)
        record(ledger, CONTACT, share * lost + curved)
        record(ledger, FRICTION, share * rubbed)
        store(ledger, HELD, held)
        if part == ARRIVE:
            store(ledger, MET, 1.0 + 0.0 * held)


@compiled
def is_fresh(like: Any, leave: Any, ledger: Any) -> Any:
    if ledger is None:
        return like > 1.0
    return load(ledger, MET) + (0.0 if leave else 1.0) < 0.5


@compiled
def half_step(
    i: Any,
    place: Any,
    speed: Any,
    smooth: Any,
    tau: Any,
    pushes: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """Twice what the surfaces do in half a step, of ``tau`` seconds, that begins where the particle is placed.

    There is no first half of the node: the way is that of the mean speed, where the drift is that of the last.
    """
    change, rub, bend, loss = surfaces_change(
        i, place, place, speed, smooth, tau, False, pushes, particles, planes, bowl, friction, damping
    )
    normal = minus(change, rub)
    size = dot(normal, normal)
    along = select(size > 0.0, dot(smooth, normal) / (size + TINY), 0.0)
    bend = plus_scaled(bend, -0.5 * tau, plus_scaled(normal, along, normal))
    return times(2.0, change), times(2.0, rub), bend, 2.0 * loss


@compiled
def lifted(
    i: Any,
    place: Any,
    first: Any,
    last: Any,
    particles: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> Any:
    """How far a node is lifted [m] while it is read: to half of the lower of the heights around it, or higher.

    Where a step is too coarse for an impact, the node is behind the surface though no step begins or ends there.
    """
    lift = times(0.0, place)
    if particles.free[i]:
        if planes is not None:
            for k in range(planes.offset.size):
                least = 0.5 * minimum(height(first, planes, k), height(last, planes, k))
                short = minimum(least, 0.5 * planes.reach) - height(plus(place, lift), planes, k)
                lift = plus_scaled(lift, maximum(short, 0.0), row(planes.normal, k))
        if bowl is not None:
            far, here = minus(last, vector(bowl.centre)), minus(place, vector(bowl.centre))
            near = minus(first, vector(bowl.centre))
            most = sqrt(maximum(dot(near, near), dot(far, far)))
            least = minimum(0.5 * (bowl.radius - most), 0.5 * bowl.reach)
            r = sqrt(dot(here, here) + TINY)
            lift = times(-1.0 * maximum(least - (bowl.radius - r), 0.0) / r, here)
    return lift


@compiled
def lower(x: Any, ledger: Any) -> None:
    """Take back how far the nodes were lifted to be read."""
    if ledger is not None:
        for i in range(x.shape[0]):
            for axis in range(3):
                store(x, (i, axis), load(x, (i, axis)) - load(ledger, LIFTS + 3 * i + axis))


@compiled
def raise_to_read(x: Any, ledger: Any, springs: Any) -> None:
    """Lift the nodes to be read; what that does to the springs is held."""
    if ledger is not None:
        any_lift = 0.0 * load(x, (0, 0))
        for i in range(x.shape[0]):
            for axis in range(3):
                up = load(ledger, LIFTS + 3 * i + axis)
                any_lift = any_lift + up * up
        if any_lane(any_lift > 0.0):
            before, _ = spring_energy(x, springs)
            for i in range(x.shape[0]):
                for axis in range(3):
                    store(x, (i, axis), load(x, (i, axis)) + load(ledger, LIFTS + 3 * i + axis))
            after, _ = spring_energy(x, springs)
            record(ledger, HELD, before - after)


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
