"""What acts once in a cycle of steps: dampers, and the wrench.

A cycle is an even number of steps. In its middle, dampers and wrench act for all of its time at once; between
two ends of cycles all of a step but they is velocity Verlet's. Copies are each in a cycle of their own. Where a
state is read amid a cycle, they have acted there for the time since it began, neither more nor less, and the
next call goes on from before that: calls of a and b steps are one of a + b. Copies that were placed or varied
begin a cycle, and so do those of which something else is asked than at the last step, if they are amid one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

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


class Cycle(NamedTuple):
    """Where copies are in their cycles, and how those amid one move."""

    every: int
    """steps of a cycle, even"""
    velocity: np.ndarray
    """(N, 3) before dampers and wrench acted to be read [m/s]; of copies that are amid a cycle"""
    marks: np.ndarray
    """(`MARKS`,)"""


def cycle(every: int, particles: int, blocks: Callable[..., np.ndarray]) -> Cycle:
    """That of copies which begin one."""
    return Cycle(every, blocks(particles, 3), blocks(MARKS))


@compiled
def place_in(phase: Number, cycle: Cycle) -> Any:
    """The steps that each copy has taken of its cycle."""
    return select(phase >= cycle.every, phase - cycle.every, phase)


@compiled
def next_in_cycle(phase: Number, cycle: Cycle) -> Any:
    after = phase + 1.0
    return select(after >= 2 * cycle.every, 0.0, after)


@compiled
def keep_phase(phase: Number, cycle: Cycle) -> None:
    store(cycle.marks, PHASE, phase)


@compiled
def is_at(phase: Number, place: Any) -> Any:
    """Whether a copy's phase is this one."""
    off = phase - place
    return off * off < 0.25


@compiled
def resume_cycle(v: Rows, ledger: Ledger, wrench: Wrench | None, cycle: Cycle) -> Any:
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
def changed(wrench: Wrench | None, cycle: Cycle) -> Any:
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
def pass_middle(
    x: Rows, v: Rows, b: Rows, direction: Rows, phase: Number, h: Number, ledger: Ledger, terms: Terms
) -> None:
    """Let dampers and wrench act for a whole cycle on the copies in the middle of one.

    The sweep is before the wrench in one cycle, and after it, in the other direction, in the next: two
    are the mirror image of themselves, and so of second order.
    """
    cycle, half = terms.cycle, terms.cycle.every // 2
    first, second = is_at(phase, half), is_at(phase, half + cycle.every)
    some = is_at(place_in(phase, cycle), half)
    damp_some(v, direction, True, first, ledger, terms)
    turn(x, v, b, select(some, cycle.every * h + 0.0 * phase, 0.0), ledger, terms)
    damp_some(v, direction, False, second, ledger, terms)


@compiled
def damp_some(
    v: Rows, direction: Rows, backward: bool, among: Mask, ledger: Ledger, terms: Terms
) -> None:
    """Let the dampers act for a whole cycle on some copies, if there are any."""
    if any_lane(among):
        damp(v, direction, terms.springs, terms.dampers, terms.drive, ledger, backward, True, among)


@compiled
def turn(x: Rows, v: Rows, b: Rows, tau: Number, ledger: Ledger, terms: Terms) -> None:
    """Let the wrench act for ``tau`` seconds; ``b`` is workspace."""
    set_actuation(x, b, terms.particles, terms.springs, terms.wrench, None, None)
    push(v, b, tau, terms.particles, terms.wrench, None, ledger)


@compiled
def catch_up(
    x: Rows, v: Rows, b: Rows, direction: Rows, phase: Number, h: Number, ledger: Ledger, terms: Terms
) -> None:
    """Let dampers and wrench have acted for the time since the cycle began, where a state is read amid it.

    Before its middle they have not acted yet; after it, for more than that: what is too much is taken back.
    """
    cycle = terms.cycle
    taken = place_in(phase, cycle)
    share = taken * (1.0 / cycle.every)
    share = select(2.0 * taken > cycle.every, share - 1.0, share)
    damp(v, direction, terms.springs, terms.dampers, terms.drive, ledger, True, True, None, share)
    turn(x, v, b, share * (cycle.every * h), ledger, terms)
