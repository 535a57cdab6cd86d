"""Bodies that collide among surfaces: rest, friction, energy, and copies that go on as one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from springgym.core.language.blocks import numbers
from springgym.dynamics.contact.totals import PairReadings
from springgym.model.bodies import Body, cube
from springgym.model.scene import Placed, Scene, WrenchActuator
from springgym.model.surfaces import Bowl, Contact, Plane
from springgym.scenes import load
from springgym.simulator import SimulationDivergedError, Simulator
from tests.collisions.impacts import impacts
from tests.collisions.stepped import Stepped

FLOOR = (Plane(),)
BLOCK = cube(0.5, damping=100.0)
REST = 0.2562
"""Height [m] of the middle of a block that rests on the floor, nearly."""


def among(*placed: Placed, **more: Any) -> Scene:
    """Bodies on a floor; the first has an actuator."""
    first = replace(placed[0], wrench=WrenchActuator())
    defaults: dict[str, Any] = {
        "surfaces": FLOOR,
        "contact": Contact(friction=0.5, restitution=0.3),
        "collisions": "all",
    }
    return Scene(bodies=(first, *placed[1:]), **defaults | more)


def put(body: Body, place: Any, name: str) -> Placed:
    return Placed(body, body.positions + np.asarray(place, float), name=name)


def test_a_pair_among_many_bodies_is_named() -> None:
    """With more pairs than bodies, the error names the two that met."""
    with pytest.raises(SimulationDivergedError, match="bodies 'cue' and 'b1' of copy 0 met"):
        Simulator(load("billiard-break").scene, step=3.5e-4).advance(1500)


@pytest.mark.slow
def test_stack_on_a_floor() -> None:
    """Three blocks come to rest and stay: no motion, no heat, no creep; what they lost is entered."""
    stack = among(*(put(BLOCK, (0, 0, 0.26 + 0.51 * n), f"{n}") for n in range(3)))
    simulator = Stepped(stack).simulator
    start = simulator.measure().balance[0]
    simulator.advance(int(8 / simulator.step))
    x = simulator.positions
    lost = simulator.measure()
    simulator.advance(int(2 / simulator.step))
    measured = simulator.measure()
    assert measured.kinetic.max() < 1e-10
    assert np.abs(simulator.positions - x).max() < 2e-7
    for name in ("damping_loss", "contact_loss", "friction_loss"):
        assert getattr(measured, name)[0] - getattr(lost, name)[0] < 1e-9
    assert measured.balance[0] == pytest.approx(start, abs=2e-5)
    told = simulator.pairs()
    summed = simulator.pair_sums()
    assert told.touching.tolist() == [[True, False, True]] * 2
    nearest = np.minimum(told.min_gap, simulator.scene.meetings.reach).min(axis=1)
    np.testing.assert_array_equal(summed.min_gap, nearest)
    assert (nearest < simulator.scene.meetings.reach.min()).all()
    for name in ("touching", "impulse", "late_contacts", "coarse_contacts"):
        np.testing.assert_array_equal(getattr(summed, name), getattr(told, name).sum(axis=1, dtype=float))
    assert not np.any([told.late_contacts, told.overflow, told.coarse_contacts])
    weight = told.impulse[0, [0, 2]] / (9.81 * simulator.time[0])
    assert weight == pytest.approx([2.0, 1.0], rel=0.02)


def test_block_that_pushes_another() -> None:
    """Below the friction of both they hold; above it they slide with (F − μ m g)/m."""
    scene = among(
        put(BLOCK, (0, 0, REST), "a"),
        put(BLOCK, (0.51, 0, REST), "b"),
        contact=Contact(friction=0.3, restitution=0.3),
    )
    simulator = Stepped(scene).simulator
    simulator.actuate(**{"a.force": (3.5, 0.0, 0.0)})
    simulator.advance(int(2.5 / simulator.step))
    simulator.actuate(**{"a.force": np.array([[5.5, 0, 0], [9.0, 0, 0]])})
    simulator.advance(int(0.3 / simulator.step))
    speeds = []
    before = simulator.measure().balance
    steps = int(0.5 / simulator.step)
    for _ in range(2):
        speeds.append(simulator.measure().centre_velocity[:, 0])
        simulator.advance(steps)
    assert simulator.pairs().touching.all()
    assert abs(speeds[1][0]) < 1e-6
    gained = (speeds[1] - speeds[0])[1] / (steps * simulator.step)
    assert gained == pytest.approx((9.0 - 2 * 0.3 * 9.81) / 2, rel=1e-3)
    assert np.abs(simulator.measure().balance - before).max() < 1e-5


def test_start_amid_contact() -> None:
    """Bodies placed where they press each other part with what the barrier had; taken over, they have it."""
    scene = among(put(BLOCK, (0, 0, 2.0), "a"), put(BLOCK, (0, 0, 2.503), "b"))
    simulator, other = (Stepped(scene).simulator for _ in range(2))
    start = simulator.measure()
    told = simulator.pairs()
    assert told.touching.all()
    assert start.contact.min() > 1e-3
    assert start.contact[0] == pytest.approx(told.energy[0, 0])
    other.take_over(simulator)
    assert other.measure().energy.tobytes() == start.energy.tobytes()
    simulator.advance(1)
    other.take_over(simulator)
    assert other.measure().energy.tobytes() == simulator.measure().energy.tobytes()
    simulator.advance(int(0.2 / simulator.step))
    parted = simulator.measure()
    assert not simulator.pairs().touching.any()
    assert parted.kinetic[0] > 0.5 * start.contact[0]
    assert parted.balance[0] == pytest.approx(start.balance[0], abs=0.02 * start.contact[0])


def impacts_on_floor(copies: int) -> tuple[Scene, np.ndarray, np.ndarray]:
    body = cube(damping=5.0)
    scene = among(put(body, (0, 0, 3.0), "a"), put(body, (4, 0, 3.0), "b"))
    x, v = impacts(body, body, 6.0, copies, np.random.default_rng(8))
    return scene, x + np.array([0.0, 0.0, 2.0]), v


@pytest.mark.slow
def test_how_bodies_meet_varies_copy_by_copy() -> None:
    """Friction and restitution of the scene's contact; a contact of their own stays."""
    scene, x, v = impacts_on_floor(3)
    mu = np.array([0.0, 0.3, 0.6])
    e = np.array([1.0, 0.7, 0.4])
    many = Stepped(scene, copies=3).simulator
    many.vary(None, friction=mu, restitution=e)
    many.place(x, v)
    many.advance(900)
    told = many.pairs()
    assert (told.impulse > 0).all()
    assert told.friction_loss[0, 0] == 0 == told.contact_loss[0, 0]
    assert (told.friction_loss[1:] > 0).all()
    assert (told.contact_loss[1:] > 0).all()
    for n in range(3):
        one = Stepped(scene.with_(contact=Contact(friction=mu[n], restitution=e[n])), copies=1).simulator
        one.place(x[n], v[n])
        one.advance(900)
        alone = one.pairs()
        among = many.pairs()
        assert np.array_equal(one.positions[0], many.positions[n]), n
        assert np.array_equal(one.velocities[0], many.velocities[n]), n
        for name in set(PairReadings._fields) - {"coarse_contacts"}:  # of the scene's restitution
            assert np.array_equal(getattr(alone, name)[0], getattr(among, name)[n]), (n, name)
    own = Stepped(scene.with_(collisions=Contact(friction=0.2)), copies=3).simulator
    own.vary(None, friction=mu)
    assert (numbers(own._terms.collisions.pairs.friction)[:, :1] == 0.2).all()


