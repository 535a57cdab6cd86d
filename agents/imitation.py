"""Imitation of classical control, with which PPO can begin.

The controller plays in the copies in which the agent will learn, with the noise that the agent will have, so
that the data also shows how it corrects mistakes. The policy is fitted to the controller's actions without
noise, and the critic to its returns. After that, PPO learns as usual.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from config import ConfigError, PPOConfig
from controllers import make_controller
from gymnasium import spaces
from runs import Run
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from springgym.envs.agent import Policy

EPOCHS = 20
"""Number of passes over the data."""

RATE = 1e-3
"""Initial learning rate; it falls linearly to 0."""

CRITIC = 0.05
"""Weight of the critic's error: returns are several units, actions one."""


def teacher(run: Run, space: spaces.Space[Any]) -> Policy:
    """Return the controller that an agent with these actions is to imitate.

    Raises
    ------
    ConfigError
        If the environment has none, or the agent does not see what it sees.
    """
    given = run.config.env_kwargs
    if given.get("observation") != "features":
        raise ConfigError(
            f"{run.env_id}: bc_steps: classical control needs the features, so the agent must "
            "observe them: set env_kwargs.observation=features"
        )
    return make_controller("classical", run.env_id, given, space)


def imitate(run: Run, model: PPO) -> int:
    """Let an untrained agent imitate classical control for ``bc_steps`` steps of all copies together.

    Returns
    -------
    environment steps that it took
    """
    config = run.config
    env = model.get_env()
    assert isinstance(config, PPOConfig)
    assert env is not None
    steps = config.bc_steps // config.n_envs
    fit(model, *played(model, env, teacher(run, env.action_space), steps, run.seed))
    return steps * config.n_envs


def played(model: PPO, env: VecEnv, controller: Policy, steps: int, seed: int) -> tuple[torch.Tensor, ...]:
    """Let the controller play; return what the agent sees (n, D), the actions (n, A), and returns (n,)."""
    normalize = model.get_vec_normalize_env()
    space = env.action_space
    assert isinstance(space, spaces.Box)
    rng = np.random.default_rng(seed)
    noise = math.exp(float(model.policy.log_std.detach().mean()))
    observations: Any = env.reset()
    seen = []
    wanted = []
    rewards = []
    ends = []
    for _ in range(steps):
        now: Any = normalize.get_original_obs() if normalize else observations
        actions = controller(now)
        seen.append(np.array(now))
        wanted.append(actions)
        noisy = actions + noise * rng.standard_normal(actions.shape)
        observations, reward, done, _ = env.step(np.clip(noisy, space.low, space.high).astype(np.float32))
        rewards.append(normalize.get_original_reward() if normalize else np.array(reward))
        ends.append(np.array(done))
    found: Any = np.concatenate(seen)
    given = np.array(rewards)
    if normalize:
        found = normalize.normalize_obs(found)
        given = normalize.normalize_reward(given)
    returns = np.zeros_like(given)
    after = np.zeros(given.shape[1])
    for n in reversed(range(steps)):
        after = given[n] + model.gamma * after * ~ends[n]
        returns[n] = after
    learned = (found, np.concatenate(wanted), returns.ravel())
    return tuple(torch.as_tensor(array, dtype=torch.float32) for array in learned)


def fit(model: PPO, seen: torch.Tensor, wanted: torch.Tensor, returns: torch.Tensor) -> None:
    """Bring the policy's means to what is ``wanted``, and the critic to the ``returns``; the noise stays."""
    policy = model.policy
    size = min(model.batch_size, len(seen))
    learned = [parameter for name, parameter in policy.named_parameters() if name != "log_std"]
    optimizer = torch.optim.Adam(learned, RATE)
    falls = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.0, EPOCHS * (len(seen) // size))
    for _ in range(EPOCHS):
        order = torch.randperm(len(seen))
        for n in range(0, len(seen) - size + 1, size):
            some = order[n : n + size]
            means = policy.get_distribution(seen[some]).mode()
            values = policy.predict_values(seen[some])[:, 0]
            loss = torch.mean((means - wanted[some]) ** 2)
            loss = loss + CRITIC * torch.mean((values - returns[some]) ** 2)
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            falls.step()
