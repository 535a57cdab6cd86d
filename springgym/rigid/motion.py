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

from springgym.contact.totals import halve_totals, resume_totals
from springgym.core.blocks import at
from springgym.core.compiling import compiled, kernel
from springgym.core.kinds import Ledger, Number, Rows
from springgym.core.lanes import bodies_of, load, of_body
from springgym.forces.memory import PHASE, remember, resume, share_actions
from springgym.integrators.clock import Clock, tick
from springgym.integrators.node import PASSES, READS, START, STARTS, node_at, span_of
from springgym.integrators.record import Phase
from springgym.rigid.body import read_state, set_particles
from springgym.rigid.flight import fly
from springgym.rigid.kick import kick
from springgym.rigid.node import Company, pass_alone, pass_together, reach_node, read_node, set_loads
from springgym.rigid.solid import Solid, State, Twin
from springgym.rigid.surfaces import LOADS, clearance
from springgym.terms import Memory, Terms


@compiled
def move(phase: Phase, workspace: np.ndarray, h: Number, steps: int, twin: Twin) -> None:
    """Take the particles of one block through ``steps`` steps; none only makes them rigid, and as many as
    `springgym.integrators.node.LOOK` make the last node anew."""
    x, v, ledger = phase
    rigid, asymmetry, terms = twin
    if rigid.moves:
        go_back(x, v, ledger, steps, terms.memory)
        state, solid = read_state(x, v, rigid, asymmetry, terms)
        state = take(phase, state, workspace, h, steps, solid, terms.memory)
        set_particles(x, v, state, solid)


@compiled
def go_back(x: Rows, v: Rows, ledger: Ledger, steps: int, memory: Memory | None) -> None:
    """Go back to where the last node was reached, if there are surfaces and steps to take."""
    if memory is not None and steps != 0:
        resume(x, v, ledger, memory)


@compiled
def take(
    phase: Phase,
    state: State,
    workspace: np.ndarray,
    h: Number,
    steps: int,
    solid: Solid,
    memory: Memory | None,
) -> State:
    """Take ``steps`` steps, through nodes where there are surfaces; returns the state that is to be read."""
    wrench, thrust = solid.terms.wrench, solid.terms.thrust
    if memory is not None:
        if steps != 0:
            state = take_among_surfaces(phase, state, workspace, h, max(steps, 0), solid)
    else:
        rigid, asymmetry = solid.rigid, solid.asymmetry
        last = steps * rigid.stages.size
        before = 0.0
        for n in range(last + 1):
            ahead = h * rigid.stages[n % rigid.stages.size] if n < last else 0.0
            if last > 0:
                state = kick(state, 0.5 * (before + ahead), phase.ledger, solid, wrench, thrust)
            if n < last:
                state = fly(state, ahead, rigid, asymmetry)
            before = ahead
    return state


@compiled
def take_among_surfaces(
    bodies: Phase, state: State, workspace: np.ndarray, h: Number, steps: int, solid: Solid
) -> State:
    """Take steps through nodes, the last of which the next call makes anew (`springgym.rigid.node`)."""
    (x, _, ledger), memory, b = bodies, solid.terms.memory, workspace[LOADS]
    phase = load(memory.marks, PHASE)
    span = span_of(phase, h)
    begin = fly(state, -1.0 * span.lead, solid.rigid, solid.asymmetry)
    near = (clearance(begin, solid), 0.0 * phase)
    read = state
    for n in range(steps + 1):
        set_loads(b, state.q, solid, solid.terms.wrench, solid.terms.thrust)
        if n == 0:
            share_actions(b, phase, memory, memory.pushed, None)
        if n == steps:
            set_particles(x, memory.arrived, state, solid)
            remember(x, b, 1.0 + 0.0 * phase, ledger, memory, memory.pushed)
        node = reach_node(begin, state, span, b, solid)
        end, near, given = pass_alone(node, near, ledger, workspace, solid)
        if n == steps:
            read = read_node(node, end, given, 0.0 * node.before[0], ledger, workspace, solid)
        span = span_of(1.0 + 0.0 * phase, h)
        begin, state = end, fly(end, span.out, solid.rigid, solid.asymmetry)
    return read


@compiled
def move_each(phase: Phase, workspace: np.ndarray, h: Number, steps: int, settles: bool, twins: Twin) -> None:
    """Take each body through all steps, by itself; none makes it rigid, if it ``settles``."""
    if settles or steps != 0:
        for body in range(bodies_of(phase.x)):
            move(of_body(phase, body), workspace, h, steps, of_body(twins, body))


@compiled
def move_together(bodies: Phase, space: Company, h: Number, steps: int, settles: bool, twins: Twin) -> None:
    """Take all bodies through the steps together; the last node is made anew by the next call.

    None only makes them rigid, if it ``settles``; as many as `springgym.integrators.node.START` tell
    which bodies of fresh copies touch, as many as its `LOOK` make the last node anew.
    """
    x, v, ledger = bodies
    if steps == 0:
        if settles:
            for body in range(bodies_of(x)):
                settle(of_body(x, body), of_body(v, body), of_body(twins, body))
    else:
        memory, collisions = twins[2].memory, twins[2].collisions
        phase, goes, end = load(of_body(memory, 0).marks, PHASE), steps != START, max(steps, 0)
        if goes:
            for body in range(bodies_of(x)):
                resume(of_body(x, body), of_body(v, body), of_body(ledger, body), of_body(memory, body))
            resume_totals(phase, collisions)
        for n in range(end + 1):
            stage = STARTS if not goes else (READS if n == end else PASSES)
            now = phase if n == 0 else 1.0 + 0.0 * phase
            pass_together(bodies, node_at(now, h, stage), n == 0, space, twins)
        if goes:
            halve_totals(collisions)


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
