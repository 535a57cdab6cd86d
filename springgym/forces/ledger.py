"""The energy ledger: what went in and out of a copy, entry by entry.

Kinetic + potential energy − work + damping + contact + friction stays constant, to the integrator's order.
A ledger of None records nothing and costs nothing.
"""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.lanes import load, store

WORK, DAMPING, CONTACT, FRICTION, HELD, MET, LIFTS = range(7)
ENTRIES = 4
"""What follows is no entry, but what is kept of a node while it is read (`springgym.forces.node`): what contact
holds beside the energy of its barriers; 1 if the state was read off at a node, 0 if it was placed; and how far
each particle is lifted, 3 numbers each."""


def room(particles: int) -> int:
    """Numbers in the ledger of a body."""
    return LIFTS + 3 * particles


@compiled
def record(ledger: Any, entry: Any, energy: Any) -> None:
    """Add an energy [J] to an entry: `WORK` done by actuators, or lost to the other three."""
    if ledger is not None:
        store(ledger, entry, load(ledger, entry) + energy)
