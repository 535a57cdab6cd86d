"""Warm start: the impulses of contacts start from those of the last node.

A sweep propagates impulses from one contact to the next. Starting from zero, a pile needs many sweeps before
lower bodies support upper ones. Starting from the impulses of the last step it needs few, and over several
steps the impulses of resting bodies converge.

Each copy stores the impulses of a node in a hash table, by contact. The key of a vertex is its pair and the
vertex, whichever face of the other body it touches; at a surface, also the surface; that of two edges is
their four ends. A contact that is not in the table starts from zero. All this is only a first guess, from
which sweeps solve for all impulses.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Mask, Number, Rows, Vector
from springgym.core.language.lanes import any_lane, maximum, rounded, select
from springgym.core.language.memory import load, load_each, store
from springgym.core.language.vectors import choose, dot, row, row_each, set_row, set_row_each
from springgym.dynamics.contact.features import put_where
from springgym.dynamics.contact.friction import crosses, push_across
from springgym.dynamics.contact.movers import push, push_turning
from springgym.dynamics.records import FAR, ContactCount, Pairs, Problem, WarmStart

ROWS_OF_A_BODY = 32
"""Least number of rows of the table per body: three times the contacts of a cube among others."""

PROBES = 64
"""Number of rows that are probed for a contact: its impulses are stored in the first empty one. If none is
empty, they are not stored; such a contact starts from zero at each node, and its impulse stays too small."""

OF_PAIR = 61.0
"""Factor of a pair's index in the hash that spreads contacts over the table."""

OF_ENDS = (17.0, 7.0, 5.0, 3.0)
"""Factors of the indices of a contact's four particles in this hash."""


class Key(NamedTuple):
    """A key identifies a contact, and gives the first row of the table to probe."""

    pair: int
    """the index of the pair, plus one"""
    first: Number
    others: Number
    place: Number
    """the first row to probe"""


def new_warm_start(pairs: Pairs, bodies: int, blocks: Callable[..., np.ndarray]) -> WarmStart:
    """Return an empty table for the contacts of a scene."""
    rows = 1 << (ROWS_OF_A_BODY * bodies - 1).bit_length()
    return WarmStart(
        pair=blocks(rows),
        first=blocks(rows),
        others=blocks(rows),
        impulse=blocks(rows),
        friction=None if pairs.friction is None else blocks(rows, 3),
        couple=None if pairs.resistance is None else blocks(rows, 3),
        in_use=blocks(1),
    )


# --- Keys ---------------------------------------------------------------------------------------------


@compiled
def key_of(k: int, problem: Problem, rows: int) -> Key:
    """Return the key of contact k in a table with ``rows`` rows."""
    contacts = problem.contacts
    pair = problem.contacts.pair[k]
    i = load(contacts.particle, 4 * k)
    j = load(contacts.particle, 4 * k + 1)
    m = load(contacts.particle, 4 * k + 2)
    n = load(contacts.particle, 4 * k + 3)
    others = OF_ENDS[1] * j + OF_ENDS[2] * m + OF_ENDS[3] * n
    if contacts.members[k] == 4:
        others = select(crosses(k, contacts), others, 0.0)
    elif contacts.members[k] == 3:
        others = 0.0 * others
    elif contacts.members[k] == 1:
        others = contacts.surface[k] + 0.0 * others
    spread = (OF_PAIR * pair + OF_ENDS[0] * i) + others
    place = spread - rows * rounded(spread * (1.0 / rows) - 0.5)
    return Key(pair + 1, i, others, within_table(place, rows))


@compiled
def within_table(place: Number, rows: int) -> Number:
    """Return a row index wrapped around the end of the table."""
    return select(place < rows - 0.5, place, place - rows)


@compiled
def is_of(key: Key, place: Number, table: WarmStart) -> Mask:
    """Return the mask of the copies in which a row of the table belongs to a contact."""
    pair = load_each(table.pair, place) - key.pair
    first = load_each(table.first, place) - key.first
    others = load_each(table.others, place) - key.others
    return pair * pair + first * first + others * others <= 0.0


# --- Starting -----------------------------------------------------------------------------------------


