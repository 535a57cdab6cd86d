"""Find contacts of bodies with surfaces: of their particles, or of their round features.

Each near particle, or feature, and surface makes a row of contact (`springgym.dynamics.contact.rows`). A
round feature touches in its support point at the node; its gap is that of the feature at both ends of the
step, which includes the change, of second order in the angle of a step, as the support point moves over the
skin. The rule is symmetric in time, so that the energy of rolling bodies does not drift."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Number, Rows, Vector
from springgym.core.language.lanes import any_lane, minimum
from springgym.core.language.memory import store
from springgym.core.language.vectors import row, set_row
from springgym.dynamics.contact.movers import turns_as_one
from springgym.dynamics.contact.round import Way, at, moved, nearest
from springgym.dynamics.contact.surfaces import count, height, mean_normal
from springgym.dynamics.records import ContactRows, Rounds, Surfaces, Turning

NEAR = 2.0
"""Gap in units of Δ below which a surface gets a row: more than 1, as contacts between bodies move them."""


class Grounded(NamedTuple):
    """A body that may touch surfaces in a step."""

    pair: int
    """index among all pairs of this body and the surfaces"""
    body: int
    first: int
    """index of its first particle among all"""
    x: Rows
    """(N, 3) positions at the node [m]"""
    begin: Way
    """the ways to where the step begins, and to where it would end without contact"""
    end: Way
    free: np.ndarray
    """(N,) whether each particle is free, not pinned"""
    surfaces: Surfaces
    contacts: ContactRows


@compiled
def find_ground(rows: int, own: Grounded, rounds: Rounds | None) -> int:
    """Add the contacts of a body with surfaces after ``rows`` others, and return the number of rows."""
    if rounds is not None:
        for e in range(rounds.first.size):
            for k in range(count(own.surfaces.kinds)):
                rows = add_feature(rows, e, k, own, rounds, own.contacts.turning)
        if rounds.first.size > 0:
            return rows
    for i in range(own.x.shape[0]):
        if own.free[i]:
            begin = moved(i, own.begin, own.begin.v)
            end = moved(i, own.end, own.end.v)
            for k in range(count(own.surfaces.kinds)):
                ahead = height(k, end, own.surfaces)
                reach = NEAR * own.surfaces.reach
                if any_lane(minimum(ahead, height(k, begin, own.surfaces)) < reach):
                    n, _, start = mean_normal(k, begin, end, own.surfaces)
                    add_row(rows, k, i, -1, (n, start, ahead), own)
                    set_particle_arm(rows, row(own.x, i), own, own.contacts.turning)
                    rows += 1
    return rows


@compiled
def add_row(rows: int, k: int, i: int, e: int, touch: tuple[Vector, Number, Number], own: Grounded) -> None:
    """Write a row of contact with surface ``k``, of particle ``i`` or of round feature ``e``.

    ``touch`` are its normal, the gap where the step begins, and that where it would end without contact.
    """
    contacts = own.contacts
    n, start, ahead = touch
    contacts.pair[rows] = own.pair
    contacts.surface[rows] = k
    contacts.feature[rows] = e
    contacts.body[2 * rows] = own.body
    contacts.body[2 * rows + 1] = -1
    contacts.members[rows] = 1
    clear(rows, contacts.loose)
    clear(rows, contacts.tilts)
    contacts.touching[rows] = own.first + i if e < 0 else -1
    contacts.only[rows] = own.first + i if e < 0 else -1
    contacts.at_end[rows] = 0 if e < 0 else 1
    set_row(contacts.normal, rows, 0.0 * row(own.x, 0) + n)
    store(contacts.start, rows, start)
    store(contacts.gap, rows, ahead)
    store(contacts.share, rows, 1.0)
    store(contacts.particle, 4 * rows, 1.0 * (own.first + i if e < 0 else e))
    store(contacts.grips, rows, 1.0)


@compiled
def clear(k: int, numbers: np.ndarray | None) -> None:
    """Set the entry of contact k in an integer array to 0, if the scene has that array."""
    if numbers is not None:
        numbers[k] = 0


@compiled
def set_particle_arm(rows: int, place: Vector, own: Grounded, turning: Turning | None) -> None:
    """Set the point of contact of a particle, and its arm if its body, springs or rigid, turns as one."""
    set_row(own.contacts.place, rows, place)
    if turns_as_one(own.body, turning):
        own.contacts.only[rows] = -1
        set_row(own.contacts.arm, 4 * rows, place)


@compiled
def add_feature(rows: int, e: int, k: int, own: Grounded, rounds: Rounds, turning: Turning | None) -> int:
    """Add the contact of round feature ``e`` with surface ``k``, if near; return the number of rows."""
    if turning is not None:
        _, _, _, start = nearest(e, k, own.begin, rounds, own.surfaces)
        at_end, _, _, ahead = nearest(e, k, own.end, rounds, own.surfaces)
        if any_lane(minimum(start, ahead) < NEAR * own.surfaces.reach):
            here = Way(own.x, None, 0.0)
            point, n, _, _ = nearest(e, k, here, rounds, own.surfaces)
            add_row(rows, k, 0, e, (n, start, ahead), own)
            place = at(e, point, here, rounds)
            set_row(own.contacts.place, rows, place)
            set_row(own.contacts.arm, 4 * rows, place)
            set_row(own.contacts.arm, 4 * rows + 2, at(e, at_end, own.end, rounds))
            rows += 1
    return rows


@compiled
def shift_arms(k: int, contacts: ContactRows, turning: Turning | None) -> None:
    """Make the arms of contact k with a surface relative to the body's point, at the node and at the end."""
    if turning is not None and contacts.only[k] < 0:
        body = contacts.body[2 * k]
        count_of = turning.turns.size
        set_row(contacts.arm, 4 * k, row(contacts.arm, 4 * k) - row(turning.point, body))
        if contacts.at_end[k] == 1:
            at_end = row(contacts.arm, 4 * k + 2) - row(turning.point, body + count_of)
            set_row(contacts.arm, 4 * k + 2, at_end)


@compiled
def ahead_of(k: int, own: Grounded, rounds: Rounds | None) -> Number:
    """Return the gap [m] of contact k with a surface where the step would end without contact."""
    contacts = own.contacts
    if rounds is not None and contacts.feature[k] >= 0:
        _, _, _, gap = nearest(contacts.feature[k], contacts.surface[k], own.end, rounds, own.surfaces)
        return gap
    i = contacts.touching[k] - own.first
    return height(contacts.surface[k], moved(i, own.end, own.end.v), own.surfaces)
