"""Agents to and from their file, see `springgym.envs.agent`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from config import Config, ConfigError, PPOConfig
from gymnasium import spaces
from stable_baselines3 import SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd

from springgym.cli import whole_file
from springgym.envs import agent
from springgym.envs.agent import STATISTICS, Network, Policy


def policy_kwargs(config: Config) -> dict[str, Any]:
    """What a configuration says of the networks, as Stable-Baselines3's policies take it."""
    activation = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}[config.activation]
    kwargs: dict[str, Any] = {"net_arch": config.net_arch, "activation_fn": activation}
    return kwargs | ({"log_std_init": config.log_std_init} if isinstance(config, PPOConfig) else {})


def save_agent(path: Path, model: BaseAlgorithm) -> None:
    """Write what a model does, without what it needs to learn on."""
    algo = "sac" if isinstance(model, SAC) else "ppo"
    tensors = model.policy.state_dict()
    arrays = {name: tensor.cpu().numpy() for name, tensor in tensors.items() if agent.acts(algo, name)}
    if normalize := model.get_vec_normalize_env():
        moments, limits = normalize.obs_rms, np.array([normalize.epsilon, normalize.clip_obs])
        assert isinstance(moments, RunningMeanStd)
        arrays |= dict(zip(STATISTICS, (moments.mean, moments.var, limits), strict=True))
    with whole_file(path) as temporary:
        np.savez(temporary, **arrays)


def load_agent(
    path: Path, config: Config, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
) -> Policy:
    """The deterministic policy in a file, see `springgym.envs.agent.load_agent`.

    Raises
    ------
    ConfigError
        If the file is damaged, or does not fit configuration and environment.
    """
    algo: Literal["ppo", "sac"] = "ppo" if isinstance(config, PPOConfig) else "sac"
    network = Network(algo, config.net_arch, config.activation, config.normalize)
    try:
        return agent.load_agent(path, network, observation_space, action_space)
    except ValueError as error:
        raise ConfigError(str(error)) from error
