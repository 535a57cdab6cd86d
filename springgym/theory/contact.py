"""Inverse-square floor, restitution and Coulomb friction of a particle.

The floor pushes a particle at height h < Delta with F = c/h^2 - c/Delta^2 (McDonald's paper,
eq 8), whose potential is U = c (Delta - h)^2 / (h Delta^2); c in N m^2, Delta in m.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from springgym.theory.frames import Floats


def force(height: ArrayLike, strength: float, reach: float) -> Floats:
    """F(h) = c/h^2 - c/Delta^2 for 0 < h < Delta, else 0, N (paper, eq 8).

    Parameters
    ----------
    height : array_like
        h > 0, m.
    strength, reach : float
        c, N m^2, and Delta, m.
    """
    height = np.asarray(height, float)
    return np.maximum(strength / height**2 - strength / reach**2, 0.0)


def energy(height: ArrayLike, strength: float, reach: float) -> Floats:
    """U(h) = c (Delta - h)^2 / (h Delta^2) for 0 < h < Delta, else 0, J; F = -dU/dh.

    Parameters as for `force`.
    """
    height = np.asarray(height, float)
    return np.asarray(strength * np.maximum(reach - height, 0.0) ** 2 / (height * reach**2))


def rest_height(weight: float, strength: float, reach: float) -> float:
    """Height where the floor carries a weight, Delta / sqrt(1 + m g Delta^2 / c), m.

    Parameters
    ----------
    weight, strength, reach : float
        m g on this particle, N; c, N m^2; Delta, m.
    """
    return reach / math.sqrt(1 + weight * reach**2 / strength)


def turning_point(energy: float, strength: float, reach: float, weight: float = 0.0) -> float:
    """Lowest height of a particle of a given energy, m.

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


def apex(energy: float, strength: float, reach: float, weight: float) -> float:
    """Greatest height, E / m g above the floor's reach, m: without loss each bounce returns to it.

    Parameters as for `turning_point`; a particle that never leaves the floor's reach turns at the
    larger root of the same quadratic.
    """
    if energy >= weight * reach:
        return energy / weight
    return _larger_root(energy, strength, reach, weight)


def _stiff(strength: float, reach: float, weight: float) -> float:
    return strength / reach**2 + weight


def _larger_root(energy: float, strength: float, reach: float, weight: float) -> float:
    """Larger root of U(h) + m g h = E, as a quadratic in h; the roots' product is c / _stiff."""
    stiff, half = _stiff(strength, reach, weight), strength / reach + energy / 2
    # half^2 - stiff c, without the cancellation of c^2 / Delta^2
    square = energy**2 / 4 + strength * (energy / reach - weight)
    if square < 0:
        least = 2 * (math.sqrt(stiff * strength) - strength / reach)
        raise ValueError(f"energy {energy} J is below {least:.6g} J, the energy of rest")
    return (half + math.sqrt(square)) / stiff


def _loss(x: float) -> float:
    """(x - ln(1 + x)) / x^2, positive and falling on (-1, inf); infinite at -1."""
    if x <= -1:
        return math.inf
    if abs(x) < 0.1:
        return sum((-x) ** n / (n + 2) for n in range(18))
    return (x - math.log1p(x)) / x**2


def _imbalance(x: float, restitution: float) -> float:
    """Zero where ln[(1 + x)/(1 - e x)] = x (1 + e); falls with x and with e."""
    return _loss(x) - restitution**2 * _loss(-restitution * x)


def _falling_root(function: Callable[[float], float], top: float) -> float:
    """Root in (0, top) of a falling function, by bisection to the last bit."""
    low, high = 0.0, top
    while low < (middle := (low + high) / 2) < high:
        low, high = (middle, high) if function(middle) > 0 else (low, middle)
    return middle


def damping_for_restitution(restitution: float, speed: float) -> float:
    """Damping d of the force F(h) (1 - d h_dot)_+ that gives restitution e at impact speed v0.

    ln[(1 + d v0) / (1 - d e v0)] = d v0 (1 + e), for any barrier F and no weight. Small d gives
    e = 1 - 2 d v0 / 3, which is Hunt and Crossley's e = 1 - alpha v0 with d = 3 alpha / 2.

    Parameters
    ----------
    restitution : float
        Rebound speed over impact speed, 0 <= e <= 1.
    speed : float
        Impact speed v0 > 0, m/s.

    Returns
    -------
    float
        d, s/m: 0 for e = 1. No finite d stops a particle dead: the rebound never exceeds 1/d, so
        d v0 -> 1/e as e -> 0, and e = 0 gives infinity.

    Raises
    ------
    ValueError
        If e lies outside [0, 1] or the speed is not positive.

    Source: m v dv/dh = F (1 - d v) integrated in and out; force law of Hunt & Crossley, J. Appl.
    Mech. 42 (1975) 440, doi:10.1115/1.3423596.
    """
    if not 0 <= restitution <= 1:
        raise ValueError(f"restitution must lie in [0, 1], got {restitution!r}")
    if not speed > 0:
        raise ValueError(f"speed must be positive, got {speed!r} m/s")
    if restitution in (0, 1):
        return 0.0 if restitution else math.inf
    return _falling_root(lambda x: _imbalance(x, restitution), 1 / restitution) / speed


def restitution_at(speed: float, damping: float) -> float:
    """Restitution e at impact speed v of the force F(h) (1 - d h_dot)_+.

    Solves ln[(1 + d v) / (1 - d e v)] = d v (1 + e) for e; 1 at low speed, 1/(d v) at high speed.

    Parameters
    ----------
    speed, damping : float
        v >= 0, m/s, and d >= 0, s/m.

    Source: as `damping_for_restitution`.
    """
    x = damping * speed
    if x == 0:
        return 1.0
    return _falling_root(lambda e: _imbalance(x, e), min(1.0, 1 / x))


def stopping_distance(speed: float, friction: float, gravity: float = 9.81) -> float:
    """Distance a particle slides on a level floor, v^2 / (2 mu g), m (Coulomb friction)."""
    return speed**2 / (2 * friction * gravity)


def slope_acceleration(angle: float, friction: float, gravity: float = 9.81) -> float:
    """Acceleration of a particle sliding down a slope, g (sin a - mu cos a), m/s^2.

    Negative where it slows down; `holds` says whether it then stays. Angle in rad.
    """
    return gravity * (math.sin(angle) - friction * math.cos(angle))


def holds(angle: float, friction: float) -> bool:
    """Whether a particle at rest stays on a slope, tan a <= mu, 0 <= a < pi/2 rad."""
    return math.sin(angle) <= friction * math.cos(angle)
