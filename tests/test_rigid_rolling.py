"""Rigid bodies that roll: against theory, an ODE, the springs that are their limit; alone and among others.

Scenes of spheres that collide have all kinds of terms (`tests.collisions.stepped.full`): one kernel for all.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from springgym import Simulator
from springgym.bodies import disk, ellipsoid, rolling_ball, start
from springgym.core.blocks import block_array
from springgym.core.lanes import block_dtype
from springgym.envs.billiards import SpringBilliards
from springgym.integrators.record import workspace
from springgym.measures import Measures
from springgym.packing import Options, pack_pairs, solids_workspace
from springgym.rigid import METHODS
from springgym.rigid.surfaces import LOADS
from springgym.scene import Scene
from springgym.surfaces import Bowl, Contact, floor, incline
from springgym.theory import rolling
from springgym.theory.contact import rest_height
from tests.collisions.stepped import full
from tests.collisions.test_spheres import BALL as FREE_BALL
from tests.collisions.test_spheres import BLOCK, body_at, momenta, on_a_tilted_block, scene
from tests.collisions.test_spheres import CONTACT as BETWEEN
from tests.collisions.test_spheres import motion as motions
from tests.forces.rigid_rolling import motion
from tests.forces.test_round import (
    BALL,
    GRIP,
    STONE,
    G,
    on_hard_ground,
    placed,
    rigid,
    thrown_into_a_corner,
)
from tests.forces.test_round import VARYING as OF_SPRINGS
from tests.params import slow_but

VARYING = ("friction", "restitution")
"""So that what a floor does not have is a zero: one kernel for all on planes."""


def twin(of: Scene, step: float = 1e-3) -> Simulator:
    return Simulator(of, dynamics="rigid", step=step, varying=VARYING)


def run(of: Scene, duration: float, step: float = 1e-3, every: int = 10) -> tuple[np.ndarray, Measures]:
    """Times and measures (T, …) of the twin."""
    simulator = twin(of, step)
    rows = [[np.array(field[0]) for field in simulator.measure()]]
    for _ in range(round(duration / step / every)):
        simulator.advance(every)
        rows.append([np.array(field[0]) for field in simulator.measure()])
    return step * every * np.arange(len(rows)), Measures(*map(np.array, zip(*rows, strict=True)))


def test_actuators_of_a_body_of_one_particle_have_room() -> None:
    """The workspace has two rows, for force and torque, even if the body is a single particle."""
    both = SpringBilliards().scene
    alone = Scene(bodies=both.bodies[:1], surfaces=both.surfaces, contact=both.contact)
    assert len(alone.positions) == 1
    method, kind = METHODS["verlet"].record, block_dtype(float, 1)
    pairs = pack_pairs(
        both, Options(method, 1e-3, 1, frozenset(), lambda *shape: block_array(1, shape, kind))
    )
    assert solids_workspace(both, pairs, kind).loads.shape[1] >= 2
    arrays: Any = workspace(method, alone, kind)
    assert len(arrays[LOADS]) >= 2


# --- On surfaces ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.5, 0.05])
def test_ball_rolls_or_slides_down_a_slope(friction: float) -> None:
    """A ball rolls with the acceleration g sin a/(1 + I/(m r²)), or slides with g (sin a − μ cos a)."""
    angle = 0.3
    times, m = run(placed(BALL, (incline(angle),), Contact(friction, 0.5)), 1.0)
    speed = np.linalg.norm(m.centre_velocity, axis=1)
    rolls = friction > rolling.needed_friction(angle, 0.4)
    slides = G * (math.sin(angle) - friction * math.cos(angle))
    expected = rolling.acceleration(angle, 0.4) if rolls else slides
    assert np.polyfit(times, speed, 1)[0] == pytest.approx(expected, rel=1e-4)
    slip = speed - 0.1 * np.linalg.norm(m.angular_velocity, axis=1)
    assert (abs(slip[-1]) < 1e-4 * speed[-1]) == rolls
    assert np.ptp(m.balance) < 1e-3 * m.kinetic[-1]


def test_ball_that_skids_rolls_at_5_7_of_its_speed_and_stays() -> None:
    """Friction takes 2/7 of its energy; at rest it lies still."""
    _, m = run(placed(BALL, contact=Contact(0.1, 1.0), velocity=(2.0, 0, 0)), 2.0)
    assert m.centre_velocity[-1, 0] == pytest.approx(10 / 7, rel=2e-5)
    assert m.friction_loss[-1] == pytest.approx(4 / 7, rel=1e-4)
    simulator = twin(placed(BALL))
    simulator.advance(1000)
    centre, found = simulator.measure().centre[0], simulator.contacts()
    assert np.abs(simulator.velocities).max() < 1e-12
    assert [of.tolist() for of in found[:5]] == [[[True]], [[0]], [[-1]], [[0]], [[-1]]]
    np.testing.assert_allclose(found.force[0, 0], (0, 0, G), atol=1e-9)
    np.testing.assert_allclose(found.point[0, 0], centre - (0, 0, 0.1 + found.gap[0, 0] / 2), atol=1e-12)


def test_energy_of_hops_with_spin_is_entered_to_rounding() -> None:
    """The way of a sphere's centre along the normal is what its gap changes by: the work is the barrier's."""
    of = placed(BALL, contact=replace(GRIP, friction=0.3), up=0.05, velocity=(0.5, 0, -0.5), omega=(3, 0, 20))
    _, m = run(of, 0.5)
    assert m.friction_loss[-1] > 0.02
    assert m.contact_loss[-1] > 0.2
    assert np.abs(m.balance - m.balance[0]).max() < 1e-9


@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.5])
def test_ball_rebounds_with_the_restitution(restitution: float) -> None:
    how = Contact(0.3, restitution, strength=4e-5, reach=1e-3)
    of = placed(BALL, contact=how, up=0.01, velocity=(0, 0, -0.5)).with_(gravity=(0.0, 0.0, 0.0))
    _, m = run(of, 0.1, 2e-4)
    assert m.centre_velocity[-1, 2] / 0.5 == pytest.approx(restitution, abs=0.01)
    np.testing.assert_allclose(m.balance, m.balance[0], rtol=1e-10)


@pytest.mark.parametrize("spin", slow_but([-2.0, 2.0], -2.0))
def test_rattleback_turns_back_one_way_only_as_the_ode_of_rolling(spin: float) -> None:
    omega, velocity = (0.0, 1.0, spin), (0.01, 0.0, 0.0)
    times, m = run(on_hard_ground(STONE, 5e-5, 5.0, omega=omega, velocity=velocity), 5.0, 2e-4, 100)
    _, _, spins, _ = motion(rigid(STONE), np.eye(3), omega, velocity, times)
    late = times > 4.5
    assert m.angular_velocity[late, 2].mean() == pytest.approx(spins[late, 2].mean(), rel=3e-3)
    assert (m.angular_velocity[late, 2] > 0).all()
    assert np.ptp(m.balance) < 1e-3 * m.kinetic[0]


def egg(stiffness: float) -> Scene:
    """An ellipsoid that rolls from the start, and spins about the vertical."""
    body = ellipsoid((0.12, 0.1, 0.08), 0.7, stiffness=stiffness, damping=0.0)
    how = Contact(2.0, 1.0, strength=10 * 0.7 * G * 1e-8, reach=1e-4)
    omega = np.array((2.0, 3.0, 4.0))
    return placed(body, contact=how, omega=omega, velocity=-np.cross(omega, (0, 0, -0.08)))


def rolled(of: Scene, dynamics: str, step: float) -> tuple[np.ndarray, float]:
    """Where the egg's centre and its axis are after 0.3 s, and what friction took."""
    varying = VARYING if dynamics == "rigid" else OF_SPRINGS
    simulator = Simulator(of, dynamics=dynamics, step=step, varying=varying)
    simulator.advance(round(0.3 / step))
    m = simulator.measure()
    return np.concatenate([m.centre[0], m.axis[0]]), float(m.friction_loss[0])


