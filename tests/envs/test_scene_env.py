"""Environments over a user's own scene."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import springgym
from springgym.bodies import cube
from springgym.measures import Measures
from springgym.scene import Scene, ThrustActuator


def lifted(m: Measures, x: np.ndarray, v: np.ndarray, action: np.ndarray) -> np.ndarray:
    return m.centre[:, 2]


def kicked(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    positions = cube().positions
    return positions, rng.normal(size=3) + np.zeros_like(positions)


def make(**options: Any) -> Any:
    scene = Scene(cube(), gravity=None, thrust=ThrustActuator((1, 6)))
    settings = {"reward": lifted, "actuators": {"torque": 2.0, "thrust": 1.0}, "start": kicked}
    return springgym.make_scene_env(scene, **(settings | options))


def test_checker() -> None:
    env = make(render_mode="rgb_array")
    check_env(env.unwrapped, skip_render_check=True)  # which wants a registered id
    env.reset(seed=0)
    assert env.render().std() > 0


def test_reward_and_end_are_the_users() -> None:
    env = make(failed=lambda m, x, v: m.centre[:, 2] > 0.5, max_episode_steps=50)
    env.reset(seed=0)
    up = np.array([0, 0, 0, 0, 0, 1, 0, 0, 1], np.float32)
    start = env.unwrapped.episodes.measures.momentum[0, 2]
    step, terminated, truncated = 0, False, False
    while not (terminated or truncated):
        _, reward, terminated, truncated, info = env.step(up)
        step += 1
    assert terminated
    assert reward == info["reward_own"] == env.unwrapped.episodes.measures.centre[0, 2]
    # Both thrusters push the cube of 1 kg up with 1 N: it gains 2 m/s² over step × 20 ms.
    gained = env.unwrapped.episodes.measures.momentum[0, 2] - start
    assert gained == pytest.approx(2.0 * step * 0.02, rel=1e-9)


def test_batch_equals_single() -> None:
    env, envs = make(), make(num_envs=3)
    first, _ = env.reset(seed=1)
    batch, _ = envs.reset(seed=[0, 1, 2])
    np.testing.assert_array_equal(batch[1], first)
    action = np.linspace(-1, 1, 9, dtype=np.float32)
    for _ in range(5):
        single, many = env.step(action), envs.step(np.tile(action, (3, 1)))
        np.testing.assert_array_equal(many[0][1], single[0])
        assert many[1][1] == single[1]


def test_shipped_scene_by_name() -> None:
    env = springgym.make_scene_env("cube-pendulum", lifted, actuators={"torque": 1.0})
    env.reset(seed=0)
    _, reward, *_ = env.step(np.ones(3, np.float32))
    assert np.isfinite(reward)


def test_wrong_actuators() -> None:
    with pytest.raises(ValueError, match="a name in actuators is 'wind'; it must be one of"):
        make(actuators={"wind": 1.0})
    with pytest.raises(ValueError, match="has 'acceleration', but the scene has nothing that it could drive"):
        make(actuators={"acceleration": 1.0})


def test_scaled_scene_starts_unstrained() -> None:
    """The start is scaled with the springs, about the centre of mass, which moves as it did."""
    env = make(randomize={"scale": (0.5, 2.0)})
    starts = []
    for scale in (1.0, 1.5):
        _, info = env.reset(seed=3, options={"randomize": {"scale": scale}})
        assert info["strain"] < 1e-12
        starts.append((*(values[0].copy() for values in env.unwrapped.episodes.particles),))
    (x, v), (scaled_x, scaled_v) = starts
    centre = x.mean(axis=0)  # its masses are equal
    np.testing.assert_allclose(scaled_x - centre, 1.5 * (x - centre), atol=1e-12)
    np.testing.assert_allclose(scaled_v, v, atol=1e-12)  # it flies without turning
