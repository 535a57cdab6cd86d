"""Spheres that turn among bodies that collide: friction that turns them, rolling, restitution, momenta."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from springgym.bodies import Body, capsule, cube, disk, ellipsoid, rolling_ball, sphere, start
from springgym.scene import Placed, Scene
from springgym.simulator import Simulator, UnresolvedContactError
from springgym.surfaces import Contact, floor
from springgym.theory import rolling
from springgym.theory.contact import rest_height
from tests.collisions.stepped import full
from tests.copies import check_alone
from tests.params import each_dynamics, slow_but

G = 9.81
BALL = rolling_ball(0.1, 1.0, damping=0.0)
BLOCK = cube(0.5, damping=0.0)
CONTACT = Contact(friction=0.3, restitution=0.8)


def body_at(body: Body, position: Any, pinned: bool = False, **begins: Any) -> Placed:
    """Return a body placed with its centre at a position; ``begins`` are further arguments of `start`."""
    begun = start(body, position=position, **begins)
    pins = tuple(range(len(body.masses))) if pinned else ()
    return Placed(body, begun.positions, begun.velocities, pinned=pins)


def scene(*bodies: Placed, contact: Contact = CONTACT, gravity: Any = (0.0, 0.0, 0.0)) -> Scene:
    """Return a scene of bodies that collide, and a block far away that gives it all kinds of features."""
    return Scene(bodies=(*bodies, body_at(BLOCK, (0, 100.0, 0))), contact=contact, gravity=gravity)


def run(of: Scene, duration: float, **options: Any) -> Simulator:
    simulator = full(of, copies=2, **options)
    simulator.advance(round(duration / simulator.step))
    return simulator


def motion(simulator: Simulator, copy: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocities and angular velocities (bodies, 3) about the centres of mass."""
    found = []
    for placed, own in zip(simulator.scene.bodies, simulator.scene.slices, strict=True):
        m = placed.body.masses[:, None]
        x, v = simulator.positions[copy, own], simulator.velocities[copy, own]
        arms, mean = x - (m * x).sum(0) / m.sum(), (m * v).sum(0) / m.sum()
        second = (m * arms).T @ arms
        inertia = np.trace(second) * np.eye(3) - second
        found.append((mean, np.linalg.solve(inertia, (m * np.cross(arms, v)).sum(0))))
    return tuple(np.array(of) for of in zip(*found, strict=True))  # type: ignore[return-value]


def momenta(simulator: Simulator) -> np.ndarray:
    """Return momentum and angular momentum (6,) of all bodies but the block far away."""
    own = slice(0, simulator.scene.starts[-2])
    m = simulator.scene.masses[own, None]
    x, v = simulator.positions[0, own], simulator.velocities[0, own]
    return np.concatenate([(m * v).sum(0), (m * np.cross(x, v)).sum(0)])


# --- Two spheres ----------------------------------------------------------------------------------------


@each_dynamics
@pytest.mark.parametrize("restitution", [1.0, 0.8, 0.5])
@pytest.mark.parametrize("speed", [0.1, 0.5, 1.0])
def test_restitution_of_two_spheres(restitution: float, speed: float, dynamics: str) -> None:
    left = body_at(BALL, (-0.21, 0, 0), velocity=(speed, 0, 0))
    of = scene(left, body_at(BALL, (0, 0, 0)), contact=replace(CONTACT, restitution=restitution))
    v, _ = motion(run(of, 0.1 / speed, step=2e-4, dynamics=dynamics))
    off = 0.01 if dynamics == "rigid" and speed < 1 else 0.02
    assert (v[1, 0] - v[0, 0]) / speed == pytest.approx(restitution, abs=off)


