"""The law of friction: Coulomb's cone, with a coefficient that may fall as the slip grows (Stribeck).

Friction is an impulse j across the normal that stops what slips, or as much of it as the cone allows,

    |j| ≤ μ(s) J,

with the push J. Coulomb's μ is a constant. Stribeck's falls from the static μ_s to the kinetic μ_k, half of
it at the speed v_s, here in the form of Hess & Soom, J. Tribology 112 (1990) 147 (see Armstrong-Hélouvry,
Dupont & Canudas de Wit, Automatica 30 (1994) 1083, doi:10.1016/0005-1098(94)90209-7):

    μ(s) = μ_k + (μ_s − μ_k)/(1 + (s/v_s)²).

s is the mean of the slip before the node and after it, along j. With the impulse w that would stop what
slips, of which an impulse of 1 changes the slip by K, the slip after it is K (w − j): an equation for j,
found by fixed-point iteration from |j| = μ_s J. What rests, and is pushed by less than μ_s J, has s = 0 and
stays.

A law is this file and its numbers in `springgym.surfaces.Contact`: its named tuple, `law_of` and `weakened`.

Where a round feature meets a surface (`springgym.contact.round`), or what is round another body
(`springgym.contact.turning`), a couple q may resist its turning, too: by
up to ρ J what turns it about tangents, by up to τ J what turns it about the normal. ρ and τ are lengths: what
yields carries its load by ρ ahead of its middle, and a patch of radius a, under an even pressure, takes the
moment (2/3) μ a J to turn about its normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Number, Vector
from springgym.core.lanes import load, maximum, minimum, sqrt
from springgym.core.vectors import TINY, dot

if TYPE_CHECKING:
    from springgym.surfaces import Contact

ROUNDS = 3
"""Rounds of the iteration. Each multiplies the error by (μ_s − μ_k) J K/v_s at the most: by the share of v_s
by which friction changes a slip in a step."""


class Stribeck(NamedTuple):
    """Stribeck's law, for the surfaces of a scene (1,) or for each pair of bodies (pairs,)."""

    drop: np.ndarray
    """1 − μ_k/μ_s [1]"""
    speed: np.ndarray
    """v_s [m/s]"""


class Resistance(NamedTuple):
    """Coefficients of rolling and torsional resistance, of surfaces (1,) or of pairs of bodies (pairs,)."""

    rolling: np.ndarray
    """ρ [m]"""
    torsional: np.ndarray
    """τ [m]"""


def resistance_of(rolling: np.ndarray, torsional: np.ndarray) -> Resistance | None:
    """Return coefficients of resistance as compiled functions take them; None if all are zero."""
    return Resistance(rolling, torsional) if rolling.any() or torsional.any() else None


ROLLING, SPINNING = range(2)
"""The two parts of an angular velocity: about tangents of the contact, and about its normal."""


def law_of(contacts: Sequence[Contact]) -> Stribeck | None:
    """Return what the law of friction takes beside μ_s; None if it is Coulomb's in all contacts."""
    if all(contact.stribeck is None for contact in contacts):
        return None
    drops = [
        1.0 - contact.kinetic / contact.friction if contact.kinetic is not None else 0.0
        for contact in contacts
    ]
    return Stribeck(np.array(drops), np.array([contact.stribeck or 1.0 for contact in contacts]))


@compiled
def within_cone(
    wanted: Vector, limit: Number, inverse: Number, before: Vector, law: Stribeck | None, n: int
) -> Vector:
    """Return an impulse of friction, across the normal, or as much of it as the cone allows.

    Parameters
    ----------
    wanted
        Impulse that would stop what slips [N·s]; or its opposite. This, the limit and 1/K may be per mass.
    limit
        μ_s J [N·s]
    inverse
        K [1/kg]
    before
        The relative velocity before the node [m/s].
    law, n
        The law of friction, None if it is Coulomb's, and the row of its arrays.
    """
    limit = weakened(wanted, limit, inverse, before, law, n)
    return minimum(limit / sqrt(dot(wanted, wanted) + TINY), 1.0) * wanted


@compiled
def weakened(
    wanted: Vector, limit: Number, inverse: Number, before: Vector, law: Stribeck | None, n: int
) -> Number:
    """Return μ(s) J [N·s], given μ_s J and the rest of what `within_cone` takes."""
    if law is None:
        return limit
    size = sqrt(dot(wanted, wanted) + TINY)
    begun = dot(before, wanted) / size
    begun = maximum(begun, -1.0 * begun)
    drop, square = load(law.drop, n), load(law.speed, n) * load(law.speed, n)
    weaker = limit
    for _ in range(ROUNDS):
        slip = 0.5 * (begun + inverse * maximum(size - weaker, 0.0))
        weaker = limit * (1.0 - drop * (slip * slip / (slip * slip + square)))
    return weaker


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
