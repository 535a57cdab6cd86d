"""A run folder: the configuration, the versions, and the trained agent.

=====================  ==========================================================================
``config.yaml``        algorithm, environment, seed and every hyperparameter, as used
``versions.json``      Python, packages, processor and git revision it was made with
``agent.npz``          the newest agent: arrays of numbers and nothing else
``metrics.csv``        the learning curve, drawn in ``learning_curve.png``
``progress.csv``       what the agent reached without noise, at every checkpoint
``tensorboard/``       everything Stable-Baselines3 logs
``evaluation.json``    the finished agent beside the baselines, on held-out seeds
``episode.gif``        one held-out episode of the finished agent
``model.zip``          the newest checkpoint: a Stable-Baselines3 model file (``PPO.load`` reads
                       it) that also holds all else that training depends on
``lock``               held by the process that trains
=====================  ==========================================================================

``config.yaml`` and ``agent.npz`` are enough to evaluate and watch an agent, so share these two. They are safe
to use, whoever made them. ``model.zip`` is pickled, and unpickling a file can run any code: resume your own
runs only.
"""

from __future__ import annotations

import errno
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import IO, Any, NamedTuple

import yaml
from config import CONFIG_OF, Config, ConfigError, NetworkConfig, assign, build_config
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

from springgym.cli import write_text
from springgym.core.extras import SOURCE
from springgym.envs import agent
from springgym.envs.agent import Algorithm, Network, Policy
from springgym.scenes.strict_yaml import build, read_yaml

HELD_OUT_SEED = 1_000_000
"""First seed of the episodes that every run is reported on. A run's seed is below it; of that, copies that
learn draw seeds of 64 bits, and linear control seeds below it."""
SELECTION_SEED = 1_500_000
"""First seed of the episodes on which hyperparameters, and agents to publish, are chosen."""
PROGRESS_SEED = 2_000_000
"""First seed of the episodes that learning curves are of."""
PUBLISHED_SEED = 2_500_000
"""First seed of the episodes that a chosen agent is reported on: none had a part in the choice."""
DATASET_SEED = 3_000_000
"""First seed of the episodes in recorded data sets. No agent learns in these episodes or is evaluated on
them."""


