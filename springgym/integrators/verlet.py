"""Velocity Verlet with the dampers split off: the default."""

from __future__ import annotations

import numpy as np

from springgym.contact.totals import halve_totals, remember_totals, resume_totals
from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Rows
from springgym.core.lanes import bodies_of, load, of_body
from springgym.forces import (
    act,
    actuate,
    divide_and_kick,
    divide_by_mass,
    kick_and_drift,
    kick_through,
    paired,
    relax,
    set_forces,
)
from springgym.forces.cycle import count_step, damps_somewhere, relax_in_turn, turn_in_turn
from springgym.forces.memory import (
    PHASE,
    keep_expected,
    recall_expected,
    remember,
    resume,
    share_actions,
    steer,
)
from springgym.integrators.node import (
    PASSES,
    READS,
    START,
    STARTS,
    Bodies,
    Node,
    Space,
    acts_amid,
    find_touching,
    next_phase,
    node_at,
    note_busy,
    pass_node,
)
from springgym.integrators.record import Integrator
from springgym.terms import Terms

RECORD = Integrator(
    name="verlet",
    order=2,
    evaluations=1,
    imaginary_limit=2.0,
    real_limit=float("inf"),
    symplectic=True,
    negative_substeps=False,
    workspace=3,
    citation="Swope et al. 1982, doi:10.1063/1.442716; splitting: Strang 1968, doi:10.1137/0705041",
    meets_bodies=True,
    meets_surfaces=True,
    cycles=True,
)


@compiled
def integrate(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, h: Number, steps: int, terms: Terms
) -> None:
    """Damp h/2, kick h/2, drift h, kick h/2, damp h/2; the actuators act amid the damping.

    What loses or adds energy does so where velocities and positions are of the same time: half a kick
    later, spinning alone would look like stretching. All that depends on the positions x_n is found
    once, when the step arrives there: ``steps`` steps take ``steps`` + 1 force evaluations. Between two steps
    the damping of both is one sweep, its direction alternating, where the body allows it.
    """
    a, b, direction = workspace[0], workspace[1], workspace[2]
    pair = paired(terms.dampers)
    for n in range(steps + 1):
        set_forces(x, a, direction, True, terms)
        actuate(x, b, terms)
        inner = 0 < n < steps
        if inner and not acts_amid(terms):
            kick_through(x, v, a, 0.5 * h, h, terms.particles)
            continue
        whole = inner and not pair
        divide_and_kick(a, v, v, 0.5 * h if n > 0 else 0.0, terms.particles)
        if n > 0 and (not whole or n % 2 == 1):
            relax(v, direction, True, whole, ledger, terms)
        act(v, b, h if inner else 0.5 * h, ledger, terms)
        if n < steps:
            if not whole or n % 2 == 0:
                relax(v, direction, False, whole, ledger, terms)
            kick_and_drift(x, v, a, h)


@compiled
def integrate_in_cycles(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, h: Number, steps: int, terms: Terms
) -> None:
    """The same, but dampers and wrench act in cycles of several steps, see `springgym.forces.cycle`.

    The ``steps`` are those of whole cycles. Calls of a and b steps are one of a + b, to the bit.
    """
    a, b, direction = workspace[0], workspace[1], workspace[2]
    cycle = terms.cycle
    for n in range(steps + 1):
        before, last = 0.5 * h if n > 0 else 0.0, n == steps
        damps = damps_somewhere(cycle)
        turns = terms.wrench is not None and n % (cycle.every // 2) == 0
        set_forces(x, a, direction, damps, terms)
        if not (damps or turns or last):
            kick_through(x, v, a, before, h, terms.particles)
        else:
            divide_and_kick(a, v, v, before, terms.particles)
            for part in range(3):
                if part == 1 and turns:
                    turn_in_turn(x, v, b, n, steps, h, ledger, terms)
                elif part != 1 and damps:
                    relax_in_turn(v, direction, part == 2, ledger, terms)
            if not last:
                kick_and_drift(x, v, a, h)
        if not last:
            count_step(cycle)


@compiled
def integrate_through_nodes(
    x: Rows, v: Rows, ledger: Ledger, workspace: Space, h: Number, steps: int, terms: Terms
) -> None:
    """The same where there are surfaces or bodies collide: all acts at nodes between drifts.

    All bodies take each step together; those that do not collide may also come here one by one. The state is
    read amid the last node, which the next call makes anew: see `springgym.integrators.node`. As many steps
    as `START` and `LOOK` are none: it is told which bodies of fresh copies touch, or the last node is made
    anew.
    """
    bodies = Bodies(x, v, ledger, workspace, terms)
    phase, goes, end = load(of_body(terms.memory, 0).marks, PHASE), steps != START, max(steps, 0)
    if goes:
        for n in range(bodies_of(x)):
            go_back(of_body(bodies, n), phase)
        resume_totals(phase, terms.collisions)
    for n in range(end + 1):
        node = node_at(phase, h, STARTS if not goes else (READS if n == end else PASSES))
        phase = next_phase(phase)
        problem = find_touching(bodies, node, workspace.exchange)
        if goes:
            count_nodes(bodies, n > 0)
            for body in range(bodies_of(x)):
                arrive(of_body(bodies, body), node, n == 0)
            if n == end:
                remember_totals(terms.collisions)
        pass_node(bodies, node, problem)
    if goes:
        halve_totals(terms.collisions)


@compiled
def count_nodes(bodies: Bodies, passed: bool) -> None:
    """Advance the damping cycles of all bodies by a step, if the call has ``passed`` a node already."""
    if passed:
        for body in range(bodies_of(bodies.x)):
            count_step(of_body(bodies.terms, body).cycle)


@compiled
def go_back(own: Bodies, phase: Number) -> None:
    """Go back to where a body's last node was reached, and to what contact was expected to give there."""
    memory, space = own.terms.memory, own.space
    resume(own.x, own.v, own.ledger, memory)
    recall_expected(phase, space.given, memory.given)
    for i in range(own.x.shape[0]):
        space.busy[i] = True
    note_busy(own.terms.body, True, space.exchange)


@compiled
def arrive(own: Bodies, node: Node, first: bool) -> None:
    """Find the forces at a node on a body; how it is reached is remembered where it is to be read."""
    x, space, terms, memory, last = own.x, own.space, own.terms, own.terms.memory, node.stage == READS
    set_forces(x, space.a, space.direction, damps_somewhere(terms.cycle), terms)
    actuate(x, space.b, terms)
    if acts_amid(terms):
        divide_and_kick(space.a, own.v, space.w, node.span.lead, terms.particles)
    else:
        divide_by_mass(space.a, terms.particles)
    if first:
        share_actions(space.b, node.phase, memory, memory.pushed, terms.drive)
    else:
        steer(memory, terms.drive)
    if last:
        remember(x, space.b, node.phase, own.ledger, memory, memory.pushed)
        keep_expected(space.given, memory.given)
