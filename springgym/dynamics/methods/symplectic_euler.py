"""Symplectic Euler with the dampers split off: the cheapest method that does not drift in energy."""

from __future__ import annotations

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number, Rows
from springgym.dynamics.forces import accelerate, act, actuate, drift, kick, relax
from springgym.dynamics.methods.record import Integrator
from springgym.dynamics.terms import Terms

RECORD = Integrator(
    name="symplectic_euler",
    order=1,
    evaluations=1,
    imaginary_limit=2.0,
    real_limit=float("inf"),
    symplectic=True,
    negative_substeps=False,
    workspace=3,
    citation="Hairer, Lubich, Wanner, Geometric Numerical Integration, sec. I.1.2, doi:10.1007/3-540-30666-8",
)


@compiled
def integrate(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, h: Number, steps: int, terms: Terms
) -> None:
    """Kick h/2, damp h/2, actuate h, damp h/2, kick h/2, all with the forces at x_n, then drift h.

    The velocity is that of half a step before x_n: only half a kick later, it is of the same time. Before,
    pure rotation looks like compression, and dampers would dissipate what the springs' kicks add.
    """
    a = workspace[0]
    b = workspace[1]
    direction = workspace[2]
    for _ in range(steps):
        accelerate(x, a, direction, terms)
        actuate(x, b, terms)
        kick(v, a, 0.5 * h)
        relax(v, direction, False, False, ledger, terms)
        act(v, b, h, ledger, terms)
        relax(v, direction, True, False, ledger, terms)
        kick(v, a, 0.5 * h)
        drift(x, v, h)
