"""Shared parts of the checks: their result, the limits of theory, and events in samples."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from springgym.scenes.plan import Plan
from springgym.scenes.recording import Recording

NOT_COVERED = "not covered"
"""The verdict where the error of theory may exceed the tolerance."""

Checking = Callable[[Recording], "list[Check]"]
Need = Callable[[Plan], None]

CHECKS: dict[str, Checking] = {}
"""Checks by the names that scene files give them."""

NEEDS: dict[str, tuple[Need, ...]] = {}
"""Requirements of each check on a scene, by the name of the check: functions of
`springgym.scenes.checks.needs`."""

TOGETHER: set[str] = set()
"""Names of the checks that concern all bodies together, not each alone, where bodies collide."""

TOUCHING: set[str] = set()
"""Names of the checks that need `Recording.contacts`."""


def applies(*needs: Need, together: bool = False, contacts: bool = False) -> Callable[[Checking], Checking]:
    """Register a function as a check under its name, for scenes that meet some needs.

    A check concerns each body by itself, or ``together`` all that collide. Some need the ``contacts``.
    """

    def add(function: Checking) -> Checking:
        name = function.__name__
        CHECKS[name], NEEDS[name] = function, needs
        if together:
            TOGETHER.add(name)
        if contacts:
            TOUCHING.add(name)
        return function

    return add


class Check(NamedTuple):
    """A quantity in theory and as measured.

    The tolerance follows from the scene's file, not from measurements, so that a worse run has no larger
    tolerance. The error of theory is estimated from the run, as the ``doubt``; if it exceeds the tolerance,
    theory does not cover the run.
    """

    quantity: str
    theory: float
    measured: float
    """NaN if the run does not have it"""
    tolerance: float
    """largest difference that passes, in the same unit"""
    unit: str
    doubt: float = 0.0
    """estimated error of theory, which neglects stretch, step and damping; in the same unit"""

    @property
    def covered(self) -> bool:
        """Return whether the error of theory is within the tolerance; False for a doubt of NaN."""
        return bool(self.doubt <= self.tolerance)

    @property
    def verdict(self) -> str:
        """Verdict of the check in a word or two. A quantity that was not seen is never "not covered"."""
        if self.passed:
            return "ok"
        return NOT_COVERED if not self.covered and self.measured == self.measured else "FAILED"

    @property
    def passed(self) -> bool:
        """Return whether theory covers the run and the difference is within the tolerance; False for NaN."""
        return self.covered and bool(abs(self.measured - self.theory) <= self.tolerance)


def two_figures(result: Check, difference: float, sign: str = "") -> str:
    """Return a difference with two significant digits: in % of theory, or in its unit if that is 0.

    ``sign`` is "+" to write the sign of positive numbers, too.
    """
    share = 100 * difference / abs(result.theory) if result.theory else difference
    return f"{float(f'{share:.2g}'):{sign}g} {'%' if result.theory else result.unit}".rstrip()


def within(
    share: float, quantity: str, theory: float, measured: float, unit: str, doubt: float = 0.0
) -> Check:
    """Return a check whose tolerance and doubt are relative to the value of theory."""
    scale = abs(theory)
    return Check(quantity, theory, measured, share * scale, unit, doubt * scale)


def slack(recording: Recording, rate: float) -> float:
    """Return a bound of the relative error of a body's moments against a rigid one: 2 ε + (rate h)^order.

    ε is the largest strain of any spring in the run, which falls as 1/k; moments of inertia scale with the
    square of lengths. ``rate`` [rad/s] is the fastest rotation: faster vibrations are about an equilibrium
    that every method has exactly.
    """
    strain = float(recording.measures.strain.max())
    return 2 * strain + (abs(rate) * recording.step) ** recording.integrator.order


def spread(of: Callable[..., float], *arguments: float, by: float) -> float:
    """Return the sum of the changes of a value if each of its arguments has the relative error ``by``."""
    value = of(*arguments)
    changed = [
        of(*arguments[:n], argument * (1 + sign * by), *arguments[n + 1 :])
        for n, argument in enumerate(arguments)
        for sign in (1, -1)
    ]
    pairs = np.abs(np.array(changed) - value).reshape(-1, 2)
    return float(pairs.max(axis=1).sum())


def gravity(recording: Recording) -> float:
    """Return the acceleration of gravity in a scene, 0 without [m/s²]."""
    return float(np.linalg.norm(recording.plan.scene.gravity or 0.0))


def turning_rate(recording: Recording) -> float:
    """Return the largest |ω| of the run [rad/s]."""
    omega = np.linalg.norm(recording.measures.angular_velocity, axis=1)
    return float(np.nanmax(omega)) if np.isfinite(omega).any() else 0.0


def crossings(times: np.ndarray, values: np.ndarray, rising: bool | None = None) -> np.ndarray:
    """Return times at which samples pass through zero, by cubics through four of them, if there are four.

    Parameters
    ----------
    times, values : (T,)
        At equal intervals.
    rising
        Whether to return only upward (True) or only downward (False) crossings; both if None.
    """
    if len(times) < 4:
        return np.zeros(0)
    up, down = (values[:-1] < 0) & (values[1:] >= 0), (values[:-1] > 0) & (values[1:] <= 0)
    wanted = up | down if rising is None else up if rising else down
    found = []
    for n in np.flatnonzero(wanted).tolist():
        first = min(max(n - 1, 0), len(times) - 4)
        cubic = np.polynomial.Polynomial.fit(np.arange(4.0), values[first : first + 4], 3)
        roots = cubic.roots()
        real = roots[np.abs(roots.imag) < 1e-9].real - (n - first)
        inside = real[(real > -1e-6) & (real < 1 + 1e-6)]
        share = inside[0] if len(inside) else values[n] / (values[n] - values[n + 1])
        found.append(times[n] + share * (times[n + 1] - times[n]))
    return np.array(found)


def period(times: np.ndarray, values: np.ndarray) -> float:
    """Return the mean time between zero crossings in the same direction; NaN if there are not two."""
    marks = crossings(times, values, rising=True)
    return (marks[-1] - marks[0]) / (len(marks) - 1) if len(marks) > 1 else math.nan


def peaks(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return times and heights of the maxima of samples at equal intervals, by parabolas through three."""
    n = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1
    before, here, after = values[n - 1], values[n], values[n + 1]
    slope, bend = (after - before) / 2, before - 2 * here + after
    shift = -slope / bend
    return times[n] + shift * (times[1] - times[0]), here + slope * shift / 2
