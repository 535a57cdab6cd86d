"""The inside of a round pipe: height R − |d|, the distance, with d the vector from the axis to a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from springgym.checks import TINY, array, direction, number, refusing_unknown
from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number, Vector
from springgym.core.language.lanes import sqrt
from springgym.core.language.memory import load
from springgym.core.language.vectors import dot, plus_scaled, row, unit
from springgym.model.surfaces.surface import Surface, points


class Pipes(NamedTuple):
    """The pipes of a scene, for compiled code."""

    point: np.ndarray
    """(pipes, 3) a point of the axis [m]"""
    axis: np.ndarray
    """(pipes, 3) unit vectors of the axis"""
    radius: np.ndarray
    """(pipes,) radius of each pipe [m]"""

    @staticmethod
    @compiled
    def height(place: Vector, k: int, own: Pipes) -> Number:
        arm = off_axis(place, k, own)
        return load(own.radius, k) - sqrt(dot(arm, arm))

    @staticmethod
    @compiled
    def gradient(place: Vector, k: int, own: Pipes) -> Vector:
        return unit(-off_axis(place, k, own))


@compiled
def off_axis(place: Vector, k: int, own: Pipes) -> Any:
    """Return d [m], the vector from the axis of pipe ``k`` to a point."""
    arm = place - row(own.point, k)
    return plus_scaled(arm, -1.0 * dot(arm, row(own.axis, k)), row(own.axis, k))


@refusing_unknown
@dataclass(frozen=True)
class Pipe(Surface):
    """The inside of a round pipe without ends, around an axis through a point. Its lower part is a gutter.

    An axis vector of any length is normalised.
    """

    point: tuple[float, float, float]
    axis: tuple[float, float, float]
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", tuple(array("point of a pipe", self.point, (3,)).tolist()))
        object.__setattr__(self, "axis", tuple(direction("axis of a pipe", self.axis).tolist()))
        object.__setattr__(self, "radius", number("radius of a pipe", self.radius, low=TINY))

    def _off_axis(self, positions: np.ndarray) -> np.ndarray:
        arm = positions - np.asarray(self.point)
        axis = np.asarray(self.axis)
        return np.asarray(arm - (arm @ axis)[..., None] * axis)

    def height(self, positions: np.ndarray) -> np.ndarray:
        """Return the heights [m] (…) of positions (…, 3): negative outside the pipe."""
        return self.radius - np.linalg.norm(self._off_axis(points(positions)), axis=-1)

    @classmethod
    def packed(cls, surfaces: Sequence[Self]) -> Pipes:
        each = zip(*((pipe.point, pipe.axis, pipe.radius) for pipe in surfaces), strict=True)
        return Pipes(*map(np.array, each))

    # --- Drawing: the lower half of the pipe, or one half of a pipe that stands -------------------------

    def net(self, middle: np.ndarray, extent: float) -> np.ndarray:
        axis = np.asarray(self.axis)
        down = np.array([0.0, 0.0, -1.0]) if abs(axis[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
        down = down - (down @ axis) * axis
        down /= np.linalg.norm(down)
        foot = np.asarray(self.point) + axis * float((middle - self.point) @ axis)
        along = np.linspace(-1.5 * extent, 1.5 * extent, 33)[:, None, None]
        around = np.linspace(-np.pi / 2, np.pi / 2, 145)[:, None]
        outwards = np.cos(around) * down + np.sin(around) * np.cross(axis, down)
        return np.asarray(foot + along * axis + self.radius * outwards)

    def hit(self, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        axis = np.asarray(self.axis)
        offset = self._off_axis(start)
        across = direction - (direction @ axis)[..., None] * axis
        square = (across**2).sum(-1)
        along = (offset * across).sum(-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(along**2 - square * ((offset**2).sum(-1) - self.radius**2))
            met = start + direction * ((root - along) / square)[..., None]
        return met, -self._off_axis(met) / self.radius
