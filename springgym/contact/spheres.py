"""Contacts move spheres and capsules, and friction turns them.

Friction acts at the skin of such a body, at the arm r = −ρ n from a sphere's centre, or from a capsule's
axis, with the unit normal n from the other body. The inertia I is that of the body's particles as they lie at
the node; their angular velocity and what the torque of an impulse j changes are

    ω = I⁻¹ Σ mᵢ (xᵢ − c) × vᵢ,    δω = I⁻¹ (r × j),    δvᵢ = δω × (xᵢ − c).

This keeps momentum and angular momentum to rounding, and stretches no spring. With (n × s) for r × s, a unit
impulse along s changes the slip ρ n × ω by ρ² (n × s) · I⁻¹ (n × s).

A contact sees a sphere from its centre of mass c: v = Σ mᵢ vᵢ/M, pushes go through c, and all of an impulse
is distributed as on a rigid body, δvᵢ = j/M + δω × (xᵢ − c). While impulses between bodies are found, a
sphere's first particle stands for all of it, with the mass M at c; in arrays of velocities, the row behind
has ω.

A capsule is pushed at the two particles at the ends of its axis, like a rod. They take the impulse j of
friction, too, and all of its particles its torque. As both may turn the body, K has the product of the two
parts, 2 δω · Σ wᵢ (xᵢ − c) × s over the ends.

At a face or an edge ρ is the radius: what is left of the gap is up to the face, see
`springgym.contact.friction`. Between two such bodies each takes its share of the gap, so that both touch in
one point. Between a capsule and a single point or a rope, the capsule takes all of it, and the rope's radius.

Of rigid bodies, `springgym.contact.solids` takes the arm alone from here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import DTypeLike

from springgym.collisions import Shape
from springgym.contact.records import Problem, Spheres
from springgym.core.blocks import aligned_zeros
from springgym.core.compiling import OPTIONS, compiled
from springgym.core.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.core.lanes import load, maximum, select, store
from springgym.core.vectors import (
    angular_momentum,
    choose,
    cross,
    dot,
    inertia,
    inverse_symmetric,
    mass_centre,
    multiplied,
    plus_scaled,
    row,
    row_each,
    set_row,
)

INLINE = {**OPTIONS, "forceinline": True}
"""Options of what differs with and without spheres: it is compiled into what calls it."""

Seen: TypeAlias = tuple[Rows, Rows, Numbers]


def new_spheres(
    start: np.ndarray, shapes: Sequence[Shape], resisted: np.ndarray, dtype: DTypeLike
) -> Spheres | None:
    """Return a workspace for the spheres and capsules among bodies of ``shapes``; None without any.

    ``resisted`` (bodies,) tells of which bodies the turning is resisted by others, or resists theirs.
    """
    if not any(shape.skin for shape in shapes):
        return None
    bodies, particles = len(shapes), int(start[-1])

    def lanes(*shape: int) -> np.ndarray:
        return aligned_zeros(shape, dtype)

    return Spheres(
        start=np.array(start),
        radius=np.array([shape.radius if shape.turns else 0.0 for shape in shapes]),
        skin=np.array([shape.radius if shape.skin else 0.0 for shape in shapes]),
        thick=np.array([shape.radius for shape in shapes]),
        turns=np.array([shape.skin for shape in shapes]) | resisted,
        x=lanes(particles, 3),
        before=lanes(particles, 3),
        inverse_mass=lanes(particles),
        mass=lanes(particles),
        centre=lanes(bodies, 3),
        turn=lanes(2 * bodies, 3),
        kept=lanes(particles, 3),
        began=lanes(2 * bodies, 3),
    )


# --- As contacts see them -------------------------------------------------------------------------------


def as_seen(x: Rows, v: Rows, mass: Numbers, inverse_mass: Numbers, spheres: Spheres | None) -> Seen:
    """Return positions, velocities before a node and inverse masses of particles as contacts see them."""
    return (x, v, inverse_mass) if spheres is None else look(x, v, mass, inverse_mass, spheres)


@overload(as_seen, jit_options=INLINE)
def _as_seen(
    x: Rows, v: Rows, mass: Numbers, inverse_mass: Numbers, spheres: Spheres | None
) -> Callable[..., Seen]:
    def as_it_is(x: Rows, v: Rows, mass: Numbers, inverse_mass: Numbers, spheres: Spheres | None) -> Seen:
        return x, v, inverse_mass

    def with_spheres(x: Rows, v: Rows, mass: Numbers, inverse_mass: Numbers, spheres: Spheres | None) -> Seen:
        return look(x, v, mass, inverse_mass, spheres)

    return as_it_is if isinstance(spheres, types.NoneType) else with_spheres


@compiled
def look(x: Rows, v: Rows, mass: Numbers, inverse_mass: Numbers, spheres: Spheres) -> Seen:
    """Find how contacts see all particles, where some bodies are spheres or capsules."""
    for i in range(x.shape[0]):
        set_row(spheres.x, i, row(x, i))
        set_row(spheres.before, i, row(v, i))
        store(spheres.inverse_mass, i, load(inverse_mass, i))
    for body in range(spheres.turns.size):
        if spheres.turns[body]:
            first, behind = spheres.start[body], spheres.start[body + 1]
            own, places = mass[first:behind], x[first:behind]
            whole, centre = 0.0 * load(spheres.inverse_mass, first), mass_centre(places, own)
            for i in range(first, behind):
                whole = whole + load(mass, i)
                store(spheres.mass, i, load(mass, i))
            free = load(spheres.inverse_mass, first) > 0.0
            set_row(spheres.centre, body, centre)
            diagonal, across = inverse_symmetric(inertia(places, own, centre))
            set_row(spheres.turn, 2 * body, choose(free, diagonal, 0.0 * diagonal))
            set_row(spheres.turn, 2 * body + 1, choose(free, across, 0.0 * across))
            if spheres.radius[body] > 0.0:
                set_row(spheres.x, first, centre)
                store(spheres.inverse_mass, first, select(free, 1.0 / whole, 0.0))
                set_row(spheres.before, first, mass_centre(v[first:behind], own))
                set_row(spheres.before, first + 1, turning(body, x, v, spheres))
    return spheres.x, spheres.before, spheres.inverse_mass


@compiled
def turning(body: int, x: Rows, v: Rows, spheres: Spheres) -> Vector:
    """Return ω of a body that turns [rad/s], by the velocities of its particles."""
    first, behind = spheres.start[body], spheres.start[body + 1]
    own, centre = spheres.mass[first:behind], row(spheres.centre, body)
    moment = angular_momentum(x[first:behind], v[first:behind], own, centre)
    return turned(body, moment, spheres)


@compiled
def put_together(x: Rows, v: Rows, rows: int, spheres: Spheres | None) -> None:
    """Let the first two rows of each sphere have v and ω in place of its particles' velocities."""
    if spheres is not None and rows > 0:
        for body in range(spheres.radius.size):
            if spheres.radius[body] > 0.0:
                first, behind = spheres.start[body], spheres.start[body + 1]
                mean = mass_centre(v[first:behind], spheres.mass[first:behind])
                spin = turning(body, x, v, spheres)
                for i in range(first, behind):
                    set_row(spheres.kept, i, row(v, i))
                set_row(spheres.began, 2 * body, mean)
                set_row(spheres.began, 2 * body + 1, spin)
                set_row(v, first, mean)
                set_row(v, first + 1, spin)


