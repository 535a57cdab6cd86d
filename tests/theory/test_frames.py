import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import special
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from springgym.theory import elliptic, frames

angle = st.floats(-10, 10)


@given(angle, angle, angle)
def test_euler_angles_are_three_turns(phi, theta, psi):
    expected = Rotation.from_euler("ZXZ", [phi, theta, psi]).as_matrix()
    # entries are sums of two products of numbers below 1, angles carry eps * 10
    assert frames.euler_zxz(phi, theta, psi) == pytest.approx(expected, abs=1e-14)


def test_axis_of_the_documented_azimuth():
    assert frames.euler_zxz(np.pi / 2, 0.4, 0.0)[:, 2] == pytest.approx(
        [np.sin(0.4), 0.0, np.cos(0.4)], abs=1e-15
    )


def test_carried_particles_move_with_their_velocity():
    omega = np.array([0.3, -2.0, 1.1])
    points = np.array([[1.0, 2.0, 3.0], [-1.0, 0.5, 0.0]])
    step = 1e-5
    times = np.array([-step, 0.0, step])
    turn = Rotation.from_rotvec(times[:, None] * omega).as_matrix()
    frame = turn @ frames.euler_zxz(0.3, 0.7, 0.1)
    positions, velocities = frames.carry(frame, np.broadcast_to(omega, (3, 3)), points)
    assert positions.shape == velocities.shape == (3, 2, 3)
    difference = (positions[2] - positions[0]) / (2 * step)
    # central difference: omega^3 r h^2 / 6 = 8e-10, round-off eps r / h = 8e-11
    assert velocities[1] == pytest.approx(difference, abs=2e-9)
    assert np.abs(velocities[1]).max() > 1


@pytest.mark.parametrize("m1", [1.0, 0.7, 0.3, 1e-3, 1e-8])
def test_jacobi_functions_against_scipy(m1):
    u = np.linspace(-30, 30, 401)
    now = elliptic.jacobi(u, m1)
    sn, cn, dn, _ = special.ellipj(u, 1 - m1)
    # scipy takes m, whose rounding moves m1 by eps/m1 of itself and the phase, up to 30, by as much
    tolerance = 3e-14 / m1
    assert now.sn == pytest.approx(sn, abs=tolerance)
    assert now.cn == pytest.approx(cn, abs=tolerance)
    assert now.dn == pytest.approx(dn, abs=tolerance)
    assert np.abs(now.turns).max() >= 1
    assert elliptic.complete_k(m1) == pytest.approx(special.ellipkm1(m1), rel=4e-16)


def test_jacobi_functions_on_the_separatrix():
    u = np.linspace(-3, 3, 7)
    now = elliptic.jacobi(u, 0.0)
    assert now.sn == pytest.approx(np.tanh(u), rel=1e-15)
    assert now.dn == pytest.approx(1 / np.cosh(u), rel=1e-15)
    assert elliptic.complete_k(0.0) == np.inf


@pytest.mark.parametrize("m1", [0.9, 0.2])
@pytest.mark.parametrize(("p", "q"), [(2.0, 0.5), (0.5, 2.0), (1.0, 1.0), (0.01, 1.5)])
def test_integral_of_the_third_kind_against_quadrature(m1, p, q):
    def integrand(u):
        sn, cn, _, _ = special.ellipj(u, 1 - m1)
        return 1 / (p * cn**2 + q * sn**2)

    for u in (-5.0, -0.4, 0.0, 0.8, 1.9, 7.3):
        expected, error = quad(integrand, 0, u, epsabs=1e-11, epsrel=1e-11, limit=400)
        value = elliptic.third_kind(elliptic.jacobi(np.asarray(u), m1), m1, p, q)
        assert value == pytest.approx(expected, abs=error + 1e-12)
        assert u == 0 or abs(value) > 0.1


def test_incomplete_integral_inverts_sn():
    for m1 in (1.0, 0.4, 1e-6):
        u = elliptic.incomplete_f(np.sin(0.9), np.cos(0.9), m1)
        assert elliptic.jacobi(np.asarray(u), m1).sn == pytest.approx(np.sin(0.9), abs=1e-15)
