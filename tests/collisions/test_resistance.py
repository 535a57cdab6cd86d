"""Rolling and torsional resistance between bodies, against closed forms, and with invalid options."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from springgym import Simulator
from springgym.bodies import Body, ball, capsule, rolling_ball, rope
from springgym.collisions import Pair
from springgym.scene import Placed, Scene
from springgym.surfaces import Contact, floor
from springgym.theory import rolling
from springgym.theory.contact import rest_height
from tests.collisions.test_spheres import BLOCK, G, body_at, momenta, motion

RADIUS, MOMENT = 0.1, 0.4
RHO, TAU = 0.01, 0.004
"""Coefficients of rolling resistance, ρ, and of torsional resistance, τ [m]."""

BALL = rolling_ball(RADIUS, 1.0, stiffness=1e6)
STRENGTH, REACH = 2e-4, 2e-3
HOW = Contact(0.5, 0.5, STRENGTH, REACH, rolling_resistance=RHO, torsional_resistance=TAU)
STEP = 1e-4

each_dynamics = pytest.mark.parametrize("dynamics", ["springs", "rigid"])


def lies(angle: float = 0.0, body: Body = BALL, height: float = RADIUS, **begins: Any) -> Scene:
    """Return a scene in which a body lies on a block that is pinned, and turned by an angle about y."""
    up = np.array([math.sin(angle), 0, math.cos(angle)])
    gap = rest_height(G * math.cos(angle), STRENGTH, REACH)
    on = body_at(body, (0.25 + height + gap) * up, **begins)
    block = body_at(BLOCK, (0, 0, 0), pinned=True, turn=(0, angle, 0))
    return Scene(bodies=(on, block), contact=HOW, gravity=(0, 0, -G))


def followed(of: Scene, duration: float, dynamics: str, every: float = 0.01) -> tuple[np.ndarray, ...]:
    """Return times (T,), and v and ω (T, 3) of the first body."""
    simulator = Simulator(of, dynamics=dynamics, step=STEP)
    found = [motion(simulator)]
    for _ in range(round(duration / every)):
        simulator.advance(round(every / STEP))
        found.append(motion(simulator))
    v, w = (np.array([one[0] for one in of]) for of in zip(*found, strict=True))
    return every * np.arange(len(v)), v, w


@pytest.mark.slow
@each_dynamics
def test_ball_rolls_to_a_stop_on_a_block(dynamics: str) -> None:
    speed = 0.2
    _, stops = rolling.resisted_way(speed, MOMENT, RHO, RADIUS, G)
    of = lies(velocity=(speed, 0, 0), omega=(0, speed / RADIUS, 0))
    times, v, w = followed(of, 2 * stops, dynamics)
    rolls = (times > 0.2 * stops) & (times < 0.8 * stops)
    slower = -np.polyfit(times[rolls], v[rolls, 0], 1)[0]
    assert slower == pytest.approx(speed / stops, rel=3e-3)
    assert np.abs(v[-1]).max() < 1e-5
    assert np.abs(w[-1]).max() < 1e-4


@pytest.mark.slow
@each_dynamics
@pytest.mark.parametrize("ratio", [0.95, 2.0])
def test_slope_holds_a_ball_up_to_the_angle_of_resistance(ratio: float, dynamics: str) -> None:
    angle = math.atan(ratio * RHO / RADIUS)
    times, v, _ = followed(lies(angle), 0.4, dynamics)
    speed = v @ np.array([math.cos(angle), 0.0, -math.sin(angle)])
    late = times > 0.1
    if ratio < 1:
        assert np.abs(speed[late]).max() < 2e-5
    else:
        measured = np.polyfit(times[late], speed[late], 1)[0]
        expected = rolling.resisted_acceleration(angle, MOMENT, RHO, RADIUS, G)
        assert measured == pytest.approx(expected, rel=5e-3)


@pytest.mark.slow
@each_dynamics
def test_spin_about_the_normal_stops(dynamics: str) -> None:
    spin = 4.0
    stops = rolling.resisted_spin(spin, MOMENT, TAU, RADIUS, G)
    times, _, w = followed(lies(omega=(0, 0, spin)), 1.5 * stops, dynamics)
    turns = (times > 0.1 * stops) & (times < 0.9 * stops)
    slower = -np.polyfit(times[turns], w[turns, 2], 1)[0]
    assert slower == pytest.approx(spin / stops, rel=3e-3)
    assert np.abs(w[-1]).max() < 1e-4


@pytest.mark.slow
@each_dynamics
@pytest.mark.parametrize("of", ["block", "ball", "capsule"])
def test_momenta_are_kept_and_turning_is_lost(of: str, dynamics: str) -> None:
    """A spinning ball strikes a body off its middle: what the couple takes, the ledger has."""
    others = {
        "block": body_at(BLOCK, (0.40, 0.05, 0.02), turn=(0.1, 0.2, 0.3), omega=(1.0, 2.0, 3.0)),
        "ball": body_at(rolling_ball(0.2, 3.0), (0.31, 0.05, 0.02), omega=(3.0, -2.0, 1.0)),
        "capsule": body_at(capsule(0.1, 0.3), (0.21, 0.05, 0.02), omega=(3.0, -2.0, 1.0)),
    }
    ended = []
    for scale in (1e-9, 1.0):
        contact = Contact(
            0.5, 0.5, 1e-3, 4e-3, rolling_resistance=scale * RHO, torsional_resistance=scale * TAU
        )
        thrown = body_at(BALL, (0, 0, 0), velocity=(1.0, 0, 0), omega=(20.0, 10.0, -10.0))
        far = body_at(BLOCK, (0, 100.0, 0))
        whole = Scene(bodies=(thrown, others[of], far), contact=contact, gravity=(0, 0, 0))
        simulator = Simulator(whole, dynamics=dynamics, step=2e-5)
        before, energy = momenta(simulator), simulator.measure().balance[0]
        simulator.advance(5000)
        assert simulator.pairs().impulse[0].max() > 0.3
        np.testing.assert_allclose(momenta(simulator), before, rtol=0, atol=1e-11)
        assert simulator.measure().balance[0] == pytest.approx(energy, rel=1e-3)
        ended.append((simulator.pairs().friction_loss[0].sum(), motion(simulator)[1][0]))
    assert ended[1][0] > 1.001 * ended[0][0]
    assert np.abs(ended[1][1] - ended[0][1]).max() > 0.1


@pytest.mark.slow
def test_copies_are_those_of_their_own() -> None:
    of = lies(velocity=(0.1, 0.05, 0), omega=(0, 1.0, 2.0))
    many = Simulator(of, copies=3, step=STEP)
    v = np.repeat(of.velocities[None], 3, axis=0)
    v[1] = 0.0
    many.place(np.repeat(of.positions[None], 3, axis=0), v)
    one = Simulator(of, step=STEP)
    for simulator in (many, one):
        simulator.advance(2000)
    assert many.positions[0].tobytes() == one.positions[0].tobytes() == many.positions[2].tobytes()
    assert many.positions[1].tobytes() != one.positions[0].tobytes()


# --- What is refused ------------------------------------------------------------------------------------


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
        Scene(bodies=(body_at(BALL, (0, 0, 0)), away), contact=HOW)


def test_resistance_without_effect_is_refused() -> None:
    ice = Contact(0.0, 0.5, STRENGTH, REACH, rolling_resistance=RHO)
    with pytest.raises(ValueError, match="no friction"):
        Scene(bodies=(body_at(BALL, (0, 0, 0)), body_at(BLOCK, (1, 0, 0))), contact=ice)
    blocks = body_at(BLOCK, (0, 0, 0)), body_at(BLOCK, (1, 0, 0))
    with pytest.raises(ValueError, match="no round feature meets another body"):
        Scene(bodies=blocks, contact=HOW)
    with pytest.raises(ValueError, match="no round feature meets another body"):
        Scene(bodies=(body_at(BALL, (0, 0, 0)), body_at(BALL, (1, 0, 0))), contact=HOW, collisions=None)
    for collisions in (HOW, (Pair(0, 1, HOW),)):
        with pytest.raises(
            ValueError, match=r"a contact in collisions has rolling_resistance 0\.01, .*; none"
        ):
            Scene(bodies=blocks, collisions=collisions)
    on_floor = {"surfaces": (floor(-1.0),), "contact": replace(HOW, friction=0.4)}
    three = (*blocks, body_at(BALL, (2, 0, 0)))
    with pytest.raises(ValueError, match="a contact in collisions has"):
        Scene(bodies=three, collisions=(Pair(0, 1, HOW), Pair(1, 2, Contact(0.5))), **on_floor)
    shared = Scene(bodies=three, collisions=(Pair(0, 1, HOW), Pair(1, 2, replace(HOW))), **on_floor)
    assert shared.resisted.tolist() == [False, True]


def test_only_pairs_of_what_is_round_resist() -> None:
    three = body_at(BALL, (0, 0, 0)), body_at(BLOCK, (1, 0, 0)), body_at(BLOCK, (2, 0, 0))
    of = Scene(bodies=three, contact=HOW)
    assert of.resisted.tolist() == [True, True, False]
    smooth = Contact(0.5, 0.5, STRENGTH, REACH)
    some = of.with_(collisions=(Pair(0, 1), Pair(0, 2, smooth)))
    assert some.resisted.tolist() == [True, False]
