"""Seeds, directions and orientations for the start of episodes, the latter in closed form.

A decomposition from LAPACK would not determine the signs of axes, nor the axes of equal moments. Another
version could choose others, and every seed would then give another start.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.random import Generator

from springgym.checks import HUGE, TINY, array, instance, number, whole
from springgym.core.compiler.decorators import compiled, kernel
from springgym.core.language.lanes import multiply_add
from springgym.model.bodies import Body
from springgym.model.bodies.equilibrium import StretchedShapes
from springgym.model.bodies.rotations import cross, turned

__all__ = [
    "EQUAL",
    "MOST",
    "above_bowl",
    "any_rotation",
    "direction",
    "headed",
    "lean",
    "principal_axes",
    "spawn_seeds",
    "standing",
    "tilted",
    "turn_of",
    "uniform",
    "varied_top",
]

MOST = 10**8
"""Largest number of seeds that are drawn at once."""

EQUAL = 1e-9
"""Relative difference below which moments count as equal, and their axes are not determined."""


def spawn_seeds(seed: int, copies: int) -> list[int]:
    """Return a seed of 64 bits for each copy; runs with different seeds share none.

    If copy i had the seed ``seed + i``, runs of neighbouring seeds would share their starts.

    Raises
    ------
    TypeError
        If a seed is not a whole number.
    ValueError
        If a seed is negative.
    """
    sequence = np.random.SeedSequence(whole("seed", seed, high=math.inf))
    return [
        int(own.generate_state(1, np.uint64)[0]) for own in sequence.spawn(whole("copies", copies, high=MOST))
    ]


def uniform(rng: Generator, low: Sequence[float], high: Sequence[float]) -> list[float]:
    """Draw a number between each pair of bounds, bit-identical to NumPy's, in a fifth of the time.

    Raises
    ------
    TypeError, ValueError
        If the bounds are not finite numbers, as many low as high ones; the message names them.
    """
    try:
        shares = rng.random(len(low)).tolist()
        drawn = [start + (end - start) * share for start, end, share in zip(low, high, shares, strict=True)]
        total = sum(drawn)
        sound = isinstance(total, float) and abs(total) <= HUGE
    except (AttributeError, TypeError, ValueError):
        sound = False
    if not sound:  # checks beforehand would take longer than the draw
        instance("rng", rng, Generator)
        array("high", high, array("low", low, (None,)).shape)
    return drawn


def direction(rng: Generator) -> np.ndarray:
    """Draw a unit vector (3,); every direction is equally likely."""
    z, azimuth = uniform(instance("rng", rng, Generator), (-1.0, -math.pi), (1.0, math.pi))
    across = math.sqrt(1 - z * z)
    return np.array([across * math.cos(azimuth), across * math.sin(azimuth), z])


def any_rotation(rng: Generator) -> np.ndarray:
    """Draw a rotation (3, 3), all equally likely, by Gram-Schmidt from three random directions."""
    first, second, third = instance("rng", rng, Generator).normal(size=(3, 3)).T.tolist()
    first = _along(first)
    share = _dot(first, second)
    second = _along([b - share * a for a, b in zip(first, second, strict=True)])
    i, j, k = first
    u, v, w = second
    across = [j * w - k * v, k * u - i * w, i * v - j * u]
    side = math.copysign(1.0, _dot(across, third))
    return np.array([[side * a, side * b, c] for a, b, c in zip(first, second, across, strict=True)])


def _dot(u: list[float], w: list[float]) -> float:
    return u[0] * w[0] + u[1] * w[1] + u[2] * w[2]


def _along(vector: list[float]) -> list[float]:
    length = math.sqrt(_dot(vector, vector))
    return [component / length for component in vector]


def tilted(azimuth: float | np.ndarray, tilt: float | np.ndarray) -> np.ndarray:
    """Return the rotation by ``tilt`` [rad] about y, then ``azimuth`` [rad] about z: (3, 3), or (k, 3, 3) for
    (k,).

    It equals the product of two `springgym.model.bodies.rotation` to the bit, where a cosine c is 1 − (1 −
    c)."""
    azimuth = array("azimuth", azimuth, (), (None,))
    angles = np.array((azimuth, array("tilt", tilt, azimuth.shape)))
    sines = np.sin(angles).tolist()
    cosines = np.cos(angles).tolist()
    if angles.ndim == 1:
        return np.array(turn_of.py_func(*sines, *cosines))
    return np.array([turn_of.py_func(*own) for own in zip(*sines, *cosines, strict=True)])


def headed(shapes: np.ndarray, headings: np.ndarray) -> np.ndarray:
    """Return shapes (…, N, 3) rotated about z by headings (…) [rad]."""
    shapes = array("shapes", shapes, (None, 3), (None, None, 3), (None, None, None, 3))
    headings = array("headings", headings, (), (None,), (None, None))
    try:
        np.broadcast_shapes(shapes.shape[:-2], headings.shape)
    except ValueError:
        raise ValueError(f"headings have shape {headings.shape}; shapes have {shapes.shape}") from None
    return shapes @ turned(np.array([0.0, 0.0, 1.0]), headings).swapaxes(-1, -2)


@compiled
def turn_of(sz: float, sy: float, cz: float, cy: float) -> tuple[tuple[float, float, float], ...]:
    """Return a rotation about y, then z, from the sines of the angles about z and y, and their cosines."""
    cz = 1.0 - (1.0 - cz)
    cy = 1.0 - (1.0 - cy)
    return (cz * cy, -sz, cz * sy), (sz * cy, cz, sz * sy), (-sy, 0.0 * cz, cy)


def varied_top(factors: Mapping[str, float]) -> tuple[float, float]:
    """Return the factors of an episode that `standing` needs: scale, and masses over stiffness."""
    return factors["scale"], factors["masses"] / factors["stiffness"]


def standing(shape: StretchedShapes, tip: int, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions [m] and velocities [m/s], (k, N, 3) each, of spinning, leaning tops.

    Parameters
    ----------
    shape
        The shapes of the top at all spins.
    tip
        The particle on which they stand.
    poses : (k, 5)
        Azimuth and tilt [rad], spin [rad/s], and `varied_top`.

    Returns
    -------
    positions from the tip (k, N, 3) [m], velocities (k, N, 3) [m/s] if that is at rest
    """
    instance("shape", shape, StretchedShapes)
    tip = whole("tip", tip, high=shape.coefficients.shape[1] - 1)
    poses = np.ascontiguousarray(array("poses", poses, (None, 5)))
    shapes = shape.at(poses[:, 2] * np.sqrt(poses[:, 4]))
    positions, velocities = np.empty((2, *shapes.shape))
    lean(shapes, tip, poses, positions, velocities)
    return positions, velocities