@compiled
def start_warm(v: Rows, problem: Problem, table: WarmStart | None) -> None:
    """Start each contact with its impulse of the last node, and change the velocities ``v`` (N, 3) by it."""
    if table is not None and any_lane(load(table.in_use, 0) > 0.5):
        contacts = problem.contacts
        for k in range(problem.contacts.length[ContactCount.ROWS]):
            key = key_of(k, problem, table.pair.size)
            place = key.place
            none = 0.0 * key.place
            looks = select(load(contacts.gap, k) < 0.5 * FAR, 1.0 + none, 0.0)
            at = none - 1.0
            for _ in range(PROBES):
                found = select(is_of(key, place, table), looks, 0.0) > 0.5
                at = select(found, place, at)
                looks = select(found, 0.0, looks)
                looks = select(load_each(table.pair, place) < 0.5, 0.0, looks)
                if not any_lane(looks > 0.5):
                    break
                place = within_table(place + 1.0, table.pair.size)
            there = at > -0.5
            if any_lane(there):
                at = select(there, at, 0.0)
                impulse = select(there, load_each(table.impulse, at), 0.0)
                n = row(contacts.normal, k)
                store(contacts.impulse, k, impulse)
                push(v, k, impulse * n, problem)
                start_friction(v, k, at, there, problem, table.friction)
                start_couple(v, k, at, there, problem, table.couple)


@compiled
def start_friction(
    v: Rows, k: int, at: Number, there: Mask, problem: Problem, kept: np.ndarray | None
) -> None:
    """Start the friction of contact k from rows ``at`` of the table, made tangential."""
    if kept is not None:
        contacts = problem.contacts
        n = row(problem.contacts.normal, k)
        friction = row_each(kept, at)
        friction = friction - dot(friction, n) / dot(n, n) * n
        friction = choose(there, friction, 0.0 * n)
        set_row(contacts.friction, k, friction)
        push_across(v, k, friction, problem)


@compiled
def start_couple(v: Rows, k: int, at: Number, there: Mask, problem: Problem, kept: np.ndarray | None) -> None:
    """Start the couple of contact k, where turning is resisted, from rows ``at`` of the table."""
    if kept is not None:
        contacts = problem.contacts
        couple = choose(there, row_each(kept, at), 0.0 * row(contacts.normal, k))
        set_row(contacts.couple, k, couple)
        push_turning(v, k, 0.0 * couple, couple, problem, contacts.turning)


# --- Keeping ------------------------------------------------------------------------------------------


@compiled
def keep_impulses(problem: Problem, table: WarmStart | None) -> None:
    """Store the impulses of all contacts, replacing those of the previous node."""
    if table is not None:
        contacts = problem.contacts
        rows = table.pair.size
        in_use = load(table.in_use, 0)
        if any_lane(in_use > 0.5):
            for entry in range(rows):
                store(table.pair, entry, 0.0)
        in_use = 0.0 * in_use
        for k in range(problem.contacts.length[ContactCount.ROWS]):
            key = key_of(k, problem, rows)
            impulse = load(contacts.impulse, k)
            place = key.place
            left = select(impulse > 0.0, 1.0 + 0.0 * impulse, 0.0)
            in_use = maximum(in_use, left)
            for _ in range(PROBES):
                if not any_lane(left > 0.5):
                    break
                enters = select(load_each(table.pair, place) < 0.5, left, 0.0) > 0.5
                if any_lane(enters):
                    put_where(table.pair, place, enters, key.pair + 0.0 * place)
                    put_where(table.first, place, enters, key.first)
                    put_where(table.others, place, enters, key.others)
                    put_where(table.impulse, place, enters, impulse)
                    enter_row(table.friction, place, row(contacts.friction, k), enters)
                    if table.couple is not None:
                        enter_row(table.couple, place, row(contacts.couple, k), enters)
                    left = select(enters, 0.0, left)
                place = within_table(place + 1.0, rows)
        store(table.in_use, 0, in_use)


@compiled
def enter_row(array: np.ndarray | None, place: Number, value: Vector, enters: Mask) -> None:
    """Store a vector in each copy's row of a table, if there is one, where it ``enters``."""
    if array is not None:
        set_row_each(array, place, choose(enters, value, row_each(array, place)))
