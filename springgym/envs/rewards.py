"""Shapes of rewards, for compiled task functions."""

from __future__ import annotations

import math

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Vector
from springgym.dynamics.measures import Measures


@compiled
def gaussian(value: float, margin: float, bound: float = 0.0) -> float:
    """Return 1 within ±``bound``, 0.1 at ``margin`` beyond: 0.1^(d²), d = max(|value| − bound, 0)/margin."""
    d = max(abs(value) - bound, 0.0) / margin
    return 0.1 ** (d * d)


@compiled
def long_tail(value: float, margin: float, bound: float = 0.0) -> float:
    """Return 1 within ±``bound``, 0.1 at ``margin`` beyond, with a long tail: 1/(1 + 9d²)."""
    d = max(abs(value) - bound, 0.0) / margin
    return 1.0 / (1.0 + 9.0 * d * d)


@compiled
def thrift(action: np.ndarray, c: int) -> float:
    """Return the effort factor 1 − 0.1 mean(a²) of copy c, which multiplies rewards."""
    total = 0.0
    for n in range(action.shape[1]):
        total += action[c, n] ** 2
    return 1.0 - 0.1 * total / action.shape[1]


@compiled
def tilt_of(m: Measures, c: int) -> float:
    """Return the angle of the third axis of copy c from the vertical [rad]."""
    return math.atan2(math.hypot(m.axis[c, 0], m.axis[c, 1]), m.axis[c, 2])


@compiled
def spinning(m: Measures, c: int) -> tuple[float, float]:
    """Return the angular velocity of copy c along its third axis, and its magnitude across it [rad/s]."""
    n = m.axis[c]
    w = m.angular_velocity[c]
    along = w[0] * n[0] + w[1] * n[1] + w[2] * n[2]
    return along, math.sqrt(max(w[0] ** 2 + w[1] ** 2 + w[2] ** 2 - along**2, 0.0))


@compiled
def put_axis(m: Measures, c: int, unit: float, entries: np.ndarray) -> float:
    """Write the third axis of copy c and the angular velocity across it to ``entries`` (6,).

    The latter is divided by a ``unit`` [rad/s]. Returns the angular velocity along the axis [rad/s].
    """
    spin, _ = spinning(m, c)
    for axis in range(3):
        n = m.axis[c, axis]
        entries[axis] = n
        entries[3 + axis] = (m.angular_velocity[c, axis] - spin * n) / unit
    return spin


@compiled
def angle_of(cosine: float) -> float:
    """Return the angle of a cosine that may exceed ±1 by rounding [rad]."""
    return math.acos(min(max(cosine, -1.0), 1.0))


@compiled
def height_above(place: Vector, point: Vector, normal: Vector) -> float:
    """Return the height of a point (3,) above the plane through ``place`` with the unit ``normal`` [m]."""
    height = 0.0
    for axis in range(3):
        height += (point[axis] - place[axis]) * normal[axis]
    return height


@compiled
def angle_between(u: Vector, w: Vector) -> float:
    """Return the angle between two vectors (3,) [rad], accurate also for small angles."""
    x = u[1] * w[2] - u[2] * w[1]
    y = u[2] * w[0] - u[0] * w[2]
    z = u[0] * w[1] - u[1] * w[0]
    return math.atan2(math.sqrt(x * x + y * y + z * z), u[0] * w[0] + u[1] * w[1] + u[2] * w[2])
