"""List the contacts of a node, one list for all kinds of features, and state what their impulses solve.

A row holds a contact of each copy, its own: row r the r-th of each. A copy that has less than others has a
gap of `FAR` there, and the particles of another. So the list is as long as the longest of a copy, and what a
copy has, and in which order, does not depend on the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from springgym.contact.law import Span
from springgym.contact.pairs import Pairs
from springgym.core.blocks import aligned_zeros
from springgym.core.compiling import compiled
from springgym.core.kinds import Number, Numbers, Rows
from springgym.core.lanes import load, store

if TYPE_CHECKING:
    from springgym.contact.solids import Solids
    from springgym.contact.spheres import Spheres

FAR = 1e9
"""Distance [m] of what is no contact, in a lane where another copy has one."""

MET, ROWS = range(2)
"""The list of pairs that have contacts, and the rows of contacts."""


class ContactRows(NamedTuple):
    """The contacts of a node, a row each, with the impulses that they give."""

    length: np.ndarray
    """(2,) how many pairs have contacts, `MET`, and how many rows of contacts there are, `ROWS`"""
    met: np.ndarray
    """(pairs,) list of the pairs that have contacts, in ascending order"""
    left_out: np.ndarray
    """(pairs,) how many contacts there was no space for, at this node"""
    have: np.ndarray
    """(2,) how many contacts each copy has: in all, and of the pair that is looked at"""
    pair: np.ndarray
    """(rows,) the pair of bodies that meet in this contact, the same in all copies"""
    members: np.ndarray
    """(rows,) the number of particles of the contact, the same in all copies"""
    particle: np.ndarray
    """(4 rows,) the indices of these particles"""
    weight: np.ndarray
    """(4 rows,) the weights w of these particles in the way from one body to the other; they sum to 0"""
    normal: np.ndarray
    """(rows, 3) the normal n, from the second body to the first"""
    gap: np.ndarray
    """(rows,) the gap d between both bodies [m]; `FAR` in copies without this contact"""
    share: np.ndarray
    """(rows,) the factor Φ, 0 to 1, by which the strength c is multiplied where edges meet"""
    approach: np.ndarray
    """(rows,) the speed u₀ along the normal before the node [m/s]"""
    gain: np.ndarray
    """(4 rows,) w/m [1/kg]"""
    inverse_mass: np.ndarray
    """(rows,) the inverse mass W along the normal [1/kg]"""
    impulse: np.ndarray
    """(rows,) the impulse J along the normal [N·s]"""
    friction: np.ndarray
    """(rows, 3) the impulse of friction [N·s]"""
    couple: np.ndarray
    """(rows, 3) the angular impulse of the couple on the first body of the pair [N·m·s]"""
    taper: np.ndarray
    """(rows, 3) the impulse of the gradient of Φ [N·s]"""
    tilt: np.ndarray
    """(2 rows, 3) G and H; of a rod, G and the direction along it: see `springgym.contact.friction`"""
    grips: np.ndarray
    """(rows,) 1 where friction acts, else 0"""
    losses: np.ndarray
    """(pairs, 3) energy that a pair lost at this node: see `add_loss` [J]"""
    solids: Solids | None
    """the rigid bodies that contacts move; None where particles move by themselves"""
    spheres: Spheres | None = None
    """the spheres that turn, among bodies of springs; None if there are none"""


class Problem(NamedTuple):
    """All that the impulses of the contacts of a node follow from."""

    span: Span
    """the time of the node"""
    rows: int
    """how many rows of contacts there are"""
    x: Rows
    """(N, 3) positions of all particles at the node [m]"""
    before: Rows
    """(N, 3) velocities before it [m/s]; of rigid bodies, as `springgym.contact.solids.Solids` has them"""
    inverse_mass: Numbers
    """(N,) the inverse masses of the particles [1/kg]"""
    pairs: Pairs
    """the pairs of bodies, and what they are like"""
    contacts: ContactRows
    """the contacts, and where their impulses are written"""
    totals: Numbers
    """the totals of each pair, see `springgym.contact.totals`"""


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
