import math

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st

from springgym.theory import frames, top
from springgym.theory.top import TopState
from tests.params import slow_but

PAPER = top.cone_top_inertia(mass=12.0, radius=0.5, height=1.0)
SLOW, FAST = top.steady_precession(PAPER, 0.4, 45.0)

CASES = {
    "cusps": TopState(0.3, 50.0),
    "loops": TopState(0.3, 50.0, phi_dot=-2.0, phi=1.0, psi=2.0),
    "loops, rising": TopState(0.3, 50.0, theta_dot=-0.5, phi_dot=-2.0),
    "waves, falling, spun backwards": TopState(0.5, -45.0, theta_dot=1.0, phi_dot=3.0),
    "slow and hanging": TopState(2.5, 3.0, theta_dot=1.0, phi_dot=1.0),
    "steady, slow": TopState(0.4, 45.0, phi_dot=SLOW),
    "steady, fast": TopState(0.4, 45.0, phi_dot=FAST),
    "nearly steady": TopState(0.4, 45.0, phi_dot=FAST * (1 + 1e-9)),
    "sleeping": TopState(0.0, 50.0),
    "through the upright": TopState(0.0, 30.0, theta_dot=1.0),
    "through the upright, other way": TopState(0.0, 30.0, theta_dot=-1.0, phi=0.4, psi=0.3),
    "through the lowest point": TopState(math.pi, 5.0, theta_dot=-3.0),
    "just past the upright": TopState(1e-6, 45.0, theta_dot=0.3),
    "just past the lowest point": TopState(math.pi - 1e-6, 3.0, theta_dot=0.3),
    "plane pendulum": TopState(2.0, 0.0),
    "plane pendulum over the top": TopState(2.0, 0.0, theta_dot=9.0),
    "just under the sleeping threshold": TopState(1e-3, 38.0),
}


def initial(state):
    """Frame and body angular velocity of a state, from the definition of the Euler rates."""
    frame = frames.euler_zxz(state.phi, state.theta, state.psi)
    node = np.array([math.cos(state.psi), -math.sin(state.psi), 0.0])
    omega = state.theta_dot * node + state.phi_dot * frame[2]
    return frame, np.array([omega[0], omega[1], state.omega3])


def torque(body):
    """Return a function of the frame: the torque of the weight, axis × (0, 0, −m g l)."""
    return lambda frame: body.mgl * np.array([-frame[1, 2], frame[0, 2], 0.0])


def compare(state, times, rigid_reference, body=PAPER):
    frame, omega = initial(state)
    inertia = np.array([body.i1, body.i1, body.i3])
    reference = rigid_reference(inertia, torque(body), omega, frame, times)
    motion = top.motion(body, state, times)
    assert motion.attitude == pytest.approx(reference.frame, abs=reference.error)
    omega_body = np.einsum("tji,tj->ti", motion.attitude, motion.omega_world)
    assert omega_body == pytest.approx(reference.omega_body, abs=reference.error)
    return reference, motion


@pytest.mark.parametrize("name", slow_but(CASES, "cusps", "sleeping", "plane pendulum"))
def test_motion_against_integration(name, rigid_reference):
    reference, motion = compare(CASES[name], np.linspace(0, 2.5, 51), rigid_reference)
    assert reference.error < 2e-9
    assert np.abs(motion.attitude[-1] - motion.attitude[0]).max() > 0.1


@settings(max_examples=12, deadline=None, derandomize=True, phases=[Phase.generate])
@given(
    theta=st.floats(0.01, 3.13),
    omega3=st.floats(-40, 40),
    theta_dot=st.floats(-5, 5),
    phi_dot=st.floats(-5, 5),
    i3=st.floats(0.1, 1.9),
)
@pytest.mark.slow
def test_any_motion_against_integration(rigid_reference, theta, omega3, theta_dot, phi_dot, i3):
    state = TopState(theta, omega3, theta_dot, phi_dot)
    body = top.HeavyTop(1.0, i3, 20.0)
    reference, _ = compare(state, np.linspace(0, 1, 11), rigid_reference, body)
    assume(reference.error < 1e-8)


