"""Keep totals of each pair of bodies that collide, over the nodes since they were emptied.

The next call makes the last node anew, so that the totals from before it are kept, too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.contact.records import (
    CONTACT,
    ENERGY,
    ENTRIES,
    FAR,
    FASTEST,
    FRICTION,
    GAP,
    IMPULSE,
    MET,
    MISSES,
    OVERFLOW,
    TOUCHING,
    Collisions,
    ContactRows,
)
from springgym.core.blocks import numbers, set_copies, to_copies
from springgym.core.compiling import compiled, kernel
from springgym.core.kinds import Number, Numbers
from springgym.core.lanes import any_lane, load, select, store

RESOLVED = 1.0
"""Share of Δ that a contact may move by in a step: what is faster is not in reach before it is through."""


class PairReadings(NamedTuple):
    """Totals of pairs, (copies, pairs), in the order of `Scene.meetings`."""

    touching: np.ndarray
    """whether anything pushes at the node where the state is read"""
    impulse: np.ndarray
    """the sum of all impulses along normals, up to this node and half of what it gives [N·s]"""
    least_gap: np.ndarray
    """the least distance that any contact had [m]; infinite if none was near"""
    energy: np.ndarray
    """in the barriers between them, the mean before and after the node [J]"""
    contact_loss: np.ndarray
    """what was lost to restitution [J]"""
    friction_loss: np.ndarray
    """and to friction [J]"""
    misses: np.ndarray
    """how often a contact was found when the bodies were in each other already, or almost, or were read so"""
    too_fast: np.ndarray
    """how often one came faster than it is computed well for: a fifth of Δ in a step"""
    overflow: np.ndarray
    """how often one was left out for want of space"""
    fastest: np.ndarray
    """the largest speed along its normal that any contact which pushes was reached with [m/s]"""


@compiled
def entry_of(changing: np.ndarray, n: int) -> int:
    """Return a number of a list that all copies of a block share."""
    return changing[n]["lanes"][0]


@compiled
def set_entry(changing: np.ndarray, n: int, value: int) -> None:
    """Set a number of a list that all copies of a block share."""
    changing[n]["lanes"][0] = value


@compiled
def list_changing(contacts: ContactRows, changing: np.ndarray) -> None:
    """Add the pairs that have contacts to those whose totals change."""
    count, at = entry_of(changing, 0), 1
    for n in range(contacts.length[MET]):
        p = contacts.met[n]
        while at <= count and entry_of(changing, at) < p:
            at += 1
        if at > count or entry_of(changing, at) != p:
            for m in range(count, at - 1, -1):
                set_entry(changing, m + 1, entry_of(changing, m))
            set_entry(changing, at, p)
            count += 1
    set_entry(changing, 0, count)


@compiled
def add_to(totals: Numbers, pair: int, entry: int, value: Number) -> None:
    """Add to an entry of a pair."""
    n = pair * ENTRIES + entry
    store(totals, n, load(totals, n) + value)


@compiled
def resume_totals(phase: Number, collisions: Collisions | None) -> None:
    """Put the totals, if bodies collide, back to what they were before the last node, but of fresh copies."""
    if collisions is not None:
        for m in range(1, entry_of(collisions.changing, 0) + 1):
            first = entry_of(collisions.changing, m) * ENTRIES
            for n in range(first, first + ENTRIES):
                total, before = load(collisions.totals, n), load(collisions.totals_before, n)
                store(collisions.totals, n, select(phase < 0.5, total, before))


@compiled
def remember_totals(collisions: Collisions | None) -> None:
    """Remember the totals, if bodies collide, before the last node; those of pairs that are apart stay."""
    if collisions is not None:
        kept, totals = 0, collisions.totals
        for m in range(1, entry_of(collisions.changing, 0) + 1):
            p = entry_of(collisions.changing, m)
            first = p * ENTRIES
            for n in range(first, first + ENTRIES):
                store(collisions.totals_before, n, load(totals, n))
            touching, energy = load(totals, first + TOUCHING), load(totals, first + ENERGY)
            # be it no number
            if any_lane(select(energy <= 0.0, touching, 1.0 + 0.0 * touching) > 0.5):
                kept += 1
                set_entry(collisions.changing, kept, p)
        set_entry(collisions.changing, 0, kept)


@compiled
def halve_totals(collisions: Collisions | None) -> None:
    """Leave half of the impulses and losses that the node added, if bodies collide."""
    if collisions is not None:
        for m in range(1, entry_of(collisions.changing, 0) + 1):
            p = entry_of(collisions.changing, m)
            for entry in (IMPULSE, CONTACT, FRICTION):
                n = p * ENTRIES + entry
                both = load(collisions.totals_before, n) + load(collisions.totals, n)
                store(collisions.totals, n, 0.5 * both)


# --- Of all copies --------------------------------------------------------------------------------------


def read_pairs(collisions: Collisions | None, copies: int) -> PairReadings:
    """Return the totals of all pairs of some copies."""
    if collisions is None:
        return PairReadings(*np.zeros((ENTRIES, copies, 0)))
    found = to_copies(collisions.totals, copies).reshape(copies, -1, ENTRIES).astype(float)
    entries = dict(zip(PairReadings._fields, np.moveaxis(found, -1, 0), strict=True))
    least = entries["least_gap"]
    return PairReadings(
        **entries
        | {"touching": entries["touching"] > 0, "least_gap": np.where(least < 0.5 * FAR, least, np.inf)}
    )


def resolved_speeds(collisions: Collisions, step: float) -> np.ndarray:
    """Return the largest speed [m/s] of a contact that a step [s] resolves, of each pair (pairs,)."""
    return RESOLVED / step * collisions.pairs.reach


@kernel
def tell_unresolved(totals: np.ndarray, reach: np.ndarray, step: float, found: np.ndarray) -> None:
    """Tell in which copies, ``found`` (copies,), bodies met in a way that a step [s] cannot resolve.

    The ``totals`` (blocks, pairs × `ENTRIES`, copies of a block) are of blocks that begin with the first of
    these copies; the ``reach`` (pairs,) is Δ [m].
    """
    width = totals.shape[2]
    for copy in range(found.size):
        own, lane = totals[copy // width], copy % width
        found[copy] = False
        for p in range(reach.size):
            entry = p * ENTRIES
            wrong = own[entry + MISSES, lane] + own[entry + OVERFLOW, lane] > 0.0
            if wrong or own[entry + FASTEST, lane] > RESOLVED / step * reach[p]:
                found[copy] = True


def count_shown(collisions: Collisions, first: int, found: np.ndarray) -> None:
    """Count as a miss of each copy, from the ``first`` on, and pair that it is shown in each other."""
    for array in (collisions.totals, collisions.totals_before):
        lanes = numbers(array)
        for n, pair in np.argwhere(found).tolist():
            block, lane = divmod(first + n, lanes.shape[-1])
            lanes[block, pair * ENTRIES + MISSES, lane] += 1.0


def forget_pairs(collisions: Collisions) -> None:
    """Empty the totals; of the last node, which the next call makes anew, half is left to be told."""
    totals, before = numbers(collisions.totals), numbers(collisions.totals_before)
    before -= totals
    kept = [TOUCHING, ENERGY]
    for entry in range(ENTRIES):
        if entry not in kept:
            totals[:, entry::ENTRIES] = 0.0
    for array in (totals, before):
        array[:, GAP::ENTRIES] = FAR
        array[:, FASTEST::ENTRIES] = 0.0


def find_changing(collisions: Collisions) -> None:
    """Find from the totals, which were set, the pairs whose totals change."""
    changing = numbers(collisions.changing)[:, :, 0]
    totals, before = (
        by_pairs.reshape(len(changing), -1, ENTRIES, by_pairs.shape[-1])
        for by_pairs in (numbers(collisions.totals), numbers(collisions.totals_before))
    )
    rests = (totals == before).all(axis=(2, 3))
    rests &= (totals[:, :, TOUCHING] <= 0.0).all(axis=-1) & (totals[:, :, ENERGY] <= 0.0).all(axis=-1)
    for row, own in zip(changing, rests, strict=True):
        pairs = np.flatnonzero(~own)
        row[0], row[1 : 1 + len(pairs)] = len(pairs), pairs


def empty_totals(collisions: Collisions, index: np.ndarray | slice) -> None:
    """Let some copies (k,) begin with empty totals."""
    for array in (collisions.totals, collisions.totals_before):
        row = np.zeros(array.shape[1])
        row[GAP::ENTRIES] = FAR
        numbers_of = numbers(array)
        if isinstance(index, slice):
            numbers_of[:] = row[:, None]
        else:
            set_copies(array, index, row)
