"""The node of a step among surfaces: what is read, what is kept, and what is the same however it is asked
for."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from springgym.bodies import cube, rigid_velocities, rotation
from springgym.scene import Placed, Scene, WrenchActuator
from springgym.simulator import Simulator
from springgym.surfaces import Bowl, Contact, Plane, floor, scales
from tests.forces.test_contact import REACH, VARYING, WEIGHTLESS, beads, thrown_cube

BOWL = (Bowl((0.0, 0.0, 1.5), 1.6),)
RAMP = (floor(), Plane((0.6, 0, 0), (-0.6, 0, 0.8)))


ALIKE: Any = {"varying": VARYING}
"""So that these cubes are compiled once, with those of the tests of contact."""


def fallen(surfaces: Any, copies: int = 3, wrench: WrenchActuator | None = None, **options: Any) -> Simulator:
    """Cubes with dampers that fall onto surfaces with friction and loss, each thrown in its own way."""
    body = cube(damping=5.0, stiffness=1e4)
    positions = (body.positions - body.centre) * 0.3 @ rotation([1, 2, 0.5], 0.7).T + [0, 0, 0.5]
    body = body.with_(positions=positions, lengths=0.3 * body.lengths)
    how = Contact(friction=0.4, restitution=0.5, strength=0.05, reach=0.02)
    scene = Scene(body, positions, surfaces=surfaces, contact=how, wrench=wrench)
    simulator = Simulator(scene, step=1e-3, copies=copies, **options)
    pace = 1 + 0.3 * np.arange(copies)[:, None, None]
    simulator.place(
        positions + np.zeros((copies, 1, 1)),
        pace * (rigid_velocities(positions, [1, 3, 2], [0, 0, 0.5]) - [0, 0, 2.0]),
    )
    return simulator


def bits(simulator: Simulator) -> list[bytes]:
    """All that changes, and all that is read, of copies alone."""
    measured = simulator.measure()
    return [
        np.ascontiguousarray(array).tobytes()
        for array in (simulator.positions, simulator.velocities, measured.balance, measured.contact_loss)
    ]


@pytest.mark.parametrize("surfaces", [(floor(),), BOWL], ids=["floor", "bowl"])
def test_one_call_is_many_to_the_bit(surfaces: Any) -> None:
    """Odd and even parts, read amid impacts: the next call makes the node anew as it was."""
    one, many = fallen(surfaces, **ALIKE), fallen(surfaces, **ALIKE)
    one.advance(600)
    for steps in [1, 2, 3, 50, 7] * 9 + [33]:
        many.advance(steps, read=True)
    assert bits(one) == bits(many)
    assert (one.measure().contact_loss > 0.1).all()


@pytest.mark.own_kernels
@pytest.mark.slow
def test_a_copy_placed_amid_the_steps_of_others_is_as_one_alone() -> None:
    """The directions of dampers' sweeps, and where nodes begin, are each copy's own."""
    for before in (3, 4):
        batch, alone = fallen(RAMP, 20, **ALIKE), fallen(RAMP, 1, **ALIKE)
        batch.advance(before)
        batch.place(alone.positions, alone.velocities, [7])
        alone.advance(400)
        batch.advance(400)
        assert (batch.positions[7] == alone.positions[0]).all()
        assert (batch.velocities[7] == alone.velocities[0]).all()
        assert batch.measure().balance[7] == alone.measure().balance[0]
        assert alone.measure().contact_loss[0] > 0.1


def test_state_and_pickle_return_to_mid_impact_to_the_bit() -> None:
    simulator = fallen((floor(),), threads=2, **ALIKE)
    while not (simulator.measure().contact > 0).any():
        simulator.advance(1)
    state, twin, other = simulator.state(), pickle.loads(pickle.dumps(simulator)), copy.copy(simulator)
    for one in (simulator, twin, other):
        one.advance(101)
    again = fallen((floor(),), **ALIKE)
    again.restore(state)
    again.advance(101)
    assert bits(simulator) == bits(twin) == bits(other) == bits(again)


@pytest.mark.slow
def test_several_bodies_are_each_as_alone_to_the_bit() -> None:
    """Calls of odd length, so that each body's own memory is what the next begins with."""
    body = cube(damping=5.0)
    positions = (body.positions - body.centre) @ rotation([1, 2, 0.5], 0.7).T + [0, 0, 1.2]
    how = Contact(friction=0.4, restitution=0.5)
    velocities = [np.tile([0, 0, -speed], (8, 1)) for speed in (1.0, 2.0)]
    placed = [Placed(body, positions, v, name=f"cube {n}") for n, v in enumerate(velocities)]
    scene = Scene(bodies=tuple(placed), surfaces=(floor(),), contact=how, collisions=None)
    both = Simulator(scene, step=2e-4, **ALIKE)
    each = [
        Simulator(Scene(body, positions, v, surfaces=(floor(),), contact=how), step=2e-4, **ALIKE)
        for v in velocities
    ]
    for simulator in (both, *each):
        for _ in range(200):
            simulator.advance(7)
    assert (both.positions[0] == np.concatenate([simulator.positions[0] for simulator in each])).all()
    assert both.measure().balance[0] == pytest.approx(
        sum(simulator.measure().balance[0] for simulator in each)
    )
    assert all(simulator.measure().contact_loss[0] > 0.1 for simulator in each)


