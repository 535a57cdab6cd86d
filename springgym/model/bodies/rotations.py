"""Rotations as matrices, and the triad that rotates with a body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import TINY, direction, number, refusing_unknown


@refusing_unknown
def rotation(axis: ArrayLike, angle: float) -> np.ndarray:
    """Return the matrix (3, 3) of the rotation by ``angle`` [rad] about an axis (Rodrigues' formula)."""
    return turned(direction("axis", axis), number("angle", angle))


def turned(axis: np.ndarray, angle: ArrayLike) -> np.ndarray:
    """Return the matrices (…, 3, 3) of `rotation` for unit vectors (…, 3), not checked, and angles (…)."""
    u = skew(axis)
    angles = np.array(angle)[..., None, None]
    return np.eye(3) + np.sin(angles) * u + (1 - np.cos(angles)) * u @ u


def skew(u: np.ndarray) -> np.ndarray:
    """Return the matrices (…, 3, 3) of the map w ↦ u × w, for vectors u (…, 3)."""
    return cross(np.eye(3), u[..., None, :])


NEXT = np.array([1, 2, 0])
LAST = np.array([2, 0, 1])


def cross(u: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return u × w of vectors (…, 3). For few of them this takes a third of the time of `numpy.cross`."""
    ahead = u.take(NEXT, axis=-1) * w.take(LAST, axis=-1)
    return ahead - u.take(LAST, axis=-1) * w.take(NEXT, axis=-1)


def axes(positions: np.ndarray, markers: Sequence[int]) -> np.ndarray:
    """Return the triad of three particles (`Body.markers`) as the columns of a rotation (3, 3).

    If the particles lie on a line, the first axis is any one across it. If they coincide, the axes are the
    world's.
    """
    i, j, k = markers
    third = positions[j] - positions[i]
    if not third.any():
        return np.eye(3)
    third = third / np.linalg.norm(third)
    across = np.eye(3) - np.outer(third, third)
    candidates = across @ np.column_stack([positions[k] - positions[i], np.eye(3)])
    size = np.linalg.norm(candidates, axis=0)
    reach = np.linalg.norm(positions[k] - positions[i])
    best = 0 if size[0] > 1e-9 * reach else 1 + int(np.argmax(size[1:]))
    first = candidates[:, best] / size[best]
    return np.column_stack([first, np.cross(third, first), third])


def rotating(vector: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(vector))
    return turned(np.asarray(vector) / angle, angle) if angle >= TINY else np.eye(3)


def aligning(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the smallest rotation (3, 3) from the direction of ``source`` to the unit vector ``target``."""
    source = source / np.linalg.norm(source)
    across = np.cross(source, target)
    size = float(np.linalg.norm(across))
    if size > 1e-12:
        return rotation(across, np.arctan2(size, source @ target))
    any_normal = np.cross(target, np.eye(3)[np.argmin(np.abs(target))])
    return np.eye(3) if source @ target > 0 else rotation(any_normal, np.pi)
