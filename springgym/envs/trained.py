"""Trained agents: those in the package, and those in run folders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from os.path import isfile
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym

from springgym.checks import shown
from springgym.envs.agent import Algorithm, Network, Policy, load_policy
from springgym.envs.registration import nearest_id, spec_of
from springgym.envs.scripts import AGENTS
from springgym.scenes.strict_yaml import YamlError, build, read_json, read_yaml

__all__ = ["PUBLISHED", "Agent", "Trained", "checksum", "load_agent", "published"]

PUBLISHED = AGENTS / "trained"
"""Folder of published agents, one folder per environment, written by ``agents/studies/publish.py``."""


class Agent(NamedTuple):
    """A trained agent, and the environment in which it acts."""

    name: str
    env_id: str
    env_kwargs: dict[str, Any]
    policy: Callable[[gym.Env], Policy]
    """makes the policy for an environment: from observations (n, …), or one of them, to actions"""

    def make(self, **options: object) -> gym.Env:
        """Make the environment that the agent was trained for; ``options`` are added to its arguments."""
        return gym.make(self.env_id, **(self.env_kwargs | options))


@dataclass(frozen=True)
class Trained:
    """The contents of the ``config.yaml`` of a run folder."""

    algo: Algorithm
    env_id: str
    seed: int
    config: dict[str, Any]


def load_agent(agent: str | Path) -> Agent:
    """Load a published agent by the id of its environment, or an agent of your own by its run folder.

    This needs neither PyTorch nor Stable-Baselines3. Nothing is unpickled, so you can load a run folder of
    somebody else. If the environment's id has the form ``module:ID``, `Agent.make` imports the module.

    Parameters
    ----------
    agent
        An id, as "SpringTop-v0", or a run folder, as "runs/SpringTop-v0-ppo-0".

    Raises
    ------
    TypeError
        If it is neither a string nor a path.
    ValueError
        If there is no such agent, or one of its files is damaged.

    Examples
    --------
    >>> agent = springgym.load_agent("SpringTop-v0")
    >>> env = agent.make(render_mode="rgb_array")
    >>> policy = agent.policy(env)
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step(policy(observation))
    """
    if not isinstance(agent, (str, Path)):
        raise TypeError(f"agent is {agent!r}; it must be an environment id or a run folder")
    folder = Path(agent)
    if not isfile(folder / "config.yaml"):
        folder = published(str(agent))
    tree = read_yaml(folder / "config.yaml")
    run: Trained = build(Trained, tree)
    others = tuple(key for key in run.config if key not in Network.__dataclass_fields__)
    network: Network = build(Network, tree, ("config",), skip=others, algo=run.algo)
    path = folder / "agent.npz"

    def policy(env: gym.Env) -> Policy:
        if not path.exists():
            raise ValueError(f"{folder} has no agent.npz yet: its training has not reached a checkpoint")
        return load_policy(path, network, env.observation_space, env.action_space)

    kwargs: dict[str, Any] = {}
    for name in ("env_kwargs", "eval_env_kwargs"):
        arguments = run.config.get(name, {})
        if not isinstance(arguments, dict):
            raise YamlError(f"{folder / 'config.yaml'}: {name} is {shown(arguments)}; it must be a mapping")
        kwargs |= arguments
    return Agent(folder.name, run.env_id, kwargs, policy)


def published(env_id: str, within: Path = PUBLISHED) -> Path:
    """Return the folder of the published agent of an environment, after checking the checksums on its card.

    Raises
    ------
    ValueError
        If there is no such agent, or one of its files was changed.
    """
    cards = {path.parent.name: path for path in sorted(within.glob("*/card.json"))}
    if env_id not in cards:
        if nearest_id(env_id):
            spec_of(env_id)  # whose error suggests ids if there is no such id
        raise YamlError(
            f"{shown(env_id)} is neither a run folder nor a published agent; published "
            f"agents are {', '.join(cards) or 'none'}"
        )
    folder = cards[env_id].parent
    try:
        sums = read_json(cards[env_id])["sha256"]
        changed = [name for name, told in sums.items() if checksum(folder / name) != told]
    except (KeyError, TypeError, AttributeError) as error:
        raise YamlError(f"{cards[env_id]}: the file is not the card of an agent: {error!r}") from error
    if changed:
        raise YamlError(f"{folder / changed[0]}: the file differs from the published one")
    return folder


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return sha256(path.read_bytes()).hexdigest()
