import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from springgym.theory import contact

C = 0.05
REACH = 0.02
MASS = 1.3
G = 9.81
WEIGHT = MASS * G
INSIDE = contact.energy(0.005, C, REACH)


def fly(height, speed, until, weight):
    """Height and speed at the first event `until(h, v)` of a particle over the floor."""

    def slope(_, y):
        return [y[1], (contact.force(y[0], C, REACH) - weight) / MASS]

    def event(_, y):
        return until(*y)

    event.terminal = True
    event.direction = 1
    # a step of 1 ms falls 4 mm from 0.8 m: it cannot jump across the floor's reach
    how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "max_step": 1e-3}
    run = solve_ivp(slope, (0, 5), [height, speed], events=event, **how)
    assert run.status == 1
    return run.y[:, -1]


def test_force_is_minus_the_slope_of_the_energy():
    h = np.array([0.003, 0.007, 0.015, 0.0199])
    step = 1e-7
    slope = (contact.energy(h + step, C, REACH) - contact.energy(h - step, C, REACH)) / (2 * step)
    force = contact.force(h, C, REACH)
    # step^2 U'''/6 = step^2 c/h^4 = 6e-6 N at the lowest, round-off eps U / step = 1e-7 N
    assert force == pytest.approx(-slope, abs=1e-5)
    assert force.max() > 1000
    assert force == pytest.approx(C / h**2 - C / REACH**2, rel=1e-14)


def test_floor_ends_at_its_reach():
    assert np.all(contact.force([REACH, 0.03, 5.0], C, REACH) == 0)
    assert np.all(contact.energy([REACH, 0.03, 5.0], C, REACH) == 0)


def test_rest_height_balances_the_weight():
    height = contact.rest_height(WEIGHT, C, REACH)
    assert contact.force(height, C, REACH) == pytest.approx(WEIGHT, rel=1e-12)
    assert 0 < height < REACH
    least = float(contact.energy(height, C, REACH)) + WEIGHT * height
    assert contact.turning_point(least * (1 + 1e-12), C, REACH, WEIGHT) == pytest.approx(height, rel=1e-5)
    with pytest.raises(ValueError, match=r"below .* the energy of rest"):
        contact.turning_point(least * (1 - 1e-9), C, REACH, WEIGHT)
    with pytest.raises(ValueError, match="the energy of rest"):
        contact.turning_point(-1e3 * C / REACH, C, REACH, WEIGHT)  # where the discriminant is positive again


@pytest.mark.parametrize("speed", [0.1, 2.0, 20.0])
def test_turning_point_without_weight(speed):
    energy = MASS * speed**2 / 2
    height = contact.turning_point(energy, C, REACH)
    assert contact.energy(height, C, REACH) == pytest.approx(energy, rel=1e-12)
    s = energy * REACH / C
    form = 1 + s / 2 - math.sqrt(s + s**2 / 4)
    # the printed form cancels: eps s against 1/s
    assert height / REACH == pytest.approx(form, rel=1e-15 * (10 + s**2))
    lowest, _ = fly(REACH, -speed, lambda _, v: v, weight=0.0)
    assert height == pytest.approx(lowest, rel=1e-9)


@pytest.mark.parametrize("start", [0.8, 0.021, 0.0195])
def test_drop_turns_and_returns_to_its_apex(start):
    energy = float(contact.energy(start, C, REACH)) + WEIGHT * start
    lowest, _ = fly(start, 0.0, lambda _, v: v + 1e-300, weight=WEIGHT)
    height = contact.turning_point(energy, C, REACH, WEIGHT)
    assert height == pytest.approx(lowest, rel=1e-8)
    assert height < contact.rest_height(WEIGHT, C, REACH)
    assert contact.apex(energy, C, REACH, WEIGHT) == pytest.approx(start, rel=1e-12)
    highest, _ = fly(lowest, 0.0, lambda _, v: -v, weight=WEIGHT)
    assert highest == pytest.approx(start, rel=1e-8)


@pytest.mark.parametrize("restitution", [0.0, 0.05, 0.5, 0.95])
@pytest.mark.parametrize("speed", [1e-4, 3e-3, 0.02, 0.4, 6.0])
def test_rebound_is_that_of_the_motion(restitution, speed):
    slow = 4e-3
    beta = (1 - restitution**2) / (1 + restitution**2)
    strength = MASS * speed**2 * REACH

    def slope(_, y):
        loss = 1 - beta * y[1] / math.hypot(y[1], slow)
        return [y[1], float(contact.force(y[0], strength, REACH)) * loss / MASS]

    def out(_, y):
        return y[0] - REACH

    out.terminal = True
    out.direction = 1
    time = REACH / speed
    how = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-14, "max_step": time / 50}
    run = solve_ivp(slope, (0, 1e4 * time), [REACH, -speed], events=out, **how)
    assert run.status == 1
    assert run.y[1, -1] / speed == pytest.approx(contact.rebound(speed, restitution, slow), abs=2e-7)


@given(st.floats(0.0, 1.0), st.floats(1.0, 100.0))
def test_rebound_is_the_restitution_of_what_is_fast(restitution, speed):
    found = contact.rebound(speed, restitution, 1e-6)
    # e = 0 leaves a rebound that is slow beside the impact: of some sqrt(w/v)
    assert restitution - 1e-6 <= found < math.hypot(restitution, 1e-3)


def test_rebound_at_its_ends():
    assert contact.rebound(0.0, 0.3, 1e-3) == contact.rebound(2.0, 1.0, 1e-3) == 1
    # far below w the loss is that of a damper, less and less of it: 1 - (2/3) beta v/w, nearly
    assert (1 - contact.rebound(1e-6, 0.0, 1e-3)) / 1e-3 == pytest.approx(2 / 3, rel=1e-3)


def test_bad_restitution_is_named():
    with pytest.raises(ValueError, match=r"restitution is 1\.1; it must be a number from 0 to 1"):
        contact.rebound(1.0, 1.1, 1e-3)
    with pytest.raises(ValueError, match=r"speed is -1\.0; it must be a number from 0"):
        contact.rebound(-1.0, 0.5, 1e-3)
    with pytest.raises(ValueError, match=r"slow is 0\.0; it must be a positive number"):
        contact.rebound(1.0, 0.5, 0.0)


def test_sliding_particle_stops_where_it_should():
    """Against the sum of the motion under constant deceleration, in small steps of midpoint rule."""
    speed = 3.0
    friction = 0.4
    steps = 1000
    step = speed / (friction * G) / steps
    speeds = speed - friction * G * step * (np.arange(steps) + 0.5)
    distance = contact.stopping_distance(speed, friction)
    assert distance == pytest.approx(step * speeds.sum(), rel=1e-12)
    assert distance > 1


def test_slope():
    friction = 0.6
    edge = math.atan(friction)
    assert contact.holds(edge - 1e-9, friction)
    assert not contact.holds(edge + 1e-9, friction)
    assert contact.slope_acceleration(edge, friction) == pytest.approx(0, abs=1e-14)
    # the normal force is m g cos a: forces in the world frame, projected downhill
    angle = 0.9
    downhill = np.array([math.cos(angle), -math.sin(angle)])
    normal = np.array([math.sin(angle), math.cos(angle)])
    gravity = np.array([0.0, -G])
    total = gravity - (gravity @ normal) * normal + friction * (gravity @ normal) * downhill
    assert contact.slope_acceleration(angle, friction) == pytest.approx(total @ downhill, rel=1e-14)
    assert total @ downhill > 1