def test_readings_add_up() -> None:
    """What is forgotten with each reading is told once."""
    scene, x, v = impacts_on_floor(2)
    whole, parts = (Stepped(scene).simulator for _ in range(2))
    readings: list[PairReadings] = []
    for simulator in (whole, parts):
        simulator.place(x, v)
    for _ in range(120):
        parts.advance(10)
        readings.append(parts.pairs(forget=True))
    whole.advance(1200)
    told = whole.pairs()
    assert parts.positions.tobytes() == whole.positions.tobytes()
    for name in ("impulse", "contact_loss", "friction_loss", "late_contacts", "coarse_contacts", "overflow"):
        total = np.sum([getattr(reading, name) for reading in readings], axis=0)
        assert total == pytest.approx(getattr(told, name), rel=1e-12, abs=1e-12)
    assert np.min([reading.min_gap for reading in readings], axis=0) == pytest.approx(told.min_gap)
    assert sum(bool(reading.impulse[0, 0] > 0) for reading in readings) < 60


def test_balls_meet_surfaces_at_their_own() -> None:
    """A ball on a floor rests a radius higher; starts nearer are refused."""
    contact = Contact(strength=0.02, reach=0.01, restitution=0.3)
    ball = Body("ball", [[0.0, 0.0, 0.0]], 1.0, [], 1.0, 0.0, radius=0.2)
    scene = Scene(ball, [(0.0, 0.0, 0.25)], surfaces=FLOOR, contact=contact)
    simulator = Simulator(scene, step=1e-3)
    simulator.advance(3000)
    above = np.sqrt(0.02 / (9.81 + 0.02 / 0.01**2))
    assert simulator.positions[0, 0, 2] == pytest.approx(0.2 + above, abs=1e-6)
    with pytest.raises(ValueError, match=r"starts 0\.05 m behind surface 0"):
        scene.with_(positions=[(0.0, 0.0, 0.15)])
    bowl = Scene(ball, [(0.0, 0.0, 0.25)], surfaces=(Bowl((0, 0, 2.0), 2.0),), contact=contact)
    with pytest.raises(ValueError, match=r"starts 0\.05 m behind surface 0"):
        bowl.with_(positions=[(0.0, 0.0, 0.15)])


@pytest.mark.slow
def test_three_hundred_cubes_do_not_creep() -> None:
    """No cube of the pile moves faster than 1 mm/s after 2.5 s.

    The fastest one has 0.3 mm/s; if sweeps ended at 1e-3 Δ, it would have 0.2 m/s.
    """
    plan = load("pile-300")
    simulator = Simulator(plan.scene, step=plan.step)
    simulator.advance(round(2.5 / simulator.step))
    speeds = np.linalg.norm(simulator.velocities[0], axis=1)
    fastest = [speeds[own].max() for own in plan.scene.slices]
    assert max(fastest) < 1e-3
    assert simulator.pairs().late_contacts.sum() == 0
