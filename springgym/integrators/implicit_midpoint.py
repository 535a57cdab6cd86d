"""The implicit midpoint rule: symplectic, and keeps angular momentum."""

from __future__ import annotations

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Rows
from springgym.core.vectors import row, set_row
from springgym.forces import act, actuate
from springgym.integrators.newton import copy_rows, record_losses, solve_stage
from springgym.integrators.record import Control, Integrator
from springgym.terms import Terms

RECORD = Integrator(
    name="implicit_midpoint",
    order=2,
    evaluations=1,
    imaginary_limit=float("inf"),
    real_limit=float("inf"),
    symplectic=True,
    negative_substeps=False,
    workspace=5,
    citation="Hairer, Lubich, Wanner, Geometric Numerical Integration, sec. II.1, doi:10.1007/3-540-30666-8",
    implicit=True,
    iterative=True,
)


@compiled
def integrate(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, control: Control, steps: int, terms: Terms
) -> None:
    """Implicit Euler for h/2, and as much again along the same derivative."""
    h = control.step
    space, matrix = workspace
    a, b, change, x0, v0 = space[0], space[1], space[2], space[3], space[4]
    for n in range(steps + 1):
        actuate(x, b, terms)
        act(v, b, h if 0 < n < steps else 0.5 * h, ledger, terms)
        if n < steps:
            copy_rows(x, x0)
            copy_rows(v, v0)
            solve_stage((x0, v0), x, v, 0.5 * h, (matrix, a, change), control, terms)
            record_losses(x, v, a, h, ledger, terms)
            for i in range(x.shape[0]):
                set_row(x, i, row(x0, i) + h * row(v, i))
                set_row(v, i, 2.0 * row(v, i) - row(v0, i))
