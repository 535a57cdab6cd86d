"""Results of the benchmark: the rows that hold them, whether a row is current and sound, and statistics.

docs/benchmark.md describes the rows. The statistics of few seeds of several tasks are those that Agarwal et
al. (2021, arXiv:2108.13264) recommend; scores (seeds, tasks) belong to one algorithm.
"""

from __future__ import annotations

import csv
import math
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, asdict, fields
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from config import Config, ConfigError
from controllers import UNTRAINED, controllers_of
from evaluate import Evaluation, evaluate, find_task
from runs import HELD_OUT_SEED, open_run, versions, waited_for, write_rows

from springgym.checks import counted, printable, shown
from springgym.envs.registration import find
from springgym.scenes.strict_yaml import read_json

Row = Mapping[str, Any]
Rows = dict[tuple[Any, ...], dict[str, Any]]

PROTOCOL = 3
"""Version of the protocol: budgets, seeds, episodes, probe, and the form of a row."""
SUITE = (
    "SpringBilliards-v0",
    "SpringFreeTopRough-v0",
    "SpringDuelStrong-v0",
    "SpringShoveHard-v0",
    "SpringDetumbleParticles-v0",
    "SpringTumbleHard-v0",
    "SpringGyroscopeHard-v0",
    "SpringTower-v0",
)
"""The tasks by which algorithms are compared."""
COMPARED = ("ppo", "sac", "tqc")
SECONDS = 300.0
"""Budget at which they are compared by time: seconds of learning on one core."""
SAMPLES = 50_000
"""Budget at which they are compared by experience: environment steps."""
REFERENCES = ("classical", "planner")
"""The better of them in a task scores 1, random actions 0."""
COLORS = {"linear": "C0", "ppo": "C1", "sac": "C2", "tqc": "C3", "her": "C4", "iql": "C5"}
"""Colours of what learns, in all figures."""
LINES: dict[str, Any] = {"classical": "--", "planner": ":", "random": "-.", "noop": (0, (1, 4))}
"""Dark lines of what does not learn, in all figures."""
EPISODES = 100
"""Number of held-out episodes that a row reports at least."""
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
    "probe": (list,),
    "springgym": (str,),
    "commit": (str, type(None)),
    "python": (str,),
    "packages": (dict,),
    "cpu": (str,),
}
"""What a row holds, and the types of the values. Rows of offline learning also hold "data"."""
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
POINTS = 60
"""Largest number of points of a curve in a row."""
PROBED = 8
"""Number of episodes of each agent in a probe."""
ENOUGH = 0.03
"""The largest relative difference between what a run spent and a budget at which it counts."""
SAME = 1e-6
"""Largest difference between the probes of the same task."""
ROUNDED = 1e-5
"""Largest difference between a mean, and that of the rounded numbers that it is of."""
CLOSE = 0.01
"""Largest median difference of returns played again: processors round differently, which impacts magnify."""
COMMIT = r"[0-9a-f]{40}|v?\d+\.\d+\.\d+(-\d+-g[0-9a-f]{40})?"
"""What ``git describe`` says of a tree that does not differ from its commit."""


class Cell(NamedTuple):
    """One run of the benchmark."""

    task: str
    algorithm: str
    seed: int

    def __str__(self) -> str:
        return f"{self.task} {self.algorithm} {self.seed}"


# --- Rows ----------------------------------------------------------------------------------------------


def row_of(
    cell: Cell,
    config: Config | None,
    steps: int,
    seconds: float,
    curve: list[list[float | None]],
    played: Evaluation,
) -> dict[str, Any]:
    """Return the row of a run: its configuration, the budget that it spent, and its evaluation."""
    returns = [round(value, 5) for value in played.returns_per_step]
    return {
        "protocol": PROTOCOL,
        **cell._asdict(),
        "used": used(cell.algorithm, config),
        "steps": steps,
        "seconds": seconds,
        "success_rate": played.success_rate,
        "mean_return": round(sum(returns) / len(returns), 6),
        "first_seed": played.first_seed,
        "episodes": len(returns),
        "returns": returns,
        "successes": None if played.successes is None else [int(success) for success in played.successes],
        "curve": curve,
        "configuration": {} if config is None else asdict(config),
        "config": digest_of(config),
        "probe": probe(cell.task),
        **made_with(),
    }


def used(algorithm: str, config: Config | None) -> list[str]:
    """Return what an algorithm of the package uses, of `USED`."""
    found = {
        "model": algorithm == "classical",
        "imitation": bool(getattr(config, "bc_steps", 0)),
        "other starts": bool(config and config.eval_env_kwargs),
        "data": algorithm == "iql",
        "planning": algorithm == "planner",
    }
    return [name for name in USED if found.get(name)]


