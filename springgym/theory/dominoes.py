"""The wave in a row of dominoes that lean on each other as they fall.

J. M. J. van Leeuwen, The domino effect, Am. J. Phys. 78 (2010) 721, doi:10.1119/1.3406154, without
friction between dominoes. Each turns about its lower front edge, which does not slip. One that has hit the
next goes on leaning on it, so that the angle of the foremost, θ, says all others: with height h, thickness d,
free space s,

    h sin(θᵢ − θᵢ₊₁) = (s + d) cos θᵢ₊₁ − d.

Until the foremost hits the next, at sin θ = s/h, energy is kept. The impact is inelastic, and does no work
along what the leaning allows: with Γ = Σ (dθᵢ/dθ)², the angular velocity falls to Γ/(Γ + 1) of it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial.legendre import leggauss

from springgym.theory.frames import Floats

POINTS = 60
"""At which the time of a fall is integrated."""


def leaning(angle: float, count: int, height: float, thickness: float, space: float) -> tuple[Floats, Floats]:
    """Return angles θᵢ [rad] of `count` dominoes, from the foremost back, and rates dθᵢ/dθ, each (count,)."""
    pitch = space + thickness
    angles, rates = np.zeros(count), np.ones(count)
    angles[0] = angle
    for n in range(1, count):
        before = angles[n - 1]
        lean = (pitch * math.cos(before) - thickness) / height
        angles[n] = before + math.asin(lean)
        rates[n] = rates[n - 1] * (1 - pitch * math.sin(before) / (height * math.sqrt(1 - lean * lean)))
    return angles, rates


def impacts(
    count: int,
    height: float,
    thickness: float,
    space: float,
    inertia: float,
    start: float,
    gravity: float = 9.81,
) -> Floats:
    """Return times at which each of `count` dominoes behind the first is hit, s, shape (count,).

    Parameters
    ----------
    height, thickness, space : float
        h, d, s, m.
    inertia : float
        Of one about its lower edge, per mass, m^2: (h^2 + d^2)/3 of a solid one.
    start : float
        Angular velocity of the first, upright at t = 0, rad/s.

    Raises
    ------
    ValueError
        If one does not reach the next, or they are too far apart to hit each other.
    """
    if not 0 < space < height:
        raise ValueError(f"space is {space} m; it must be more than 0 and less than the height, {height} m")
    last = math.asin(space / height)
    nodes, weights = leggauss(POINTS)
    angles = 0.5 * last * (nodes + 1)
    rate, time, found = start, 0.0, []
    for train in range(1, count + 1):
        poses = [leaning(angle, train, height, thickness, space) for angle in (0.0, *angles, last)]
        high = np.array([(height * np.cos(a) + thickness * np.sin(a)).sum() for a, _ in poses])
        together = np.array([(w**2).sum() for _, w in poses])  # Γ
        square = (rate**2 * together[0] + gravity / inertia * (high[0] - high)) / together
        if square.min() <= 0:
            raise ValueError(f"domino {train - 1} comes to rest before it hits the next")
        time += float(0.5 * last * (weights / np.sqrt(square[1:-1])).sum())
        found.append(time)
        rate = math.sqrt(square[-1]) * together[-1] / (together[-1] + 1)
    return np.array(found)


def speed(
    height: float, thickness: float, space: float, inertia: float, gravity: float = 9.81, count: int = 60
) -> float:
    """Return the speed of the wave far from its start, m/s, see `impacts`."""
    start = 3.0 * math.sqrt(gravity / height)
    times = impacts(count, height, thickness, space, inertia, start, gravity)
    return (space + thickness) / float(times[-1] - times[-2])
