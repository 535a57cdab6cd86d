"""Let dampers and the wrench act less often than at every step.

A cycle is an even number of steps of velocity Verlet. The wrench acts by Simpson's rule: for a sixth of a
cycle at each of its ends, and for the rest in its middle. Once a cycle dampers act for all of its time, after
the first step of one cycle and before the last of the next, so that no vibration is met at the same moment of
its swing each time. Two cycles are their own mirror image, and so of second order. Copies are each in a cycle
of their own.

Where a state is read amid a cycle, both have acted for the time since it began, neither more nor less, and
the next call goes on from before that: calls of a and b steps are one of a + b. Copies that were placed or
varied begin a cycle, and so do those amid one of which something else is asked than when they were read.

Where there is contact, half of a node that is read is behind (`springgym.integrators.node`): there dampers
act for twice the time that is missing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Mask, Number, Rows
from springgym.core.lanes import any_lane, load, maximum, select, store
from springgym.core.vectors import choose, row, set_row
from springgym.forces.actuators import push, set_actuation
from springgym.forces.ledger import ENTRIES
from springgym.forces.springs import damp

if TYPE_CHECKING:
    from springgym.forces import Terms
    from springgym.forces.actuators import Wrench


PHASE, BEFORE, ASKED = 0, 1, 1 + ENTRIES
"""Where in the marks are: the steps taken since the first of two cycles began, as the dampers' sweeps take
turns in direction; the ledger before the state was read; and what the wrench was asked for."""

MARKS = ASKED + 9

FIRST = 1
"""Steps after which dampers act in the first of two cycles."""

END, MIDDLE = 1 / 6, 2 / 3
"""Simpson's rule: for which share of a cycle the wrench acts at each of its ends, and in its middle."""


class Cycle(NamedTuple):
    """Record how far copies are in their cycles, and the velocities of those amid one."""

    every: int
    """steps of a cycle, even"""
    velocity: np.ndarray
    """(N, 3) velocities that copies amid a cycle go on with: a reading lets dampers and wrench act for the
    time since the cycle began, and those velocities are not kept [m/s]"""
    marks: np.ndarray
    """(`MARKS`,)"""


def cycle(every: int, particles: int, blocks: Callable[..., np.ndarray]) -> Cycle:
    """Return the `Cycle` of copies that begin one."""
    return Cycle(every, blocks(particles, 3), blocks(MARKS))


@compiled
def place_in(phase: Number, cycle: Cycle) -> Number:
    """Return the steps that each copy has taken of its cycle."""
    return select(phase >= cycle.every, phase - cycle.every, phase)


@compiled
def next_in_cycle(phase: Number, cycle: Cycle) -> Number:
    after = phase + 1.0
    return select(after >= 2 * cycle.every, 0.0, after)


@compiled
def keep_phase(phase: Number, cycle: Cycle) -> None:
    store(cycle.marks, PHASE, phase)


@compiled
def is_at(phase: Number, place: int) -> Mask:
    """Tell whether a copy's phase is this one."""
    off = phase - place
    return off * off < 0.25


@compiled
def resume_cycle(v: Rows, ledger: Ledger, wrench: Wrench | None, cycle: Cycle) -> Number:
    """Go back to before the state was read, amid cycles that go on. Returns the phase."""
    phase = load(cycle.marks, PHASE)
    if any_lane(place_in(phase, cycle) > 0.0):
        phase = select(changed(wrench, cycle) > 0.0, 0.0, phase)
        amid = place_in(phase, cycle) > 0.0
        for i in range(v.shape[0]):
            set_row(v, i, choose(amid, row(cycle.velocity, i), row(v, i)))
        if ledger is not None:
            for entry in range(ENTRIES):
                before = load(cycle.marks, BEFORE + entry)
                store(ledger, entry, select(amid, before, load(ledger, entry)))
    return phase


@compiled
def changed(wrench: Wrench | None, cycle: Cycle) -> Mask:
    """Return by how much the wrench asks for something else at the most."""
    most = 0.0 * load(cycle.marks, PHASE)
    if wrench is not None:
        for n in range(3):
            for part, asked in enumerate((wrench.force, wrench.torque, wrench.body_torque)):
                apart = load(asked, n) - load(cycle.marks, ASKED + 3 * part + n)
                most = maximum(most, maximum(apart, -apart))
    return most


@compiled
def remember_cycle(v: Rows, ledger: Ledger, wrench: Wrench | None, cycle: Cycle) -> None:
    """Keep what the next call goes on from."""
    for i in range(v.shape[0]):
        set_row(cycle.velocity, i, row(v, i))
    if ledger is not None:
        for entry in range(ENTRIES):
            store(cycle.marks, BEFORE + entry, load(ledger, entry))
    if wrench is not None:
        for n in range(3):
            for part, asked in enumerate((wrench.force, wrench.torque, wrench.body_torque)):
                store(cycle.marks, ASKED + 3 * part + n, load(asked, n))