def learned_from(row: Row) -> list[str]:
    """Return the names of the data sets of a row of offline learning; none of any other row."""
    return [data["id"] for data in row.get("data", [])]


def identity(row: Row) -> tuple[Any, ...]:
    """Return task, algorithm, data sets and seed of a row; a file holds one row of each."""
    return row["task"], row["algorithm"], tuple(learned_from(row)), row["seed"]


def read_rows(path: Path, key: Callable[[dict[str, Any]], Any] = identity) -> Rows:
    """Return the rows of a JSON file by their ``key``; no rows if the file is missing.

    Raises
    ------
    ConfigError
        If it holds something else.
    """
    if not path.exists():
        return {}
    found = read_json(path)
    try:
        return {key(row): row for row in found}
    except (KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"{path}: the file does not hold rows of results: {error!r}") from error


def add_row(path: Path, row: dict[str, Any]) -> None:
    """Write a row to a file, replacing the row of the same run."""
    change_rows(path, lambda rows: dict(sorted((rows | {identity(row): row}).items())))


def change_rows(
    path: Path, change: Callable[[Rows], Rows], key: Callable[[dict[str, Any]], Any] = identity
) -> None:
    """Replace the rows of a file, by their ``key``, by what ``change`` makes of them, while others wait."""
    with waited_for(path):
        write_rows(path, change(read_rows(path, key)).values())


def folder_name(task: str, algorithm: str, data: Sequence[str], seed: int) -> str:
    """Return the usual name of a run's folder."""
    return "-".join(
        [task.rpartition(":")[2], algorithm, *(name.rpartition("/")[2] for name in data), str(seed)]
    )


def curve_of(folder: Path) -> list[list[float | None]]:
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


def digest_of(config: Config | None) -> str:
    """Return eight letters that depend on the fields of a configuration that differ from their defaults."""
    known = () if config is None else fields(config)
    differing = {
        field.name: value for field in known if (value := getattr(config, field.name)) != default_of(field)
    }
    return sha256(repr(dict(sorted(differing.items()))).encode()).hexdigest()[:8]


def default_of(field: Field[Any]) -> object:
    """Return the default of a field; `dataclasses.MISSING` if it has none."""
    return field.default if field.default_factory is MISSING else field.default_factory()


@cache
def probe(task: str) -> list[float]:
    """Return mean return per step and mean length of whole episodes of a task as it is now.

    The first two numbers are those of random actions, the last two those of classical control if the task has
    it. They change with physics, rewards, starts and ends of episodes, and with the controller.
    """
    numbers: list[float] = []
    for agent in ("random", *(("classical",) if controllers_of(task) else ())):
        played = evaluate(agent, task, {}, PROBED)
        numbers += [round(played.return_per_step, 7), float(np.mean(played.lengths))]
    return numbers


def same_probe(given: object, task: str) -> bool:
    """Return whether a probe is that of a task as it is now; numbers of an older protocol are not."""
    present = probe(task)
    return isinstance(given, list) and len(given) == len(present) and np.allclose(given, present, 0.0, SAME)


def is_old(row: Row) -> bool:
    """Return whether a row follows an older protocol, or was marked as of a task that has changed since."""
    return row.get("protocol") != PROTOCOL or "present_probe" in row


def is_clean(commit: object) -> bool:
    """Return whether a commit names an unchanged tree (matches `COMMIT`), or is None (outside of a clone)."""
    return commit is None or re.fullmatch(COMMIT, str(commit)) is not None


def made_with() -> dict[str, Any]:
    """Return versions, commit and processor of this machine, as a row holds them."""
    found: Any = versions()
    return {
        "springgym": found["packages"]["springgym"],
        "commit": found["git_revision"],
        "python": found["python"].split()[0],
        "packages": {name: found["packages"][name] for name in ("numpy", "numba", "torch")},
        "cpu": found["cpu"],
    }


# --- Checks of rows ------------------------------------------------------------------------------------


