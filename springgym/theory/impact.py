"""Linear theory of a stiff body of springs that hits a floor: contact time and rebound speed.

With displacements u of its particles from where they are when the lowest one meets the barrier,

    M u_tt = -K u - C u_t - M g z + F(h + u_z) z,

F that of `contact.force`, h the heights at the start. It is linear except for the barrier, and is solved by
the classical Runge-Kutta method in steps of a fiftieth of a radian of the fastest vibration. A bar with waves
touches for 2 L/c; a few particles carry no waves, and touch for a time that their springs determine.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import array, number, shown
from springgym.theory.checking import (
    ROUNDING,
    checked,
    filled,
    not_negative,
    numbers,
    positive,
    positives,
    symmetric,
)
from springgym.theory.contact import unchecked_force
from springgym.theory.frames import Floats

__all__ = ["RADIANS", "STIFFEST", "Impact", "impact"]

RADIANS = 0.02
"""Angle by which the fastest vibration advances in a step [rad]."""


STIFFEST = 1000.0
"""Largest ratio of the fastest to the slowest vibration: five million steps."""


@checked(duration=not_negative, speed=number, until=not_negative)
class Impact(NamedTuple):
    """From the first touch: `duration` to the last, s; `speed` of the centre at `until`, m/s and s."""

    duration: float
    speed: float
    until: float


@checked(
    masses=filled(positives((None,))),
    stiffness=numbers((None, None)),
    damping=numbers((None, None)),
    heights=numbers((None,), low=0.0),
    speed=positive,
    strength=positive,
    reach=positive,
    gravity=not_negative,
)
def impact(
    masses: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    heights: ArrayLike,
    speed: float,
    strength: float,
    reach: float,
    gravity: float = 9.81,
) -> Impact:
    """Compute contact time and rebound of a body that falls without turning on a smooth, lossless floor.

    It is integrated until its lowest particle is above Delta by as much as vibrations may move it, 10 v/ω of
    the slowest, or by Delta if that is less.

    Parameters
    ----------
    masses : array_like, shape (N,)
        kg.
    stiffness, damping : array_like, shape (3 N, 3 N)
        K, N/m, and C, kg/s, of the body's springs.
    heights : array_like, shape (N,)
        Heights of the particles above the lowest, m.
    speed : float
        Downward speed at the first touch, m/s.
    strength, reach : float
        c, N m^2, and Delta, m.

    Raises
    ------
    ValueError
        If it does not vibrate, or does not leave the floor within a hundred radians of its slowest vibration.
    """
    mass = np.repeat(np.asarray(masses, float), 3)[:, None]
    size = len(mass)
    high = reach + array("heights", heights, (size // 3,))
    root = np.sqrt(mass)
    springs, dampers = (
        symmetric(name, array(name, given, (size, size)))
        for name, given in (("stiffness", stiffness), ("damping", damping))
    )
    rates = np.linalg.eigvalsh(dampers)
    if rates[0] < -ROUNDING * abs(rates).max():
        raise ValueError(f"damping is {shown(damping)}; it must take energy from all motions")
    squares = np.linalg.eigvalsh(springs / (root * root.T))
    if not squares[-1] > 0:
        raise ValueError(
            f"stiffness is {shown(stiffness)}: the body does not vibrate; it needs a spring between two "
            "particles"
        )
    quick = math.sqrt(squares[-1] + 2 * strength / (reach**3 * mass.min()))
    slow = math.sqrt(squares[squares > 1e-9 * squares[-1]][0])
    springs = springs / mass
    dampers = dampers / mass
    vertical = slice(2, None, 3)
    step = RADIANS / quick

    def rate(state: Floats) -> Floats:
        u, v = state
        a = -springs @ u - dampers @ v
        a[vertical] += (
            unchecked_force(np.maximum(high + u[vertical], 1e-9 * reach), strength, reach) / mass[vertical, 0]
        )
        a[vertical] -= gravity
        return np.array([v, a])

    state = np.zeros((2, len(mass)))
    state[1, vertical] = -speed
    clear = min(reach, 10 * speed / slow)
    share = mass[vertical, 0] / mass[vertical].sum()
    last = 0.0
    slowest = min(slow, math.sqrt(2 * strength / (reach**3 * mass[vertical].sum())))
    if quick > STIFFEST * slowest:
        raise ValueError(
            f"the fastest vibration, of {quick:g} rad/s, is more than {STIFFEST:g} times as fast as the "
            f"slowest, of {slowest:g} rad/s: stiffness and strength are too different, or the masses"
        )
    for n in range(math.ceil(100 / slowest / step)):
        before = float((high + state[0, vertical]).min()) - reach
        k1 = rate(state)
        k2 = rate(state + step / 2 * k1)
        k3 = rate(state + step / 2 * k2)
        k4 = rate(state + step * k3)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        after = float((high + state[0, vertical]).min()) - reach
        if before < 0 <= after:
            last = step * (n + before / (before - after))
        if after > clear:
            return Impact(last, float(share @ state[1, vertical]), step * (n + 1))
    raise ValueError(f"a body that hits the floor with {speed:g} m/s does not leave it")
