"""Rates of several programs, measured in turn."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Mapping
from statistics import median
from typing import Any, NamedTuple

PATIENCE = 2.0
"""If the first run of a case takes longer than this [s], as where it compiles, a message says so."""


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
    """Median, lowest and highest rate of each case over ``rounds`` rounds, taken in turn.

    On a shared machine speeds drift: what is to be compared runs side by side. Each case runs once
    before it counts, and is repeated within a round until about ``seconds`` have passed. Cases that take long
    before they can be measured are told on stderr: they compile.
    """
    cases = list(cases)
    repeats = []
    for n, case in enumerate(cases, 1):
        started = time.perf_counter()
        _spent(case, 1)
        if (waited := time.perf_counter() - started) > PATIENCE:
            print(f"  {n} of {len(cases)} ready after {waited:.0f} s: {named(case.what)}", file=sys.stderr)
        repeats.append(max(1, round(seconds / _spent(case, 1))))
    seen: list[list[float]] = [[] for _ in cases]
    for _ in range(rounds):
        for case, times, own in zip(cases, repeats, seen, strict=True):
            own.append(case.units * times / _spent(case, times))
    return [
        Row(case.what, median(own), min(own), max(own), unit, case.facts)
        for case, own in zip(cases, seen, strict=True)
    ]


def _spent(case: Case, times: int) -> float:
    """Seconds that this many runs take."""
    spent = 0.0
    for _ in range(times):
        case.begin()
        started = time.perf_counter()
        case.run()
        spent += time.perf_counter() - started
    return spent
