import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import jn_zeros

from springgym.theory import rope

# the paper's rope: beads of 0.1 kg and a load of 70 kg, here with uneven springs
MASSES = np.array([0.1] * 8 + [70.0])
REST = np.linspace(0.4, 0.6, 9)
STIFFNESS = np.linspace(0.8e5, 1.2e5, 9)


def spring_forces(points, rest, stiffness):
    """Force on every particle but the first from springs between neighbours, any dimension."""
    edge = np.diff(points, axis=0)
    length = np.linalg.norm(edge, axis=1)
    pull = (stiffness * (length - rest) / length)[:, None] * edge
    return np.vstack([pull[1:], np.zeros((1, points.shape[1]))]) - pull


def hanging(masses, rest, stiffness):
    depth = np.cumsum(rope.stretched_lengths(masses, rest, stiffness))
    return np.vstack([np.zeros(3), np.outer(-depth, [0.0, 0.0, 1.0])])


def test_hanging_rope_is_in_balance():
    force = spring_forces(hanging(MASSES, REST, STIFFNESS), REST, STIFFNESS)
    weight = np.outer(MASSES * 9.81, [0.0, 0.0, 1.0])
    # a length of eps * 4.5 m times k is 1e-10 N
    assert force == pytest.approx(weight, abs=5e-10)
    assert rope.tensions(MASSES)[[0, -1]] == pytest.approx([70.8 * 9.81, 70 * 9.81], rel=1e-14)


def test_modes_are_those_of_the_whole_rope():
    """Frequencies from a finite-difference Hessian in three dimensions: each swing twice."""
    points = hanging(MASSES, REST, STIFFNESS)
    n = len(MASSES)
    step = 1e-5
    hessian = np.empty((3 * n, 3 * n))
    for column in range(3 * n):
        moved = np.zeros(3 * n)
        moved[column] = step
        shift = np.vstack([np.zeros(3), moved.reshape(n, 3)])
        forces = (spring_forces(points + s * shift, REST, STIFFNESS) for s in (1, -1))
        hessian[:, column] = np.subtract(*forces).ravel() / (-2 * step)
    root = np.sqrt(np.repeat(MASSES, 3))
    measured = np.sqrt(np.linalg.eigvalsh(hessian / np.outer(root, root)))
    swing = rope.swing_modes(MASSES, REST, STIFFNESS).frequencies
    bounce = rope.bounce_modes(MASSES, STIFFNESS).frequencies
    expected = np.sort(np.concatenate([swing, swing, bounce]))
    # squares err by (step/l)^2 k/m = 1e-3 and by k eps l / step / m = 1e-4, in 1/s^2; the slowest
    # mode, whose mass is 70 kg, by a thousandth of that
    assert measured**2 == pytest.approx(expected**2, rel=1e-8, abs=5e-3)
    assert measured[0] == pytest.approx(expected[0], rel=1e-5)
    assert expected[-1] / expected[0] > 500


def test_shapes_are_modes():
    for modes, stiffness in (
        (rope.bounce_modes(MASSES, STIFFNESS), STIFFNESS),
        (
            rope.swing_modes(MASSES, REST, STIFFNESS),
            rope.tensions(MASSES) / rope.stretched_lengths(MASSES, REST, STIFFNESS),
        ),
    ):
        assert modes.shapes.T @ (MASSES[:, None] * modes.shapes) == pytest.approx(np.eye(9), abs=1e-12)
        stretch = np.diff(modes.shapes, axis=0, prepend=0.0)
        pull = stiffness[:, None] * stretch
        force = np.vstack([pull[1:], np.zeros(9)]) - pull
        expected = -MASSES[:, None] * modes.shapes * modes.frequencies**2
        assert force == pytest.approx(expected, abs=1e-11 * np.abs(expected).max())


def test_one_bead_is_a_pendulum_and_an_oscillator():
    assert rope.bounce_modes([2.0], 50.0).frequencies == pytest.approx([5.0])
    length = 1.0 + 2.0 * 9.81 / 50
    swing = rope.swing_modes([2.0], 1.0, 50.0).frequencies
    assert swing == pytest.approx([math.sqrt(9.81 / length)], rel=1e-14)


