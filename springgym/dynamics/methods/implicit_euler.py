"""Implicit Euler: stable for any step, but it damps every rotation.

v₁ = v₀ + h a(x₁, v₁), x₁ = x₀ + h v₁. A spin Ω decreases by h Ω³ per second.
"""

from __future__ import annotations

from springgym.dynamics.methods.newton import one_stage
from springgym.dynamics.methods.record import Integrator

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

integrate = one_stage(1.0)