def test_what_sticks_rolls_without_work_to_the_square_of_the_step() -> None:
    lost = [abs(rolled(egg(1e5), "rigid", step)[1]) for step in (1e-3, 5e-4)]
    assert lost[0] < 1e-6
    assert lost[1] < 0.3 * lost[0]


def test_springs_that_roll_approach_their_twin_as_they_grow_stiff() -> None:
    """The body's shape is off by its load over k."""
    exact, _ = rolled(egg(1e5), "rigid", 5e-5)
    off = [
        np.abs(rolled(egg(stiffness), "springs", step)[0] - exact).max()
        for stiffness, step in ((1e4, 5e-5), (1e5, 5e-5), (1e6, 2e-5))
    ]
    assert off[1] < 0.2 * off[0]
    assert off[2] < 0.2 * off[1]
    assert off[2] < 3e-5


def test_coin_that_is_dropped_gains_no_energy() -> None:
    for turn in ((0, 0, 0), (0.1, 0.05, 0), (0.4, 0, 0)):
        _, m = run(placed(disk(), up=0.05, turn=turn, velocity=(0, 0, -1.0), omega=(0, 0, 2.0)), 1.5, 2e-4)
        assert m.energy.max() < 1.001 * m.energy[0]
        assert m.energy[-1] < 0.2 * m.energy[0]


