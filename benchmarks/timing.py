"""Rates of several programs, measured in turn; and methods, run on a problem with steps of many lengths."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from benchmarks.conditions import progress
from springgym.model.bodies.distances import largest_distance
from springgym.model.scene import Scene


class Case(NamedTuple):
    """Something to measure."""

    what: Mapping[str, Any]
    """what it is: together these name it"""
    run: Callable[[], object]
    units: float
    """of work in a run"""
    begin: Callable[[], object] = lambda: None
    """called before each run, in no one's time"""
    facts: Mapping[str, Any] = {}
    """what is to stand beside its speed, the error above all"""


class Row(NamedTuple):
    """The measurements of a case."""

    what: Mapping[str, Any]
    median: float
    low: float
    high: float
    unit: str
    facts: Mapping[str, Any]

    def flat(self) -> dict[str, Any]:
        """Return the row as one dict, for JSON."""
        speed = {"median": self.median, "low": self.low, "high": self.high, "unit": self.unit}
        return {**self.what, **speed, **self.facts}

    def __str__(self) -> str:
        number = ",.0f" if self.median >= 100 else ",.3g"
        text = f"{named(self.what):58} {self.median:>13{number}} {self.unit}"
        text += f" ({self.low:{number}} … {self.high:{number}})"
        facts = [
            value if isinstance(value, str) else f"{name.replace('_', ' ')} {value:.3g}"
            for name, value in self.facts.items()
        ]
        return f"{text}  {', '.join(facts)}".rstrip()


def named(what: Mapping[str, Any]) -> str:
    """Return in words what is measured."""
    return ", ".join(value if isinstance(value, str) else f"{name} {value}" for name, value in what.items())


def measured(cases: Iterable[Case], rounds: int, unit: str, seconds: float = 0.02) -> list[Row]:
    """Median, lowest and highest of the `rates` of each case over ``rounds`` rounds."""
    cases = list(cases)
    return [
        row_over(case.what, own, unit, case.facts)
        for case, own in zip(cases, rates(cases, rounds, seconds), strict=True)
    ]


def row_over(what: Mapping[str, Any], rounds: Sequence[float], unit: str, facts: Mapping[str, Any]) -> Row:
    """Return the row of what was found in each round."""
    return Row(what, median(rounds), min(rounds), max(rounds), unit, facts)


def rates(cases: Sequence[Case], rounds: int, seconds: float = 0.02) -> list[list[float]]:
    """Return the rate of each case in each of ``rounds`` rounds, in which they take turns.

    On a shared machine speeds drift: what is to be compared runs side by side. Each case runs once
    before it counts, which compiles it, and is repeated within a round until about ``seconds`` have passed.
    """
    repeats = []
    for case in progress(cases, "compiling"):
        _spent(case, 1)
        repeats.append(max(1, round(seconds / _spent(case, 1))))
    seen: list[list[float]] = [[] for _ in cases]
    for _ in progress(range(rounds), "rounds"):
        for case, times, own in zip(cases, repeats, seen, strict=True):
            own.append(case.units * times / _spent(case, times))
    return seen


def _spent(case: Case, times: int) -> float:
    """Seconds that this many runs take."""
    spent = 0.0
    for _ in range(times):
        case.begin()
        started = time.perf_counter()
        case.run()
        spent += time.perf_counter() - started
    return spent


# --- Methods on a problem -----------------------------------------------------------------------------

SAMPLES = 4
"""Times at which positions are compared: a quarter, half, three quarters and the end."""

FAILED = 0.1
"""An error above this, or none that is a number, is a failure."""


class Rung(NamedTuple):
    """A method at a step or tolerance, ready to be run."""

    method: str
    step: float
    """h [s]; of an adaptive method, its tolerance"""
    run: Callable[[], tuple[np.ndarray, float, float]]
    """gives positions (samples, N, 3) [m], force evaluations per simulated second, wall time [s] of it"""
    begin: Callable[[], object]
    """puts it to its start"""
    piece: Callable[[float], tuple[Callable[[], object], float]]
    """of the wall time of the whole: a part to time, and how long it is in simulated time [s]"""


class Stepper(NamedTuple):
    """A program that takes steps of one length."""

    begin: Callable[[], object]
    """puts it to its start"""
    advance: Callable[[int], object]
    positions: Callable[[], np.ndarray]
    """(N, 3) [m]"""
    evaluations: Callable[[int], float]
    """force evaluations since its start, which was so many steps ago"""


def rung_of(
    method: str, step: float, count: int, program: Stepper, *, samples: int = SAMPLES, longest: float = 2e-3
) -> Rung:
    """Make a rung of ``count`` steps [s], which is timed in pieces of about ``longest`` [s]."""

    def run() -> tuple[np.ndarray, float, float]:
        program.begin()
        positions = []
        started = time.perf_counter()
        for _ in range(samples):
            program.advance(count // samples)
            positions.append(program.positions())
        wall = time.perf_counter() - started
        return np.array(positions), program.evaluations(count) / (count * step), wall

    def piece(wall: float) -> tuple[Callable[[], object], float]:
        steps = max(1, min(count, int(count * longest / wall)))
        return lambda: program.advance(steps), steps * step

    return Rung(method, step, run, program.begin, piece)


def rows_of(rungs: Sequence[Rung], exact: np.ndarray, scene: Scene, runs: int) -> list[dict[str, Any]]:
    """Return the error and cost of each rung; their timed runs take turns."""
    ran = []
    for rung in progress(rungs, "errors"):
        positions, evaluations, wall = rung.run()
        ran.append((rung, largest_distance(positions, exact, scene.sizes), evaluations, *rung.piece(wall)))
    costs: list[list[float]] = [[] for _ in ran]
    for _ in progress(range(runs), "costs"):
        for own, (rung, _, _, part, simulated) in zip(costs, ran, strict=True):
            rung.begin()
            started = time.perf_counter()
            part()
            own.append(1e6 * (time.perf_counter() - started) / simulated)
    return [
        row_of(rung.method, rung.step, error, evaluations, own)
        for own, (rung, error, evaluations, _, _) in zip(costs, ran, strict=True)
    ]


def row_of(method: str, step: float, error: float, evaluations: float, costs: list[float]) -> dict[str, Any]:
    """Return a row of a report; costs are µs per simulated second."""
    low, middle, high = np.percentile(costs, [25, 50, 75])
    return {
        "method": method,
        "step": step,
        "error": error if error < FAILED else None,
        "evaluations": evaluations,
        "cost": float(middle),
        "cost_quartiles": [float(low), float(high)],
        "runs": len(costs),
    }
