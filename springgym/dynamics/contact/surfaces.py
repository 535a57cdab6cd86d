"""Surfaces that bound the space of particles: heights of particles above them, and normals.

Contact with them follows `springgym.dynamics.contact.law`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from numba.extending import overload

from springgym.core.compiler.decorators import OPTIONS, compiled
from springgym.core.language.kinds import Number, Numbers, Vector
from springgym.core.language.lanes import epsilon, minimum, sqrt
from springgym.core.language.memory import load
from springgym.core.language.vectors import GUARD, dot, plus_scaled, row
from springgym.dynamics.contact.law import barrier_energy
from springgym.dynamics.records import Facing, Kinds, Surfaces
from springgym.dynamics.terms import Particles

Overload: TypeAlias = Callable[..., Any]
"""A function that Numba compiles instead of another, for the scene's kinds of surfaces."""

INLINE = {**OPTIONS, "forceinline": True}
"""Options of functions that differ by the kinds of surfaces: they are inlined into their callers."""

COMPILED = "Numba compiles an overload instead of this"


@compiled
def coefficient(of: Numbers, none: Number) -> Number:
    """Return the coefficient of friction or loss, or ``none`` if the scene has none."""
    if of is not None:
        none = none + load(of, 0)
    return none


# --- Surfaces -----------------------------------------------------------------------------------------


def count(kinds: Kinds) -> int:
    """Return the number of surfaces of some kinds."""
    raise NotImplementedError(COMPILED)


@overload(count, jit_options=INLINE)
def _count(kinds: Kinds) -> Overload:
    def of_first(kinds: Kinds) -> int:
        return kinds[0][0].shape[0]

    def of_all(kinds: Kinds) -> int:
        return kinds[0][0].shape[0] + count(kinds[1:])

    return of_first if len(kinds) == 1 else of_all


def distance(k: int, place: Vector, kinds: Kinds) -> Number:
    """Return the height [m] of a point above surface ``k`` of some kinds."""
    raise NotImplementedError(COMPILED)


@overload(distance, jit_options=INLINE)
def _distance(k: int, place: Vector, kinds: Kinds) -> Overload:
    height = kinds[0].instance_class.height

    def of_first(k: int, place: Vector, kinds: Kinds) -> Number:
        return height(place, k, kinds[0])

    def of_one(k: int, place: Vector, kinds: Kinds) -> Number:
        own = kinds[0][0].shape[0]
        if k < own:
            return height(place, k, kinds[0])
        return distance(k - own, place, kinds[1:])

    return of_first if len(kinds) == 1 else of_one


def mean_gradient(k: int, begin: Vector, end: Vector, least: Number, kinds: Kinds) -> Facing:
    """Return n̄ of surface ``k`` along a path, its square, and the height [m] where the path begins.

    For a path shorter than ``least`` [m], the correction would only be rounding, and is left out.
    """
    raise NotImplementedError(COMPILED)


def _mean_gradient_of_first(kind: Any) -> Overload:
    """Return an implementation of `mean_gradient` for surfaces of the first kind."""
    height = kind.height
    gradient = kind.gradient

    def of_plane(k: int, begin: Vector, end: Vector, least: Number, kinds: Kinds) -> Facing:
        return gradient(begin, k, kinds[0]), 1.0, height(begin, k, kinds[0])

    def of_way(k: int, begin: Vector, end: Vector, least: Number, kinds: Kinds) -> Facing:
        way = end - begin
        start = height(begin, k, kinds[0])
        n = gradient(plus_scaled(begin, 0.5, way), k, kinds[0])
        missing = height(end, k, kinds[0]) - start - dot(n, way)
        n = plus_scaled(n, missing / (dot(way, way) + least * least), way)
        return n, dot(n, n) + GUARD, start

    return of_plane if getattr(kind, "flat", bool)() else of_way


@overload(mean_gradient, jit_options=INLINE)
def _mean_gradient(k: int, begin: Vector, end: Vector, least: Number, kinds: Kinds) -> Overload:
    of_first = _mean_gradient_of_first(kinds[0].instance_class)
    if len(kinds) == 1:
        return of_first
    first = compiled(of_first)

    def of_one(k: int, begin: Vector, end: Vector, least: Number, kinds: Kinds) -> Facing:
        own = kinds[0][0].shape[0]
        if k < own:
            n, square, start = first(k, begin, end, least, kinds)
            return 0.0 * begin + n, 0.0 * start + square, start
        n, square, start = mean_gradient(k - own, begin, end, least, kinds[1:])
        return 0.0 * begin + n, 0.0 * start + square, start

    return of_one


@compiled
def strength_and_reach(surfaces: Surfaces) -> tuple[Number, Number]:
    """Return c [N·m²] and Δ [m] of all surfaces."""
    return load(surfaces.strength, 0), surfaces.reach


@compiled
def from_skin(distance: Number, radius: float | None) -> Number:
    """Return the gap [m] to a surface, given the ``distance`` of a ball's centre, or of a point."""
    if radius is not None:
        distance = distance - radius
    return distance


@compiled
def height(k: int, place: Vector, surfaces: Surfaces) -> Number:
    """Return the gap [m] between a particle at a point and surface ``k``."""
    return from_skin(distance(k, place, surfaces.kinds), surfaces.radius)


@compiled
def mean_normal(k: int, begin: Vector, end: Vector, surfaces: Surfaces) -> Facing:
    """Return the normal n̄ of surface ``k`` along a path, its square, and the gap [m] where the path begins.

    n̄ · (end − begin) is the difference of both gaps: n̄ is the discrete gradient of the height h (Gonzalez,
    J. Nonlinear Sci. 6 (1996) 449, doi:10.1007/BF02440162),

        n̄ = ∇h(m) + (h(end) − h(begin) − ∇h(m) · d)/|d|² d,    m = (begin + end)/2,    d = end − begin.

    For planes it is their normal. For a path shorter than 1e-5 Δ, the second term is left out, as rounding
    would exceed it.
    """
    least = sqrt(1e-10 + 100.0 * epsilon(begin[0])) * surfaces.reach
    n, square, start = mean_gradient(k, begin, end, least, surfaces.kinds)
    return n, square, from_skin(start, surfaces.radius)


@compiled
def normal_at(k: int, place: Vector, surfaces: Surfaces) -> Facing:
    """Return the normal of surface ``k`` at a point, its square, and the gap there [m]."""
    return mean_normal(k, place, place, surfaces)


@compiled
def lowest(place: Vector, surfaces: Surfaces) -> Number:
    """Return the smallest gap [m] between a particle at a point and any surface."""
    least = height(0, place, surfaces)
    for k in range(1, count(surfaces.kinds)):
        least = minimum(least, height(k, place, surfaces))
    return least


@compiled
def energy_at(position: Vector, surfaces: Surfaces | None) -> Number:
    """Return the energy of a free particle in the barriers of all surfaces [J]; 0 without surfaces."""
    energy = 0.0 * position[0]
    if surfaces is not None:
        for k in range(count(surfaces.kinds)):
            gap = height(k, position, surfaces)
            energy = energy + barrier_energy(gap, load(surfaces.strength, 0), surfaces.reach)
    return energy


@compiled
def contact_energy(x: Numbers, particles: Particles, surfaces: Surfaces | None) -> Number:
    """Return the energy of the particles in the barriers of all surfaces [J]."""
    energy = 0.0 * load(x, (0, 0))
    for i in range(particles.mass.size):
        if particles.free[i]:
            energy = energy + energy_at(row(x, i), surfaces)
    return energy