@each_dynamics
@pytest.mark.parametrize(("friction", "slides"), [(0.05, True), (0.5, False)])
def test_friction_turns_both_spheres(friction: float, slides: bool, dynamics: str) -> None:
    """Coulomb's, or as much as stops the slip: of equal balls, 2/7 of the slip over 2 is the impulse."""
    spin, off = 10.0, 1e-2 if dynamics == "rigid" else 2e-2
    contact = Contact(friction=friction, restitution=1.0)
    left = body_at(BALL, (-0.21, 0, 0), velocity=(1.0, 0, 0), omega=(0, 0, spin))
    of = scene(left, body_at(BALL, (0, 0, 0)), contact=contact)
    simulator = run(of, 0.1, step=2e-4, dynamics=dynamics)
    v, w = motion(simulator)
    slip = spin * 0.1
    push = v[1, 0]
    rub = min(friction * push, slip / 7) if slides else slip / 7
    assert slides == (friction * push < slip / 7)
    np.testing.assert_allclose(v[1, 1], rub, rtol=off)
    np.testing.assert_allclose((spin - w[0, 2], -w[1, 2]), rub * 0.1 / 0.004, rtol=off)
    within = 1e-4 if dynamics == "rigid" else 1e-3
    assert simulator.measure().balance == pytest.approx(0.5 + 0.5 * 0.004 * spin**2, rel=within)


# --- A sphere and a body --------------------------------------------------------------------------------


def check_coulomb(body: Body, above: float, dynamics: str = "springs", **begins: Any) -> None:
    """Compare the friction on a body that slides over a free block as long as both touch with Coulomb's."""
    thrown = body_at(body, (0, 0, 0.25 + above), velocity=(3.0, 0, -0.5), **begins)
    of = scene(thrown, body_at(BLOCK, (0, 0, 0)))
    v, _ = motion(run(of, 0.05, step=1e-4, dynamics=dynamics))
    given = v[0] - (3.0, 0, -0.5)
    assert given[2] > 0.3
    assert -given[0] / (0.3 * given[2]) == pytest.approx(1.0, abs=0.005)


@each_dynamics
@pytest.mark.parametrize("radius", [0.05, 0.1, 0.2, 0.4])
def test_friction_on_a_free_block_is_coulombs(radius: float, dynamics: str) -> None:
    check_coulomb(rolling_ball(radius, 1.0, damping=0.0), radius + 0.004, dynamics)


def check_rolling(
    body: Body,
    share: float,
    angle: float,
    friction: float,
    dynamics: str = "springs",
    carriers: int = 1,
    **begins: Any,
) -> None:
    """Compare a round body (0.1 m, 1 kg, I = ``share`` m r²) that lies on a tilted block with theory.

    It rolls with the acceleration g sin a/(1 + I/(m r²)), or slides with g (sin a − μ cos a).
    """
    contact = Contact(friction=friction, restitution=0.5, strength=2e-4, reach=2e-3)
    up = np.array([math.sin(angle), 0, math.cos(angle)])
    down = np.array([math.cos(angle), 0, -math.sin(angle)])
    gap = rest_height(G * math.cos(angle) / carriers, 2e-4, 2e-3)
    block = body_at(BLOCK, (0, 0, 0), pinned=True, turn=(0, angle, 0))
    lies = body_at(body, (0.35 + gap) * up - 0.2 * down + (0, 0.03, 0), **begins)
    of = scene(lies, block, contact=contact, gravity=(0, 0, -G))
    simulator = full(of, copies=2, step=2e-4, dynamics=dynamics)
    off, speeds = 1e-6 if dynamics == "rigid" else 1e-3, []
    for _ in range(20):
        simulator.advance(100)
        v, w = motion(simulator)
        speeds.append(v[0] @ down)
    found = np.polyfit(0.02 * np.arange(20), speeds, 1)[0]
    rolls = friction > rolling.needed_friction(angle, share)
    slides = G * (math.sin(angle) - friction * math.cos(angle))
    assert found == pytest.approx(rolling.acceleration(angle, share) if rolls else slides, rel=off)
    assert (abs(v[0] @ down - 0.1 * w[0, 1]) < 2 * off * speeds[-1]) == rolls
    assert abs(v[0, 1]) < 1e-3 * speeds[-1]