class Run(NamedTuple):
    """One training run and its folder."""

    folder: Path
    algo: Algorithm
    env_id: str
    seed: int
    config: Config

    @property
    def model(self) -> Path:
        """Return the newest checkpoint."""
        return self.folder / "model.zip"

    @property
    def agent(self) -> Path:
        """Return the newest agent."""
        return self.folder / "agent.npz"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep others from training in a folder; the system lets go when this process ends, in whatever way.

    Raises
    ------
    ConfigError
        If another process trains in it.
    """
    with open(folder / "lock", "ab") as file:
        try:
            _lock(file)
        except OSError as error:
            if error.errno in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
                raise ConfigError(f"{folder}: another process is training in this folder") from error
            print(f"{folder} cannot be locked here ({error.strerror}): do not train in it twice at once")
        yield


@contextmanager
def waited_for(path: Path) -> Iterator[None]:
    """Keep others from changing the rows of files in the folder of ``path``, and wait while others do so."""
    with open(Path(os.path.realpath(path)).parent / ".lock", "ab") as file:
        try:
            _lock(file, wait=True)
        except OSError as error:
            print(f"{path} cannot be locked here ({error.strerror}): add rows to it once at a time")
        yield


def _lock(file: IO[bytes], wait: bool = False) -> None:
    if sys.platform == "win32":
        import msvcrt

        msvcrt.locking(file.fileno(), msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)


def create_run(run: Run) -> Run:
    """Make the folder of a new run and write down its configuration and versions.

    Raises
    ------
    FileExistsError
        If the folder holds a run already.
    """
    if (run.folder / "config.yaml").exists():
        raise FileExistsError(
            f"{run.folder} holds a run already: continue it with --resume {run.folder}, "
            "or name another folder with --out"
        )
    run.folder.mkdir(parents=True, exist_ok=True)
    write_text(run.folder / "versions.json", json.dumps(versions(), indent=2) + "\n")
    write_config(run)
    return run


def write_config(run: Run) -> None:
    """Write ``config.yaml``."""
    content = {"algo": run.algo, "env_id": run.env_id, "seed": run.seed, "config": asdict(run.config)}
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
    write_text(run.folder / "config.yaml", text)


def open_run(folder: Path, overrides: Iterable[str] = ()) -> Run:
    """Read a run folder's ``config.yaml``, and change it by ``"key=value"`` texts.

    Raises
    ------
    ConfigError
        If it is missing or wrong.
    """
    tree = read_yaml(folder / "config.yaml")
    algo, env_id, seed = build(_header, tree)
    for override in overrides:
        assign(tree, ("config",), override)
    return Run(folder, algo, env_id, seed, build_config(algo, tree, ("config",)))


def _header(algo: Algorithm, env_id: str, seed: int, config: dict[str, Any]) -> tuple[Algorithm, str, int]:
    """Return the keys of ``config.yaml``; the last is read by `build_config`."""
    return algo, env_id, seed


def load_policy(run: Run, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]) -> Policy:
    """Load the deterministic policy of a run's newest agent, normalisation included, see `policy_in`.

    Raises
    ------
    ConfigError
        If there is none, or it does not fit.
    """
    if not run.agent.exists():
        raise ConfigError(
            f"{run.folder} has no agent.npz; if the run is your own, springgym train --resume {run.folder} "
            "continues it and writes one"
        )
    return policy_in(run.agent, run.config, observation_space, action_space)


def policy_in(
    path: Path, config: Config, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]
) -> Policy:
    """Load the deterministic policy from a file, see `springgym.envs.agent.load_policy`.

    Raises
    ------
    ConfigError
        If the file is damaged, or does not fit configuration and environment.
    """
    (algo,) = (name for name, kind in CONFIG_OF.items() if type(config) is kind)
    network = Network(algo)
    if isinstance(config, NetworkConfig):
        network = Network(algo, config.net_arch, config.activation, config.normalize)
    try:
        return agent.load_policy(path, network, observation_space, action_space)
    except ValueError as error:
        raise ConfigError(str(error)) from error


def time_limit(spec: EnvSpec) -> int:
    """Return after how many steps the episodes of an environment are cut.

    Raises
    ------
    ConfigError
        If they are not: an evaluation might never end.
    """
    limit = spec.kwargs.get("max_episode_steps", spec.max_episode_steps)
    if limit is None:
        raise ConfigError(f"{spec.id} has no time limit: register it with max_episode_steps")
    return int(limit)


def write_rows(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows as a list in JSON, one row a line."""
    lines = ",\n".join(map(json.dumps, rows))
    write_text(path, f"[\n{lines}\n]\n")


def versions() -> dict[str, object]:
    """Return the versions and the machine that a run depends on besides its configuration."""
    own = ("springgym", "gymnasium", "numpy", "numba", "torch", "stable-baselines3", "sb3-contrib")
    installed: dict[str, str | None] = {}
    for name in (*own, "torchrl", "minari"):
        try:
            installed[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            installed[name] = None
    return {
        "python": sys.version,
        "packages": installed,
        "platform": platform.platform(),
        "cpu": _cpu_model(),
        "cpu_count": os.cpu_count(),
        "git_revision": _git_revision(),
    }


def _cpu_model() -> str:
    if (cpuinfo := Path("/proc/cpuinfo")).exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()


@cache
def _git_revision() -> str | None:
    """Return the Git commit of the source tree, then ``-dirty`` if files differ from it; None if not a clone.

    It is that of the first call: rows that this process writes into the tree do not change its code.
    """
    if not (SOURCE / "pyproject.toml").is_file():  # installed, maybe within somebody's own tree
        return None
    command = ["git", "--no-optional-locks", "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        return subprocess.run(command, cwd=SOURCE, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None
