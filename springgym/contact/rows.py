"""List the contacts of a node, one list for all kinds of features, and state what their impulses solve.

A row holds a contact of each copy, its own: row r the r-th of each. A copy that has less than others has a
gap of `FAR` there, and the particles of another. So the list is as long as the longest of a copy, and what a
copy has, and in which order, does not depend on the others.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike

from springgym.contact.records import ContactRows, Pairs
from springgym.core.blocks import aligned_zeros
from springgym.core.compiling import compiled
from springgym.core.kinds import Number
from springgym.core.lanes import load, store


def new_contacts(pairs: Pairs, rows: int, dtype: DTypeLike) -> ContactRows:
    """Return an empty list of contacts, on elements of ``dtype``; ``rows`` is the most a block can have.

    They move particles by themselves, until the list is given ``solids``.
    """
    width = np.dtype(dtype)["lanes"].shape[0]
    rows = min(rows, pairs.most * width) + 1
    rubbing = 1 if pairs.friction is None else rows
    turning = 1 if pairs.resistance is None else rows
    count = len(pairs.first)

    def lanes(*shape: int) -> np.ndarray:
        return aligned_zeros(shape, dtype)

    return ContactRows(
        met=np.zeros(count, np.int64),
        have=lanes(2),
        left_out=lanes(count),
        pair=np.zeros(rows, np.int32),
        members=np.zeros(rows, np.int32),
        particle=lanes(4 * rows),
        weight=lanes(4 * rows),
        normal=lanes(rows, 3),
        gap=lanes(rows),
        share=lanes(rows),
        approach=lanes(rows),
        gain=lanes(4 * rows),
        inverse_mass=lanes(rows),
        impulse=lanes(rows),
        friction=lanes(rows, 3),
        couple=lanes(turning, 3),
        taper=lanes(rows, 3),
        tilt=lanes(2 * rubbing, 3),
        grips=lanes(rubbing),
        losses=lanes(count, 3),
        length=np.zeros(2, np.int64),
        solids=None,
    )


@compiled
def add_loss(contacts: ContactRows, pair: int, kind: int, energy: Number) -> None:
    """Add to what a pair lost at this node: 0 to restitution, 1 to friction, 2 out of its barriers [J]."""
    store(contacts.losses, (pair, kind), load(contacts.losses, (pair, kind)) + energy)
