"""The motion of a rigid body, represented by its particles.

A kernel reads position, orientation and momenta off the particles, moves the rigid body, and sets the
particles accordingly. No other state is stored, so that code which reads particles reads rigid bodies, too.

The step is a symmetric splitting: kick h/2, flight h, kick h/2. Kicks change the momenta by gravity and
actuators (`springgym.rigid.kick`), flights are free (`springgym.rigid.flight`). Where there are surfaces it
is flight h/2, node, flight h/2 (`springgym.rigid.node`), which all colliding bodies pass together. Higher
orders compose such steps (`springgym.rigid.METHODS`).

Source: Hairer, Lubich & Wanner, Geometric Numerical Integration, sec. V.3 and VII.5.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from springgym.core.blocks import at
from springgym.core.compiling import compiled, kernel
from springgym.core.kinds import Number, Rows
from springgym.core.lanes import bodies_of, of_body
from springgym.integrators.clock import Clock, tick
from springgym.integrators.node import START, span_of
from springgym.integrators.record import Phase
from springgym.integrators.rows import store_energy_of_pairs
from springgym.rigid.body import read_state, set_particles
from springgym.rigid.flight import fly
from springgym.rigid.kick import kick
from springgym.rigid.node import Workspace, pass_together
from springgym.rigid.solid import Solid, State, Twin
from springgym.terms import Terms


@compiled
def move(phase: Phase, h: Number, steps: int, twin: Twin) -> None:
    """Advance the particles of one block by ``steps`` steps; 0 steps only make them rigid."""
    x, v, _ = phase
    rigid, asymmetry, terms = twin
    if rigid.moves:
        state, solid = read_state(x, v, rigid, asymmetry, terms)
        state = take(phase, state, h, steps, solid)
        set_particles(x, v, state, solid)


@compiled
def take(phase: Phase, state: State, h: Number, steps: int, solid: Solid) -> State:
    """Return the state after ``steps`` steps without surfaces."""
    wrench, thrust, rigid = solid.terms.wrench, solid.terms.thrust, solid.rigid
    last = steps * rigid.stages.size
    before = 0.0
    for n in range(last + 1):
        ahead = h * rigid.stages[n % rigid.stages.size] if n < last else 0.0
        if last > 0:
            state = kick(state, 0.5 * (before + ahead), phase.ledger, solid, wrench, thrust)
        if n < last:
            state = fly(state, ahead, rigid, solid.asymmetry)
        before = ahead
    return state


@compiled
def move_each(phase: Phase, workspace: np.ndarray, h: Number, steps: int, settles: bool, twins: Twin) -> None:
    """Advance bodies one by one through all steps; 0 steps make them rigid if ``settles``."""
    if settles or steps != 0:
        for body in range(bodies_of(phase.x)):
            move(of_body(phase, body), h, steps, of_body(twins, body))


@compiled
def move_together(bodies: Phase, space: Workspace, h: Number, steps: int, settles: bool, twins: Twin) -> None:
    """Advance all bodies together, step by step.

    0 steps only make them rigid, if ``settles``; `springgym.integrators.node.START` only finds which bodies
    of fresh copies touch.
    """
    x, v, _ = bodies
    if steps == 0:
        if settles:
            for body in range(bodies_of(x)):
                move_to_shape(of_body(x, body), of_body(v, body), of_body(twins, body))
    else:
        goes = steps != START
        span = span_of(h, goes, x)
        for _ in range(steps if goes else 1):
            pass_together(bodies, span, goes, space, twins)
        store_energy_of_pairs(twins[2].collisions)


@compiled
def move_to_shape(x: Rows, v: Rows, twin: Twin) -> None:
    """Move the particles of a body onto its rigid shape, with unchanged momenta."""
    rigid, asymmetry, terms = twin
    if rigid.moves:
        state, solid = read_state(x, v, rigid, asymmetry, terms)
        set_particles(x, v, state, solid)


@cache
def kernel_reading(read: Callable[..., None], take: Callable[..., None] = move_each) -> Callable[..., None]:
    """Return a kernel like those of springs; ``terms`` are `Rigid`, the asymmetry, and the scene's `Terms`.

    If ``settles``, the particles are moved onto the rigid shape and then advanced by ``take``, by 0 steps or
    more; else 0 steps leave them unchanged.
    """

    @kernel
    def advance(
        phase: Phase,
        workspace: np.ndarray,
        blocks: tuple[int, int],
        h: float,
        steps: int,
        settles: bool,
        terms: Terms,
        reading: Any,
        reads: bool,
        clock: Clock,
    ) -> None:
        for block in range(blocks[0], blocks[1]):
            here, all_terms = at(phase, block), at(terms, block)
            take(here, workspace, h, steps, settles, all_terms)
            if settles:
                tick(clock, block, steps)
            if reads:
                read(block, here, reading, all_terms[2])

    return advance
