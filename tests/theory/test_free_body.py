import math

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from scipy.special import ellipk

from springgym.theory import frames, free_body
from tests.params import slow_but

TURN = frames.euler_zxz(0.3, 1.0, 2.0)

CASES = {
    "about the major axis": ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
    "about the minor axis": ([1.0, 2.0, 3.0], [-3.0, 0.2, 0.3]),
    "all backwards": ([1.0, 2.0, 3.0], [-1.0, -2.0, -3.0]),
    "other order of axes": ([0.9, 0.5, 0.7], [-1.6, 1.1, 3.9]),
    "near the middle axis": ([0.158, 0.289, 0.372], [0.1, 6.0, 0.1]),
    "nearly steady": ([2.0, 1.0, 1.5], [3.0, 1e-4, 0.0]),
    "oblate": ([1.0, 1.0, 2.0], [1.0, 2.0, 3.0]),
    "prolate": ([2.0, 1.0, 2.0], [1.0, 2.0, 3.0]),
    "nearly prolate": ([2.0, 3.0, 3.0000001], [1.0, 2.0, 3.0]),
    "oblate, spun across": ([1.0, 1.0, 2.0], [1.0, 2.0, 0.0]),
    "oblate, spun almost across": ([0.5, 0.5, 1.0], [0.0, 1.0, 6e-8]),
    "steady about the middle axis": ([1.0, 2.0, 3.0], [0.0, 2.0, 0.0]),
    "sphere": ([1.0, 1.0, 1.0], [1.0, 2.0, 3.0]),
}


def compare(inertia, omega, times, rigid_reference):
    reference = rigid_reference(inertia, lambda _: np.zeros(3), np.array(omega), TURN, times)
    motion = free_body.motion(inertia, omega, times, TURN)
    assert motion.omega_body == pytest.approx(reference.omega_body, abs=reference.error)
    assert motion.attitude == pytest.approx(reference.frame, abs=reference.error)
    return reference, motion


@pytest.mark.parametrize("name", slow_but(CASES, "about the major axis", "near the middle axis", "sphere"))
def test_motion_against_integration(name, rigid_reference):
    inertia, omega = CASES[name]
    times = np.linspace(0, 3, 31)
    reference, motion = compare(inertia, omega, times, rigid_reference)
    # the middle axis is unstable: a disturbance grows as e^(rate t)
    growth = math.exp(3 * free_body.growth_rate(inertia, np.linalg.norm(omega)))
    assert reference.error < 1e-10 * growth
    assert np.abs(motion.attitude[-1] - motion.attitude[0]).max() > 0.1
    momentum = np.einsum("tij,tj->ti", motion.attitude, inertia * motion.omega_body)
    assert momentum == pytest.approx(np.tile(TURN @ np.multiply(inertia, omega), (31, 1)), rel=1e-12)
    carried = np.einsum("tij,tj->ti", motion.attitude, motion.omega_body)
    assert motion.omega_world == pytest.approx(carried, abs=1e-13)


moment = st.floats(0.5, 1.0)
component = st.floats(-4, 4)


@settings(max_examples=15, deadline=None, derandomize=True, phases=[Phase.generate])
@given(st.tuples(moment, moment, moment), st.tuples(component, component, component))
@pytest.mark.slow
def test_any_motion_against_integration(rigid_reference, inertia, omega):
    assume(np.linalg.norm(omega) > 0.1)
    compare(inertia, omega, np.linspace(0, 3, 7), rigid_reference)


@settings(max_examples=200, deadline=None)
@given(st.tuples(moment, moment, moment), st.tuples(component, component, component))
def test_energy_and_momentum_are_kept(inertia, omega):
    motion = free_body.motion(inertia, omega, np.linspace(0, 100, 23))
    energy = motion.omega_body**2 @ inertia
    square = motion.omega_body**2 @ np.square(inertia)
    # 100 s at 7 rad/s turn a phase of 700 rad; amplitudes are exact to a few eps
    assert energy == pytest.approx(np.square(omega) @ inertia, rel=1e-13, abs=1e-250)
    assert square == pytest.approx(np.square(omega) @ np.square(inertia), rel=1e-13, abs=1e-250)


