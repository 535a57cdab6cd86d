"""Distances between points, segments and triangles, of all pairs, in NumPy.

The first axis is that of copies: points (k, P, 3), segments (k, S, 2, 3), triangles (k, T, 3, 3).
"""

from __future__ import annotations

import numpy as np

from springgym.model.bodies.surface import winding

SMALL = 1e-300
"""Added to divisors, which it changes only if they are 0."""


def _dot(u: np.ndarray, w: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", u, w)


def _share(along: np.ndarray, square: np.ndarray) -> np.ndarray:
    return np.clip(along / (square + SMALL), 0.0, 1.0)


def _above(r: np.ndarray, u: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return which points, at ``r`` from its corner, are above or below a triangle of sides ``u``, ``w``."""
    uu = _dot(u, u)
    uw = _dot(u, w)
    ww = _dot(w, w)
    e = _dot(r, u)
    f = _dot(r, w)
    scale = uu * ww - uw * uw + SMALL
    s = (ww * e - uw * f) / scale
    t = (uu * f - uw * e) / scale
    return np.asarray((s >= 0) & (t >= 0) & (s + t <= 1))


def point_segment(points: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Return distances (k, P, S) [m]."""
    start = segments[:, None, :, 0]
    way = (segments[:, :, 1] - segments[:, :, 0])[:, None]
    r = points[:, :, None] - start
    return np.linalg.norm(r - _share(_dot(r, way), _dot(way, way))[..., None] * way, axis=-1)


def point_surface(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return distances (k, P) from the surface of a solid [m], negative inside."""
    a = triangles[:, None, :, 0]
    u = triangles[:, None, :, 1] - a
    w = triangles[:, None, :, 2] - a
    r = points[:, :, None] - a
    normal = np.cross(u, w)
    height = _dot(r, normal / (np.linalg.norm(normal, axis=-1) + SMALL)[..., None])
    square = np.where(_above(r, u, w), height**2, np.inf)
    for start, way in ((a, u), (a, w), (a + u, w - u)):
        q = points[:, :, None] - start
        foot = q - _share(_dot(q, way), _dot(way, way))[..., None] * way
        square = np.minimum(square, _dot(foot, foot))
    distance = np.sqrt(square.min(axis=2))
    return np.where(winding(points, triangles) > 0.5, -distance, distance)


def segment_segment(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return distances (k, S, Z) [m] of segments (k, S, 2, 3) and (k, Z, 2, 3)."""
    ends = [point_segment(first[:, :, n], second) for n in (0, 1)]
    ends += [np.swapaxes(point_segment(second[:, :, n], first), 1, 2) for n in (0, 1)]
    p = first[:, :, None, 0]
    q = second[:, None, :, 0]
    a = first[:, :, None, 1] - p
    b = second[:, None, :, 1] - q
    r = p - q
    aa = _dot(a, a)
    ab = _dot(a, b)
    bb = _dot(b, b)
    ar = _dot(a, r)
    br = _dot(b, r)
    across = np.cross(a, b)
    square = _dot(across, across)
    s = (ab * br - bb * ar) / (square + SMALL)
    t = (aa * br - ab * ar) / (square + SMALL)
    inside = (square > 0) & (s > 0) & (s < 1) & (t > 0) & (t < 1)
    apart = np.abs(_dot(r, across)) / np.sqrt(square + SMALL)
    return np.where(inside, apart, np.minimum.reduce(ends))


def pierced(segments: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return how deep segments reach through triangles [m], (k, S, T): the depth of the nearer end, or 0."""
    a = triangles[:, None, :, 0]
    u = triangles[:, None, :, 1] - a
    w = triangles[:, None, :, 2] - a
    normal = np.cross(u, w)
    normal = normal / (np.linalg.norm(normal, axis=-1) + SMALL)[..., None]
    start = segments[:, :, None, 0]
    end = segments[:, :, None, 1]
    low = _dot(start - a, normal)
    high = _dot(end - a, normal)
    through = low * high < 0
    share = np.where(through, low / np.where(through, low - high, 1.0), 0.0)
    r = start + share[..., None] * (end - start) - a
    through &= _above(r, u, w)
    return np.where(through, np.minimum(np.abs(low), np.abs(high)), 0.0)
