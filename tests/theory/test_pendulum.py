import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from springgym.theory import pendulum, top

CUBE = pendulum.cube_on_vertex(mass=1.0, edge=1.0)
RATE = math.sqrt(CUBE.mgl / CUBE.i1)


@pytest.mark.parametrize(
    ("theta", "theta_dot"),
    [(1, 0), (-2, 1), (-2, -1), (3.0, 0), (0, 3), (2, -8), (0.5, 9), (math.pi, 1), (-math.pi, -1)],
)
def test_motion_against_integration(theta, theta_dot):
    times = np.linspace(0, 6, 61)
    runs = [
        solve_ivp(
            lambda _, y: [y[1], -(RATE**2) * np.sin(y[0])],
            (0, 6),
            [theta, theta_dot],
            method="DOP853",
            rtol=rtol,
            atol=rtol,
            t_eval=times,
        ).y
        for rtol in (1e-11, 1e-13)
    ]
    error = np.abs(runs[0] - runs[1]).max() + 1e-13 * math.exp(RATE * 6 * (abs(theta) > 3))
    angle, rate = pendulum.motion(CUBE.i1, CUBE.mgl, theta, theta_dot, times)
    assert error < 1e-6
    assert angle == pytest.approx(runs[1][0], abs=error)
    assert rate == pytest.approx(runs[1][1], abs=error)
    assert np.ptp(angle) > 1


@given(theta=st.floats(-math.pi, math.pi), theta_dot=st.floats(-20, 20))
def test_energy_is_kept(theta, theta_dot):
    angle, rate = pendulum.motion(CUBE.i1, CUBE.mgl, theta, theta_dot, np.linspace(0, 40, 30))
    energy = CUBE.i1 * rate**2 / 2 - CUBE.mgl * np.cos(angle)
    expected = CUBE.i1 * theta_dot**2 / 2 - CUBE.mgl * math.cos(theta)
    # sn^2 + cn^2 = 1 to a few eps; whole turns are rounded at 1e-13
    assert energy == pytest.approx(expected, abs=1e-12 * (CUBE.i1 * theta_dot**2 + CUBE.mgl))


def test_motion_on_the_separatrix_is_the_gudermannian():
    times = np.linspace(0, 4, 9)
    angle, rate = pendulum.motion(1.0, 1.0, 0.0, 2.0, times)
    assert angle == pytest.approx(4 * np.arctan(np.exp(times)) - math.pi, abs=1e-14)
    assert rate == pytest.approx(2 / np.cosh(times), abs=1e-14)


def test_pendulum_at_rest_stays():
    for theta in (0.0, math.pi):
        angle, rate = pendulum.motion(1.0, 1.0, theta, 0.0, [0.0, 3.0])
        assert np.all(angle == theta)
        assert np.all(rate == 0)


@pytest.mark.parametrize("amplitude", [0.5, 1.5, 3.0, 3.14])
def test_period_against_the_swing_and_quadrature(amplitude):
    period = pendulum.period(CUBE.i1, CUBE.mgl, amplitude)
    angle, _ = pendulum.motion(CUBE.i1, CUBE.mgl, amplitude, 0.0, [period / 4, period / 2, period])
    assert angle == pytest.approx([0, -amplitude, amplitude], abs=1e-12)
    # sin(theta/2) = k sin(x) turns the quarter swing into the integral of a smooth function
    m1 = math.cos(amplitude / 2) ** 2
    quarter, error = quad(lambda x: 1 / math.hypot(math.cos(x), math.sqrt(m1) * math.sin(x)), 0, math.pi / 2)
    assert period == pytest.approx(4 * quarter / RATE, abs=4 * error / RATE + 1e-12)


def test_period_of_small_swings():
    small = pendulum.small_period(CUBE.i1, CUBE.mgl)
    assert small == pytest.approx(2 * math.pi * math.sqrt(5 / (2 * math.sqrt(3) * 9.81)), rel=1e-14)
    assert small == pytest.approx(2.4101, abs=1e-4)
    # T/T0 = 1 + a^2/16 + 11 a^4/3072 + O(a^6)
    a = 0.1
    series = 1 + a**2 / 16 + 11 * a**4 / 3072
    assert pendulum.period(CUBE.i1, CUBE.mgl, a) / small == pytest.approx(series, abs=1e-8)


def test_cube_is_the_sum_over_its_corners():
    corners = np.indices((2, 2, 2)).reshape(3, -1).T * 0.8
    mass = 3.0 / 8
    square = np.sum(corners**2)
    tensor = mass * (square * np.eye(3) - corners.T @ corners)
    cube = pendulum.cube_on_vertex(3.0, 0.8)
    moments = np.linalg.eigvalsh(tensor)
    assert moments == pytest.approx([cube.i3, cube.i1, cube.i1], rel=1e-13)
    assert cube.length == pytest.approx(np.linalg.norm(corners.mean(axis=0)), rel=1e-14)
    assert cube.mgl == pytest.approx(3.0 * 9.81 * cube.length, rel=1e-14)


def test_top_without_spin_is_this_pendulum():
    body = top.HeavyTop(CUBE.i1, CUBE.i3, CUBE.mgl)
    times = np.linspace(0, 6, 40)
    swing, _ = pendulum.motion(CUBE.i1, CUBE.mgl, 1.2, 0.0, times)
    axis = top.motion(body, top.TopState(math.pi - 1.2, 0.0), times).attitude[:, 2, 2]
    assert axis == pytest.approx(-np.cos(swing), abs=1e-13)
    assert top.nutation_period(body, top.TopState(math.pi - 1.2, 0.0)) == pytest.approx(
        pendulum.period(CUBE.i1, CUBE.mgl, 1.2) / 2, rel=1e-14
    )


def test_bad_values_are_named():
    with pytest.raises(ValueError, match=r"amplitude is 3\.2; it must be more than -3\.14159 and less"):
        pendulum.period(1.0, 1.0, 3.2)
    with pytest.raises(ValueError, match=r"theta is 4\.0; it must be a number from -3\.14159\d* to 3\.14159"):
        pendulum.motion(1.0, 1.0, 4.0, 0.0, 0.0)
