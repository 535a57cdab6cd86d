"""The rigid twin on surfaces: energy, restitution, friction, and the springs' limit."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from springgym.bodies import Body, cube, start
from springgym.bodies.motion import InitialState
from springgym.contact.law import SLOW
from springgym.scene import Scene
from springgym.simulator import Simulator
from springgym.surfaces import Bowl, Contact, PaperContact, Pipe, Plane, floor, waves
from springgym.theory import contact as theory
from tests.copies import check_alone, check_contacts
from tests.forces.test_contact import VARYING
from tests.params import slow_but

CUBE = cube(damping=0.0)
STRENGTH, REACH = 0.05, 0.02
G = 9.81
RUBBING = ("friction", "restitution")
"""What varies in most of these scenes: so their contact is compiled once, and μ = 0 or e = 1 is a number."""


def contact(friction: float = 0.0, restitution: float = 1.0) -> Contact:
    return Contact(friction, restitution, strength=STRENGTH, reach=REACH)


def stone(stiffness: float = 1e5) -> Body:
    """An irregular tetrahedron with a particle at its centre."""
    corners = [(0.26, 0, -0.09), (-0.14, 0.24, -0.08), (-0.12, -0.23, -0.10), (0.03, 0.02, 0.27)]
    masses = np.array([1.2, 1.0, 1.1, 1.3, 2.4])
    corners = np.array(corners)
    positions = np.vstack([corners, masses[:4] @ corners / masses[:4].sum()])
    return Body("stone", positions, masses, list(itertools.combinations(range(5), 2)), stiffness, 0.0)


def thrown(copies: int, spin: float, speed: float, height: float = 0.8) -> InitialState:
    """Stones in any attitude, with random spins and velocities."""
    random, stones = np.random.default_rng(1), []
    for _ in range(copies):
        stones.append(
            start(
                stone(),
                omega=spin * random.normal(size=3),
                tilt=random.uniform(0, 3),
                roll=random.uniform(0, 6),
                position=(0, 0, height),
                velocity=speed * random.normal(size=3),
                stretched=False,
            )
        )
    return InitialState(np.stack([s.positions for s in stones]), np.stack([s.velocities for s in stones]))


def throw(
    began: InitialState, how: Contact, step: float, surfaces: tuple = (floor(),), **options
) -> Simulator:
    scene = Scene(stone(), began.positions[0], began.velocities[0], surfaces=surfaces, contact=how)
    copies = len(began.positions)
    simulator = Simulator(scene, dynamics="rigid", step=step, copies=copies, varying=RUBBING, **options)
    simulator.place(*began)
    return simulator


def worst_balance(simulator: Simulator, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Largest error of the energy balance relative to the energy, and least height, of every copy."""
    first = simulator.measure().balance
    worst, lowest = np.zeros_like(first), np.full_like(first, np.inf)
    for _ in range(round(seconds / simulator.step / 4)):
        simulator.advance(4, check=False)
        worst = np.maximum(worst, np.abs(simulator.measure().balance / first - 1))
        heights = [surface.height(simulator.positions).min(axis=1) for surface in simulator.scene.surfaces]
        lowest = np.minimum(lowest, np.min(heights, axis=0))
    return worst, lowest


# --- Energy -------------------------------------------------------------------------------------------


def test_without_loss_bounces_keep_the_energy_for_every_step() -> None:
    """Also amid an impact, where some of it is in the barrier; what is left is that of the sweeps."""
    began = thrown(8, 4.0, 0.0)
    for step in (2e-3, 5e-4):
        worst, lowest = worst_balance(throw(began, contact(), step), 1.5)
        assert worst.max() < 1e-5
        assert (lowest < REACH / 2).all()  # they did hit


def test_calls_of_a_and_b_steps_are_one_of_both_and_a_state_restores_an_impact() -> None:
    """Up to the sweeps, which a call begins anew; without what is kept of the last node they are not."""
    began = thrown(8, 4.0, 1.0, height=0.4)
    whole, parts = (throw(began, contact(0.6, 0.5), 1e-3) for _ in range(2))
    whole.advance(200, check=False)
    for n in range(200):
        parts.advance(1, check=False)
        if n == 99:
            state = parts.state()
    assert (whole.measure().contact_loss > 0.1).sum() > 2
    np.testing.assert_allclose(parts.positions, whole.positions, atol=1e-6)
    after = parts.positions
    parts.restore(state)
    for _ in range(100):
        parts.advance(1, check=False)
    np.testing.assert_array_equal(parts.positions, after)