@kernel
def lean(
    shapes: np.ndarray, tip: int, poses: np.ndarray, positions: np.ndarray, velocities: np.ndarray
) -> None:
    """Scale upright shapes (k, N, 3), turn them about the tip, and let them spin; see `standing`."""
    for k in range(shapes.shape[0]):
        azimuth = poses[k, 0]
        tilt = poses[k, 1]
        spin = poses[k, 2]
        scale = poses[k, 3]
        foot = (shapes[k, tip, 0], shapes[k, tip, 1], shapes[k, tip, 2])
        turn = turn_of(math.sin(azimuth), math.sin(tilt), math.cos(azimuth), math.cos(tilt))
        wx = spin * turn[0][2]
        wy = spin * turn[1][2]
        wz = spin * turn[2][2]
        for n in range(shapes.shape[1]):
            x = scale * shapes[k, n, 0] - scale * foot[0]
            y = scale * shapes[k, n, 1] - scale * foot[1]
            z = scale * shapes[k, n, 2] - scale * foot[2]
            for axis in range(3):
                total = multiply_add(turn[axis][0], x, 0.0)
                total = multiply_add(turn[axis][1], y, total)
                positions[k, n, axis] = multiply_add(turn[axis][2], z, total)
            x = positions[k, n, 0]
            y = positions[k, n, 1]
            z = positions[k, n, 2]
            velocities[k, n, 0] = wy * z - wz * y
            velocities[k, n, 1] = wz * x - wx * z
            velocities[k, n, 2] = wx * y - wy * x


def above_bowl(radius: float, away: float, height: float) -> tuple[float, float]:
    """Return the distance of a point from the axis of a bowl, and its height [m].

    It is ``height`` above the bowl, along the normal of a place that is ``away`` from the axis.
    """
    radius = number("radius", radius, TINY)
    away = number("away", away, -radius, radius)
    height = number("height", height)
    steepness = math.asin(away / radius)
    left = radius - height
    return left * math.sin(steepness), radius - left * math.cos(steepness)


def principal_axes(body: Body) -> np.ndarray:
    """Return the principal axes about the centre of mass, ascending by moment, as columns of a rotation (3,
    3).

    The largest component of each axis is positive, except for the last axis, which makes them right-handed.
    Among equal moments, the first axis is the one nearest to a coordinate axis, and so on.
    """
    moments, vectors = instance("body", body, Body).principal()
    chosen: list[np.ndarray] = []
    for moment in moments:
        space = vectors[:, np.abs(moments - moment) < EQUAL * moments[2]]
        projector = space @ space.T
        for earlier in chosen:
            projector = projector - np.outer(earlier, earlier) @ projector
        sizes = np.sqrt((projector * projector).sum(axis=0))
        axis = projector[:, _first_largest(sizes)]
        axis = _unit(axis)
        chosen.append(math.copysign(1.0, axis[_first_largest(np.abs(axis))]) * axis)
    chosen[2] = cross(chosen[0], chosen[1])
    return np.column_stack(chosen)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / math.sqrt((vector * vector).sum())


def _first_largest(sizes: np.ndarray) -> int:
    """Return the index of the first of the largest sizes, which may differ by rounding."""
    return int(np.argmax(sizes > (1 - EQUAL) * sizes.max()))
