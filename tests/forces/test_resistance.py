"""Test rolling and torsional resistance against closed forms, at rest, and with invalid options."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from springgym import Simulator
from springgym.bodies import ball, cube, rolling_ball
from springgym.measures import Measures
from springgym.scene import Placed, Scene
from springgym.surfaces import Contact, Surface, floor, incline
from springgym.theory import rolling
from tests.forces.test_round import placed

G = 9.81
RADIUS, MOMENT = 0.1, 0.4
RHO, TAU = 0.01, 0.004
"""Coefficients of rolling resistance, ρ, and of torsional resistance, τ [m]."""

HOW = Contact(0.5, 0.5, rolling_resistance=RHO, torsional_resistance=TAU)
BALL = rolling_ball(RADIUS, 1.0, stiffness=1e6)
LEVEL = floor()
STEP = {"springs": 1e-4, "rigid": 1e-3}
SAG = {"springs": 2e-3, "rigid": 1e-6}
"""Share by which a ball's moment and radius may be off: springs give way by m g/(k r) and ring by as much as
the load changes; a rigid ball settles on the floor to rounding."""


each_dynamics = pytest.mark.parametrize(
    "dynamics", [pytest.param("rigid", marks=pytest.mark.slow), "springs"]
)
"""Resistance takes kernels of its own, which slow tests alone compile."""


def run(dynamics: str, duration: float, surface: Surface = LEVEL, **begins: Any) -> tuple[Any, Measures]:
    """Times and measures (T, …) of a ball."""
    scene = placed(BALL, (surface,), HOW, **begins)
    step = STEP[dynamics]
    simulator = Simulator(scene, dynamics=dynamics, step=step)
    every = round(0.01 / step)
    rows = [[np.array(field[0]) for field in simulator.measure()]]
    for _ in range(round(duration / 0.01)):
        simulator.advance(every)
        rows.append([np.array(field[0]) for field in simulator.measure()])
    return 0.01 * np.arange(len(rows)), Measures(*map(np.array, zip(*rows, strict=True)))


def test_ball_rolls_and_spins_ever_slower() -> None:
    """By the coefficients, within a few steps."""
    speed, spin, steps = 0.3, 4.0, 5
    scene = placed(BALL, (LEVEL,), HOW, velocity=(speed, 0, 0), omega=(0, speed / RADIUS, spin))
    simulator = Simulator(scene, dynamics="rigid", step=STEP["rigid"])
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
@each_dynamics
def test_ball_rolls_to_a_stop_and_stays(dynamics: str) -> None:
    """The ledger holds all that it had: it is lost to resistance, and enters as friction."""
    speed = 0.3
    times, m = run(dynamics, 1.0, velocity=(speed, 0, 0), omega=(0, speed / RADIUS, 0))
    way, stops = rolling.resisted_way(speed, MOMENT, RHO, RADIUS, G)
    rolls = (times > 0.05) & (times < stops - 0.05)
    slower = -np.polyfit(times[rolls], m.centre_velocity[rolls, 0], 1)[0]
    assert slower == pytest.approx(speed / stops, rel=SAG[dynamics])
    assert m.centre[-1, 0] - m.centre[0, 0] == pytest.approx(way, rel=5 * SAG[dynamics] + 1e-3)
    still = times > stops + 0.05
    assert np.ptp(m.centre[still, 0]) < 1e-7
    assert m.centre_velocity[:, 0].min() > -1e-3 * speed
    assert np.abs(m.angular_velocity[-1]).max() < 1e-5
    energy = 0.5 * (1 + MOMENT) * speed**2
    assert m.friction_loss[-1] == pytest.approx(energy, rel=SAG[dynamics])
    assert np.ptp(m.balance[1:]) < (1e-12 if dynamics == "rigid" else 1e-4 * energy)


@pytest.mark.slow
@each_dynamics
@pytest.mark.parametrize("ratio", [0.95, 2.0])
def test_slope_holds_a_ball_up_to_the_angle_of_resistance(ratio: float, dynamics: str) -> None:
    angle = math.atan(ratio * RHO / RADIUS)
    times, m = run(dynamics, 0.5, incline(angle))
    down = np.array([-math.cos(angle), 0.0, -math.sin(angle)])
    speed = m.centre_velocity @ down
    expected = rolling.resisted_acceleration(angle, MOMENT, RHO, RADIUS, G)
    assert (expected == 0.0) == (ratio < 1)
    late = times > 0.1
    measured = np.polyfit(times[late], speed[late], 1)[0]
    if ratio < 1:
        assert abs(speed[late]).max() < 1e-5
        assert np.ptp((m.centre @ down)[late]) < 1e-6
    else:
        assert measured == pytest.approx(expected, rel=2 * SAG[dynamics])


@pytest.mark.slow
@each_dynamics
def test_spin_about_the_vertical_stops(dynamics: str) -> None:
    spin = 4.0
    stops = rolling.resisted_spin(spin, MOMENT, TAU, RADIUS, G)
    times, m = run(dynamics, 2 * stops, omega=(0, 0, spin))
    turns = (times > 0.1 * stops) & (times < 0.9 * stops)
    assert -np.polyfit(times[turns], m.angular_velocity[turns, 2], 1)[0] == pytest.approx(
        spin / stops, rel=SAG[dynamics]
    )
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
        _, m = run(dynamics, 0.3, velocity=velocity, omega=omega)
        gone, spin = (m.centre[-1] - m.centre[0])[:2], m.angular_velocity[-1]
        ends.append([gone @ along, gone @ across, spin[:2] @ across, spin[2]])
    assert ends[0] == pytest.approx(ends[1], rel=SAG[dynamics], abs=1e-6)
    assert ends[0][0] > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", ["rigid", "springs"])
def test_copies_are_single_ones_to_the_bit(dynamics: str) -> None:
    scene = placed(BALL, (floor(),), HOW, velocity=(0.3, 0.1, 0), omega=(0, 3.0, 2.0))
    many = Simulator(scene, copies=3, dynamics=dynamics, step=STEP[dynamics])
    v = np.repeat(scene.velocities[None], 3, axis=0)
    v[1] = 0.0
    many.place(np.repeat(scene.positions[None], 3, axis=0), v)
    one = Simulator(scene, dynamics=dynamics, step=STEP[dynamics])
    for simulator in (many, one):
        simulator.advance(round(0.4 / STEP[dynamics]))
    assert many.positions[0].tobytes() == one.positions[0].tobytes() == many.positions[2].tobytes()
    assert many.positions[1].tobytes() != one.positions[0].tobytes()


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
