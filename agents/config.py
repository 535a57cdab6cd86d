"""Hyperparameters: YAML files keyed by environment id, read strictly.

``configs/<algo>.yaml`` maps environment ids to the fields of a dataclass below.
The entry ``default`` holds for all other ids. An unknown, duplicate or missing key, or a value of the wrong
type, raises a `ConfigError` that names file, line and key.
"""

from __future__ import annotations

import argparse
import copy
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import Any, Literal

import gymnasium as gym

from springgym.cli import Parser, check_new
from springgym.envs.agent import Algorithm
from springgym.envs.registration import UnknownEnvironment, find, spec_of
from springgym.scenes.strict_yaml import Tree, YamlError, build, parse_yaml, read_yaml

ConfigError = YamlError
CONFIG_FOLDER = Path(__file__).resolve().parent.parent / "configs"


@contextmanager
def making(env_id: str) -> Iterator[None]:
    """Turn what an environment that is made here complains of, its name or its arguments, into a
    `ConfigError`."""
    try:
        yield
    except UnknownEnvironment:
        raise
    except (TypeError, ValueError, ArithmeticError, MemoryError, ImportError, gym.error.Error) as error:
        raise ConfigError(f"{env_id}: {str(error) or 'not enough memory'}") from error


#: What the scripts tell in a line, see `springgym.cli.guarded`.
MENDABLE = (ConfigError, OSError, MemoryError, gym.error.Error)


def add_overrides(parser: argparse.ArgumentParser, what: str = "arguments of the environment") -> None:
    """Declare the option ``--set KEY=VALUE …`` of a script; it may be given several times."""
    parser.add_argument(
        "--set", dest="overrides", metavar="KEY=VALUE", nargs="+", action="extend", default=[], help=what
    )


def number(low: float, high: float) -> Callable[[str], float]:
    """Return a function that reads an argument of a command as a number from ``low`` to ``high``."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} must be a number from {low} to {high}")
        return value

    return parse


def new_file(*endings: str) -> Callable[[str], Path]:
    """Return a function that reads an argument of a command as the path of a file to write."""

    def parse(text: str) -> Path:
        try:
            check_new(path := Path(text), endings)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
        return path

    return parse


def check_result(path: Path) -> None:
    """Raise ConfigError unless a file of results can be written, before the work of hours."""
    try:
        check_new(path)
    except ValueError as error:
        raise ConfigError(str(error)) from error


def command_line(description: str | None, program: str | None = None) -> Parser:
    """Return an argument parser, still empty, whose help keeps the line breaks of the ``description``."""
    return Parser(program, description=description, formatter_class=argparse.RawDescriptionHelpFormatter)


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return a function that reads an argument of a command as a whole number from ``low`` to ``high``."""

    def parse(text: str) -> int:
        try:
            value = float(text)  # exact up to 2⁵³, and takes 1e5
        except ValueError:
            value = math.nan
        if not (low <= value <= high and value.is_integer()):
            raise argparse.ArgumentTypeError(f"{text!r} must be a whole number from {low} to {high}")
        return int(value)

    return parse


@dataclass(frozen=True, kw_only=True)
class Config:
    """The settings that every algorithm needs. ``env_kwargs`` go to the environment, in evaluation too, where
    ``eval_env_kwargs`` are added."""

    total_timesteps: int
    seconds: float = 0.0
    """of learning, instead of ``total_timesteps``; 0 for as many steps as that"""
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    eval_env_kwargs: dict[str, Any] = field(default_factory=dict)

    def share_done(self, steps: int, seconds: float) -> float:
        """Return the share of a run that is done after so many steps and seconds of learning."""
        return min(seconds / self.seconds if self.seconds else steps / self.total_timesteps, 1.0)


@dataclass(frozen=True, kw_only=True)
class NetworkConfig(Config):
    """The settings that algorithms with neural networks need."""

    batch_size: int
    learning_rate: float
    gamma: float
    net_arch: list[int]
    activation: Literal["tanh", "relu"]
    normalize: bool = False


@dataclass(frozen=True, kw_only=True)
class SB3Config(NetworkConfig):
    """The settings that algorithms of Stable-Baselines3 need.

    Rows of ``metrics.csv`` and checkpoints are written whenever ``log_every`` and ``checkpoint_every``
    environment steps have passed.
    """

    n_envs: int
    anneal: bool = False
    """whether the learning rate falls to 0 in a straight line"""
    log_every: int = 4096
    checkpoint_every: int = 32768


