"""Steady play: copies of an environment take random actions, each at another age of its episode.

Just after a reset all copies are alike: balls are at rest, tops have not met. A user meets what comes later.
So the clocks of n copies start at fractions i/n of the time limit, and all play for one time limit before
anything counts. Episodes that last as long as they may are then spread evenly; shorter ones have been
followed by others many times.
"""

from __future__ import annotations

from math import ceil
from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.errors import batch


def fractions(limit: int, copies: int) -> np.ndarray:
    """Return the steps that the clocks of the copies start with: fractions i/n of the time limit."""
    return np.arange(copies) * limit // copies


class RandomPlay:
    """Random actions in a batch of environments that has been reset.

    `begin` draws the actions of the next ``steps`` steps, and `run` takes these steps.
    """

    def __init__(self, envs: Any, copies: tuple[int, ...], steps: int) -> None:
        self.envs = envs
        self.shape = (steps, *copies)
        self.rng = np.random.default_rng(0)
        self.actions = np.zeros(0)

    def begin(self) -> None:
        """Draw the actions of the next run."""
        self.actions = self.rng.uniform(-1, 1, self.shape).astype(np.float32)

    def run(self) -> None:
        """Take steps."""
        for action in self.actions:
            self.envs.step(action)

    def warmed(self, limit: int) -> RandomPlay:
        """Play for as many steps as the time limit has, and return this object."""
        for _ in range(ceil(limit / self.shape[0])):
            self.begin()
            self.run()
        return self


class SinglePlay(RandomPlay):
    """Random actions in one environment, which is reset where an episode ends."""

    def run(self) -> None:
        for action in self.actions:
            _, _, terminated, truncated, _ = self.envs.step(action)
            if terminated or truncated:
                self.envs.reset()


def single(env_id: str, **options: Any) -> SinglePlay:
    """Return an environment as `gymnasium.make` gives it.

    A run takes as many steps as the time limit has, and so has episodes of every age.
    """
    env = gym.make(env_id, **options)
    env.reset(seed=0)
    limit = limit_of(env)
    play = SinglePlay(env, env.action_space.shape or (), max(limit, 20))
    play.warmed(limit)
    return play


def native(env_id: str, copies: int, **options: Any) -> RandomPlay:
    """Return a native batch in steady play; a run takes 2 steps."""
    envs = batch(env_id, copies, **options)
    envs.reset(seed=0)
    episodes = envs.unwrapped.episodes
    limit = episodes.max_episode_steps
    episodes.elapsed[:] = fractions(limit, copies)
    return RandomPlay(envs, envs.action_space.shape or (), 2).warmed(limit)


def synchronous(env_id: str, copies: int, **options: Any) -> RandomPlay:
    """Return Gymnasium's `SyncVectorEnv` in steady play; a run takes 2 steps."""
    envs: Any = gym.make_vec(env_id, num_envs=copies, vectorization_mode="sync", **options)
    envs.reset(seed=0)
    limit = limit_of(envs.envs[0])
    envs.set_attr("_elapsed_steps", fractions(limit, copies).tolist())  # of Gymnasium's `TimeLimit`
    return RandomPlay(envs, envs.action_space.shape or (), 2).warmed(limit)


def adapted(env_id: str, copies: int, **options: Any) -> RandomPlay:
    """Return the adapter for Stable-Baselines3 in steady play; a run takes 2 steps."""
    from springgym.envs.sb3 import make_sb3

    envs = make_sb3(env_id, copies, 0, stagger=True, env_kwargs=options)
    envs.reset()
    limit = envs.unwrapped.vector_env.episodes.max_episode_steps  # type: ignore[attr-defined]
    return RandomPlay(envs, (copies, *(envs.action_space.shape or ())), 2).warmed(limit)


def limit_of(env: gym.Env[Any, Any]) -> int:
    """Return the time limit of an environment that `gymnasium.make` gave [steps]."""
    assert env.spec is not None
    assert env.spec.max_episode_steps is not None
    return env.spec.max_episode_steps
