"""Totals of each pair of bodies that collide, over all nodes since they were reset."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.core.compiler.decorators import compiled, kernel
from springgym.core.language.blocks import numbers, set_copies, to_copies
from springgym.core.language.kinds import Mask, Number, Numbers
from springgym.core.language.lanes import any_lane, maximum, minimum, select
from springgym.core.language.memory import load, store
from springgym.dynamics.records import FAR, PAIR_TOTALS, Collisions, ContactCount, ContactRows, PairTotal

RESOLVED = 1.0
"""Largest motion of a contact in a step, in Δ: a faster one passes the barrier before it acts."""

AT_THE_NODE = (PairTotal.TOUCHING, PairTotal.ENERGY)
"""The totals that hold for the last node alone."""


class PairReadings(NamedTuple):
    """Totals of pairs, (copies, pairs), in the order of `Scene.meetings`."""

    touching: np.ndarray
    """whether the bodies pushed each other at the last node"""
    impulse: np.ndarray
    """the sum of all impulses along normals [N·s]"""
    min_gap: np.ndarray
    """the least gap of any contact [m]; infinite if none was near"""
    energy: np.ndarray
    """energy in the barriers between them [J]"""
    contact_loss: np.ndarray
    """energy lost to restitution [J]"""
    friction_loss: np.ndarray
    """energy lost to friction [J]"""
    late_contacts: np.ndarray
    """number of contacts that were found late, in a step or a read state whose bodies (almost) overlapped"""
    coarse_contacts: np.ndarray
    """number of contacts, each counted in every step, that were too fast to keep their restitution, see
    `springgym.simulator.Simulator.max_impact_speed`"""
    overflow: np.ndarray
    """number of contacts that were left out: arrays were full, or bodies too fast for the search"""
    fastest: np.ndarray
    """the largest speed of approach, along the normal, of any contact that pushed [m/s]"""


@compiled
def entry_of(changing: np.ndarray, n: int) -> int:
    """Return entry ``n`` of a list that all copies of a block share."""
    return changing[n]["lanes"][0]


@compiled
def set_entry(changing: np.ndarray, n: int, value: int) -> None:
    """Set entry ``n`` of a list that all copies of a block share."""
    changing[n]["lanes"][0] = value


@compiled
def list_changing(contacts: ContactRows, totals: Numbers, changing: np.ndarray) -> None:
    """List the pairs that have contacts, or touched at the last node.

    Entry 0 of ``changing`` is their number; the pairs follow from entry 1 on, in ascending order.
    """
    count = 0
    for n in range(1, entry_of(changing, 0) + 1):
        p = entry_of(changing, n)
        touching = load(totals, p * PAIR_TOTALS + PairTotal.TOUCHING)
        energy = load(totals, p * PAIR_TOTALS + PairTotal.ENERGY)
        # an energy that is NaN counts as contact
        if any_lane(select(energy <= 0.0, touching, 1.0 + 0.0 * touching) > 0.5):
            count += 1
            set_entry(changing, count, p)
    at = 1
    for n in range(contacts.length[ContactCount.PAIRS]):
        p = contacts.touching_pairs[n]
        while at <= count and entry_of(changing, at) < p:
            at += 1
        if at > count or entry_of(changing, at) != p:
            for m in range(count, at - 1, -1):
                set_entry(changing, m + 1, entry_of(changing, m))
            set_entry(changing, at, p)
            count += 1
    set_entry(changing, 0, count)


@compiled
def clear_current(where: Mask, totals: Numbers, changing: np.ndarray) -> None:
    """Set `AT_THE_NODE` to 0 in the copies ``where``."""
    for m in range(1, entry_of(changing, 0) + 1):
        p = entry_of(changing, m)
        for entry in AT_THE_NODE:
            n = p * PAIR_TOTALS + entry
            store(totals, n, select(where, 0.0, load(totals, n)))


@compiled
def add_to(totals: Numbers, pair: int, entry: int, value: Number) -> None:
    """Add ``value`` to the total ``entry`` of a pair, in its unit."""
    n = pair * PAIR_TOTALS + entry
    store(totals, n, load(totals, n) + value)


@compiled
def set_fastest(speed: Number, pair: int, totals: Numbers | None) -> None:
    """Set the largest normal speed of a pair [m/s] to ``speed`` in the copies where that is larger."""
    if totals is not None:
        n = pair * PAIR_TOTALS + PairTotal.FASTEST
        store(totals, n, maximum(load(totals, n), speed))


@compiled
def set_touching(touches: Mask, pair: int, totals: Numbers) -> None:
    """Mark a pair as touching in the copies where ``touches`` holds."""
    n = pair * PAIR_TOTALS + PairTotal.TOUCHING
    store(totals, n, select(touches, 1.0, load(totals, n)))


@compiled
def set_least_gap(gap: Number, pair: int, totals: Numbers) -> None:
    """Set the least gap of a pair [m] to ``gap`` in the copies where that is smaller."""
    n = pair * PAIR_TOTALS + PairTotal.GAP
    store(totals, n, minimum(load(totals, n), gap))


# --- Of all copies --------------------------------------------------------------------------------------


def read_pairs(totals: np.ndarray | None, copies: int, pairs: int | None = None) -> PairReadings:
    """Return the totals of the first ``pairs`` of some copies; of all pairs if None."""
    if totals is None:
        return PairReadings(*np.zeros((PAIR_TOTALS, copies, 0)))
    values = to_copies(totals, copies).reshape(copies, -1, PAIR_TOTALS)[:, :pairs].astype(float)
    entries = dict(zip(PairReadings._fields, np.moveaxis(values, -1, 0), strict=True))
    least = entries["min_gap"]
    return PairReadings(
        **entries
        | {"touching": entries["touching"] > 0, "min_gap": np.where(least < 0.5 * FAR, least, np.inf)}
    )


@kernel
def mark_unresolved(
    totals: np.ndarray, reach: np.ndarray, step: float, found: np.ndarray, coarse: np.ndarray
) -> None:
    """Mark the copies, ``found`` (copies,), with contacts that a step [s] cannot resolve.

    Set ``coarse`` (copies,) to the number of contacts that were too fast to keep their restitution. The first
    block of ``totals`` (blocks, pairs × `PAIR_TOTALS`, copies of a block) begins with the first of
    these copies; ``reach`` (pairs,) is Δ [m].
    """
    width = totals.shape[2]
    for copy in range(found.size):
        own = totals[copy // width]
        lane = copy % width
        found[copy] = False
        coarse[copy] = 0
        for p in range(reach.size):
            entry = p * PAIR_TOTALS
            coarse[copy] += int(own[entry + PairTotal.COARSE, lane])
            wrong = own[entry + PairTotal.MISSES, lane] + own[entry + PairTotal.OVERFLOW, lane] > 0.0
            if wrong or own[entry + PairTotal.FASTEST, lane] > RESOLVED / step * reach[p]:
                found[copy] = True


def count_overlaps(collisions: Collisions, first: int, found: np.ndarray) -> None:
    """Count a miss for each copy, from ``first`` on, and pair where ``found`` (copies, pairs) is set."""
    lanes = numbers(collisions.totals)
    for n, pair in np.argwhere(found).tolist():
        block, lane = divmod(first + n, lanes.shape[-1])
        lanes[block, pair * PAIR_TOTALS + PairTotal.MISSES, lane] += 1.0


def forget_pairs(totals: np.ndarray) -> None:
    """Reset the totals of all pairs, except for `AT_THE_NODE`."""
    totals = numbers(totals)
    for entry in range(PAIR_TOTALS):
        if entry not in AT_THE_NODE:
            totals[:, entry::PAIR_TOTALS] = FAR if entry == PairTotal.GAP else 0.0


def find_changing(collisions: Collisions) -> None:
    """Rebuild the list of pairs that may touch from the totals, after these were set."""
    changing = numbers(collisions.changing)[:, :, 0]
    totals = numbers(collisions.totals)
    touching, energy = (totals[:, entry::PAIR_TOTALS] for entry in AT_THE_NODE)
    for row, apart in zip(changing, (touching <= 0.0) & (energy <= 0.0), strict=True):
        pairs = np.flatnonzero(~apart.all(axis=-1))
        row[0] = len(pairs)
        row[1 : 1 + len(pairs)] = pairs


def share_energy(collisions: Collisions) -> None:
    """Assign half of the energy in each pair's barriers to each of its bodies, after totals were set; as
    `springgym.dynamics.step` does after steps, in the same order."""
    pairs = collisions.pairs
    stored = numbers(collisions.stored)
    stored[:] = 0.0
    half = 0.5 * numbers(collisions.totals)[:, PairTotal.ENERGY : pairs.among * PAIR_TOTALS : PAIR_TOTALS]
    for p in np.flatnonzero((half != 0.0).any(axis=(0, 2))).tolist():
        stored[:, pairs.first[p]] += half[:, p]
        stored[:, pairs.second[p]] += half[:, p]


def empty_totals(collisions: Collisions, index: np.ndarray | slice) -> None:
    """Reset the totals of some copies (k,), and mark these copies as fresh."""
    row = np.zeros(collisions.totals.shape[1])
    row[PairTotal.GAP :: PAIR_TOTALS] = FAR
    for array, value in ((collisions.totals, row), (collisions.fresh, np.ones(1))):
        if isinstance(index, slice):
            numbers(array)[:] = value[:, None]
        else:
            set_copies(array, index, value)
