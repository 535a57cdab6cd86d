"""Rotations as unit quaternions (w, x, y, z) of lanes, which turn body into world coordinates."""

from __future__ import annotations

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number, Vector
from springgym.core.language.lanes import rounded, sqrt
from springgym.core.language.vectors import GUARD, cross, dot, vec

PI_HIGH = 3.1415925025939941  # 22 bits: a few times it is exact
PI_LOW = 1.5099579909783765e-07


@compiled
def sine_cosine(angle: Number) -> tuple[Number, Number]:
    """Return (sin, cos), or both negated: both signs of a quaternion are the same rotation.

    The angle is reduced to |angle| ≤ π/2, with Taylor series at half of it and double-angle formulas.
    """
    turns = rounded(angle * 0.3183098861837907)
    half = 0.5 * ((angle - turns * PI_HIGH) - turns * PI_LOW)
    z = half * half
    series = 2.8114572543455206e-15 * z - 7.647163731819816e-13
    series = series * z + 1.6059043836821613e-10
    series = series * z - 2.505210838544172e-08
    series = series * z + 2.7557319223985893e-06
    series = series * z - 0.0001984126984126984
    series = series * z + 0.008333333333333333
    series = series * z - 0.16666666666666666
    sine = half + half * z * series
    series = 4.779477332387385e-14 * z - 1.1470745597729725e-11
    series = series * z + 2.08767569878681e-09
    series = series * z - 2.755731922398589e-07
    series = series * z + 2.48015873015873e-05
    series = series * z - 0.001388888888888889
    series = series * z + 0.041666666666666664
    series = series * z - 0.5
    cosine = 1.0 + z * series
    return 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine


@compiled
def product(p: Vector, q: Vector) -> Vector:
    """Return the rotation q, followed by p."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] + p[2] * q[0] + p[3] * q[1] - p[1] * q[3],
        p[0] * q[3] + p[3] * q[0] + p[1] * q[2] - p[2] * q[1],
    )


@compiled
def normalised(q: Vector) -> Vector:
    inverse = 1.0 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return inverse * q[0], inverse * q[1], inverse * q[2], inverse * q[3]


@compiled
def turn(q: Vector, u: Vector) -> Vector:
    """Turn a vector from body to world coordinates: u + 2 w a × u + 2 a × (a × u), q = (w, a)."""
    axis = vec(q[1], q[2], q[3])
    across = 2.0 * cross(axis, u)
    return u + (q[0] * across + cross(axis, across))


@compiled
def turn_back(q: Vector, u: Vector) -> Vector:
    """Turn a vector from world to body coordinates."""
    return turn((q[0], -q[1], -q[2], -q[3]), u)


@compiled
def rotation_vector(u: Vector, scale: Number) -> Vector:
    """Return the rotation about ``u`` by the angle ``scale`` × |u|."""
    size = sqrt(dot(u, u) + GUARD)
    sine, cosine = sine_cosine((0.5 * scale) * size)
    s = sine / size
    return cosine, s * u[0], s * u[1], s * u[2]
