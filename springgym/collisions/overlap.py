"""Check that bodies start apart: no vertex inside, no edge through a face, none nearer than 1e-3 Δ.

Boxes around the bodies are sorted by where they begin along an axis: only those that begin before another
ends can overlap it (sweep and prune: Cohen et al. 1995, doi:10.1145/199404.199437). Bodies whose boxes
overlap are compared feature by feature; ellipsoids by `springgym.core.ellipsoids`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from springgym.collisions import distance
from springgym.collisions.meeting import Meetings
from springgym.collisions.shape import Shape
from springgym.core.ellipsoids import ELLIPSOID, POINT, SEGMENT, TRIANGLE, gaps
from springgym.surfaces import NEAREST

CHUNK = 100_000
"""Pairs of features looked at in one go: some 50 MB of numbers."""

BOXES = 1_000_000
"""Pairs of boxes looked at in one go: some 100 MB of numbers."""

ROUNDING = 1.001
"""Boxes are grown a little more than must be: rounding decides nothing."""


Ellipsoids: TypeAlias = Mapping[int, np.ndarray]
"""The rows that `springgym.collisions.shape.place_ellipsoids` returns, by the numbers of their bodies."""


class Found(NamedTuple):
    """Distances of features of one kind from the other body."""

    own: int
    """0 if they are the first body's, 1 if the second's"""
    members: np.ndarray
    """(F, 1) or (F, 2) their particles; (1, 0) of an ellipsoid"""
    apart: np.ndarray
    """(k, F) [m], less the radii"""
    through: bool = False
    """whether it says only how deep edges are through faces"""


def check_apart(
    shapes: Sequence[Shape],
    names: Sequence[str],
    starts: np.ndarray,
    met: Meetings,
    positions: np.ndarray,
    ellipsoids: Ellipsoids,
    copies: Any = None,
) -> None:
    """Refuse bodies that start in each other, or too near.

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
    ellipsoids
        Where the ellipsoids are.
    copies : (k,), optional
        What the copies are called.

    Raises
    ------
    ValueError
        Naming the first pair of bodies that is wrong, the copy if there are several, how deep they are in
        each other, and where.
    """
    if not len(met):
        return
    x = positions.reshape(-1, *positions.shape[-2:])
    reaches = np.zeros(len(shapes))
    for of in (met.first, met.second):
        np.maximum.at(reaches, of, met.reach)
    wide = (ROUNDING * (np.array([shape.radius for shape in shapes]) + 0.5 * NEAREST * reaches))[:, None]
    low = np.minimum.reduceat(x, starts[:-1], axis=1) - wide
    high = np.maximum.reduceat(x, starts[:-1], axis=1) + wide
    copy, first, second = overlapping(low, high)
    pair = met.numbers(first, second)
    rows = np.flatnonzero(pair >= 0)
    rows = rows[np.lexsort((copy[rows], pair[rows]))]
    copy, first, second, pair = copy[rows], first[rows], second[rows], pair[rows]
    nearest = _nearest(shapes, starts, x, ellipsoids, copy, (first, second))
    late = ~(nearest >= NEAREST * met.reach[pair])
    wrong = int(late.argmax()) if late.any() else len(pair)
    if wrong < len(pair):
        row = slice(wrong, wrong + 1)
        bodies = (int(first[wrong]), int(second[wrong]))
        where = f" in copy {copies[copy[wrong]]}" if positions.ndim == 3 and copies is not None else ""
        found = _distances(
            (shapes[bodies[0]], shapes[bodies[1]]),
            *(_of_bodies(x, copy[row], starts, np.array([body]), ellipsoids) for body in bodies),
        )
        _refuse(list(found), (names[bodies[0]], names[bodies[1]]), float(met.reach[pair[wrong]]), where)


def _nearest(
    shapes: Sequence[Shape],
    starts: np.ndarray,
    x: np.ndarray,
    ellipsoids: Ellipsoids,
    copy: np.ndarray,
    bodies: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """Return how near two ``bodies`` (n,) each are in copies (n,), of particles (k, N, 3) [m]."""
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
            pairs = [_of_bodies(x, copy[some], starts, of[some], ellipsoids) for of in bodies]
            nearest[some] = np.min([found.apart.min(axis=1) for found in _distances(both, *pairs)], axis=0)
    return nearest


def overlapping(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find which boxes (k, bodies, 3) overlap: their copies, and their bodies, the smaller number first."""
    swept = min((_begun(low[..., axis], high[..., axis]) for axis in range(3)), key=lambda of: of[2].sum())
    ordered, place, count = swept
    bodies, begins, ends = low.shape[1], low.reshape(-1, 3), high.reshape(-1, 3)
    all_before = np.cumsum(count)
    ends_of_chunks = np.searchsorted(all_before, np.arange(BOXES, all_before[-1], BOXES))
    found = []
    for start, behind in pairwise([0, *np.unique(ends_of_chunks).tolist(), len(count)]):
        several = count[start:behind]
        one = np.repeat(np.arange(start, behind), several)
        turn = np.arange(len(one)) - np.repeat(np.cumsum(several) - several, several)
        other = ordered[place[one] + 1 + turn]
        meet = ((begins[one] <= ends[other]) & (begins[other] <= ends[one])).all(axis=1)
        found.append(np.sort([one[meet], other[meet]], axis=0))
    one, other = np.concatenate(found, axis=1)
    return one // bodies, one % bodies, other % bodies


