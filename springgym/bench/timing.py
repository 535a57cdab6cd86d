"""Rates of several programs, measured in turn."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from statistics import median
from typing import NamedTuple


class Rate(NamedTuple):
    """Units of work a second."""

    median: float
    low: float
    high: float


Piece = tuple[Callable[[], object], float]
"""What is run, and how many units of work that is."""


def rates(pieces: Mapping[str, Piece], rounds: int, seconds: float = 0.02) -> dict[str, Rate]:
    """Median, lowest and highest rate of each piece over ``rounds`` rounds, taken in turn.

    On a shared machine speeds drift: what is to be compared runs side by side. Each piece runs once
    before it counts, and is repeated within a round until ``seconds`` have passed.
    """
    repeats = {}
    for name, (run, _) in pieces.items():
        run()
        started = time.perf_counter()
        run()
        repeats[name] = max(1, round(seconds / (time.perf_counter() - started)))
    seen: dict[str, list[float]] = {name: [] for name in pieces}
    for _ in range(rounds):
        for name, (run, units) in pieces.items():
            started = time.perf_counter()
            for _ in range(repeats[name]):
                run()
            seen[name].append(units * repeats[name] / (time.perf_counter() - started))
    return {name: Rate(median(values), min(values), max(values)) for name, values in seen.items()}
