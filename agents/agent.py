"""Write agents to files in the format of `springgym.envs.agent`; `runs.policy_in` reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from config import NetworkConfig, PPOConfig
from sb3_contrib import TQC, CrossQ
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd

from springgym.cli import whole_file
from springgym.envs import agent
from springgym.envs.agent import SQUASHED, STATISTICS, Algorithm


class HER(SAC):
    """SAC that also learns from goals it was not asked for, but reached (`config.HERConfig`)."""


#: Those of Stable-Baselines3.
ALGORITHMS: dict[Algorithm, type[BaseAlgorithm]] = {
    "ppo": PPO,
    "sac": SAC,
    "tqc": TQC,
    "crossq": CrossQ,
    "her": HER,
}

ADAM_EPSILON = 1e-5
"""Stable-Baselines3's for PPO. Adam is fused into one call: a step of it has a dozen small tensors."""

RENORM_EPSILON = 1e-3
"""CrossQ adds this to the variance."""


ACTIVATIONS: dict[str, type[torch.nn.Module]] = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
"""What stands between the layers of a network, by its name in configurations."""


def policy_kwargs(config: NetworkConfig) -> dict[str, Any]:
    """Return the settings of the networks, in the form that Stable-Baselines3's policies take."""
    kwargs: dict[str, Any] = {"net_arch": config.net_arch, "activation_fn": ACTIVATIONS[config.activation]}
    if isinstance(config, PPOConfig):
        kwargs |= {
            "log_std_init": config.log_std_init,
            "optimizer_kwargs": {"eps": ADAM_EPSILON, "fused": True},
        }
    return kwargs


def save_agent(path: Path, model: BaseAlgorithm) -> None:
    """Write what a model does, without what it needs to learn on."""
    (algo,) = (name for name, kind in ALGORITHMS.items() if type(model) is kind)
    tensors = model.policy.state_dict()
    arrays = {name: tensor.cpu().numpy() for name, tensor in tensors.items() if agent.acts(algo, name)}
    if algo == "crossq":
        arrays = _without_normalisation(arrays)
    if normalize := model.get_vec_normalize_env():
        found, limits = normalize.obs_rms, np.array([normalize.epsilon, normalize.clip_obs])
        parts = [found] if isinstance(found, RunningMeanStd) else [found[name] for name in sorted(found)]
        mean, variance = (np.concatenate([getattr(part, name) for part in parts]) for name in ("mean", "var"))
        arrays |= dict(zip(STATISTICS, (mean, variance, limits), strict=True))
    with whole_file(path) as temporary:
        np.savez(temporary, **arrays)


def _without_normalisation(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Replace the layers of CrossQ's actor by plain ones.

    A normalisation y = s (x − m)/√(v + ε) + t stands before each layer W y + b, and is made part of it:
    W' = W diag(s/√(v + ε)), b' = b + W (t − s m/√(v + ε)).
    """
    hidden, last = SQUASHED
    count = sum(name.endswith(".ra_mean") for name in arrays)
    plain = {}
    for n in range(count):  # normalisation, layer, activation, normalisation, …
        before = f"{hidden}.{3 * n}"
        layer, name = (f"{hidden}.{3 * n + 1}", f"{hidden}.{2 * n}") if n < count - 1 else (last, last)
        mean, variance, scale, shift = (
            arrays[f"{before}.{key}"].astype(float) for key in ("ra_mean", "ra_var", "scale", "bias")
        )
        gain, weight = scale / np.sqrt(variance + RENORM_EPSILON), arrays[f"{layer}.weight"].astype(float)
        plain[f"{name}.weight"] = (weight * gain).astype(np.float32)
        plain[f"{name}.bias"] = (arrays[f"{layer}.bias"] + weight @ (shift - gain * mean)).astype(np.float32)
    return plain
