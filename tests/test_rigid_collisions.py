"""Rigid bodies that collide: momenta, energy, restitution, friction, pins and balls, and the springs' limit.

All scenes have all kinds of terms (`tests.collisions.stepped.full`), so that their kernels are compiled once:
that takes a minute. Every run has one impact; the others are of slow runs.
"""

from __future__ import annotations

import numpy as np
import pytest

from springgym.bodies import Body, ball, box, cube, top
from springgym.scene import Placed, Scene
from springgym.simulator import Simulator
from springgym.surfaces import Contact, floor
from tests.collisions.cases import approach
from tests.collisions.impacts import impacts
from tests.collisions.stepped import full
from tests.copies import check_alone, check_calls, check_contacts

REACH, STRENGTH = 0.01, 0.01
G = 9.81
COPIES = 32

CUBE = cube(damping=0.0)
SLAB = box((4.0, 4.0, 0.5), 8.0, damping=0.0)
BALL = ball(0.1, 0.5)


def contact(friction: float = 0.0, restitution: float = 1.0) -> Contact:
    return Contact(friction, restitution, strength=STRENGTH, reach=REACH)


# --- In every run ---------------------------------------------------------------------------------------


def test_an_impact() -> None:
    """A cube strikes and rubs another off its middle.

    Momenta are kept to rounding, and what friction and loss take is entered.
    The impulse J is (1 + e) v m/2 at any phase, by a restitution that is the law's to .04, as below,
    and to as much again as friction turns the bodies meanwhile. What slips all the time is rubbed by no more
    than μ J.
    """
    step = 1e-3
    simulator = full(pair(CUBE, contact(0.3, 0.5)), dynamics="rigid", step=step, copies=8)
    x = np.repeat(simulator.scene.positions[None], 8, axis=0)
    v = np.zeros_like(x)
    x[:, 8:] = np.add(x[:, :8], (1.012, 0.2, 0.0))
    x[:, 8:, 0] += np.linspace(0, step, 8, endpoint=False)[:, None]
    v[:, :8] = (1.0, 0.5, 0.0)
    simulator.place(x, v)
    before = simulator.measure()
    simulator.advance(32)
    after, told = simulator.measure(), simulator.pairs()
    losses = after.friction_loss, after.contact_loss
    impulse, (along, across, _) = told.impulse[:, 0], simulator.measure("second").centre_velocity.T
    np.testing.assert_allclose(before.momentum, after.momentum, rtol=0, atol=1e-13)
    np.testing.assert_allclose(before.angular_momentum, after.angular_momentum, rtol=0, atol=1e-13)
    np.testing.assert_allclose(before.balance, after.balance, rtol=1e-8)
    np.testing.assert_allclose((told.friction_loss[:, 0], told.contact_loss[:, 0]), losses, rtol=1e-12)
    assert np.min(losses) > 0.02
    assert CUBE.mass * along == pytest.approx(impulse, rel=1e-3)
    assert impulse == pytest.approx((1 + 0.5) * CUBE.mass / 2, abs=2 * 0.04 * CUBE.mass / 2)
    assert (0.9 * 0.3 * impulse < CUBE.mass * across).all()
    assert (CUBE.mass * across <= 0.3 * impulse).all()


# --- Free bodies ----------------------------------------------------------------------------------------


def pair(body: Body = CUBE, how: Contact | None = None) -> Scene:
    """Two bodies without weight, far apart."""
    away = body.positions + np.array([4 * body.size, 0.0, 0.0])
    return Scene(
        bodies=(Placed(body, name="first"), Placed(body, away, name="second")),
        gravity=(0.0, 0.0, 0.0),
        contact=contact() if how is None else how,
        collisions="all",
    )


def twins(step: float, how: Contact | None = None, body: Body = CUBE) -> Simulator:
    return full(pair(body, how), dynamics="rigid", step=step, copies=COPIES)


def thrown(step: float, how: Contact | None = None, body: Body = CUBE) -> Simulator:
    """Pairs of bodies on their way to each other at 1 m/s, each turned and spinning in its own way."""
    simulator = twins(step, how, body)
    simulator.place(*impacts(body, body, 1.0, COPIES, np.random.default_rng(3)))
    return simulator


def energy_errors(step: float, body: Body) -> np.ndarray:
    simulator = thrown(step, body=body)
    before = simulator.measure()
    simulator.advance(round(1.0 / step))
    after = simulator.measure()
    assert (simulator.pairs().impulse > 0).sum() > COPIES / 2
    assert simulator.pairs().misses.sum() == 0
    scale = np.abs(before.angular_momentum).max()
    np.testing.assert_allclose(after.momentum, before.momentum, atol=1e-12 * body.mass)
    np.testing.assert_allclose(
        after.angular_momentum, before.angular_momentum, atol=1e-12 * max(scale, body.mass)
    )
    return np.abs(after.energy / before.energy - 1)[simulator.pairs().impulse[:, 0] > 0]


