"""What methods keep: energy, its ledger, and spin."""

from __future__ import annotations

import math

import numpy as np
import pytest

from springgym.dynamics.methods import METHODS, integrator
from tests.integrators.problems import NEGLIGIBLE, oscillator, simulator, tetrahedron

NOWHERE = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", METHODS)
def test_energy_has_a_trend_only_if_not_symplectic(name: str) -> None:
    record = integrator(name)
    options = {"tolerance": (1e-3, 1e-3)} if record.adaptive else {}
    step = {1: 1e-3, 2: 1e-2, 3: 1e-2, 4: 2e-2, 5: 3e-2, 6: 1e-1}[record.order]
    made = simulator(tetrahedron(name, NEGLIGIBLE, gravity=NOWHERE), name, step, **options)
    energies = []
    samples = 200
    start = made.measure().energy[0]
    for _ in range(samples):
        made.advance(math.ceil(0.3 / step), check=False)
        energies.append(made.measure().energy[0] - start)
    times = np.arange(samples) - (samples - 1) / 2
    slope, _ = np.polyfit(times, energies, 1)
    noise = np.std(energies - slope * times)
    assert noise > 1e-12
    # the slope of independent noise is below 4 √12 noise / samples^1.5 but in 1 of 16000 cases
    trend = abs(slope) * samples / (4 * math.sqrt(12 / samples) * noise)
    if record.symplectic:
        assert trend < 1.0
    else:
        assert trend > 3.0


@pytest.mark.parametrize("name", METHODS)
def test_ledger_closes(name: str) -> None:
    """E − work + losses stays, to the method's order or what its docstring says."""
    record = integrator(name)
    order = min(record.order, {"rodas3": 2, "blanes_moan": 4}.get(name, 9))
    steps = {1: 512, 2: 128, 4: 64, 5: 64, 6: 16}[order] * np.array([1, 2, 4])
    gaps = []
    for count in steps.tolist():
        options = {"tolerance": (1e29, 1e29)} if record.adaptive else {}
        made = simulator(tetrahedron(name, 1.0), name, 0.6 / count, **options)
        made.actuate(torque=np.array([[1.0, 4.0, 3.0]]))
        before = made.measure().energy[0]
        made.advance(count)
        after = made.measure()
        gaps.append(abs(after.energy[0] - before - after.work[0] + after.damping_loss[0]))
        assert abs(after.work[0]) > 1.0
        assert record.negative_substeps or after.damping_loss[0] > 0.5
    slope = -np.polyfit(np.log(steps), np.log(gaps), 1)[0]
    assert slope > order - 0.15


@pytest.mark.parametrize("name", [name for name in METHODS if not integrator(name).negative_substeps])
def test_spinning_alone_loses_nothing(name: str) -> None:
    """A pair turns at constant length, so that its strong damper does no work."""
    stiffness = 1e4
    turning = 4.0
    step = 2e-3
    length = 1 / (1 - turning**2 / (2 * stiffness))
    pair = oscillator(name, stiffness, 100.0, stretch=length - 1)
    velocities = np.zeros((4, 3))
    velocities[:2, 1] = np.array([-0.5, 0.5]) * turning * length
    options = {"tolerance": (1e-9, 0.0)} if integrator(name).adaptive else {}
    made = simulator(pair.with_(velocities=velocities), name, step, **options)
    made.advance(100, check=False)
    settled = made.measure()
    made.advance(1000, check=False)
    after = made.measure()
    share = 2e-2 if name == "implicit_euler" else 1e-4  # it brakes the pair, and so lets it shrink
    assert after.damping_loss[0] - settled.damping_loss[0] < share * after.kinetic[0]
    if name != "implicit_euler":
        assert after.balance[0] == pytest.approx(settled.balance[0], rel=1e-3)


def spin_left(name: str, turns: float, step: float, duration: float) -> tuple[float, float]:
    """Shares of angular momentum and of length that a stiff pair, spun with so many turns a second, keeps."""
    at_rest = oscillator(name, 1e8, NEGLIGIBLE, stretch=0.0)
    velocities = np.zeros((4, 3))
    velocities[:2, 1] = np.array([-0.5, 0.5]) * 2 * math.pi * turns
    made = simulator(at_rest.with_(velocities=velocities), name, step)
    before = made.measure().angular_momentum[0, 2]
    made.advance(round(duration / step), check=False)
    length = np.linalg.norm(made.positions[0, 1] - made.positions[0, 0])
    return made.measure().angular_momentum[0, 2] / before, float(length)


def test_implicit_euler_brakes_spin_by_the_law() -> None:
    turns = 1.0
    step = 0.01
    duration = 10.0
    left, _ = spin_left("implicit_euler", turns, step, duration)
    law = 1 / math.sqrt(1 + 2 * step * (2 * math.pi * turns) ** 2 * duration)
    assert law < 0.4
    assert left == pytest.approx(law, rel=0.01)


def test_second_order_methods_keep_spin() -> None:
    kept = {
        name: spin_left(name, 5.0, 0.01, 1.0) for name in ("tr_bdf2", "implicit_midpoint", "implicit_euler")
    }
    assert kept["tr_bdf2"][0] == pytest.approx(0.9606, abs=1e-3)  # as an independent program has it
    assert kept["implicit_midpoint"][0] == pytest.approx(1.0, abs=1e-9)
    assert kept["implicit_euler"][0] < 0.3
    assert kept["tr_bdf2"][1] == pytest.approx(1.0, abs=1e-3)
    assert abs(kept["implicit_midpoint"][1] - 1.0) > 0.01  # its length drifts instead
