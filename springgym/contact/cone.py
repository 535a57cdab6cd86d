"""The law of friction, Coulomb's cone, and what resists turning.

Friction is an impulse j across the normal that stops what slips, or as much of it as the cone allows,
|j| ≤ μ J, with the push J.

Where what is round meets a surface or another body, a couple q may resist its turning, too: by up to ρ J
what turns it about tangents, by up to τ J what turns it about the normal. ρ and τ are lengths: what yields
carries its load by ρ ahead of its middle, and a patch of radius a, under an even pressure, takes the moment
(2/3) μ a J to turn about its normal.
"""

from __future__ import annotations

import numpy as np

from springgym.contact.records import Resistance
from springgym.core.compiling import compiled
from springgym.core.kinds import Number, Vector
from springgym.core.lanes import load, minimum, sqrt
from springgym.core.vectors import TINY, dot


def resistance_of(rolling: np.ndarray, torsional: np.ndarray) -> Resistance | None:
    """Return coefficients of resistance as compiled functions take them; None if all are zero."""
    return Resistance(rolling, torsional) if rolling.any() or torsional.any() else None


ROLLING, SPINNING = range(2)
"""The two parts of an angular velocity: about tangents of the contact, and about its normal."""


@compiled
def within_cone(wanted: Vector, limit: Number) -> Vector:
    """Return an impulse across the normal, ``wanted``, or as much of it as the ``limit`` μ J allows.

    Both are in N·s, or per mass.
    """
    return minimum(limit / sqrt(dot(wanted, wanted) + TINY), 1.0) * wanted


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
    spinning, held = dot(rate, n) * n, dot(couple, n) * n
    if part == ROLLING:
        return rate - spinning, couple - held, push * load(resistance.rolling, row)
    return spinning, held, push * load(resistance.torsional, row)
