"""Chain of beads and springs hung from a fixed point or between two.

Spring i joins particle i to particle i + 1; particle 0 is fixed and `masses[i]` belongs to
particle i + 1, so that N springs carry N masses.

Sources: Goldstein, Poole & Safko, *Classical Mechanics*, 3rd ed., chapter 6 (small oscillations);
Routh, *Analytical Statics*, vol. I, chapter X (catenary).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import TINY, array, number, shown
from springgym.theory.checking import checked, filled, not_negative, numbers, positive, positives
from springgym.theory.frames import Floats

__all__ = [
    "FIRMEST",
    "Catenary",
    "Modes",
    "bounce_modes",
    "cable_bounce",
    "cable_stretch",
    "catenary",
    "stretched_lengths",
    "swing_modes",
    "tensions",
]

FIRMEST = 1e100
"""Largest tension for which a catenary is sought [N]."""


@checked(frequencies=numbers((None,), low=0.0), shapes=numbers((None, None)))
class Modes(NamedTuple):
    """`frequencies`, shape (N,), rad/s, ascending; `shapes`, shape (N, N), one mode per column.

    Shapes are displacements of masses 0 ... N - 1, scaled so that sum of m x^2 = 1 kg m^2.
    """

    frequencies: Floats
    shapes: Floats


@checked(points=numbers((None, 2)), tensions=numbers((None,), low=0.0))
class Catenary(NamedTuple):
    """`points`, shape (N + 1, 2): x and z from the left support, m; `tensions`, shape (N,), N."""

    points: Floats
    tensions: Floats


def _stiffness(name: str, value: object) -> Floats:
    """Return positive numbers, of which some may be infinite: springs that do not stretch."""
    given = array(name, value, (), (None,), low=TINY, high=math.inf)
    array(name, np.where(np.isinf(given), 1.0, given), (), (None,))
    return given


@checked(masses=filled(positives((None,))), gravity=not_negative)
def tensions(masses: ArrayLike, gravity: float = 9.81) -> Floats:
    """Return the tension at rest, T_i = g (mass below spring i), N, shape (N,).

    Parameters
    ----------
    masses : array_like, shape (N,)
        Top to bottom, kg.
    """
    return gravity * np.cumsum(np.asarray(masses, float)[::-1])[::-1]


@checked(
    masses=filled(positives((None,))),
    rest_length=numbers((), (None,), low=0.0),
    stiffness=_stiffness,
    gravity=not_negative,
)
def stretched_lengths(
    masses: ArrayLike, rest_length: ArrayLike, stiffness: ArrayLike, gravity: float = 9.81
) -> Floats:
    """Return the length at rest of the hanging springs, l_i = L0_i + T_i / k_i, m, shape (N,).

    Parameters
    ----------
    masses : array_like, shape (N,)
        Top to bottom, kg.
    rest_length, stiffness : array_like, shape () or (N,)
        m and N/m.
    """
    pull = tensions(masses, gravity)
    stretch = pull / _of_each("stiffness", stiffness, len(pull))
    return np.asarray(_of_each("rest_length", rest_length, len(pull)) + stretch)


def _of_each(name: str, values: ArrayLike, count: int) -> Floats:
    """Return numbers of each of some springs, (count,), from those or from one number."""
    return np.broadcast_to(array(name, values, (), (count,), high=math.inf), (count,))


@checked(
    masses=filled(positives((None,))),
    rest_length=numbers((), (None,), low=0.0),
    stiffness=_stiffness,
    gravity=not_negative,
)
def swing_modes(
    masses: ArrayLike, rest_length: ArrayLike, stiffness: ArrayLike, gravity: float = 9.81
) -> Modes:
    """Return small sideways modes of the hanging rope: M x_ddot = -K x, K of the springs T_i / l_i.

    Each occurs twice, once per horizontal direction. Parameters as for `stretched_lengths`.

    Source: Goldstein chapter 6; a stretched spring resists a sideways displacement with T/l.
    """
    pull = tensions(masses, gravity)
    return _chain_modes(masses, pull / stretched_lengths(masses, rest_length, stiffness, gravity))


@checked(masses=filled(positives((None,))), stiffness=positives((), (None,)))
def bounce_modes(masses: ArrayLike, stiffness: ArrayLike) -> Modes:
    """Return vertical modes of the hanging rope, M z_ddot = -K z with K of the springs k_i.

    They are exact at any amplitude, as long as all springs stay along the vertical.

    Parameters
    ----------
    masses : array_like, shape (N,)
        Top to bottom, kg.
    stiffness : array_like, shape () or (N,)
        N/m.

    Source: Goldstein chapter 6.
    """
    return _chain_modes(masses, _of_each("stiffness", stiffness, len(np.asarray(masses))))


def _chain_modes(masses: ArrayLike, stiffness: Floats) -> Modes:
    """Return modes of masses in line from a wall: K_ii = k_i + k_{i+1}, K_{i,i+1} = -k_{i+1}."""
    root = np.sqrt(np.asarray(masses, float))
    matrix = np.diag(stiffness + np.append(stiffness[1:], 0.0))
    matrix -= np.diag(stiffness[1:], 1) + np.diag(stiffness[1:], -1)
    squares, vectors = np.linalg.eigh(matrix / np.outer(root, root))
    return Modes(np.sqrt(squares), vectors / root[:, None])


@checked(
    span=positive,
    rise=number,
    masses=filled(numbers((None,), low=0.0)),
    rest_length=numbers((), (None,), low=0.0),
    stiffness=_stiffness,
    gravity=positive,
)
def catenary(
    span: float,
    rise: float,
    masses: ArrayLike,
    rest_length: ArrayLike,
    stiffness: ArrayLike,
    gravity: float = 9.81,
) -> Catenary:
    """Return the discrete catenary: a rope of N springs and N - 1 beads hanging between two supports.

    Spring i has tension T_i = sqrt(H^2 + V_i^2), V_i = V_0 + g (masses left of it), length
    l_i = L0_i + T_i / k_i and direction (H, V_i) / T_i. The height reached rises with V_0 and the
    span with H (sum L0 T + T^2 / 2k, whose slopes they are, is convex): two nested scalar roots.
    This function needs SciPy.

    Parameters
    ----------
    span, rise : float
        Horizontal distance (positive) and height of the right support from the left, m.
    masses : array_like, shape (N - 1,)
        Left to right, kg.
    rest_length, stiffness : array_like, shape () or (N,)
        m and N/m; an infinite stiffness is an inextensible rope.

    Raises
    ------
    ValueError
        If the masses weigh nothing, an inextensible rope is too short, or a spring goes slack.

    Source: Routh chapter X.
    """
    load = gravity * np.append(0.0, np.cumsum(np.asarray(masses, float)))
    rest = _of_each("rest_length", rest_length, len(load))
    give = 1 / _of_each("stiffness", stiffness, len(load))
    if not load[-1] >= TINY:
        raise ValueError(f"masses is {shown(masses)}; together they must weigh something")
    if not give.any() and rest.sum() <= math.hypot(span, rise):
        raise ValueError(f"an inextensible rope of {rest.sum()} m cannot reach {math.hypot(span, rise)} m")

    from scipy.optimize import brentq

    def edges(across: float, up: float) -> tuple[Floats, Floats]:
        force = np.stack([np.full_like(load, across), up + load], axis=-1)
        tension = np.linalg.norm(force, axis=-1)
        return (rest / tension + give)[:, None] * force, tension

    def root(gap: Callable[[float], float], low: float, high: float) -> float:
        # to the rounding of `high`: a root near zero is added to numbers of this size
        return float(brentq(gap, low, high, xtol=1e-16 * high, rtol=1e-15, maxiter=1000))

    def double(force: float) -> float:
        if force > FIRMEST:
            raise ValueError(
                f"a rope of {rest.sum()} m between supports {math.hypot(span, rise)} m apart is so taut that "
                f"its tension is more than {FIRMEST:g} N"
            )
        return 2 * force

    def lift(across: float) -> float:
        """Return V_0 that reaches the right height under a given H."""

        def gap(up: float) -> float:
            return float(edges(across, up)[0][:, 1].sum()) - rise

        margin = across + load[-1]
        while gap(margin) < 0 or gap(-margin) > 0:
            margin = double(margin)
        return root(gap, -margin, margin)

    def gap(across: float) -> float:
        return float(edges(across, lift(across))[0][:, 0].sum()) - span

    least = most = 1e-9 * load[-1]
    if gap(least) > 0:
        loose = int(np.argmin(edges(least, lift(least))[1]))
        raise ValueError(f"spring {loose} goes slack: no catenary with all in tension")
    while gap(most) < 0:
        least = most
        most = double(most)
    across = root(gap, least, most)
    edge, tension = edges(across, lift(across))
    return Catenary(np.vstack([np.zeros(2), np.cumsum(edge, axis=0)]), tension)


@checked(
    load=not_negative,
    mass=not_negative,
    young=positive,
    section=positive,
    length=positive,
    gravity=not_negative,
)
def cable_stretch(
    load: float, mass: float, young: float, section: float, length: float, gravity: float = 9.81
) -> float:
    """Return the stretch of a hanging cable under a load and its own weight, (M + m/2) g L / (E A), m.

    Parameters
    ----------
    load, mass : float
        M at its end, and m of the cable, kg.
    young, section, length : float
        E, Pa; A, m^2; L unstretched, m.

    Source: Gere & Timoshenko, *Mechanics of Materials*, 4th ed., section 2.3.
    """
    return (load + mass / 2) * gravity * length / (young * section)


@checked(load=not_negative, mass=positive, young=positive, section=positive, length=positive)
def cable_bounce(load: float, mass: float, young: float, section: float, length: float) -> float:
    """Return the lowest frequency of a hanging cable with a load along itself, rad/s: x tan x = m / M.

    The wave equation with u(0) = 0 and M u_tt = -E A u_x at the end, x = omega L / c,
    c^2 = E A L / m; bisection between 0 and pi/2, which is the root without a load.

    Parameters
    ----------
    load, mass, young, section, length : float
        As for `cable_stretch`.

    Source: Rao, *Mechanical Vibrations*, 5th ed., section 8.3.
    """
    low = 0.0
    high = math.pi / 2
    while low < (x := (low + high) / 2) < high:
        low, high = (x, high) if load * x * math.sin(x) < mass * math.cos(x) else (low, x)
    return x * math.sqrt(young * section / (mass * length))