@settings(max_examples=200, deadline=None)
@given(
    theta=st.floats(0.0, math.pi),
    omega3=st.floats(-100, 100),
    theta_dot=st.floats(-10, 10),
    phi_dot=st.floats(-10, 10),
)
def test_energy_and_vertical_momentum_are_kept(theta, omega3, theta_dot, phi_dot):
    state = TopState(theta, omega3, theta_dot, phi_dot)
    motion = top.motion(PAPER, state, np.linspace(0, 30, 50))
    axis = motion.attitude[..., 2]
    spin = np.sum(motion.omega_world * axis, axis=-1)
    across = motion.omega_world - spin[..., None] * axis
    momentum = PAPER.i1 * across + PAPER.i3 * spin[..., None] * axis
    energy = np.sum(momentum * motion.omega_world, axis=-1) / 2 + PAPER.mgl * axis[..., 2]
    frame, omega = initial(state)
    body = np.array([PAPER.i1, PAPER.i1, PAPER.i3])
    expected = body @ omega**2 / 2 + PAPER.mgl * math.cos(theta)
    # round-off of the phase: 3000 rad * 1e-16, times 1e2 for the product of two terms
    scale = body @ omega**2 + 2 * PAPER.mgl
    assert energy == pytest.approx(expected, abs=1e-11 * scale)
    lift = np.linalg.norm(body * omega) + PAPER.mgl
    assert momentum[:, 2] == pytest.approx(frame[2] @ (body * omega), abs=1e-11 * lift)
    assert spin == pytest.approx(omega3, abs=1e-12 * (1 + abs(omega3)))


@pytest.mark.parametrize("name", ["cusps", "loops", "slow and hanging", "nearly steady"])
def test_motion_restarted_on_the_way_goes_on(name):
    state = CASES[name]
    half = top.motion(PAPER, state, 1000.0)
    again = TopState(
        float(half.theta),
        state.omega3,
        float(half.theta_dot),
        float(half.phi_dot),
        float(half.phi),
        float(half.psi),
    )
    later = np.linspace(0, 5, 20)
    whole = top.motion(PAPER, state, 1000 + later)
    rest = top.motion(PAPER, again, later)
    # angles of 5e4 rad are rounded at 7e-12; ten roundings, and growth of omega3 t = 250 at most
    assert rest.attitude == pytest.approx(whole.attitude, abs=1e-9)


def test_theta_dot_and_phi_dot_are_the_rates():
    step = 1e-5
    for name in ("loops", "waves, falling, spun backwards", "slow and hanging"):
        before, now, after = (
            top.motion(PAPER, CASES[name], np.linspace(0.3, 1, 9) + d) for d in (-step, 0, step)
        )
        # h^2/6 of a third derivative below 10 * 8^3, i.e. 1e-7; round-off eps * 50 / h = 1e-9
        assert now.theta_dot == pytest.approx((after.theta - before.theta) / 2 / step, abs=2e-7)
        assert now.phi_dot == pytest.approx((after.phi - before.phi) / 2 / step, abs=2e-7)
        assert np.ptp(now.phi_dot) > 1


@pytest.mark.parametrize("name", ["cusps", "loops, rising", "slow and hanging"])
def test_turning_points_are_roots_and_bounds(name):
    state = CASES[name]
    u1, u2, u3 = top.turning_points(PAPER, state)
    of = top.constants(PAPER, state)
    scale = of.a**2 + of.alpha + of.beta
    assert u1 < u2 <= 1 <= u3
    for root in (u1, u2, u3):
        assert top.cubic(root, of) == pytest.approx(0, abs=1e-15 * scale * (1 + u3**3))
    assert top.cubic((u1 + u2) / 2, of) > 0 > top.cubic((u2 + u3) / 2, of)
    period = top.nutation_period(PAPER, state)
    motion = top.motion(PAPER, state, np.linspace(0, period, 4001))
    u = np.cos(motion.theta)
    # an extremum falls between samples: |u''| dt^2 / 8 with |u''| <= omega_n^2 (u2 - u1)
    slip = (2 * math.pi / 4000) ** 2 * (u2 - u1)
    assert u.min() == pytest.approx(u1, abs=slip)
    assert u.max() == pytest.approx(u2, abs=slip)
    # u_dot^2 = f(u) and I1 theta_dot^2/2 + V = V at the turning points
    assert top.cubic(u, of) == pytest.approx(
        (np.sin(motion.theta) * motion.theta_dot) ** 2, abs=1e-14 * scale
    )
    total = PAPER.i1 * motion.theta_dot**2 / 2 + top.effective_potential(motion.theta, PAPER, state)
    level = top.effective_potential(math.acos(u1), PAPER, state)
    assert total == pytest.approx(float(level), rel=1e-12)