def test_ball_swings_about_its_pin_and_hits_the_floor() -> None:
    begun = placed(BALL, contact=Contact(0.3, 1.0), up=0.01)
    of = Scene(BALL, begun.positions, pinned=(0,), surfaces=begun.surfaces, contact=begun.contact)
    simulator, lowest, balance = twin(of, 1e-4), [], []
    for _ in range(300):
        simulator.advance(20)
        m = simulator.measure()
        lowest.append(m.centre[0, 2])
        balance.append(m.balance[0])
    assert simulator.positions[0, 0].tobytes() == of.positions[0].tobytes()
    assert 0.1 < min(lowest) < 0.101
    assert m.friction_loss[0] > 0.05
    assert np.ptp(balance) < 1e-6


@pytest.mark.slow
def test_copies_of_a_batch_are_single_ones_to_the_bit() -> None:
    of, x, v = thrown_into_a_corner()
    many = Simulator(of, copies=18, dynamics="rigid", step=1e-3)
    many.place(x, v)
    many.advance(100)
    many.advance(101)
    for n in (0, 7, 16, 17):
        one = Simulator(of, dynamics="rigid", step=1e-3)
        one.place(x[n], v[n])
        one.advance(201)
        np.testing.assert_allclose(one.positions[0], many.positions[n], atol=1e-12)
        np.testing.assert_allclose(one.measure().balance[0], many.measure().balance[n], rtol=1e-12)


@pytest.mark.slow
def test_ball_rolls_to_and_fro_in_a_bowl() -> None:
    """A ball swings in a bowl with ω² = g/((R − r)(1 + I/m r²)), if its swings are small."""
    swing, how = 0.1, Contact(friction=0.8, restitution=0.5, strength=1e-4, reach=1e-3)
    arm = 0.9 - rest_height(G, 1e-4, 1e-3)
    begun = start(BALL, position=(arm * math.sin(swing), 0.0, 1.0 - arm * math.cos(swing)))
    bowl = Scene(BALL, begun.positions, surfaces=(Bowl((0, 0, 1.0), 1.0),), contact=how)
    times, m = run(bowl, 8.0)
    angle = np.arctan2(m.centre[:, 0], 1.0 - m.centre[:, 2])
    ups = np.flatnonzero((angle[:-1] < 0) & (angle[1:] >= 0))
    at = times[ups] - angle[ups] * np.diff(times)[0] / (angle[ups + 1] - angle[ups])
    period = 2 * math.pi * math.sqrt(1.4 * arm / G) * (1 + swing**2 / 16)
    assert np.diff(at).mean() == pytest.approx(period, rel=1e-3)
    assert np.abs(angle[-80:]).max() > 0.995 * swing


