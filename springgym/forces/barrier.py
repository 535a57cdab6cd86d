"""Surfaces that bound where particles may be: how high a particle is above them, and friction along them.

Particles meet them by `springgym.contact.law`; friction is Coulomb's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from springgym.contact.law import barrier_energy
from springgym.core.compiling import compiled
from springgym.core.kinds import Number, Numbers, Vector
from springgym.core.lanes import load, minimum, sqrt
from springgym.core.vectors import TINY, dot, row, vector

if TYPE_CHECKING:
    from springgym.forces import Particles


class Planes(NamedTuple):
    """Planes that bound where particles may be; any two meet at a right angle or a wider one."""

    normal: np.ndarray
    """(planes, 3) unit vectors"""
    offset: np.ndarray
    """(planes,) [m]: the height of x is normal · x − offset"""
    strength: np.ndarray
    """c [N·m²], (1,)"""
    reach: float
    """Δ [m]"""
    oblique: bool | None
    """True if two of them meet at another than a right angle; else None, so that no turns are compiled"""


class HollowSphere(NamedTuple):
    """The inside of a sphere."""

    centre: np.ndarray
    """(3,) [m]"""
    radius: float
    """[m]: the height of x is radius − |x − centre|"""
    strength: np.ndarray
    """c [N·m²], (1,)"""
    reach: float
    """Δ [m]"""


@compiled
def slowed(slip: Vector, limit: Number) -> Any:
    """What friction takes from the velocity ``slip`` along a surface: ``limit`` of it, or all there is."""
    return minimum(limit / sqrt(dot(slip, slip) + TINY), 1.0) * slip


@compiled
def coefficient(of: Numbers, none: Number) -> Any:
    """The one number of friction or loss, or ``none`` if the scene has no such thing."""
    if of is not None:
        none = none + load(of, 0)
    return none


# --- Surfaces -----------------------------------------------------------------------------------------


@compiled
def height(position: Vector, planes: Planes, k: int) -> Any:
    """Height above a plane [m]."""
    return dot(row(planes.normal, k), position) - load(planes.offset, k)


@compiled
def surfaces(planes: Planes | None, bowl: HollowSphere | None) -> int:
    """How many there are: planes or a bowl."""
    count = 0
    if planes is not None:
        count += planes.offset.size
    if bowl is not None:
        count += 1
    return count


@compiled
def strength_and_reach(planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """c [N·m²] and Δ [m] of all surfaces."""
    if planes is not None:
        return load(planes.strength, 0), planes.reach
    if bowl is not None:
        return load(bowl.strength, 0), bowl.reach
    raise LookupError("no surfaces")


@compiled
def facing(k: int, begin: Vector, end: Vector, planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """The normal n̄ of surface ``k`` for a way, and the height at which that begins.

    n̄ · (end − begin) is exactly the difference of both heights: in a bowl, with d from its centre and r =
    |d|, n̄ = −(d₀ + d₁)/(r₀ + r₁).
    """
    if planes is not None:
        return row(planes.normal, k), height(begin, planes, k)
    if bowl is not None:
        first, last = begin - vector(bowl.centre), end - vector(bowl.centre)
        near, far = sqrt(dot(first, first) + TINY), sqrt(dot(last, last) + TINY)
        return -1.0 / (near + far) * (first + last), bowl.radius - near
    raise LookupError("no surfaces")


@compiled
def standing(k: int, position: Any, planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """The normal of surface ``k`` at a position, and the height there."""
    return facing(k, position, position, planes, bowl)


@compiled
def energy_at(position: Vector, planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """Energy of a free particle in the barriers of all surfaces [J]."""
    energy = 0.0 * position[0]
    if planes is not None:
        for k in range(planes.offset.size):
            h = height(position, planes, k)
            energy = energy + barrier_energy(h, load(planes.strength, 0), planes.reach)
    if bowl is not None:
        from_centre = position - vector(bowl.centre)
        h = bowl.radius - sqrt(dot(from_centre, from_centre))
        energy = energy + barrier_energy(h, load(bowl.strength, 0), bowl.reach)
    return energy


@compiled
def contact_energy(x: Numbers, particles: Particles, planes: Planes | None, bowl: HollowSphere | None) -> Any:
    """Energy of the particles in the barriers of all surfaces [J]."""
    energy = 0.0 * load(x, (0, 0))
    for i in range(particles.mass.size):
        if particles.free[i]:
            energy = energy + energy_at(row(x, i), planes, bowl)
    return energy
