"""The paper's top against the theory of the heavy symmetric top, and what its integrators keep."""

from __future__ import annotations

import numpy as np
import pytest

from springgym.dynamics.stability import steps_in
from springgym.model.bodies import start, top
from springgym.model.scene import Scene
from springgym.simulator import Simulator
from springgym.theory.top import (
    HeavyTop,
    TopState,
    cone_top_inertia,
    nutation_frequency,
    nutation_period,
    steady_precession,
)

TILT, SPIN = 0.4, 45.0  # above the sleeping threshold, 39 rad/s; the gap to the rigid top grows as SPIN²
RIGID: HeavyTop = cone_top_inertia(12.0, 0.5, 1.0)


def spinning_top(stiffness: float, precession: float, spin: float = SPIN, **options: float) -> Simulator:
    body = top(stiffness=stiffness, damping=0.0)
    tip = body.parts["tip"]
    state = start(body, tilt=TILT, spin=spin, precession=precession, pinned=tip, gravity=(0.0, 0.0, -9.81))
    return Simulator(Scene(body, *state, pinned=tip), **options)


def turned(simulator: Simulator, duration: float, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth [rad] and tilt [rad] of the axis, (samples + 1,) each, over a duration [s]."""
    steps = steps_in(duration / samples, simulator.step)
    axes = [simulator.measure().axis[0]]
    for _ in range(samples):
        simulator.advance(steps)
        axes.append(simulator.measure().axis[0])
    x, y, z = np.transpose(axes)
    return np.unwrap(np.arctan2(y, x)), np.arccos(z)


def precession_gap(stiffness: float, root: int) -> float:
    """Relative difference of a steady precession from the rigid root it was started with."""
    rigid = steady_precession(RIGID, TILT, SPIN)[root]
    step = 0.02 / np.ceil(40 * np.sqrt(stiffness / 1e6))
    simulator = spinning_top(stiffness, rigid, step=step)
    azimuth, _ = turned(simulator, 2.0, 100)
    return (azimuth[-1] - azimuth[0]) / simulator.time[0] / rigid - 1


@pytest.mark.parametrize("root", [0, 1], ids=["slow", "fast"])
def test_steady_precession(root: int) -> None:
    """Ω = [I₃ω₃ ± √(I₃²ω₃² − 4 I₁ Mgl cos θ)] / (2 I₁ cos θ), both roots, within 0.3 % at k = 1e6."""
    gap = precession_gap(1e6, root)
    assert 1e-6 < abs(gap) < 3e-3


def test_rigid_gap_shrinks_with_stiffness() -> None:
    """The springs' stretch, hence the gap to the rigid top, is ∝ 1/k: a slope of −1 over two decades.

    The slope's tolerance, 0.05, is the stretch itself (5e-3 at k = 1e5) plus the share of the time error
    (ω₃h)²/12 ≈ 5e-5 in the smallest gap.
    """
    stiffness = np.array([1e5, 1e6, 1e7])
    gaps = [abs(precession_gap(k, root=0)) for k in stiffness]
    slope = np.polyfit(np.log(stiffness), np.log(gaps), 1)[0]
    assert slope == pytest.approx(-1, abs=0.05)


def test_nutation_frequency() -> None:
    """A small nutation about steady precession has ω_n² = [(Mgl)² − 2 I₁Mgl Ω² cos θ + I₁²Ω⁴]/(I₁Ω)²."""
    rigid = steady_precession(RIGID, TILT, SPIN)[0]
    simulator = spinning_top(1e6, rigid * 1.05, step=2.5e-4)
    samples = 4000
    duration = 4.0
    _, tilt = turned(simulator, duration, samples)
    assert np.ptp(tilt) > 1e-3
    # The frequency of a pure oscillation from its zero crossings, interpolated.
    swing = tilt - tilt.mean()
    up = np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0))
    crossing = up + swing[up] / (swing[up] - swing[up + 1])
    periods = np.diff(crossing).mean() * duration / samples
    assert 2 * np.pi / periods == pytest.approx(nutation_frequency(RIGID, TILT, rigid), rel=5e-3)


def test_nutation_period_of_a_released_top() -> None:
    """Released at rest, the top nutates with the period 4K(k)/√(β(u₃ − u₁)), falling and rising in cusps."""
    simulator = spinning_top(1e6, 0.0, step=2.5e-4)
    period = nutation_period(RIGID, TopState(theta=TILT, omega3=SPIN))
    _, tilt = turned(simulator, 12.0, 4000)
    swing = tilt - 0.5 * (tilt.max() + tilt.min())
    assert tilt.min() == pytest.approx(TILT, abs=2e-4)  # cusps: it comes back to where it was released
    up = np.flatnonzero((swing[:-1] < 0) & (swing[1:] >= 0))
    crossing = up + swing[up] / (swing[up] - swing[up + 1])
    assert np.diff(crossing).mean() * 12.0 / 4000 == pytest.approx(period, rel=5e-3)


def drift_of_lz(integrator: str, step: float) -> float:
    simulator = spinning_top(1e6, 0.0, integrator=integrator, step=step)
    before = simulator.measure()
    simulator.advance(round(10.0 / step))
    after = simulator.measure()
    assert np.linalg.norm(after.axis - before.axis) > 0.1  # it moved
    lz = before.angular_momentum[0, 2]
    return abs(after.angular_momentum[0, 2] - lz) / lz


def test_verlet_keeps_lz() -> None:
    """Every substep of Verlet is a rotation-invariant central force or a drift: L_z is kept to round-off."""
    assert drift_of_lz("verlet", 5e-4) < 1e-10


@pytest.mark.slow
def test_rk4_loses_lz() -> None:
    """RK4 keeps L_z to its order only: at the paper's step it loses more than a millionth in 10 s."""
    coarse = drift_of_lz("rk4", 5e-4)
    fine = drift_of_lz("rk4", 2.5e-4)
    assert 1e-7 < coarse < 1e-4
    assert fine < coarse / 10