@dataclass(frozen=True, kw_only=True)
class PPOConfig(SB3Config):
    """Proximal policy optimisation (Schulman et al. 2017, arXiv:1707.06347)."""

    n_steps: int
    n_epochs: int
    gae_lambda: float
    log_std_init: float
    ent_coef: float = 0.0
    bc_steps: int = 0
    """steps, of the total, in which classical control plays and is imitated, see imitation.py"""


@dataclass(frozen=True, kw_only=True)
class SACConfig(SB3Config):
    """Soft actor-critic (Haarnoja et al. 2018, arXiv:1812.05905)."""

    buffer_size: int
    learning_starts: int
    gradient_steps: int
    """number of updates after each step of all copies"""
    tau: float


@dataclass(frozen=True, kw_only=True)
class TQCConfig(SACConfig):
    """Truncated quantile critics (Kuznetsov et al. 2020, arXiv:2005.04269)."""

    dropped_quantiles: int = 2
    """of each network's 25, the largest"""


@dataclass(frozen=True, kw_only=True)
class HERConfig(SACConfig):
    """SAC with hindsight experience replay (Andrychowicz et al. 2017, arXiv:1707.01495).

    The environment must tell goals apart (``env_kwargs: {goals: true, sparse: true}``).
    """

    relabelled: int = 4
    """transitions with a goal that was reached later in the episode, to one with the goal that was asked"""


@dataclass(frozen=True, kw_only=True)
class LinearConfig(Config):
    """Linear control found by the cross-entropy method (Szita & Lőrincz 2006,
    doi:10.1162/neco.2006.18.12.2936). Each of ``population`` policies plays the same ``episodes`` episodes;
    the best ``elites`` set mean and spread of the next ones, and ``extra_spread`` is added, less and less.
    """

    population: int
    elites: int
    episodes: int
    spread: float
    """of the first policies' weights"""
    extra_spread: float


@dataclass(frozen=True, kw_only=True)
class IQLConfig(NetworkConfig):
    """Implicit Q-learning from data alone (Kostrikov et al. 2021, arXiv:2110.06169), see offline.py.

    It takes no steps, so ``total_timesteps`` counts updates.
    """

    data: list[str] = field(default_factory=list)
    """names of Minari data sets"""
    tau: float
    expectile: float
    """which expectile of the returns of the data's actions is the value of a state: 0.5 is their mean, and
    towards 1 it is the return of the best action"""
    temperature: float
    """factor t in the weight exp(t A) with which an action of advantage A is imitated: with 0, all weigh the
    same"""


CONFIG_OF: dict[Algorithm, type[Config]] = {
    "ppo": PPOConfig,
    "sac": SACConfig,
    "tqc": TQCConfig,
    "her": HERConfig,
    "linear": LinearConfig,
    "iql": IQLConfig,
}
ONLINE = tuple(algo for algo, kind in CONFIG_OF.items() if kind is not IQLConfig)
"""Algorithms that learn from episodes which they play."""

RANGES = {
    "total_timesteps": (1, inf),
    "seconds": (0.0, inf),
    "n_envs": (1, 1_000_000),
    "batch_size": (2, 1_000_000_000),
    "learning_rate": (1e-8, 1.0),
    "gamma": (0.0, 1.0),
    "net_arch": (1, 10_000),
    "log_every": (1, inf),
    "checkpoint_every": (1, inf),
    "n_steps": (1, 1_000_000_000),
    "n_epochs": (1, inf),
    "gae_lambda": (0.0, 1.0),
    "log_std_init": (-10.0, 2.0),
    "ent_coef": (0.0, 1.0),
    "bc_steps": (0, inf),
    "tau": (1e-6, 1.0),
    "buffer_size": (1, 1_000_000_000),
    "learning_starts": (0, inf),
    "gradient_steps": (1, inf),
    "dropped_quantiles": (0, 24),
    "expectile": (0.0, 1.0),
    "temperature": (0.0, 1000.0),
    "relabelled": (1, 1000),
    "population": (2, 100_000),
    "elites": (2, 100_000),
    "episodes": (1, 100_000),
    "spread": (1e-6, 1e3),
    "extra_spread": (0.0, 1e3),
}


MOST_LAYERS = 100

DEFAULT = "default"
"""Key of the entry for environments that a file does not name."""


def config_path(algo: Algorithm, folder: Path | None = None) -> Path:
    """Return the file of an algorithm's hyperparameters, in ``configs`` or another folder."""
    return (folder or CONFIG_FOLDER) / f"{algo}.yaml"