@pytest.mark.parametrize("speed", [0.3, 3.0, 30.0])
@pytest.mark.parametrize("surfaces", [(floor(),), (Bowl((0, 0, 1.0), 1.0),)], ids=["floor", "bowl"])
def test_energy_is_kept_at_every_reading_of_an_impact(speed: float, surfaces: Any) -> None:
    """What contact holds in mid-impact beside its barriers is in what is read; so is that of a lifted
    node."""
    simulator = beads([[0, 0, 1.5 * REACH]] * 2, [[0, 0, -speed]] * 2, surfaces=surfaces, step=2e-4)
    start = simulator.measure().energy
    touched, worst, fastest = 0, 0.0, 0.0
    for _ in range(int(10 * REACH / speed / 2e-4) + 5):
        simulator.advance(1)
        found = simulator.measure()
        assert surfaces[0].height(simulator.positions[:, 0]).min() > 0
        touched += found.contact[0] > 0
        worst = max(worst, abs(found.energy / start - 1).max())
        fastest = max(fastest, simulator.velocities[0, 0, 2])
    assert touched > 0
    assert fastest > 0.8 * speed
    assert worst < 1e-12


@pytest.mark.parametrize("restitution", [1.0, 0.5])
def test_cube_loses_no_energy_that_is_not_in_the_books(restitution: float) -> None:
    """64 orientations at 5 m/s, the default step: what Verlet keeps, H − (h²/8) Σ m |a|², and what was
    lost."""
    body = cube(damping=0.0)
    how = Contact(friction=0.5 if restitution < 1 else 0.0, restitution=restitution)
    draw = np.random.default_rng(0)
    turns = [rotation(draw.normal(size=3), draw.uniform(0, np.pi)) for _ in range(64)]
    positions = np.array([(body.positions - body.centre) @ turn.T for turn in turns])
    positions[..., 2] += 1.5 * scales(how, body)[1] - positions[..., 2].min(axis=1, keepdims=True)
    velocities = np.tile([0, 0, -5.0], (64, 8, 1))
    scene = Scene(body, positions[0], velocities[0], gravity=WEIGHTLESS, surfaces=(floor(),), contact=how)
    simulator = Simulator(scene, copies=64, varying=VARYING)
    simulator.place(positions, velocities)
    start = simulator.measure().balance
    simulator.advance(round(0.3 / simulator.step))
    first, second = body.springs.T
    apart = simulator.positions[:, second] - simulator.positions[:, first]
    length = np.linalg.norm(apart, axis=-1, keepdims=True)
    pull = (body.stiffness[:, None] * (1 - body.lengths[:, None] / length)) * apart
    force = np.zeros_like(positions)
    for n in range(len(body.springs)):
        force[:, first[n]] += pull[:, n]
        force[:, second[n]] -= pull[:, n]
    found = simulator.measure()
    kept = found.balance - simulator.step**2 / 8 * np.sum(force**2 / body.masses[:, None], axis=(1, 2))
    told = simulator.shadow_energy() + found.contact_loss + found.friction_loss
    assert told == pytest.approx(kept, rel=1e-12)
    error = np.abs(kept / start - 1)
    assert (found.centre_velocity[:, 2] > 0).all()
    assert np.median(error) < 2e-4
    assert error.max() < 1e-3
    assert (found.contact_loss > 1).all() == (restitution < 1)


