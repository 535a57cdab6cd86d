"""Find which points are hidden: those behind or inside of a body, as seen from the eye."""

from __future__ import annotations

import numpy as np

from springgym.rendering.canvas import Array
from springgym.rendering.look import Look

_NEAR = 0.005  # a point so little farther than a surface lies on it, as a share of its distance from the eye
_AT_ONCE = 2**18  # pairs of points and surfaces that are compared at once


class Occluders:
    """The opaque surfaces, bars and balls of a body in one frame. Glass hides nothing.

    Parameters
    ----------
    eye : (3,) array
        Position of the camera, m.
    look : Look
    points : (N + V, 3) array
        Particles and points of the skin, see `Look.points`, m.
    opacity : (T,) array
        Of the triangles.
    """

    def __init__(self, eye: Array, look: Look, points: Array, opacity: Array) -> None:
        self._eye = eye
        radii, pairs = np.asarray(look.radii), np.asarray(look.bars)
        balls = np.flatnonzero(radii > 0.0)
        with np.errstate(invalid="ignore", over="ignore"):  # what is not finite hides nothing
            corners = points[np.asarray(look.triangles)[opacity == 1.0]] - eye
            size = np.linalg.norm(corners, axis=2).prod(axis=1)
            seen = np.linalg.det(corners) < -1e-9 * size  # these look at the eye: they run anticlockwise
            self._faces = np.linalg.inv(corners[seen])
            starts = np.concatenate([points[pairs[:, 0]], points[balls]])
            along = np.concatenate([points[pairs[:, 1]], points[balls]]) - starts
            found = np.isfinite(along).all(axis=1)
            self._away, self._along = eye - starts[found], along[found]
        self._radius = np.concatenate([np.asarray(look.bar_radius), radii[balls]])[found]

    def hide(self, points: Array) -> np.ndarray:
        """Mask (n,) of the points (n, 3) that are hidden."""
        d = points - self._eye
        hidden = np.zeros(len(d), bool)
        at_once = max(1, _AT_ONCE // max(1, len(d)))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for n in range(0, len(self._faces), at_once):
                hidden |= _behind_faces(d, self._faces[n : n + at_once])
            for n in range(0, len(self._away), at_once):
                w, u, radius = (table[n : n + at_once] for table in (self._away, self._along, self._radius))
                hidden |= _behind_rods(d, w, u, radius)
        return hidden


def _behind_faces(d: Array, inverse: Array) -> np.ndarray:
    """Mask (n,) of the points d (n, 3) from the eye that lie behind any of some triangles.

    With corners a, b, c from the eye, d = α a + β b + γ c. The ray through d meets the triangle if none of
    the three is negative, and α + β + γ is the distance of the point over that of where they meet.
    ``inverse`` (T, 3, 3) are the inverses of the matrices with rows a, b, c.
    """
    shares = d @ inverse
    return ((shares >= -1e-9).all(axis=2) & (shares.sum(axis=2) > 1.0 + _NEAR)).any(axis=0)


def _behind_rods(d: Array, w: Array, u: Array, radius: Array) -> np.ndarray:
    """Mask (n,) of the points d (n, 3) from the eye that lie behind or inside of any of some rods.

    Rods have axes u (B, 3) and round ends; balls are those without length. ``w`` (B, 3) are the ways from
    their starts to the eye. The nearest points s d of the ray and t u of the axis, t in [0, 1], are those of
    two lines; the ray enters √(r² − distance²) before.
    """
    dd, uu = (d * d).sum(axis=1)[:, None], (u * u).sum(axis=1)
    du, dw, uw = d @ u.T, d @ w.T, (u * w).sum(axis=1)
    t = np.nan_to_num(np.clip((dd * uw - du * dw) / (dd * uu - du**2), 0.0, 1.0))
    s = (t * du - dw) / dd
    apart = (w * w).sum(axis=1) + s**2 * dd + t**2 * uu + 2.0 * (s * dw - t * uw - s * t * du)
    enters = s - np.sqrt(radius**2 - apart) / np.sqrt(dd)
    return ((apart < radius**2) & (s > 0.0) & (enters < 1.0 - _NEAR)).any(axis=1)
