"""Check that bodies start apart: no vertex inside, no edge through a face, no gap below 1e-3 Δ.

Bodies whose boxes overlap, and which no face's plane separates, are compared feature by feature.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from springgym.checks import apart
from springgym.model.collisions import distance
from springgym.model.collisions.meeting import Meetings
from springgym.model.collisions.shape import Shape
from springgym.model.surfaces import NEAREST

CHUNK = 100_000
"""Number of pairs of features that are processed at once: some 50 MB of numbers."""

BOXES = 1_000_000
"""Number of pairs of boxes that are processed at once: some 100 MB of numbers."""

BEYOND_ROUNDING = 1.001
"""Factor by which a search goes farther than needed, so that rounding has no effect."""


class Found(NamedTuple):
    """Distances of features of one kind from the other body."""

    own: int
    """0 if they are the first body's, 1 if the second's"""
    members: np.ndarray
    """(F, 1) or (F, 2) their particles"""
    apart: np.ndarray
    """(k, F) distances of the features from the other body, less the radii [m]"""
    through: bool = False
    """whether these are only the depths of edges through faces"""


def check_apart(
    shapes: Sequence[Shape],
    names: Sequence[str],
    starts: np.ndarray,
    met: Meetings,
    positions: np.ndarray,
    copies: Any = None,
) -> None:
    """Raise ValueError if bodies overlap at the start, or are too near.

    Parameters
    ----------
    shapes, names : (bodies,)
        Of all bodies; a shape may be shared.
    starts : (bodies + 1,)
        Where each body's particles begin among all, and the end.
    met
        The pairs that must be apart.
    positions : (N, 3) or (k, N, 3)
        Of all particles [m].
    copies : (k,), optional
        The numbers of the copies, for error messages.

    Raises
    ------
    ValueError
        The message names the first such pair of bodies, the copy if there are several, their gap or depth,
        and the place.
    """
    if not len(met):
        return
    x = positions.reshape(-1, *positions.shape[-2:])
    reaches = np.zeros(len(shapes))
    for of in (met.first, met.second):
        np.maximum.at(reaches, of, met.reach)
    wide = (BEYOND_ROUNDING * (np.array([shape.radius for shape in shapes]) + 0.5 * NEAREST * reaches))[
        :, None
    ]
    low = np.minimum.reduceat(x, starts[:-1], axis=1) - wide
    high = np.maximum.reduceat(x, starts[:-1], axis=1) + wide
    pair, copy = overlapping(met, low, high)
    first = met.first[pair]
    second = met.second[pair]
    least = NEAREST * met.reach[pair]
    late = ~(_nearest(shapes, starts, x, copy, (first, second), least) >= least)
    wrong = int(late.argmax()) if late.any() else len(pair)
    if wrong < len(pair):
        row = slice(wrong, wrong + 1)
        bodies = (int(first[wrong]), int(second[wrong]))
        where = f" in copy {copies[copy[wrong]]}" if positions.ndim == 3 and copies is not None else ""
        distances = _distances(
            (shapes[bodies[0]], shapes[bodies[1]]),
            *(_of_bodies(x, copy[row], starts, np.array([body])) for body in bodies),
        )
        _refuse(list(distances), (names[bodies[0]], names[bodies[1]]), float(met.reach[pair[wrong]]), where)


def _nearest(
    shapes: Sequence[Shape],
    starts: np.ndarray,
    x: np.ndarray,
    copy: np.ndarray,
    bodies: tuple[np.ndarray, np.ndarray],
    least: np.ndarray,
) -> np.ndarray:
    """Return the gaps (n,) [m] of pairs of ``bodies`` (n,) in copies (n,), of particles (k, N, 3).

    A gap may be too small where the result is at least ``least`` (n,).
    """
    first, second = bodies
    each = {id(shape): n for n, shape in enumerate(shapes)}
    kind = np.array([each[id(shape)] for shape in shapes])
    kinds = kind[first] * len(shapes) + kind[second]
    nearest = np.empty(len(copy))
    for one in np.unique(kinds):
        alike = np.flatnonzero(kinds == one)
        both = (shapes[first[alike[0]]], shapes[second[alike[0]]])
        chunk = max(1, CHUNK // (_features(both[0]) * _features(both[1])))
        for start in range(0, len(alike), chunk):
            some = alike[start : start + chunk]
            pairs = [_of_bodies(x, copy[some], starts, of[some]) for of in bodies]
            nearest[some] = gaps = separation(both, *pairs)
            if (close := ~(gaps >= least[some])).any():
                distances = _distances(both, *(of[close] for of in pairs))
                nearest[some[close]] = np.min([own.apart.min(axis=1) for own in distances], axis=0)
    return nearest


def separation(shapes: tuple[Shape, Shape], first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the distances (k,) [m] by which faces' planes separate two bodies, of particles (k, N, 3) each.

    They are lower bounds of the gaps, and −∞ without faces.
    """
    widest = np.full(len(first), -np.inf)
    for own, other, x, y in ((*shapes, first, second), (*shapes[::-1], second, first)):
        if len(own.triangles):
            a, b, c = np.moveaxis(x[:, own.triangles], 2, 0)
            normal = np.cross(b - a, c - a)
            normal /= np.linalg.norm(normal, axis=-1, keepdims=True) + distance.SMALL
            beyond = (normal @ y[:, other.vertices].swapaxes(1, 2)).min(axis=2)
            within = (normal @ x[:, own.vertices].swapaxes(1, 2)).max(axis=2)
            widest = np.maximum(widest, (beyond - within).max(axis=1))
    return widest - shapes[0].radius - shapes[1].radius


