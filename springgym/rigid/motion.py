"""The motion of a rigid body, seen as that of its particles.

A kernel reads position, orientation and momenta off the particles, moves the one rigid body, and sets
the particles to it; nothing else is kept, so whatever reads particles reads a rigid body too.

The step is a symmetric splitting: kick h/2, flight h, kick h/2. Kicks change the momenta by gravity and
actuators (`springgym.rigid.kick`), flights are free (`springgym.rigid.flight`). Where there are surfaces it
is flight h/2, node, flight h/2 (`springgym.rigid.contact`), which bodies that collide take together
(`springgym.rigid.together`).
Higher orders compose such steps (`springgym.rigid.METHODS`).

Source: Hairer, Lubich & Wanner, Geometric Numerical Integration, sec. V.3 and VII.5.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from springgym.core.blocks import at
from springgym.core.compiling import compiled, kernel
from springgym.core.kinds import Ledger, Number, Numbers, Rows, Vector
from springgym.core.lanes import bodies_of, load, of_body
from springgym.core.vectors import angular_momentum, cross, mass_centre, row, set_row, triad, vec
from springgym.forces.memory import PHASE, remember, resume, share_actions
from springgym.integrators.clock import Clock, tick
from springgym.integrators.envelope import Block
from springgym.integrators.node import span_of
from springgym.integrators.record import Phase
from springgym.rigid.contact import LOADS, clearance, pass_node, reach_node, read_node, set_loads
from springgym.rigid.flight import State, angular_velocity, combine, components, fly, turned
from springgym.rigid.kick import kick, rows

if TYPE_CHECKING:
    from springgym.forces import Terms
    from springgym.forces.memory import Memory


class Rigid(NamedTuple):
    """The rigid body, as its kernel takes it."""

    shape: np.ndarray
    """(N, 3) particles in principal axes, from the pin or the centre of mass [m]"""
    moments: np.ndarray
    """(3,) [kg·m²]"""
    triad: np.ndarray
    """(3, 3) rows: the body's `triad` in principal axes"""
    markers: np.ndarray
    """(3,) the particles of that triad"""
    pivot: int
    """the pinned particle, or −1"""
    moves: bool
    """whether any particle is free"""
    turns: bool
    """whether it does more than to move along: not so of a single particle"""
    stages: np.ndarray
    """(stages,) the composition: shares of the step that its second-order steps take"""


Twin: TypeAlias = "tuple[Rigid, Numbers, Terms]"
"""What kernels take of a rigid body: itself, as `Solid` has it its asymmetry, and what acts on it."""


class Solid(NamedTuple):
    """A body in a call, as its steps take it."""

    rigid: Rigid
    asymmetry: Numbers
    """1/I₂ − 1/I₁ [1/(kg·m²)], (1,), or None"""
    axes: Block
    """the principal axes in world coordinates where `State.q` is the identity"""
    centre: Vector
    """of mass, in body coordinates [m]"""
    total: Number
    """mass [kg]"""
    lightness: Number
    """1/mass [1/kg], or 0 of a pinned body"""
    terms: Terms
    """what acts on it"""


@compiled
def orientation(x: Rows, rigid: Rigid) -> Block:
    """Return the principal axes in world coordinates, from the triads of the particles and of the shape."""
    here = triad(x, rigid.markers)
    e1, e2, e3 = rows(rigid.triad)
    return (
        combine(here, vec(e1[0], e2[0], e3[0])),
        combine(here, vec(e1[1], e2[1], e3[1])),
        combine(here, vec(e1[2], e2[2], e3[2])),
    )


@compiled
def set_particles(x: Rows, v: Rows, state: State, solid: Solid) -> None:
    """Set the particles to where a rigid body has them."""
    _, spin, position, velocity = state
    now = turned(solid.axes, state.q)
    omega = combine(now, angular_velocity(spin, solid.rigid))
    for i in range(solid.terms.particles.mass.size):
        r = combine(now, row(solid.rigid.shape, i))
        set_row(x, i, position + r)
        set_row(v, i, velocity + cross(omega, r))


