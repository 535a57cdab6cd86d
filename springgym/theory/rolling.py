"""Balls that roll, a tippe-top, Euler's disk, and a rattleback as ordinary differential equations."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from springgym.theory.frames import Floats


def acceleration(angle: float, moment: float, gravity: float = 9.81) -> float:
    """Return the acceleration of a ball that rolls down a slope, g sin a / (1 + I/(m r^2)), m/s^2.

    Parameters
    ----------
    angle : float
        a of the slope, rad.
    moment : float
        I/(m r^2) about the centre, 2/5 of a solid ball.
    gravity : float
        g, m/s^2.
    """
    return gravity * math.sin(angle) / (1 + moment)


def needed_friction(angle: float, moment: float) -> float:
    """Return the least coefficient of friction by which a ball rolls down a slope, tan a / (1 + m r^2/I)."""
    return math.tan(angle) * moment / (1 + moment)


def after_skidding(
    speed: float, moment: float, friction: float, gravity: float = 9.81
) -> tuple[float, float]:
    """Return speed and time at which a ball thrown without spin rolls, v / (1 + I/(m r^2)).

    It skids for (v I/(m r^2)) / (mu g (1 + I/(m r^2))). Of a solid ball 5/7 v is left, whatever friction is,
    which acts through the line on which it touches and keeps the angular momentum about it.

    Returns
    -------
    speed, m/s, and time, s
    """
    rolls = speed / (1 + moment)
    return rolls, (speed - rolls) / (friction * gravity)


def disk_rate(angle: float, radius: float, across: float, gravity: float = 9.81) -> float:
    """Rate at which a disk that rolls on its rim turns about the vertical, its centre at rest, rad/s.

    It touches with no velocity and its centre has none, so that it turns about the diameter between them:
    L = I_1 W sin a along it. The floor's m g acts R cos a beside the centre, and turns L with W about the
    vertical: m g R cos a = W I_1 W sin a cos a. Of a thin disk I_1 = m R^2/4 and W = sqrt(4 g/(R sin a))
    (Euler's disk; Moffatt, Nature 404 (2000) 833, doi:10.1038/35009017).

    Parameters
    ----------
    angle : float
        a between the disk and the floor, rad.
    radius : float
        R, m.
    across : float
        I_1/m about a diameter, m^2.
    gravity : float
        g, m/s^2.
    """
    return math.sqrt(gravity * radius / (across * math.sin(angle)))


def jellett(angular_momentum: ArrayLike, axis: ArrayLike, radius: float, offset: float) -> Floats:
    """Return Jellett's constant of a tippe-top, L . (r z - a e), kg m^3/s, which friction does not change.

    r z - a e is the arm from the point that touches to the centre of mass, of a sphere whose centre lies a e
    from it. All forces act at that point, so that dL/dt has no part along the arm; and L . d(arm)/dt is
    -a L . (w x e), which is 0 of a body that is symmetric about e (Cohen, Am. J. Phys. 45 (1977) 12,
    doi:10.1119/1.10926).

    Parameters
    ----------
    angular_momentum : (..., 3) array_like
        L about the centre of mass, kg m^2/s.
    axis : (..., 3) array_like
        e, unit vectors from the centre of mass to that of the sphere.
    radius, offset : float
        r of the sphere, and a, m.
    """
    arm = radius * np.array([0.0, 0.0, 1.0]) - offset * np.asarray(axis, float)
    return np.asarray((np.asarray(angular_momentum, float) * arm).sum(axis=-1))


def rolling_ellipsoid(
    semi_axes: ArrayLike,
    inertia: ArrayLike,
    offset: ArrayLike,
    frame: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    gravity: float = 9.81,
    steps: int = 10,
) -> tuple[Floats, Floats]:
    """Return the rotation of a rigid ellipsoid that rolls on a level floor without slipping and without loss.

    With rho from the centre of mass to the point that touches and J = I/m + rho^2 1 - rho rho^T,
    J dw/dt = -w x (I/m) w + rho x (g z - w x d rho/dt): angular momentum about the point that touches
    (Kane & Levinson, Int. J. Non-Linear Mech. 17 (1982) 175, doi:10.1016/0020-7462(82)90017-8, of which this
    is the vector form). By Runge and Kutta's method of fourth order.

    Parameters
    ----------
    semi_axes : (3,) array_like
        Along the body's axes, m.
    inertia : (3, 3) array_like
        I/m about the centre of mass in the body's axes, m^2.
    offset : (3,) array_like
        From the centre of mass to that of the ellipsoid, in the body's axes, m.
    frame : (3, 3) array_like
        The body's axes at the start, in columns.
    omega : (3,) array_like
        w at the start, world axes, rad/s.
    times : (T,) array_like
        Equally far apart, from the start, s.
    gravity : float
        g, m/s^2.
    steps : int
        Between two times.

    Returns
    -------
    angular velocities (T, 3), rad/s, and frames (T, 3, 3)
    """
    matrix = np.diag(np.asarray(semi_axes, float) ** 2)
    tensor, arm = np.asarray(inertia, float), np.asarray(offset, float)
    up = np.array([0.0, 0.0, 1.0])

    def slope(turn: Floats, w: Floats) -> tuple[Floats, Floats]:
        g = turn.T @ up
        pull, change = matrix @ g, -matrix @ np.cross(turn.T @ w, g)
        size = math.sqrt(float(g @ pull))
        rho = turn @ (arm - pull / size)
        moves = np.cross(w, rho) - turn @ (change / size - pull * (float(g @ change) / size**3))
        own = turn @ tensor @ turn.T
        whole = own + float(rho @ rho) * np.eye(3) - np.outer(rho, rho)
        moment = np.cross(rho, gravity * up - np.cross(w, moves)) - np.cross(w, own @ w)
        return np.cross(w, turn.T).T, np.linalg.solve(whole, moment)

    moments = np.asarray(times, float)
    h = float(moments[1] - moments[0]) / steps
    turn, w = np.array(frame, float), np.array(omega, float)
    found = [(w, turn)]
    for _ in range(len(moments) - 1):
        for _ in range(steps):
            t1, w1 = slope(turn, w)
            t2, w2 = slope(turn + h / 2 * t1, w + h / 2 * w1)
            t3, w3 = slope(turn + h / 2 * t2, w + h / 2 * w2)
            t4, w4 = slope(turn + h * t3, w + h * w3)
            turn = turn + h / 6 * (t1 + 2 * t2 + 2 * t3 + t4)
            w = w + h / 6 * (w1 + 2 * w2 + 2 * w3 + w4)
        found.append((w, turn))
    return np.array([w for w, _ in found]), np.array([turn for _, turn in found])