def refusal(row: Any) -> str:
    """Return what is wrong with the form, task, tree or episodes of a row; an empty text if nothing is."""
    if not isinstance(row, dict):
        return f"a row is a mapping, got {type(row).__name__}"
    if row.get("protocol") != PROTOCOL:
        return f"its protocol is {row.get('protocol')!r}; this version knows {PROTOCOL}"
    if absent := sorted(FORM.keys() - row.keys()):
        return f"it has no {', '.join(absent)}"
    if unknown := sorted(row.keys() - FORM.keys() - {"data"}):
        return f"it has {', '.join(unknown)}, which is unknown"
    for name, types in FORM.items():
        if not isinstance(row[name], types) or isinstance(row[name], bool):
            return f"{name} is {shown(row[name])}"
    data = row.get("data", [])
    if not isinstance(data, list) or not all(
        isinstance(each, dict) and isinstance(each.get("id"), str) for each in data
    ):
        return f"data is {shown(data)}; it must be a list of data sets with their ids"
    if ("data" in row) != ("data" in row["used"]) or any(name not in USED for name in row["used"]):
        return f"used is {row['used']!r}; it holds some of {', '.join(USED)}, and 'data' only with data"
    if find(row["task"]) is None:
        return f"springgym has no task {row['task']!r}"
    if not same_probe(row["probe"], row["task"]):
        return f"its task was another one: the probe is {row['probe']}, and now {probe(row['task'])}"
    if not is_clean(row["commit"]):
        return f"its commit is {row['commit']!r}: it must be one, and the tree must not differ from it"
    return refused_episodes(row)


def refused_episodes(row: Row) -> str:
    """Return what is wrong with the seeds, the number or the means of a row's episodes, see `refusal`."""
    count = row["episodes"]
    if not 0 <= row["seed"] < HELD_OUT_SEED:
        return f"its seed is {row['seed']}: it must lie between 0 and {HELD_OUT_SEED - 1}"
    if row["first_seed"] != HELD_OUT_SEED or count < EPISODES:
        return (
            f"it is of {count} episodes from seed {row['first_seed']}: the protocol asks for {EPISODES} "
            f"or more from {HELD_OUT_SEED}"
        )
    for name, mean, low in (("returns", "mean_return", -1), ("successes", "success_rate", 0)):
        values = row[name]
        if values is None and row[mean] is None:
            continue
        if values is None or len(values) != count or not all(is_number(v) and low <= v <= 1 for v in values):
            return f"{name} must be {count} numbers from {low} to 1"
        if not is_number(row[mean]) or not abs(sum(values) / count - row[mean]) <= ROUNDED:
            return f"its {mean} is {row[mean]}, and that of its episodes {sum(values) / count:.6f}"
    return ""


def is_number(value: object) -> bool:
    """Return whether a value is a finite number, and no bool."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def replay(row: Row, agents: Path | None) -> str | None:
    """Play a row's episodes again; return how they differ from it, None if its agent is not there."""
    agent = row["algorithm"]
    if agent not in UNTRAINED:
        folder = agents and agents / folder_name(row["task"], agent, learned_from(row), row["seed"])
        if folder is None or not (folder / "agent.npz").is_file():
            return None
        run = open_run(folder)
        if (run.env_id, run.algo, run.seed, digest_of(run.config)) != (
            *Cell(row["task"], agent, row["seed"]),
            row["config"],
        ):
            return f"{folder} holds a run of another task, algorithm, seed or configuration"
        agent = str(folder)
    _, kwargs = find_task([] if agent in UNTRAINED else [agent], row["task"], [])
    returns = evaluate(agent, row["task"], kwargs, row["episodes"], row["first_seed"]).returns_per_step
    apart = float(np.median(np.abs(np.subtract(returns, row["returns"]))))
    return (
        f"played again, its episodes return otherwise: by {apart:.3f} in the median" if apart > CLOSE else ""
    )


def check(path: Path, agents: Path | None = None) -> int:
    """Print what is wrong with the rows of a file; the status is 0 if nothing is.

    Raises
    ------
    ConfigError
        If the file does not hold a list.
    """
    rows = read_json(path)
    if not isinstance(rows, list):
        raise ConfigError(f"{path}: the file must hold a list of rows")
    findings = [refusal(row) or replay(row, agents) for row in rows]
    counts = Counter(identity(row) for row, found in zip(rows, findings, strict=True) if not found)
    refused = 0
    for n, (row, found) in enumerate(zip(rows, findings, strict=True)):
        if not found and counts[identity(row)] > 1:
            found = "there are several rows of this task, algorithm and seed"
        if found:
            refused += 1
            print(f"row {n}: {printable(found)}", file=sys.stderr)
    unplayed = findings.count(None)
    print(
        f"{printable(str(path))}: {counted(len(rows), 'row')}, {refused} refused, {unplayed} not played "
        "again, as there is no agent"
    )
    return 1 if refused else 0


# --- Scores -------------------------------------------------------------------------------------------


def scale_of(task: str, rows: Iterable[Row]) -> tuple[float, float] | None:
    """Return the mean returns that score 0 and 1 in a task, random actions' and the best reference's; None if
    a row lacks."""
    mean = {row["algorithm"]: row["mean_return"] for row in rows if row["task"] == task}
    references = [mean[name] for name in REFERENCES if name in mean]
    return (mean["random"], max(references)) if references and "random" in mean else None


