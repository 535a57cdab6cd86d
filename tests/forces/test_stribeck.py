"""Stribeck's friction against theory: what slides, what sticks, and the energy that is lost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from springgym.bodies import box, cube, rolling_ball
from springgym.scene import Placed, Scene
from springgym.simulator import Simulator
from springgym.surfaces import Contact, floor, incline
from tests.forces.test_contact import G, at_rest_height, beads, contact, state

STATIC, KINETIC, SLOW = 0.6, 0.3, 0.1
"""μ_s, μ_k [1] and v_s [m/s]."""

FALLS: Any = {"friction": STATIC, "kinetic": KINETIC, "stribeck": SLOW}
SPEED, TIME = 0.5, 0.1
"""The speed at which bodies begin to slide [m/s], and when they are looked at [s]: at some .1 m/s."""


def mu(slip: Any) -> Any:
    return KINETIC + (STATIC - KINETIC) / (1 + (slip / SLOW) ** 2)


def elapsed(speed: float) -> float:
    """Time in which friction alone stops what slides on level ground [s], by ∫ dv/(g μ(v)).

    With u = v/v_s, 1/μ = (1 + u²)/(μ_s + μ_k u²) has the integral
    u/μ_k + (1 − μ_s/μ_k) atan(u √(μ_k/μ_s))/√(μ_s μ_k).
    """
    u, ratio = speed / SLOW, KINETIC / STATIC
    bent = math.atan(u * math.sqrt(ratio)) / math.sqrt(STATIC * KINETIC)
    return SLOW / G * (u / KINETIC + (1 - 1 / ratio) * bent)


def speed_after(time: float) -> float:
    return float(brentq(lambda v: elapsed(SPEED) - elapsed(v) - time, 0.0, SPEED, xtol=1e-15))


def sliding(how: Contact, step: float) -> Simulator:
    simulator = beads([[0, 0, at_rest_height(G)]], [[SPEED, 0, 0]], how, step=step)
    simulator.advance(round(TIME / step))
    return simulator


def test_what_slides_slows_down_by_the_curve() -> None:
    """To second order: half of the step makes a fourth of the error; Coulomb's friction is far off."""
    expected = speed_after(TIME)
    assert 0.05 < expected < 0.25
    errors = []
    for step in (2e-3, 1e-3):
        _, v = state(sliding(contact(**FALLS), step))
        errors.append(v[0, 0] - expected)
    assert 3.5 < errors[0] / errors[1] < 4.5
    # a step changes μ by less than g μ_s h (μ_s − μ_k)/v_s; of second order, its share is that squared
    share = G * STATIC * 1e-3 * (STATIC - KINETIC) / SLOW
    assert abs(errors[1]) < share**2 * G * STATIC * TIME
    for coulomb in (STATIC, KINETIC):
        _, v = state(sliding(contact(friction=coulomb), 1e-3))
        assert abs(v[0, 0] - expected) > 0.02


def test_all_that_friction_takes_is_in_the_ledger() -> None:
    simulator = sliding(contact(**FALLS), 1e-3)
    assert 0.05 < state(simulator)[1][0, 0] < SPEED
    simulator.advance(round(2 * elapsed(SPEED) / 1e-3))
    assert np.abs(state(simulator)[1][0]).max() < 1e-12
    assert simulator.measure().friction_loss[0] == pytest.approx(0.5 * SPEED**2, rel=1e-9)


@pytest.mark.parametrize("degrees", [-0.1, 2.0])
def test_a_slope_holds_up_to_the_static_angle(degrees: float) -> None:
    """A tenth of a degree below it nothing creeps; above it all slides as the ODE says, ever faster."""
    angle = math.atan(STATIC) + math.radians(degrees)
    slope = incline(angle)
    start = at_rest_height(G * math.cos(angle)) * np.asarray(slope.normal)
    simulator = beads([start], [[0, 0, 0]], contact(**FALLS), (slope,))
    simulator.advance(500)
    x, v = state(simulator)
    if degrees < 0:
        assert np.abs(x[0] - start).max() < 1e-12
        assert np.abs(v[0]).max() < 1e-12
    else:
        motion = solve_ivp(
            lambda _, u: G * (math.sin(angle) - mu(u) * math.cos(angle)), (0, 0.5), [0.0], rtol=1e-10
        )
        final = float(motion.y[0, -1])
        assert final > 5 * SLOW
        assert np.linalg.norm(v[0]) == pytest.approx(final, rel=5e-3)


