"""The motion of a rigid body, seen as that of its particles.

A kernel reads position, orientation and momenta off the particles, moves the one rigid body, and sets
the particles to it; nothing else is kept, so whatever reads particles reads a rigid body too.

The step is a symmetric splitting: kick h/2, flight h, kick h/2. Kicks change the momenta by gravity and
actuators (`springgym.rigid.kick`), flights are free (`springgym.rigid.flight`). Where there are surfaces it
is flight h/2, node, flight h/2 (`springgym.rigid.node`), which bodies that collide take together.
Higher orders compose such steps (`springgym.rigid.METHODS`).

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
    """Take the particles of one block through ``steps`` steps; none only makes them rigid."""
    x, v, _ = phase
    rigid, asymmetry, terms = twin
    if rigid.moves:
        state, solid = read_state(x, v, rigid, asymmetry, terms)
        state = take(phase, state, h, steps, solid)
        set_particles(x, v, state, solid)


@compiled
def take(phase: Phase, state: State, h: Number, steps: int, solid: Solid) -> State:
    """Take ``steps`` steps where there are no surfaces."""
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
    """Take each body through all steps, by itself; none makes it rigid, if it ``settles``."""
    if settles or steps != 0:
        for body in range(bodies_of(phase.x)):
            move(of_body(phase, body), h, steps, of_body(twins, body))


@compiled
def move_together(bodies: Phase, space: Workspace, h: Number, steps: int, settles: bool, twins: Twin) -> None:
    """Take all bodies through the steps together.

    None only makes them rigid, if it ``settles``; as many as `springgym.integrators.node.START` tell which
    bodies of fresh copies touch.
    """
    x, v, _ = bodies
    if steps == 0:
        if settles:
            for body in range(bodies_of(x)):
                settle(of_body(x, body), of_body(v, body), of_body(twins, body))
    else:
        goes = steps != START
        span = span_of(h, goes, x)
        for _ in range(steps if goes else 1):
            pass_together(bodies, span, goes, space, twins)
        store_energy_of_pairs(twins[2].collisions)


@compiled
def settle(x: Rows, v: Rows, twin: Twin) -> None:
    """Put the particles of a body onto its rigid shape; their momenta stay."""
    rigid, asymmetry, terms = twin
    if rigid.moves:
        state, solid = read_state(x, v, rigid, asymmetry, terms)
        set_particles(x, v, state, solid)


@cache
def kernel_reading(read: Callable[..., None], take: Callable[..., None] = move_each) -> Callable[..., None]:
    """As the kernels of springs; ``terms`` are `Rigid`, the asymmetry, and the scene's `Terms`.

    If ``settles``, the particles are put onto the rigid shape and then ``take`` their steps, be it none;
    else they are left as they are, and only read off.
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
