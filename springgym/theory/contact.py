"""Inverse-square floor, restitution and Coulomb friction of a particle.

The floor pushes a particle at height h < Delta with F = c/h^2 - c/Delta^2 (McDonald's paper,
eq 8), whose potential is U = c (Delta - h)^2 / (h Delta^2); c in N m^2, Delta in m.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import number
from springgym.theory.checking import ANY, between, checked, not_negative, positive, positives
from springgym.theory.frames import Floats

__all__ = [
    "apex",
    "energy",
    "force",
    "holds",
    "rebound",
    "rest_height",
    "slope_acceleration",
    "stopping_distance",
    "turning_point",
    "unchecked_force",
]


@checked(height=positives(*ANY), strength=positive, reach=positive)
def force(height: ArrayLike, strength: float, reach: float) -> Floats:
    """Return F(h) = c/h^2 - c/Delta^2 for 0 < h < Delta, else 0, N (paper, eq 8).

    Parameters
    ----------
    height : array_like
        h > 0, m.
    strength, reach : float
        c, N m^2, and Delta, m.
    """
    return unchecked_force(np.asarray(height, float), strength, reach)


def unchecked_force(height: Floats, strength: float, reach: float) -> Floats:
    """Return `force` for arguments that were checked before, N."""
    return np.maximum(strength / height**2 - strength / reach**2, 0.0)


@checked(height=positives(*ANY), strength=positive, reach=positive)
def energy(height: ArrayLike, strength: float, reach: float) -> Floats:
    """Return U(h) = c (Delta - h)^2 / (h Delta^2) for 0 < h < Delta, else 0, J; F = -dU/dh.

    Parameters as for `force`.
    """
    height = np.asarray(height, float)
    return np.asarray(strength * np.maximum(reach - height, 0.0) ** 2 / (height * reach**2))


@checked(weight=not_negative, strength=positive, reach=positive)
def rest_height(weight: float, strength: float, reach: float) -> float:
    """Return the height at which the floor supports a weight W, Delta / sqrt(1 + W Delta^2 / c), m.

    Parameters
    ----------
    weight, strength, reach : float
        W on this particle, N; c, N m^2; Delta, m.
    """
    return reach / math.sqrt(1 + weight * reach**2 / strength)


@checked(energy=number, strength=positive, reach=positive, weight=not_negative)
def turning_point(energy: float, strength: float, reach: float, weight: float = 0.0) -> float:
    """Return the lowest height of a particle of a given energy, m.

    Without weight, h/Delta = 1 + s/2 - sqrt(s + s^2/4), s = E Delta / c. With weight, the smaller
    root of (c/Delta^2 + m g) h^2 - (2 c/Delta + E) h + c = 0, which is U(h) + m g h = E.

    Parameters
    ----------
    energy : float
        Kinetic energy of the vertical motion plus U plus m g h, J, with height from the surface.
    strength, reach, weight : float
        c, N m^2; Delta, m; m g, N.

    Raises
    ------
    ValueError
        If the energy is below that of rest.
    """
    return strength / _larger_root(energy, strength, reach, weight) / _stiff(strength, reach, weight)


@checked(energy=number, strength=positive, reach=positive, weight=positive)
def apex(energy: float, strength: float, reach: float, weight: float) -> float:
    """Return the greatest height, E / m g above Delta, m, to which each bounce without loss returns.

    Parameters as for `turning_point`; a particle that never rises above Delta turns at the larger root of the
    same quadratic.
    """
    if energy >= weight * reach:
        return energy / weight
    return _larger_root(energy, strength, reach, weight)


def _stiff(strength: float, reach: float, weight: float) -> float:
    return strength / reach**2 + weight


def _larger_root(energy: float, strength: float, reach: float, weight: float) -> float:
    """Return the larger root of U(h) + m g h = E, as a quadratic in h; the roots' product is c / _stiff."""
    stiff = _stiff(strength, reach, weight)
    half = strength / reach + energy / 2
    # half^2 - stiff c, without the cancellation of c^2 / Delta^2
    square = energy**2 / 4 + strength * (energy / reach - weight)
    if square < 0 or half < 0:
        least = 2 * (math.sqrt(stiff * strength) - strength / reach)
        raise ValueError(f"energy {energy} J is below {least:.6g} J, the energy of rest")
    return (half + math.sqrt(square)) / stiff


@checked(speed=not_negative, restitution=between(0.0, 1.0), slow=positive)
def rebound(speed: float, restitution: float, slow: float) -> float:
    """Return rebound over impact speed v of the force F(h) (1 - beta h_dot / sqrt(h_dot^2 + w^2)).

    With beta = (1 - e^2)/(1 + e^2), it is e for v far above w, and more for slower impacts: 1 for v = 0.
    This holds without weight, for any barrier F.

    Parameters
    ----------
    speed : float
        Impact speed v >= 0, m/s.
    restitution : float
        e, 0 to 1.
    slow : float
        w > 0, m/s.

    Source: with u = w sinh a, m u du/dh = F L(u) says that the integral of sinh a cosh a/(1 + beta tanh a)
    up to the impact speed is that of sinh a cosh a/(1 - beta tanh a) up to the speed of the rebound.
    """
    if restitution == 1 or speed == 0:
        return 1.0
    angles = np.linspace(0.0, math.asinh(speed / slow), 40001)
    rise = np.sinh(angles) * np.cosh(angles) ** 2
    up = np.exp(angles)
    kept = restitution**2
    # cosh a ± beta sinh a, but for a factor, without cancellation
    way_in, way_out = (_sums(rise / (kept / grows + grows), angles) for grows in (up, 1 / up))
    return math.sinh(float(np.interp(way_in[-1], way_out, angles))) * slow / speed


def _sums(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the cumulative integral (n,) of values (n,) at places (n,), by the trapezoidal rule."""
    return np.append(0.0, np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(at)))


@checked(speed=not_negative, friction=positive, gravity=positive)
def stopping_distance(speed: float, friction: float, gravity: float = 9.81) -> float:
    """Return the distance a particle slides on a level floor, v^2 / (2 mu g), m (Coulomb friction)."""
    return speed**2 / (2 * friction * gravity)


@checked(angle=between(0.0, math.pi / 2), friction=not_negative, gravity=not_negative)
def slope_acceleration(angle: float, friction: float, gravity: float = 9.81) -> float:
    """Return the acceleration of a particle sliding down a slope, g (sin a - mu cos a), m/s^2.

    It is negative where the particle slows down; `holds` says whether it then stays. The angle is in rad.
    """
    return gravity * (math.sin(angle) - friction * math.cos(angle))


@checked(angle=between(0.0, math.pi / 2), friction=not_negative)
def holds(angle: float, friction: float) -> bool:
    """Return whether a particle at rest stays on a slope, tan a <= mu, for 0 <= a < pi/2 rad."""
    return math.sin(angle) <= friction * math.cos(angle)
