"""The motion of a rigid body, represented by its particles.

A kernel reads position, orientation and momenta off the particles, moves the rigid body, and sets the
particles accordingly. No other state is stored, so that code which reads particles reads rigid bodies, too.

The step is a symmetric splitting: kick h/2, flight h, kick h/2. Kicks change the momenta by gravity and
actuators (`springgym.dynamics.rigid.kick`), flights are free (`springgym.dynamics.rigid.flight`). Where there
are surfaces it is flight h/2, node, flight h/2 (`springgym.dynamics.step`), which all bodies pass together.
Higher orders compose such steps (`springgym.dynamics.rigid.METHODS`).

Source: Hairer, Lubich & Wanner, Geometric Numerical Integration, sec. V.3 and VII.5.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.bodies import bodies_of, of_body
from springgym.core.language.kinds import Number, Rows
from springgym.dynamics.methods import kernel_of
from springgym.dynamics.methods.record import Phase
from springgym.dynamics.rigid.body import read_state, set_particles
from springgym.dynamics.rigid.flight import fly
from springgym.dynamics.rigid.kick import kick
from springgym.dynamics.rigid.node import RIGID, Workspace
from springgym.dynamics.rigid.solid import Solid, State, Twin
from springgym.dynamics.step import Bodies, advance_together


@compiled
def advance_each(
    phase: Phase, workspace: np.ndarray, h: Number, steps: int, placed: bool, twins: Twin
) -> None:
    """Advance bodies that touch nothing, one after another, or move those just ``placed`` to their shapes."""
    if placed:
        move_to_shapes(phase, twins)
        return
    for body in range(bodies_of(phase.x)):
        advance(of_body(phase, body), h, steps, of_body(twins, body))


@compiled
def advance(phase: Phase, h: Number, steps: int, twin: Twin) -> None:
    """Advance the particles of a body by ``steps`` steps."""
    x, v, _ = phase
    rigid, asymmetry, terms = twin
    if rigid.moves:
        state, solid = read_state(x, v, rigid, asymmetry, terms)
        state = take(phase, state, h, steps, solid)
        set_particles(x, v, state, solid)


@compiled
def take(phase: Phase, state: State, h: Number, steps: int, solid: Solid) -> State:
    """Return the state after ``steps`` steps without surfaces."""
    wrench = solid.terms.wrench
    thrust = solid.terms.thrust
    rigid = solid.rigid
    last = steps * rigid.stages.size
    before = 0.0
    for n in range(last + 1):
        ahead = h * rigid.stages[n % rigid.stages.size] if n < last else 0.0
        state = kick(state, 0.5 * (before + ahead), phase.ledger, solid, wrench, thrust)
        if n < last:
            state = fly(state, ahead, rigid, solid.asymmetry)
        before = ahead
    return state


@compiled
def advance_all(phase: Phase, space: Workspace, h: Number, steps: int, placed: bool, twins: Twin) -> None:
    """Advance all bodies together, step by step, or find which touch in copies that were just ``placed``."""
    if placed:
        move_to_shapes(phase, twins)
    bodies = Bodies(phase.x, phase.v, phase.ledger, space, twins[2], twins)
    advance_together(RIGID, bodies, h, steps, placed)


@compiled
def move_to_shapes(phase: Phase, twins: Twin) -> None:
    """Move the particles of each body onto its rigid shape, with unchanged momenta."""
    for body in range(bodies_of(phase.x)):
        move_to_shape(of_body(phase.x, body), of_body(phase.v, body), of_body(twins, body))


@compiled
def move_to_shape(x: Rows, v: Rows, twin: Twin) -> None:
    """Move the particles of a body onto its rigid shape, with unchanged momenta."""
    rigid, asymmetry, terms = twin
    if rigid.moves:
        state, solid = read_state(x, v, rigid, asymmetry, terms)
        set_particles(x, v, state, solid)


@cache
def read_twins(read: Callable[..., None]) -> Callable[..., None]:
    """Return a function that measures rigid bodies as ``read`` does bodies of springs."""

    @compiled
    def read_rigid(block: int, phase: Phase, reading: Any, twins: Twin) -> None:
        read(block, phase, reading, twins[2])

    return read_rigid


def advance_kernel(read: Callable[..., None], together: bool) -> Callable[..., None]:
    """Return a kernel as `springgym.dynamics.methods.kernel_of` makes it; its ``terms`` are a `Twin`."""
    return kernel_of(advance_all if together else advance_each, read_twins(read))