@pytest.mark.slow
@pytest.mark.parametrize("body", [CUBE, top(damping=0.0)], ids=["cubes", "tops"])
def test_elastic_impacts_keep_momenta_to_rounding_and_energy_to_second_order(body: Body) -> None:
    coarse, fine = (np.median(energy_errors(REACH / n, body)) for n in (15, 60))
    assert coarse < 1e-3
    assert fine < coarse / 6


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [1.0, 0.5])
def test_faces_rebound_with_the_restitution(restitution: float) -> None:
    """At every speed: what is in contact longer than a step has the law's."""
    simulator = twins(5e-5, contact(restitution=restitution))  # contact takes some 5e-3 s
    x, v = np.repeat(simulator.scene.positions[None], COPIES, axis=0), np.zeros((COPIES, 16, 3))
    x[:, 8:] = x[:, :8] + (1.05, 0.0, 0.0)
    speeds = np.geomspace(0.2, 1.0, COPIES)
    v[:, :8, 0] = speeds[:, None]
    simulator.place(x, v)
    simulator.advance(14_000)
    first, second = (simulator.measure(body).centre_velocity[:, 0] for body in ("first", "second"))
    np.testing.assert_allclose((second - first) / speeds, restitution, atol=0.04)
    m = simulator.measure()
    np.testing.assert_allclose(m.balance, 0.5 * speeds**2 * CUBE.mass, rtol=2e-3)
    np.testing.assert_allclose(simulator.pairs().contact_loss[:, 0], m.contact_loss, rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_friction_and_loss_are_entered_and_nothing_gains() -> None:
    simulator = thrown(REACH / 30, contact(0.5, 0.6))
    first = simulator.measure()
    energy = first.energy
    for _ in range(40):
        simulator.advance(75)
        m = simulator.measure()
        assert (m.energy - energy < 1e-3 * first.energy).all()
        energy = m.energy
    lost = m.friction_loss
    np.testing.assert_allclose(m.momentum, first.momentum, atol=1e-12)
    np.testing.assert_allclose(m.angular_momentum, first.angular_momentum, atol=1e-11)
    assert np.median(lost / first.energy) > 1e-2
    assert np.median(np.abs(m.balance / first.balance - 1)) < 1e-3
    np.testing.assert_allclose(simulator.pairs().friction_loss[:, 0], lost, rtol=1e-9, atol=1e-15)


def test_calls_of_any_length_have_the_bits_of_one_and_a_state_restores_an_impact() -> None:
    """Of bodies on a floor and each other, with friction and loss."""
    simulator = full(stack(contact(0.5, 0.6)), dynamics="rigid", step=1e-3, copies=2)
    v = np.repeat([[0.0, 0.0, 0.0], [1.0, 0.5, -0.2]], 8, axis=0)
    simulator.place(simulator.scene.positions, v)
    check_calls(simulator, [1, 2, 57, 3, 37, 100])
    assert (simulator.pairs().contact_loss > 0).all()
    assert (simulator.pairs().friction_loss > 0.01).all()


@pytest.mark.slow
@pytest.mark.parametrize("alone", [False, True])
def test_every_copy_has_the_bits_of_another_batch_and_of_a_single_one(alone: bool) -> None:
    """A single one has a block of one copy, and nothing but what its scene asks for."""
    scene, options = pair(CUBE, contact(0.5, 0.6)), {"dynamics": "rigid", "step": REACH / 30}

    def make(copies: int) -> Simulator:
        if alone and copies == 1:
            return Simulator(scene, **options)
        return full(scene, copies=max(copies, 2), **options)

    x, v = impacts(CUBE, CUBE, 1.0, COPIES, np.random.default_rng(3))
    batch = check_alone(make, x, v, [1500], (0, 5, 31))
    assert (batch.pairs().impulse[[0, 5, 31], 0] > 0).sum() >= 2


def test_contacts_are_told_as_those_of_springs() -> None:
    simulator = full(pair(CUBE, contact(0.4, 0.6)), dynamics="rigid", step=1e-3, copies=2)
    simulator.place(*approach("crossed edges", 2.0))
    assert np.abs(check_contacts(simulator, 30)[:, 0, 0]).sum() > 0.5


@pytest.mark.slow
def test_springs_approach_their_twin_as_they_grow_stiff() -> None:
    """By their velocities after an impact; contact is the same for all."""
    x, v = impacts(CUBE, CUBE, 1.0, COPIES, np.random.default_rng(3))
    rigid = thrown(2e-4)
    rigid.advance(round(0.7 / rigid.step))
    hit = rigid.pairs().impulse[:, 0] > 0
    errors = []
    for stiffness in (1e5, 1e6, 1e7):
        springs = full(pair(cube(stiffness=stiffness, damping=0.0)), copies=COPIES)
        springs.place(x, v)
        springs.advance(round(0.7 / springs.step))
        apart = [
            np.linalg.norm(springs.measure(n).centre_velocity - rigid.measure(n).centre_velocity, axis=1)
            for n in (0, 1)
        ]
        errors.append(np.median(np.maximum(*apart)[hit]))
    assert errors[2] < 0.02
    assert errors[2] < errors[1] < errors[0]


# --- Pinned, and among surfaces -------------------------------------------------------------------------


def on_slab(angle: float = 0.0, how: Contact | None = None) -> Scene:
    """A cube and a ball on a slab that is pinned altogether; gravity is turned by an angle [°]."""
    g = G * np.array([np.sin(np.radians(angle)), 0.0, -np.cos(np.radians(angle))])
    low = SLAB.positions[:, 2].max()
    body = CUBE.positions - CUBE.centre
    return Scene(
        bodies=(
            Placed(SLAB, pinned=tuple(range(8)), name="slab"),
            Placed(CUBE, np.add(body, (0.0, 0.0, low - body[:, 2].min() + REACH)), name="cube"),
            Placed(BALL, np.array([[-1.2, 1.2, low + 0.1 + REACH]]), name="ball"),
        ),
        gravity=tuple(g),
        contact=contact(0.5, 0.3) if how is None else how,
        collisions="all",
    )


@pytest.mark.slow
def test_friction_holds_below_its_limit_and_slides_above() -> None:
    slides = []
    for angle in (25.5, 27.6):  # arctan 0.5 is 26.57°
        simulator = full(on_slab(angle), dynamics="rigid", step=1e-3, copies=2)
        simulator.advance(1500)  # it falls by Δ and comes to rest, or does not
        before = [simulator.measure(body) for body in ("cube", "ball")]
        simulator.advance(200)
        after = [simulator.measure(body) for body in ("cube", "ball")]
        slides.append([(b.centre - a.centre)[0, 0] for a, b in zip(before, after, strict=True)])
        gained = [(b.centre_velocity - a.centre_velocity)[0, 0] for a, b in zip(before, after, strict=True)]
    np.testing.assert_allclose(slides[0], 0.0, atol=1e-6)
    down = 0.2 * G * (np.sin(np.radians(27.6)) - 0.5 * np.cos(np.radians(27.6)))
    np.testing.assert_allclose(gained, down, rtol=0.02)


@pytest.mark.slow
def test_a_body_turns_about_its_pin_when_it_is_hit() -> None:
    """Angular momentum about the pin is kept, and so is energy."""
    pinned = CUBE.positions
    hits = np.add(pinned, (1.1, 0.3, 0.2))
    speed = np.repeat([[-1.0, 0.0, 0.0]], 8, axis=0)
    scene = Scene(
        bodies=(Placed(CUBE, pinned=(0,), name="door"), Placed(CUBE, hits, speed, name="stone")),
        gravity=(0.0, 0.0, 0.0),
        contact=contact(),
        collisions="all",
    )
    simulator = full(scene, dynamics="rigid", step=2e-4, copies=2)
    pin, mass = pinned[0], np.concatenate([CUBE.masses, CUBE.masses])

    def about_pin() -> np.ndarray:
        return np.einsum("n,cnx->cx", mass, np.cross(simulator.positions - pin, simulator.velocities))

    before = about_pin()
    simulator.advance(3000)
    assert np.linalg.norm(simulator.measure("door").angular_velocity, axis=1).min() > 0.2
    np.testing.assert_allclose(about_pin(), before, atol=1e-12)
    np.testing.assert_allclose(simulator.measure().energy, 0.5 * CUBE.mass, rtol=1e-4)
    np.testing.assert_array_equal(simulator.positions[:, 0], [pin] * 2)


def stack(how: Contact) -> Scene:
    """A cube above another, aside, above a floor."""
    body = CUBE.positions - CUBE.positions.min(axis=0)
    return Scene(
        bodies=(
            Placed(CUBE, np.add(body, (0.0, 0.0, REACH)), name="lower"),
            Placed(CUBE, np.add(body, (0.1, 0.2, 1 + 2 * REACH)), name="upper"),
        ),
        surfaces=(floor(),),
        contact=how,
        collisions="all",
    )


@pytest.mark.slow
def test_cubes_stack_on_a_floor_and_one_is_pushed() -> None:
    """Surfaces and pairs are all else to each other: a stack rests, and weighs what it does on the floor."""
    simulator = full(stack(contact(0.5, 0.3)), dynamics="rigid", step=1e-3, copies=2)
    first = simulator.measure().balance
    simulator.advance(4000)
    assert np.abs(simulator.velocities).max() < 1e-6
    np.testing.assert_allclose(simulator.measure().balance, first, rtol=1e-3)
    simulator.pairs(forget=True)
    simulator.advance(1000)
    np.testing.assert_allclose(simulator.pairs().impulse[:, 0], G * CUBE.mass, rtol=1e-3)


# --- What is refused ------------------------------------------------------------------------------------


def test_a_rod_that_collides_is_refused_with_the_reason() -> None:
    rod = Body("rod", np.array([(0, 0, 0), (1, 0, 0)]), 1.0, [(0, 1)], 1e5, 0.0, radius=0.1)
    away = rod.positions + np.array([5.0, 0.0, 0.0])
    scene = Scene(bodies=(Placed(CUBE, name="a"), Placed(rod, away, name="b")), collisions="all")
    with pytest.raises(ValueError, match="one line"):
        Simulator(scene, dynamics="rigid")
