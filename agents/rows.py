"""The form of the benchmark's rows, see docs/benchmark.md."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from config import Config

PROTOCOL = 1
"""Version of the protocol: seeds, episodes, and the form of a row."""
FORM: dict[str, tuple[type, ...]] = {
    "protocol": (int,),
    "task": (str,),
    "algorithm": (str,),
    "seed": (int,),
    "used": (list,),
    "steps": (int,),
    "seconds": (int, float),
    "success_rate": (int, float, type(None)),
    "mean_return": (int, float),
    "first_seed": (int,),
    "episodes": (int,),
    "returns": (list,),
    "successes": (list, type(None)),
    "curve": (list,),
    "configuration": (dict,),
    "config": (str,),
    "probe": (int, float),
    "springgym": (str,),
    "commit": (str, type(None)),
    "python": (str,),
    "packages": (dict,),
    "cpu": (str,),
}
"""What a row holds, and the types of the values."""
DATA: dict[str, tuple[type, ...]] = {
    "id": (str,),
    "agent": (str,),
    "episodes": (int,),
    "transitions": (int,),
    "mean_return": (int, float),
    "digest": (str,),
}
"""Entries of each data set in the list ``data`` of a row of offline learning, and their types: its name in
Minari, the agent that played, numbers of episodes and transitions, mean return of an episode per step, and a
digest of the transitions."""
USED = (
    "model",
    "planning",
    "privileged information",
    "imitation",
    "goal relabelling",
    "other starts",
    "data",
)
"""What a row can have used beside the rewards of the task's own episodes."""
POINTS = 40
"""Largest number of points of a curve in a row."""


def used(algorithm: str, config: Config | None) -> list[str]:
    """Return what an algorithm of the package uses, of `USED`."""
    found = {
        "model": algorithm == "classical",
        "imitation": bool(getattr(config, "imitate", 0)),
        "other starts": bool(config and config.eval_env_kwargs),
        "data": algorithm == "iql",
    }
    return [name for name in USED if found.get(name)]


def learned_from(row: Mapping[str, Any]) -> list[str]:
    """Return the names of the data sets of a row of offline learning; none of any other row."""
    return [own["id"] for own in row.get("data", [])]


def identity(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return what tells the run of a row from all others; a file holds one row of each run."""
    return row["task"], row["algorithm"], tuple(learned_from(row)), row["seed"]


def folder_name(task: str, algorithm: str, data: Sequence[str], seed: int) -> str:
    """Return the usual name of a run's folder."""
    return "-".join(
        [task.rpartition(":")[2], algorithm, *(name.rpartition("/")[2] for name in data), str(seed)]
    )


def curve(folder: Path) -> list[list[float | None]]:
    """Return the learning curve of a run: steps, seconds, return per step and success, row by row.

    Of linear control, it is of the unperturbed policy in each generation's episodes; of others, of the agent
    without noise, on episodes that are neither trained nor reported on. At most `POINTS` points are kept.
    """
    path = folder / "progress.csv"
    with open(path if path.exists() else folder / "metrics.csv", newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["return_per_step"]]
    every = -(-len(rows) // POINTS) or 1
    kept = rows[::-1][::every][::-1]  # the last one among them
    return [
        [
            int(row["timesteps"]),
            float(row["seconds"]),
            round(float(row["return_per_step"]), 4),
            round(float(row["success_rate"]), 4) if row["success_rate"] else None,
        ]
        for row in kept
    ]