def test_effective_potential_is_least_at_the_steady_tilt():
    state = CASES["steady, slow"]
    low, middle, high = top.effective_potential([0.39, 0.4, 0.41], PAPER, state)
    assert middle < min(low, high)
    curve = (low - 2 * middle + high) / 0.01**2 / PAPER.i1
    # fourth difference: relative error O(0.01^2 * few / theta^2)
    assert math.sqrt(curve) == pytest.approx(top.nutation_frequency(PAPER, 0.4, SLOW), rel=5e-3)


def test_cusps_loops_and_waves():
    times = np.linspace(0, 3, 3001)
    cusps = top.motion(PAPER, CASES["cusps"], times).phi_dot
    loops = top.motion(PAPER, CASES["loops"], times).phi_dot
    waves = top.motion(PAPER, TopState(0.3, 50.0, phi_dot=0.5), times).phi_dot
    assert cusps.min() == pytest.approx(0, abs=1e-12)
    assert cusps.max() > 1
    assert loops.min() < -1 < 1 < loops.max()
    assert waves.min() > 0.4
    assert np.ptp(waves) > 0.1


@pytest.mark.parametrize("name", ["cusps", "waves, falling, spun backwards", "plane pendulum"])
def test_tilt_returns_after_the_nutation_period(name):
    state = CASES[name]
    period = top.nutation_period(PAPER, state)
    times = np.linspace(0, 1, 7)
    now, half, later = (np.cos(top.motion(PAPER, state, times + d).theta) for d in (0, period / 2, period))
    assert later == pytest.approx(now, abs=1e-13)
    assert np.abs(half - now).max() > 0.05


@pytest.mark.parametrize(
    ("theta", "omega3"), [(0.4, 45.0), (0.4, -45.0), (1.4, 20.0), (2.0, 5.0), (2.5, 0.0)]
)
def test_steady_precession_is_steady(theta, omega3):
    slow, fast = top.steady_precession(PAPER, theta, omega3)
    assert abs(slow) <= abs(fast)
    for rate in (slow, fast):
        push = PAPER.i1 * math.cos(theta) * rate**2 - PAPER.i3 * omega3 * rate + PAPER.mgl
        assert push == pytest.approx(0, abs=1e-15 * (PAPER.i1 * rate**2 + 100 * abs(rate) + 100))
        motion = top.motion(PAPER, TopState(theta, omega3, phi_dot=rate), np.linspace(0, 5, 40))
        # a rate rounded by eps nutates by about eps * rate / omega_n
        assert motion.theta == pytest.approx(theta, abs=1e-13)
        assert motion.phi[-1] == pytest.approx(5 * rate, rel=1e-12)
        off = top.motion(PAPER, TopState(theta, omega3, phi_dot=rate * 1.05), np.linspace(0, 5, 40))
        assert np.ptp(off.theta) > 1e-3


def test_steady_precession_of_a_level_axis_has_one_finite_rate():
    slow, fast = top.steady_precession(PAPER, math.pi / 2, 45.0)
    assert slow == pytest.approx(PAPER.mgl / (PAPER.i3 * 45), rel=1e-14)
    assert abs(fast) > 1e12


def test_no_steady_precession_below_the_least_spin():
    least = 2 * math.sqrt(PAPER.i1 * PAPER.mgl * math.cos(0.4)) / PAPER.i3
    slow, fast = top.steady_precession(PAPER, 0.4, least * (1 + 1e-12))
    assert slow == pytest.approx(fast, rel=1e-5)
    with pytest.raises(ValueError, match=r"theta = 0\.4 rad .* needs \|omega3\| >= 37\."):
        top.steady_precession(PAPER, 0.4, least * (1 - 1e-12))
    with pytest.raises(ValueError, match="no steady precession"):
        top.steady_precession(PAPER, 1.0, 0.0)


