"""Capsules among bodies that collide: inertia, rolling, Coulomb's friction, momenta, and what is refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from springgym.bodies import ball, capsule, cube, rolling_ball, rope, sphere
from springgym.collisions import shape
from springgym.scene import Placed, Scene
from springgym.surfaces import Contact
from springgym.theory.contact import rest_height
from tests.collisions.stepped import full
from tests.collisions.test_spheres import (
    BLOCK,
    G,
    body_at,
    check_coulomb,
    check_momenta,
    check_rolling,
    motion,
    run,
    scene,
)
from tests.params import each_dynamics

RADIUS, LENGTH = 0.1, 0.3
CAPSULE = capsule(RADIUS, LENGTH, 1.0, damping=0.0)
ACROSS = (math.pi / 2, 0.0, 0.0)
"""Turns the axis from z to −y."""


def share_about_axis(radius: float, length: float) -> float:
    """Return I/(m r²) of a solid capsule about its axis, from the volumes of its parts."""
    cylinder, balls = math.pi * radius**2 * length, 4 / 3 * math.pi * radius**3
    return (cylinder / 2 + balls * 2 / 5) / (cylinder + balls)


# --- The body -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("radius", "length"), [(0.1, 0.3), (0.05, 0.01), (0.01, 1.0)])
def test_inertia_is_that_of_a_solid(radius: float, length: float) -> None:
    """Compare with the sum over thin disks."""
    z = (np.arange(200_000) + 0.5) / 200_000 * (length / 2 + radius)
    square = radius**2 - np.maximum(z - length / 2, 0.0) ** 2
    about, along = np.average(square / 2, weights=square), np.average(z**2, weights=square)
    body = capsule(radius, length, 2.0)
    np.testing.assert_allclose(np.diag(body.inertia())[2], 2.0 * about, rtol=1e-6)
    np.testing.assert_allclose(np.diag(body.inertia())[:2], 2.0 * (about / 2 + along), rtol=1e-6)
    np.testing.assert_allclose(body.inertia(), np.diag(np.diag(body.inertia())), atol=1e-15)
    np.testing.assert_allclose(body.centre, 0.0, atol=1e-15)
    assert about == pytest.approx(share_about_axis(radius, length) * radius**2, rel=1e-6)


@pytest.mark.parametrize("length", [9e-4, 101.0, 1e20])
def test_a_cylinder_that_is_too_short_or_too_long_is_refused(length: float) -> None:
    with pytest.raises(ValueError, match=rf"length is {re.escape(str(length))}; .* from 0.001 to 100"):
        capsule(0.1, length)


def test_others_meet_two_equal_balls_about_particles_as_a_capsule() -> None:
    assert shape(CAPSULE).edges.tolist() == [[0, 1]]
    assert shape(CAPSULE).radius == RADIUS
    ends = CAPSULE.positions[:2]
    unequal = (sphere(RADIUS, ends[0]), sphere(0.9 * RADIUS, ends[1]))
    beside = (sphere(RADIUS, ends[0]), sphere(RADIUS, 0.9 * ends[1]))
    twice = (sphere(RADIUS, ends[0]), sphere(RADIUS, ends[0]))
    partly = (sphere(RADIUS, ends[0], (0, 1, 2, 4)), sphere(RADIUS, ends[1]))
    for rounds in (unequal, beside, twice, partly):
        with pytest.raises(ValueError, match="or two of one radius about two particles"):
            scene(body_at(CAPSULE.with_(rounds=rounds), (0, 0, 0)))
    with pytest.raises(ValueError, match="pin all or none"):
        scene(Placed(CAPSULE, pinned=(0,)))


# --- Rolling --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("angle", "friction"), [(0.2, 0.5), (0.4, 0.05)])
def test_capsule_rolls_down_a_tilted_block(angle: float, friction: float) -> None:
    """Both ends bear it."""
    share = share_about_axis(RADIUS, LENGTH)
    check_rolling(CAPSULE, share, angle, friction, carriers=2, turn=ACROSS)


def test_friction_of_a_capsule_on_a_free_block_is_coulombs() -> None:
    """A capsule slides over a free block along its own axis as long as both touch."""
    check_coulomb(CAPSULE, RADIUS + 0.004, turn=(0, math.pi / 2, 0))


@each_dynamics
def test_crossed_capsules_turn_each_other(dynamics: str) -> None:
    """One spins about its axis and falls across the middle of another: friction stops the slip of the skins.

    The impulse j that stops the slip r ω, along the other's axis, turns that across: K = 2/m + r²/I + r²/I'.
    """
    spin, speed, stiff = 5.0, 0.5, capsule(RADIUS, LENGTH, 1.0, stiffness=1e8, damping=0.0)
    contact = Contact(friction=2.0, restitution=1.0, strength=2e-4, reach=0.002)
    above = (0, 0, 2 * RADIUS + 0.0021)
    first = body_at(stiff, above, velocity=(0, 0, -speed), turn=ACROSS, omega=(0, spin, 0))
    across = body_at(stiff, (0, 0, 0), turn=(0, math.pi / 2, 0))
    v, w = motion(run(scene(first, across, contact=contact), 0.04, step=1e-5, dynamics=dynamics))
    inertia = share_about_axis(RADIUS, LENGTH) * RADIUS**2
    j = RADIUS * spin / (2.0 + RADIUS**2 / inertia + RADIUS**2 / stiff.inertia()[0, 0])
    np.testing.assert_allclose(v[:2, 0], [j, -j], rtol=1e-2)
    np.testing.assert_allclose(spin - w[0, 1], RADIUS * j / inertia, rtol=2e-2)


def test_capsule_that_spins_throws_a_ball_that_does_not_turn() -> None:
    """Friction acts at the centre of the ball, a distance 2 r from the axis: K = 2/m + (2 r)²/I."""
    spin, speed, stiff = 5.0, 0.5, capsule(RADIUS, LENGTH, 1.0, stiffness=1e8, damping=0.0)
    contact = Contact(friction=9.0, restitution=1.0, strength=2e-4, reach=0.002)
    above = (0, 0, 2 * RADIUS + 0.0021)
    first = body_at(stiff, above, velocity=(0, 0, -speed), turn=ACROSS, omega=(0, spin, 0))
    struck = body_at(ball(RADIUS, 1.0), (0, 0, 0))
    simulator = run(scene(first, struck, contact=contact), 0.04, step=1e-5)
    v = [simulator.measure(n).centre_velocity[0, 0] for n in range(2)]
    j = 2 * RADIUS * spin / (2.0 + 4 / share_about_axis(RADIUS, LENGTH))
    np.testing.assert_allclose(v, [j, -j], rtol=2e-2)


# --- What is kept ---------------------------------------------------------------------------------------


def thrown(of: str, stiffness: float = 1e5, damping: float = 0.0) -> Scene:
    """Return a scene in which a spinning capsule flies at another body off its middle."""
    springs = {"stiffness": stiffness, "damping": damping}
    first, block = capsule(RADIUS, LENGTH, 1.0, **springs), cube(0.5, **springs)
    flat = {"velocity": (2.0, 0, 0), "omega": (0.0, 0.0, 20.0)}
    tilted = {"velocity": (2.0, 0, 0), "omega": (5.0, 20.0, -10.0), "turn": (0.3, 0.2, 0.5)}
    others = {
        "ball": lambda: body_at(rolling_ball(0.2, 3.0, **springs), (-0.1, 0, 0), omega=(3.0, -2.0, 1.0)),
        "block": lambda: body_at(block, (0.1, 0, 0), turn=(0.1, 0.2, 0.3), omega=(1.0, 2.0, 3.0)),
        "capsule": lambda: body_at(first, (-0.1, 0, 0), turn=(0, 1.0, 0.3), omega=(3.0, -2.0, 1.0)),
        "parallel": lambda: body_at(first, (-0.1, 0, 0.02), omega=(0.0, 0.0, 10.0)),
        "rope": lambda: body_at(rope(5, 1.0, 0.3, radius=0.03), (-0.2, 0.02, -0.4)),
    }
    aim = flat if of == "parallel" else tilted
    contact = Contact(friction=0.3, restitution=0.8, strength=2e-3, reach=5e-3)
    return scene(body_at(first, (-0.48, 0.06, 0.04), **aim), others[of](), contact=contact)


@pytest.mark.parametrize("of", ["ball", "block", "capsule", "parallel", "rope"])
def test_momenta_and_energy_are_kept(of: str) -> None:
    """Energy to what ringing springs, which move the skin, do against the barriers: some 1/k."""
    check_momenta(thrown(of), 0.1, 2e-3)
    if of == "capsule":
        check_momenta(thrown(of, 1e6), 0.1, 2e-4)


def test_contacts_are_told_at_the_skin() -> None:
    """A capsule that lies on a block touches it below both ends; each contact bears half of its weight."""
    contact = Contact(friction=0.5, restitution=0.0, strength=2e-4, reach=2e-3)
    gap = rest_height(G / 2, 2e-4, 2e-3)
    lies = body_at(capsule(RADIUS, LENGTH, 1.0), (0, 0, 0.25 + RADIUS + gap), turn=ACROSS)
    block = body_at(BLOCK, (0, 0, 0), pinned=True)
    simulator = full(scene(lies, block, contact=contact, gravity=(0, 0, -G)), copies=2, step=2e-4)
    simulator.advance(2500)
    found = simulator.contacts()
    there = found.there[0]
    assert there.sum() == 2
    points = found.point[0, there]
    np.testing.assert_allclose(sorted(points[:, 1]), [-LENGTH / 2, LENGTH / 2], atol=1e-3)
    np.testing.assert_allclose(points[:, 2], 0.25 + gap / 2, atol=1e-4)
    force = found.force[0, there]
    np.testing.assert_allclose(force.sum(axis=0), [0, 0, G], atol=1e-2 * G)
    np.testing.assert_allclose(force[:, 2], G / 2, rtol=0.02)


# --- Rigid capsules -------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("of", ["ball", "block", "capsule", "parallel"])
def test_springs_approach_their_twin_as_they_grow_stiff(of: str) -> None:
    """After an impact, velocities differ from those of the twin by less, the stiffer the springs are."""

    def after(stiffness: float, dynamics: str) -> np.ndarray:
        simulator = run(thrown(of, stiffness), 0.1, step=2e-6, dynamics=dynamics)
        v, w = motion(simulator)
        return np.concatenate([v, RADIUS * w], axis=1)[:2]

    rigid = after(1e10, "rigid")
    off = [np.abs(after(stiffness, "springs") - rigid).max() for stiffness in (1e7, 1e8, 1e9)]
    assert off[1] < 0.5 * off[0]
    assert off[2] < 0.5 * off[1]
    assert off[2] < 6e-3
