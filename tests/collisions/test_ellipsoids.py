"""Ellipsoids and disks collide with other bodies: momenta, restitution, rolling, rest, copies, refusals."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest

from springgym import packing
from springgym.bodies import (
    Body,
    ball,
    capsule,
    cube,
    disk,
    ellipsoid,
    ellipsoid_of,
    rolling_ball,
    rope,
    sphere,
)
from springgym.collisions import shape
from springgym.core.ellipsoids import ELLIPSOID, TRIANGLE, gaps
from springgym.scene import Placed, Scene
from springgym.simulator import Simulator, UnresolvedContactError
from springgym.surfaces import Contact, floor
from springgym.theory.contact import rest_height
from tests.collisions.stepped import full
from tests.collisions.test_spheres import BLOCK, G, body_at, check_copies, momenta, motion, run, scene

EGG = ellipsoid((0.15, 0.1, 0.08), 1.0, damping=0.0)
LOPSIDED = ellipsoid((0.2, 0.12, 0.1), 2.0, centre_of_mass=(0.03, 0.01, -0.02), damping=0.0)
COIN = disk(0.1, 0.7, damping=0.0)
REACH, STRENGTH = 2e-3, 2e-4
HOW = Contact(friction=0.3, restitution=1.0, strength=1e-3, reach=3e-3)

OTHERS = {
    "sphere": body_at(rolling_ball(0.1, 1.0, damping=0.0), (-0.3, 0.03, 0.02)),
    "capsule": body_at(capsule(0.05, 0.3, 1.0, damping=0.0), (-0.3, 0.03, 0.02)),
    "rope": body_at(rope(5, 0.8, 0.1, 0.2, damping=0.0, radius=0.03), (-0.3, 0, 0), turn=(0.3, 0, 0)),
    "ball": body_at(ball(0.05, 0.5), (-0.3, 0.03, 0.02)),
    "ellipsoid": body_at(LOPSIDED, (-0.4, 0.06, 0.04), omega=(5, 2, -1)),
    "block": body_at(BLOCK, (-0.5, 0.06, 0.04), omega=(1, 2, -1)),
    "coin": body_at(COIN, (-0.4, 0.06, 0.04), turn=(0.3, 0.5, 0), omega=(5, 2, -1)),
}


# --- What is kept ---------------------------------------------------------------------------------------


def strikes(other: str, contact: Contact = HOW) -> Scene:
    """Return a scene in which a spinning ellipsoid flies at another body off its middle."""
    thrown = body_at(EGG, (0, 0, 0), velocity=(-1.0, 0, 0), omega=(4.0, 5.0, -6.0))
    return scene(thrown, OTHERS[other], contact=contact)


@pytest.mark.parametrize("other", OTHERS)
def test_momenta_and_energy_are_kept(other: str) -> None:
    simulator = full(strikes(other), copies=2, step=1e-4)
    before, energy = momenta(simulator), simulator.measure().balance[0]
    simulator.advance(4000)
    told = simulator.pairs()
    assert told.impulse[0].max() > 0.3
    assert told.friction_loss[0].max() > 2e-3
    np.testing.assert_allclose(momenta(simulator), before, rtol=0, atol=1e-13)
    softer = other in ("block", "capsule")  # where springs ring
    assert simulator.measure().balance[0] == pytest.approx(energy, rel=1e-4 if softer else 1e-6)


def test_energy_does_not_drift_while_an_egg_rocks() -> None:
    """Though the place that touches runs over the skin within each step."""
    egg = ellipsoid((0.12, 0.1, 0.1), 1.0, damping=0.0)
    rocks = body_at(egg, (0, 0, 0.35 + rest_height(G, STRENGTH, REACH)), omega=(0, 6.0, 0))
    contact = Contact(friction=0.0, restitution=1.0, strength=STRENGTH, reach=REACH)
    of = scene(rocks, body_at(BLOCK, (0, 0, 0), pinned=True), contact=contact, gravity=(0, 0, -G))
    simulator, kept, heights = full(of, copies=2, step=7e-4), [], []
    for _ in range(20):
        simulator.advance(100)
        kept.append(simulator.measure().balance[0])
        heights.append(simulator.measure(0).centre[0][2])
    assert np.ptp(heights) > 0.005
    assert np.ptp(kept) < 1e-6
    assert simulator.pairs().least_gap[0, 0] > 0.5 * REACH


@pytest.mark.parametrize("restitution", [1.0, 0.5])
def test_restitution_of_two_ellipsoids(restitution: float) -> None:
    left = body_at(EGG, (-0.31, 0, 0), velocity=(0.5, 0, 0))
    contact = replace(HOW, friction=0.0, restitution=restitution)
    v, w = motion(run(scene(left, body_at(EGG, (0, 0, 0)), contact=contact), 0.2, step=2e-4))
    assert (v[1, 0] - v[0, 0]) / 0.5 == pytest.approx(restitution, abs=0.01)
    np.testing.assert_allclose(w, 0.0, atol=1e-9)


def test_push_off_the_middle_turns_an_ellipsoid() -> None:
    """Without friction, an impulse J along n at the arm r gives I⁻¹ (r × n) J, and the energy gives J.

    With e = 1 the approach u₀ = n · v is reversed: J = 2 u₀/W, W = 1/m + 1/M + (r × n) · I⁻¹ (r × n).
    """
    n = np.array([0.6, 0.8, 0.0])
    semi = np.array([0.15, 0.1, 0.08])
    r = semi**2 * n / np.linalg.norm(semi * n)
    ballast = rolling_ball(0.1, 3.0, damping=0.0)
    struck = body_at(ballast, r + 0.1 * n + 0.01 * n)
    hard = replace(HOW, friction=0.0, strength=1e-6, reach=1e-4)
    egg = body_at(EGG, (0, 0, 0), velocity=0.5 * n)
    v, w = motion(run(scene(egg, struck, contact=hard), 0.04, step=2e-5))
    moment = np.cross(r, n)
    inverse = 1 / 1.0 + 1 / 3.0 + moment @ np.linalg.solve(EGG.inertia(), moment)
    push = 2 * 0.5 / inverse
    np.testing.assert_allclose(w[0], -push * np.linalg.solve(EGG.inertia(), moment), rtol=0, atol=0.02)
    np.testing.assert_allclose(v[0], 0.5 * n - push * n, rtol=0, atol=2e-3)
    assert np.abs(w[0]).max() > 1.0


@pytest.mark.parametrize("other", ["sphere", "ellipsoid", "ball"])
def test_push_without_friction_is_found_in_one_sweep(other: str) -> None:
    """The inverse mass W of a contact says by how much its impulse changes its speed."""
    found = []
    for sweeps in (1, packing.MORE_SWEEPS):
        with mock.patch.object(packing, "MORE_SWEEPS", sweeps):
            simulator = full(strikes(other, replace(HOW, friction=0.0)), copies=2, step=2e-4)
        simulator.advance(1500)
        assert simulator.pairs().impulse[0].max() > 0.3
        found.append(simulator.velocities[0])
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-9)


def test_tip_of_a_fast_bar_is_met_in_time() -> None:
    """How far to look for contacts follows from how fast the skin turns: here up to 0.7 Δ in a step."""
    bar, ends = ellipsoid((0.3, 0.04, 0.04), 1.0, damping=0.0), []
    met = body_at(rolling_ball(0.1, 1.0, damping=0.0), (0.237, 0.2295, 0))
    of = scene(body_at(bar, (0, 0, 0), omega=(0, 0, 40.0)), met, contact=replace(HOW, friction=0.0))
    for step in np.linspace(2e-4, 2.03e-4, 6):
        simulator = full(of, copies=2, step=float(step))
        before = simulator.measure().balance[0]
        simulator.advance(300)
        assert simulator.pairs().impulse[0].max() > 3.0
        ends.append(simulator.measure().balance[0] / before - 1)
    np.testing.assert_allclose(ends, 0.0, atol=1e-4)


def test_flat_one_that_is_past_a_face_amid_a_step_comes_back() -> None:
    """It meets the face that it was in front of when the step began, not one on the far side of the body."""
    hard, block = Contact(friction=0.0, restitution=1.0, strength=1e-6, reach=2e-4), cube(0.05, damping=0.0)
    for share in np.linspace(0.0, 1.0, 9):
        height = 0.0255 + 8.0 * 2e-4 * (5 + share)
        falls = body_at(COIN, (0, 0, height), velocity=(0, 0, -8.0))
        of = scene(falls, body_at(block, (0, 0, 0), pinned=True), contact=hard)
        simulator = full(of, copies=2, step=2e-4)
        simulator.advance(30, check=False)
        assert motion(simulator)[0][0, 2] > 0.5


# --- Compared with others -------------------------------------------------------------------------------


@pytest.mark.slow
def test_ellipsoid_of_equal_axes_moves_as_a_sphere() -> None:
    """On a free block with friction, in as many sweeps; what is left is of second order in the step."""
    sphere_like = rolling_ball(0.1, 1.0, damping=0.0)
    round_one = sphere_like.with_(rounds=(ellipsoid_of((0.1, 0.1, 0.1 * (1 + 1e-8))),))
    assert shape(round_one).ellipsoid
    assert not shape(sphere_like).ellipsoid
    found = []
    for body in (sphere_like, round_one):
        on = body_at(body, (0, 0, 0.354), velocity=(1.0, 0.3, -0.5), omega=(0, 3.0, 9.0))
        with mock.patch.object(packing, "SWEEPS", packing.MORE_SWEEPS):
            simulator = full(scene(on, body_at(BLOCK, (0, 0, 0)), gravity=(0, 0, -2.0)), copies=2, step=2e-4)
        simulator.advance(1000)
        assert simulator.pairs().friction_loss[0].max() > 0.05
        found.append(np.concatenate([simulator.positions[0], simulator.velocities[0]]))
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-5)


def test_egg_rolls_on_a_block_as_on_a_floor() -> None:
    """Surfaces strain the body, other bodies do not: the stiffer it is, the less they differ."""
    egg = ellipsoid((0.12, 0.1, 0.1), 1.0, stiffness=1e6, damping=30.0)
    contact = Contact(friction=0.5, restitution=0.5, strength=STRENGTH, reach=REACH)
    height, found = 0.1 + rest_height(G, STRENGTH, REACH), []
    for on_block in (True, False):
        rolls = body_at(egg, (0, 0, 0.25 * on_block + height), velocity=(0.3, 0, 0), omega=(0, 3.0, 0.5))
        block = body_at(BLOCK, (0, 0, 0) if on_block else (0, 9.0, 2.0), pinned=True)
        far = body_at(BLOCK, (0, 100.0, 1.0), pinned=True)
        bodies, surfaces = (rolls, block, far), () if on_block else (floor(),)
        of = Scene(bodies=bodies, contact=contact, surfaces=surfaces, gravity=(0, 0, -G))
        simulator, ways = full(of, copies=2, step=1e-4), []
        for _ in range(5):
            simulator.advance(1000)
            v, w = motion(simulator)
            ways.append([*simulator.measure(0).centre[0] - (0, 0, 0.25 * on_block), *v[0], *w[0]])
        found.append(np.array(ways))
    assert np.ptp(found[0][:, 2]) > 3e-3  # over its long axis
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=5e-4)


# --- At rest --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("body", "height"), [(disk(0.1, 1.0), 3e-4), (ellipsoid((0.1, 0.1, 0.06)), 0.06)])
def test_laid_on_a_block_it_rests(body: Body, height: float) -> None:
    gap = rest_height(G * body.mass, STRENGTH, REACH)
    contact = Contact(friction=0.5, restitution=0.3, strength=STRENGTH, reach=REACH)
    laid = body_at(body, (0.02, 0.01, 0.25 + height + gap))
    of = scene(laid, body_at(BLOCK, (0, 0, 0), pinned=True), contact=contact, gravity=(0, 0, -G))
    simulator = full(of, copies=2, step=2e-4)
    simulator.advance(5000)
    v, w = motion(simulator)
    np.testing.assert_allclose(v[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(w[0], 0.0, atol=1e-7)
    np.testing.assert_allclose(simulator.measure(0).centre[0], laid.positions.mean(axis=0), atol=1e-6)


def test_coin_falls_flat_and_comes_to_rest() -> None:
    contact = Contact(friction=0.5, restitution=0.3)
    tilted = body_at(disk(0.1, 1.0), (0, 0, 0.25 + 0.033), turn=(0.3, 0, 0))
    of = scene(tilted, body_at(BLOCK, (0, 0, 0), pinned=True), contact=contact, gravity=(0, 0, -G))
    simulator = full(of, copies=2, step=1e-4)
    heights = []
    for _ in range(10):
        simulator.advance(1000)
        heights.append(simulator.measure(0).centre[0][2])
    v, w = motion(simulator)
    assert np.abs(v[0]).max() < 2e-3
    assert abs(w[0, 2]) < 1e-3
    assert simulator.pairs().touching[0, 0]
    assert 0.2503 < min(heights[5:]) < max(heights[5:]) < 0.254
    assert simulator.measure().balance[0] == pytest.approx(G * 0.283, rel=1e-3)


# --- What is told ---------------------------------------------------------------------------------------


def rows_of(body: Body, x: np.ndarray) -> np.ndarray:
    """Return the rows (5, 3) of a body's ellipsoid, from its particles."""
    feature = body.rounds[0]
    arms, middle = body.positions - body.centre, body.masses @ x / body.mass
    first, _, last = np.linalg.svd((x - middle).T @ (body.masses[:, None] * arms))
    turn = first @ last
    squares, axes = np.linalg.eigh(feature.matrix)
    return np.array([middle + turn @ (feature.centre - body.centre), *(turn @ axes).T, np.sqrt(squares)])


