"""Variants under ids of their own: each is its environment with its arguments, and keeps its promises."""

from __future__ import annotations

import json

import gymnasium as gym
import numpy as np
import pytest
from controllers import controllers_of, make_controller
from gymnasium.envs.registration import EnvSpec

from springgym.envs.registration import ENVIRONMENTS, VARIANTS, Variant, find
from tests.envs.cases import DUEL, make, make_vec
from tests.envs.playing import play
from tests.params import slow_unless

USUAL = ("SpringTopHard-v0", "SpringDetumbleFlat-v0", "SpringShoveSparse-v0")
"""What has an episode in every run; in the others' stead, that they are their environments with arguments."""

LEAST = {
    "SpringDuelStrong-v0": 0.15,  # the controller is the opponent, and wins one duel in two
    "SpringPendulumWeak-v0": 0.9,  # a reference
}
"""Least success rate of classical control in 16 episodes, for the variants in which it is not one half."""


@pytest.mark.parametrize(
    "variant", [pytest.param(own, id=own.id, marks=slow_unless(own.of != DUEL)) for own in VARIANTS]
)
def test_it_is_its_environment_with_its_arguments(variant: Variant) -> None:
    """The same episode to the bit, alone and in a batch, and from its spec."""
    ours = make(variant.id)
    theirs = make(variant.of, **variant.arguments)
    again = gym.make(EnvSpec.from_json(ours.spec.to_json()))
    batch = make_vec(variant.id, 2, "native", "SameStep")
    rng = np.random.default_rng(0)
    for env in (ours, theirs, again):
        env.reset(seed=3)
    batch.reset(seed=3)
    for _ in range(12):  # before the first episode ends
        action = rng.uniform(-1, 1, ours.action_space.shape).astype(np.float32)
        seen, reward, *_ = ours.step(action)
        assert ours.observation_space.contains(seen)
        rows, rewards, *_ = batch.step(np.repeat(action[None], 2, 0))
        for other in (theirs.step(action), again.step(action), (rows[0], rewards[0])):
            np.testing.assert_array_equal(other[0], seen)
            assert other[1] == reward


def test_names_are_told_apart() -> None:
    ids = [row.id for row in ENVIRONMENTS] + [variant.id for variant in VARIANTS]
    assert len(set(ids)) == len(ids)
    assert {variant.of for variant in VARIANTS} <= {row.id for row in ENVIRONMENTS}
    assert find("CartPole-v1") is None
    row, arguments = find("SpringGyroscopeHard-v0")  # type: ignore[misc]
    assert (row.id, arguments) == ("SpringGyroscope-v0", {"hard": True})
    json.dumps([variant.arguments for variant in VARIANTS])


@pytest.mark.parametrize(
    "variant", [pytest.param(own, id=own.id, marks=slow_unless(own.id in USUAL)) for own in VARIANTS]
)
def test_a_classical_controller_does_it_and_doing_nothing_does_not(variant: Variant) -> None:
    env = make(variant.id)
    idle = make_controller("noop", variant.id, {}, env.action_space)
    assert play(variant.id, idle, 16).successes.mean() <= 0.1
    assert controllers_of(variant.id)
    policy = make_controller("classical", variant.id, {}, env.action_space)
    played = play(variant.id, policy, 16, observation="features")
    assert played.successes.mean() >= LEAST.get(variant.id, 0.5)


def test_a_sparse_reward_is_whether_the_aim_is_met() -> None:
    dense = make("SpringTop-v0", observation="features")
    sparse = make("SpringTopSparse-v0", observation="features")
    act = make_controller("classical", "SpringTop-v0", {}, dense.action_space)
    observation, _ = dense.reset(seed=0)
    sparse.reset(seed=0)
    rewards = []
    for _ in range(400):
        action = act(observation[None])[0]
        observation, reward, *_, info = dense.step(action)
        same, alone, *_, told = sparse.step(action)
        np.testing.assert_array_equal(same, observation)
        met = info["tilt"] < 0.1 and info["precession"] < 0.3 and abs(info["spin"] - 50) < 3
        assert alone == met
        assert sum(value for name, value in told.items() if name.startswith("reward_")) == pytest.approx(
            reward
        )
        rewards.append(alone)
    assert set(rewards) == {0.0, 1.0}
