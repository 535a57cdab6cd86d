"""Rows of contacts: one for each contact of two bodies, or of a body and a surface, at a node.

Row r of two bodies holds the r-th contact of each copy, which may be of other particles in each. A copy with
fewer contacts has a gap of `FAR` in the rows that it lacks. So the list is as long as that of the copy with
most contacts, and which contacts a copy has, and in which order, does not depend on other copies. A row of
contact with a surface is of the same particle, or the same round feature, in all copies.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Vector
from springgym.core.language.lanes import maximum, select
from springgym.core.language.memory import load, store
from springgym.core.language.vectors import choose, dot, plus_scaled, row, row_each, set_row
from springgym.dynamics.arrays import allocate
from springgym.dynamics.contact.friction import crosses
from springgym.dynamics.contact.movers import turns_as_one
from springgym.dynamics.records import ContactRows, Pairs, Problem, Turning


def new_contacts(
    pairs: Pairs, among: int, surfaces: int, bodies: int, turning: Turning | None, dtype: DTypeLike
) -> ContactRows:
    """Return an empty list of contacts with elements of ``dtype``.

    A block has at most ``among`` contacts between bodies, and ``surfaces`` with surfaces.
    """
    width = np.dtype(dtype)["lanes"].shape[0]
    rows = min(among, pairs.most * width) + surfaces + 1
    extents = {
        "pairs": len(pairs.reach),
        "bodies": bodies,
        "rows": rows,
        "couples": 1 if pairs.resistance is None else rows,
        "arms": 1 if turning is None else rows,
    }
    of_bodies = {} if among else {"loose": None, "tilts": None}
    return allocate(ContactRows, extents, dtype, turning=turning, **of_bodies)


@compiled
def describe(k: int, problem: Problem) -> None:
    """Set the bodies, the points and the arms of contact k between two bodies."""
    contacts = problem.contacts
    pairs = problem.pairs
    p = contacts.pair[k]
    n = row(contacts.normal, k)
    nothing = 0.0 * row(contacts.normal, k)
    a = pairs.first[p]
    b = pairs.second[p]
    contacts.body[2 * k] = a
    contacts.body[2 * k + 1] = b
    contacts.surface[k] = -1
    contacts.only[k] = -1
    contacts.at_end[k] = 0
    contacts.loose[k] = contacts.members[k]
    contacts.tilts[k] = 1
    one = nothing
    other = nothing
    for m in range(contacts.members[k]):
        weight = load(contacts.weight, 4 * k + m)
        place = row_each(problem.x, load(contacts.particle, 4 * k + m))
        one = plus_scaled(one, maximum(weight, 0.0), place)
        other = plus_scaled(other, maximum(-1.0 * weight, 0.0), place)
    both = load(contacts.weight, 4 * k) * load(contacts.weight, 4 * k + 1)
    store(contacts.crossed, k, both)
    store(contacts.height, k, dot(one - other, n))
    first = plus_scaled(one, -pairs.radius[a], n)
    second = plus_scaled(other, pairs.radius[b], n)
    set_row(contacts.place, k, 0.5 * (first + second))
    set_arms(k, (one, other), (first, second), problem, contacts.turning)


@compiled
def set_arms(
    k: int,
    axes: tuple[Vector, Vector],
    skins: tuple[Vector, Vector],
    problem: Problem,
    turning: Turning | None,
) -> None:
    """Set the arms of contact k on bodies that turn as one, from the points of both sides.

    Two such bodies are pushed halfway between both points. If only one turns as one, it is pushed at its own
    skin where friction can tilt a face of the other, or else at the other's point. A body of a single
    particle is pushed at its particle.
    """
    if turning is not None:
        contacts = problem.contacts
        pairs = problem.pairs
        a = contacts.body[2 * k]
        b = contacts.body[2 * k + 1]
        first = turns_as_one(a, turning)
        second = turns_as_one(b, turning)
        if first or second:
            place = 0.5 * (skins[0] + skins[1])
            contacts.tilts[k] = 0
            if first and second:
                contacts.loose[k] = 0
                if pairs.single[a]:
                    place = axes[0]
                elif pairs.single[b]:
                    place = axes[1]
            else:
                own, theirs = (skins[0], axes[1]) if first else (skins[1], axes[0])
                place = theirs
                if contacts.members[k] == 4:
                    contacts.tilts[k] = 1
                    crossed = crosses(k, contacts)
                    place = choose(crossed, theirs, own)
                    left = load(contacts.height, k) - pairs.radius[a if first else b]
                    store(contacts.height, k, select(crossed, 0.0, left))
                for m in range(contacts.members[k]):
                    weight = load(contacts.weight, 4 * k + m)
                    sign = 1.0 if first else -1.0  # of the weights of the body that turns
                    store(contacts.weight, 4 * k + m, select(sign * weight > 0.0, 0.0 * weight, weight))
            if first:
                set_row(contacts.arm, 4 * k, place - row(turning.point, a))
            if second:
                set_row(contacts.arm, 4 * k + 1, place - row(turning.point, b))
