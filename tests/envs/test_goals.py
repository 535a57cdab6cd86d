"""Observations that tell goals apart, and rewards computed from goals alone."""

from __future__ import annotations

import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_sb3

import springgym
from springgym.envs import goals
from springgym.envs.sb3 import make_sb3
from tests.envs.cases import IDS, hindsight_learner, make, make_vec, started, task_type
from tests.envs.test_contract import compare_with_sync
from tests.params import slow_but

WITH_GOALS = [env_id for env_id in IDS if task_type(env_id).goal_tolerances]
APART: dict[str, Any] = {"goals": True, "sparse": True}

NEAR: dict[str, tuple[dict[str, float], int]] = {
    "SpringGyroscope-v0": ({"angle": 0.099, "spin": 30.0}, 40),
    "SpringRope-v0": ({"distance": 0.0, "sway": 0.0}, 30),
    "SpringTumble-v0": ({"distance": 0.05}, 130),
    "SpringShove-v0": ({"distance": 0.05}, 10),
}
"""Reset options by which copies that do little reach their goal now and then, and in how many steps."""


def batch(env_id: str, copies: int, autoreset: str = "NextStep", **options: Any) -> Any:
    return make_vec(env_id, copies, "native", autoreset, **options)


each_with_goals = pytest.mark.parametrize("env_id", slow_but(WITH_GOALS, "SpringRope-v0", "SpringTumble-v0"))


@pytest.mark.usefixtures("small_pictures")
@each_with_goals
def test_checkers(env_id: str, capsys: pytest.CaptureFixture[str]) -> None:
    """SB3's sees that it is a ``GoalEnv``, and computes the reward again."""
    env = make(env_id, render_mode="rgb_array", **APART).unwrapped
    check_env(env)
    check_env_sb3(env)
    assert "We detected your env to be a GoalEnv" in capsys.readouterr().out


def check_rewards(apart: Any, sparse: Any, steps: int, reach: float, **options: Any) -> tuple[Any, Any]:
    """Step two batches alike, of which one tells goals apart: both are paid what the goals alone say.

    Return their last observations.
    """
    for envs in (apart, sparse):
        envs.reset(seed=0, options=dict(options))
    rng = np.random.default_rng(0)
    paid = []
    for _ in range(steps):
        actions = rng.uniform(-reach, reach, apart.action_space.shape).astype(np.float32)
        seen, reward, *_, infos = apart.step(actions)
        usual, other, *_, told = sparse.step(actions)
        np.testing.assert_array_equal(reward, other)
        again = apart.compute_reward(seen["achieved_goal"], seen["desired_goal"], {})
        np.testing.assert_array_equal(reward, again)
        np.testing.assert_array_equal(infos["is_success"], told["is_success"])
        assert apart.observation_space.contains(seen)
        paid.append(reward)
    assert 0 < np.mean(paid) < 1
    return seen, usual


@each_with_goals
def test_the_reward_is_the_sparse_one_and_that_of_the_goals(env_id: str) -> None:
    options, steps = NEAR[env_id]
    check_rewards(batch(env_id, 48, **APART), batch(env_id, 48, sparse=True), steps, 0.1, **options)


def test_the_rest_of_the_observation_does_not_tell_the_goal() -> None:
    """Two episodes that differ in nothing else are observed alike, and in the usual way differently."""
    for arguments, alike in ((APART, True), ({}, False)):
        env = make("SpringRope-v0", **arguments)
        seen = [env.reset(seed=0, options={"distance": distance})[0] for distance in (1.0, 2.0)]
        if alike:
            assert not np.array_equal(seen[0]["desired_goal"], seen[1]["desired_goal"])
            seen = [one["observation"] for one in seen]
        assert np.array_equal(*seen) == alike


@pytest.mark.parametrize("env_id", WITH_GOALS)
def test_a_goal_is_reached_within_each_of_its_aims(env_id: str) -> None:
    """What was achieved is what that goal asks for; just inside and just outside of each aim alone."""
    task = task_type(env_id)
    compute = goals.Goals(task.goal_tolerances).compute_reward
    rng = np.random.default_rng(0)
    first = 0
    achieved = rng.uniform(-1, 1, sum(aim.size for aim in task.goal_tolerances))
    assert compute(achieved, achieved, {}) == 1.0
    for aim in task.goal_tolerances:
        off = np.zeros_like(achieved)
        off[first : first + aim.size] = rng.normal(size=aim.size)
        off *= aim.within / np.linalg.norm(off)
        both = compute(np.stack([achieved] * 2), achieved + np.outer([1 - 1e-9, 1 + 1e-9], off), {})
        assert both.tolist() == [1.0, 0.0], aim.name
        first += aim.size


