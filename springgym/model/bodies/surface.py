"""Properties of closed surfaces of triangles: volume, sharp edges, thickness."""

from __future__ import annotations

import math

import numpy as np

SHARP = math.radians(1.0)
"""Edges whose faces turn by less count as flat."""

RAYS = 256
"""Number of rays that are processed at once: some 30 MB of numbers for 800 triangles."""

JUST = 1e-6
"""Distance of test points from a face, relative to the surface's size; and a sliver's area, to its square."""

SAMPLES = np.array([(1, 1, 1), (4, 1, 1), (1, 4, 1), (1, 1, 4)]) / np.array([[3], [6], [6], [6]])
"""Barycentric coordinates of the points of a triangle where thickness is measured."""


def is_closed(triangles: np.ndarray) -> bool:
    """Return whether each edge belongs to two triangles (T, 3), which run along it in opposite directions."""
    runs = _runs(triangles)
    once = len(np.unique(runs, axis=0)) == len(runs)
    return len(runs) > 0 and once and bool((_ordered(runs) == _ordered(runs[:, ::-1])).all())


def same_sense(triangles: np.ndarray) -> np.ndarray:
    """Return edges (E, 2) along which two triangles run in the same direction: one of them is inverted."""
    runs, times = np.unique(_runs(triangles), axis=0, return_counts=True)
    return runs[times > 1]


def shells(triangles: np.ndarray) -> list[np.ndarray]:
    """Split a surface into pieces (T, 3) that share no edge."""
    edges, belongs = np.unique(np.sort(_runs(triangles), axis=1), axis=0, return_inverse=True)
    first, second, third = belongs.reshape(3, -1)
    joined = np.concatenate([np.column_stack([first, second]), np.column_stack([second, third])])
    piece = pieces(len(edges), joined)[first]
    return [triangles[piece == one] for one in np.unique(piece)]


def pieces(count: int, pairs: np.ndarray) -> np.ndarray:
    """Return the first item of the connected component of each of ``count`` items, linked by pairs (P, 2)."""
    piece = np.arange(count)
    while True:
        lower = piece.copy()
        for a, b in ((0, 1), (1, 0)):
            np.minimum.at(lower, pairs[:, a], piece[pairs[:, b]])
        if (lower == piece).all():
            return piece
        piece = lower


def winding(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return winding numbers (..., P) of surfaces of triangles (..., T, 3, 3) around points (..., P, 3).

    1 inside a solid, 0 outside: the sum of solid angles (van Oosterom and Strackee, IEEE Trans. Biomed. Eng.
    30 (1983) 125) over 4π.
    """
    p, q, r = (corners[..., None, :, n, :] - points[..., :, None, :] for n in range(3))
    a, b, c = (np.linalg.norm(of, axis=-1) for of in (p, q, r))
    pq, qr, rp = (np.einsum("...i,...i->...", u, w) for u, w in ((p, q), (q, r), (r, p)))
    height = np.einsum("...i,...i->...", p, np.cross(q, r))
    return np.arctan2(height, a * b * c + pq * c + qr * a + rp * b).sum(axis=-1) / (2 * np.pi)


def faces_out(positions: np.ndarray, triangles: np.ndarray) -> bool:
    """Return whether a closed surface encloses solids that do not overlap.

    Points just behind each face must be inside of one solid, and points just before it outside. Slivers are
    skipped, as rounding may invert them.
    """
    corners = positions[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.ptp(corners, axis=(0, 1)).max()
    area = np.linalg.norm(across, axis=1) / 2
    wide = area > JUST * size**2
    middle = corners[wide].mean(axis=1)
    step = JUST * size * normals(positions, triangles[wide])
    for first in range(0, len(middle), RAYS):
        some = slice(first, first + RAYS)
        for side, inside in ((-step, 1.0), (step, 0.0)):
            found = winding(middle[some] + side[some], corners)
            if (np.abs(found - inside) > 0.5).any():
                return False
    return len(middle) > 0


def volume(positions: np.ndarray, triangles: np.ndarray) -> float:
    """Return the volume that a closed surface encloses [m³]; negative if its normals point inwards."""
    a, b, c = (positions - positions.mean(axis=0))[triangles].transpose(1, 0, 2)
    return float(np.einsum("ti,ti->", a, np.cross(b, c))) / 6


def normals(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return unit normals (T, 3); zero for a triangle without an area."""
    a, b, c = positions[triangles].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    return across / np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]


