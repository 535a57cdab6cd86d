"""Splitting methods from tables of their coefficients: drifts, and kicks that include actuators."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number, Rows
from springgym.dynamics.forces import accelerate, act, actuate, drift, kick
from springgym.dynamics.terms import Terms


def splitting(drifts: tuple[float, ...], kicks: tuple[float, ...]) -> Callable[..., None]:
    """Return the method that alternates drifts and kicks of these fractions of a step.

    It begins and ends with the kind that has one more; the last of a step is merged with the next.
    """
    stages = min(len(drifts), len(kicks))
    drifts_first = len(drifts) > len(kicks)

    @compiled
    def integrate(
        x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, h: Number, steps: int, terms: Terms
    ) -> None:
        a = workspace[0]
        b = workspace[1]
        direction = workspace[2]
        last = stages * steps
        for n in range(last + 1):
            stage = n % stages
            times = 2.0 if stage == 0 and 0 < n < last else 1.0
            if drifts_first:
                drift(x, v, h * (times * drifts[stage]))
            if n < last or not drifts_first:
                accelerate(x, a, direction, terms)
                actuate(x, b, terms)
                share = kicks[stage] if drifts_first else times * kicks[stage]
                kick_and_act(v, a, b, h * share, ledger, terms)
            if n < last and not drifts_first:
                drift(x, v, h * drifts[stage])

    return integrate


@compiled
def kick_and_act(v: Rows, a: Rows, b: Rows, tau: Number, ledger: Ledger, terms: Terms) -> None:
    """Apply forces ``a`` and actuators ``b`` for ``tau`` seconds: with half of the kick before and after, the
    actuators' work is that of the exact flow, so that the ledger closes to the method's order."""
    actuated = terms.wrench is not None or terms.thrust is not None
    kick(v, a, 0.5 * tau if actuated else tau)
    act(v, b, tau, ledger, terms)
    if actuated:
        kick(v, a, 0.5 * tau)
