"""The wave in a row of dominoes that lean on each other as they fall.

J. M. J. van Leeuwen, The domino effect, Am. J. Phys. 78 (2010) 721, doi:10.1119/1.3406154. Each domino turns
about its lower front edge, which does not slip. One that has hit the next continues to lean on it, so that
the angle of the foremost, θ, determines all others: with height h, thickness d, free space s,

    h sin(θᵢ − θᵢ₊₁) = (s + d) cos θᵢ₊₁ − d.

With δ = θᵢ − θᵢ₊₁, the upper edge of domino i slides down the back of domino i + 1, at the distance
a = h cos δ − (s + d) sin θᵢ₊₁ from its lower edge. It exerts N and friction μ N, which have the moments

    N (a − μ d) on i + 1,    −N h (cos δ + μ sin δ) on i

about the lower edges. Summed with weights f, 1 for the foremost, fᵢ = fᵢ₊₁ (a − μ d)/(h (cos δ + μ sin δ)),
the equations of motion have no N. With the rates w = dθᵢ/dθ, and I and the moment Tᵢ of its weight per mass,

    I Σ f (w θ̈ + w′ θ̇²) = Σ f T.

The foremost hits the next at sin θ = s/h. The impact is inelastic, and its impulses act as the forces do.
With Γ = φ Σ f w before, φ of the new contact, the angular velocity is multiplied by Γ/(Γ + 1). Without
friction f = w, and energy is conserved between impacts.
"""

from __future__ import annotations

import math

import numpy as np

from springgym.theory.checking import between, checked, count, filled, not_negative, numbers, positive
from springgym.theory.frames import Floats

__all__ = ["MOST", "NEAR", "PARTS", "impacts", "leaning", "speed", "weights"]

PARTS = 40
"""Number of Runge-Kutta steps from impact to impact; even."""

NEAR = 1e-5
"""Half of the angle difference by which rates are differentiated [rad]."""


MOST = 1000
"""Largest number of dominoes. The time to find their impacts grows with its square."""


@checked(
    angle=between(0.0, math.pi / 2),
    count=count(1, MOST),
    height=positive,
    thickness=not_negative,
    space=positive,
)
def leaning(angle: float, count: int, height: float, thickness: float, space: float) -> tuple[Floats, Floats]:
    """Return angles θᵢ [rad] of `count` dominoes, from the foremost back, and rates dθᵢ/dθ, each (count,)."""
    _check_row(height, thickness, space)
    return _leaning(angle, count, height, thickness, space)


def _check_row(height: float, thickness: float, space: float) -> None:
    """Raise ValueError if a domino does not reach the next, or is no upright slab."""
    for name, size in (("space", space), ("thickness", thickness)):
        if not size < height:
            raise ValueError(f"{name} is {size} m; it must be less than the height, {height} m")


def _leaning(
    angle: float, count: int, height: float, thickness: float, space: float
) -> tuple[Floats, Floats]:
    pitch = space + thickness
    angles = np.zeros(count)
    rates = np.ones(count)
    angles[0] = angle
    for n in range(1, count):
        before = angles[n - 1]
        lean = (pitch * math.cos(before) - thickness) / height
        angles[n] = before + math.asin(lean)
        rates[n] = rates[n - 1] * (1 - pitch * math.sin(before) / (height * math.sqrt(1 - lean * lean)))
    return angles, rates


@checked(
    angles=filled(numbers((None,), low=-math.pi, high=math.pi)),
    height=positive,
    thickness=not_negative,
    space=positive,
    friction=not_negative,
)
def weights(angles: Floats, height: float, thickness: float, space: float, friction: float) -> Floats:
    """Return weights f (count,) of the equations of motion at angles (count,) [rad], foremost first."""
    _check_row(height, thickness, space)
    return _weights(angles, height, thickness, space, friction)