@pytest.mark.parametrize(("theta", "omega3"), [(0.4, 45.0), (1.4, 20.0), (2.5, 0.0), (2.0, -7.0)])
def test_nutation_frequency_is_the_limit_of_the_period(theta, omega3):
    for rate in top.steady_precession(PAPER, theta, omega3):
        expected = 2 * math.pi / top.nutation_frequency(PAPER, theta, rate)
        exact = top.nutation_period(PAPER, TopState(theta, omega3, phi_dot=rate))
        assert exact == pytest.approx(expected, rel=1e-9)
        # off by a relative size s the period changes by O(s): a tenth of s gives a tenth of it
        wide, near = (
            top.nutation_period(PAPER, TopState(theta, omega3, phi_dot=rate * (1 + s))) - expected
            for s in (1e-3, 1e-4)
        )
        assert wide / near == pytest.approx(10, rel=0.05)


def test_fast_top_nutates_at_the_fast_limit():
    gaps = []
    for omega3 in (200.0, 400.0):
        slow, _ = top.steady_precession(PAPER, 0.4, omega3)
        limit = PAPER.i3 * omega3 / PAPER.i1  # Goldstein section 5.7
        gaps.append(top.nutation_frequency(PAPER, 0.4, slow) / limit - 1)
    # the next term is of relative order Mgl I1 / (I3 omega3)^2
    assert abs(gaps[0]) < 0.02
    assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.05)


def test_sleeping_threshold():
    r = 0.5
    h = 1.0
    g = 9.81
    threshold = top.sleeping_threshold(PAPER)
    assert threshold**2 == pytest.approx(3 * g * h * (3 * h**2 + r**2) / r**4, rel=1e-14)
    tilt = 1e-3
    above, below = (
        math.acos(top.turning_points(PAPER, TopState(tilt, threshold * s))[0]) for s in (1.02, 0.98)
    )
    # 2 % above: the tilt swings to tilt * omega_fast/omega_slow of order 1/sqrt(0.04); below: it
    # falls to cos(theta) = a^2/beta - 1 = 2 * 0.98^2 - 1
    assert tilt < above < 10 * tilt
    assert below == pytest.approx(math.acos(2 * 0.98**2 - 1), rel=1e-3)


def test_upright_axis_below_the_threshold_balances_for_ever():
    state = TopState(0.0, 30.0)
    motion = top.motion(PAPER, state, [0.0, 7.0])
    assert top.nutation_period(PAPER, state) == math.inf
    assert np.all(motion.theta == 0)
    assert (motion.phi + motion.psi)[1] == pytest.approx(210.0)


def test_cone_top_is_the_sum_over_its_particles():
    mass = 12.0
    radius = 0.5
    height = 1.0
    n = 12
    angles = 2 * math.pi * np.arange(n) / n
    ring = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(n, height)], axis=1)
    points = np.vstack([ring, [0, 0, height], [0, 0, 0]])
    masses = np.array([mass / 2 / n] * n + [mass / 4] * 2)
    square = np.sum(points**2, axis=1)
    tensor = np.einsum("i,ijk->jk", masses, square[:, None, None] * np.eye(3)) - np.einsum(
        "i,ij,ik->jk", masses, points, points
    )
    expected = np.diag([PAPER.i1, PAPER.i1, PAPER.i3])
    assert tensor == pytest.approx(expected, abs=1e-14 * mass)
    assert PAPER.mgl == pytest.approx(9.81 * masses @ points[:, 2], rel=1e-14)


def test_bad_values_are_named():
    with pytest.raises(ValueError, match=r"i3 is 0\.0; it must be a positive number"):
        top.HeavyTop(1.0, 0.0, 1.0)
    with pytest.raises(ValueError, match="mgl is nan; it must be a positive number"):
        top.HeavyTop(1.0, 1.0, math.nan)
    with pytest.raises(ValueError, match=r"theta is -0\.1; it must be a number from 0 to 3\.14159"):
        TopState(-0.1, 1.0)
    with pytest.raises(ValueError, match="theta_dot is nan; it must be a number"):
        TopState(0.1, 1.0, theta_dot=math.nan)
