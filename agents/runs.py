"""A run folder: what was asked for, with what versions, and the agent that came out of it.

=====================  ==========================================================================
``config.yaml``        algorithm, environment, seed and every hyperparameter, as used
``versions.json``      Python, packages, processor and git revision it was made with
``model.zip``          the newest checkpoint: a Stable-Baselines3 model file (``PPO.load`` reads
                       it) that also holds ``vecnormalize.pkl`` and ``training_state.pkl``
``metrics.csv``        the learning curve, drawn in ``learning_curve.png``
``tensorboard/``       everything Stable-Baselines3 logs
``evaluation.json``    the finished agent beside the baselines, on held-out seeds
``episode.gif``        one held-out episode of the finished agent
=====================  ==========================================================================
"""

from __future__ import annotations

import json
import os
import pickle
import platform
import subprocess
import sys
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import stable_baselines3
import yaml
from config import Config, build_config
from stable_baselines3.common.base_class import BaseAlgorithm

from springgym.strict_yaml import build, read_yaml

#: Maps observations ``(n, ...)`` to actions ``(n, ...)``.
Policy = Callable[[np.ndarray], np.ndarray]

#: Evaluation episodes start from this seed upwards, training from seeds below it.
HELD_OUT_SEED = 1_000_000

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {
    "ppo": stable_baselines3.PPO,
    "sac": stable_baselines3.SAC,
}


class Run(NamedTuple):
    """One training run and its folder."""

    folder: Path
    algo: str
    env_id: str
    seed: int
    config: Config

    @property
    def model(self) -> Path:
        """The newest checkpoint."""
        return self.folder / "model.zip"


def create_run(run: Run) -> Run:
    """Make the folder of a new run and write down its configuration and versions.

    Raises
    ------
    FileExistsError
        If the folder holds a run already.
    """
    if (run.folder / "config.yaml").exists():
        raise FileExistsError(
            f"{run.folder} holds a run: continue it with --resume {run.folder}, "
            "or name another folder with --run"
        )
    run.folder.mkdir(parents=True, exist_ok=True)
    write_atomically(run.folder / "versions.json", json.dumps(versions(), indent=2) + "\n")
    write_config(run)
    return run


def write_config(run: Run) -> None:
    """Write ``config.yaml``."""
    content = {
        "algo": run.algo,
        "env_id": run.env_id,
        "seed": run.seed,
        "config": asdict(run.config),
    }
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
    write_atomically(run.folder / "config.yaml", text)


def open_run(folder: Path) -> Run:
    """Read a run folder's ``config.yaml``.

    Raises
    ------
    ConfigError
        If it is missing or wrong.
    """
    tree = read_yaml(folder / "config.yaml")
    algo, env_id, seed = build(_header, tree)
    return Run(folder, algo, env_id, seed, build_config(algo, tree, ("config",)))


def _header(
    algo: Literal["ppo", "sac"], env_id: str, seed: int, config: dict[str, Any]
) -> tuple[str, str, int]:
    """The keys of ``config.yaml``; the last is read by `build_config`."""
    return algo, env_id, seed


def load_policy(run: Run) -> Policy:
    """The deterministic policy of a run's newest checkpoint, normalisation included.

    Raises
    ------
    FileNotFoundError
        If the run was stopped before its first checkpoint.
    """
    if not run.model.exists():
        raise FileNotFoundError(
            f"{run.folder} has no model.zip yet: train.py --resume {run.folder} continues the run"
        )
    model = ALGORITHMS[run.algo].load(run.model, device="cpu")
    if not run.config.normalize:
        return lambda observations: model.predict(observations, deterministic=True)[0]
    with zipfile.ZipFile(run.model) as archive:
        normalize = pickle.loads(archive.read("vecnormalize.pkl"))
    return lambda observations: model.predict(normalize.normalize_obs(observations), deterministic=True)[0]


def write_atomically(path: Path, text: str) -> None:
    """Replace a file by ``text``: a kill at any moment leaves the old file or the new one."""
    temporary = path.with_name(f"{path.name}.tmp")
    temporary.write_text(text, encoding="utf-8")
    replace_atomically(temporary, path)


def replace_atomically(temporary: Path, path: Path) -> None:
    """Put a finished file in another's place, once its content is on the disk."""
    with open(temporary, "rb+") as file:  # Windows syncs what may be written
        os.fsync(file.fileno())
    os.replace(temporary, path)


def versions() -> dict[str, object]:
    """What a run depends on besides its configuration."""
    packages = ("springgym", "gymnasium", "numpy", "numba", "torch", "stable-baselines3")
    installed: dict[str, str | None] = {}
    for name in packages:
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
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()


def _git_revision() -> str | None:
    """Revision of the source tree, ``-dirty`` if it was changed since; None outside git."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        result = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return result.stdout.strip()