@pytest.mark.parametrize(("friction", "restitution"), slow_but([(0.6, 1.0), (0.6, 0.5)], (0.6, 1.0)))
def test_the_ledger_closes_with_friction_and_loss(friction: float, restitution: float) -> None:
    began = thrown(8, 4.0, 1.0)
    simulator = throw(began, contact(friction, restitution), 1e-3)
    worst, _ = worst_balance(simulator, 1.5)
    m = simulator.measure()
    assert (m.friction_loss > 0.5).all()
    assert (m.contact_loss > 0.5).all() == (restitution < 1)
    assert worst.max() < 1e-2
    closer, _ = worst_balance(throw(began, contact(friction, restitution), 2.5e-4), 1.5)
    assert np.median(closer) < max(np.median(worst) / 6, 1e-8)


def test_nothing_gets_through_at_20_m_per_s_and_100_rad_per_s_in_a_corner_of_three_planes() -> None:
    corner = (floor(), Plane((-1, 0, 0), (1, 0, 0)), Plane((0, -1, 0), (0, 1, 0)))
    simulator = throw(thrown(16, 60.0, 12.0), contact(), 1e-3, corner)
    first = simulator.measure().energy
    worst, lowest = worst_balance(simulator, 1.0)
    assert (lowest > 0).all()
    assert (lowest < REACH / 10).sum() > 8  # they did hit
    assert simulator.unresolved.sum() > 8  # at 20 mm a step, which is told
    assert np.median(worst) < 0.2
    assert (simulator.measure().energy < 1.1 * first).all()


@pytest.mark.parametrize(
    "surfaces",
    [
        pytest.param((Bowl((0, 0, 1.5), 1.5),), id="bowl"),
        pytest.param(
            (Pipe((0, 0, 1.5), (0, 1, 0), 1.5), Plane((0, -2, 0), (0, 1, 0))),
            id="pipe with an end",
            marks=pytest.mark.slow,
        ),
        pytest.param((waves(0.1, 2.0, 3.0, 0.1, level=-0.1),), id="waves", marks=pytest.mark.slow),
    ],
)
@pytest.mark.slow
def test_energy_is_kept_on_curved_surfaces_at_either_step(surfaces: tuple) -> None:
    began = thrown(8, 3.0, 1.0)
    coarse, low = worst_balance(throw(began, contact(), 1e-3, surfaces), 2.0)
    fine, _ = worst_balance(throw(began, contact(), 2.5e-4, surfaces), 2.0)
    assert (low > 0).all()
    assert (low < REACH / 2).all()
    assert coarse.max() < 1e-6  # what is left is how far the sweeps agree
    assert fine.max() < 1e-6


def test_contacts_are_what_changes_momenta() -> None:
    given = check_contacts(throw(thrown(8, 4.0, 1.0, height=0.4), contact(0.6, 0.5), 1e-3), 200)
    assert (given[:, :, 2].sum(axis=0) > 1.0).sum() > 3
    assert np.abs(given[:, :, :2]).max() > 0.1


# --- Restitution and friction -------------------------------------------------------------------------


def resting(body: Body, slope: float = 0.0) -> np.ndarray:
    """A box on its four lower corners, at the height where the barrier carries it: c/h² − c/Δ² = m g/4."""
    weight = body.mass * G * np.cos(slope) / 4
    height = REACH / np.sqrt(1 + weight * REACH**2 / STRENGTH)
    return body.positions - body.positions[:, 2].min() * np.array([0, 0, 1]) + (0, 0, height)


def on_floor(positions: np.ndarray, velocity: tuple[float, ...], how: Contact, slope: float, step: float):
    gravity = (G * np.sin(slope), 0.0, -G * np.cos(slope))
    velocities = np.broadcast_to(velocity, positions.shape)
    scene = Scene(CUBE, positions, velocities, gravity=gravity, surfaces=(floor(),), contact=how)
    return Simulator(scene, dynamics="rigid", step=step, varying=RUBBING)


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.7, 1.0])
def test_a_cube_that_falls_flat_rebounds_with_the_restitution(restitution: float) -> None:
    """At 1 m/s, from wherever in a step it meets the floor."""
    step, speed = 2.5e-4, np.broadcast_to((0, 0, -1.0), CUBE.positions.shape)
    above = CUBE.positions + np.array([0, 0, 0.5 + REACH])
    scene = Scene(
        CUBE, above, speed, gravity=(0, 0, 0), surfaces=(floor(),), contact=contact(0.5, restitution)
    )
    simulator = Simulator(scene, dynamics="rigid", step=step, varying=RUBBING, copies=8)
    late = np.linspace(0, step, 8, endpoint=False)[:, None, None] * [0, 0, 1]
    simulator.place(above + late, speed + 0 * late)
    simulator.advance(1600, check=False)
    velocity = simulator.velocities
    # corners share the loss out by turns: what is to be stopped dead keeps some of its speed
    expected = theory.rebound(1.0, restitution, SLOW)
    np.testing.assert_allclose(velocity[..., 2], expected, atol=2e-3 if restitution else 5e-3)
    np.testing.assert_allclose(velocity[..., :2], 0.0, atol=5e-6)


