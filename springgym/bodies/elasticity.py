"""Forces of a body's springs in any shape, and their derivative."""

from __future__ import annotations

import numpy as np

from springgym.bodies.body import Body, assembled


def spring_force_and_jacobian(body: Body, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return spring forces (N, 3) [N] and their derivative ∂F/∂x (3N, 3N) [N/m] at positions ``x``."""
    along, length, tension = _pulls(body.springs, body.stiffness, body.lengths, x)
    outer = along[:, :, None] * along[:, None, :]
    across = (tension / length)[:, None, None] * (np.eye(3) - outer)
    stiff = body.stiffness[:, None, None] * outer + across
    return _added(body.springs, tension, along, x), assembled(-stiff, body.springs, len(x))


def spring_forces(
    springs: np.ndarray, stiffness: np.ndarray, lengths: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Return spring forces (k, N, 3) [N] on copies at positions ``x``, for stiffness and lengths (k, S)."""
    along, _, tension = _pulls(springs, stiffness, lengths, x)
    return _added(springs, tension, along, x)


def elastic_energy(
    springs: np.ndarray, stiffness: np.ndarray, lengths: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Return the energy (k,) [J] of springs on copies at ``x``, with stiffness and lengths (k, S)."""
    tension = _pulls(springs, stiffness, lengths, x)[2]
    return np.asarray((tension**2 / stiffness).sum(axis=-1) / 2)


def _pulls(
    springs: np.ndarray, stiffness: np.ndarray, lengths: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit vectors (…, S, 3), lengths and tensions (…, S)."""
    first, second = springs.T
    apart = x[..., second, :] - x[..., first, :]
    length = np.linalg.norm(apart, axis=-1)
    return apart / length[..., None], length, stiffness * (length - lengths)


def _added(springs: np.ndarray, tension: np.ndarray, along: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return forces (…, N, 3) of springs on their ends."""
    pull = np.moveaxis(tension[..., None] * along, -2, 0)
    force = np.zeros_like(np.moveaxis(x, -2, 0))
    np.add.at(force, springs[:, 0], pull)
    np.add.at(force, springs[:, 1], -pull)
    return np.moveaxis(force, 0, -2)
