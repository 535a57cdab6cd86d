"""Keep what a copy needs from one call to the next beside x and v, in scenes with surfaces.

There a state is read in the middle of a node (`springgym.integrators.node`): x is where the particles are
there, v the mean of the velocities with which they come and go. The next call goes on from the velocities
with which they came, so that calls of a and b steps are one of a + b. A copy that was placed has come from
nowhere: it is fresh.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Numbers, Rows
from springgym.core.lanes import load, select, store
from springgym.core.vectors import choose, row, set_row, vec, vector
from springgym.forces.actuators import drive_by
from springgym.forces.ledger import ENTRIES
from springgym.terms import Drive, Memory

PHASE, STORED, BEFORE, STEERED = 0, 1, 2, 2 + ENTRIES
"""Where in the marks are: 0 of a fresh copy, else 1 or 2 in turn, the direction of the dampers' sweep; the
energy [J] that contact stores in mid-impact beside its barriers; the ledger before the node; and the drive's
acceleration."""

MARKS = STEERED + 3


def memory(particles: int, actuated: bool, expects: bool, blocks: Callable[..., np.ndarray]) -> Memory:
    """Return the memory of fresh copies of a body."""
    return Memory(
        arrived=blocks(particles, 3),
        place=blocks(particles, 3),
        pushed=blocks(particles, 3) if actuated else None,
        given=blocks(particles, 3) if expects else None,
        marks=blocks(MARKS),
    )


@compiled
def resume(x: Rows, v: Rows, ledger: Ledger, memory: Memory) -> Number:
    """Go back to where the last node was reached; fresh copies stay where they are. Returns the phase."""
    phase = load(memory.marks, PHASE)
    fresh = phase < 0.5
    for i in range(x.shape[0]):
        set_row(x, i, choose(fresh, row(x, i), row(memory.place, i)))
        set_row(v, i, choose(fresh, row(v, i), row(memory.arrived, i)))
    if ledger is not None:
        for entry in range(ENTRIES):
            store(ledger, entry, select(fresh, load(ledger, entry), load(memory.marks, BEFORE + entry)))
    return phase


@compiled
def share_actions(b: Rows, phase: Number, memory: Memory, pushed: Rows, drive: Drive | None) -> None:
    """Actions change at nodes: half of what the actuators give is as before, half as it is from now on."""
    fresh = phase < 0.5
    if pushed is not None:
        for i in range(pushed.shape[0]):
            now = row(b, i)
            set_row(b, i, choose(fresh, now, 0.5 * (now + row(pushed, i))))
    if drive is not None:
        now = vector(drive.acceleration)
        for axis in range(3):
            before = load(memory.marks, STEERED + axis)
            store(memory.marks, STEERED + axis, select(fresh, now[axis], 0.5 * (now[axis] + before)))


@compiled
def steer(memory: Memory, drive: Drive | None) -> None:
    """The drive takes its present command from now on."""
    if drive is not None:
        for axis in range(3):
            store(memory.marks, STEERED + axis, load(drive.acceleration, axis))


@compiled
def turn_drive(
    v: Numbers, force: Numbers, tau: Number, memory: Memory, drive: Drive | None, ledger: Ledger
) -> None:
    """`move_drive`, as the node before and what is asked for now have it."""
    if drive is not None:
        acceleration = vec(
            load(memory.marks, STEERED), load(memory.marks, STEERED + 1), load(memory.marks, STEERED + 2)
        )
        drive_by(v, force, acceleration, tau, drive, ledger)


@compiled
def remember(x: Rows, b: Rows, phase: Number, ledger: Ledger, memory: Memory, pushed: Rows) -> None:
    """Keep how the node is reached at which the state is read."""
    store(memory.marks, PHASE, phase)
    for i in range(x.shape[0]):
        set_row(memory.place, i, row(x, i))
        if pushed is not None:
            set_row(pushed, i, row(b, i))
    if ledger is not None:
        for entry in range(ENTRIES):
            store(memory.marks, BEFORE + entry, load(ledger, entry))


@compiled
def recall_expected(phase: Number, given: Rows, expected: Rows | None) -> None:
    """Expect for the last node, which is made anew, what was expected; fresh copies expect nothing."""
    if expected is not None:
        for i in range(expected.shape[0]):
            set_row(given, i, choose(phase < 0.5, vec(0.0, 0.0, 0.0), row(expected, i)))


@compiled
def keep_expected(given: Rows, expected: Rows | None) -> None:
    """Keep what is expected for the last node."""
    if expected is not None:
        for i in range(expected.shape[0]):
            set_row(expected, i, row(given, i))


@compiled
def halve(ledger: Ledger, memory: Memory) -> None:
    """Leave half of what the node entered in the ledger."""
    if ledger is not None:
        for entry in range(ENTRIES):
            store(ledger, entry, 0.5 * (load(memory.marks, BEFORE + entry) + load(ledger, entry)))


@compiled
def stored_in_contact(like: Number, memory: Memory | None) -> Number:
    """Return the energy [J] that contact stores beside its barriers; ``like`` is any value in all lanes."""
    if memory is None:
        return 0.0 * like
    return load(memory.marks, STORED)
