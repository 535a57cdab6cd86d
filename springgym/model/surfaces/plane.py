"""Planes: height n · x − n · p, with the unit normal n and a point p."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from springgym.checks import array, direction, number, refusing_unknown
from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number, Vector
from springgym.core.language.memory import load
from springgym.core.language.vectors import dot, row
from springgym.model.records import read_only
from springgym.model.surfaces.surface import Surface, points


class Planes(NamedTuple):
    """The planes of a scene, for compiled code."""

    normal: np.ndarray
    """(planes, 3) unit vectors"""
    offset: np.ndarray
    """(planes,) offset of each plane along its normal [m]"""

    @staticmethod
    def flat() -> bool:
        """Return True: the gradient is a unit vector, and the same everywhere."""
        return True

    @staticmethod
    @compiled
    def height(place: Vector, k: int, own: Planes) -> Number:
        return dot(row(own.normal, k), place) - load(own.offset, k)

    @staticmethod
    @compiled
    def gradient(place: Vector, k: int, own: Planes) -> Vector:
        return row(own.normal, k)


@refusing_unknown
@dataclass(frozen=True)
class Plane(Surface):
    """A plane whose normal points to the free side. A normal of any length is normalised."""

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", tuple(array("point of a plane", self.point, (3,)).tolist()))
        object.__setattr__(self, "normal", tuple(direction("normal of a plane", self.normal).tolist()))

    @cached_property
    def offset(self) -> float:
        """Return normal · point [m]."""
        return float(np.dot(self.normal, self.point))

    def height(self, positions: np.ndarray) -> np.ndarray:
        """Return the heights [m] (…) of positions (…, 3): negative behind the plane."""
        return points(positions) @ self._across - self.offset

    @cached_property
    def _across(self) -> np.ndarray:
        """Return the normal as an array."""
        return read_only(self.normal)

    @classmethod
    def packed(cls, surfaces: Sequence[Self]) -> Planes:
        return Planes(
            np.array([plane.normal for plane in surfaces]), np.array([plane.offset for plane in surfaces])
        )

    def net(self, middle: np.ndarray, extent: float) -> np.ndarray:
        normal = np.asarray(self.normal)
        foot = middle - normal * float(normal @ middle - self.offset)
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        first /= np.linalg.norm(first)
        along = np.linspace(-extent, extent, 33)
        return np.asarray(
            foot + along[:, None, None] * first + along[None, :, None] * np.cross(normal, first)
        )


@refusing_unknown
def floor(z: float = 0.0) -> Plane:
    """Return a level plane at height z [m]."""
    return Plane((0.0, 0.0, number("z", z)))


@refusing_unknown
def incline(angle: float, point: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Plane:
    """Return a slope that rises towards +x by ``angle`` [rad], through a point."""
    angle = number("angle of an incline [rad]", angle, -math.pi / 2, math.pi / 2)
    return Plane(point, (-math.sin(angle), 0.0, math.cos(angle)))
