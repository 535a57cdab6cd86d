"""The implicit midpoint rule: symplectic, and conserves angular momentum.

Implicit Euler for h/2, then h/2 more along the same derivative.
"""

from __future__ import annotations

from springgym.dynamics.methods.newton import one_stage
from springgym.dynamics.methods.record import Integrator

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

integrate = one_stage(0.5)
