"""The node of a step among surfaces: energy at every step, and what is the same however it is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from springgym.model.bodies import cube, rigid_velocities, rotation
from springgym.model.scene import Scene, WrenchActuator
from springgym.model.surfaces import Bowl, Contact, floor, scales
from springgym.simulator import Simulator
from tests.copies import check_calls
from tests.forces.test_contact import DOWN, REACH, VARYING, WEIGHTLESS, beads

BOWL = (Bowl((0.0, 0.0, 1.5), 1.6),)


ALIKE: Any = {"varying": VARYING}
"""So that these cubes are compiled once, with those of the tests of contact."""


def fallen(surfaces: Any, copies: int = 3, wrench: WrenchActuator | None = None, **options: Any) -> Simulator:
    """Cubes with dampers that fall onto surfaces with friction and loss, each thrown in its own way."""
    body = cube(damping=5.0, stiffness=1e4)
    positions = (body.positions - body.centre) * 0.3 @ rotation([1, 2, 0.5], 0.7).T + [0, 0, 0.5]
    body = body.with_(positions=positions, lengths=0.3 * body.lengths)
    how = Contact(friction=0.4, restitution=0.5, strength=0.05, reach=0.02)
    scene = Scene(body, positions, surfaces=surfaces, contact=how, wrench=wrench)
    simulator = Simulator(scene, **{"step": 1e-3, "copies": copies, **options})
    pace = 1 + 0.3 * np.arange(copies)[:, None, None]
    simulator.place(
        positions + np.zeros((copies, 1, 1)),
        pace * (rigid_velocities(positions, [1, 3, 2], [0, 0, 0.5]) - [0, 0, 2.0]),
    )
    return simulator


@pytest.mark.parametrize("surfaces", [(floor(),), BOWL], ids=["floor", "bowl"])
def test_one_call_is_many_to_the_bit(surfaces: Any) -> None:
    """Odd and even parts, read amid impacts."""
    simulator = fallen(surfaces, threads=2, **ALIKE)
    check_calls(simulator, [1, 2, 3, 50, 7] * 9 + [33])
    assert (simulator.measure().contact_loss > 0.1).all()


@pytest.mark.parametrize("gravity", [WEIGHTLESS, DOWN], ids=["weightless", "falling"])
@pytest.mark.parametrize("speed", [0.3, 3.0, 30.0, 50.0, 100.0])
@pytest.mark.parametrize("surfaces", [(floor(),), (Bowl((0, 0, 1.0), 1.0),)], ids=["floor", "bowl"])
def test_energy_and_losses_are_kept_at_every_step_of_an_impact(
    surfaces: Any, speed: float, gravity: Any
) -> None:
    """Hard cases 11 and 13: straight and aslant, with and without loss and friction, at up to Δ in a step.

    In a bowl, friction and the normal follow from each other; turns settle both to 1e-9.
    """
    restitution = np.array([1, 0.5, 0, 1, 0.5, 0])
    friction = np.array([0, 0, 0, 0.5, 0.5, 0.5])
    velocities = speed * np.stack([1.4 * friction, 0 * friction, 0 * friction - 1], axis=1)
    simulator = beads([[0, 0, 1.5 * REACH]] * 6, velocities, surfaces=surfaces, gravity=gravity, step=2e-4)
    simulator.vary(np.arange(6), restitution=restitution, friction=friction)
    start = simulator.measure().balance
    off = np.where((friction > 0) & isinstance(surfaces[0], Bowl), 1e-9, 2e-12)
    fastest = np.zeros(6)
    for _ in range(int(10 * REACH / speed / 2e-4) + 5):
        simulator.advance(1)
        found = simulator.measure()
        fastest = np.maximum(fastest, simulator.velocities[:, 0, 2])
        assert surfaces[0].height(simulator.positions[:, 0]).min() > 0
        assert (np.abs(found.balance / start - 1) < off).all()
    assert (fastest > 0.4 * restitution * speed).all()
    assert ((found.contact_loss > 0.01 * start) == (restitution < 1)).all()
    assert ((found.friction_loss > 0.01 * start) == (friction > 0)).all()


def test_an_untouched_floor_changes_free_flight_to_second_order() -> None:
    """A cube that vibrates above a floor, which adds nodes, moves as without it but for terms of order h²."""
    off = []
    for step in (2e-4, 1e-4):
        ends = []
        for surfaces, varying in (((), ("damping",)), ((floor(-9.0),), VARYING)):
            simulator = fallen(surfaces, step=step, varying=varying)
            simulator.advance(round(0.2 / step))
            ends.append(simulator.positions[0])
        off.append(np.abs(ends[1] - ends[0]).max())
    assert 1e-9 < off[1] < 1e-5
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.1)


def test_to_dampers_rest_is_no_stretching() -> None:
    """On ice a cube rests as its springs have it, whatever its dampers: these see the mean velocity."""
    body = cube(stiffness=1e4)
    how = Contact(restitution=0.5)
    lying = body.positions - [0, 0, body.positions[:, 2].min() - scales(how, body)[1]]
    simulator = Simulator(Scene(body, lying, surfaces=(floor(),), contact=how), varying=VARYING, copies=2)
    simulator.vary([0, 1], damping=np.outer([5.0, 50.0], np.ones(28)))
    simulator.advance(round(20 / simulator.step))
    lengths = np.linalg.norm(np.diff(simulator.positions[:, body.springs], axis=2)[:, :, 0], axis=-1)
    assert np.ptp(lengths[0] / body.lengths) > 5e-5
    assert lengths[0] == pytest.approx(lengths[1], abs=1e-10)


def test_actions_change_from_call_to_call() -> None:
    """Far above a floor the centre moves as forces that change from call to call have it, and work is
    theirs."""
    draw = np.random.default_rng(5)
    simulator = fallen((floor(),), 1, WrenchActuator())
    simulator.place(simulator.positions + np.array([0, 0, 50.0]), simulator.velocities)
    mass = simulator.scene.body.mass
    seconds = 3 * simulator.step
    work = 0.0
    found = simulator.measure()
    centre = found.centre[0]
    velocity = found.centre_velocity[0]
    for _ in range(50):
        force = draw.normal(size=3)
        simulator.actuate(force=force, torque=np.zeros(3))
        simulator.advance(3)
        acceleration = force / mass + [0, 0, -9.81]
        way = seconds * velocity + 0.5 * seconds**2 * acceleration
        centre = centre + way
        velocity = velocity + seconds * acceleration
        work = work + force @ way
        found = simulator.measure()
        assert found.centre[0] == pytest.approx(centre, rel=1e-12)
        assert found.centre_velocity[0] == pytest.approx(velocity, rel=1e-12)
        assert found.work[0] == pytest.approx(work, rel=1e-9, abs=1e-12)
