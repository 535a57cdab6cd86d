"""Write agents to files in the format of `springgym.envs.agent`; `runs.policy_in` reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from config import NetworkConfig, PPOConfig
from sb3_contrib import TQC
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd

from springgym.cli import whole_file
from springgym.envs import agent
from springgym.envs.agent import STATISTICS, Algorithm


class HER(SAC):
    """SAC that also learns from goals it was not asked for, but reached (`config.HERConfig`)."""


#: Those of Stable-Baselines3.
ALGORITHMS: dict[Algorithm, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC, "tqc": TQC, "her": HER}

ADAM_EPSILON = 1e-5
"""Stable-Baselines3's for PPO. Adam is fused into one call: its steps are of a dozen small tensors."""

ACTIVATIONS: dict[str, type[torch.nn.Module]] = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
"""What stands between the layers of a network, by its name in configurations."""


def policy_kwargs(config: NetworkConfig) -> dict[str, Any]:
    """Return the settings of the networks, in the form that Stable-Baselines3's policies take."""
    kwargs: dict[str, Any] = {"net_arch": config.net_arch, "activation_fn": ACTIVATIONS[config.activation]}
    kwargs["optimizer_kwargs"] = {"fused": True}
    if isinstance(config, PPOConfig):
        kwargs["log_std_init"] = config.log_std_init
        kwargs["optimizer_kwargs"]["eps"] = ADAM_EPSILON
    return kwargs


def save_agent(path: Path, model: BaseAlgorithm) -> None:
    """Write what a model does, without what it needs to learn on."""
    (algo,) = (name for name, kind in ALGORITHMS.items() if type(model) is kind)
    tensors = model.policy.state_dict()
    arrays = {name: tensor.cpu().numpy() for name, tensor in tensors.items() if agent.acts(algo, name)}
    if normalize := model.get_vec_normalize_env():
        found = normalize.obs_rms
        limits = np.array([normalize.epsilon, normalize.clip_obs])
        parts = [found] if isinstance(found, RunningMeanStd) else [found[name] for name in sorted(found)]
        mean, variance = (np.concatenate([getattr(part, name) for part in parts]) for name in ("mean", "var"))
        arrays |= dict(zip(STATISTICS, (mean, variance, limits), strict=True))
    with whole_file(path) as temporary:
        np.savez(temporary, **arrays)
