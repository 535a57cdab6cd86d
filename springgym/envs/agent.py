"""A trained agent as a file of plain arrays, ``agent.npz``, which NumPy reads without unpickling.

The agent consists of fully connected layers, as the algorithms of Stable-Baselines3 train them, or of one
layer, which is linear control. The file holds their arrays by their names in PyTorch and, if observations are
normalised, their statistics. The run's configuration describes the layers, and the environment's spaces
describe their input and output.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from gymnasium import spaces

from springgym.checks import unreadable

__all__ = [
    "LARGEST",
    "LAYERS",
    "MOST",
    "SEEN",
    "STATISTICS",
    "Algorithm",
    "Network",
    "Policy",
    "acts",
    "alone",
    "joined",
    "load_policy",
]

Policy = Callable[[Any], np.ndarray]
"""Maps observations (n, …) to actions (n, …). Observations with goals are a dict of such arrays."""

Algorithm = Literal["ppo", "sac", "tqc", "her", "linear", "iql"]
"""The algorithm that trained an agent."""

LARGEST = 1_000_000_000
"""Largest size of all arrays of an agent [bytes]."""

MOST = 1e38
"""Largest number in the layers for any observation: float32 ends at 3.4e38."""

SEEN = 1e6
"""Largest observation that is assumed where the space has no bounds."""

STATISTICS = ("observations.mean", "observations.variance", "observations.limits")
"""Arrays by which observations are normalised. The limits are ε, added to the variance, and the largest
normalised value."""

CLIPPED = ("mlp_extractor.policy_net", "action_net")
SQUASHED = ("actor.latent_pi", "actor.mu")
LAYERS: dict[str, tuple[str, str]] = {
    **dict.fromkeys(("ppo", "linear"), CLIPPED),
    **dict.fromkeys(("sac", "tqc", "her", "iql"), SQUASHED),
}
"""Names in PyTorch of the layers that act, by algorithm. First the hidden ones, then the last. Outputs of the
first kind are clipped to the action space, those of the second squashed into it."""

ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
}


@dataclass(frozen=True)
class Network:
    """The configuration of the layers that compute actions."""

    algo: Algorithm
    net_arch: list[int] = field(default_factory=list)
    """widths of the hidden layers"""
    activation: Literal["tanh", "relu"] = "tanh"
    normalize: bool = False
    """whether their inputs are normalised observations"""


def acts(algo: str, name: str) -> bool:
    """Return whether an array of a Stable-Baselines3 policy is needed to act; others serve learning."""
    return name.rpartition(".")[0].startswith(LAYERS[algo])


def load_policy(
    path: Path, network: Network, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
) -> Policy:
    """Return the deterministic policy in a file; it takes observations (n, …), or a single one.

    Parameters
    ----------
    path
        The file. Files from others are safe, as nothing in them is executed.
    network
        The configuration of the network.
    observation_space, action_space
        The spaces of the environment in which the agent will act.

    Raises
    ------
    ValueError
        If the file is damaged, or does not fit the network and the environment.
    """
    if isinstance(observation_space, spaces.Dict) and all(
        isinstance(own, spaces.Box) and len(own.shape) == 1 for own in observation_space.values()
    ):
        act_on_all = load_policy(path, network, joined(observation_space), action_space)
        return _of_parts(act_on_all, observation_space)
    if not isinstance(observation_space, spaces.Box) or not isinstance(action_space, spaces.Box):
        raise ValueError(f"{path}: agents need spaces of numbers, not {observation_space} and {action_space}")
    arrays = _read(path)
    layers = _layers(network, observation_space, action_space)
    expected: dict[str, tuple[int, ...]] = {}
    for weight, bias, shape in layers:
        expected |= {weight: shape, bias: shape[:1]}
    if network.normalize:
        seen = observation_space.shape
        expected |= dict(zip(STATISTICS, (seen, seen, (2,)), strict=True))
    if found := expected.keys() ^ arrays.keys():
        name = min(found)
        raise ValueError(f"{path}: {name!r} is {'missing' if name in expected else 'unknown'}")
    for name, shape in expected.items():
        array = arrays[name]
        if array.shape != shape or array.dtype.kind != "f" or not np.isfinite(array).all():
            raise ValueError(
                f"{path}: {name!r} is {array.dtype}{list(array.shape)}; the environment and config.yaml "
                f"require finite numbers {list(shape)}"
            )
    reach = float(np.minimum(np.abs([observation_space.low, observation_space.high]), SEEN).max())
    if network.normalize:
        reach = _reach_of_statistics(path, *(arrays[name] for name in STATISTICS[1:]))
    _check_reach(path, [(arrays[weight], arrays[bias]) for weight, bias, _ in layers], network, reach)
    single = {name: arrays[name].astype(np.float32) for name in expected}
    weights = [(single[weight].T, single[bias]) for weight, bias, _ in layers]
    activation = ACTIVATIONS[network.activation]
    low = action_space.low
    high = action_space.high

    def act(observations: np.ndarray) -> np.ndarray:
        if np.shape(observations) == observation_space.shape:
            return act(np.asarray(observations)[None])[0]
        if network.normalize:
            mean, variance, (epsilon, largest) = (arrays[name] for name in STATISTICS)
            observations = np.clip((observations - mean) / np.sqrt(variance + epsilon), -largest, largest)
        x = observations.reshape(len(observations), -1).astype(np.float32)
        for weight, bias in weights[:-1]:
            x = activation(x @ weight + bias)
        weight, bias = weights[-1]
        actions = (x @ weight + bias).reshape(-1, *action_space.shape)
        if LAYERS[network.algo] is SQUASHED:  # to (−1, 1), whatever the space
            return np.asarray(low + 0.5 * (np.tanh(actions) + 1.0) * (high - low), np.float32)
        return np.clip(actions, low, high)

    return act


def joined(space: spaces.Dict) -> spaces.Box:
    """Return the space of the numbers of all entries, one after another, in the order of their names."""
    low, high = (
        np.concatenate([getattr(own, end) for own in space.values()], dtype=np.float32)
        for end in ("low", "high")
    )
    return spaces.Box(low, high)


def alone(observation: Any) -> Any:
    """Return an observation, or each entry of a dict of them, as a batch of one."""
    if isinstance(observation, dict):
        return {name: alone(own) for name, own in observation.items()}
    return observation[None]


def _of_parts(act: Policy, space: spaces.Dict) -> Policy:
    """Return a policy for observations with several entries, from one for their concatenated numbers."""

    def of_parts(observations: Any) -> np.ndarray:
        return act(np.concatenate([observations[name] for name in space], axis=-1, dtype=np.float32))

    return of_parts


def _reach_of_statistics(path: Path, variance: np.ndarray, limits: np.ndarray) -> float:
    """Return the largest normalised number."""
    epsilon, largest = limits.tolist()
    if not (variance >= 0).all() or not epsilon > 0 or not 0 < largest < MOST:
        raise ValueError(
            f"{path}: variances from {variance.min():g}, with {epsilon:g} added, and a largest value of "
            f"{largest:g} cannot normalise: the variances must not be negative, "
            "and the others must be positive"
        )
    return float(largest)


def _check_reach(
    path: Path, weights: list[tuple[np.ndarray, np.ndarray]], network: Network, reach: float
) -> None:
    """Raise ValueError if sums of layers may overflow for inputs up to ``reach`` in size."""
    for weight, bias in weights:
        with np.errstate(over="ignore"):
            sums = np.abs(weight, dtype=float).sum(axis=1) * reach + np.abs(bias, dtype=float)
        reach = float(sums.max(initial=0.0))
        if not reach < MOST:
            raise ValueError(
                f"{path}: weights up to {np.abs(weight).max():g} are too large: the output of a layer may "
                f"reach {reach:g}, and must stay below {MOST:g}"
            )
        reach = min(reach, 1.0) if network.activation == "tanh" else reach


def _layers(
    network: Network, observation_space: spaces.Box, action_space: spaces.Box
) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return names of weight and bias of each layer, and the shape of the weight."""
    hidden, last = LAYERS[network.algo]
    names = [f"{hidden}.{2 * n}" for n in range(len(network.net_arch))]  # activations are in between
    sizes = [int(np.prod(observation_space.shape)), *network.net_arch, int(np.prod(action_space.shape))]
    return [
        (f"{name}.weight", f"{name}.bias", (after, before))
        for name, before, after in zip([*names, last], sizes[:-1], sizes[1:], strict=True)
    ]


def _read(path: Path) -> dict[str, np.ndarray]:
    """Read the arrays of a file, which may be of any kind."""
    try:
        if why := unreadable(path, LARGEST):
            raise ValueError(why)
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > LARGEST:
            raise ValueError(f"its arrays are {size:g} bytes; an agent has at most {LARGEST:g}")
        with np.load(path, allow_pickle=False) as archive:
            arrays = dict(archive)
        if not all(isinstance(array, np.ndarray) for array in arrays.values()):
            raise ValueError("it holds other files")
        return arrays
    except Exception as error:  # any file may be given
        why = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: the file does not hold the arrays of an agent: {why}") from error
