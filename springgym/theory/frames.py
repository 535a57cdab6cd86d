"""Frames of a rigid body: Euler angles to rotation matrices, and particles carried along."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from springgym.theory.checking import ANY, FRAMES, VECTORS, checked, fit, numbers, rotations

__all__ = ["carry", "euler_zxz"]

Floats = NDArray[np.float64]


@checked(phi=numbers(*ANY), theta=numbers(*ANY), psi=numbers(*ANY))
def euler_zxz(phi: ArrayLike, theta: ArrayLike, psi: ArrayLike) -> Floats:
    """Return the frame of Goldstein's Euler angles: R = Rz(phi) Rx(theta) Rz(psi).

    The body's third axis is R e_z = (sin theta sin phi, -sin theta cos phi, cos theta); it tilts
    towards +x for phi = pi/2.

    Parameters
    ----------
    phi, theta, psi : array_like
        Precession, tilt and spin angle, rad, of one broadcast shape S.

    Returns
    -------
    ndarray, shape S + (3, 3)
        Rotation from body to world coordinates; its columns are the body axes.

    Source: Goldstein, Poole & Safko, *Classical Mechanics*, 3rd ed., section 4.4.
    """
    phi, theta, psi = (np.asarray(x, float) for x in (phi, theta, psi))
    fit(phi=phi, theta=theta, psi=psi)
    phi, theta, psi = np.broadcast_arrays(phi, theta, psi)
    cf = np.cos(phi)
    sf = np.sin(phi)
    ct = np.cos(theta)
    st = np.sin(theta)
    cp = np.cos(psi)
    sp = np.sin(psi)
    rows = (
        (cf * cp - sf * ct * sp, -cf * sp - sf * ct * cp, sf * st),
        (sf * cp + cf * ct * sp, -sf * sp + cf * ct * cp, -cf * st),
        (st * sp, st * cp, ct),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@checked(frame=rotations(*FRAMES), omega_world=numbers(*VECTORS), points=numbers((None, 3)))
def carry(frame: ArrayLike, omega_world: ArrayLike, points: ArrayLike) -> tuple[Floats, Floats]:
    """Return positions and velocities of particles fixed in a turning frame: x = R r, v = omega x (R r).

    Parameters
    ----------
    frame : array_like, shape S + (3, 3)
        Rotation from body to world coordinates.
    omega_world : array_like, shape S + (3,)
        Angular velocity in world coordinates, rad/s.
    points : array_like, shape (N, 3)
        Particles in body coordinates from the fixed point (or centre of mass), m.

    Returns
    -------
    positions, velocities : ndarray, shape S + (N, 3)
        From the fixed point, m and m/s.
    """
    frame = np.asarray(frame, float)
    omega = np.asarray(omega_world, float)
    if frame.shape[:-1] != omega.shape:
        raise ValueError(
            f"frame has shape {frame.shape}, and omega_world {omega.shape}; they must be S + (3, 3) and "
            "S + (3,)"
        )
    positions = np.asarray(points, float) @ np.swapaxes(frame, -1, -2)
    return positions, np.cross(omega[..., None, :], positions)