@each_dynamics
@pytest.mark.parametrize(("angle", "friction"), [(0.2, 0.5), (0.4, 0.5), (0.4, 0.05)])
def test_ball_rolls_down_a_tilted_block(angle: float, friction: float, dynamics: str) -> None:
    check_rolling(BALL, 0.4, angle, friction, dynamics)


def test_ball_rebounds_from_an_edge_and_a_corner() -> None:
    for towards in ((1.0, 1.0, 0.0), (1.0, 1.0, 1.0)):
        n = np.array(towards) / np.linalg.norm(towards)
        place = 0.25 * np.array(towards) + 0.105 * n
        ball = body_at(BALL, place, velocity=-1.0 * n)
        v, w = motion(run(scene(ball, body_at(BLOCK, (0, 0, 0), pinned=True)), 0.05, step=2e-4))
        np.testing.assert_allclose(v[0], 0.8 * n, atol=0.02)
        np.testing.assert_allclose(w[0], 0.0, atol=1e-6)


# --- What is kept ---------------------------------------------------------------------------------------


def thrown(of: str, contact: Contact = CONTACT, body: Body | None = None, **springs: float) -> Scene:
    """Return a scene in which a spinning ball, or another body, flies at a body off its middle."""
    others = {
        "ball": body_at(rolling_ball(0.2, 3.0, **springs), (0, 0, 0), omega=(3.0, -2.0, 1.0)),
        "block": body_at(BLOCK, (0.16, 0, 0), turn=(0.1, 0.2, 0.3), omega=(1.0, 2.0, 3.0)),
    }
    flies = body_at(
        body or rolling_ball(0.1, 1.0, **springs),
        (-0.32, 0.06, 0.04),
        velocity=(2.0, 0, 0),
        omega=(5.0, 20.0, -10.0),
    )
    return scene(flies, others[of], contact=contact)


SOFT = replace(CONTACT, strength=1e-3, reach=2e-3)


def check_momenta(of: Scene, least: float, off: float, dynamics: str = "springs") -> None:
    """Momenta are kept to rounding, and energy to a share, in an impact that gives an impulse [N·s]."""
    simulator = full(of, copies=2, step=1e-4, dynamics=dynamics)
    before, energy = momenta(simulator), simulator.measure().balance[0]
    simulator.advance(2000)
    pairs = simulator.pairs()
    assert pairs.impulse[0].max() > least
    assert pairs.friction_loss[0].max() > 1e-3
    np.testing.assert_allclose(momenta(simulator), before, rtol=0, atol=1e-12)
    assert simulator.measure().balance[0] == pytest.approx(energy, rel=off)


@each_dynamics
@pytest.mark.parametrize("of", ["ball", "block"])
def test_momenta_and_energy_are_kept(of: str, dynamics: str) -> None:
    springs = dynamics == "springs"  # in which Verlet's error is of what rings
    check_momenta(thrown(of, CONTACT if springs else SOFT), 0.5, 3e-3 if springs else 1e-4, dynamics)


@pytest.mark.slow
def test_springs_that_collide_approach_their_twin_as_they_grow_stiff() -> None:
    """After an impact of two spinning balls, velocities differ from the twin's by 1/k, as springs stretch.

    The twin has the inertia of the shape that it is given, and soft bodies are placed as they stretch.
    """

    def after(stiffness: float, dynamics: str) -> np.ndarray:
        of = thrown("ball", SOFT, stiffness=stiffness, damping=0.0)
        v, w = motion(run(of, 0.15, step=2e-5, dynamics=dynamics))
        return np.concatenate([v[:2], 0.1 * w[:2]])

    twin = after(1e9, "rigid")
    off = [np.abs(after(stiffness, "springs") - twin).max() for stiffness in (1e4, 1e5, 1e6)]
    assert off[1] < 0.2 * off[0]
    assert off[2] < 0.2 * off[1]
    assert off[2] < 5e-5