# --- Among others ---------------------------------------------------------------------------------------


def twins(of: Scene, step: float, **options: Any) -> Simulator:
    return full(of, dynamics="rigid", step=step, copies=2, **options)


def after(of: Scene, duration: float, step: float) -> tuple[Simulator, np.ndarray, np.ndarray]:
    """The twin, and the velocities and angular velocities of its bodies, after some time."""
    simulator = twins(of, step)
    simulator.advance(round(duration / step))
    return simulator, *motions(simulator)


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.5])
def test_restitution_of_two_spheres(restitution: float) -> None:
    left = body_at(FREE_BALL, (-0.21, 0, 0), velocity=(0.5, 0, 0))
    of = scene(left, body_at(FREE_BALL, (0, 0, 0)), contact=replace(BETWEEN, restitution=restitution))
    _, v, _ = after(of, 0.2, 2e-4)
    assert (v[1, 0] - v[0, 0]) / 0.5 == pytest.approx(restitution, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "slides"), [(0.05, True), (0.5, False)])
def test_friction_turns_both_spheres(friction: float, slides: bool) -> None:
    """Coulomb's, or as much as stops the slip: of equal balls, 2/7 of the slip over 2 is the impulse."""
    left = body_at(FREE_BALL, (-0.21, 0, 0), velocity=(1.0, 0, 0), omega=(0, 0, 10.0))
    of = scene(left, body_at(FREE_BALL, (0, 0, 0)), contact=Contact(friction=friction, restitution=1.0))
    simulator, v, w = after(of, 0.1, 2e-4)
    push, slip = v[1, 0], 1.0
    rub = min(friction * push, slip / 7) if slides else slip / 7
    assert slides == (friction * push < slip / 7)
    np.testing.assert_allclose(v[1, 1], rub, rtol=1e-2)
    np.testing.assert_allclose((10.0 - w[0, 2], -w[1, 2]), rub * 0.1 / 0.004, rtol=1e-2)
    assert simulator.measure().balance[0] == pytest.approx(0.5 + 0.5 * 0.004 * 100, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.05, 0.4])
def test_friction_on_a_free_block_is_coulombs(radius: float) -> None:
    ball = rolling_ball(radius, 1.0, damping=0.0)
    thrown = body_at(ball, (0, 0, 0.254 + radius), velocity=(3.0, 0, -0.5))
    _, v, _ = after(scene(thrown, body_at(BLOCK, (0, 0, 0))), 0.05, 1e-4)
    given = v[0] - (3.0, 0, -0.5)
    assert given[2] > 0.3
    assert -given[0] / (0.3 * given[2]) == pytest.approx(1.0, abs=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.5, 0.05])
def test_ball_rolls_or_slides_down_a_tilted_block(friction: float) -> None:
    angle = 0.4
    of, down = on_a_tilted_block(FREE_BALL, angle, friction)
    simulator = twins(of, 2e-4)
    speeds = []
    for _ in range(20):
        simulator.advance(100)
        v, w = motions(simulator)
        speeds.append(v[0] @ down)
    rolls = friction > rolling.needed_friction(angle, 0.4)
    slides = G * (math.sin(angle) - friction * math.cos(angle))
    found = np.polyfit(0.02 * np.arange(20), speeds, 1)[0]
    assert found == pytest.approx(rolling.acceleration(angle, 0.4) if rolls else slides, rel=1e-6)
    assert (abs(v[0] @ down - 0.1 * w[0, 1]) < 1e-6 * speeds[-1]) == rolls


