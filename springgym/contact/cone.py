"""The law of friction: Coulomb's cone.

Friction is an impulse across the normal that stops what slips, or as much of it as the cone allows, μ times
the push.
"""

from __future__ import annotations

from springgym.core.compiling import compiled
from springgym.core.kinds import Number, Vector
from springgym.core.lanes import minimum, sqrt
from springgym.core.vectors import TINY, dot


@compiled
def within_cone(across: Vector, limit: Number) -> Vector:
    """Return an impulse of friction, across the normal, or as much of it as Coulomb's cone allows.

    ``limit`` is the coefficient of friction times the push. Both may be per mass.
    """
    return minimum(limit / sqrt(dot(across, across) + TINY), 1.0) * across
