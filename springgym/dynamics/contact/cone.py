"""The law of friction, Coulomb's cone, and rolling and torsional resistance.

Friction is the tangential impulse j that stops the slip after the node, or as much of it as the cone allows,
|j| ≤ μ J, with the normal impulse J. The energy lost is −j times the mean of the slips before and after it.

Where a round body touches a surface or another body, a couple q may resist its turning, too: rolling about
tangents by up to ρ J, and spinning about the normal by up to τ J. ρ and τ are lengths: a yielding contact
carries its load at a distance ρ ahead of its centre, and a patch of radius a, under uniform pressure, needs
the moment (2/3) μ a J to turn about its normal.
"""

from __future__ import annotations

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number, Vector
from springgym.core.language.lanes import minimum, sqrt
from springgym.core.language.memory import load
from springgym.core.language.vectors import GUARD, dot
from springgym.dynamics.records import Resistance


def resistance_of(rolling: np.ndarray, torsional: np.ndarray) -> Resistance | None:
    """Return coefficients of resistance in the form of compiled functions; None if all are zero."""
    return Resistance(rolling, torsional) if rolling.any() or torsional.any() else None


ROLLING = 0
"""The part of an angular velocity about tangents of the contact."""

SPINNING = 1
"""The part of an angular velocity about the normal of the contact."""


@compiled
def within_cone(wanted: Vector, limit: Number) -> Vector:
    """Return a tangential impulse ``wanted``, shortened to the Coulomb limit μ J if it is longer.

    Impulse and ``limit`` are in N·s, or both per mass.
    """
    return minimum(limit / sqrt(dot(wanted, wanted) + GUARD), 1.0) * wanted


@compiled
def part_resisted(
    part: int, rate: Vector, couple: Vector, n: Vector, push: Number, resistance: Resistance, row: int
) -> tuple[Vector, Vector, Number]:
    """Return one part of an angular velocity and of a couple, and the largest couple that resists it.

    Parameters
    ----------
    part
        `ROLLING` or `SPINNING`.
    rate
        ω [rad/s]
    couple
        The angular impulse [N·m·s].
    n
        The unit normal.
    push
        J [N·s]
    resistance, row
        The coefficients, and the row of their arrays.
    """
    spinning = dot(rate, n) * n
    about_normal = dot(couple, n) * n
    if part == ROLLING:
        return rate - spinning, couple - about_normal, push * load(resistance.rolling, row)
    return spinning, about_normal, push * load(resistance.torsional, row)
