"""Whether bodies start in each other: no vertex inside, no edge through a face, none nearer than 1e-3 Δ."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from springgym.bodies import surface
from springgym.collisions import distance
from springgym.collisions.shape import Shape
from springgym.surfaces import NEAREST

CHUNK = 100_000
"""Pairs of features looked at in one go: some 50 MB of numbers."""


def check_apart(
    shapes: tuple[Shape, Shape],
    names: tuple[str, str],
    reach: float,
    positions: tuple[np.ndarray, np.ndarray],
    copies: Any = None,
) -> None:
    """Refuse bodies that start in each other, or too near.

    Parameters
    ----------
    shapes, names
        Of both bodies.
    reach
        Δ of their contact [m].
    positions : (N, 3) or (k, N, 3)
        Of each body's particles [m].
    copies : (k,), optional
        What the copies are called.

    Raises
    ------
    ValueError
        Naming the bodies, the copy if there are several, how deep they are in each other, and where.
    """
    first, second = (x.reshape(-1, *x.shape[-2:]) for x in positions)
    least = NEAREST * reach
    margin = least + shapes[0].radius + shapes[1].radius
    low = np.maximum(first.min(axis=1), second.min(axis=1))
    high = np.minimum(first.max(axis=1), second.max(axis=1))
    near = np.flatnonzero((low <= high + margin).all(axis=1))
    rows = max(1, CHUNK // (_features(shapes[0]) * _features(shapes[1])))
    for start in range(0, len(near), rows):
        some = near[start : start + rows]
        kinds = list(_distances(shapes, names, first[some], second[some]))
        nearest = np.stack([apart.min(axis=1) for _, apart in kinds])
        wrong = np.flatnonzero(~(nearest.min(axis=0) >= least))
        if len(wrong):
            row = int(wrong[0])
            each = nearest[:, row]  # of an edge through a face, no more than that is known: it comes last
            kind = each[:-1].argmin() if each[:-1].min() < 0 else each.argmin()
            called, apart = kinds[int(kind)]
            d, copy = float(apart[row].min()), some[row]
            of = f" in copy {copies[copy]}" if positions[0].ndim == 3 and copies is not None else ""
            where = f"{-d:g} m deep in each other" if d < 0 else f"only {abs(d):g} m apart"
            raise ValueError(
                f"bodies {names[0]!r} and {names[1]!r} start {where}{of}, by "
                f"{called[int(apart[row].argmin())]}; they must be at least {least:g} m apart, and are "
                f"free of each other from {reach:g} m. Move one, or say collisions=None to let bodies pass "
                "through each other"
            )


def _features(shape: Shape) -> int:
    return len(shape.vertices) + len(shape.triangles) + len(_lines(shape))


def _lines(shape: Shape) -> np.ndarray:
    """All edges (E, 2): of a closed surface the flat ones, too."""
    return surface.all_edges(shape.triangles) if len(shape.triangles) else shape.edges


def _distances(
    shapes: tuple[Shape, Shape], names: tuple[str, str], first: np.ndarray, second: np.ndarray
) -> Iterator[tuple[list[str], np.ndarray]]:
    """What features are called, and their distances (k, F) from the other body [m], less the radii."""
    radius = shapes[0].radius + shapes[1].radius
    positions = (first, second)
    called: list[str] = []
    pierced: list[np.ndarray] = [np.full((len(first), 1), np.inf)]
    for own, other in ((0, 1), (1, 0)):
        mine, theirs, x, y = shapes[own], shapes[other], positions[own], positions[other]
        points = x[:, mine.vertices]
        particles = [f"particle {n} of {names[own]!r}" for n in mine.vertices.tolist()]
        if len(theirs.triangles):
            faces, lines = y[:, theirs.triangles], _lines(mine)
            yield particles, distance.point_surface(points, faces) - radius
            called += _called(lines, names[own])
            depth = distance.pierced(x[:, lines], faces).max(axis=2)
            pierced.append(np.where(depth > 0, -depth - radius, np.inf))
        elif len(theirs.edges):
            yield particles, distance.point_segment(points, y[:, theirs.edges]).min(axis=2) - radius
        elif not len(mine.triangles) and not len(mine.edges):
            apart = np.linalg.norm(points[:, :, None] - y[:, None, theirs.vertices], axis=-1)
            yield particles, apart.min(axis=2) - radius
    lines, others = _lines(shapes[0]), _lines(shapes[1])
    if len(lines) and len(others):
        between = distance.segment_segment(first[:, lines], second[:, others]).min(axis=2)
        yield _called(lines, names[0]), between - radius
    yield ["", *called], np.concatenate(pierced, axis=1)


def _called(lines: np.ndarray, name: str) -> list[str]:
    return [f"the edge {i}–{j} of {name!r}" for i, j in lines.tolist()]