def overlapping(met: Meetings, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the pairs (n,) of bodies whose boxes (k, bodies, 3) overlap, and the copies in which they do."""
    found = []
    chunk = max(1, BOXES // len(met))
    for start in range(0, len(low), chunk):
        begins = low[start : start + chunk]
        ends = high[start : start + chunk]
        apart = (begins[:, met.first] > ends[:, met.second]) | (begins[:, met.second] > ends[:, met.first])
        copy, pair = np.nonzero(~apart.any(axis=2))
        found.append((pair, copy + start))
    pair, copy = np.concatenate(found, axis=1)
    order = np.lexsort((copy, pair))
    return pair[order], copy[order]


def _of_bodies(x: np.ndarray, copy: np.ndarray, starts: np.ndarray, bodies: np.ndarray) -> np.ndarray:
    """Return the particles (k, N, 3) of bodies (k,) of equal shapes in copies (k,) [m]."""
    count = starts[bodies[0] + 1] - starts[bodies[0]]
    return x[copy[:, None], starts[bodies][:, None] + np.arange(count)]


def _refuse(found: list[Found], names: tuple[str, str], reach: float, of: str) -> None:
    """Raise a ValueError that says where two bodies overlap, or are too near."""
    others = [each for each in found if not each.through]
    deep = min(float(each.apart.min()) for each in others) < 0
    kind = min(others if deep else found, key=lambda each: float(each.apart.min()))
    d = float(kind.apart.min())
    feature = kind.members[int(kind.apart[0].argmin())].tolist()
    distance, least = apart(abs(d), NEAREST * reach)
    where = f"{distance} m deep in each other" if d < 0 else f"only {distance} m apart"
    what = f"{'particle' if len(feature) == 1 else 'the edge'} {'–'.join(map(str, feature))}"
    raise ValueError(
        f"bodies {names[0]!r} and {names[1]!r} start {where}{of}, by "
        f"{what} of {names[kind.own]!r}; "
        f"they must be at least {least} m apart; their contact ends at {reach:g} m. "
        "Move one, or say collisions=None to let bodies pass through each other"
    )


def _features(shape: Shape) -> int:
    return len(shape.vertices) + len(shape.triangles) + len(shape.lines)


def _distances(shapes: tuple[Shape, Shape], first: np.ndarray, second: np.ndarray) -> Iterator[Found]:
    """Yield the distances of features from the other body, by kind."""
    radius = shapes[0].radius + shapes[1].radius
    positions = (first, second)
    for own, other in ((0, 1), (1, 0)):
        mine = shapes[own]
        theirs = shapes[other]
        x = positions[own]
        y = positions[other]
        points = x[:, mine.vertices]
        particles = mine.vertices[:, None]
        if len(theirs.triangles):
            faces = y[:, theirs.triangles]
            yield Found(own, particles, distance.point_surface(points, faces) - radius)
            if len(mine.lines):
                depth = distance.pierced(x[:, mine.lines], faces).max(axis=2)
                yield Found(own, mine.lines, np.where(depth > 0, -depth - radius, np.inf), through=True)
        elif len(theirs.edges):
            apart = distance.point_segment(points, y[:, theirs.edges]).min(axis=2)
            yield Found(own, particles, apart - radius)
        elif not len(mine.triangles) and not len(mine.edges):
            apart = np.linalg.norm(points[:, :, None] - y[:, None, theirs.vertices], axis=-1)
            yield Found(own, particles, apart.min(axis=2) - radius)
    lines = shapes[0].lines
    others = shapes[1].lines
    if len(lines) and len(others):
        between = distance.segment_segment(first[:, lines], second[:, others]).min(axis=2)
        yield Found(0, lines, between - radius)
