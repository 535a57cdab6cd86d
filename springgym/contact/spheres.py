"""How contacts move spheres that turn: bodies whose only feature is a sphere about their middle.

A contact sees such a body from its centre of mass c, as a ball that turns, with v and ω and the inertia I of
its particles as they lie at the node,

    v = Σ mᵢ vᵢ/M,    ω = I⁻¹ Σ mᵢ (xᵢ − c) × vᵢ.

Of an impulse j at the arm r from c the particles take what a rigid body would:

    δv = j/M,    δω = I⁻¹ (r × j),    δvᵢ = δv + δω × (xᵢ − c).

So momentum and angular momentum are kept to rounding, and no spring is stretched. Pushes go through c. The
arm of friction is r = −ρ n, with the unit normal n from the other body: with (n × s) for r × s, a unit
impulse along s changes the slip ρ n × ω by ρ² (n × s) · I⁻¹ (n × s).

At a face or a rod ρ is the sphere's radius: what is left of the gap is up to the face, see
`springgym.contact.friction`. Between two spheres each takes its share of the gap, so that both touch in one
point.

Of rigid bodies, `springgym.contact.solids` takes the arm alone from here. Of springs, while impulses between
bodies are found, a sphere's first particle stands for all of it, with the mass M at c; in arrays of
velocities, the row behind has ω.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import DTypeLike

from springgym.core.blocks import aligned_zeros
from springgym.core.compiling import OPTIONS, compiled
from springgym.core.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.core.lanes import load, select, store
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
    set_row,
)

if TYPE_CHECKING:
    from springgym.contact.rows import Problem


INLINE = {**OPTIONS, "forceinline": True}
"""Options of what differs with and without spheres: it is compiled into what calls it."""

Seen: TypeAlias = tuple[Rows, Rows, Numbers]


class Spheres(NamedTuple):
    """The spheres among bodies that collide, and all particles as contacts see them."""

    start: np.ndarray
    """(bodies + 1,) where the particles of each body begin among all, and the end"""
    radius: np.ndarray
    """(bodies,) [m]; 0 of what is no sphere"""
    x: Rows
    """(N, 3) positions of the particles at the node [m]; in the first row of a sphere, its centre of mass"""
    before: Rows
    """(N, 3) velocities of the particles before the node [m/s]; in the first two rows of a sphere, v and ω"""
    inverse_mass: Numbers
    """(N,) inverse masses [1/kg]; in the first row of a sphere, 1/M"""
    turn: Rows
    """(2 bodies, 3) the inverse inertia I⁻¹ of each sphere, in two rows: xx, yy, zz, and xy, xz, yz
    [1/(kg·m²)]; 0 if it is pinned"""
    kept: Rows
    """(N, 3) velocities of the particles of spheres, saved while their rows hold v and ω [m/s]"""
    began: Rows
    """(2 bodies, 3) v [m/s] and ω [rad/s] of each sphere that follow from the kept velocities"""


def new_spheres(start: np.ndarray, radii: Sequence[float], dtype: DTypeLike) -> Spheres | None:
    """Return room for the spheres among bodies of ``radii``, 0 of what is none; None without spheres."""
    if not any(radii):
        return None
    bodies, particles = len(radii), int(start[-1])

    def lanes(*shape: int) -> np.ndarray:
        return aligned_zeros(shape, dtype)

    return Spheres(
        start=np.array(start),
        radius=np.array(radii),
        x=lanes(particles, 3),
        before=lanes(particles, 3),
        inverse_mass=lanes(particles),
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
    """Find how contacts see all particles, where some bodies are spheres."""
    for i in range(x.shape[0]):
        set_row(spheres.x, i, row(x, i))
        set_row(spheres.before, i, row(v, i))
        store(spheres.inverse_mass, i, load(inverse_mass, i))
    for body in range(spheres.radius.size):
        if spheres.radius[body] > 0.0:
            first, behind = spheres.start[body], spheres.start[body + 1]
            own, places = mass[first:behind], x[first:behind]
            whole, centre = 0.0 * load(spheres.inverse_mass, first), mass_centre(places, own)
            for i in range(first, behind):
                whole = whole + load(mass, i)
            free = load(spheres.inverse_mass, first) > 0.0
            set_row(spheres.x, first, centre)
            store(spheres.inverse_mass, first, select(free, 1.0 / whole, 0.0))
            diagonal, across = inverse_symmetric(inertia(places, own, centre))
            set_row(spheres.turn, 2 * body, choose(free, diagonal, 0.0 * diagonal))
            set_row(spheres.turn, 2 * body + 1, choose(free, across, 0.0 * across))
            set_row(spheres.before, first, mass_centre(v[first:behind], own))
            set_row(spheres.before, first + 1, turning(body, x, v, mass, spheres))
    return spheres.x, spheres.before, spheres.inverse_mass


@compiled
def turning(body: int, x: Rows, v: Rows, mass: Numbers, spheres: Spheres) -> Vector:
    """Return ω of a sphere [rad/s]."""
    first, behind = spheres.start[body], spheres.start[body + 1]
    centre = row(spheres.x, first)
    moment = angular_momentum(x[first:behind], v[first:behind], mass[first:behind], centre)
    return multiplied(row(spheres.turn, 2 * body), row(spheres.turn, 2 * body + 1), moment)


@compiled
def put_together(x: Rows, v: Rows, mass: Numbers, rows: int, spheres: Spheres | None) -> None:
    """Let the first two rows of each sphere have v and ω in place of its particles' velocities."""
    if spheres is not None and rows > 0:
        for body in range(spheres.radius.size):
            if spheres.radius[body] > 0.0:
                first, behind = spheres.start[body], spheres.start[body + 1]
                mean = mass_centre(v[first:behind], mass[first:behind])
                spin = turning(body, x, v, mass, spheres)
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
                centre = row(spheres.x, first)
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
    """Let all particles of each sphere be in a contact where its first one is."""
    if spheres is not None:
        for body in range(spheres.radius.size):
            if spheres.radius[body] > 0.0:
                first = spheres.start[body]
                for i in range(first + 1, spheres.start[body + 1]):
                    store(touched, i, load(touched, first))


