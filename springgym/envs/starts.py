"""Seeds, directions and orientations for the start of episodes, the latter in closed form.

A decomposition from LAPACK would not determine the signs of axes, nor the axes of equal moments. Another
version could choose others, and every seed would then start in another way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.random import Generator

from springgym.bodies import Body
from springgym.bodies.equilibrium import StretchedShapes
from springgym.bodies.rotations import cross
from springgym.checks import whole

EQUAL = 1e-9
"""Moments that differ by a smaller share count as equal, and their axes are not determined."""


def spawned(seed: int, copies: int) -> list[int]:
    """Return a seed of 64 bits for each copy; runs of different seeds share none.

    If copy i had the seed ``seed + i``, runs of neighbouring seeds would share their starts.

    Raises
    ------
    TypeError
        If a seed is not a whole number.
    ValueError
        If a seed is negative.
    """
    sequence = np.random.SeedSequence(whole("seed", seed, high=math.inf))
    return [int(own.generate_state(1, np.uint64)[0]) for own in sequence.spawn(whole("copies", copies))]


def uniform(rng: Generator, low: Sequence[float], high: Sequence[float]) -> list[float]:
    """Draw a number between each pair of bounds, to the bit as NumPy does, in a fifth of the time."""
    shares = rng.random(len(low)).tolist()
    return [start + (end - start) * share for start, end, share in zip(low, high, shares, strict=True)]


def direction(rng: Generator) -> np.ndarray:
    """Draw a unit vector (3,); every direction is equally likely."""
    z, azimuth = uniform(rng, (-1.0, -math.pi), (1.0, math.pi))
    across = math.sqrt(1 - z * z)
    return np.array([across * math.cos(azimuth), across * math.sin(azimuth), z])


def any_rotation(rng: Generator) -> np.ndarray:
    """Draw a rotation (3, 3), all equally likely, by Gram-Schmidt from three random directions."""
    first, second, third = rng.normal(size=(3, 3)).T
    first = _unit(first)
    second = _unit(second - (first * second).sum() * first)
    across = cross(first, second)
    side = math.copysign(1.0, (across * third).sum())
    return np.column_stack([side * first, side * second, across])


def tilted(azimuth: float | np.ndarray, tilt: float | np.ndarray) -> np.ndarray:
    """Return the rotation by ``tilt`` [rad] about y, then ``azimuth`` [rad] about z: (3, 3), or (k, 3, 3) for
    (k,).

    It equals the product of two `springgym.bodies.rotation` to the bit, where a cosine c is 1 − (1 − c).
    """
    angles = np.array((azimuth, tilt))
    sines, cosines = np.sin(angles).tolist(), (1 - (1 - np.cos(angles))).tolist()
    if angles.ndim == 1:
        return np.array(_turn(*sines, *cosines))
    return np.array([_turn(*own) for own in zip(*sines, *cosines, strict=True)])


def _turn(s: float, sine: float, c: float, cosine: float) -> list[list[float]]:
    """Return a rotation about y, then z, from the sines of the angles about z and y, and their cosines."""
    return [[c * cosine, -s, c * sine], [s * cosine, c, s * sine], [-sine, 0 * c, cosine]]


def standing(
    shape: StretchedShapes, tip: int, poses: np.ndarray, factors: Sequence[Mapping[str, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the states of spinning, leaning tops, each with the factors of its episode's randomisation.

    Parameters
    ----------
    shape
        The shapes of the top at all spins.
    tip
        The particle on which they stand.
    poses : (k, 3)
        Azimuth and tilt [rad], and spin [rad/s].

    Returns
    -------
    positions from the tip (k, N, 3) [m], velocities (k, N, 3) [m/s] if that is at rest
    """
    azimuth, tilt, spin = poses.T
    softer = np.sqrt([own["masses"] / own["stiffness"] for own in factors])
    shapes = np.array([[[own["scale"]]] for own in factors]) * shape(spin * softer)
    turn = tilted(azimuth, tilt)
    arms = (shapes - shapes[:, tip, None]) @ turn.transpose(0, 2, 1)
    return arms, cross((spin[:, None] * turn[:, :, 2])[:, None], arms)


def above_bowl(radius: float, away: float, height: float) -> tuple[float, float]:
    """Return the distance of a point from the axis of a bowl, and its height [m].

    It is ``height`` above the bowl, along the normal of a place that is ``away`` from the axis.
    """
    steepness, left = math.asin(away / radius), radius - height
    return left * math.sin(steepness), radius - left * math.cos(steepness)


def principal_axes(body: Body) -> np.ndarray:
    """Return the principal axes about the centre of mass, ascending by moment, as columns of a rotation (3,
    3).

    The largest component of each axis is positive, except for the last axis, which makes them right-handed.
    Among equal moments, the first axis is the one nearest to a coordinate axis, and so on.
    """
    moments, vectors = body.principal()
    chosen: list[np.ndarray] = []
    for moment in moments:
        space = vectors[:, np.abs(moments - moment) < EQUAL * moments[2]]
        projector = space @ space.T
        for axis in chosen:
            projector = projector - np.outer(axis, axis) @ projector
        sizes = np.sqrt((projector * projector).sum(axis=0))
        axis = projector[:, _first_largest(sizes)]
        axis = _unit(axis)
        chosen.append(math.copysign(1.0, axis[_first_largest(np.abs(axis))]) * axis)
    chosen[2] = cross(chosen[0], chosen[1])
    return np.column_stack(chosen)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / math.sqrt((vector * vector).sum())


def _first_largest(sizes: np.ndarray) -> int:
    """Return the first of the largest ones, as if rounding had not told them apart."""
    return int(np.argmax(sizes > (1 - EQUAL) * sizes.max()))
