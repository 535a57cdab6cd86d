"""The kick that splitting methods share: forces and actuators act at once."""

from __future__ import annotations

from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Rows
from springgym.forces import act, kick
from springgym.terms import Terms


@compiled
def kick_and_act(v: Rows, a: Rows, b: Rows, tau: Number, ledger: Ledger, terms: Terms) -> None:
    """Forces ``a`` and actuators ``b`` act for ``tau`` seconds, at once: with half of the kick on either
    side the actuators' work is that of the exact flow, so that the ledger closes to the method's order."""
    actuated = terms.wrench is not None or terms.thrust is not None
    kick(v, a, 0.5 * tau if actuated else tau)
    act(v, b, tau, ledger, terms)
    if actuated:
        kick(v, a, 0.5 * tau)
