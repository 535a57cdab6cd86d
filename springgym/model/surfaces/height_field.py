"""Uneven ground z = f(x, y): height (z − f)/√(1 + |∇f|²).

f is the natural bicubic spline through heights on a grid (de Boor, J. Math. Phys. 41 (1962) 212): a sum of
products of B-splines, with two continuous derivatives everywhere. Beyond the grid it continues with the slope
at its edge. Its error is of fourth order in the spacing if f has no curvature at the edges of the grid.

The height is 0 on the ground. At a distance d from ground of curvature κ and slope tan θ, it differs from d
by κ d² tan² θ/2. In contact, where d < Δ, the relative difference is at most κ Δ tan² θ/2. Forces follow the
gradient of the height, so they conserve energy in spite of this difference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from springgym.checks import TINY, array, number, refusing_unknown, whole
from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number, Vector
from springgym.core.language.lanes import maximum, minimum, rounded, sqrt
from springgym.core.language.memory import load, load_each
from springgym.core.language.vectors import row, vec
from springgym.model.identity import digest
from springgym.model.surfaces.surface import Surface, points

MOST = 1_000_000
"""Largest number of heights of all fields of a scene: indices up to here are exact in single precision."""


class HeightFields(NamedTuple):
    """The height fields of a scene, for compiled code."""

    corner: np.ndarray
    """(fields, 3) position of the first corner of the grid, with z = 0 [m]"""
    density: np.ndarray
    """(fields,) cells of the grid per metre [1/m]"""
    cells: np.ndarray
    """(fields, 2) number of cells along x and along y"""
    first: np.ndarray
    """(fields,) index of the first coefficient of the field"""
    coefficients: np.ndarray
    """coefficients of the B-splines of all fields [m]: (cells along x + 3)(cells along y + 3) of each, row by
    row"""

    @staticmethod
    @compiled
    def height(place: Vector, k: int, own: HeightFields) -> Number:
        u, v = grid_splines(place, k, own)
        f, along_x, along_y, _, _, _ = ground(u, v, k, own)
        return (place[2] - f) / sqrt(1.0 + (along_x * along_x + along_y * along_y))

    @staticmethod
    @compiled
    def gradient(place: Vector, k: int, own: HeightFields) -> Vector:
        u, v = grid_splines(place, k, own)
        f, x, y, xx, xy, yy = ground(u, v, k, own)
        inverse = 1.0 / sqrt(1.0 + (x * x + y * y))
        share = (place[2] - f) * inverse * inverse
        bent = vec(-x - share * (x * xx + y * xy), -y - share * (x * xy + y * yy), 1.0)
        return inverse * bent


@compiled
def grid_splines(place: Vector, k: int, own: HeightFields) -> Any:
    """Return `splines` along x and along y, for a point above field ``k``."""
    density = load(own.density, k)
    corner = row(own.corner, k)
    along_x = splines(density * (place[0] - corner[0]), load(own.cells, (k, 0)), density)
    return along_x, splines(density * (place[1] - corner[1]), load(own.cells, (k, 1)), density)


@compiled
def splines(t: Number, cells: Number, density: Number) -> Any:
    """Return the cell of a grid that ``t`` is in, and four B-splines there, their slopes and bends.

    Beyond the grid they continue linearly.
    """
    held = minimum(maximum(t, 0.0), cells)
    cell = maximum(minimum(rounded(held - 0.5), cells - 1.0), 0.0)
    s = held - cell
    beyond = t - held
    rest = 1.0 - s
    bends = (rest, 3.0 * s - 2.0, 1.0 - 3.0 * s, s)
    slopes = (-0.5 * rest * rest, (1.5 * s - 2.0) * s, (1.0 - 1.5 * s) * s + 0.5, 0.5 * s * s)
    sixth = 1.0 / 6.0
    values = (
        sixth * rest * rest * rest + beyond * slopes[0],
        (0.5 * s - 1.0) * s * s + 4.0 * sixth + beyond * slopes[1],
        ((0.5 - 0.5 * s) * s + 0.5) * s + sixth + beyond * slopes[2],
        sixth * s * s * s + beyond * slopes[3],
    )
    return cell, values, scaled(density, slopes), scaled(density * density, bends)


@compiled
def scaled(scale: Number, w: Any) -> Any:
    """Return four numbers times ``scale``."""
    return scale * w[0], scale * w[1], scale * w[2], scale * w[3]


@compiled
def product(w: Any, c: Any) -> Any:
    """Return Σ w c of four numbers."""
    return w[0] * c[0] + w[1] * c[1] + (w[2] * c[2] + w[3] * c[3])


@compiled
def products(w: Any, rows: Any) -> Any:
    """Return Σ w c of each of four rows c."""
    return product(w, rows[0]), product(w, rows[1]), product(w, rows[2]), product(w, rows[3])


@compiled
def four(first: Number, own: HeightFields) -> Any:
    """Return four consecutive coefficients."""
    c = own.coefficients
    return (
        load_each(c, first),
        load_each(c, first + 1.0),
        load_each(c, first + 2.0),
        load_each(c, first + 3.0),
    )


@compiled
def ground(along_x: Any, along_y: Any, k: int, own: HeightFields) -> Any:
    """Return f [m], and its derivatives by x, y, xx, xy and yy."""
    row_of, value, slope, bend = along_x
    column, across, slope_across, bend_across = along_y
    length = load(own.cells, (k, 1)) + 3.0
    first = load(own.first, k) + row_of * length + column
    low = four(first, own), four(first + length, own)
    rows = (*low, four(first + 2.0 * length, own), four(first + 3.0 * length, own))
    f = products(across, rows)
    y = products(slope_across, rows)
    yy = products(bend_across, rows)
    return (
        product(value, f),
        product(slope, f),
        product(value, y),
        product(bend, f),
        product(slope, y),
        product(value, yy),
    )


@refusing_unknown
@dataclass(frozen=True, repr=False)
class HeightField(Surface):
    """Uneven ground z = f(x, y): a smooth surface through heights on a grid of square cells.

    Bodies are above it.

    Parameters
    ----------
    heights : (m, n)
        f [m], with a row for each x and a column for each y.
    spacing
        Distance between neighbours of the grid [m].
    corner
        x and y [m] of the first height.
    """

    heights: Sequence[Sequence[float]]
    spacing: float
    corner: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        given = array("heights of a height field", self.heights, (None, None))
        for axis, count in enumerate(given.shape):
            whole(f"number of heights along {'xy'[axis]}", count, low=2)
        whole("number of heights of a height field", given.size, high=MOST)
        object.__setattr__(self, "heights", tuple(map(tuple, given.tolist())))
        object.__setattr__(self, "spacing", number("spacing of a height field", self.spacing, low=TINY))
        object.__setattr__(
            self, "corner", tuple(array("corner of a height field", self.corner, (2,)).tolist())
        )

    def __repr__(self) -> str:
        size = f"{len(self.heights)} × {len(self.heights[0])} heights {digest(np.array(self.heights))}"
        return f"HeightField({size}, spacing={self.spacing}, corner={self.corner})"

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Return the coefficients of the B-splines [m], (m + 2, n + 2)."""
        return _coefficients(_coefficients(np.array(self.heights)).T).T

    @property
    def _cells(self) -> np.ndarray:
        return np.array([len(self.heights) - 1, len(self.heights[0]) - 1])

    def height(self, positions: np.ndarray) -> np.ndarray:
        """Return the heights [m] (…) of positions (…, 3): negative below the ground."""
        places = points(positions)
        ground, slopes = self._ground(places[..., :2])
        return np.asarray((places[..., 2] - ground) / np.sqrt(1.0 + (slopes**2).sum(-1)))

    def _ground(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return f (…) and ∇f (…, 2) at places (…, 2)."""
        t = (places - self.corner) / self.spacing
        held = np.clip(t, 0.0, self._cells)
        cell = np.minimum(held.astype(int), self._cells - 1)
        s = held - cell
        beyond = t - held
        slopes = np.stack([-0.5 * (1 - s) ** 2, 1.5 * s**2 - 2 * s, 0.5 + s - 1.5 * s**2, 0.5 * s**2])
        values = np.stack([(1 - s) ** 3, 3 * s**3 - 6 * s**2 + 4, 1 + 3 * (s + s**2 - s**3), s**3]) / 6
        values = values + beyond * slopes
        offset = np.arange(4).reshape(4, *[1] * (cell.ndim - 1))
        rows = cell[..., 0] + offset
        columns = cell[..., 1] + offset
        c = self.coefficients[rows[:, None], columns[None]]
        f, x, y = (
            np.einsum("i...,j...,ij...", u[..., 0], v[..., 1], c)
            for u, v in ((values, values), (slopes, values), (values, slopes))
        )
        return f, np.stack([x, y], axis=-1) / self.spacing

    @classmethod
    def packed(cls, surfaces: Sequence[Self]) -> HeightFields:
        total = sum(len(field.heights) * len(field.heights[0]) for field in surfaces)
        whole("number of heights of all fields of a scene", total, high=MOST)
        sizes = [field.coefficients.size for field in surfaces]
        return HeightFields(
            corner=np.array([(*field.corner, 0.0) for field in surfaces]),
            density=np.array([1.0 / field.spacing for field in surfaces]),
            cells=np.array([field._cells for field in surfaces], float),
            first=np.cumsum([0, *sizes[:-1]]).astype(float),
            coefficients=np.concatenate([field.coefficients.ravel() for field in surfaces]),
        )

    # --- Drawing: the part of the grid around what happens ---------------------------------------------

    def net(self, middle: np.ndarray, extent: float) -> np.ndarray:
        low = np.array(self.corner)
        high = low + self._cells * self.spacing
        first = np.clip(middle[:2] - 1.5 * extent, low, high)
        last = np.clip(middle[:2] + 1.5 * extent, low, high)
        axes = (np.linspace(first[n], last[n], count) for n, count in enumerate((97, 145)))
        flat = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        return np.concatenate([flat, self._ground(flat)[0][..., None]], axis=-1)


def _coefficients(values: np.ndarray) -> np.ndarray:
    """Return the coefficients (m + 2, n) of natural cubic splines along the first axis of ``values`` (m, n).

    (c₋ + 4 c + c₊)/6 is the value at a node. The curvature is zero at the ends, so c is the value there.
    """
    inner = 6.0 * values[1:-1]
    if len(inner):
        inner[0] -= values[0]
        inner[-1] -= values[-1]
    pivot = np.full(len(inner), 4.0)
    for i in range(1, len(inner)):
        pivot[i] -= 1.0 / pivot[i - 1]
        inner[i] -= inner[i - 1] / pivot[i - 1]
    for i in reversed(range(len(inner))):
        inner[i] = (inner[i] - (inner[i + 1] if i + 1 < len(inner) else 0.0)) / pivot[i]
    c = np.concatenate([values[:1], inner, values[-1:]])
    return np.concatenate([2.0 * c[:1] - c[1:2], c, 2.0 * c[-1:] - c[-2:-1]])


@refusing_unknown
def waves(amplitude: float, length: float, size: float, spacing: float, level: float = 0.0) -> HeightField:
    """Return ground with waves along x, f = z₀ + a cos(2π x/λ), on a square around the origin.

    Parameters
    ----------
    amplitude, length
        a and λ [m]
    size
        Distance from the origin to each edge [m]. It is rounded up to the next place where a wave crosses the
        level.
    spacing
        Distance between heights [m], at most λ/8.
    level
        z₀ [m]
    """
    amplitude = number("amplitude", amplitude)
    level = number("level", level)
    length = number("length", length, low=TINY)
    size = number("size", size, low=TINY)
    spacing = number("spacing", spacing, low=TINY, high=length / 8)
    edge = (math.ceil(2 * size / length - 0.5) + 0.5) * length / 2
    count = math.ceil(edge / spacing)
    whole("number of heights by size and spacing", (2 * count + 1) ** 2, high=MOST)
    x = np.linspace(-edge, edge, 2 * count + 1)
    row = level + amplitude * np.cos(2 * math.pi * x / length)
    return HeightField(
        np.repeat(row[:, None], len(x), axis=1),  # type: ignore[arg-type]
        edge / count,
        (-edge, -edge),
    )
