"""The energy ledger: the work done on a copy and its losses, by kind.

Kinetic + potential energy − work + damping + contact + friction stays constant, to the integrator's order.
A ledger of None records nothing and costs nothing.
"""

from __future__ import annotations

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number
from springgym.core.language.memory import load, store

WORK, DAMPING, CONTACT, FRICTION = range(4)
ENTRIES = 4


@compiled
def record(ledger: Ledger, entry: int, energy: Number) -> None:
    """Add an energy [J] to an entry: `WORK` of actuators, or one of the three losses."""
    if ledger is not None:
        store(ledger, entry, load(ledger, entry) + energy)
