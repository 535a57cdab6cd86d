"""The parts that splitting methods share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Rows
from springgym.forces import act, kick

if TYPE_CHECKING:
    from springgym.forces import Terms
    from springgym.forces.actuators import Thrust, Wrench


@compiled
def kick_and_act(v: Rows, a: Rows, b: Rows, tau: Number, ledger: Ledger, terms: Terms) -> None:
    """Let forces ``a`` and actuators ``b`` act for ``tau`` seconds, at once: with half of the kick on either
    side the actuators' work is that of the exact flow, so that the ledger closes to the method's order."""
    kick_amid(v, a, b, tau, ledger, terms, terms.wrench, terms.thrust)


@compiled
def kick_amid(
    v: Rows,
    a: Rows,
    b: Rows,
    tau: Number,
    ledger: Ledger,
    terms: Terms,
    wrench: Wrench | None,
    thrust: Thrust | None,
) -> None:
    if wrench is None and thrust is None:
        kick(v, a, tau)
        act(v, b, tau, ledger, terms)
    else:
        kick(v, a, 0.5 * tau)
        act(v, b, tau, ledger, terms)
        kick(v, a, 0.5 * tau)