def test_fine_chain_swings_like_the_continuous_one():
    """omega_n = j_{0,n} / 2 sqrt(g/L) (Bernoulli); N equal beads approach it as 1/N."""
    exact = jn_zeros(0, 3) / 2 * math.sqrt(9.81 / 2.0)
    gaps = [
        rope.swing_modes(np.full(n, 1.0 / n), 2.0 / n, math.inf).frequencies[:3] / exact - 1
        for n in (200, 400)
    ]
    assert np.abs(gaps[1]).max() < 5e-3
    assert gaps[0] / gaps[1] == pytest.approx([2, 2, 2], rel=0.02)


@pytest.mark.parametrize("load", [0.0, 0.01, 0.5, 100.0])
def test_cable_bounces_at_the_lowest_root(load):
    """x tan x = m / M has one root below π/2, with or without a load."""
    x = rope.cable_bounce(load, 1.0, 1.0, 1.0, 1.0)
    assert 0 < x <= math.pi / 2
    assert load * x * math.sin(x) == pytest.approx(math.cos(x), abs=1e-15 * (1 + load))


def test_bounce_estimate_is_high_by_a_sixth_of_the_bead_mass():
    exact = rope.bounce_modes(np.array([0.1] * 9 + [70.0]), 1e5).frequencies[0]
    estimate = math.sqrt(1e5 / (10 * 70.0))  # of springs in series
    # sum of m (i/N)^2 = 0.285 kg, halved over 70 kg; next order is its square
    assert estimate / exact - 1 == pytest.approx(0.285 / 140, rel=0.02)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(0.5, 2.0), min_size=1, max_size=9),
    st.floats(3.0, 6.0),
    st.floats(-1.0, 1.0),
    st.sampled_from([1e3, 1e5, 1e8]),
)
def test_catenary_is_in_balance_and_reaches(masses, span, rise, stiffness):
    n = len(masses) + 1
    points, tensions = rope.catenary(span, rise, masses, 5.0 / n, stiffness)
    scale = tensions.max()
    assert points[0] == pytest.approx([0, 0])
    assert points[-1] == pytest.approx([span, rise], abs=1e-9)
    force = spring_forces(points, 5.0 / n, stiffness)[:-1]
    weight = np.outer(np.multiply(masses, 9.81), [0.0, 1.0])
    # lengths of 5 m are rounded at 1e-15, which k turns into a force
    assert force == pytest.approx(weight, abs=1e-9 * scale + 1e-13 * stiffness)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert stiffness * (length - 5.0 / n) == pytest.approx(tensions, abs=1e-9 * scale + 1e-14 * stiffness)


def test_fine_inextensible_catenary_is_a_cosh():
    """z = a cosh((x - s/2)/a) - a cosh(s/2a), length 2a sinh(s/2a); beads approach it as 1/N^2."""
    span = 2.0
    a = 0.9
    total = 2 * a * math.sinh(span / 2 / a)
    gaps = []
    for n in (100, 200):
        # a bead carries the rope of half a spring either side
        points, tensions = rope.catenary(span, 0.0, np.full(n - 1, 1.0 / n), total / n, math.inf)
        curve = a * np.cosh((points[:, 0] - span / 2) / a) - a * math.cosh(span / 2 / a)
        gaps.append(np.abs(points[:, 1] - curve).max())
        assert tensions.min() == pytest.approx(9.81 / total * a, rel=2e-3)
    assert points[:, 1].min() < -0.5
    assert gaps[1] < 2e-5
    assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.02)


def test_catenary_refuses_what_cannot_hang():
    with pytest.raises(ValueError, match=r"span is 0\.0; it must be a positive number"):
        rope.catenary(0.0, 1.0, [1.0], 1.0, 1e5)
    with pytest.raises(ValueError, match=r"inextensible rope of 2\.0 m cannot reach 2\.5 m"):
        rope.catenary(1.5, 2.0, [1.0], 1.0, math.inf)
    # the bead hangs below the right support, 1.8 m from the left one, on springs of 2.5 m
    with pytest.raises(ValueError, match="spring 0 goes slack"):
        rope.catenary(1.0, 1.0, [1.0], 2.5, 1e3)


def test_the_search_for_a_rope_as_long_as_its_way_ends():
    """By rounding it is longer than its way by 2e-16, and its tensions would rise beyond all numbers."""
    with pytest.raises(ValueError, match=r"so taut that its tension is more than 1e\+100 N"):
        rope.catenary(
            0.4728980303731746,
            0.0,
            [3.4263835324600183] * 3,
            [0.1182245075932937, *[0.11822450759329366] * 3],
            math.inf,
        )