def test_a_cube_at_rest_stays_at_rest() -> None:
    positions = resting(CUBE)
    simulator = on_floor(positions, (0, 0, 0), contact(0.5, 0.5), 0.0, 1e-3)
    simulator.advance(5000, check=False)
    np.testing.assert_allclose(simulator.positions[0], positions, atol=1e-9)
    found = simulator.contacts()
    corners = np.flatnonzero(positions[:, 2] < REACH)
    np.testing.assert_array_equal(found.particle, [corners])
    np.testing.assert_allclose(found.force[0, :, 2], CUBE.mass * G / 4, rtol=1e-5)
    np.testing.assert_allclose(found.force[0, :, :2].sum(axis=0), 0.0, atol=1e-5)  # corners strain each other
    np.testing.assert_allclose(found.gap[0], positions[corners, 2], rtol=1e-6)
    np.testing.assert_allclose(found.point[0], positions[corners] * (1, 1, 0.5), atol=1e-9)
    np.testing.assert_allclose(simulator.velocities[0], 0.0, atol=1e-2 * G * simulator.step)


def test_friction_holds_a_degree_below_its_angle_and_slides_rightly_a_degree_above() -> None:
    moves = []
    for angle in (-1, 1):
        slope = np.arctan(0.5) + np.radians(angle)
        simulator = on_floor(resting(CUBE, slope), (0, 0, 0), contact(0.5, 0.5), slope, 1e-3)
        simulator.advance(1000, check=False)
        first = simulator.measure()
        simulator.advance(1000, check=False)
        last = simulator.measure()
        moves.append(((last.centre - first.centre)[0, 0], (last.momentum - first.momentum)[0, 0] / CUBE.mass))
    assert abs(moves[0][0]) < 2e-5  # still settling on its corners; 1e-4 would be the least of phantom creep
    assert moves[1][1] == pytest.approx(G * (np.sin(slope) - 0.5 * np.cos(slope)), rel=1e-3)


def test_a_sliding_cube_stops_after_v_squared_over_two_mu_g() -> None:
    """The front corners press harder, which does not change the sum: μ M g until it stops."""
    positions = resting(CUBE)
    simulator = on_floor(positions, (1.0, 0, 0), contact(0.5, 0.5), 0.0, 1e-3)
    simulator.advance(1000, check=False)
    moved = simulator.measure().centre[0, 0] - CUBE.masses @ positions[:, 0] / CUBE.mass
    assert moved == pytest.approx(1 / (2 * 0.5 * G), rel=5e-3)
    assert np.abs(simulator.velocities).max() < 0.02


# --- Springs and copies -------------------------------------------------------------------------------


def test_springs_that_bounce_with_friction_approach_their_twin() -> None:
    """One bounce: the gap falls with 1/k once the body rings faster than it touches the floor."""
    gaps = []
    for stiffness in (1e7, 1e8):
        body = stone(stiffness)
        began = start(body, omega=(2, -3, 1), tilt=1.0, roll=0.5, position=(0, 0, 0.5), velocity=(1, 0.5, 0))
        scene = Scene(body, *began, surfaces=(floor(),), contact=contact(0.6, 0.5))
        h = 2e-4 / np.ceil(2e-4 * np.sqrt(stiffness) * 2)
        springs = Simulator(scene, step=h, varying=VARYING)
        both = springs, Simulator(scene, dynamics="rigid", step=5e-5, varying=RUBBING)
        for simulator in both:
            simulator.advance(round(0.35 / simulator.step), check=False)
            assert simulator.measure().friction_loss[0] > 0.5
        gaps.append(np.abs(both[0].positions - both[1].positions).max())
    assert gaps[1] < 5e-4
    assert gaps[1] < gaps[0] / 5


@pytest.mark.slow
def test_every_copy_has_the_bits_of_a_single_one_through_bounces_and_rest() -> None:
    began = thrown(11, 4.0, 1.0, height=0.4)

    def make(copies: int) -> Simulator:
        some = InitialState(*(array[:copies] for array in began))
        return throw(some, contact(0.6, 0.5), 1e-3)

    batch = check_alone(make, *began, [10] * 50, range(11), calls_alone=[10] * 50)
    assert (batch.measure().contact_loss > 0.1).all()


def test_methods_and_laws_without_meaning_are_refused_and_the_default_has_one() -> None:
    scene = Scene(CUBE, CUBE.positions + np.array([0, 0, 1]), surfaces=(floor(),))
    assert Simulator(scene, dynamics="rigid", varying=RUBBING).integrator.name == "verlet"
    with pytest.raises(ValueError, match="back in time"):
        Simulator(scene, dynamics="rigid", integrator="suzuki")
    with pytest.raises(ValueError, match="the paper's contact"):
        Simulator(scene.with_(contact=PaperContact()), dynamics="rigid")