@pytest.mark.parametrize(("omega", "about"), [([0.3, 2.0, 2.5], "major"), ([2.5, 2.0, 0.3], "minor")])
def test_middle_component_reverses_every_flip_interval(omega, about):
    i1, i2, i3 = inertia = np.array([1.0, 2.0, 3.0])
    twice = np.square(omega) @ inertia
    square = np.square(omega) @ inertia**2
    assert (square > twice * i2) == (about == "major")
    if about == "minor":
        i1, i3 = i3, i1
    rate = math.sqrt((i3 - i2) * (square - twice * i1) / (i1 * i2 * i3))
    parameter = (i2 - i1) * (twice * i3 - square) / ((i3 - i2) * (square - twice * i1))
    interval = free_body.flip_interval(inertia, omega)
    assert interval == pytest.approx(2 * ellipk(parameter) / rate, rel=1e-13)
    times = np.linspace(0, 5, 11)
    now, later = (free_body.motion(inertia, omega, times + d).omega_body for d in (0, interval))
    circulated = 2 if about == "major" else 0
    sign = np.where(np.arange(3) == circulated, 1.0, -1.0)
    assert later == pytest.approx(sign * now, abs=1e-12)
    assert np.ptp(now[:, 1]) > 1


def test_flip_interval_of_a_steady_spin_is_infinite():
    assert free_body.flip_interval([1.0, 2.0, 3.0], [0.0, 2.0, 0.0]) == math.inf
    assert free_body.flip_interval([1.0, 1.0, 1.0], [0.1, 2.0, 0.0]) == math.inf


def test_flips_near_the_middle_axis_follow_the_growth_rate():
    inertia = [0.158, 0.289, 0.372]
    spin = 6.0
    rate = free_body.growth_rate(inertia, spin)
    intervals = [free_body.flip_interval(inertia, [s, spin, 0.0]) for s in (1e-4, 1e-6)]
    # a disturbance 100 times smaller takes ln(100)/rate longer to grow, and as long to fall back
    assert intervals[1] - intervals[0] == pytest.approx(2 * math.log(100) / rate, rel=1e-6)
    a, b, c = inertia
    linear = np.array([[0.0, (b - c) * spin / a], [(a - b) * spin / c, 0.0]])
    assert np.linalg.eigvals(linear).real.max() == pytest.approx(rate, rel=1e-14)
    assert free_body.growth_rate([c, a, b], -spin) == pytest.approx(rate, rel=1e-14)


def test_symmetric_body_precesses_at_the_known_rate():
    times = np.linspace(0, 4, 30)
    motion = free_body.motion([1.0, 1.0, 1.7], [0.5, 0.0, 3.0], times)
    phase = (1.7 - 1.0) / 1.0 * 3.0 * times
    expected = np.stack([0.5 * np.cos(phase), 0.5 * np.sin(phase), 3.0 + 0 * times], axis=1)
    assert motion.omega_body == pytest.approx(expected, abs=1e-13)


def test_corner_box_is_the_sum_over_its_corners():
    edges = np.array([1.0, 0.7, 0.4])
    corners = (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5) * edges
    square = np.sum(corners**2)
    expected = 0.3 / 8 * (square - np.sum(corners**2, axis=0))
    assert free_body.corner_box_inertia(0.3, edges) == pytest.approx(expected, rel=1e-14)


def test_bad_moments_are_named():
    with pytest.raises(ValueError, match=r"inertia\[1\] is 0\.0; it must be a positive number"):
        free_body.motion([1.0, 0.0, 2.0], [1.0, 1.0, 1.0], 0.0)
