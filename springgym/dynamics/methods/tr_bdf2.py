"""TR-BDF2: second order; it damps unresolved vibrations, but hardly rotation."""

from __future__ import annotations

import math

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Rows
from springgym.core.language.vectors import row, set_row
from springgym.dynamics.forces import accelerate_and_damp, act, actuate
from springgym.dynamics.methods.newton import record_losses, solve_stage
from springgym.dynamics.methods.record import Control, Integrator
from springgym.dynamics.terms import Terms

RECORD = Integrator(
    name="tr_bdf2",
    order=2,
    evaluations=3,
    imaginary_limit=float("inf"),
    real_limit=float("inf"),
    symplectic=False,
    negative_substeps=False,
    workspace=7,
    citation="Bank et al. 1985, doi:10.1109/TCAD.1985.1270142; Hosea, Shampine 1996, "
    "doi:10.1016/0168-9274(95)00115-8",
    implicit=True,
    iterative=True,
)

GAMMA = 2 - math.sqrt(2)
TAU = GAMMA / 2
"""Time over which either stage is implicit, in steps: their matrices differ only by the state."""

OUTER = math.sqrt(2) / 4
"""Weight of the derivatives at the start and after the first stage; that of the last is `TAU`."""

FORWARD = 1 / (GAMMA * (2 - GAMMA))


@compiled
def integrate(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, control: Control, steps: int, terms: Terms
) -> None:
    """The trapezoidal rule for γ h, then the backward difference formula through both for (1 − γ) h."""
    h = control.step
    space, matrix = workspace
    a = space[0]
    b = space[1]
    change = space[2]
    x0 = space[3]
    v0 = space[4]
    x_start = space[5]
    v_start = space[6]
    for n in range(steps + 1):
        actuate(x, b, terms)
        act(v, b, h if 0 < n < steps else 0.5 * h, ledger, terms)
        if n == steps:
            break
        accelerate_and_damp(x, v, a, OUTER * h, ledger, terms)
        for i in range(x.shape[0]):
            set_row(x_start, i, row(x, i))
            set_row(v_start, i, row(v, i))
            set_row(x0, i, row(x, i) + TAU * h * row(v, i))
            set_row(v0, i, row(v, i) + TAU * h * row(a, i))
        solve_stage((x0, v0), x, v, TAU * h, (matrix, a, change), control, terms)
        record_losses(x, v, a, OUTER * h, ledger, terms)
        for i in range(x.shape[0]):
            x_past = row(x_start, i)
            v_past = row(v_start, i)
            set_row(x0, i, x_past + FORWARD * (row(x, i) - x_past))
            set_row(v0, i, v_past + FORWARD * (row(v, i) - v_past))
        solve_stage((x0, v0), x, v, TAU * h, (matrix, a, change), control, terms)
        record_losses(x, v, a, TAU * h, ledger, terms)
