"""Implicit Euler: stable for any step, and a brake on every rotation."""

from __future__ import annotations

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Rows
from springgym.forces import act, actuate
from springgym.integrators.newton import copy_rows, record_losses, solve_stage
from springgym.integrators.record import Control, Integrator
from springgym.terms import Terms

RECORD = Integrator(
    name="implicit_euler",
    order=1,
    evaluations=1,
    imaginary_limit=float("inf"),
    real_limit=float("inf"),
    symplectic=False,
    negative_substeps=False,
    workspace=5,
    citation="Hairer, Wanner, Solving ODEs II, sec. IV.3, doi:10.1007/978-3-642-05221-7",
    implicit=True,
    iterative=True,
)


@compiled
def integrate(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, control: Control, steps: int, terms: Terms
) -> None:
    """v₁ = v₀ + h a(x₁, v₁), x₁ = x₀ + h v₁. A spin Ω loses h Ω³ a second."""
    h = control.step
    space, matrix = workspace
    a, b, change, x0, v0 = space[0], space[1], space[2], space[3], space[4]
    for n in range(steps + 1):
        actuate(x, b, terms)
        act(v, b, h if 0 < n < steps else 0.5 * h, ledger, terms)
        if n < steps:
            copy_rows(x, x0)
            copy_rows(v, v0)
            solve_stage((x0, v0), x, v, h, (matrix, a, change), control, terms)
            record_losses(x, v, a, h, ledger, terms)
