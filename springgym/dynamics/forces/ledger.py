"""The energy ledger: the work done on each body, and the energy it loses to dampers, contact and friction.

Kinetic + potential energy − work + damping + contact + friction stays constant, to the integrator's order.
A ledger of None records nothing and costs nothing.
"""

from __future__ import annotations

from enum import IntEnum

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number
from springgym.core.language.memory import load, store


class LedgerEntry(IntEnum):
    """The entries of the ledger of a body [J]."""

    WORK = 0
    """the work of actuators"""
    DAMPING = 1
    """the loss to dampers"""
    CONTACT = 2
    """the loss to restitution"""
    FRICTION = 3
    """the loss to friction"""


LEDGER_ENTRIES = len(LedgerEntry)


@compiled
def record(ledger: Ledger, entry: LedgerEntry, energy: Number) -> None:
    """Add an energy [J] to an entry."""
    if ledger is not None:
        store(ledger, entry, load(ledger, entry) + energy)
