"""Rolling and torsional resistance, on floors and between bodies: closed forms, rest, invalid options."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from springgym import Simulator
from springgym.bodies import ball, capsule, cube, rolling_ball, rope
from springgym.collisions import Pair
from springgym.measures import Measures
from springgym.scene import Placed, Scene
from springgym.surfaces import Contact, floor, incline
from springgym.theory import rolling
from springgym.theory.contact import rest_height
from tests.collisions.test_spheres import BLOCK, body_at, momenta, motion
from tests.copies import check_alone
from tests.forces.test_round import placed

G = 9.81
RADIUS, MOMENT = 0.1, 0.4
RHO, TAU = 0.01, 0.004
"""Coefficients of rolling resistance, ρ, and of torsional resistance, τ [m]."""

HOW = Contact(0.5, 0.5, rolling_resistance=RHO, torsional_resistance=TAU)
STRENGTH, REACH = 2e-4, 2e-3
BETWEEN = replace(HOW, strength=STRENGTH, reach=REACH)
BALL = rolling_ball(RADIUS, 1.0, stiffness=1e6)
KINDS = {
    ("floor", "springs"): (1e-4, 2e-3),
    ("floor", "rigid"): (1e-3, 1e-6),
    ("block", "springs"): (1e-4, 3e-3),
    ("block", "rigid"): (1e-4, 3e-3),
}
"""What a ball rolls on, and how it moves: the step [s], and the share by which its moment and radius may be
off. Springs give way by m g/(k r) and ring by as much as the load changes; a rigid ball settles on the floor
to rounding."""

each_kind = pytest.mark.parametrize(("on", "dynamics"), KINDS)
each_dynamics = pytest.mark.parametrize("dynamics", ["springs", "rigid"])


def lies(on: str, angle: float = 0.0, **begins: Any) -> Scene:
    """Return a scene in which a ball lies on a floor or a pinned block, which rises towards x by an angle."""
    if on == "floor":
        return placed(BALL, (incline(angle),), HOW, **begins)
    up = np.array([-math.sin(angle), 0, math.cos(angle)])
    gap = rest_height(G * math.cos(angle), STRENGTH, REACH)
    block = body_at(BLOCK, (0, 0, 0), pinned=True, turn=(0, -angle, 0))
    bodies = (body_at(BALL, (0.25 + RADIUS + gap) * up, **begins), block)
    return Scene(bodies=bodies, contact=BETWEEN, gravity=(0, 0, -G))


def run(on: str, dynamics: str, duration: float, angle: float = 0.0, **begins: Any) -> tuple[Any, Measures]:
    """Times and measures (T, …) of the ball."""
    simulator = Simulator(lies(on, angle, **begins), dynamics=dynamics, step=KINDS[on, dynamics][0])
    of = () if on == "floor" else (0,)
    rows = [[np.array(field[0]) for field in simulator.measure(*of)]]
    for _ in range(round(duration / 0.01)):
        simulator.advance(round(0.01 / simulator.step))
        rows.append([np.array(field[0]) for field in simulator.measure(*of)])
    return 0.01 * np.arange(len(rows)), Measures(*map(np.array, zip(*rows, strict=True)))


def test_ball_rolls_and_spins_ever_slower() -> None:
    """By the coefficients, within a few steps."""
    speed, spin, steps = 0.3, 4.0, 5
    scene = lies("floor", velocity=(speed, 0, 0), omega=(0, speed / RADIUS, spin))
    simulator = Simulator(scene, dynamics="rigid", step=1e-3)
    seen = []
    for _ in range(2):
        simulator.advance(steps)
        m = simulator.measure()
        seen.append([m.centre_velocity[0, 0], m.angular_velocity[0, 2]])
    rolls = speed / rolling.resisted_way(speed, MOMENT, RHO, RADIUS, G)[1]
    turns = spin / rolling.resisted_spin(spin, MOMENT, TAU, RADIUS, G)
    slower = -np.diff(seen, axis=0)[0] / (steps * simulator.step)
    assert slower == pytest.approx([rolls, turns], rel=1e-2)


@pytest.mark.slow
@each_kind
def test_ball_rolls_to_a_stop_and_stays(on: str, dynamics: str) -> None:
    """On a floor the ledger holds all that it had: it is lost to resistance, and enters as friction."""
    speed, off = 0.3, KINDS[on, dynamics][1]
    times, m = run(on, dynamics, 1.0, velocity=(speed, 0, 0), omega=(0, speed / RADIUS, 0))
    way, stops = rolling.resisted_way(speed, MOMENT, RHO, RADIUS, G)
    rolls = (times > 0.05) & (times < stops - 0.05)
    slower = -np.polyfit(times[rolls], m.centre_velocity[rolls, 0], 1)[0]
    assert slower == pytest.approx(speed / stops, rel=off)
    assert m.centre[-1, 0] - m.centre[0, 0] == pytest.approx(way, rel=5 * off + 1e-3)
    still = times > stops + 0.05
    assert np.ptp(m.centre[still, 0]) < 1e-7
    assert m.centre_velocity[:, 0].min() > -1e-3 * speed
    assert np.abs(m.angular_velocity[-1]).max() < 1e-5
    if on == "floor":
        energy = 0.5 * (1 + MOMENT) * speed**2
        assert m.friction_loss[-1] == pytest.approx(energy, rel=off)
        assert np.ptp(m.balance[1:]) < (1e-12 if dynamics == "rigid" else 1e-4 * energy)


@pytest.mark.slow
@each_kind
@pytest.mark.parametrize("ratio", [0.95, 2.0])
def test_slope_holds_a_ball_up_to_the_angle_of_resistance(ratio: float, on: str, dynamics: str) -> None:
    angle = math.atan(ratio * RHO / RADIUS)
    times, m = run(on, dynamics, 0.5, angle)
    down = np.array([-math.cos(angle), 0.0, -math.sin(angle)])
    speed, late = m.centre_velocity @ down, times > 0.1
    expected = rolling.resisted_acceleration(angle, MOMENT, RHO, RADIUS, G)
    assert (expected == 0.0) == (ratio < 1)
    if ratio < 1:
        assert abs(speed[late]).max() < 1e-5
        assert np.ptp((m.centre @ down)[late]) < 1e-6
    else:
        measured = np.polyfit(times[late], speed[late], 1)[0]
        assert measured == pytest.approx(expected, rel=min(2 * KINDS[on, dynamics][1], 5e-3))


@pytest.mark.slow
@each_kind
def test_spin_about_the_normal_stops(on: str, dynamics: str) -> None:
    spin = 4.0
    stops = rolling.resisted_spin(spin, MOMENT, TAU, RADIUS, G)
    times, m = run(on, dynamics, 2 * stops, omega=(0, 0, spin))
    turns = (times > 0.1 * stops) & (times < 0.9 * stops)
    slower = -np.polyfit(times[turns], m.angular_velocity[turns, 2], 1)[0]
    assert slower == pytest.approx(spin / stops, rel=KINDS[on, dynamics][1])
    assert np.abs(m.angular_velocity[-1]).max() < 1e-5


@pytest.mark.slow
@each_dynamics
def test_the_direction_in_which_it_rolls_does_not_matter(dynamics: str) -> None:
    """A sphere of a few particles is alike in a few directions alone: there is more than rounding."""
    ends = []
    for angle in (0.0, 1.0):
        along, across = (
            np.array([math.cos(angle), math.sin(angle)]),
            np.array([-math.sin(angle), math.cos(angle)]),
        )
        velocity, omega = (*(0.3 * along), 0.0), (*(3.0 * across), 2.0)
        _, m = run("floor", dynamics, 0.3, velocity=velocity, omega=omega)
        gone, spin = (m.centre[-1] - m.centre[0])[:2], m.angular_velocity[-1]
        ends.append([gone @ along, gone @ across, spin[:2] @ across, spin[2]])
    assert ends[0] == pytest.approx(ends[1], rel=KINDS["floor", dynamics][1], abs=1e-6)
    assert ends[0][0] > 0.05


@pytest.mark.slow
@each_kind
def test_copies_are_single_ones_to_the_bit(on: str, dynamics: str) -> None:
    scene, step = lies(on, velocity=(0.3, 0.1, 0), omega=(0, 3.0, 2.0)), KINDS[on, dynamics][0]
    x, v = (np.repeat(each[None], 3, axis=0) for each in (scene.positions, scene.velocities))
    v[1] = 0.0
    check_alone(
        lambda copies: Simulator(scene, copies=copies, dynamics=dynamics, step=step),
        x,
        v,
        [round(0.4 / step)],
        (0, 1, 2),
    )


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
    scene = placed(BALL, (floor(),), HOW)
    assert pickle.loads(pickle.dumps(scene)).contact == HOW
    assert f"rolling_resistance={RHO}" in repr(HOW)
    assert scene.identity != placed(BALL, (floor(),), replace(HOW, rolling_resistance=0.02)).identity
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
    with pytest.raises(ValueError, match="no round feature meets another body"):
        Scene(bodies=blocks, contact=BETWEEN)
    with pytest.raises(ValueError, match="no round feature meets another body"):
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
