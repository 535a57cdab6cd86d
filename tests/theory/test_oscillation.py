import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from springgym.theory import oscillation

CRITICAL = 2 * math.sqrt(50.0 * 2.0)


@pytest.mark.parametrize(
    "damping", [0.0, 3.0, CRITICAL * (1 - 1e-9), CRITICAL, CRITICAL * (1 + 1e-9), 90.0, 5000.0]
)
def test_damped_against_the_matrix_exponential(damping):
    mass = 2.0
    stiffness = 50.0
    matrix = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    for t in (0.0, 0.1, 0.9, 3.0):
        expected = expm(matrix * t) @ [0.3, -2.0]
        measured = oscillation.damped(mass, damping, stiffness, 0.3, -2.0, t)
        # expm is accurate to eps times the size of its argument
        assert measured == pytest.approx(expected, abs=1e-14 * (10 + damping * t))
    assert abs(measured[0] - 0.3) > 0.005


def test_damped_slow_decay_of_strong_damping_does_not_cancel():
    x, v = oscillation.damped(1.0, 1e9, 1.0, 1.0, 0.0, 1e9)
    assert x == pytest.approx(math.exp(-1), rel=1e-14)
    assert v == pytest.approx(-1e-9 * math.exp(-1), rel=1e-14)


@given(st.floats(0, 100), st.floats(-1, 1), st.floats(-10, 10))
def test_damped_never_gains_energy(damping, x, v):
    x_t, v_t = oscillation.damped(2.0, damping, 50.0, x, v, np.linspace(0, 5, 200))
    energy = x_t**2 * 25 + v_t**2
    assert energy[0] == pytest.approx(25 * x**2 + v**2)
    assert np.diff(energy).max() <= 1e-13 * energy[0] + 1e-300


def test_spun_pair_keeps_its_length():
    """The two masses circle on the closed form's length, and not on the rest length."""
    mass = 0.5
    stiffness = 400.0
    rest = 1.0
    omega = 12.0
    length = oscillation.spun_pair_length(mass, stiffness, rest, omega)
    assert length > 1.08

    def lengths(start):
        def slope(_, y):
            r = y[:2]
            v = y[2:]
            size = np.linalg.norm(r)  # r is the edge, of reduced mass m/2
            return [*v, *(-2 * stiffness / mass * (size - rest) / size * r)]

        run = solve_ivp(slope, (0, 2), [start, 0, 0, omega * start], method="DOP853", rtol=1e-12, atol=1e-12)
        return np.hypot(run.y[0], run.y[1])

    assert lengths(length) == pytest.approx(length, abs=1e-10)
    assert np.ptp(lengths(rest)) > 0.1


def test_pair_spun_too_fast_flies_apart():
    with pytest.raises(ValueError, match=r"0\.5 kg on 400\.0 N/m .* needs \|omega\| < 40 rad/s"):
        oscillation.spun_pair_length(0.5, 400.0, 1.0, 40.0)


def test_implicit_euler_loses_spin_as_stated():
    """Implicit Euler on a stiff pair, each step solved to round-off."""
    omega = 10.0
    step = 2e-3
    steps = 500
    stiffness = 1e7
    r = np.array([1.0, 0.0])
    v = np.array([0.0, omega])

    spins = []
    for _ in range(steps):
        w = v
        for _ in range(8):  # Newton
            size = np.linalg.norm(r + step * w)
            n = (r + step * w) / size
            gap = w - v + step * stiffness * (size - 1) * n
            slope = (1 - 1 / size) * np.eye(2) + np.outer(n, n) / size
            change = np.linalg.solve(np.eye(2) + step**2 * stiffness * slope, gap)
            w = w - change
        assert np.abs(change).max() < 1e-10
        r = r + step * w
        v = w
        spins.append((r[0] * v[1] - r[1] * v[0]) / (r @ r))
    expected = oscillation.implicit_euler_spin(omega, step, step * np.arange(1, steps + 1))
    # (h omega)^2 = 4e-4 is the next order of a step's loss and omega^2/k = 1e-5 the stretch
    assert spins == pytest.approx(expected, rel=2e-3)
    assert expected[-1] < 0.9 * omega
    # omega0 = omega1 (1 + h^2 omega1^2) to (h omega)^4, once settled in
    before = np.array(spins[4:-1])
    after = np.array(spins[5:])
    assert before == pytest.approx(after * (1 + (step * after) ** 2), rel=1e-6)
    assert before != pytest.approx(after, rel=1e-5)


def test_spun_pair_has_its_angular_momentum():
    for momentum in (0.0, 1e-3, 7.5, 40.0, -7.5):
        length, spin = oscillation.spun_pair(1.0, 1000.0, 1.0, momentum)
        assert spin * length**2 / 2 == pytest.approx(momentum, rel=1e-12)
        assert length == oscillation.spun_pair_length(1.0, 1000.0, 1.0, spin)
