"""Cycles of steps, in which dampers and the wrench act less often than at every step.

A cycle is an even number of steps of velocity Verlet. The wrench acts by Simpson's rule: for a sixth of a
cycle at each of its ends, and for the rest in its middle. Dampers act once per cycle for all of its time,
after the first step of one cycle and before the last of the next, so that no vibration is always damped at
the same phase; likewise at nodes, which are in the middle of steps. Two cycles are symmetric in time, and so
of second order.

A call takes whole cycles: the state is read, and actions change, at the end of a cycle. Which of two cycles
comes next may differ between copies, as copies that are placed begin with the first.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Mask, Number, Rows
from springgym.core.language.lanes import any_lane, select
from springgym.core.language.memory import load, store
from springgym.dynamics.forces.actuators import push, set_actuation
from springgym.dynamics.forces.springs import damp
from springgym.dynamics.terms import Cycle, Terms

FIRST = 1
"""Number of steps after which dampers act in the first of two cycles."""

END = 1 / 6
"""Fraction of a cycle for which the wrench acts at each end, by Simpson's rule."""

MIDDLE = 2 / 3
"""Fraction of a cycle for which it acts in the middle."""


def cycle(every: int, nodes: bool, blocks: Callable[..., np.ndarray]) -> Cycle:
    """Return the `Cycle` of copies at the beginning of one; dampers act at ``nodes``, or between steps."""
    return Cycle(every, 2 * every - FIRST - nodes, blocks(1))


@compiled
def count_step(cycle: Cycle | None) -> None:
    """Advance the phase of all copies by a step, if dampers act in cycles."""
    if cycle is not None:
        after = load(cycle.marks, 0) + 1.0
        store(cycle.marks, 0, select(after >= 2 * cycle.every, 0.0, after))


@compiled
def damps_now(backward: bool, cycle: Cycle) -> Mask:
    """Return the mask of copies in which dampers act now: ``backward`` after a first step, else forward."""
    off = load(cycle.marks, 0) - (FIRST if backward else cycle.second)
    return off * off < 0.25


@compiled
def damps_somewhere(cycle: Cycle | None) -> bool:
    """Return whether dampers act before the next step in any copy; True without cycles."""
    if cycle is None:
        return True
    return any_lane(damps_now(True, cycle)) or any_lane(damps_now(False, cycle))


@compiled
def relax_in_turn(v: Rows, direction: Rows, backward: bool, ledger: Ledger, terms: Terms) -> None:
    """Apply the dampers to the copies in which they act now."""
    among = damps_now(backward, terms.cycle)
    if any_lane(among):
        damp(v, direction, terms.springs, terms.dampers, None, ledger, backward, True, among)


@compiled
def apply_wrench(
    x: Rows, v: Rows, b: Rows, n: int, steps: int, h: Number, ledger: Ledger, terms: Terms
) -> None:
    """Apply the wrench after ``n`` of ``steps``: at the end or beginning of a cycle, or in its middle."""
    if terms.wrench is not None:
        every = terms.cycle.every
        ends = n % every == 0
        tau = (END if ends else MIDDLE) * (every * h)
        set_actuation(x, b, terms.particles, None, terms.wrench, None, None)
        for _ in range(2 if ends and 0 < n < steps else 1):
            push(v, b, tau, terms.particles, terms.wrench, None, ledger)
