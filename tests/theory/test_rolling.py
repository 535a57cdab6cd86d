"""Balls that meet, rebound or roll on what turns, and a rising egg, against equations of motion."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from springgym.theory import rolling

UP = np.array([0.0, 0.0, 1.0])
SOLID = 0.4


def skid_until_it_rolls(velocity, omega, radius=0.03, moment=SOLID, friction=0.2, g=9.81, step=1e-5):
    """Return the velocity at which a ball that skids on a table begins to roll, by Euler's method.

    The method is exact while the slip keeps its direction.

    Vectors in the plane are complex numbers. A turn by the right angle from x to y, UP × …, multiplies by i.
    """
    v = complex(*velocity[:2])
    w = complex(*omega[:2])
    for _ in range(200_000):
        slip = v + 1j * radius * w
        speed = abs(slip)
        if speed < 3 * friction * g * step:
            return [v.real, v.imag, 0.0]
        pull = -friction * g * slip / speed
        v += step * pull
        w -= step * 1j * pull / (moment * radius)
    raise AssertionError("it still skids")


@pytest.mark.parametrize(("cut", "restitution"), [(0.0, 1.0), (0.7, 0.9)])
def test_balls_roll_on_after_they_met(restitution, cut):
    came = np.array([2.0, 0.0, 0.0])
    radius = 0.03
    line = np.array([math.cos(cut), math.sin(cut), 0.0])
    given = (1 + restitution) / 2 * (came @ line) * line
    spin = np.cross(UP, came) / radius
    ends = skid_until_it_rolls(came - given, spin), skid_until_it_rolls(given, (0, 0, 0))
    found = rolling.after_struck(came, line, SOLID, restitution)
    for own, end in zip(found, ends, strict=True):
        assert own == pytest.approx(end, abs=1e-3)
    assert sum(found) == pytest.approx(came, abs=1e-12)
    if cut == 0 and restitution == 1:
        assert [own[0] for own in found] == pytest.approx([4 / 7, 10 / 7], rel=1e-12)


@pytest.mark.parametrize(("friction", "spin"), [(0.0, 60.0), (0.2, 60.0), (2.0, -80.0), (0.2, 0.0)])
def test_wall_gives_the_sum_of_its_small_impulses(spin, friction):
    """Coulomb's law in each of 10⁴ parts of the normal impulse.

    Vectors along the wall are complex numbers, and n × … multiplies them by −i.
    """
    v = np.array([1.0, 0.5, -0.2])
    w = np.array([3.0, -7.0, spin])
    n = np.array([-1.0, 0, 0])
    radius = 0.03
    found = rolling.off_a_wall(v, w, n, radius, SOLID, friction, 0.8)
    part = 1.8 * 1.0 / 10_000
    along = complex(v[1], v[2])
    turn = complex(w[1], w[2])
    for _ in range(10_000):
        slip = along - 1j * radius * turn
        speed = abs(slip)
        rub = min(friction * part, speed * SOLID / (1 + SOLID))
        j = -rub * slip / speed if speed > 0 else 0.0
        along += j
        turn += 1j * j / (SOLID * radius)
    assert found == pytest.approx([v[0] - 10_000 * part, along.real, along.imag], abs=1e-9)


def test_ball_on_a_turntable_turns_at_the_rate_of_the_circle():
    """A ball that creeps with a slip of 10⁻⁶ m/s and less, by its friction −c (slip)."""
    rate = 7.0
    radius = 0.05
    moment = SOLID

    def slope(_, y):
        x = y[:3]
        v = y[3:6]
        w = y[6:]
        slip = v - radius * np.cross(w, UP) - rate * np.cross(UP, x)
        slip[2] = 0.0
        pull = -1e6 * slip
        return np.concatenate([v, pull, -np.cross(UP, pull) / (moment * radius)])

    y = solve_ivp(
        slope, (0, 2), [0.3, 0, 0, 0, 0.4, 0, 34, 0, 0], method="Radau", rtol=1e-9, atol=1e-11, max_step=0.02
    ).y
    turned = np.unwrap(np.arctan2(y[4], y[3]))
    assert (turned[-1] - turned[0]) / 2 == pytest.approx(rolling.turntable_rate(rate, moment), rel=1e-5)
    assert rolling.turntable_rate(rate, moment) == pytest.approx(2 / 7 * rate, rel=1e-12)


def test_egg_rises_in_the_time_of_its_equation():
    a = 0.03
    b = 0.022
    constant = 4e-5
    weight = 0.6
    friction = 0.1

    def slope(_, y):
        return -friction * weight / constant * ((a * np.cos(y)) ** 2 + (b * np.sin(y)) ** 2)

    def there(_, y):
        return y[0] - 0.2

    there.terminal = True
    run = solve_ivp(slope, (0, 10), [1.5], events=there, rtol=1e-10, atol=1e-12)
    time = rolling.egg_rise(1.5, 0.2, (a, b), constant, weight, friction)
    assert time == pytest.approx(run.t_events[0][0], rel=1e-7)


def test_resistance_is_that_of_the_equations_of_motion() -> None:
    """m dv/dt = m g sin a − f and I dw/dt = f r − ρ N, solved for dv/dt = r dw/dt and f."""
    angle = 0.3
    moment = 0.4
    rho = 0.01
    radius = 0.1
    g = 9.81
    slows = np.array([[1.0, 1.0], [moment, -1.0]])
    pulls = np.array([g * math.sin(angle), -rho / radius * g * math.cos(angle)])
    expected = np.linalg.solve(slows, pulls)[0]
    found = [rolling.resisted_acceleration(a, moment, rho, radius, g) for a in (angle, -angle)]
    assert found == pytest.approx([expected, -expected], rel=1e-12)
    assert rolling.resisted_acceleration(math.atan(rho / radius) - 1e-9, moment, rho, radius, g) == 0.0
    way, time = rolling.resisted_way(0.3, moment, rho, radius, g)
    slower = -np.linalg.solve(slows, [0.0, -rho / radius * g])[0]
    assert 0.3 - slower * time == pytest.approx(0.0, abs=1e-12)
    assert way == pytest.approx(0.3 * time - 0.5 * slower * time**2, rel=1e-12)
    assert rolling.resisted_spin(4.0, moment, rho, radius, g) * rho * g == pytest.approx(
        moment * radius**2 * 4.0, rel=1e-12
    )