@compiled
def take_apart(x: Rows, v: Rows, rows: int, spheres: Spheres | None) -> None:
    """Give the particles of each sphere their share of what changed since `put_together`."""
    if spheres is not None and rows > 0:
        for body in range(spheres.radius.size):
            if spheres.radius[body] > 0.0:
                first = spheres.start[body]
                centre = row(spheres.centre, body)
                faster = row(v, first) - row(spheres.began, 2 * body)
                spun = row(v, first + 1) - row(spheres.began, 2 * body + 1)
                for i in range(first, spheres.start[body + 1]):
                    set_row(v, i, row(spheres.kept, i) + (faster + cross(spun, row(x, i) - centre)))


@compiled
def share_first(rows: Rows, spheres: Spheres | None) -> None:
    """Let all particles of each sphere have the row of its first one."""
    if spheres is not None:
        for body in range(spheres.radius.size):
            if spheres.radius[body] > 0.0:
                first = spheres.start[body]
                for i in range(first + 1, spheres.start[body + 1]):
                    set_row(rows, i, row(rows, first))


@compiled
def share_touched(touched: Numbers, spheres: Spheres | None) -> None:
    """Mark all particles of each body that turns as touched in the copies where one of them is."""
    if spheres is not None:
        for body in range(spheres.turns.size):
            if spheres.turns[body]:
                first, behind = spheres.start[body], spheres.start[body + 1]
                any_touched = load(touched, first)
                for i in range(first + 1, behind):
                    any_touched = maximum(any_touched, load(touched, i))
                for i in range(first, behind):
                    store(touched, i, any_touched)


# --- Friction -------------------------------------------------------------------------------------------


@compiled
def body_of(side: int, k: int, problem: Problem) -> int:
    """Return the first body of contact k, or the second."""
    p = problem.contacts.pair[k]
    return problem.pairs.first[p] if side == 0 else problem.pairs.second[p]


@compiled
def is_capsule(body: int, spheres: Spheres) -> bool:
    """Tell whether a body is a capsule."""
    return spheres.skin[body] > spheres.radius[body]


@compiled
def both_turn(k: int, problem: Problem, spheres: Spheres) -> bool:
    """Tell whether both bodies of contact k are spheres or capsules."""
    return spheres.skin[body_of(0, k, problem)] > 0.0 and spheres.skin[body_of(1, k, problem)] > 0.0


@compiled
def at_one_point(k: int, problem: Problem, spheres: Spheres | None) -> bool:
    """Tell whether friction acts on both bodies of contact k at one point, so that it leaves no torque."""
    if spheres is None:
        return False
    capsule = is_capsule(body_of(0, k, problem), spheres) or is_capsule(body_of(1, k, problem), spheres)
    return (capsule and problem.contacts.members[k] == 3) or both_turn(k, problem, spheres)