def load_config(
    algo: Algorithm, env_id: str, overrides: Iterable[str] = (), path: Path | None = None
) -> Config:
    """Read one environment's hyperparameters.

    Parameters
    ----------
    algo
        A key of `CONFIG_OF`.
    env_id
        A key of the file, a variant of one, or any other registered environment, which gets the entry
        `DEFAULT` if the file has one.
    overrides
        ``"key=value"`` texts; ``env_kwargs.key=value`` reaches inside.
    path
        The file; that of `config_path` if None.

    Raises
    ------
    ConfigError
        If the file, any entry of it, or an override is wrong.
    UnknownEnvironment
        If there is no such environment.
    """
    path = path or config_path(algo)
    tree = read_yaml(path)
    if not isinstance(tree.value, dict):
        raise ConfigError(f"{path}: the file must be a mapping of environment ids to hyperparameters")
    for key in tree.value:
        build_config(algo, tree, (key,))
    if env_id not in tree.value:
        spec_of(env_id)
    if env_id not in tree.value and (found := find(env_id)):
        tree = _with_copy(tree, env_id, found[0].id)
    if env_id not in tree.value and DEFAULT in tree.value:
        tree = _with_copy(tree, env_id, DEFAULT)
    if env_id not in tree.value:
        raise ConfigError(f"{path}: no entry for {env_id!r}; it has {', '.join(tree.value)}")
    for override in overrides:
        assign(tree, (env_id,), override)
    return build_config(algo, tree, (env_id,))


def _with_copy(tree: Tree, env_id: str, of: str) -> Tree:
    """Return the document with an entry for an environment that copies another entry, if that exists."""
    if of not in tree.value:
        return tree
    where = {(env_id, *path[1:]): place for path, place in tree.where.items() if path[:1] == (of,)}
    return Tree({**tree.value, env_id: copy.deepcopy(tree.value[of])}, {**tree.where, **where})


def build_config(algo: Algorithm, tree: Tree, path: tuple[str, ...]) -> Config:
    """Make the configuration that stands at ``path`` of a document.

    Raises
    ------
    ConfigError
        If it is wrong.
    """
    config: Config = build(CONFIG_OF[algo], tree, path)
    for key, (low, high) in RANGES.items():
        value = getattr(config, key, low)
        numbers = value if isinstance(value, list) else [value]
        if not all(low <= number <= high for number in numbers):
            here = tree.where[*path, key]
            raise ConfigError(f"{here}: {key}: must lie between {low} and {high}, got {value!r}")
    if isinstance(config, NetworkConfig) and len(config.net_arch) > MOST_LAYERS:
        here = tree.where[*path, "net_arch"]
        raise ConfigError(f"{here}: net_arch: has {len(config.net_arch)} layers; at most {MOST_LAYERS}")
    if isinstance(config, LinearConfig) and config.elites > config.population:
        raise ConfigError(
            f"{tree.where[*path, 'elites']}: elites {config.elites} must be at most the population, "
            f"{config.population}"
        )
    if isinstance(config, PPOConfig) and config.bc_steps:
        here = tree.where[*path, "bc_steps"]
        if not config.n_envs <= config.bc_steps < config.total_timesteps:
            raise ConfigError(
                f"{here}: bc_steps {config.bc_steps} must be 0, or at least n_envs, {config.n_envs}, and "
                f"less than total_timesteps, {config.total_timesteps}"
            )
    if isinstance(config, PPOConfig) and config.n_envs * config.n_steps % config.batch_size:
        raise ConfigError(
            f"{tree.where[*path, 'batch_size']}: batch_size {config.batch_size} must divide "
            f"n_envs * n_steps = {config.n_envs * config.n_steps}"
        )
    return config


def parse_assignments(assignments: Iterable[str]) -> dict[str, Any]:
    """Read ``"key=value"`` texts, values as YAML, into a dict."""
    tree = Tree({}, {})
    for assignment in assignments:
        assign(tree, (), assignment)
    return tree.value


def assign(tree: Tree, root: tuple[str, ...], assignment: str) -> None:
    """Write one ``key=value`` into a document below ``root``; dots in the key reach deeper."""
    source = f"--set {assignment}"
    key, equals, text = assignment.partition("=")
    path = (*root, *key.split("."))
    if not equals or not all(path):
        raise ConfigError(f"{source}: write it as key=value")
    entry = tree.value
    for i, part in enumerate(path[:-1], start=1):
        tree.where.setdefault(path[:i], source)
        entry = entry.setdefault(part, {})
        if not isinstance(entry, dict):
            raise ConfigError(f"{source}: {part} holds a value, not keys")
    parsed = parse_yaml(text, source)
    entry[path[-1]] = parsed.value
    tree.where.update({path + inner: source for inner in parsed.where})
