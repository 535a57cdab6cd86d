"""The base of surfaces: a height and, in compiled code, its gradient.

A kind of surface is one file of this folder and one line of `springgym.model.surfaces.SURFACES`. The file has
a frozen dataclass for users, a `Surface`, and a named tuple for compiled code. The named tuple holds arrays
with one row for each surface of the kind. The length of the first array is the number of surfaces. The named
tuple has two static compiled functions:

    height(place, k, own)    the height of a place above surface k [m]: smooth, 0 on the surface, and near it
                             the distance from it
    gradient(place, k, own)  the gradient of this height: the normal, a unit vector if the height is the
                             distance

If the gradient is the same unit vector everywhere, the kind has a function ``flat`` that returns True.
Contact needs nothing else. `springgym.model.surfaces.check_gradient` checks both functions, and
`springgym.dynamics.contact.surfaces` explains how it computes a normal from these functions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import array, shown
from springgym.model.own_forces import check_functions

FUNCTIONS = {"height": ("place", "k", "own"), "gradient": ("place", "k", "own")}
"""The compiled functions of a kind of surface, and their parameters."""


class Surface(ABC):
    """A surface that bounds the free particles: its height, the gap to it, stays positive."""

    @abstractmethod
    def height(self, positions: np.ndarray) -> np.ndarray:
        """Return the heights [m] (…) of positions (…, 3): negative behind the surface."""

    @classmethod
    @abstractmethod
    def packed(cls, surfaces: Sequence[Self]) -> tuple[Any, ...]:
        """Return some surfaces of this kind as a named tuple for compiled code."""

    @abstractmethod
    def net(self, middle: np.ndarray, extent: float) -> np.ndarray:
        """Return points (m, n, 3) [m] of the surface, in rows and columns, for drawing.

        The picture shows an ``extent`` [m] around the ``middle`` (3,) [m] of the scene.
        """

    def fade(self, points: np.ndarray, middle: np.ndarray, extent: float) -> np.ndarray:
        """Return the opacity of points (…, 3) of the surface in pictures, from 0 to 1."""
        away = np.linalg.norm(points - middle, axis=-1) / (2.0 * extent)
        return np.asarray(np.maximum(1.0 - away**2, 0.0))

    def hit(self, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the points where rays (…, 3) hit the surface from its free side, and its unit normals there.

        Both are NaN for rays that miss the surface. A surface that returns None is drawn as a net, without
        shading.
        """
        return None


def by_kind(surfaces: Sequence[Surface]) -> dict[type[Surface], list[int]]:
    """Return the indices of some surfaces by their kinds, in the order of compiled code."""
    kinds: dict[type[Surface], list[int]] = {}
    for n, surface in enumerate(surfaces):
        kinds.setdefault(type(surface), []).append(n)
    return kinds


def packed_kind(kind: type[Surface], surfaces: Sequence[Surface]) -> Any:
    """Return surfaces of one kind as a named tuple for compiled code, after checking it.

    Raises
    ------
    TypeError, ValueError
        If the kind packs no named tuple of arrays with a row for each surface, or lacks a function.
    """
    packed = kind.packed(surfaces)
    name = f"what {kind.__name__}.packed gave"
    if not isinstance(packed, tuple) or not hasattr(packed, "_fields"):
        raise TypeError(f"{name} is {shown(packed)}; it must be a named tuple of arrays")
    check_functions(name, type(packed), FUNCTIONS)
    for field, value in zip(packed._fields, packed, strict=True):
        if not isinstance(value, np.ndarray) or not value.ndim:
            raise TypeError(f"{name}.{field} is {shown(value)}; it must be an array with one row per surface")
    if len(packed[0]) != len(surfaces):
        raise ValueError(f"{name}.{packed._fields[0]} has {len(packed[0])} rows for {len(surfaces)} surfaces")
    return packed


def points(positions: ArrayLike) -> np.ndarray:
    """Return positions as an array (…, 3), after checking them.

    Raises
    ------
    TypeError, ValueError
        If they are not numbers, or their shape is not (3,), (N, 3) or (k, N, 3).
    """
    return array("positions", positions, (3,), (None, 3), (None, None, 3))