def all_edges(triangles: np.ndarray) -> np.ndarray:
    """Return the edges of triangles (T, 3) as pairs of particles (E, 2), each once."""
    return edges_and_counts(triangles)[0]


def edges_and_counts(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges (E, 2) of triangles (T, 3), each once, and the number of triangles at each (E,)."""
    return np.unique(np.sort(_runs(triangles), axis=1), axis=0, return_counts=True)


def sharp_edges(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the convex edges (E, 2) of a closed surface whose faces turn by more than `SHARP`."""
    owner: dict[tuple[int, int], tuple[int, int]] = {}
    for t, (a, b, c) in enumerate(triangles.tolist()):
        owner |= {(a, b): (t, c), (b, c): (t, a), (c, a): (t, b)}
    normal = normals(positions, triangles)
    found = []
    for (i, j), (t, _) in owner.items():
        if i < j:
            other, far = owner[j, i]
            turn = math.acos(min(1.0, max(-1.0, float(normal[t] @ normal[other]))))
            if turn > SHARP and normal[t] @ (positions[far] - positions[i]) < 0:
                found.append((i, j))
    return np.array(sorted(found), int).reshape(-1, 2)


def thickness(positions: np.ndarray, triangles: np.ndarray) -> float:
    """Return the least distance from a closed surface straight inwards to the other side [m].

    Measured from `SAMPLES` of each triangle: near a sharp edge every body is thin.
    """
    corners = positions[triangles]
    normal = normals(positions, triangles)
    start = np.einsum("sk,tki->tsi", SAMPLES, corners).reshape(-1, 3)
    own = np.repeat(np.arange(len(triangles)), len(SAMPLES))
    least = math.inf
    for first in range(0, len(start), RAYS):
        some = slice(first, first + RAYS)
        way = _along(start[some], -normal[own[some]], own[some], corners, normal)
        least = min(least, float(way.min()))
    return least


def _along(
    start: np.ndarray, way: np.ndarray, own: np.ndarray, corners: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Return distances (R,) from points (R, 3) along unit vectors (R, 3) to the nearest triangle where rays
    leave the body, except ``own`` (R,); infinite without one."""
    a = corners[:, 0]
    u = corners[:, 1] - corners[:, 0]
    w = corners[:, 2] - corners[:, 0]
    r = start[:, None] - a
    slope = way @ normal.T
    slope[np.arange(len(own)), own] = 0.0
    leaves = slope > 1e-9
    far = -np.einsum("rti,ti->rt", r, normal) / np.where(leaves, slope, 1.0)
    foot = r + far[:, :, None] * way[:, None]
    uu, uw, ww = (np.einsum("ti,ti->t", p, q) for p, q in ((u, u), (u, w), (w, w)))
    e = np.einsum("rti,ti->rt", foot, u)
    f = np.einsum("rti,ti->rt", foot, w)
    scale = np.maximum(uu * ww - uw * uw, 1e-300)
    s = (ww * e - uw * f) / scale
    t = (uu * f - uw * e) / scale
    size = 1e-9 * np.sqrt(uu.max(initial=0.0))
    within = leaves & (far > -size) & (np.minimum(np.minimum(s, t), 1 - s - t) > -1e-9)
    return np.where(within, np.maximum(far, 0.0), np.inf).min(axis=1)


def _runs(triangles: np.ndarray) -> np.ndarray:
    """Return the directed edges (3 T, 2) of triangles (T, 3)."""
    return np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])


def _ordered(pairs: np.ndarray) -> np.ndarray:
    return pairs[np.lexsort(pairs.T)]