@pytest.mark.parametrize("other", ["ellipsoid", "block"])
def test_contacts_are_told_where_both_are_nearest(other: str) -> None:
    simulator = full(strikes(other), copies=2, step=1e-4)
    for _ in range(4000):
        simulator.advance(1)
        found = simulator.contacts()
        if found.there[0].any():
            break
    assert found.there[0].sum() == 1
    x, slices = simulator.positions[0], simulator.scene.slices
    egg = rows_of(EGG, x[slices[0]])
    if other == "ellipsoid":
        met = rows_of(LOPSIDED, x[slices[1]])
        n, told = gaps(ELLIPSOID, egg[None], met[None])
    else:
        faces = x[slices[1]][BLOCK.triangles]
        n, told = gaps(TRIANGLE, np.repeat(egg[None], len(faces), axis=0), faces)
    nearest = int(np.abs(told[:, 0]).argmin())
    gap, normal = told[nearest, 0], n[nearest]
    assert 0 < gap < 1.1 * HOW.reach
    assert found.gap[0, 0] == pytest.approx(gap, abs=1e-6)
    np.testing.assert_allclose(found.normal[0, 0], -normal, atol=1e-6)
    skin = egg[4] * (egg[1:4] @ normal)
    place = egg[0] + (egg[4] * skin / np.linalg.norm(skin)) @ egg[1:4] + 0.5 * gap * normal
    np.testing.assert_allclose(found.point[0, 0], place, atol=1e-6)
    impulse = found.impulse[0, 0]
    assert impulse @ found.normal[0, 0] > 0


