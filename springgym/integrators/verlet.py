"""Velocity Verlet with the dampers split off: the default."""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.forces import accelerate, act, actuate, drift, kick, paired, relax
from springgym.forces.node import ARRIVE, LEAVE, WHOLE, keep, lower, meet_surfaces, raise_to_read, set_out
from springgym.integrators.record import Integrator

RECORD = Integrator(
    name="verlet",
    order=2,
    evaluations=1,
    imaginary_limit=2.0,
    real_limit=float("inf"),
    symplectic=True,
    negative_substeps=False,
    workspace=8,
    citation="Swope et al. 1982, doi:10.1063/1.442716; splitting: Strang 1968, doi:10.1137/0705041",
    meets_surfaces=True,
)


@compiled
def integrate(x: Any, v: Any, ledger: Any, workspace: Any, h: Any, steps: Any, terms: Any) -> None:
    """Drift h between nodes, where all else acts: half of it where a call of ``steps`` begins and ends."""
    choose(x, v, ledger, workspace, h, steps, terms, terms.planes, terms.bowl)


@compiled
def choose(
    x: Any, v: Any, ledger: Any, workspace: Any, h: Any, steps: Any, terms: Any, planes: Any, bowl: Any
) -> None:
    if planes is None and bowl is None:
        in_the_open(x, v, ledger, workspace, h, steps, terms)
    if planes is not None:
        on_surfaces(x, v, ledger, workspace, h, steps, terms)
    if bowl is not None:
        on_surfaces(x, v, ledger, workspace, h, steps, terms)


@compiled
def in_the_open(x: Any, v: Any, ledger: Any, workspace: Any, h: Any, steps: Any, terms: Any) -> None:
    """Damp h/2, kick h/2, drift h, kick h/2, damp h/2; the actuators act amid the damping.

    What loses or adds energy does so where velocities and positions are of the same time: half a kick
    later, spinning alone would look like stretching. All that depends on the positions x_n is found
    once, when the step arrives there: ``steps`` steps take ``steps`` + 1 force evaluations. Between two steps
    the damping of both is one sweep, its direction alternating, where the body allows it.
    """
    a, b, direction = workspace[0], workspace[1], workspace[2]
    pair = paired(terms.dampers)
    for n in range(steps + 1):
        accelerate(x, a, direction, terms)
        actuate(x, b, terms)
        inner = 0 < n < steps
        whole = inner and not pair
        if n > 0:
            kick(v, a, 0.5 * h)
            if not whole or n % 2 == 1:
                relax(v, direction, True, whole, ledger, terms)
        act(v, b, h if inner else 0.5 * h, ledger, terms)
        if n < steps:
            if not whole or n % 2 == 0:
                relax(v, direction, False, whole, ledger, terms)
            kick(v, a, 0.5 * h)
            drift(x, v, h)


@compiled
def on_surfaces(x: Any, v: Any, ledger: Any, workspace: Any, h: Any, steps: Any, terms: Any) -> None:
    """The same with contact and friction at the nodes (`springgym.forces.node`)."""
    a, b, direction = workspace[0], workspace[1], workspace[2]
    space = (workspace[3], workspace[4], workspace[5], workspace[6], workspace[7])
    pair = paired(terms.dampers)
    lower(x, ledger)
    for n in range(steps + 1):
        accelerate(x, a, direction, terms)
        actuate(x, b, terms)
        inner = 0 < n < steps
        whole = inner and not pair
        part = WHOLE if inner else (LEAVE if n == 0 else ARRIVE)
        if n > 0:
            set_out(x, v, a, b, h, space, terms)
            if not whole or n % 2 == 1:
                relax(v, direction, True, whole, ledger, terms)
        else:
            keep(v, space)
        act(v, b, h if inner else 0.5 * h, ledger, terms)
        if n < steps:
            if not whole or n % 2 == 0:
                relax(v, direction, False, whole, ledger, terms)
        meet_surfaces(x, v, a, h, part, space, ledger, terms)
        if n < steps:
            kick(v, a, 0.5 * h)
            drift(x, v, h)
    raise_to_read(x, ledger, terms.springs)
