"""Velocity Verlet with the dampers split off: the default."""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.forces import accelerate, actuate, drift
from springgym.forces.node import impulse
from springgym.integrators.record import Integrator

RECORD = Integrator(
    name="verlet",
    order=2,
    evaluations=1,
    imaginary_limit=2.0,
    real_limit=float("inf"),
    symplectic=True,
    negative_substeps=False,
    workspace=6,
    citation="Swope et al. 1982, doi:10.1063/1.442716; splitting: Strang 1968, doi:10.1137/0705041",
    meets_surfaces=True,
)


@compiled
def integrate(x: Any, v: Any, ledger: Any, workspace: Any, h: Any, steps: Any, terms: Any) -> None:
    """Drift h/2, all impulses at once, drift h/2; between two nodes the drifts are one."""
    a, b = workspace[0], workspace[1]
    space = (workspace[2], workspace[3], workspace[4], workspace[5])
    for n in range(steps):
        drift(x, v, 0.5 * h if n == 0 else h)
        accelerate(x, a, space[0], terms)
        actuate(x, b, terms)
        impulse(x, v, a, b, h, n % 2 == 1, space, ledger, terms)
    if steps > 0:
        drift(x, v, 0.5 * h)