def test_a_curve_that_does_not_fall_is_coulombs_to_the_bit() -> None:
    flat = sliding(contact(friction=STATIC, kinetic=STATIC, stribeck=SLOW), 1e-3)
    coulomb = sliding(contact(friction=STATIC), 1e-3)
    for of, as_of in zip(state(flat), state(coulomb), strict=True):
        assert (of == as_of).all()
    assert state(flat)[0][0, 0] > 0.01


def test_contact_refuses_what_makes_no_sense() -> None:
    for wrong, says in [
        ({"kinetic": 0.2}, "given together"),
        ({"stribeck": 0.1}, "given together"),
        ({"kinetic": 0.7, "stribeck": 0.1}, "kinetic of the contact is 0.7; it must be at most the friction"),
        ({"kinetic": -0.1, "stribeck": 0.1}, "kinetic of the contact"),
        ({"kinetic": 0.2, "stribeck": 0.0}, "stribeck of the contact"),
        ({"kinetic": math.nan, "stribeck": 0.1}, "kinetic of the contact"),
        ({"friction": 0.0, "kinetic": 0.0, "stribeck": 0.1}, "must be positive"),
    ]:
        with pytest.raises(ValueError, match=says):
            Contact(**{"friction": STATIC, **wrong})
    with pytest.raises(TypeError, match="kinetic of the contact"):
        Contact(STATIC, kinetic="low", stribeck=0.1)  # type: ignore[arg-type]


# --- Of bodies ----------------------------------------------------------------------------------------


def resting(under: str) -> Scene:
    """A cube a little above a floor, or above a slab that is pinned."""
    body, how = cube(stiffness=1e5, damping=100.0), contact(**FALLS, restitution=0.0)
    above = body.positions - [0, 0, body.positions[:, 2].min() - at_rest_height(G)]
    if under == "floor":
        return Scene(body, above, surfaces=(floor(),), contact=how)
    slab = box((6.0, 4.0, 0.5), 1000.0)
    below = Placed(slab, slab.positions - [0, 0, slab.positions[:, 2].max()], pinned=tuple(range(8)))
    return Scene(bodies=(below, Placed(body, above)), contact=how)


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", ["springs", "rigid"])
@pytest.mark.parametrize("under", ["floor", "slab"])
def test_bodies_slide_by_the_curve(under: str, dynamics: str) -> None:
    """On all of its corners, which slip alike and carry its weight together."""
    simulator = Simulator(resting(under), dynamics=dynamics)
    simulator.advance(round(1.0 / simulator.step))
    own = simulator.scene.slices[-1]
    v = np.array(simulator.velocities)
    assert np.abs(v).max() < 1e-3
    v[:, own] += [SPEED, 0, 0]
    simulator.place(simulator.positions, v)
    simulator.advance(round(TIME / simulator.step))
    reached = round(TIME / simulator.step) * simulator.step
    assert simulator.velocities[0, own, 0].mean() == pytest.approx(speed_after(reached), abs=5e-3)


@pytest.mark.slow
def test_a_ball_skids_by_the_curve() -> None:
    """Friction slows what slips, v − ω R, by 7/2 of what it slows v by, as 1 + M R²/I is 7/2."""
    body, how = rolling_ball(0.2), contact(**FALLS, restitution=0.0)
    up = at_rest_height(body.mass * G)
    above = body.positions - body.centre + [0, 0, 0.2 + up]
    moving = np.tile([SPEED, 0, 0], (len(above), 1))
    simulator = Simulator(Scene(body, above, moving, surfaces=(floor(),), contact=how))
    time = 2 / 7 * TIME
    steps = round(time / simulator.step)
    simulator.advance(steps)
    slip = speed_after(3.5 * steps * simulator.step)
    speed = simulator.measure().centre_velocity[0, 0]
    assert speed == pytest.approx(SPEED - 2 / 7 * (SPEED - slip), abs=1e-3)
    assert speed < SPEED - 0.05
