"""The speed up to which bodies rebound as asked, and what is to be had beyond it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from springgym.bodies import ball, cube, rolling_ball, rope
from springgym.scene import Placed, Scene
from springgym.simulator import Simulator
from springgym.surfaces import Contact, PaperContact, floor
from springgym.theory.contact import turning_point

MEASURED = {1e5: ((0.5, 0.991), (2, 0.874), (5, 0.578), (10, 0.520)), 1e6: ((5, 0.953), (10, 0.746))}
"""Restitution of cubes by their stiffness [N/m], face on face, at speeds [m/s]: 5 mm of reach, e = 1."""


def cubes(stiffness: float, **law: Any) -> Scene:
    """Two cubes of 1 kg and 1 m, 2 cm apart, without gravity."""
    body = cube(stiffness=stiffness, damping=0.0)
    bodies = tuple(Placed(body, np.add(body.positions, (1.02 * n, 0, 0)), name=f"{n}") for n in range(2))
    return Scene(bodies=bodies, gravity=None, collisions=Contact(reach=0.005, **law))


def test_faithful_speed_of_cubes() -> None:
    """It is Δ ω/3 of the slowest vibration, ω² = 8 k/m of such a cube: it grows by the root of k."""
    assert cubes(1e5).faithful_speed == pytest.approx(0.005 / 3 * math.sqrt(8e5), rel=1e-3)
    assert cubes(1e7).faithful_speed == pytest.approx(10 * cubes(1e5).faithful_speed)
    assert "rebounds as asked up to 1.49 m/s" in repr(cubes(1e5))


def test_steps_limit_the_faithful_speed() -> None:
    """The faithful speed is at most Δ/5 a step."""
    for step, speed in ((7e-4, 0.2 * 0.005 / 7e-4), (1e-4, cubes(1e5).faithful_speed)):
        simulator = Simulator(cubes(1e5), step=step)
        assert simulator.faithful_speed == pytest.approx(speed)
        assert f"as asked up to {speed:.3g} m/s)" in repr(simulator)
    assert Simulator(Scene(cube())).faithful_speed == math.inf


def test_softest_contact_counts() -> None:
    """Of several contacts; surfaces have theirs; a body that is held does not vibrate."""
    soft, stiff = cube(stiffness=1e5), cube(stiffness=1e7)
    far = stiff.positions + np.array([3.0, 0.0, 2.0])
    bodies = (Placed(soft, np.add(soft.positions, (0, 0, 2)), name="soft"), Placed(stiff, far, name="stiff"))
    law = Contact(reach=0.01)
    both = Scene(bodies=bodies, collisions=law)
    on_floor = Scene(stiff, far, surfaces=(floor(),), contact=law)
    assert on_floor.faithful_speed == pytest.approx(10 * both.faithful_speed)
    for on in ({"collisions": law}, {"collisions": None, "surfaces": (floor(),), "contact": law}):
        held = Placed(soft, bodies[0].positions, pinned=tuple(range(8)), name="soft")
        assert Scene(bodies=(held, bodies[1]), **on).faithful_speed == on_floor.faithful_speed


def test_what_rolls_comes_no_nearer_than_a_tenth_of_the_reach() -> None:
    one, c, reach = rolling_ball(0.1, mass=2.0), 1e-4, 0.002
    law = Contact(reach=reach, strength=c)
    two = tuple(Placed(one, np.add(one.positions, (0, 0, z)), name=f"{z}") for z in (1, 2))
    for mass, scene in (
        (2.0, Scene(bodies=two[:1], surfaces=(floor(),), contact=law)),
        (1.0, Scene(bodies=two, collisions=law)),
    ):
        speed = scene.faithful_speed
        assert turning_point(0.5 * mass * speed**2, c, reach) == pytest.approx(0.1 * reach)


def test_what_has_no_faithful_speed() -> None:
    """Single particles and ropes have no shape to vibrate about; what does not rebound asks for nothing."""
    body = cube()
    raised = body.positions + np.array([0.0, 0.0, 2.0])
    for scene in (
        Scene(body),
        Scene(body, raised, surfaces=(floor(),), contact=Contact(restitution=0.0)),
        Scene(body, raised, surfaces=(floor(),), contact=PaperContact()),
        Scene(
            ball(0.1),
            np.array([[0, 0, 1.0]]),
            surfaces=(floor(),),
            contact=Contact(reach=0.01, strength=1e-3),
        ),
        Scene(
            rope(),
            np.add(rope().positions, (0, 0, 50)),
            surfaces=(floor(),),
            contact=Contact(reach=0.01, strength=1e-3),
        ),
    ):
        assert scene.faithful_speed == math.inf
        assert scene.restitution_at(1e3) == 1.0
        assert "rebounds" not in repr(scene)


def test_restitution_beyond_it() -> None:
    """The estimate is what was measured to .07, and falls."""
    for stiffness, each in MEASURED.items():
        scene = cubes(stiffness)
        for speed, measured in each:
            assert scene.restitution_at(speed) == pytest.approx(measured, abs=0.07)
    assert np.all(np.diff([scene.restitution_at(v) for v in np.linspace(0, 100, 50)]) <= 0)
    for wrong in (-1.0, math.nan, "fast", None, True):
        with pytest.raises((TypeError, ValueError), match="speed"):
            scene.restitution_at(wrong)  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.3, 1.5, 3.0])
def test_estimate_against_impacts(ratio: float) -> None:
    """Cubes face on face, a hair aside: what they rebound with is what is told, to .07."""
    scene = cubes(1e5)
    speed = ratio * scene.faithful_speed
    simulator = Simulator(scene, unresolved="count")
    v = np.zeros((16, 3))
    v[:8, 0], v[8:, 0] = speed / 2, -speed / 2
    simulator.place(scene.positions, v)
    simulator.advance(math.ceil(0.2 / speed / simulator.step))
    m = simulator.scene.masses[:, None]
    away = (m * simulator.velocities[0])[8:].sum(axis=0) - (m * simulator.velocities[0])[:8].sum(axis=0)
    assert away[0] / speed == pytest.approx(scene.restitution_at(speed), abs=0.07)
