"""RODAS3: a stiffly accurate Rosenbrock method, with one matrix and four linear systems per step."""

from __future__ import annotations

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number, Rows
from springgym.core.language.memory import load
from springgym.core.language.vectors import add_row, apply, row, set_row
from springgym.dynamics.forces import accelerate_and_damp, act, actuate
from springgym.dynamics.forces.springs import pull_jacobian
from springgym.dynamics.methods.envelope import solve
from springgym.dynamics.methods.newton import assemble, record_losses
from springgym.dynamics.methods.record import Integrator
from springgym.dynamics.terms import Dampers, Particles, Springs, Terms

RECORD = Integrator(
    name="rodas3",
    order=3,
    evaluations=3,
    imaginary_limit=float("inf"),
    real_limit=float("inf"),
    symplectic=False,
    negative_substeps=False,
    workspace=13,
    citation="Sandu et al. 1997, doi:10.1016/S1352-2310(97)83212-8",
    implicit=True,
)

STAGES = 4
GAMMA = 0.5
A = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [2, 0, 0, 0], [2, 0, 1, 0]], float)
C = np.array([[0, 0, 0, 0], [4, 0, 0, 0], [1, -1, 0, 0], [1, -1, -8 / 3, 0]], float)
M = np.array([2, 0, 1, 1], float)


@compiled
def integrate(
    x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, h: Number, steps: int, terms: Terms
) -> None:
    """Stage i solves (1/(γh) − J) k_i = f(y + Σ A_ij k_j) + Σ (C_ij/h) k_j; then y gains Σ M_i k_i.

    With k = (p, q) and the stage's velocity and acceleration u and a this is
    (M − γh ∂F/∂v − (γh)² ∂F/∂x) q = γh M r_v + (γh)² ∂F/∂x r_x and p = γh (r_x + q), where
    r_x = u + Σ (C_ij/h) p_j and r_v = a + Σ (C_ij/h) q_j. Losses are recorded by the trapezoidal rule.
    """
    space, matrix = workspace
    a = space[0]
    b = space[1]
    xs = space[2]
    vs = space[3]
    ahead = space[4]
    q = space[5:9]
    p = space[9:13]
    tau = GAMMA * h
    for n in range(steps + 1):
        actuate(x, b, terms)
        act(v, b, h if 0 < n < steps else 0.5 * h, ledger, terms)
        if n == steps:
            break
        assemble(matrix, x, v, tau, terms)
        record_losses(x, v, a, 0.5 * h, ledger, terms)
        for stage in range(STAGES):
            for i in range(x.shape[0]):
                u = row(x, i)
                w = row(v, i)
                for j in range(stage):
                    u = u + A[stage, j] * row(p[j], i)
                    w = w + A[stage, j] * row(q[j], i)
                set_row(xs, i, u)
                set_row(vs, i, w)
            if stage != 1:  # the second stage has the state of the first
                accelerate_and_damp(xs, vs, a, 0.0, None, terms)
            for i in range(x.shape[0]):
                u = row(vs, i)
                w = row(a, i)
                for j in range(stage):
                    u = u + C[stage, j] / h * row(p[j], i)
                    w = w + C[stage, j] / h * row(q[j], i)
                set_row(ahead, i, u)
                set_row(q[stage], i, tau * load(terms.particles.mass, i) * w)
            add_stiffness(x, v, ahead, q[stage], tau * tau, terms.particles, terms.springs, terms.dampers)
            solve(matrix, q[stage])
            for i in range(x.shape[0]):
                set_row(p[stage], i, tau * (row(ahead, i) + row(q[stage], i)))
        for i in range(x.shape[0]):
            for j in range(STAGES):
                add_row(x, i, M[j] * row(p[j], i))
                add_row(v, i, M[j] * row(q[j], i))
        record_losses(x, v, a, 0.5 * h, ledger, terms)


@compiled
def add_stiffness(
    x: Rows,
    v: Rows,
    u: Rows,
    out: Rows,
    factor: Number,
    particles: Particles,
    springs: Springs,
    dampers: Dampers | None,
) -> None:
    """Add factor × ∂F/∂x u to the free particles of ``out``."""
    if springs is not None:
        for s in range(springs.first.size):
            i = springs.first[s]
            j = springs.second[s]
            pull = apply(pull_jacobian(x, v, s, factor, 0.0, springs, dampers), row(u, j) - row(u, i))
            if particles.free[i]:
                add_row(out, i, pull)
            if particles.free[j]:
                add_row(out, j, -1.0 * pull)
