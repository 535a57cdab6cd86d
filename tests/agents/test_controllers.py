"""Controllers by name. That classical control does the tasks is tested in `tests/envs/test_baselines.py`."""

import config
import controllers
import gymnasium as gym
import numpy as np
import pytest


def test_zero_and_random():
    space = gym.spaces.Box(np.array([-1, 2], np.float32), np.array([1, 3], np.float32))
    observations = np.ones((500, 4), np.float32)
    noop = controllers.make_controller("noop", "Any-v0", {}, space)(observations)
    np.testing.assert_array_equal(noop, np.zeros((500, 2), np.float32))
    policy = controllers.make_controller("random", "Any-v0", {}, space)
    first = policy(observations)
    second = policy(observations)
    for actions in (first, second):
        assert actions.dtype == np.float32
        assert all(space.contains(action) for action in actions)
    np.testing.assert_allclose(first.mean(axis=0), [0, 2.5], atol=0.1)
    assert not np.array_equal(first, second)
    again = controllers.make_controller("random", "Any-v0", {}, space)(observations)
    np.testing.assert_array_equal(again, first)


def test_unknown_controller():
    space = gym.spaces.Box(-1, 1, (3,))
    with pytest.raises(config.ConfigError, match=r"SpringTop-v0 with action='force'; there is one"):
        controllers.make_controller("classical", "SpringTop-v0", {"action": "force"}, space)


def test_only_classical_control_asks_for_the_frame():
    assert controllers.controller_env_kwargs("classical", "SpringTop-v0", {}) == {"observation": "features"}
    assert controllers.controller_env_kwargs("classical", "Another-v0", {"size": 2}) == {"size": 2}
    assert controllers.controller_env_kwargs("noop", "SpringTop-v0", {"goals": True}) == {}