def test_what_rests_has_no_velocity() -> None:
    """A cube held on a slope at 90 % of the limit: springs, gravity, contact and friction balance at the
    node."""
    body = cube(damping=20.0)
    angle = np.arctan(0.9 * 0.5)
    slope = Plane((0, 0, 0), (-np.sin(angle), 0, np.cos(angle)))
    how = Contact(friction=0.5, restitution=0.5)
    lying = body.positions - [0, 0, body.positions[:, 2].min() - scales(how, body)[1]]
    scene = Scene(body, lying @ rotation([0, 1, 0], -angle).T, surfaces=(slope,), contact=how)
    simulator = Simulator(scene, varying=VARYING, copies=2)
    simulator.vary([0, 1], damping=np.outer([5.0, 50.0], np.ones(28)))
    simulator.advance(round(8 / simulator.step))
    first = simulator.measure()
    simulator.advance(round(2 / simulator.step))
    last = simulator.measure()
    assert np.abs(last.centre - first.centre).max() < 1e-9
    assert (last.kinetic < 1e-18).all()
    for loss in ("friction_loss", "contact_loss"):
        assert getattr(last, loss) - getattr(first, loss) == pytest.approx(np.zeros(2), abs=1e-9)
    assert (last.contact > 1e-5).all()


def test_to_dampers_rest_is_no_stretching() -> None:
    """On ice a cube rests as its springs have it, whatever its dampers: these see the mean velocity."""
    body, how = cube(stiffness=1e4), Contact(restitution=0.5)
    lying = body.positions - [0, 0, body.positions[:, 2].min() - scales(how, body)[1]]
    simulator = Simulator(Scene(body, lying, surfaces=(floor(),), contact=how), varying=VARYING, copies=2)
    simulator.vary([0, 1], damping=np.outer([5.0, 50.0], np.ones(28)))
    simulator.advance(round(20 / simulator.step))
    lengths = np.linalg.norm(np.diff(simulator.positions[:, body.springs], axis=2)[:, :, 0], axis=-1)
    assert np.ptp(lengths[0] / body.lengths) > 5e-5
    assert lengths[0] == pytest.approx(lengths[1], abs=1e-10)


def test_actions_change_at_nodes_half_and_half() -> None:
    """Far above a floor the centre moves as forces that change from call to call have it, and work is
    theirs."""
    draw = np.random.default_rng(5)
    simulator = fallen((floor(),), 1, WrenchActuator())
    simulator.place(simulator.positions + np.array([0, 0, 50.0]), simulator.velocities)
    mass, seconds, work = simulator.scene.body.mass, 3 * simulator.step, 0.0
    found = simulator.measure()
    centre, velocity = found.centre[0], found.centre_velocity[0]
    for _ in range(50):
        force = draw.normal(size=3)
        simulator.actuate(force=force, torque=np.zeros(3))
        simulator.advance(3)
        acceleration = force / mass + [0, 0, -9.81]
        way = seconds * velocity + 0.5 * seconds**2 * acceleration
        centre, velocity, work = centre + way, velocity + seconds * acceleration, work + force @ way
        found = simulator.measure()
        assert found.centre[0] == pytest.approx(centre, rel=1e-12)
        assert found.centre_velocity[0] == pytest.approx(velocity, rel=1e-12)
        assert found.work[0] == pytest.approx(work, rel=1e-9, abs=1e-12)


def test_parameters_that_vary_let_copies_begin_anew() -> None:
    """A change between two calls acts from there on, and not half a step before."""
    made, other = (thrown_cube(Contact(), 2.5e-4) for _ in range(2))
    made.advance(11)
    x, v = made.positions, made.velocities
    for simulator in (made, other):
        simulator.vary([0], damping=np.full(28, 7.0))
    other.place(x, v)
    for simulator in (made, other):
        simulator.advance(5)
    assert bits(made)[:2] == bits(other)[:2]
