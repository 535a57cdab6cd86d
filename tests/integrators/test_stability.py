"""The stability limits that records state are the measured ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from springgym.dynamics.methods import METHODS, integrator
from springgym.simulator import SimulationDivergedError, Simulator
from tests.integrators.problems import NEGLIGIBLE, oscillator, simulator, tetrahedron

LARGE = (1e29, 1e29)
"""A tolerance that accepts every step: then an adaptive method takes steps of h."""


def grown(name: str, phase: float, steps: int) -> float:
    """Largest stretch near the end of an oscillation with ω h = ``phase``, in units of the amplitude."""
    frequency = 100.0
    stretch = 1e-3
    scene = oscillator(name, frequency**2 / 2, NEGLIGIBLE, stretch, speed=0.3 * frequency * stretch)
    options = {"tolerance": LARGE} if integrator(name).adaptive else {}
    made = simulator(scene, name, phase / frequency, **options)
    made.advance(steps, check=False)
    largest = 0.0
    for _ in range(50):
        made.advance(1, check=False)
        length = np.linalg.norm(made.positions[0, 1] - made.positions[0, 0])
        if not np.isfinite(length):
            return math.inf
        largest = max(largest, abs(length - 1.0))
    return largest / stretch


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.slow
def test_imaginary_limit(name: str) -> None:
    limit = integrator(name).imaginary_limit
    if math.isinf(limit):
        assert grown(name, 300.0, 1000) < 1.1
        return
    # beyond the limit dopri5 grows by 7e-6 a step, blanes_moan by 6.5e-4 in a resonance, others by over 1 %
    steps = {"dopri5": 500_000, "blanes_moan": 10_000}.get(name, 2000)
    assert grown(name, 0.99 * limit, steps) < 6.0
    assert not grown(name, 6.3486 if name == "blanes_moan" else 1.01 * limit, steps) < 10.0


@pytest.mark.parametrize("name", [name for name in METHODS if not integrator(name).negative_substeps])
def test_real_limit(name: str) -> None:
    limit = integrator(name).real_limit

    def left(phase: float) -> float:
        """Share of the speed along an overdamped spring that is left after 300 steps."""
        scene = oscillator(name, 1e-9, 1.0, stretch=1e-3, speed=1e-4)
        options = {"tolerance": LARGE} if integrator(name).adaptive else {}
        made = simulator(scene, name, phase / 2.0, **options)
        made.advance(300, check=False)
        return float(np.abs(made.velocities[0, 1, 0] - made.velocities[0, 0, 0])) / 1e-4

    if math.isinf(limit):
        assert left(30.0) < 1e-6
        return
    assert left(0.99 * limit) < 0.9
    assert not left(1.01 * limit) < 1.1


@pytest.mark.parametrize("name", METHODS)
def test_step_beyond_the_limit_is_refused(name: str) -> None:
    scene = oscillator(name, 1e4, 0.0)
    limit = integrator(name).imaginary_limit / math.sqrt(2e4)
    if math.isinf(limit):
        assert Simulator(scene, integrator=name, step=1.0).step == 1.0
        return
    assert Simulator(scene, integrator=name, step=0.998 * limit).step == 0.998 * limit
    says = "It chooses its own steps" if integrator(name).controlled else "Take a smaller step"
    with pytest.raises(ValueError, match=f"unstable: {name} on this body allows at most .* s\\. {says}"):
        Simulator(scene, integrator=name, step=0.9995 * limit)


@pytest.mark.parametrize("name", ["dopri5", "implicit_euler"])
def test_copy_without_a_step_diverges(name: str) -> None:
    """A method that cannot meet its tolerance raises an error; it does not go on, or return a wrong state."""
    options = {"tolerance": (0.0, 1e-30)}
    made = simulator(tetrahedron(name, 1.0), name, 0.01, **options)
    with pytest.raises(SimulationDivergedError, match="copy 0 diverged"):
        made.advance(10)