@compiled
def move(
    x: Rows,
    v: Rows,
    ledger: Ledger,
    workspace: np.ndarray,
    h: Number,
    steps: int,
    twin: Twin,
) -> None:
    """Take the particles of one block through ``steps`` steps; none only makes them rigid."""
    rigid, asymmetry, terms = twin
    if rigid.moves:
        go_back(x, v, ledger, steps, terms.memory)
        state, solid = read_state(x, v, rigid, asymmetry, terms)
        state = take(x, state, ledger, workspace, h, steps, solid, terms.memory)
        set_particles(x, v, state, solid)


@compiled
def read_state(x: Rows, v: Rows, rigid: Rigid, asymmetry: Numbers, terms: Terms) -> tuple[State, Solid]:
    """Return the `State` with the momenta of particles, where their triad is, and its `Solid`."""
    mass = terms.particles.mass
    zero = 0.0 * load(x, (0, 0))
    nothing = vec(zero, zero, zero)
    if rigid.pivot >= 0:
        position = row(x, rigid.pivot)
        velocity = nothing
    else:
        position = mass_centre(x, mass)
        velocity = mass_centre(v, mass)
    if rigid.turns:
        axes = orientation(x, rigid)
        spin = components(axes, angular_momentum(x, v, mass, position))
    else:
        axes = (vec(1.0 + zero, zero, zero), vec(zero, 1.0 + zero, zero), vec(zero, zero, 1.0 + zero))
        spin = nothing
    centre = mass_centre(rigid.shape, mass)
    total = load(mass, 0)
    for i in range(1, mass.size):
        total = total + load(mass, i)
    lightness = 1.0 / total
    if rigid.pivot >= 0:
        lightness = 0.0 * lightness
    solid = Solid(rigid, asymmetry, axes, centre, total, lightness, terms)
    return State((1.0 + zero, zero, zero, zero), spin, position, velocity), solid


@compiled
def go_back(x: Rows, v: Rows, ledger: Ledger, steps: int, memory: Memory | None) -> None:
    """Go back to where the last node was reached, if there are surfaces and steps to take."""
    if memory is not None and steps > 0:
        resume(x, v, ledger, memory)


@compiled
def take(
    x: Rows,
    state: State,
    ledger: Ledger,
    workspace: np.ndarray,
    h: Number,
    steps: int,
    solid: Solid,
    memory: Memory | None,
) -> State:
    """Take ``steps`` steps, through nodes where there are surfaces; returns the state that is to be read."""
    wrench, thrust = solid.terms.wrench, solid.terms.thrust
    if memory is not None:
        if steps > 0:
            state = take_among_surfaces(x, state, ledger, workspace, h, steps, solid)
    else:
        rigid, asymmetry = solid.rigid, solid.asymmetry
        last = steps * rigid.stages.size
        before = 0.0
        for n in range(last + 1):
            ahead = h * rigid.stages[n % rigid.stages.size] if n < last else 0.0
            if last > 0:
                state = kick(state, 0.5 * (before + ahead), ledger, solid, wrench, thrust)
            if n < last:
                state = fly(state, ahead, rigid, asymmetry)
            before = ahead
    return state


@compiled
def take_among_surfaces(
    x: Rows, state: State, ledger: Ledger, workspace: np.ndarray, h: Number, steps: int, solid: Solid
) -> State:
    """Take steps through nodes, the last of which the next call makes anew (`springgym.rigid.contact`)."""
    memory = solid.terms.memory
    b = workspace[LOADS]
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
        end, near, given = pass_node(node, near, ledger, workspace, solid)
        if n == steps:
            read = read_node(node, end, given, 0.0 * node.before[0], ledger, solid)
        span = span_of(1.0 + 0.0 * phase, h)
        begin, state = end, fly(end, span.out, solid.rigid, solid.asymmetry)
    return read


@compiled
def move_each(phase: Phase, workspace: np.ndarray, h: Number, steps: int, settles: bool, twins: Twin) -> None:
    """Take each body through all steps, by itself, if it ``settles``."""
    if settles:
        for body in range(bodies_of(phase.x)):
            x, v, ledger = of_body(phase, body)
            move(x, v, ledger, workspace, h, steps, of_body(twins, body))


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