def test_the_face_of_the_tumbling_body_is_known_along_its_axes() -> None:
    """The angle by which the goal is missed is the one in ``info``, to a few times the strain."""
    envs = batch("SpringTumble-v0", 16, **APART)
    envs.reset(seed=1)
    for _ in range(60):
        seen, *_, infos = envs.step(np.zeros(envs.action_space.shape, np.float32))
        cosine = (seen["achieved_goal"][:, 2:5] * seen["desired_goal"][:, 2:5]).sum(axis=1)
        assert np.abs(cosine - np.cos(infos["angle"])).max() < 5 * infos["strain"].max() + 1e-12
    assert np.ptp(cosine) > 0.5


@pytest.mark.parametrize("autoreset", ["NextStep", "SameStep"])
def test_a_batch_equals_single_environments(autoreset: str) -> None:
    assert compare_with_sync("SpringRope-v0", autoreset, 30, 3, **APART) > 0


def test_states_hold_goals() -> None:
    """After a return to a state, and in a pickled copy, the same is seen and paid."""
    env = started("SpringGyroscope-v0", **APART, seed=0)
    state = springgym.get_state(env)
    action = np.ones(3, np.float32)
    expected = env.step(action)
    springgym.set_state(env, state)
    copied = pickle.loads(pickle.dumps(env.unwrapped))
    for again in (env.step(action), copied.step(action)):
        for name, values in expected[0].items():
            np.testing.assert_array_equal(values, again[0][name], strict=True)
        assert again[1] == expected[1]
    assert copied.compute_reward(values, values, {}) in (0.0, 1.0)
    with pytest.raises(ValueError, match="goals"):
        springgym.set_state(make("SpringGyroscope-v0", sparse=True), state)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="SpringTop has no goal"):
        make("SpringTop-v0", **APART)
    with pytest.raises(ValueError, match="give sparse=True, too"):
        make("SpringRope-v0", goals=True)
    with pytest.raises(ValueError, match="must be 'particles'"):
        make("SpringRope-v0", observation="features", **APART)
    with pytest.raises(TypeError, match="goals is 1; it must be True or False"):
        make("SpringRope-v0", goals=1)
    assert not hasattr(make("SpringRope-v0", sparse=True).unwrapped, "compute_reward")


@pytest.mark.parametrize(
    ("achieved", "desired", "error", "match"),
    [
        (np.zeros(3), np.zeros(3), ValueError, "achieved_goal is .* of shape"),
        (np.zeros(4), np.zeros((1, 4)), ValueError, "desired_goal has shape"),
        (np.zeros((2, 4)), np.zeros((3, 4)), ValueError, "desired_goal has shape"),
        (np.zeros((2, 2, 4)), np.zeros((2, 2, 4)), ValueError, "achieved_goal is .* of shape"),
        (np.full(4, np.nan), np.zeros(4), ValueError, "achieved_goal"),
        (np.zeros(4), np.full(4, np.inf), ValueError, "desired_goal"),
        (np.zeros(4, bool), np.zeros(4), TypeError, "array of numbers"),
        ("near", np.zeros(4), TypeError, "achieved_goal"),
        (None, np.zeros(4), TypeError, "achieved_goal"),
    ],
)
def test_goals_that_are_none_are_refused(achieved: Any, desired: Any, error: type, match: str) -> None:
    compute = goals.Goals(task_type("SpringRope-v0").goal_tolerances).compute_reward
    with pytest.raises(error, match=match):
        compute(achieved, desired, {})
    assert compute(np.zeros((0, 4)), np.zeros((0, 4)), {}).shape == (0,)
    assert compute([0, 0, 0, 0], np.zeros(4, np.float32), None) == 1.0


@pytest.mark.parametrize("native", slow_but([True, False], True))
def test_hindsight_of_stable_baselines3(native: bool) -> None:
    """Goals that were reached later are rewarded, though the one that was asked for never was."""
    options = {"max_episode_steps": 20, **APART}
    if native:
        env: Any = make_sb3("SpringRope-v0", 2, 0, env_kwargs=options)
    else:
        env = gym.make("SpringRope-v0", **options)
    model = hindsight_learner(env, 50, 64)
    model.learn(80)
    buffer: Any = model.replay_buffer
    assert buffer.rewards.sum() == 0
    assert buffer.sample(256).rewards.mean() > 0.05
