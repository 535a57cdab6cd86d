"""Velocity Verlet with the dampers split off: the default."""

from __future__ import annotations

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number, Rows
from springgym.dynamics.forces import (
    act,
    actuate,
    divide_and_kick,
    kick_and_drift,
    kick_through,
    paired,
    relax,
    set_forces,
)
from springgym.dynamics.forces.cycle import apply_wrench, count_step, damps_somewhere, relax_in_turn
from springgym.dynamics.methods.node import PARTICLES, Space, acts_between_kicks
from springgym.dynamics.methods.record import Integrator
from springgym.dynamics.step import Bodies, advance_alone
from springgym.dynamics.terms import Terms

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
    """Damp h/2, kick h/2, drift h, kick h/2, damp h/2; actuators act between the dampings of two steps.

    Dampers and actuators act where velocities and positions belong to the same time: half a kick later, pure
    rotation would look like stretching. All that depends on the positions x_n is computed once: ``steps``
    steps take ``steps`` + 1 force evaluations. The damping of two adjacent steps is one sweep, of alternating
    direction, unless the dampers are paired.
    """
    a = workspace[0]
    b = workspace[1]
    direction = workspace[2]
    pair = paired(terms.dampers)
    for n in range(steps + 1):
        set_forces(x, a, direction, True, terms)
        actuate(x, b, terms)
        inner = 0 < n < steps
        if inner and not acts_between_kicks(terms):
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
    """Advance as `integrate` does, but with dampers and wrench in cycles, see
    `springgym.dynamics.forces.cycle`.

    ``steps`` is a whole number of cycles. Calls of a and b steps are bit-identical to one of a + b.
    """
    a = workspace[0]
    b = workspace[1]
    direction = workspace[2]
    cycle = terms.cycle
    for n in range(steps + 1):
        before = 0.5 * h if n > 0 else 0.0
        last = n == steps
        damps = damps_somewhere(cycle)
        turns = terms.wrench is not None and n % (cycle.every // 2) == 0
        set_forces(x, a, direction, damps, terms)
        if not (damps or turns or last):
            kick_through(x, v, a, before, h, terms.particles)
        else:
            divide_and_kick(a, v, v, before, terms.particles)
            for part in range(3):
                if part == 1 and turns:
                    apply_wrench(x, v, b, n, steps, h, ledger, terms)
                elif part != 1 and damps:
                    relax_in_turn(v, direction, part == 2, ledger, terms)
            if not last:
                kick_and_drift(x, v, a, h)
        if not last:
            count_step(cycle)


@compiled
def integrate_at_surfaces(
    x: Rows, v: Rows, ledger: Ledger, workspace: Space, h: Number, steps: int, terms: Terms
) -> None:
    """Advance one body whose particles may touch surfaces, see `springgym.dynamics.step`."""
    advance_alone(PARTICLES, Bodies(x, v, ledger, workspace, terms, None), h, steps)
