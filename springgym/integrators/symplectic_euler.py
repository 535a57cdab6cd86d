"""Symplectic Euler with the dampers split off: the cheapest method that does not drift in energy."""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.forces import accelerate, actuate, drift
from springgym.forces.node import impulse
from springgym.integrators.record import Integrator

RECORD = Integrator(
    name="symplectic_euler",
    order=1,
    evaluations=1,
    imaginary_limit=2.0,
    real_limit=float("inf"),
    symplectic=True,
    negative_substeps=False,
    workspace=6,
    citation="Hairer, Lubich, Wanner, Geometric Numerical Integration, sec. I.1.2, doi:10.1007/3-540-30666-8",
)


@compiled
def integrate(x: Any, v: Any, ledger: Any, workspace: Any, h: Any, steps: Any, terms: Any) -> None:
    """All impulses at once, with the forces at x_n, then drift h."""
    a, b = workspace[0], workspace[1]
    space = (workspace[2], workspace[3], workspace[4], workspace[5])
    for n in range(steps):
        accelerate(x, a, space[0], terms)
        actuate(x, b, terms)
        impulse(x, v, a, b, h, n % 2 == 1, space, ledger, terms)
        drift(x, v, h)
