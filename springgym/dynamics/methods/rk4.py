"""The classical Runge–Kutta method: the paper's."""

from __future__ import annotations

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number, Rows
from springgym.core.language.vectors import add_scaled, plus_scaled, row, set_row
from springgym.dynamics.forces import derivative
from springgym.dynamics.forces.paper_contact import clamp
from springgym.dynamics.methods.record import Integrator
from springgym.dynamics.terms import Terms

RECORD = Integrator(
    name="rk4",
    order=4,
    evaluations=4,
    imaginary_limit=2.8284,
    real_limit=2.7852,
    symplectic=False,
    negative_substeps=False,
    workspace=6,
    citation="Kutta 1901; Hairer, Nørsett, Wanner, Solving ODEs I, sec. II.1",
)


@compiled
def integrate(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, h: Number, steps: int, terms: Terms
) -> None:
    """Four derivatives per step, weighted 1, 2, 2, 1, as are the powers for the ledger."""
    a = workspace[0]
    b = workspace[1]
    xs = workspace[2]
    vs = workspace[3]
    dx = workspace[4]
    dv = workspace[5]
    for _ in range(steps):
        derivative(x, v, a, b, h / 6.0, ledger, terms)
        for i in range(x.shape[0]):
            velocity = row(v, i)
            acceleration = row(a, i)
            set_row(dx, i, velocity)
            set_row(dv, i, acceleration)
            set_row(xs, i, plus_scaled(row(x, i), 0.5 * h, velocity))
            set_row(vs, i, plus_scaled(velocity, 0.5 * h, acceleration))
        for stage in range(2):
            ahead = 0.5 * h if stage == 0 else h
            derivative(xs, vs, a, b, h / 3.0, ledger, terms)
            for i in range(x.shape[0]):
                velocity = row(vs, i)
                acceleration = row(a, i)
                add_scaled(dx, i, 2.0, velocity)
                add_scaled(dv, i, 2.0, acceleration)
                set_row(xs, i, plus_scaled(row(x, i), ahead, velocity))
                set_row(vs, i, plus_scaled(row(v, i), ahead, acceleration))
        derivative(xs, vs, a, b, h / 6.0, ledger, terms)
        for i in range(x.shape[0]):
            add_scaled(x, i, h / 6.0, row(dx, i) + row(vs, i))
            add_scaled(v, i, h / 6.0, row(dv, i) + row(a, i))
        clamp(x, v, terms.particles, terms.surfaces, terms.paper_law)
