"""The equations of implicit methods: their matrix, and Newton's method for a stage or a one-stage step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number, Rows
from springgym.core.language.lanes import any_lane, select
from springgym.core.language.memory import load, store
from springgym.core.language.vectors import block, choose, dot, row, set_row, vec
from springgym.dynamics.forces import accelerate_and_damp, act, actuate
from springgym.dynamics.forces.springs import longest_spring, pull_jacobian
from springgym.dynamics.methods.envelope import Envelope, add, factorise, set_block, solve, subtract
from springgym.dynamics.methods.record import Control, StepCount
from springgym.dynamics.terms import Dampers, Particles, Springs, Terms

ITERATION_LIMIT = 25


@compiled
def record_losses(x: Rows, v: Rows, a: Rows, weight: Number, ledger: Ledger, terms: Terms) -> None:
    """Add ``weight`` [s] times the power lost at a state to the ledger."""
    record_damping(x, v, a, weight, ledger, terms, terms.dampers)


@compiled
def record_damping(
    x: Rows, v: Rows, a: Rows, weight: Number, ledger: Ledger, terms: Terms, dampers: Dampers | None
) -> None:
    if dampers is not None and ledger is not None:
        accelerate_and_damp(x, v, a, weight, ledger, terms)


@compiled
def assemble(matrix: Envelope, x: Rows, v: Rows, tau: Number, terms: Terms) -> None:
    """Set the matrix to M − τ ∂F/∂v − τ² ∂F/∂x and factorise it; rows of pinned particles are M alone."""
    particles = terms.particles
    nothing = 0.0 * load(x, (0, 0))
    zero = vec(nothing, nothing, nothing)
    for n in range(matrix.lower.shape[0]):
        set_row(matrix.lower, n, zero)
        set_row(matrix.upper, n, zero)
    for i in range(particles.mass.size):
        m = load(particles.mass, i) + nothing
        set_block(
            matrix.lower,
            matrix.start[i] + i,
            (vec(m, nothing, nothing), vec(nothing, m, nothing), vec(nothing, nothing, m)),
        )
    subtract_jacobian(matrix, x, v, tau, particles, terms.springs, terms.dampers)
    factorise(matrix, terms.dampers)


@compiled
def subtract_jacobian(
    matrix: Envelope,
    x: Rows,
    v: Rows,
    tau: Number,
    particles: Particles,
    springs: Springs,
    dampers: Dampers | None,
) -> None:
    """Subtract τ ∂F/∂v + τ² ∂F/∂x, F the forces of springs and dampers."""
    if springs is not None:
        for s in range(springs.first.size):
            ends = np.intp(springs.first[s]), np.intp(springs.second[s])
            pull = pull_jacobian(x, v, s, tau * tau, tau, springs, dampers)
            for end in ends:
                if particles.free[end]:
                    at = matrix.start[end] + end
                    set_block(matrix.lower, at, add(block(matrix.lower, at), pull))
            if particles.free[ends[0]] and particles.free[ends[1]]:
                at = matrix.start[max(ends)] + min(ends)
                set_block(matrix.lower, at, subtract(block(matrix.lower, at), pull))
                set_block(matrix.upper, at, subtract(block(matrix.upper, at), pull))


@compiled
def solve_stage(
    start: tuple[Rows, Rows],
    x: Rows,
    v: Rows,
    tau: Number,
    space: tuple[Envelope, Rows, Rows],
    control: Control,
    terms: Terms,
) -> None:
    """Solve v = v₀ + τ a(x, v) with x = x₀ + τ v by Newton's method, starting from ``v``.

    A copy that does not converge is set to NaN. ``start`` holds x₀ and v₀; ``space`` holds the matrix, and
    arrays for the accelerations and the corrections.
    """
    x0, v0 = start
    matrix, a, change = space
    particles = terms.particles
    bound = (control.absolute + control.relative * longest_spring(x, terms.springs)) / tau
    bound = bound * bound
    largest = 2.0 * bound + 1.0
    for _ in range(ITERATION_LIMIT):
        move(x, x0, v, tau)
        accelerate_and_damp(x, v, a, 0.0, None, terms)
        assemble(matrix, x, v, tau, terms)
        for i in range(particles.mass.size):
            lacking = row(v0, i) - row(v, i) + tau * row(a, i)
            set_row(change, i, load(particles.mass, i) * lacking)
        solve(matrix, change)
        seeking = largest > bound
        peak = 0.0 * bound
        for i in range(particles.mass.size):
            size = dot(row(change, i), row(change, i))
            peak = select(size < peak, peak, size)  # NaN if one is NaN
            set_row(v, i, choose(seeking, row(v, i) + row(change, i), row(v, i)))
        once = select(seeking, 1.0 + 0.0 * bound, 0.0 * bound)
        store(control.counts, StepCount.ITERATIONS, load(control.counts, StepCount.ITERATIONS) + once)
        largest = select(seeking, peak, largest)
        if not any_lane(largest > bound):
            break
    for i in range(particles.mass.size):
        for axis in range(3):
            store(v, (i, axis), select(largest > bound, np.nan, load(v, (i, axis))))
    move(x, x0, v, tau)


def one_stage(share: float) -> Callable[..., None]:
    """Return the method that takes a step of implicit Euler for the fraction ``share`` of h, 1 or ½.

    For the rest of h it continues along the derivative of that step.
    """

    @compiled
    def integrate(
        x: Rows, v: Rows, ledger: Ledger, workspace: np.ndarray, control: Control, steps: int, terms: Terms
    ) -> None:
        h = control.step
        space, matrix = workspace
        a = space[0]
        b = space[1]
        change = space[2]
        x0 = space[3]
        v0 = space[4]
        for n in range(steps + 1):
            actuate(x, b, terms)
            act(v, b, h if 0 < n < steps else 0.5 * h, ledger, terms)
            if n < steps:
                copy_rows(x, x0)
                copy_rows(v, v0)
                solve_stage((x0, v0), x, v, share * h, (matrix, a, change), control, terms)
                record_losses(x, v, a, h, ledger, terms)
                if share < 1.0:
                    for i in range(x.shape[0]):
                        set_row(x, i, row(x0, i) + h * row(v, i))
                        set_row(v, i, 2.0 * row(v, i) - row(v0, i))

    return integrate


@compiled
def copy_rows(source: Rows, target: Rows) -> None:
    for i in range(source.shape[0]):
        set_row(target, i, row(source, i))


@compiled
def move(x: Rows, x0: Rows, v: Rows, tau: Number) -> None:
    """x = x₀ + τ v."""
    for i in range(x.shape[0]):
        set_row(x, i, row(x0, i) + tau * row(v, i))