@compiled
def skins(k: int, problem: Problem, spheres: Spheres) -> float:
    """Return the radii of the spheres and capsules of contact k, together [m]."""
    return spheres.skin[body_of(0, k, problem)] + spheres.skin[body_of(1, k, problem)]


@compiled
def lever(body: int, k: int, problem: Problem, spheres: Spheres) -> Number:
    """Return ρ of a sphere or capsule in contact k [m]; 0 of other bodies."""
    between, skin = load(problem.contacts.gap, k), spheres.skin[body]
    share = 0.0
    if at_one_point(k, problem, spheres):
        whole = skins(k, problem, spheres)
        thick = spheres.thick[body_of(0, k, problem)] + spheres.thick[body_of(1, k, problem)]
        between = between + (thick - whole)
        share = skin / whole
    return skin + share * between


@compiled
def spin_of(body: int, v: Rows, problem: Problem, spheres: Spheres) -> Vector:
    """Return ω of a body that turns [rad/s], by velocities as contacts see them."""
    if spheres.radius[body] > 0.0:
        return row(v, spheres.start[body] + 1)
    return turning(body, problem.x, v, spheres)


@compiled
def slip_by_turning(v: Rows, k: int, problem: Problem, spheres: Spheres) -> Vector:
    """Return what the turning of spheres and capsules adds to the slip of contact k [m/s]."""
    n = row(problem.contacts.normal, k)
    slip = 0.0 * n
    for side in range(2):
        body = body_of(side, k, problem)
        if spheres.skin[body] > 0.0:
            across = cross(n, spin_of(body, v, problem, spheres))
            slip = plus_scaled(slip, lever(body, k, problem, spheres), across)
    return slip


@compiled
def inverse_mass_by_turning(along: Vector, k: int, problem: Problem, spheres: Spheres) -> Number:
    """Return what the turning of spheres and capsules adds to K of contact k along a unit vector [1/kg]."""
    across, total = cross(row(problem.contacts.normal, k), along), 0.0 * along[0]
    for side in range(2):
        body = body_of(side, k, problem)
        if spheres.skin[body] > 0.0:
            rho, spun = lever(body, k, problem, spheres), turned(body, across, spheres)
            total = total + rho * rho * dot(across, spun)
            if is_capsule(body, spheres):
                total = total - 2.0 * rho * dot(spun, moment_of_ends(body, along, k, problem, spheres))
    return total


@compiled
def moment_of_ends(body: int, along: Vector, k: int, problem: Problem, spheres: Spheres) -> Vector:
    """Return Σ wᵢ (xᵢ − c) × s over the ends of a capsule in contact k [m]."""
    contacts, total = problem.contacts, 0.0 * along
    for m in range(contacts.members[k]):
        arm = row_each(problem.x, load(contacts.particle, 4 * k + m)) - row(spheres.centre, body)
        total = total + cross(own_weight(body, k, m, problem, spheres) * arm, along)
    return total


@compiled
def own_weight(body: int, k: int, m: int, problem: Problem, spheres: Spheres) -> Number:
    """Return the weight of member ``m`` of contact k if it is a particle of a body; else 0."""
    first, behind = 1.0 * spheres.start[body], 1.0 * spheres.start[body + 1]
    i, weight = load(problem.contacts.particle, 4 * k + m), load(problem.contacts.weight, 4 * k + m)
    return select(i >= first, select(i < behind, weight, 0.0), 0.0)


@compiled
def turned(body: int, moment: Vector, spheres: Spheres) -> Vector:
    """Return I⁻¹ times a vector."""
    return multiplied(row(spheres.turn, 2 * body), row(spheres.turn, 2 * body + 1), moment)


@compiled
def turn_by_friction(v: Rows, k: int, j: Vector, acts: Mask, problem: Problem, spheres: Spheres) -> None:
    """Turn the spheres and capsules of contact k by an impulse across its normal, in some lanes."""
    for side in range(2):
        body = body_of(side, k, problem)
        if spheres.skin[body] > 0.0:
            spun = turned(body, cross(row(problem.contacts.normal, k), j), spheres)
            turn_body(v, body, -lever(body, k, problem, spheres), spun, acts, problem, spheres)


@compiled
def turn_body(
    v: Rows, body: int, scale: Number, faster: Vector, acts: Mask, problem: Problem, spheres: Spheres
) -> None:
    """Add ``scale`` times ``faster`` [rad/s] to a body's rotation about its centre of mass, in some lanes."""
    first, behind = spheres.start[body], spheres.start[body + 1]
    if spheres.radius[body] > 0.0:
        spin = row(v, first + 1)
        set_row(v, first + 1, choose(acts, plus_scaled(spin, scale, faster), spin))
    else:
        for i in range(first, behind):
            before, arm = row(v, i), row(problem.x, i) - row(spheres.centre, body)
            set_row(v, i, choose(acts, plus_scaled(before, scale, cross(faster, arm)), before))