CURVE = ("steps", "seconds", "mean_return", "success_rate")
"""Columns of a learning curve; entries of a row give their values at its end."""


def reached(row: Row, column: int, budget: float, what: str = "mean_return") -> float | None:
    """Return an entry of `CURVE` that a run had reached after a budget of steps (column 0) or seconds (1).

    At its end, and if it learns nothing, it is that of the held-out episodes; before, that of the learning
    curve, interpolated between its points. None if the run was shorter than the budget, or its curve begins
    later.
    """
    spent = row[CURVE[column]]
    if not row["steps"] or abs(spent / budget - 1.0) <= ENOUGH:
        return float(row[what])
    points = np.array([point[: len(CURVE)] for point in row["curve"]], float)
    if spent < budget or not len(points) or budget < points[0, column]:
        return None
    return float(np.interp(budget, points[:, column], points[:, CURVE.index(what)]))


def scores(rows: Sequence[Row], column: int, budget: float) -> dict[tuple[str, ...], dict[str, np.ndarray]]:
    """Return the scores (seeds,) in tasks of `SUITE`, by algorithm with what it used, and by task.

    A score is the return, rescaled from that of random actions (0) to the reference's (1), see `scale_of`.
    Of the algorithms that learn nothing, "noop" alone is scored, at every budget.
    """
    found: dict[tuple[str, ...], dict[str, np.ndarray]] = {}
    for task in SUITE:
        scale = scale_of(task, rows)
        for row in rows:
            scored = row["task"] == task and (row["steps"] or row["algorithm"] == "noop")
            if scale and scored and (value := reached(row, column, budget)) is not None:
                own = found.setdefault((row["algorithm"], *row["used"]), {})
                own[task] = np.append(own.get(task, []), (value - scale[0]) / (scale[1] - scale[0]))
    return found


# --- Statistics ----------------------------------------------------------------------------------------

REPETITIONS = 2000
CONFIDENCE = 0.95
Statistic = Callable[[np.ndarray], float]
"""A function of scores (n,)."""


def interquartile_mean(scores: np.ndarray) -> float:
    """Return the mean of the middle half; values at its borders count by the part that is inside."""
    ordered = np.sort(np.ravel(scores))
    edges = np.arange(len(ordered) + 1) / len(ordered)
    inside = np.clip(np.minimum(edges[1:], 0.75) - np.maximum(edges[:-1], 0.25), 0.0, None)
    return float(np.sum(inside * ordered) / np.sum(inside))


def interval(
    by_task: Sequence[np.ndarray], statistic: Statistic, repetitions: int = REPETITIONS
) -> tuple[float, float]:
    """Return the interval of a statistic of all scores over draws of seeds: percentiles of a bootstrap.

    It is stratified: for every task, as many of its own seeds (n,) are drawn as there are, with replacement.
    """
    rng = np.random.default_rng(0)
    values = [
        statistic(np.concatenate([scores[rng.integers(0, len(scores), len(scores))] for scores in by_task]))
        for _ in range(repetitions)
    ]
    return percentiles(values)


def interval_of_returns(returns: Sequence[float]) -> tuple[float, float]:
    """Return the interval of the mean of the returns of episodes (n,)."""
    return interval([np.array(returns)], lambda drawn: float(np.mean(drawn)))


def wilson(successes: int, episodes: int) -> tuple[float, float]:
    """Return an interval for the rate of success (Wilson 1927, doi:10.1080/01621459.1927.10502953)."""
    z = 1.96
    rate = successes / episodes
    centre = rate + z * z / (2 * episodes)
    half = z * math.sqrt(rate * (1 - rate) / episodes + z * z / (4 * episodes**2))
    low, high = ((centre + side * half) / (1 + z * z / episodes) for side in (-1, 1))
    return max(low, 0.0), min(high, 1.0)


def interval_of_mean(
    means: np.ndarray, errors: np.ndarray, repetitions: int = REPETITIONS
) -> tuple[float, float]:
    """Return the interval of the mean of runs (n,), each the mean of episodes with a standard error (n,).

    Runs are drawn with replacement, and the mean of each from a normal distribution: many episodes stand for
    it. Of a single run, only the episodes count.
    """
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, len(means), (repetitions, len(means)))
    values = means[drawn] + errors[drawn] * rng.standard_normal(drawn.shape)
    return percentiles(values.mean(axis=1))


def percentiles(values: Sequence[float] | np.ndarray) -> tuple[float, float]:
    """Return the ends between which the middle of the values lies, as large a share as `CONFIDENCE`."""
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(values, (tail, 100 - tail))
    return float(low), float(high)
