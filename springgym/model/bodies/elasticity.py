"""Forces of a body's springs in any shape, and their derivative."""

from __future__ import annotations

import numpy as np

from springgym.model.bodies.body import Body, assembled


def spring_force_and_jacobian(body: Body, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return spring forces (N, 3) [N] and their derivative ∂F/∂x (3N, 3N) [N/m] at positions ``x``."""
    along, length, tension = _pulls(body.springs, body.stiffness, body.lengths, x)
    outer = along[:, :, None] * along[:, None, :]
    across = (tension / length)[:, None, None] * (np.eye(3) - outer)
    stiff = body.stiffness[:, None, None] * outer + across
    return _added(body.springs, tension[:, None] * along, x), assembled(-stiff, body.springs, len(x))


def spring_forces(
    springs: np.ndarray, stiffness: np.ndarray, lengths: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Return spring forces (k, N, 3) [N] on copies at positions ``x``, for stiffness and lengths (k, S)."""
    along, _, tension = _pulls(springs, stiffness, lengths, x)
    return _added(springs, tension[..., None] * along, x)


def changed_forces(
    springs: np.ndarray, stiffness: np.ndarray, lengths: np.ndarray, x: np.ndarray, shift: np.ndarray
) -> np.ndarray:
    """Return (∂F/∂x) s (k, N, 3), the first-order change of spring forces by a ``shift`` s of the particles.

    Like `spring_force_and_jacobian`, without a matrix, for copies at ``x``: a spring with tension T pulls
    with k û û·d + (T/L) (d − û û·d) more, where d is the shift of one end relative to the other. For
    velocities in place of a shift, the change is one per second.
    """
    along, length, tension = _pulls(springs, stiffness, lengths, x)
    first, second = springs.T
    apart = shift[..., second, :] - shift[..., first, :]
    longer = (along * apart).sum(axis=-1)[..., None] * along
    change = stiffness[..., None] * longer + (tension / length)[..., None] * (apart - longer)
    return _added(springs, change, x)


def _pulls(
    springs: np.ndarray, stiffness: np.ndarray, lengths: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit vectors (…, S, 3), lengths and tensions (…, S)."""
    first, second = springs.T
    apart = x[..., second, :] - x[..., first, :]
    length = np.linalg.norm(apart, axis=-1)
    return apart / length[..., None], length, stiffness * (length - lengths)


def _added(springs: np.ndarray, pull: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return forces (…, N, 3) of springs on their ends, from their pull (…, S, 3) on the first."""
    pull = np.moveaxis(pull, -2, 0)
    force = np.zeros_like(np.moveaxis(x, -2, 0))
    np.add.at(force, springs[:, 0], pull)
    np.add.at(force, springs[:, 1], -pull)
    return np.moveaxis(force, 0, -2)
