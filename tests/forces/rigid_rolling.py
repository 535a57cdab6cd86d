"""Rigid ellipsoids on a level plane as ordinary differential equations, written apart from the package.

The body touches at ρ = R (ξc − ξm − A g/√(g·A g)), g = Rᵀ ẑ, from its centre of mass ξm, and is held there by
a force N ẑ with the friction f. It rolls, with v = −ω × ρ, or it slips, with Coulomb's friction made smooth,
f = −μ N u/√(u² + ε²) of the speed u = v + ω × ρ of the point that touches:

    rolling   (I + m (ρ² 1 − ρ ρᵀ)) ω̇ = −ω × I ω + m ρ × (g ẑ − ω × ρ̇)
    slipping  m v̇ = N (ẑ − μ s) − m g ẑ,  I ω̇ = −ω × I ω + N ρ × (ẑ − μ s),  v̇_z = −(ω̇ × ρ + ω × ρ̇)_z

(Kane & Levinson, Int. J. Non-Linear Mech. 17 (1982) 175; Cohen, Am. J. Phys. 45 (1977) 12.) Runge and Kutta's
method of fourth order, constant steps.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit


class Solid(NamedTuple):
    """A rigid body; all in its own frame."""

    mass: float
    inertia: np.ndarray
    """(3, 3) inertia tensor about the centre of mass [kg m²]"""
    arm: np.ndarray
    """(3,) from the centre of mass to the centre of the ellipsoid"""
    matrix: np.ndarray
    """(3, 3) A"""


@njit(cache=True)
def touching(turn: Any, omega: Any, arm: Any, matrix: Any) -> Any:
    """ρ and its derivative."""
    up = np.array([0.0, 0.0, 1.0])
    g = turn.T @ up
    rate = -np.cross(turn.T @ omega, g)
    pull = matrix @ g
    change = matrix @ rate
    size = np.sqrt(g @ pull)
    rho = turn @ (arm - pull / size)
    return rho, np.cross(omega, rho) - turn @ (change / size - pull * ((g @ change) / size**3))


@njit(cache=True)
def slope(y: Any, mass: Any, inertia: Any, arm: Any, matrix: Any, g: Any, mu: Any, eps: Any) -> Any:
    """Derivative of x (3), v (3), ω (3), R (9); rolling if ε is 0."""
    up = np.array([0.0, 0.0, 1.0])
    v = y[3:6]
    omega = y[6:9]
    turn = y[9:].copy().reshape(3, 3)
    rho, rate = touching(turn, omega, arm, matrix)
    tensor = turn @ inertia @ turn.T
    gyro = -np.cross(omega, tensor @ omega)
    out = np.empty(18)
    if eps == 0.0:
        v = -np.cross(omega, rho)
        whole = tensor + mass * ((rho @ rho) * np.eye(3) - np.outer(rho, rho))
        faster = np.linalg.solve(whole, gyro + mass * np.cross(rho, g * up - np.cross(omega, rate)))
        force = np.zeros(3)
        pace = -np.cross(faster, rho) - np.cross(omega, rate)
    else:
        u = v + np.cross(omega, rho)
        u[2] = 0.0
        force = up - mu / np.sqrt(u @ u + eps * eps) * u
        free = np.linalg.solve(tensor, gyro)
        by = np.linalg.solve(tensor, np.cross(rho, force))
        # v̇_z + (ω̇ × ρ + ω × ρ̇)_z = 0, with v̇_z = N/m − g
        rest = -g + (np.cross(free, rho) + np.cross(omega, rate))[2]
        normal = -rest / (1.0 / mass + np.cross(by, rho)[2])
        faster = free + normal * by
        pace = normal / mass * force - g * up
    out[:3] = v
    out[3:6] = pace
    out[6:9] = faster
    for k in range(3):
        out[9 + k : 18 : 3] = np.cross(omega, turn[:, k])
    return out


@njit(cache=True)
def solved(
    y: Any,
    mass: Any,
    inertia: Any,
    arm: Any,
    matrix: Any,
    g: Any,
    mu: Any,
    eps: Any,
    h: Any,
    steps: Any,
    every: Any,
) -> Any:
    found = np.empty((steps // every + 1, 18))
    for n in range(steps + 1):
        if n % every == 0:
            found[n // every] = y
        a = slope(y, mass, inertia, arm, matrix, g, mu, eps)
        b = slope(y + 0.5 * h * a, mass, inertia, arm, matrix, g, mu, eps)
        c = slope(y + 0.5 * h * b, mass, inertia, arm, matrix, g, mu, eps)
        d = slope(y + h * c, mass, inertia, arm, matrix, g, mu, eps)
        y = y + h / 6 * (a + 2 * b + 2 * c + d)
    return found


def motion(
    solid: Solid,
    turn: np.ndarray,
    omega: Any,
    v: Any,
    times: np.ndarray,
    mu: float = 0.0,
    eps: float = 0.0,
    finest: float = 1e-4,
    g: float = 9.81,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities, angular velocities, rotations (T, …) at equal times; rolling without ε."""
    gap = float(times[1] - times[0])
    every = int(np.ceil(gap / finest))
    omega = np.array(omega, float)
    v = np.array(v, float)
    rho, _ = touching(turn, omega, solid.arm, solid.matrix)
    if eps == 0.0:
        v = -np.cross(omega, rho)
    else:
        v[2] = -np.cross(omega, rho)[2]
    y = np.concatenate([[0.0, 0.0, -rho[2]], v, omega, turn.ravel()])
    steps = every * (len(times) - 1)
    found = solved(
        y, solid.mass, solid.inertia, solid.arm, solid.matrix, g, mu, eps, gap / every, steps, every
    )
    velocities = found[:, 3:6]
    if eps == 0.0:
        arms = [touching(row[9:].reshape(3, 3), row[6:9], solid.arm, solid.matrix)[0] for row in found]
        velocities = -np.cross(found[:, 6:9], np.array(arms))
    return found[:, :3], velocities, found[:, 6:9], found[:, 9:].reshape(-1, 3, 3)
