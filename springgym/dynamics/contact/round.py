"""Round features of bodies at surfaces: positions of their points, and points of contact.

A feature is an ellipsoid in the rest shape, with the centre ξc and the matrix A; its carriers give the
position of each material point by constant weights, affine in ξ (`springgym.model.bodies.round`):

    x(ξ) = Σ wᵢ(ξ) xᵢ,    wᵢ(ξ) = wᵢ(ξc) + Bᵢ · (ξ − ξc).

A surface whose height has the gradient n is touched at the support point, with g = Fᵀ n and F = Σ xᵢ ⊗ Bᵢ,

    ξ = ξc − A g/√(g · A g).

On a curved surface the point and n are found from each other by iteration, which converges where the surface
is less curved inwards than the feature outwards.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number, Rows, Vector
from springgym.core.language.lanes import sqrt
from springgym.core.language.memory import load
from springgym.core.language.vectors import GUARD, apply, block, dot, plus_scaled, row
from springgym.dynamics.contact.law import barrier_energy
from springgym.dynamics.contact.surfaces import count, normal_at
from springgym.dynamics.records import Rounds, Surfaces
from springgym.model.bodies import Body
from springgym.model.bodies.round import weights

BENDS = 6
"""Number of iterations that find a point and the normal of a curved surface from each other."""


class Way(NamedTuple):
    """Straight paths of particles: positions and, if they move on, velocities and a duration."""

    rows: Rows
    """(N, 3) positions [m]; or velocities, if the velocity of a point is to be found"""
    v: Rows | None
    """(N, 3) velocities [m/s]; None if they stay"""
    tau: Number
    """the duration of the motion [s]"""


def packed_rounds(body: Body) -> Rounds:
    """Return the round features of a body in the form of compiled functions."""
    particle = [np.zeros(0, int)]
    base = [np.zeros(0)]
    slope = [np.zeros((0, 3))]
    for feature in body.rounds:
        carriers = feature.carriers(len(body.masses))
        constant, steep = weights(body.masses, body.positions, carriers)
        particle.append(carriers)
        base.append(constant + steep @ feature.centre)
        slope.append(steep)
    ends = np.cumsum([len(own) for own in particle])
    return Rounds(
        first=ends[:-1].astype(np.uint32),
        behind=ends[1:].astype(np.uint32),
        particle=np.concatenate(particle).astype(np.uint32),
        base=np.concatenate(base),
        slope=np.ascontiguousarray(np.concatenate(slope)),
        matrix=np.array([feature.matrix for feature in body.rounds]).reshape(-1, 3),
    )


@compiled
def rolls(rounds: Rounds | None) -> bool:
    """Return whether a body has round features."""
    if rounds is None:
        return False
    return rounds.first.size > 0


# --- Material points --------------------------------------------------------------------------------------


@compiled
def weight(c: int, point: Vector, rounds: Rounds) -> Number:
    """Return the weight of carrier ``c`` at a point, ξ − ξc, of its feature."""
    return load(rounds.base, c) + dot(row(rounds.slope, c), point)


@compiled
def moved(i: int, way: Way, v: Rows | None) -> Vector:
    """Return the row of particle ``i`` at the end of a path."""
    if v is None:
        return row(way.rows, i)
    return plus_scaled(row(way.rows, i), way.tau, row(v, i))


@compiled
def at(e: int, point: Vector, way: Way, rounds: Rounds) -> Vector:
    """Return the position of a point of feature ``e`` after a path, or its velocity."""
    total = 0.0 * point
    for c in range(rounds.first[e], rounds.behind[e]):
        total = plus_scaled(total, weight(c, point, rounds), moved(rounds.particle[c], way, way.v))
    return total


@compiled
def support(e: int, n: Vector, way: Way, rounds: Rounds) -> Vector:
    """Return the support point ξ − ξc of feature ``e``, farthest against n, after a path."""
    g = 0.0 * row(way.rows, 0)
    for c in range(rounds.first[e], rounds.behind[e]):
        g = plus_scaled(g, dot(n, moved(rounds.particle[c], way, way.v)), row(rounds.slope, c))
    pull = apply(block(rounds.matrix, e), g)
    return -1.0 / sqrt(dot(g, pull) + GUARD) * pull


@compiled
def nearest(
    e: int, k: int, way: Way, rounds: Rounds, surfaces: Surfaces
) -> tuple[Vector, Vector, Number, Number]:
    """Return the contact of feature ``e`` with surface ``k`` after a path: ξ − ξc, n, n² and the gap [m]."""
    point = 0.0 * row(way.rows, 0)
    n, square, gap = normal_at(k, at(e, point, way, rounds), surfaces)
    for _ in range(1 if surfaces.coupled is None else BENDS):
        point = support(e, n, way, rounds)
        n, square, gap = normal_at(k, at(e, point, way, rounds), surfaces)
    return point, 0.0 * point + n, 0.0 * gap + square, gap


@compiled
def feature_energy(x: Rows, rounds: Rounds, surfaces: Surfaces) -> Number:
    """Return the energy [J] of a body's round features in the barriers of surfaces."""
    energy = 0.0 * load(x, (0, 0))
    for e in range(rounds.first.size):
        for k in range(count(surfaces.kinds)):
            _, _, _, gap = nearest(e, k, Way(x, None, 0.0), rounds, surfaces)
            energy = energy + barrier_energy(gap, load(surfaces.strength, 0), surfaces.reach)
    return energy
