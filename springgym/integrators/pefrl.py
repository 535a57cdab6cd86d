"""PEFRL: fourth-order splitting with small errors, for undamped scenes."""

from __future__ import annotations

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Number, Rows
from springgym.forces import accelerate, actuate, drift
from springgym.integrators.record import Integrator
from springgym.integrators.splitting import kick_and_act
from springgym.terms import Terms

RECORD = Integrator(
    name="pefrl",
    order=4,
    evaluations=4,
    imaginary_limit=2.9894,
    real_limit=0.0,
    symplectic=True,
    negative_substeps=True,
    workspace=3,
    citation="Omelyan, Mryglod, Folk 2002, doi:10.1016/S0010-4655(02)00451-4",
)

XI, LAMBDA, CHI = 0.1786178958448091, -0.2123418310626054, -0.06626458266981849
DRIFTS = (XI, CHI, 1 - 2 * (CHI + XI), CHI)
KICKS = (0.5 - LAMBDA, LAMBDA, LAMBDA, 0.5 - LAMBDA)


@compiled
def integrate(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, h: Number, steps: int, terms: Terms
) -> None:
    """Drifts ξ, χ, 1 − 2(χ + ξ), χ, ξ with kicks ½ − λ, λ, λ, ½ − λ between; neighbouring drifts are one."""
    a, b, direction = workspace[0], workspace[1], workspace[2]
    for n in range(4 * steps):
        stage = n % 4
        drift(x, v, h * (2 * XI if stage == 0 and n > 0 else DRIFTS[stage]))
        accelerate(x, a, direction, terms)
        actuate(x, b, terms)
        kick_and_act(v, a, b, h * KICKS[stage], ledger, terms)
    drift(x, v, h * XI)
