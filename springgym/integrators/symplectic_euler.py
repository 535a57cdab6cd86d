"""Symplectic Euler with the dampers split off: the cheapest method that does not drift in energy."""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.forces import accelerate, act, actuate, kick, move, relax
from springgym.integrators.record import Integrator

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
    meets_surfaces=True,
)


@compiled
def integrate(x: Any, v: Any, ledger: Any, workspace: Any, h: Any, steps: Any, terms: Any) -> None:
    raise NotImplementedError