def _weights(angles: Floats, height: float, thickness: float, space: float, friction: float) -> Floats:
    found = np.ones(len(angles))
    for n in range(1, len(angles)):
        lean = angles[n] - angles[n - 1]
        arm = height * math.cos(lean) - (space + thickness) * math.sin(angles[n - 1])
        push = height * (math.cos(lean) + friction * math.sin(lean))
        if arm < friction * thickness:
            raise ValueError(
                f"friction is {friction}; it holds dominoes that lean by {angles[n - 1]:.6g} rad"
            )
        found[n] = found[n - 1] * (arm - friction * thickness) / push
    return found


@checked(
    count=count(2, MOST),
    height=positive,
    thickness=not_negative,
    space=positive,
    inertia=positive,
    start=positive,
    gravity=not_negative,
    friction=not_negative,
)
def impacts(
    count: int,
    height: float,
    thickness: float,
    space: float,
    inertia: float,
    start: float,
    gravity: float = 9.81,
    friction: float = 0.0,
) -> Floats:
    """Return times at which each of `count` dominoes behind the first is hit, s, shape (count,).

    Parameters
    ----------
    height, thickness, space : float
        h, d, s, m.
    inertia : float
        Moment of one about its lower edge, per mass, m^2: (h^2 + d^2)/3 for a solid one.
    start : float
        Angular velocity of the first, upright, domino at t = 0, rad/s.
    friction : float
        mu between dominoes.

    Raises
    ------
    ValueError
        If a domino does not reach the next, comes to rest before it hits the next, or is held by friction.
    """
    _check_row(height, thickness, space)
    last = math.asin(space / height)
    part = last / PARTS

    def sums(angle: float, train: int) -> tuple[float, float, float]:
        """Return the sums Σ f w, Σ f w′ and Σ f T/I."""
        angles, rates = _leaning(angle, train, height, thickness, space)
        f = _weights(angles, height, thickness, space, friction)
        before, after = (_leaning(angle + by, train, height, thickness, space)[1] for by in (-NEAR, NEAR))
        pull = 0.5 * gravity / inertia * (height * np.sin(angles) - thickness * np.cos(angles))
        return float(f @ rates), float(f @ (after - before)) / (2 * NEAR), float(f @ pull)

    rate = start
    time = 0.0
    found = []
    for train in range(1, count + 1):
        known = [sums(0.5 * part * n, train) for n in range(2 * PARTS + 1)]

        def slope(square: float, n: int, known: list[tuple[float, float, float]] = known) -> float:
            together, bend, pull = known[n]
            return 2 * (pull - square * bend) / together

        squares = [rate**2]
        for n in range(0, 2 * PARTS, 2):
            square = squares[-1]
            a = slope(square, n)
            b = slope(square + 0.5 * part * a, n + 1)
            c = slope(square + 0.5 * part * b, n + 1)
            d = slope(square + part * c, n + 2)
            squares.append(square + part / 6 * (a + 2 * b + 2 * c + d))
        if min(squares) <= 0:
            raise ValueError(f"domino {train - 1} comes to rest before it hits the next")
        slowness = 1 / np.sqrt(squares)
        thirds = slowness[0] + 4 * slowness[1::2].sum() + 2 * slowness[2:-1:2].sum() + slowness[-1]
        time += float(part / 3 * thirds)
        found.append(time)
        share = _weights(np.array([0.0, last]), height, thickness, space, friction)[1]
        together = share * known[-1][0]
        rate = math.sqrt(squares[-1]) * together / (together + 1)
    return np.array(found)


@checked(
    height=positive,
    thickness=not_negative,
    space=positive,
    inertia=positive,
    gravity=positive,
    count=count(2, MOST),
    friction=not_negative,
)
def speed(
    height: float,
    thickness: float,
    space: float,
    inertia: float,
    gravity: float = 9.81,
    count: int = 60,
    friction: float = 0.0,
) -> float:
    """Return the speed of the wave far from its start, m/s, see `impacts`."""
    start = 3.0 * math.sqrt(gravity / height)
    times = impacts(count, height, thickness, space, inertia, start, gravity, friction)
    return (space + thickness) / float(times[-1] - times[-2])
