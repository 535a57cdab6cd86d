"""The energy ledger: what went in and out of a copy, entry by entry.

Kinetic + potential energy − work + damping + contact + friction stays constant, to the integrator's order.
A ledger of None records nothing and costs nothing.
"""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.lanes import load, store

WORK, DAMPING, CONTACT, FRICTION, HELD = range(5)
ENTRIES, ROOM = 4, 5
"""`HELD` is no entry: what contact holds at a node beside the energy of its barriers, while it is read."""



@compiled
def record(ledger: Any, entry: Any, energy: Any) -> None:
    """Add an energy [J] to an entry: `WORK` done by actuators, or lost to the other three."""
    if ledger is not None:
        store(ledger, entry, load(ledger, entry) + energy)