@pytest.mark.parametrize("alone", slow_but([2, 1], 2))
@pytest.mark.parametrize("body", [BALL, capsule(0.1, 0.3, 1.0, damping=0.0)], ids=["ball", "capsule"])
def test_copies_are_those_of_their_own(body: Body, alone: int) -> None:
    """A copy moves as it does alone, to the bit, whatever the other copies of its block meet."""
    of = thrown("block", body=body)
    places = np.repeat(of.positions[None], 7, axis=0)
    places[:, of.slices[0], 1] += np.linspace(-0.1, 0.5, 7)[:, None]
    check_alone(
        lambda copies: full(of, copies=copies, step=2e-4),
        places,
        np.repeat(of.velocities[None], 7, axis=0),
        (400, 600),
        (0, 3, 6),
        alone,
    )


def test_too_fast_is_told() -> None:
    fast = scene(body_at(BALL, (-0.5, 0, 0), velocity=(60.0, 0, 0)), body_at(BALL, (0, 0, 0)))
    with pytest.raises(UnresolvedContactError, match="'rolling ball0' and 'rolling ball1'"):
        run(fast, 0.02, step=2e-4)
    counted = run(fast, 0.02, step=2e-4, unresolved="count")
    assert counted.unresolved.sum() > 0


# --- On a table -----------------------------------------------------------------------------------------


@each_dynamics
def test_struck_ball_rolls_with_5_7_and_the_other_with_2_7(dynamics: str) -> None:
    """A ball rolls into an equal one at rest, on a table: compare the speeds once both roll again."""
    speed = 2.0
    cue = body_at(BALL, (-0.25, 0, 0.1015), velocity=(speed, 0, 0), omega=(0, speed / 0.1, 0))
    bodies = (cue, body_at(BALL, (0, 0, 0.1015)))
    table = Scene(
        bodies=bodies, surfaces=(floor(),), contact=Contact(friction=0.2), collisions=Contact(friction=0.0)
    )
    simulator = full(table, copies=2, step=2e-4, dynamics=dynamics)
    simulator.advance(5000)
    v, w = motion(simulator)
    np.testing.assert_allclose(v[:, 0], [2 / 7 * speed, 5 / 7 * speed], rtol=0.01)
    np.testing.assert_allclose(v[:, 0], 0.1 * w[:, 1], rtol=1e-3 if dynamics == "rigid" else 1e-2)
    found, begun = simulator.contacts(), v  # each is told to be on the table, below its centre
    assert found.first.tolist() == [[0, 1]] * 2
    assert (found.second == -1).all()
    assert (found.surface == 0).all()
    centres = [simulator.measure(n).centre[0] + 1e-4 * v[n] for n in range(2)]  # half a step later
    np.testing.assert_allclose(found.point[0, :, :2], np.array(centres)[:, :2], atol=1e-4)
    simulator.advance(1)
    np.testing.assert_allclose(motion(simulator)[0] - begun, found.impulse[0] - (0, 0, G * 2e-4), atol=1e-12)


# --- What is refused ------------------------------------------------------------------------------------


def test_unfit_spheres_are_refused() -> None:
    two = BALL.with_(rounds=(sphere(0.1), sphere(0.05)))
    for body in (two, ellipsoid((0.15, 0.1, 0.08)), disk()):
        with pytest.raises(ValueError, match=r"cannot collide: only surfaces meet ellipsoids and disks"):
            scene(body_at(body, (0, 0, 0)), body_at(BALL, (1, 0, 0)))
    held = Placed(BALL, pinned=(0,))
    with pytest.raises(ValueError, match="pin all or none"):
        scene(held)
    deep = scene(body_at(BALL, (0, 0, 0)), body_at(BALL, (0.205, 0, 0)))
    with pytest.raises(ValueError, match="deep in each other"):
        scene(deep.bodies[0], body_at(BALL, (0.15, 0, 0)))
