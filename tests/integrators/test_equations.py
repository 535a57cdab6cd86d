"""Implicit methods set up the right linear systems, and Newton's method converges on them."""

from __future__ import annotations

import numpy as np

from springgym.dynamics.methods.envelope import envelope
from tests.integrators.problems import simulator, tetrahedron


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