# --- Friction -------------------------------------------------------------------------------------------


@compiled
def body_of(side: int, k: int, problem: Problem) -> int:
    """Return the first body of contact k, or the second."""
    p = problem.contacts.pair[k]
    return problem.pairs.first[p] if side == 0 else problem.pairs.second[p]


@compiled
def both_turn(k: int, problem: Problem, spheres: Spheres) -> bool:
    """Tell whether both bodies of contact k are spheres."""
    return spheres.radius[body_of(0, k, problem)] > 0.0 and spheres.radius[body_of(1, k, problem)] > 0.0


@compiled
def radii(k: int, problem: Problem, spheres: Spheres) -> float:
    """Return the radii of the spheres of contact k, together [m]."""
    return spheres.radius[body_of(0, k, problem)] + spheres.radius[body_of(1, k, problem)]


@compiled
def lever(body: int, k: int, problem: Problem, spheres: Spheres) -> Number:
    """Return ρ of a sphere in contact k [m]; 0 of what is no sphere."""
    gap, radius = load(problem.contacts.gap, k), spheres.radius[body]
    share = 0.0
    if problem.contacts.members[k] == 2:
        share = radius / radii(k, problem, spheres)
    return radius + share * gap


@compiled
def slip_by_turning(v: Rows, k: int, problem: Problem, spheres: Spheres) -> Vector:
    """Return what the turning of spheres adds to the slip of contact k [m/s]."""
    n = row(problem.contacts.normal, k)
    slip = 0.0 * n
    for side in range(2):
        body = body_of(side, k, problem)
        if spheres.radius[body] > 0.0:
            spin = row(v, spheres.start[body] + 1)
            slip = plus_scaled(slip, lever(body, k, problem, spheres), cross(n, spin))
    return slip


@compiled
def inverse_mass_by_turning(along: Vector, k: int, problem: Problem, spheres: Spheres) -> Number:
    """Return what the turning of spheres adds to K of contact k along a unit vector [1/kg]."""
    across = cross(row(problem.contacts.normal, k), along)
    total = 0.0 * across[0]
    for side in range(2):
        body = body_of(side, k, problem)
        if spheres.radius[body] > 0.0:
            rho = lever(body, k, problem, spheres)
            total = total + rho * rho * dot(across, turned(body, across, spheres))
    return total


@compiled
def turned(body: int, moment: Vector, spheres: Spheres) -> Vector:
    """Return I⁻¹ times a vector."""
    return multiplied(row(spheres.turn, 2 * body), row(spheres.turn, 2 * body + 1), moment)


@compiled
def turn_by_friction(v: Rows, k: int, j: Vector, acts: Mask, problem: Problem, spheres: Spheres) -> None:
    """Turn the spheres of contact k by an impulse across its normal, in some lanes."""
    moment = cross(row(problem.contacts.normal, k), j)
    for side in range(2):
        body = body_of(side, k, problem)
        if spheres.radius[body] > 0.0:
            i = spheres.start[body] + 1
            spin, rho = row(v, i), lever(body, k, problem, spheres)
            set_row(v, i, choose(acts, plus_scaled(spin, -1.0 * rho, turned(body, moment, spheres)), spin))