def thrown(of: str, stiffness: float = 1e5) -> Scene:
    """Return a scene in which a spinning ball flies at a body off its middle."""
    others = {
        "ball": body_at(
            rolling_ball(0.2, 3.0, stiffness=stiffness, damping=0.0), (0, 0, 0), omega=(3.0, -2.0, 1.0)
        ),
        "block": body_at(BLOCK, (0.16, 0, 0), turn=(0.1, 0.2, 0.3), omega=(1.0, 2.0, 3.0)),
    }
    ball = rolling_ball(0.1, 1.0, stiffness=stiffness, damping=0.0)
    flies = body_at(ball, (-0.32, 0.06, 0.04), velocity=(2.0, 0, 0), omega=(5.0, 20.0, -10.0))
    return scene(flies, others[of], contact=replace(BETWEEN, strength=1e-3, reach=2e-3))


@pytest.mark.slow
@pytest.mark.parametrize("of", ["ball", "block"])
def test_momenta_and_energy_are_kept(of: str) -> None:
    simulator = twins(thrown(of), 1e-4)
    before, energy = momenta(simulator), simulator.measure().balance[0]
    simulator.advance(2000)
    pairs = simulator.pairs()
    assert pairs.impulse[0].max() > 0.5
    assert pairs.friction_loss[0].max() > 1e-3
    np.testing.assert_allclose(momenta(simulator), before, rtol=0, atol=1e-12)
    assert simulator.measure().balance[0] == pytest.approx(energy, rel=1e-4)


@pytest.mark.slow
def test_struck_ball_rolls_with_5_7_and_the_other_with_2_7() -> None:
    """A ball rolls into an equal one at rest, on a table; each copy is as alone, to the bit."""
    speed = 2.0
    cue = body_at(FREE_BALL, (-0.25, 0, 0.1015), velocity=(speed, 0, 0), omega=(0, speed / 0.1, 0))
    bodies = (cue, body_at(FREE_BALL, (0, 0, 0.1015)), body_at(BLOCK, (9, 0, 0.3)))
    of = Scene(
        bodies=bodies, surfaces=(floor(),), contact=Contact(friction=0.2), collisions=Contact(friction=0.0)
    )
    simulator, other = twins(of, 5e-4), twins(of, 5e-4)
    x, v = (np.repeat(each[None], 2, axis=0) for each in (of.positions, of.velocities))
    x[1, of.slices[0], 1] += 0.05
    other.place(x, v)
    for each in (simulator, other):
        each.advance(1000)
        each.advance(1000)
    moved, turned = motions(simulator)
    np.testing.assert_allclose(moved[:2, 0], [2 / 7 * speed, 5 / 7 * speed], rtol=0.01)
    np.testing.assert_allclose(moved[:2, 0], 0.1 * turned[:2, 1], rtol=1e-3)
    found = simulator.contacts()
    on_table = found.surface[0] == 0
    assert set(found.first[0][on_table]) >= {0, 1}
    simulator.advance(1)
    later = simulator.contacts()
    for n in range(2):
        given = sum(each.impulse[0][each.first[0] == n].sum(axis=0) for each in (found, later))
        np.testing.assert_allclose(
            motions(simulator)[0][n] - moved[n], 0.5 * given - (0, 0, G * 5e-4), atol=1e-12
        )
    other.advance(1)
    assert other.positions[0].tobytes() == simulator.positions[0].tobytes()
    assert other.velocities[0].tobytes() == simulator.velocities[0].tobytes()
    assert other.positions[1].tobytes() != simulator.positions[1].tobytes()


@pytest.mark.slow
def test_springs_that_collide_approach_their_twin_as_they_grow_stiff() -> None:
    """After an impact of two spinning balls, velocities differ from the twin's by 1/k, as springs stretch.

    The twin has the inertia of the shape that it is given, and soft bodies are placed as they stretch.
    """
    _, v, w = after(thrown("ball", 1e9), 0.15, 2e-5)
    off = []
    for stiffness in (1e4, 1e5, 1e6):
        springs = full(thrown("ball", stiffness), step=2e-5, copies=2)
        springs.advance(round(0.15 / springs.step))
        found = motions(springs)
        off.append(max(np.abs(found[0] - v)[:2].max(), 0.1 * np.abs(found[1] - w)[:2].max()))
    assert off[1] < 0.2 * off[0]
    assert off[2] < 0.2 * off[1]
    assert off[2] < 5e-5
