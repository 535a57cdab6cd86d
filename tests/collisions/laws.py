"""The laws of a contact called from Python, for arrays of numbers."""

from __future__ import annotations

from typing import Any

from springgym.compiling import kernel
from springgym.forces.pairs.law import meet, meet_losing
from springgym.lanes import load, store


@kernel
def met(start: Any, free: Any, span: Any, c: Any, reach: Any, damping: Any, found: Any) -> None:
    for n in range(start.size):
        store(found, n, meet(load(start, n), load(free, n), span, load(c, n), reach))


@kernel
def met_losing(
    start: Any, free: Any, span: Any, c: Any, reach: Any, damping: Any, found: Any, lost: Any
) -> None:
    for n in range(start.size):
        change, less = meet_losing(load(start, n), load(free, n), span, load(c, n), reach, load(damping, n))
        store(found, n, change)
        store(lost, n, less)
