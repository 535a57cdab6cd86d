"""One spring: damped oscillator, pair stretched by its spin, spin lost by implicit Euler."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import number
from springgym.theory.checking import ANY, checked, not_negative, numbers, positive
from springgym.theory.frames import Floats

__all__ = ["damped", "implicit_euler_spin", "spun_pair", "spun_pair_length"]


@checked(mass=positive, damping=not_negative, stiffness=positive, x=number, v=number, t=numbers(*ANY))
def damped(
    mass: float, damping: float, stiffness: float, x: float, v: float, t: ArrayLike
) -> tuple[Floats, Floats]:
    """Return the exact solution of m x_ddot + c x_dot + k x = 0 from (x, v) at time 0, for any c >= 0.

    With g = c/2m, w0^2 = k/m: below critical damping x = e^{-gt} [x0 cos(wt) + (v0 + g x0)
    sin(wt)/w], w^2 = w0^2 - g^2; above it x = x0 e^{-r1 t} + (v0 + r1 x0) (e^{-r1 t} - e^{-r2 t})
    / (r2 - r1), r = g -+ sqrt(g^2 - w0^2). Critical is c = 2 sqrt(k m).

    Parameters
    ----------
    mass, damping, stiffness : float
        m > 0, kg; c >= 0, kg/s; k > 0, N/m. For two particles on one spring take the reduced mass
        m1 m2 / (m1 + m2) and x the stretch.
    x, v : float
        m and m/s.
    t : array_like, shape S
        Times, s.

    Returns
    -------
    x, v : ndarray, shape S
        m and m/s.

    Source: Landau & Lifshitz, *Mechanics*, 3rd ed., section 25.
    """
    t = np.asarray(t, float)
    g = damping / (2 * mass)
    square = stiffness / mass
    gap = g**2 - square
    if gap < 0:
        w = math.sqrt(-gap)
        decay = np.exp(-g * t)
        c = np.cos(w * t)
        s = np.sin(w * t) / w
        return decay * (x * c + (v + g * x) * s), decay * (v * c - (g * v + square * x) * s)
    fast = g + math.sqrt(gap)
    slow = square / fast
    spread = fast - slow
    decay = np.exp(-slow * t)
    ramp = decay * (-np.expm1(-spread * t) / spread if spread > 0 else t)
    drive = v + slow * x
    return (
        np.asarray(x * decay + drive * ramp),
        np.asarray(-slow * x * decay + drive * (np.exp(-fast * t) - slow * ramp)),
    )


@checked(mass=positive, stiffness=positive, rest_length=positive, omega=number)
def spun_pair_length(mass: float, stiffness: float, rest_length: float, omega: float) -> float:
    """Return the length of two equal masses on a spring in steady spin, L = L0 / (1 - m Omega^2 / 2k), m.

    Parameters
    ----------
    mass, stiffness, rest_length, omega : float
        Each mass, kg; N/m; m; rad/s.

    Raises
    ------
    ValueError
        If m Omega^2 >= 2 k: the spring cannot hold the pair.

    Source: k (L - L0) = m Omega^2 L / 2.
    """
    share = mass * omega**2 / (2 * stiffness)
    if share >= 1:
        raise ValueError(
            f"a pair of {mass} kg on {stiffness} N/m flies apart at {omega} rad/s: it needs "
            f"|omega| < {math.sqrt(2 * stiffness / mass):.6g} rad/s"
        )
    return rest_length / (1 - share)


@checked(mass=positive, stiffness=positive, rest_length=positive, momentum=number)
def spun_pair(mass: float, stiffness: float, rest_length: float, momentum: float) -> tuple[float, float]:
    """Return the length, m, and the spin, rad/s, of two equal masses on a spring in steady spin.

    m Omega L^2 / 2 is the momentum, of either sign; L and Omega from `spun_pair_length` by bisection, since
    the momentum grows with the spin.

    Parameters
    ----------
    mass, stiffness, rest_length, momentum : float
        Each mass, kg; N/m; m; kg m^2/s.
    """
    low = 0.0
    high = math.sqrt(2 * stiffness / mass)
    while low < (spin := (low + high) / 2) < high:
        length = spun_pair_length(mass, stiffness, rest_length, spin)
        low, high = (spin, high) if mass * spin * length**2 / 2 < abs(momentum) else (low, spin)
    return spun_pair_length(mass, stiffness, rest_length, low), math.copysign(low, momentum)


@checked(omega=number, step=not_negative, t=numbers(*ANY, low=0.0))
def implicit_euler_spin(omega: float, step: float, t: ArrayLike) -> Floats:
    """Return the spin of a body after implicit Euler steps, Omega0 / sqrt(1 + 2 h Omega0^2 t), rad/s.

    One step of size h keeps x1 x v1 = x0 x v1, hence Omega0 = Omega1 (1 + h^2 Omega1^2) at fixed
    radius, whatever the stiffness; to first order in h that is dOmega/dt = -h Omega^3.

    Parameters
    ----------
    omega, step : float
        Omega0, rad/s, and h, s.
    t : array_like
        Times, s.

    Source: derived here; implicit Euler's damping of rotation is Hairer, Lubich & Wanner,
    *Geometric Numerical Integration*, 2nd ed., section I.1.
    """
    return np.asarray(omega / np.sqrt(1 + 2 * step * omega**2 * np.asarray(t, float)))
