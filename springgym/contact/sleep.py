"""Put resting bodies to sleep: steps leave them where they are until a body that moves comes near.

A body falls asleep when all its particles have been slower than a limit for `DOZE` seconds, and so have been
those of every body that it touches, and that these touch: an island, as contact dynamics calls it. Its
particles stop, and what they had of kinetic energy is entered as lost in contact. It wakes, and its island
with it, at the node at which the search finds a contact with a body that moves, before any impulse acts.

Where a state is read, all bodies take part in the node, so that what is read has the contacts and forces of
bodies that sleep, too. The next call makes that node anew, and there they sleep. So calls of a and b steps
are one of a + b.

Copies of a block need not sleep together. Where one of a body's copies is awake, all are computed, and those
that sleep are put back (`springgym.integrators.node.put_back`); in those, contacts between bodies that sleep
are not looked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from springgym.contact.lists import Near
from springgym.contact.rows import FAR, MET, Problem
from springgym.contact.totals import ENTRIES, TOUCHING
from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Numbers, Rows
from springgym.core.lanes import any_lane, load, maximum, minimum, select, store
from springgym.core.vectors import dot, row

if TYPE_CHECKING:
    from springgym.contact.rows import ContactRows
    from springgym.contact.totals import Collisions

DOZE = 0.2
"""Time [s] for which a body and all that it touches have rested before they fall asleep."""

ASLEEP = -1.0
"""In place of the time for which a body has rested: it sleeps."""


class Sleep(NamedTuple):
    """Which bodies of each copy sleep."""

    rested: np.ndarray
    """(bodies,) the time for which all particles of a body have been slower than the limit [s]; `ASLEEP` if
    it sleeps"""
    limit: float
    """the speed below which a particle rests [m/s]"""
    pinned: np.ndarray
    """(bodies,) whether all particles of a body are pinned: it neither sleeps nor wakes another"""


# --- Who is awake -------------------------------------------------------------------------------------


@compiled
def moves(body: int, sleep: Sleep) -> Number:
    """Return 1 where a body is awake and not pinned, else 0."""
    rested = load(sleep.rested, body)
    if sleep.pinned[body]:
        return 0.0 * rested
    return select(rested < 0.0, 0.0 * rested, 1.0 + 0.0 * rested)


@compiled
def sleeps(body: int, sleep: Sleep) -> Mask:
    """Return the mask of the copies in which a body sleeps."""
    return load(sleep.rested, body) < 0.0


@compiled
def all_sleep(body: int, sleep: Sleep) -> bool:
    """Tell whether a body sleeps in all copies."""
    return not any_lane(load(sleep.rested, body) >= 0.0)


@compiled
def nothing_moves(sleep: Sleep) -> bool:
    """Tell whether no body moves in any copy."""
    moving = False
    for body in range(sleep.pinned.size):
        moving = moving or any_lane(moves(body, sleep) > 0.5)
    return not moving


# --- Search and waking --------------------------------------------------------------------------------


@compiled
def looked_at(near: Near, sleep: Sleep | None) -> Near:
    """Return a pair with a reach of 0 in the copies in which neither of its bodies moves."""
    if sleep is None:
        return near
    a, b = near.bodies
    either = maximum(moves(a, sleep), moves(b, sleep))
    return Near(near.pair, near.bodies, near.lead, select(either > 0.5, near.reach, 0.0), near.radius)


@compiled
def wake(first: int, behind: int, near: Near, contacts: ContactRows, sleep: Sleep | None) -> bool:
    """Wake one of two bodies where the other moves, if rows ``first`` to ``behind`` hold a contact of both.

    Tell whether any was woken.
    """
    woken = False
    if sleep is not None:
        found = 0.0 * near.lead
        for k in range(first, behind):
            found = select(load(contacts.gap, k) < 0.5 * FAR, 1.0, found)
        for side in range(2):
            body = near.bodies[side]
            rested = load(sleep.rested, body)
            wakes = select(rested < 0.0, found * moves(near.bodies[1 - side], sleep), 0.0) > 0.5
            if any_lane(wakes):
                store(sleep.rested, body, select(wakes, 0.0, rested))
                woken = True
    return woken


# --- Falling asleep -----------------------------------------------------------------------------------


@compiled
def note_rest(body: int, v: Rows, h: Number, sleep: Sleep) -> None:
    """Add ``h`` seconds to the time for which a body of velocities ``v`` has rested, or begin it anew."""
    rested = load(sleep.rested, body)
    fastest = 0.0 * rested
    for i in range(v.shape[0]):
        speed = row(v, i)
        fastest = maximum(dot(speed, speed), fastest)
    now = select(fastest < sleep.limit * sleep.limit, rested + h, 0.0)
    store(sleep.rested, body, select(rested < 0.0, rested, now))


@compiled
def find_ready(ready: Numbers, problem: Problem, sleep: Sleep) -> None:
    """Set ``ready`` (bodies,) to 1 where a body may sleep, else to 0.

    A body may sleep if it has rested, and so have all bodies that it touches, directly or through others.
    """
    first, second = problem.pairs.first, problem.pairs.second
    for body in range(sleep.pinned.size):
        rested = load(sleep.rested, body)
        awake = select(rested < DOZE, moves(body, sleep), 0.0)
        store(ready, body, 1.0 - awake)
    spreads = True
    while spreads:
        spreads = False
        for n in range(problem.contacts.length[MET]):
            p = problem.contacts.met[n]
            a, b = first[p], second[p]
            if not (sleep.pinned[a] or sleep.pinned[b]):
                here, there = load(ready, a), load(ready, b)
                differ = select(load(problem.totals, p * ENTRIES + TOUCHING) > 0.0, maximum(here, there), 0.0)
                if any_lane(differ > minimum(here, there)):
                    both = select(differ > 0.5, minimum(here, there), 1.0)
                    store(ready, a, minimum(here, both))
                    store(ready, b, minimum(there, both))
                    spreads = True


@compiled
def sleep_of(collisions: Collisions | None) -> Sleep | None:
    """Return the `Sleep` of bodies that collide; None if none of them can sleep."""
    if collisions is None:
        return None
    return collisions.sleep
