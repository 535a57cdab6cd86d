"""Blanes and Moan's sixth-order Runge–Kutta–Nyström splitting: the most accurate, for undamped scenes."""

from __future__ import annotations

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Rows
from springgym.forces import accelerate, actuate, drift
from springgym.integrators.record import Integrator
from springgym.integrators.splitting import kick_and_act
from springgym.terms import Terms

RECORD = Integrator(
    name="blanes_moan",
    order=6,
    evaluations=11,
    imaginary_limit=9.0735,
    real_limit=0.0,
    symplectic=True,
    negative_substeps=True,
    workspace=3,
    citation="Blanes, Moan 2002, doi:10.1016/S0377-0427(01)00492-7, SRKN 11 stages, order 6 (type b)",
)

STAGES = 11
B = (0.0414649985182624, 0.198128671918067, -0.0400061921041533, 0.0752539843015807, -0.0115113874206879)
A = (0.123229775946271, 0.290553797799558, -0.127049212625417, -0.246331761062075, 0.357208872795928)
KICKS = (*B, 0.5 - sum(B), 0.5 - sum(B), *B[:0:-1])
DRIFTS = (*A, 1 - 2 * sum(A), *A[::-1])


@compiled
def integrate(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, h: Number, steps: int, terms: Terms
) -> None:
    """Twelve kicks with eleven drifts between; the last kick of a step is one with the next step's first.

    On the stability interval of the oscillator lie two needles, ω h within 0.0005 of 3.1419 and 0.0008 of
    6.3486, where it grows by 7e-4 a step at most; an oscillator of varying frequency does not stay in one.
    The sixth order is that of forces of the positions alone; the actuators' work, whose power is not, is
    recorded to the fourth.
    """
    a, b, direction = workspace[0], workspace[1], workspace[2]
    last = STAGES * steps
    for n in range(last + 1):
        accelerate(x, a, direction, terms)
        actuate(x, b, terms)
        stage = n % STAGES
        weight = 2 * KICKS[0] if stage == 0 and 0 < n < last else KICKS[stage]
        kick_and_act(v, a, b, h * weight, ledger, terms)
        if n < last:
            drift(x, v, h * DRIFTS[stage])