def _begun(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Order intervals (k, bodies) of each copy by where they begin.

    The intervals in this order, numbered through all copies; the place of each; and how many of the next ones
    begin before it ends.
    """
    count = low.size
    copy = np.repeat(np.arange(len(low)), low.shape[1])
    ends = np.arange(2 * count) >= count
    order = np.lexsort((ends, np.concatenate([low.ravel(), high.ravel()]), np.tile(copy, 2)))
    begun = np.empty(2 * count, int)
    begun[order] = np.cumsum(~ends[order])
    place = begun[:count] - 1
    ordered = np.empty(count, int)
    ordered[place] = np.arange(count)
    return ordered, place, begun[count:] - begun[:count]


class _Bodies(NamedTuple):
    """The bodies on one side of some pairs, which have equal shapes."""

    x: np.ndarray
    """(k, N, 3) their particles [m]"""
    ellipsoids: np.ndarray | None
    """(k, 5, 3) the rows of their ellipsoids; None if they are none"""


def _of_bodies(
    x: np.ndarray, copy: np.ndarray, starts: np.ndarray, bodies: np.ndarray, ellipsoids: Ellipsoids
) -> _Bodies:
    """Return bodies (k,) of equal shapes in copies (k,)."""
    count = starts[bodies[0] + 1] - starts[bodies[0]]
    own = None
    if bodies[0] in ellipsoids:
        each = [
            ellipsoids[body].reshape(-1, 5, 3)[one] for body, one in zip(bodies.tolist(), copy, strict=True)
        ]
        own = np.array(each)
    return _Bodies(x[copy[:, None], starts[bodies][:, None] + np.arange(count)], own)


def _refuse(found: list[Found], names: tuple[str, str], reach: float, of: str) -> None:
    """Raise an error that says where two bodies are in each other, or too near."""
    others = [each for each in found if not each.through]
    deep = min(float(each.apart.min()) for each in others) < 0
    kind = min(others if deep else found, key=lambda each: float(each.apart.min()))
    d, feature = float(kind.apart.min()), kind.members[int(kind.apart[0].argmin())].tolist()
    where = f"{-d:g} m deep in each other" if d < 0 else f"only {abs(d):g} m apart"
    what = ("the skin", "particle", "the edge")[len(feature)]
    what = f"{what} {'–'.join(map(str, feature))}".strip()
    raise ValueError(
        f"bodies {names[0]!r} and {names[1]!r} start {where}{of}, by "
        f"{what} of {names[kind.own]!r}; "
        f"they must be at least {NEAREST * reach:g} m apart; their contact ends at {reach:g} m. "
        "Move one, or say collisions=None to let bodies pass through each other"
    )


def _features(shape: Shape) -> int:
    return len(shape.vertices) + len(shape.triangles) + len(shape.lines)


def _distances(shapes: tuple[Shape, Shape], first: _Bodies, second: _Bodies) -> Iterator[Found]:
    """Find how far features are from the other body."""
    bodies = first, second
    if shapes[0].ellipsoid or shapes[1].ellipsoid:
        own = 0 if shapes[0].ellipsoid else 1
        apart = _from_ellipsoid(bodies[own].ellipsoids, bodies[1 - own], shapes[1 - own])
        yield Found(own, np.zeros((1, 0), int), apart[:, None])
    else:
        yield from _between_features(shapes, first.x, second.x)


def _from_ellipsoid(ellipsoids: Any, other: _Bodies, shape: Shape) -> np.ndarray:
    """Return how far ellipsoids (k, 5, 3) are from another body each, (k,) [m]; less than 0 in it."""
    x = other.x
    if shape.ellipsoid:
        return gaps(ELLIPSOID, ellipsoids, np.asarray(other.ellipsoids))[1][:, 0]
    if len(shape.triangles):
        faces, centre = x[:, shape.triangles], ellipsoids[:, :1]
        across = np.cross(faces[:, :, 1] - faces[:, :, 0], faces[:, :, 2] - faces[:, :, 0])
        behind = ((centre - faces[:, :, 0]) * across).sum(axis=-1) < 0
        faces = np.where(behind[..., None, None], faces[:, :, ::-1], faces)
        apart = _of_each(TRIANGLE, ellipsoids, faces)
        within = distance.point_surface(centre, x[:, shape.triangles])[:, 0]
        return np.where(within < 0, np.minimum(within, apart), apart)
    if len(shape.edges):
        return _of_each(SEGMENT, ellipsoids, x[:, shape.edges]) - shape.radius
    return _of_each(POINT, ellipsoids, x[:, shape.vertices, None]) - shape.radius


def _of_each(kind: int, ellipsoids: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return how far ellipsoids (k, 5, 3) are from the nearest of others (k, n, rows, 3) each, (k,) [m]."""
    count = others.shape[1]
    found = gaps(kind, np.repeat(ellipsoids, count, axis=0), others.reshape(-1, *others.shape[2:]))
    return found[1][:, 0].reshape(-1, count).min(axis=1)


def tell_ellipsoids(
    shapes: Sequence[Shape],
    starts: np.ndarray,
    met: tuple[np.ndarray, np.ndarray],
    positions: np.ndarray,
    ellipsoids: Ellipsoids,
    found: np.ndarray,
) -> bool:
    """Find which pairs of bodies ``met`` (pairs,), one of which is an ellipsoid, are in each other.

    That is stored in ``found`` (copies, pairs), of these pairs alone. Returns whether any pair is.
    """
    radius = np.array([shape.radius for shape in shapes])[:, None]
    round_ones = np.array([shape.ellipsoid for shape in shapes])
    pairs = np.flatnonzero(round_ones[met[0]] | round_ones[met[1]])
    first, second = (of[pairs] for of in met)
    low = np.minimum.reduceat(positions, starts[:-1], axis=1) - radius
    high = np.maximum.reduceat(positions, starts[:-1], axis=1) + radius
    touch = ((low[:, first] <= high[:, second]) & (low[:, second] <= high[:, first])).all(axis=2)
    copy, n = np.nonzero(touch)
    found[:, pairs] = False
    if len(copy):
        apart = _nearest(shapes, starts, positions, ellipsoids, copy, (first[n], second[n]))
        found[copy, pairs[n]] = apart < 0
    return bool(found.any())


def _between_features(shapes: tuple[Shape, Shape], first: np.ndarray, second: np.ndarray) -> Iterator[Found]:
    """Find the distances between features of two bodies, neither of which is an ellipsoid."""
    radius = shapes[0].radius + shapes[1].radius
    positions = (first, second)
    for own, other in ((0, 1), (1, 0)):
        mine, theirs, x, y = shapes[own], shapes[other], positions[own], positions[other]
        points, particles = x[:, mine.vertices], mine.vertices[:, None]
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
    lines, others = shapes[0].lines, shapes[1].lines
    if len(lines) and len(others):
        between = distance.segment_segment(first[:, lines], second[:, others]).min(axis=2)
        yield Found(0, lines, between - radius)