@compiled
def acts_at(phase: Number, wrench: Wrench | None, cycle: Cycle) -> tuple[bool, bool]:
    """Tell whether dampers act, and the wrench, in some copy before its next step."""
    damps, turns = damps_at(phase, cycle), False
    if wrench is not None:
        place = place_in(phase, cycle)
        turns = any_lane(is_at(place, 0)) or any_lane(is_at(place, cycle.every // 2))
    return damps, turns


@compiled
def relax_in_turn(
    v: Rows, direction: Rows, backward: bool, phase: Number, ledger: Ledger, terms: Terms
) -> None:
    """Let dampers act on the copies whose turn it is: back after a first step, there before a last one."""
    among = is_at(phase, FIRST if backward else 2 * terms.cycle.every - FIRST)
    if any_lane(among):
        damp(v, direction, terms.springs, terms.dampers, None, ledger, backward, True, among)


@compiled
def sweeps_at(read: bool, cycle: Cycle | None) -> bool:
    """Return whether dampers act in some copy at a node of contact, which is ``read`` or passed."""
    if cycle is None:
        return True
    phase = load(cycle.marks, PHASE)
    if read:
        return any_lane(place_in(phase, cycle) > 0.0)
    return damps_at(phase, cycle)


@compiled
def damps_at(phase: Number, cycle: Cycle) -> bool:
    """Return whether dampers act before the next step in some copy."""
    return any_lane(is_at(phase, FIRST)) or any_lane(is_at(phase, 2 * cycle.every - FIRST))


@compiled
def not_damped(phase: Number, cycle: Cycle) -> Number:
    """Return for which share of a cycle dampers have not acted yet since two cycles began.

    It is less than 0 where they have acted for too long, and 0 where a cycle begins.
    """
    some, last = 0.0 * phase, 2 * cycle.every - FIRST
    done = select(phase > FIRST + 0.5, 1.0 + some, 0.0) + select(phase > last + 0.5, 1.0 + some, 0.0)
    return select(place_in(phase, cycle) > 0.0, phase * (1.0 / cycle.every) - done, 0.0)


@compiled
def relax_to_be_read(v: Rows, direction: Rows, phase: Number, ledger: Ledger, terms: Terms) -> None:
    """Let dampers act at a node that is read: half of it makes up for the time since two cycles began."""
    cycle = terms.cycle
    if any_lane(place_in(phase, cycle) > 0.0):
        share = 2.0 * not_damped(phase, cycle)
        damp(v, direction, terms.springs, terms.dampers, None, ledger, True, True, None, share)


@compiled
def count_node(cycle: Cycle | None) -> None:
    """Count a node that is passed, if dampers act in cycles."""
    if cycle is not None:
        keep_phase(next_in_cycle(load(cycle.marks, PHASE), cycle), cycle)


@compiled
def turn_in_turn(
    x: Rows,
    v: Rows,
    b: Rows,
    phase: Number,
    h: Number,
    before: bool,
    after: bool,
    ledger: Ledger,
    terms: Terms,
) -> None:
    """Let the wrench act where cycles end and begin, ``before`` and ``after`` that, and amid them."""
    if terms.wrench is not None:
        cycle, place = terms.cycle, place_in(phase, terms.cycle)
        time = cycle.every * h
        turn(x, b, terms)
        if before:
            add_turn(v, b, is_at(place, 0), END * time, ledger, terms)
        if after:
            add_turn(v, b, is_at(place, 0), END * time, ledger, terms)
            add_turn(v, b, is_at(place, cycle.every // 2), MIDDLE * time, ledger, terms)


@compiled
def turn(x: Rows, b: Rows, terms: Terms) -> None:
    """Set ``b`` (N, 3) to the accelerations by the wrench."""
    set_actuation(x, b, terms.particles, None, terms.wrench, None, None)


@compiled
def add_turn(v: Rows, b: Rows, among: Mask, tau: Number, ledger: Ledger, terms: Terms) -> None:
    """Let the accelerations ``b`` by the wrench act on some copies for ``tau`` seconds."""
    each = select(among, tau + 0.0 * load(terms.cycle.marks, PHASE), 0.0)
    push(v, b, each, terms.particles, terms.wrench, None, ledger)


@compiled
def catch_up(
    x: Rows, v: Rows, b: Rows, direction: Rows, phase: Number, h: Number, ledger: Ledger, terms: Terms
) -> None:
    """Let dampers and wrench have acted for the time since two cycles began, where a state is read amid one.

    What they did too much is taken back.
    """
    cycle = terms.cycle
    time, some, place = cycle.every * h, 0.0 * phase, place_in(phase, cycle)
    share = not_damped(phase, cycle)
    damp(v, direction, terms.springs, terms.dampers, None, ledger, True, True, None, share)
    if terms.wrench is not None:
        done = select(place > cycle.every // 2 + 0.5, END + MIDDLE + some, END)
        share = select(place > 0.0, place * (1.0 / cycle.every) - done, 0.0)
        turn(x, b, terms)
        push(v, b, share * time, terms.particles, terms.wrench, None, ledger)
