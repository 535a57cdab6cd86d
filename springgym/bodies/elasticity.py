"""Forces of a body's springs in any shape, and their derivative."""

from __future__ import annotations

import numpy as np

from springgym.bodies.body import Body, assembled


def spring_force_and_jacobian(body: Body, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spring forces (N, 3) [N] and their derivative ∂F/∂x (3N, 3N) [N/m] at positions ``x``."""
    first, second = body.springs.T
    apart = x[second] - x[first]
    length = np.linalg.norm(apart, axis=1)
    along = apart / length[:, None]
    tension = body.stiffness * (length - body.lengths)
    force = np.zeros_like(x)
    np.add.at(force, first, tension[:, None] * along)
    np.add.at(force, second, -tension[:, None] * along)
    outer = along[:, :, None] * along[:, None, :]
    across = (tension / length)[:, None, None] * (np.eye(3) - outer)
    stiff = body.stiffness[:, None, None] * outer + across
    return force, assembled(-stiff, body.springs, len(x))
