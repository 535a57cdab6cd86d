"""Rolling and torsional resistance: closed forms, rest, what is kept, and invalid options."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from springgym.model.bodies import ball, cube, rolling_ball, rope
from springgym.model.collisions import Pair
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Contact, floor
from springgym.theory import rolling
from springgym.theory.contact import rest_height
from tests.collisions.movers import REACH, STRENGTH, G, world
from tests.collisions.test_matrix import SHARE, SOFT, cells, kept, thrown

RADIUS = 0.1
MOMENT = SHARE["ball"]
RHO, TAU = 0.01, 0.004
"""Coefficients of rolling resistance, ρ, and of torsional resistance, τ [m]."""

HOW = Contact(0.5, 0.5, rolling_resistance=RHO, torsional_resistance=TAU)
BETWEEN = replace(HOW, strength=STRENGTH, reach=REACH)
BALL = rolling_ball(RADIUS, 1.0, stiffness=1e6)
BLOCK = cube(0.5, damping=0.0)
OFF = 1e-5
"""Measured: 5e-6 at most, of a ball of springs on a floor, which settles; 2e-6 on a block."""


def arm_on(on: str, angle: float = 0.0) -> tuple[float, float]:
    """The arm r [m] of what pushes the ball, and I/(m r²): on a block, it acts halfway across the gap."""
    gap = rest_height(G * math.cos(angle), STRENGTH, REACH) if on == "block" else 0.0
    return RADIUS + gap / 2, MOMENT / (1 + gap / (2 * RADIUS)) ** 2


def body_at(of: Any, position: Any, pinned: tuple[int, ...] = ()) -> Placed:
    return Placed(of, of.positions + np.asarray(position, float), pinned=pinned)


@cells(("ball",), ("floor", "block"), "ball-floor-springs")
def test_what_rolls_and_what_spins_stops_and_stays(mover: str, on: str, dynamics: str) -> None:
    """One rolls along x, one aslant, and one spins about the normal."""
    speed = 0.3
    spin = 4.0
    aslant = np.array([math.cos(1.0), math.sin(1.0), 0.0])
    arm, moment = arm_on(on)
    way, rolls = rolling.resisted_way(speed, moment, RHO, arm, G)
    spins = rolling.resisted_spin(spin, MOMENT, TAU, RADIUS, G)
    w = world(BALL, on, BETWEEN, dynamics=dynamics, step=1e-4, copies=3, tilt=0.0)
    velocities = speed * np.array([(1.0, 0, 0), aslant, (0, 0, 0)])
    turns = np.array([(0, speed / arm, 0), np.cross((0, 0, speed / arm), aslant), (0, 0, spin)])
    w.place(velocities=velocities, spins=turns)
    start = w.centre()
    before = w.simulator.measure().balance
    seen = []
    for _ in range(2):
        w.simulator.advance(1500)
        rolled = np.linalg.norm(w.velocity()[:2], axis=1)
        seen.append([*rolled, w.spin()[2, 2]])
    slower = [speed / rolls, speed / rolls, spin / spins]
    np.testing.assert_allclose((seen[0] - np.array(seen[1])) / 0.15, slower, rtol=OFF)
    w.simulator.advance(2000)
    ends = w.centre()
    w.simulator.advance(1000)
    m = w.simulator.measure()
    np.testing.assert_allclose((ends - start)[:, :2] / way, [(1, 0), aslant[:2], (0, 0)], atol=5 * OFF)
    np.testing.assert_allclose(w.centre(), ends, rtol=0, atol=1e-7)
    np.testing.assert_allclose(w.spin(), 0.0, atol=1e-5)
    had = 0.5 * (1 + moment) * speed**2, 0.5 * (1 + moment) * speed**2, 0.5 * MOMENT * RADIUS**2 * spin**2
    np.testing.assert_allclose(m.friction_loss, had, rtol=2 * OFF)
    np.testing.assert_allclose(m.balance, before, rtol=0, atol=1e-4 * had[0])


@cells(("ball",), ("floor", "ramp", "block"))
@pytest.mark.parametrize("ratio", [0.95, 2.0])
def test_slope_holds_a_ball_up_to_the_angle_of_resistance(
    mover: str, on: str, dynamics: str, ratio: float
) -> None:
    angle = math.atan(ratio * RHO / RADIUS)
    arm, moment = arm_on(on, angle)
    w = world(BALL, on, BETWEEN, dynamics=dynamics, step=1e-4, tilt=angle)
    w.simulator.advance(1000)
    place = w.centre()
    speed = w.velocity()[:, 0]
    w.simulator.advance(4000)
    expected = rolling.resisted_acceleration(angle, moment, RHO, arm, G)
    assert (expected == 0.0) == (ratio < 1)
    np.testing.assert_allclose((w.velocity()[:, 0] - speed) / 0.4, expected, rtol=2 * OFF, atol=2e-5)
    if ratio < 1:
        np.testing.assert_allclose(w.centre(), place, rtol=0, atol=1e-6)


@cells(("ball", "capsule"), ("mate",))
def test_momenta_are_kept_and_turning_is_lost(mover: str, on: str, dynamics: str) -> None:
    """What the couple takes, the ledger has."""
    ended = []
    for scale in (1e-9, 1.0):
        how = Contact(0.5, 0.5, **SOFT, rolling_resistance=scale * RHO, torsional_resistance=scale * TAU)
        simulator = thrown(mover, on, dynamics, how, 1e-4, 1e6).simulator
        first = simulator.measure()
        energy = kept(simulator)
        simulator.advance(4000)
        last = simulator.measure()
        np.testing.assert_allclose(last.momentum, first.momentum, rtol=0, atol=1e-11)
        np.testing.assert_allclose(last.angular_momentum, first.angular_momentum, rtol=0, atol=1e-11)
        np.testing.assert_allclose(kept(simulator), energy, rtol=1e-3)
        ended.append(last.friction_loss)
    assert np.median(ended[1] / ended[0]) > 1.001


# --- What makes no sense ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rolling_resistance", "torsional_resistance"])
def test_what_makes_no_sense_is_refused(name: str) -> None:
    for wrong in (-1e-3, math.nan, math.inf):
        with pytest.raises(ValueError, match=f"{name} of the contact"):
            Contact(**{name: wrong})
    for kind in (True, "much", [1e-3], None):
        with pytest.raises(TypeError, match=f"{name} of the contact"):
            Contact(**{name: kind})  # type: ignore[arg-type]
    how = Contact(0.5, strength=1e-4, reach=1e-3, **{name: 1e-3})
    with pytest.raises(ValueError, match="the scene has no surfaces"):
        Scene(BALL, contact=how)
    for body in (cube(), ball()):
        with pytest.raises(ValueError, match="no body has one"):
            Scene(body, body.positions + np.array([0, 0, 2.0]), surfaces=(floor(),), contact=how)


def test_options_are_kept_and_tell_scenes_apart() -> None:
    scene = Scene(BALL, np.add(BALL.positions, (0, 0, 1)), surfaces=(floor(),), contact=HOW)
    assert pickle.loads(pickle.dumps(scene)).contact == HOW
    assert f"rolling_resistance={RHO}" in repr(HOW)
    assert scene.identity != scene.with_(contact=replace(HOW, rolling_resistance=0.02)).identity
    box = cube(stiffness=1e5)
    bodies = (
        Placed(BALL, BALL.positions + np.array([0, 0, 1.0])),
        Placed(box, box.positions + np.array([5.0, 0, 2.0])),
    )
    mixed = Scene(bodies=bodies, surfaces=(floor(),), contact=HOW, collisions=None)
    assert [isinstance(part.contact, Contact) and part.contact.resists for part in mixed.parts] == [
        True,
        False,
    ]


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        (Placed(ball(), pinned=()), "too few particles"),
        (Placed(rope(3, 1.0, radius=0.02), pinned=()), "floppy"),
        (Placed(BLOCK, pinned=(0,)), "pin all or none"),
    ],
)
def test_bodies_that_no_couple_can_turn_are_refused(other: Placed, reason: str) -> None:
    away = Placed(other.body, other.body.positions + np.array([5.0, 0, 0]), pinned=other.pinned)
    with pytest.raises(ValueError, match=reason):
        Scene(bodies=(body_at(BALL, (0, 0, 0)), away), contact=BETWEEN)


def test_resistance_without_effect_is_refused() -> None:
    ice = Contact(0.0, 0.5, STRENGTH, REACH, rolling_resistance=RHO)
    with pytest.raises(ValueError, match="no friction"):
        Scene(bodies=(body_at(BALL, (0, 0, 0)), body_at(BLOCK, (1, 0, 0))), contact=ice)
    blocks = body_at(BLOCK, (0, 0, 0)), body_at(BLOCK, (1, 0, 0))
    with pytest.raises(ValueError, match="no round feature touches another body"):
        Scene(bodies=blocks, contact=BETWEEN)
    with pytest.raises(ValueError, match="no round feature touches another body"):
        Scene(bodies=(body_at(BALL, (0, 0, 0)), body_at(BALL, (1, 0, 0))), contact=BETWEEN, collisions=None)
    for collisions in (BETWEEN, (Pair(0, 1, BETWEEN),)):
        with pytest.raises(
            ValueError, match=r"a contact in collisions has rolling_resistance 0\.01, .*; none"
        ):
            Scene(bodies=blocks, collisions=collisions)
    on_floor = {"surfaces": (floor(-1.0),), "contact": replace(BETWEEN, friction=0.4)}
    three = (*blocks, body_at(BALL, (2, 0, 0)))
    with pytest.raises(ValueError, match="a contact in collisions has"):
        Scene(bodies=three, collisions=(Pair(0, 1, BETWEEN), Pair(1, 2, Contact(0.5))), **on_floor)
    shared = Scene(bodies=three, collisions=(Pair(0, 1, BETWEEN), Pair(1, 2, replace(BETWEEN))), **on_floor)
    assert shared.resisted.tolist() == [False, True]


def test_only_pairs_of_what_is_round_resist() -> None:
    three = body_at(BALL, (0, 0, 0)), body_at(BLOCK, (1, 0, 0)), body_at(BLOCK, (2, 0, 0))
    of = Scene(bodies=three, contact=BETWEEN)
    assert of.resisted.tolist() == [True, True, False]
    smooth = Contact(0.5, 0.5, STRENGTH, REACH)
    some = of.with_(collisions=(Pair(0, 1), Pair(0, 2, smooth)))
    assert some.resisted.tolist() == [True, False]
