"""PEFRL: fourth-order splitting with small errors, for undamped scenes."""

from __future__ import annotations

from springgym.dynamics.methods.record import Integrator
from springgym.dynamics.methods.splitting import splitting

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

XI = 0.1786178958448091
LAMBDA = -0.2123418310626054
CHI = -0.06626458266981849

integrate = splitting(
    drifts=(XI, CHI, 1 - 2 * (CHI + XI), CHI, XI), kicks=(0.5 - LAMBDA, LAMBDA, LAMBDA, 0.5 - LAMBDA)
)
