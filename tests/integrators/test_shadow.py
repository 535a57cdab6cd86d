"""The shadow energy: of vibrations, and of motion that feeds them, it is kept to fourth order in the step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from springgym.model.bodies import Body, rope
from springgym.model.scene import Scene
from springgym.model.surfaces import Plane
from springgym.simulator import Simulator

FAR = (Plane((0.0, 0.0, -9.0), (0.0, 0.0, 1.0)),)
"""A floor that nothing comes near: steps then drift, kick and drift."""


def pendulum(*masses: float) -> Body:
    """A pendulum of springs of 1 m, which begins stretched out along x."""
    count = len(masses) + 1
    x = np.arange(count)[:, None] * [1.0, 0.0, 0.0]
    return Body(
        "pendulum", x, [1.0, *masses], [(n, n + 1) for n in range(len(masses))], 1e4, 0.0, floppy=True
    )


def lying(body: Body) -> Body:
    """A rope that hangs, turned so that it lies along x."""
    return body.with_(positions=np.abs(body.positions[:, [2, 1, 0]]))


BODIES = {
    "double": pendulum(0.02, 5.0),
    "triple": pendulum(1.0, 1.0, 1.0),
    "rope": lying(rope(10, 2.0, 0.1, 1.0, 1e4, 0.0)),
}
"""Undamped: they fall, and their slow motion feeds vibrations of their springs."""


def spans(scene: Scene, seconds: float, finer: int) -> np.ndarray:
    """Return the spans of the shadow energy and of the energy [J], in default steps divided by ``finer``."""
    count = math.ceil(seconds / Simulator(scene).step)
    simulator = Simulator(scene, step=seconds / count / finer)
    seen = []
    for _ in range(count):
        seen.append((simulator.shadow_energy()[0], simulator.measure().energy[0]))
        simulator.advance(finer)
    return np.ptp(seen, axis=0)


@pytest.mark.parametrize("surfaces", [(), FAR], ids=["alone", "above a floor"])
@pytest.mark.parametrize("name", BODIES)
def test_it_is_kept_to_fourth_order_and_the_energy_to_second(name: str, surfaces: tuple[Plane, ...]) -> None:
    """The rest falls as h⁴, by 16 a halving, and the next terms change that by (ω h)²/4 or less, here 6 %."""
    scene = Scene(BODIES[name], pinned=(0,), surfaces=surfaces)
    coarse, fine = (spans(scene, 1.0, finer) for finer in (2, 4))
    np.testing.assert_allclose(coarse / fine, [16.0, 4.0], rtol=0.06)
    assert (fine[0] < 0.01 * fine[1]).all()


def test_it_does_not_drift_while_slow_motion_feeds_vibrations() -> None:
    """50 s of a triple pendulum at the default step; what is kept of each linear vibration alone,
    H − (h²/8) Σ |F|²/m, would seem to lose a twelfth of the energy that is at stake."""
    body = BODIES["triple"]
    simulator = Simulator(Scene(body, pinned=(0,)))
    stake = 9.81 * float(body.masses[1:] @ body.positions[1:, 0])
    first = simulator.shadow_energy()[0]
    seen = []
    for _ in range(1000):
        simulator.advance(round(0.05 / simulator.step))
        seen.append(simulator.shadow_energy()[0])
    assert abs(np.mean(seen[500:]) - first) < 0.015 * stake


def test_it_is_that_of_the_parameters_of_a_copy() -> None:
    body = BODIES["triple"]
    factors = {"masses": 1.3, "stiffness": 0.8, "lengths": 1.01}
    pull = (0.0, 1.0, -9.0)
    simulator = Simulator(Scene(body, pinned=(0,)), copies=2, varying=(*factors, "gravity"))
    changed = {name: factor * getattr(body, name) for name, factor in factors.items()}
    simulator.vary([1], gravity=pull, **changed)
    one = Simulator(
        Scene(body.with_(**changed), body.positions, pinned=(0,), gravity=pull), step=simulator.step
    )
    for each in (simulator, one):
        each.advance(100)
    assert simulator.shadow_energy()[1] == pytest.approx(one.shadow_energy()[0], rel=1e-12)
    assert simulator.shadow_energy()[1] != pytest.approx(simulator.measure().energy[1], rel=1e-6)
