"""Physical pendulum at any amplitude, and the cube hung from a vertex.

I theta_dot^2 / 2 + Mgl (1 - cos theta) is constant, theta from hanging straight down.

Sources: Landau & Lifshitz, *Mechanics*, 3rd ed., section 11, problem 1 (period); Whittaker,
*Analytical Dynamics*, 4th ed., chapter IV (elliptic solution).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import number
from springgym.theory.checking import ANY, between, checked, inside, numbers, positive
from springgym.theory.elliptic import complete_k, incomplete_f, jacobi
from springgym.theory.frames import Floats

__all__ = ["CornerCube", "cube_on_vertex", "motion", "period", "small_period"]


@checked(i1=positive, i3=positive, length=positive, mgl=positive)
@dataclass(frozen=True)
class CornerCube:
    """Cube of eight equal corner masses, about one vertex; a symmetric top about its diagonal.

    `i1`, `i3`: moments of inertia across and along the diagonal, kg m^2; `length`: vertex to
    centre, m; `mgl`: weight times length, N m.
    """

    i1: float
    i3: float
    length: float
    mgl: float


@checked(mass=positive, edge=positive, gravity=positive)
def cube_on_vertex(mass: float, edge: float, gravity: float = 9.81) -> CornerCube:
    """Return the cube's I3 = M b^2/2 and I1 = M b^2/2 + M l^2 = 5 M b^2/4, l = sqrt(3) b/2.

    Parameters
    ----------
    mass, edge, gravity : float
        Total mass M, kg; edge b, m; m/s^2.

    Source: sum of m r^2 over the corners (three times the solid cube's M b^2/6) and the parallel
    axis theorem.
    """
    length = math.sqrt(3) / 2 * edge
    return CornerCube(
        i1=1.25 * mass * edge**2, i3=0.5 * mass * edge**2, length=length, mgl=mass * gravity * length
    )


@checked(inertia=positive, mgl=positive)
def small_period(inertia: float, mgl: float) -> float:
    """Return the period of small swings, T0 = 2 pi sqrt(I / Mgl), s; inertia about the pivot, kg m^2."""
    return 2 * math.pi * math.sqrt(inertia / mgl)


@checked(inertia=positive, mgl=positive, amplitude=inside(-math.pi, math.pi))
def period(inertia: float, mgl: float, amplitude: float) -> float:
    """Return the period of swings of an amplitude below pi, T = T0 (2/pi) K(sin(amplitude/2)), s.

    Parameters
    ----------
    inertia, mgl, amplitude : float
        About the pivot, kg m^2; weight times pivot-to-centre distance, N m; rad.

    Source: Landau & Lifshitz section 11, problem 1.
    """
    quarter = complete_k(math.cos(amplitude / 2) ** 2)
    return small_period(inertia, mgl) * 2 / math.pi * quarter


@checked(inertia=positive, mgl=positive, theta=between(-math.pi, math.pi), theta_dot=number, t=numbers(*ANY))
def motion(inertia: float, mgl: float, theta: float, theta_dot: float, t: ArrayLike) -> tuple[Floats, Floats]:
    """Return the exact angle and rate from (theta, theta_dot) at time 0, swinging or going round.

    With w = sqrt(Mgl/I) and k^2 = sin^2(theta0/2) + (theta_dot0 / 2w)^2:

    k < 1:  sin(theta/2) = k sn(w t + u0, k),        theta_dot = 2 k w cn
    k > 1:  sin(theta/2) = sn(k w t + u0, 1/k),      theta_dot = 2 k w dn

    This function needs SciPy.

    Parameters
    ----------
    inertia, mgl : float
        About the pivot, kg m^2; weight times pivot-to-centre distance, N m.
    theta, theta_dot : float
        Initial angle, |theta| <= pi, rad, and rate, rad/s.
    t : array_like, shape S
        Times, s.

    Returns
    -------
    theta, theta_dot : ndarray, shape S
        rad and rad/s; theta counts whole turns when the pendulum goes round.

    Source: Whittaker chapter IV.
    """
    t = np.asarray(t, float)
    w = math.sqrt(mgl / inertia)
    sign = -1.0 if theta_dot < 0 else 1.0  # solve the mirror image that starts with a rate >= 0
    half = sign * theta / 2
    speed = abs(theta_dot) / (2 * w)
    modulus = math.hypot(math.sin(half), speed)
    depth = math.sin((math.pi - abs(theta)) / 2) ** 2
    excess = depth - speed**2  # 1 - k^2
    if modulus == 0 or (depth == 0 and speed < 1e-100):  # its square would underflow
        return np.full_like(t, theta), np.zeros_like(t)
    if excess >= 0:
        start = incomplete_f(math.sin(half), speed, excess)
        now = jacobi(w * t + start, excess)
        return sign * 2 * np.arctan2(modulus * now.sn, now.dn), sign * 2 * modulus * w * now.cn
    m1 = -excess / modulus**2
    now = jacobi(modulus * w * t + incomplete_f(math.sin(half), math.sqrt(depth), m1), m1)
    parity = 1 - 2 * np.mod(now.turns, 2)
    angle = 2 * np.arctan2(parity * now.sn, parity * now.cn) + 2 * math.pi * now.turns
    return sign * angle, sign * 2 * modulus * w * now.dn
