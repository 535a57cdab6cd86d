"""Particles at surfaces: the impulses of surfaces and friction on a particle at the node of a step.

Without contact a particle would move from x₀ to x₁. Contact with a surface of normal n follows
`springgym.dynamics.contact.law`, with the gaps h₀ and a = h₀ + n · (x₁ − x₀) and W = 1/m. Impulses of several
surfaces are found by iteration, each from those of the others (Gauss–Seidel). Friction acts along the
directions that touching surfaces leave free, so that it moves nothing towards them, and stops what slip it
can.

On a curved surface n is the discrete gradient of the height along the path
(`springgym.dynamics.contact.surfaces`). It depends on the end of the path, and is found in the same
iterations."""

from __future__ import annotations

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Mask, Number, Numbers, Vector
from springgym.core.language.lanes import any_lane, epsilon, maximum, minimum, select, sqrt
from springgym.core.language.memory import load
from springgym.core.language.vectors import choose, dot, plus_scaled, row, set_row, unit
from springgym.dynamics.contact.cone import within_cone
from springgym.dynamics.contact.law import solve_gap
from springgym.dynamics.contact.surfaces import coefficient, count, lowest, mean_normal, strength_and_reach
from springgym.dynamics.contact.totals import add_to, set_fastest
from springgym.dynamics.records import PairTotal, SurfaceImpulse, Surfaces, Times
from springgym.dynamics.terms import Terms

ITERATIONS = 40
"""Largest number of iterations that find the impulses of coupled surfaces."""

AGREED = 1e-9
"""Iterations end when one changes no displacement by more than this fraction of Δ."""

ALMOST = 1.1
"""Gap in units of Δ below which a surface is near: a path that ends farther away is followed by one that
begins beyond Δ, despite rounding."""


@compiled
def previous_push(turn: int, k: int, nothing: Vector, pushes: Numbers, surfaces: Surfaces) -> Vector:
    """Return the change of velocity by surface ``k`` in the last iteration; ``nothing`` in the first."""
    if surfaces.coupled is None or turn == 0:
        return nothing
    return row(pushes, k)


@compiled
def count_coarse(speed: Number, surfaces: Surfaces, totals: Numbers | None) -> None:
    """Count the copies in which a contact has a normal speed [m/s] too high to keep its restitution."""
    if totals is not None:
        add_to(totals, 0, PairTotal.COARSE, select(speed > surfaces.coarse_from, 1.0 + 0.0 * speed, 0.0))


@compiled
def near(begin: Vector, free: Vector, surfaces: Surfaces) -> Mask:
    """Return the mask of paths that begin or end within `ALMOST` Δ of a surface."""
    return minimum(lowest(begin, surfaces), lowest(free, surfaces)) < ALMOST * surfaces.reach


@compiled
def impulses(
    i: int,
    way: tuple[Vector, Vector],
    speed: Vector,
    smooth: Vector,
    span: Times,
    pushes: Numbers,
    terms: Terms,
) -> SurfaceImpulse:
    """Return the impulses of surfaces and friction on particle ``i`` at a node.

    Without them, the particle would move between the two ends of its ``way``. It starts with the velocity
    ``speed``, which other forces change by ``smooth``. The impulses of surfaces are iterated one after
    another until they agree, see the head of this file.
    """
    begin, free = way
    nothing = 0.0 * speed
    given = nothing
    rub = nothing
    force = nothing
    strength, reach = strength_and_reach(terms.surfaces)
    c = strength * load(terms.particles.inverse_mass, i)
    mu = coefficient(terms.friction, nothing[0])
    beta = coefficient(terms.loss, nothing[0])
    enough = (AGREED + 64 * epsilon(speed[0])) * reach
    active = select(near(begin, free, terms.surfaces), 1.0 + nothing[0], 0.0)
    for turn in range(ITERATIONS):
        now = given
        pressing = nothing
        left = speed + smooth
        first = nothing
        pressed = nothing[0]
        touched = nothing[0]
        end = plus_scaled(free, span.out, given + rub)
        for k in range(count(terms.surfaces.kinds)):
            n, square, start = mean_normal(k, begin, end, terms.surfaces)
            inverse_square = 1.0 / square
            own = previous_push(turn, k, nothing, pushes, terms.surfaces)
            by_others = now - own
            others = smooth + (by_others + rub)
            u = dot(n, speed)
            s = dot(n, others)
            ahead = start + (span.whole * u + span.out * s)
            touching = minimum(start, ahead) < reach
            gain = nothing[0]
            impulse = nothing[0]
            if any_lane(touching):
                gain, impulse = solve_gap((start, ahead, nothing[0]), span, c * square, reach, beta, touching)
                gain = select(touching, gain, 0.0)
                impulse = select(touching, impulse, 0.0)
                fast = sqrt(inverse_square) * select(gain > 0.0, maximum(u, -u), 0.0)
                set_fastest(fast, 0, terms.surfaces.totals)
                if turn == 0:
                    count_coarse(fast, terms.surfaces, terms.surfaces.totals)
                if terms.friction is not None:
                    one = select(touching, 1.0 + nothing[0], 0.0)
                    length = sqrt(inverse_square)
                    across = nothing + length * n
                    if k > 0:
                        across = unit(across - dot(across, first) * first)
                    left = left - one * dot(across, left) * across
                    first = choose(touched > 0.0, first, one * across)
                    touched = touched + one
                    pressed = pressed + length * maximum(gain, 0.0)
            if terms.surfaces.coupled is not None:
                set_row(pushes, k, choose(active > 0.5, gain * inverse_square * n, own))
            now = plus_scaled(by_others, gain * inverse_square, n)
            pressing = plus_scaled(pressing, impulse * inverse_square, n)
        rubbing = nothing
        if terms.friction is not None:
            left = choose(touched > 2.0, nothing, left)
            rubbing = -1.0 * within_cone(left, mu * pressed)
        if terms.surfaces.coupled is None:
            return SurfaceImpulse(now, rubbing, pressing)
        going = active > 0.5
        more = now - given
        far = span.whole * span.whole * dot(more, more) > enough * enough
        given = choose(going, now, given)
        rub = choose(going, rubbing, rub)
        force = choose(going, pressing, force)
        active = select(far, active, 0.0)
        if not any_lane(active > 0.5):
            break
    return SurfaceImpulse(given, rub, force)