@pytest.mark.parametrize("alone", [2, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("other", ["block", "ellipsoid"])
def test_copies_are_those_of_their_own(other: str, alone: int) -> None:
    """A copy moves as it does alone, to the bit, whatever the other copies of its block meet."""
    check_copies(strikes(other), alone)


@pytest.mark.parametrize("other", ["block", "ellipsoid", "ball"])
def test_too_fast_is_told(other: str) -> None:
    fast = body_at(COIN, (0.5, 0.05, 0), velocity=(-60.0, 0, 0))
    of = scene(fast, OTHERS[other], contact=HOW)
    with pytest.raises(UnresolvedContactError, match="'disk'"):
        run(of, 0.03, step=2e-4)
    assert run(of, 0.03, step=2e-4, unresolved="count").unresolved.sum() > 0


@pytest.mark.slow
def test_fallen_asleep_it_wakes() -> None:
    contact = Contact(friction=0.5, restitution=0.2, strength=STRENGTH, reach=REACH)
    egg = ellipsoid((0.1, 0.1, 0.06))
    laid = body_at(egg, (0, 0, 0.25 + 0.06 + rest_height(G, STRENGTH, REACH)))
    falls = body_at(egg, (0.02, 0, 1.2))
    of = scene(laid, body_at(BLOCK, (0, 0, 0), pinned=True), falls, contact=contact, gravity=(0, 0, -G))
    simulator = full(of, copies=2, step=2e-4, sleep=1e-3)
    simulator.advance(1600)
    assert simulator.asleep[0].tolist()[0]
    simulator.advance(800)
    assert not simulator.asleep[0].tolist()[0]
    assert np.abs(motion(simulator)[0][0]).max() > 0.01


# --- Rigid ----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("other", ["sphere", "capsule", "ball", "ellipsoid", "block", "coin"])
def test_rigid_ones_move_alike(other: str) -> None:
    """Momenta and energy are kept, and impulse and loss are those of stiff springs."""
    found = []
    for dynamics in ("rigid", "springs"):
        simulator = full(strikes(other), copies=2, step=1e-4, dynamics=dynamics)
        before, energy = momenta(simulator), simulator.measure().balance[0]
        simulator.advance(4000)
        told = simulator.pairs()
        found.append([told.impulse[0].max(), told.friction_loss[0].max()])
        if dynamics == "rigid":
            np.testing.assert_allclose(momenta(simulator), before, rtol=0, atol=1e-11)
            assert simulator.measure().balance[0] == pytest.approx(energy, rel=1e-5)
    softer = other in ("block", "capsule")  # which springs strain
    np.testing.assert_allclose(found[0], found[1], rtol=0.15 if softer else 5e-3)


@pytest.mark.slow
def test_copies_of_rigid_ones_are_those_of_their_own() -> None:
    of = strikes("ellipsoid")
    places = np.repeat(of.positions[None], 5, axis=0)
    places[:, of.slices[0], 1] += np.linspace(-0.1, 0.5, 5)[:, None]
    batch = full(of, copies=5, step=2e-4, dynamics="rigid")
    batch.place(places, np.repeat(of.velocities[None], 5, axis=0))
    batch.advance(1000)
    one = full(of, copies=2, step=2e-4, dynamics="rigid")
    one.place(places[1], of.velocities)
    one.advance(1000)
    assert one.positions[0].tobytes() == batch.positions[1].tobytes()


# --- Resistance -----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", ["springs", "rigid"])
def test_spin_about_the_normal_stops(dynamics: str) -> None:
    """On its short axis, a lentil is slowed down by the torque τ m g."""
    lentil, spin, tau = ellipsoid((0.1, 0.1, 0.06), 1.0, stiffness=1e6), 4.0, 0.004
    contact = Contact(0.5, 0.5, STRENGTH, REACH, rolling_resistance=0.01, torsional_resistance=tau)
    on = body_at(lentil, (0, 0, 0.25 + 0.06 + rest_height(G, STRENGTH, REACH)), omega=(0, 0, spin))
    of = Scene(bodies=(on, body_at(BLOCK, (0, 0, 0), pinned=True)), contact=contact, gravity=(0, 0, -G))
    simulator = Simulator(of, dynamics=dynamics, step=1e-4)
    stops, turns = spin * lentil.inertia()[2, 2] / (tau * G), []
    for _ in range(20):
        simulator.advance(round(0.07 * stops / 1e-4))
        turns.append(motion(simulator)[1][0, 2])
    times = round(0.07 * stops / 1e-4) * 1e-4 * np.arange(1, 21)
    slows = (times > 0.1 * stops) & (times < 0.9 * stops)
    assert -np.polyfit(times[slows], np.array(turns)[slows], 1)[0] == pytest.approx(spin / stops, rel=5e-3)
    assert abs(turns[-1]) < 1e-4


# --- What is refused ------------------------------------------------------------------------------------


def test_what_others_cannot_meet_is_refused() -> None:
    two = EGG.with_(rounds=(ellipsoid_of((0.1, 0.1, 0.12)), sphere(0.05)))
    partly = EGG.with_(rounds=(ellipsoid_of((0.1, 0.1, 0.12), particles=(0, 1, 2, 4)),))
    for body in (two, partly):
        with pytest.raises(ValueError, match="a single ellipsoid, or two spheres"):
            scene(body_at(body, (0, 0, 0)))
    with pytest.raises(ValueError, match=r"it is round, .* pin all or none"):
        scene(Placed(EGG, pinned=(0,)))


@pytest.mark.parametrize(
    ("body", "place", "deep"),
    [
        (BLOCK, (0.33, 0.0, 0.0), True),
        (cube(2.0), (0.0, 0.0, 0.1), True),
        (BLOCK, (0.4 + 2e-6, 0.0, 0.0), False),
        (EGG, (0.28, 0.0, 0.0), True),
        (rolling_ball(0.1), (0.0, 0.19, 0.0), True),
        (capsule(0.05, 0.3), (0.0, 0.14, 0.0), True),
        (rope(5, 0.8, 0.1, 0.2, radius=0.03), (0.0, 0.0, 0.0), True),
    ],
)
def test_starts_in_each_other_are_refused(body: Body, place: Any, deep: bool) -> None:
    told = "deep in each other" if deep else "only 2e-06 m apart"
    with pytest.raises(ValueError, match=f"{told}, by the skin of 'ellipsoid"):
        scene(body_at(EGG, (0, 0, 0)), body_at(body, place), contact=HOW)
    scene(body_at(EGG, (0, 0, 0)), body_at(body, np.add(place, (0, 1.4, 0))), contact=HOW)


def test_flat_one_under_a_face_is_no_overlap() -> None:
    """The plane of a face cuts a coin that lies beside the face."""
    coin = body_at(COIN, (0.25 + 0.003, 0, 0.2), turn=(0, math.pi / 2, 0))
    scene(coin, body_at(BLOCK, (0, 0, 0)), contact=HOW)
    with pytest.raises(ValueError, match="deep in each other"):
        scene(body_at(COIN, (0.34, 0, 0.2)), body_at(BLOCK, (0, 0, 0)), contact=HOW)


@pytest.mark.parametrize("other", [name for name in OTHERS if name != "coin"])
def test_shown_in_each_other_is_told(other: str) -> None:
    of = strikes(other)
    places = np.repeat(of.positions[None], 2, axis=0)
    places[1, of.slices[0]] += places[1, of.slices[1]].mean(axis=0) - (0, 0.01, 0)
    found = np.zeros((2, len(of.meetings)), bool)
    assert of.tell_ellipsoids(places, found)
    assert found.tolist() == [[False] * 3, [True, False, False]]
    assert not of.tell_ellipsoids(places[:1], found[:1])
