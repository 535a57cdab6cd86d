"""Shared parts of the checks: their result, the limits of theory, and events in samples."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from springgym.checks import (
    array,
    chosen,
    flag,
    function,
    instance,
    number,
    readings,
    refusing_unknown,
    shown,
)
from springgym.scenes.plan import Plan
from springgym.scenes.recording import Recording

__all__ = [
    "CHECKS",
    "NEEDS",
    "NOT_COVERED",
    "TOGETHER",
    "TOUCHING",
    "applies",
    "crossings",
    "gravity",
    "peaks",
    "period",
    "slack",
    "spread",
    "turning_rate",
    "two_figures",
    "within",
]

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
    for need in needs:
        function("needs", need)
    flag("together", together)
    flag("contacts", contacts)

    def add(check: Checking) -> Checking:
        name = function("check", check).__name__
        CHECKS[name] = check
        NEEDS[name] = needs
        if together:
            TOGETHER.add(name)
        if contacts:
            TOUCHING.add(name)
        return check

    return add


@refusing_unknown
@dataclass(frozen=True)
class Check:
    """A quantity in theory and as measured.

    The tolerance follows from the scene's file, not from measurements, so that a worse run has no larger
    tolerance. The error of theory is estimated from the run, as the ``doubt``; if it exceeds the tolerance,
    theory does not cover the run.

    Raises
    ------
    TypeError, ValueError
        If a field has the wrong type, the tolerance or the doubt is negative, or the tolerance or the value
        of theory is infinite, so that everything would pass; the message names it.
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

    def __post_init__(self) -> None:
        for name in ("quantity", "unit"):
            instance(name, getattr(self, name), str)
        for name in ("theory", "measured", "tolerance", "doubt"):
            value = float(readings(name, given := getattr(self, name), ()))
            if name in ("theory", "tolerance") and math.isinf(value):
                raise ValueError(f"{name} is {shown(given)}; it must be finite")
            if name in ("tolerance", "doubt") and value < 0:
                raise ValueError(f"{name} is {shown(given)}; it must not be negative")
            object.__setattr__(self, name, value)

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
    instance("result", result, Check)
    readings("difference", difference, ())
    chosen("sign", sign, ("", "+"))
    share = 100 * difference / abs(result.theory) if result.theory else difference
    return f"{float(f'{share:.2g}'):{sign}g} {'%' if result.theory else result.unit}".rstrip()


@refusing_unknown
def within(
    share: float, quantity: str, theory: float, measured: float, unit: str, doubt: float = 0.0
) -> Check:
    """Return a check whose tolerance and doubt are relative to the value of theory."""
    number("share", share, 0.0)
    scale = abs(float(readings("theory", theory, ())))
    doubt = float(readings("doubt", doubt, ()))
    return Check(quantity, theory, measured, share * scale, unit, doubt * scale)


def slack(recording: Recording, rate: float) -> float:
    """Return a bound of the relative error of a body's moments against a rigid one: 2 ε + (rate h)^order.

    ε is the largest strain of any spring in the run, which falls as 1/k; moments of inertia scale with the
    square of lengths. ``rate`` [rad/s] is the fastest rotation: faster vibrations are about an equilibrium
    that every method has exactly.
    """
    instance("recording", recording, Recording)
    rate = float(readings("rate", rate, ()))
    strain = float(recording.measures.strain.max())
    return 2 * strain + (abs(rate) * recording.step) ** recording.integrator.order


def spread(of: Callable[..., float], *arguments: float, by: float) -> float:
    """Return the sum of the changes of a value if each of its arguments has the relative error ``by``."""
    function("of", of)
    for n, argument in enumerate(arguments):
        readings(f"arguments[{n}]", argument, ())
    readings("by", by, ())
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
    return float(np.linalg.norm(instance("recording", recording, Recording).plan.scene.gravity or 0.0))


def turning_rate(recording: Recording) -> float:
    """Return the largest |ω| of the run [rad/s]."""
    omega = np.linalg.norm(instance("recording", recording, Recording).measures.angular_velocity, axis=1)
    return float(np.nanmax(omega)) if np.isfinite(omega).any() else 0.0


def _samples(times: object, values: object) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values (T,) as arrays, after checking them."""
    checked = array("times", times, (None,))
    return checked, readings("values", values, checked.shape)


def crossings(times: np.ndarray, values: np.ndarray, rising: bool | None = None) -> np.ndarray:
    """Return times at which samples pass through zero, by cubics through four of them, if there are four.

    Where one of the four is not finite, by a line through the two beside the zero.

    Parameters
    ----------
    times, values : (T,)
        At equal intervals.
    rising
        Whether to return only upward (True) or only downward (False) crossings; both if None.
    """
    times, values = _samples(times, values)
    if rising is not None:
        flag("rising", rising)
    if len(times) < 4:
        return np.zeros(0)
    seen = np.isfinite(values)
    up = (values[:-1] < 0) & (values[1:] >= 0)
    down = (values[:-1] > 0) & (values[1:] <= 0)
    wanted = up | down if rising is None else up if rising else down
    found = []
    for n in np.flatnonzero(wanted & seen[:-1] & seen[1:]).tolist():
        first = min(max(n - 1, 0), len(times) - 4)
        four = slice(first, first + 4)
        roots: np.ndarray = np.zeros(0)
        if seen[four].all():
            roots = np.polynomial.Polynomial.fit(np.arange(4.0), values[four], 3).roots()
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
    times, values = _samples(times, values)
    n = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1
    before = values[n - 1]
    here = values[n]
    after = values[n + 1]
    slope = (after - before) / 2
    bend = before - 2 * here + after
    shift = -slope / bend
    return times[n] + shift * (times[1] - times[0]), here + slope * shift / 2
