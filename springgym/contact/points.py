"""Particles at surfaces: the impulses that surfaces and friction give a particle at the node of a step.

Without contact the way of a particle begins at x₀ and would end at x₁. A surface with the normal n there
meets it by `springgym.contact.law`, with the gaps h₀ and a = h₀ + n · (x₁ − x₀) and W = 1/m. What several
surfaces give is found in turns, each from what the others give (Gauss and Seidel). Friction acts along what
the surfaces that touch leave free, so that it moves nothing towards one, and stops what it can stop.

On a curved surface n is the discrete gradient of the height for the way, see
`springgym.contact.surfaces.mean_normal`; as it depends on the end of the way, it is found in the same turns.
"""

from __future__ import annotations

from springgym.contact.cone import within_cone
from springgym.contact.law import Times, solve_gap
from springgym.contact.records import SurfaceImpulse, Surfaces
from springgym.contact.surfaces import coefficient, count, lowest, mean_normal, strength_and_reach
from springgym.contact.totals import set_fastest
from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Numbers, Vector
from springgym.core.lanes import any_lane, epsilon, load, maximum, minimum, select, sqrt
from springgym.core.vectors import choose, dot, plus_scaled, row, set_row, unit
from springgym.terms import Terms

TURNS = 40
"""Largest number of iterations (turns) that find the impulses of coupled surfaces."""

AGREED = 1e-9
"""Iterations end when none changes a displacement by more than this share of Δ."""

ALMOST = 1.1
"""Share of Δ below which a surface is near: where a way ends out of it, the next begins out of Δ, whatever is
rounded."""


@compiled
def nothing_given(like: Vector) -> SurfaceImpulse:
    """Return what is given where no surface is near."""
    nothing = 0.0 * like
    return SurfaceImpulse(nothing, nothing, nothing)


@compiled
def previous_push(turn: int, k: int, nothing: Vector, pushes: Numbers, surfaces: Surfaces) -> Vector:
    """Return the change of velocity by surface ``k`` in the last turn: ``nothing`` where one turn is all."""
    if surfaces.coupled is None or turn == 0:
        return nothing
    return row(pushes, k)


@compiled
def near(begin: Vector, free: Vector, surfaces: Surfaces) -> Mask:
    """Return where a way begins or ends within reach of a surface, or almost: by `ALMOST`."""
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
    """Return what surfaces and friction give particle ``i`` at a node.

    Without them, its ``way`` would have these two ends. It begins with the velocity ``speed``, which all else
    changes by ``smooth``. What one surface gives is all else to the others: they are taken in turn until they
    agree. Where a normal depends on the end of the way, that is found in the same turns. Friction acts along
    what the surfaces that touch leave free, so that it moves nothing towards one, and stops what it can stop.
    """
    begin, free = way
    nothing = 0.0 * speed
    given, rub, force = nothing, nothing, nothing
    strength, reach = strength_and_reach(terms.surfaces)
    c = strength * load(terms.particles.inverse_mass, i)
    mu, beta = coefficient(terms.friction, nothing[0]), coefficient(terms.loss, nothing[0])
    enough = (AGREED + 64 * epsilon(speed[0])) * reach
    active = select(near(begin, free, terms.surfaces), 1.0 + nothing[0], 0.0)
    for turn in range(TURNS):
        now, pressing = given, nothing
        left, first = speed + smooth, nothing
        pressed, touched = nothing[0], nothing[0]
        end = plus_scaled(free, span.out, given + rub)
        for k in range(count(terms.surfaces.kinds)):
            n, square, start = mean_normal(k, begin, end, terms.surfaces)
            inverse_square = 1.0 / square
            own = previous_push(turn, k, nothing, pushes, terms.surfaces)
            by_others = now - own
            others = smooth + (by_others + rub)
            u, s = dot(n, speed), dot(n, others)
            ahead = start + (span.whole * u + span.out * s)
            touching = minimum(start, ahead) < reach
            gain, impulse = nothing[0], nothing[0]
            if any_lane(touching):
                gain, impulse = solve_gap((start, ahead, nothing[0]), span, c * square, reach, beta, touching)
                gain, impulse = select(touching, gain, 0.0), select(touching, impulse, 0.0)
                fast = sqrt(inverse_square) * select(gain > 0.0, maximum(u, -u), 0.0)
                set_fastest(fast, 0, terms.surfaces.totals)
                if terms.friction is not None:
                    one, length = select(touching, 1.0 + nothing[0], 0.0), sqrt(inverse_square)
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
        given, rub = choose(going, now, given), choose(going, rubbing, rub)
        force = choose(going, pressing, force)
        active = select(far, active, 0.0)
        if not any_lane(active > 0.5):
            break
    return SurfaceImpulse(given, rub, force)
