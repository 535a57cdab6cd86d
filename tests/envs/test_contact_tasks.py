"""SpringFreeTop and SpringTumble: starts, actuators, observations and randomised contact."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.hard_cases import kept_by_nodes
from tests.envs.cases import make, make_vec, started
from tests.envs.test_contract import answered

PERIOD = 0.02
WEIGHT = np.array([0, 0, -7 * 9.81])  # of the tumbling body [N]


def particles_of(env):
    positions, velocities = env.unwrapped.episodes.particles
    return positions[0].copy(), velocities[0].copy()


def test_top_starts_with_its_weight_on_the_tip() -> None:
    """Nothing moves up or down for ten periods: N(h) = Mg at the start's height, to the vibration of the
    springs, whose strain under the weight is Mg/(k L) ~ 1e-4."""
    env = started("SpringFreeTop-v0", seed=0, options={"tilt": 0.0, "distance": 0.2})
    start, _ = particles_of(env)
    for _ in range(10):
        env.step(np.zeros(3))
        positions, _ = particles_of(env)
        assert np.abs(positions[:, 2] - start[:, 2]).max() < 1e-4
    assert np.abs(positions[:12, :2] - start[:12, :2]).max() > 0.1  # it spins


@pytest.mark.slow
def test_top_in_the_bowl_starts_on_the_tip() -> None:
    """The tip is as high above the bowl as above the floor."""
    heights = []
    for surface in ("floor", "bowl"):
        env = started("SpringFreeTop-v0", surface=surface, seed=0, options={"distance": 0.9})
        positions, _ = particles_of(env)
        heights.append(env.unwrapped.episodes.simulator.scene.surfaces[0].height(positions[13]))
    assert heights[1] == pytest.approx(heights[0], rel=1e-9)
    assert heights[0] > 0.005


def test_push_and_twist_on_ice() -> None:
    """M ΔV = F Δt exactly, the floor being all but frictionless, and Δω₃ = 8 rad/s² Δt, to the stretch by the
    spin. None at all would be compiled anew, for what μ = 0 does to the bit."""
    env = started("SpringFreeTop-v0", friction=1e-13, seed=0, options={"tilt": 0.0, "spin": 8.0})
    measures = env.unwrapped.episodes.measures
    _, _, _, _, info = env.step(np.array([1.0, -0.5, 1.0]))
    np.testing.assert_allclose(measures.momentum[0, :2], [40 * PERIOD, -20 * PERIOD], rtol=1e-9)
    assert info["spin"] == pytest.approx(8.0 + 8.0 * PERIOD, rel=1e-3)


def test_wrench_in_flight() -> None:
    """M ΔV = (F + Mg) Δt and ΔL = τ Δt."""
    env = started("SpringTumble-v0", seed=0)
    m = env.unwrapped.episodes.measures
    before = m.momentum[0].copy(), m.angular_momentum[0].copy()
    action = np.array([1.0, -1.0, 0.5, 0.2, -0.4, 1.0])
    env.step(action)
    gain = (35 * action[:3] + WEIGHT) * PERIOD
    np.testing.assert_allclose(m.momentum[0] - before[0], gain, rtol=1e-9)
    np.testing.assert_allclose(m.angular_momentum[0] - before[1], 9 * action[3:] * PERIOD, atol=1e-9)


def test_impulses_on_corners_in_flight() -> None:
    """M ΔV = Σ J + Mg Δt; ΔL = ∫ Σ r×F, by the trapezoidal rule over a turn of less than 0.15 rad."""
    env = started("SpringTumble-v0", action="impulses", seed=0)
    m = env.unwrapped.episodes.measures
    action = np.random.default_rng(0).uniform(-1, 1, 12)
    impulses = 0.175 * action.reshape(4, 3)
    before = (m.momentum[0].copy(), m.angular_momentum[0].copy())
    moments = []
    for step in range(2):
        positions, _ = particles_of(env)
        moments.append(np.cross(positions[:4] - m.centre[0], impulses).sum(axis=0))
        if step == 0:
            env.step(action)
    gain = m.momentum[0] - before[0]
    np.testing.assert_allclose(gain, impulses.sum(axis=0) + WEIGHT * PERIOD, rtol=1e-9)
    twist = m.angular_momentum[0] - before[1]
    np.testing.assert_allclose(twist, np.mean(moments, axis=0), atol=2e-4)
    assert np.abs(twist).max() > 0.02


@pytest.mark.parametrize("corner", range(4))
def test_wanted_corner_is_seen(corner: int) -> None:
    """By its direction, and by the outward normal of the face opposite to it."""
    seen = {}
    for observation in ("particles", "features"):
        env = make("SpringTumble-v0", observation=observation)
        seen[observation], _ = env.reset(seed=1, options={"corner": corner, "distance": 1.0})
        positions, _ = particles_of(env)
    centre = np.average(positions, axis=0, weights=[1.2, 1.0, 1.1, 1.3, 2.4])
    way = positions[corner] - centre
    np.testing.assert_allclose(seen["particles"][30:], way / np.linalg.norm(way), atol=1e-6)
    face = np.delete(positions[:4], corner, axis=0)
    normal = np.cross(face[1] - face[0], face[2] - face[0])
    normal *= np.sign(normal @ (face[0] - positions[corner])) / np.linalg.norm(normal)
    np.testing.assert_allclose(seen["features"][6:9], normal, atol=1e-6)
    goal = centre - seen["features"][:3]
    assert math.hypot(*goal[:2]) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(seen["particles"][:15].reshape(5, 3), (positions - goal) / 0.5, atol=1e-5)


def test_randomised_friction_and_restitution() -> None:
    """Copies that differ in friction alone part at the first touch; a lively one keeps more energy."""
    ranges = answered("SpringTumble-v0") | {"friction": (0.5, 2.0), "restitution": (0.5, 3.0)}
    envs = make_vec("SpringTumble-v0", 2, "native", "Disabled", randomize=ranges)
    for name, factors in (("friction", (0.5, 2.0)), ("restitution", (0.5, 3.0))):
        for n, factor in enumerate(factors):
            given = dict.fromkeys(ranges, 1.0) | {name: factor}
            mask = np.arange(2) == n
            options = {"randomize": given, "reset_mask": mask} if n else {"randomize": given}
            _, info = envs.reset(seed=[4, 4], options=options)
        assert info["randomization"][name][1] == factors[1]
        apart = []
        energies = []
        for _ in range(40):
            envs.step(np.zeros((2, 6)))
            positions, _ = envs.unwrapped.episodes.particles
            apart.append(np.abs(positions[1] - positions[0]).max())
            energies.append(envs.unwrapped.episodes.measures.energy.copy())
        touch = int(np.argmax(np.array(apart) > 0))
        assert 5 < touch < 30
        assert apart[-1] > 0.01
        if name == "restitution":
            dull, lively = energies[touch + 4]  # all corners that strike have left the floor
            assert lively > dull + 1.0  # J, of about 50


def test_restitution_above_one_is_refused() -> None:
    with pytest.raises(ValueError, match=r"restitution of 1\.5; it must be at most 1"):
        make("SpringFreeTop-v0", randomize={"restitution": (1, 3)})


def test_energy_drift_of_an_impact_is_that_of_the_steps() -> None:
    """Amid an impact the energy oscillates with the springs; what the steps keep of it does not."""
    env = make("SpringTumble-v0")
    simulator = env.unwrapped.episodes.simulator
    for seed in (0, 19, 31):
        _, info = env.reset(seed=seed)
        start = info["energy"]
        landed = False
        apart = info["energy"] - kept_by_nodes(simulator)[0]
        for _ in range(40):
            _, _, _, _, info = env.step(np.zeros(6, np.float32))
            landed |= info["energy"] < 0.9 * start
            more = info["energy"] - kept_by_nodes(simulator)[0] - apart
            assert abs(info["energy_drift"]) < 4e-3 * start
            assert abs(info["energy_drift"] - more) < 1e-4 * start
        assert landed
