"""The height of a body above a surface: of its particles, or of its round features if it has any."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from springgym.model.bodies import Body
from springgym.model.bodies.round import weights
from springgym.model.surfaces.plane import Plane
from springgym.model.surfaces.surface import Surface

TRIED = 1e-4
"""Step of differences of a curved surface's height, relative to a feature's extent or Δ."""

BENDS = 20
"""Number of iterations for the contact point of a feature and the normal of a curved surface there."""


def heights(body: Body, positions: np.ndarray, surface: Surface) -> np.ndarray:
    """Return the heights [m] of a body's particles (…, N), or of its round features (…, F) if it has some.

    The height of a ball or rod is that of its skin. The height of a feature is that of its nearest point.
    """
    positions = np.asarray(positions, float)
    if not body.rounds:
        return np.asarray(surface.height(positions) - body.radius)
    return np.stack([_height(body, n, positions, surface) for n in range(len(body.rounds))], axis=-1)


@lru_cache(maxsize=1024)
def _carried(body: Body, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return the carriers of round feature n of a body, their `weights`, and the feature's extent [m]."""
    carriers = body.rounds[n].carriers(len(body.masses))
    return carriers, *weights(body.masses, body.positions, carriers), body.rounds[n].extent


def _height(body: Body, n: int, positions: np.ndarray, surface: Surface) -> np.ndarray:
    """Return the heights (…,) of round feature n of a body, see `springgym.dynamics.contact.round`."""
    feature = body.rounds[n]
    carriers, base, slope, extent = _carried(body, n)
    x = positions[..., carriers, :]
    normal = gradients(surface, np.einsum("i,...ij->...j", base + slope @ feature.centre, x), extent)
    height = np.full(x.shape[:-2], np.nan)
    for _ in range(1 if isinstance(surface, Plane) else BENDS):
        toward = np.einsum("...j,...ij,ik->...k", normal, x, slope)
        share = base + feature.support(toward) @ slope.T
        place = np.einsum("...i,...ij->...j", share, x)
        height = _surface_height(surface, place)
        normal = gradients(surface, place, extent)
    return height


def _surface_height(surface: Surface, places: np.ndarray) -> np.ndarray:
    """Return the heights (…,) of places (…, 3), an array of any number of axes."""
    return np.asarray(surface.height(places.reshape(-1, 3))).reshape(places.shape[:-1])


def gradients(surface: Surface, places: np.ndarray, extent: float | np.ndarray) -> np.ndarray:
    """Return gradients (…, 3) of a height at points (…, 3), by differences over `TRIED` × ``extent`` [m]."""
    if isinstance(surface, Plane):
        return np.broadcast_to(np.asarray(surface.normal), places.shape)
    step = np.asarray(TRIED * extent)[..., None]
    steps = [step * axis for axis in np.eye(3)]
    slopes = [_surface_height(surface, places + d) - _surface_height(surface, places - d) for d in steps]
    return np.asarray(np.stack(slopes, axis=-1) / (2 * step))
