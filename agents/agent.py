"""An agent as a file of plain numbers, ``agent.npz``: to evaluate, watch or share it, nothing is unpickled.

It holds the arrays of the policy by their names in PyTorch and, if observations are normalised, their
statistics. What the networks look like stands in the run's configuration, what they see and do in the
environment's spaces.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from config import Config, ConfigError, PPOConfig
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.sac.policies import SACPolicy

from springgym.cli import whole_file

#: Maps observations ``(n, ...)`` to actions ``(n, ...)``.
Policy = Callable[[np.ndarray], np.ndarray]

LARGEST = 1_000_000_000
"""Size of all arrays of an agent [bytes], at the most."""

STATISTICS = ("observations.mean", "observations.variance", "observations.limits")
"""Arrays by which observations are normalised. The limits are ε, added to the variance, and the largest
value that comes out."""


def policy_kwargs(config: Config) -> dict[str, Any]:
    """What a configuration says of the networks, as Stable-Baselines3's policies take it."""
    activation = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}[config.activation]
    kwargs: dict[str, Any] = {"net_arch": config.net_arch, "activation_fn": activation}
    return kwargs | ({"log_std_init": config.log_std_init} if isinstance(config, PPOConfig) else {})


def save_agent(path: Path, model: BaseAlgorithm) -> None:
    """Write what a model does, without what it needs to learn on."""
    arrays = {name: tensor.cpu().numpy() for name, tensor in model.policy.state_dict().items()}
    if normalize := model.get_vec_normalize_env():
        moments, limits = normalize.obs_rms, np.array([normalize.epsilon, normalize.clip_obs])
        assert isinstance(moments, RunningMeanStd)
        arrays |= dict(zip(STATISTICS, (moments.mean, moments.var, limits), strict=True))
    with whole_file(path) as temporary:
        np.savez(temporary, **arrays)


def load_agent(
    path: Path, config: Config, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
) -> Policy:
    """The deterministic policy in a file.

    Parameters
    ----------
    path
        The file.
    config
        With which it was trained.
    observation_space, action_space
        Of the environment it is to act in.

    Raises
    ------
    ConfigError
        If the file is damaged, or does not fit configuration and environment.
    """
    arrays = _read(path)
    make: type[BasePolicy] = ActorCriticPolicy if isinstance(config, PPOConfig) else SACPolicy
    policy = make(observation_space, action_space, lambda _: 0.0, **policy_kwargs(config))
    expected = {name: tuple(tensor.shape) for name, tensor in policy.state_dict().items()}
    if config.normalize:
        shape = tuple(observation_space.shape or ())
        expected |= dict(zip(STATISTICS, (shape, shape, (2,)), strict=True))
    if found := expected.keys() ^ arrays.keys():
        name = min(found)
        raise ConfigError(f"{path}: {name!r} is {'missing' if name in expected else 'not of such an agent'}")
    for name, shape in expected.items():
        array = arrays[name]
        if array.shape != shape or array.dtype.kind != "f" or not np.isfinite(array).all():
            raise ConfigError(
                f"{path}: {name!r} is {array.dtype}{list(array.shape)}; the environment and config.yaml ask "
                f"for finite numbers {list(shape)}"
            )
    statistics = [arrays.pop(name) for name in STATISTICS] if config.normalize else None
    weights = {name: torch.from_numpy(array.astype(np.float32)) for name, array in arrays.items()}
    policy.load_state_dict(weights)

    def act(observations: np.ndarray) -> np.ndarray:
        if statistics:
            mean, variance, (epsilon, largest) = statistics
            observations = (observations - mean) / np.sqrt(variance + epsilon)
            observations = np.clip(observations, -largest, largest).astype(np.float32)
        return policy.predict(observations, deterministic=True)[0]

    return act


def _read(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a file; it comes from anyone, and may be anything."""
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > LARGEST:
            raise ConfigError(f"{path}: its arrays are {size:g} bytes; an agent has at most {LARGEST:g}")
        with np.load(path, allow_pickle=False) as archive:
            arrays = dict(archive)
        if not all(isinstance(array, np.ndarray) for array in arrays.values()):
            raise ValueError("it holds other files")
        return arrays
    except ConfigError:
        raise
    except (OSError, ValueError, EOFError, KeyError, MemoryError, RuntimeError) as error:
        raise ConfigError(f"{path}: not the arrays of an agent: {error}") from error
    except (zipfile.BadZipFile, zlib.error, SyntaxError, NotImplementedError) as error:
        raise ConfigError(f"{path}: not the arrays of an agent: {error}") from error
