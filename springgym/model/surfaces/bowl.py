"""The inside of a sphere: height R − |x − c|, which is the distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from springgym.checks import TINY, array, number, refusing_unknown
from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number, Vector
from springgym.core.language.lanes import sqrt
from springgym.core.language.memory import load
from springgym.core.language.vectors import dot, row, unit
from springgym.model.surfaces.surface import Surface, points


class Bowls(NamedTuple):
    """The bowls of a scene, for compiled code."""

    centre: np.ndarray
    """(bowls, 3) centre of each bowl [m]"""
    radius: np.ndarray
    """(bowls,) radius of each bowl [m]"""

    @staticmethod
    @compiled
    def height(place: Vector, k: int, own: Bowls) -> Number:
        arm = place - row(own.centre, k)
        return load(own.radius, k) - sqrt(dot(arm, arm))

    @staticmethod
    @compiled
    def gradient(place: Vector, k: int, own: Bowls) -> Vector:
        return unit(row(own.centre, k) - place)


@refusing_unknown
@dataclass(frozen=True)
class Bowl(Surface):
    """The inside of a sphere. Its lower part is a spherical bowl."""

    centre: tuple[float, float, float]
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", tuple(array("centre of a bowl", self.centre, (3,)).tolist()))
        object.__setattr__(self, "radius", number("radius of a bowl", self.radius, low=TINY))

    def height(self, positions: np.ndarray) -> np.ndarray:
        """Return the heights [m] (…) of positions (…, 3): negative outside the sphere."""
        return self.radius - np.linalg.norm(points(positions) - np.asarray(self.centre), axis=-1)

    @classmethod
    def packed(cls, surfaces: Sequence[Self]) -> Bowls:
        return Bowls(
            np.array([bowl.centre for bowl in surfaces]), np.array([bowl.radius for bowl in surfaces])
        )

    # --- Drawing: the part of the sphere that is near its lowest point ---------------------------------

    def _rim(self, extent: float) -> float:
        """Return the polar angle [rad] from the lowest point up to which the sphere is drawn."""
        return min(1.25, 0.75 * extent / self.radius)

    def net(self, middle: np.ndarray, extent: float) -> np.ndarray:
        polar = np.linspace(0.0, self._rim(extent), 33)[:, None]
        around = np.linspace(0.0, 2 * np.pi, 145)
        flat = np.sin(polar)
        down = np.broadcast_to(-np.cos(polar), (33, 145))
        outwards = np.stack([flat * np.cos(around), flat * np.sin(around), down], axis=-1)
        return np.asarray(self.centre) + self.radius * outwards

    def fade(self, points: np.ndarray, middle: np.ndarray, extent: float) -> np.ndarray:
        polar = np.arccos(np.clip((self.centre - points)[..., 2] / self.radius, -1.0, 1.0))
        return np.asarray(np.maximum(1.0 - (polar / self._rim(extent)) ** 3, 0.0))

    def hit(self, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        offset = start - np.asarray(self.centre)
        along = (offset * direction).sum(-1)
        with np.errstate(invalid="ignore"):
            root = np.sqrt(along**2 - (offset**2).sum(-1) + self.radius**2)
        met = start + direction * (root - along)[..., None]
        return met, (self.centre - met) / self.radius
