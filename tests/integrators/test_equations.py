"""The linear systems of implicit methods against dense algebra and finite differences."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest

from springgym.core.blocks import block_array, numbers
from springgym.integrators.envelope import envelope, solve
from springgym.integrators.newton import assemble
from springgym.simulator import Simulator
from tests.integrators.problems import accelerations, simulator, tetrahedron


@numba.njit(error_model="numpy", _nrt=False)
def assemble_and_solve(matrix: Any, x: Any, v: Any, tau: Any, y: Any, terms: Any) -> None:
    assemble(matrix, x, v, tau, terms)
    solve(matrix, y)


def dense(made: Simulator, x: np.ndarray, v: np.ndarray, tau: float) -> np.ndarray:
    """M − τ ∂F/∂v − τ² ∂F/∂x by central differences, pinned particles left to themselves."""
    body, free = made.scene.body, made.scene.free
    mass = np.repeat(body.masses, 3)
    matrix = np.diag(mass)
    for n in np.flatnonzero(np.repeat(free, 3)):
        change = np.zeros(x.size)
        change[n] = 1e-6
        change = change.reshape(x.shape)
        in_x = accelerations(body, x + change, v) - accelerations(body, x - change, v)
        in_v = accelerations(body, x, v + change) - accelerations(body, x, v - change)
        column = mass * (tau**2 * in_x + tau * in_v).ravel() / 2e-6
        matrix[:, n] -= np.where(np.repeat(free, 3), column, 0.0)
    return matrix


@pytest.mark.parametrize("damping", [0.0, 5.0])
def test_matrix_is_the_derivative_of_the_forces(damping: float) -> None:
    made = simulator(tetrahedron("implicit_euler", damping), "implicit_euler", 0.01)
    rng = np.random.default_rng(1)
    x = made.positions[0] + rng.uniform(-0.2, 0.2, (4, 3))
    v = rng.normal(size=(4, 3))
    right = rng.normal(size=(4, 3))
    blocks = [block_array(1, (4, 3), np.float64) for _ in range(3)]
    for block, values in zip(blocks, (x, v, right), strict=True):
        numbers(block)[0, ..., 0] = values
    tau = 0.1  # long enough that stiffness and damping rule
    room = envelope(4, made.scene.body.springs, blocks[0].dtype)
    assemble_and_solve(room, blocks[0][0], blocks[1][0], tau, blocks[2][0], made._terms)
    expected = np.linalg.solve(dense(made, x, v, tau), right.ravel()).reshape(4, 3)
    np.testing.assert_allclose(numbers(blocks[2])[0, ..., 0], expected, rtol=1e-6, atol=1e-8)
    without = right / made.scene.body.masses[:, None]
    assert np.abs(expected - without)[1:].max() > 0.1


def test_envelope_holds_what_springs_join() -> None:
    rope = np.array([(i, i + 1) for i in range(19)])
    everything = np.array([(i, j) for i in range(8) for j in range(i)])
    assert len(envelope(20, rope, float).lower) == 3 * (20 + 19)
    assert len(envelope(8, everything, float).lower) == 3 * (8 * 9 // 2)


def test_newton_converges_quadratically() -> None:
    """Digits double: from 0.1 m to 1e-12 m in 5 iterations; with a wrong matrix it takes dozens."""
    made = simulator(tetrahedron("implicit_midpoint", 1.0), "implicit_midpoint", 0.1, tolerance=(1e-12, 0.0))
    made.advance(10, check=False)
    steps, rejected, iterations = made.counts()[0]
    assert (steps, rejected) == (0, 0)
    assert 30 <= iterations <= 50
