"""Check rows of the benchmark that somebody hands in, see docs/benchmark.md."""

from __future__ import annotations

import json
import math
import re
import secrets
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from functools import cache
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from benchmark import EPISODES, Cell, answers, digest_of, probe
from config import CONFIG_OF, Config, ConfigError, IQLConfig, build_config
from controllers import UNTRAINED
from evaluate import evaluate, find_task
from rows import DATA, FORM, PROTOCOL, USED, folder_name, learned_from, used
from runs import HELD_OUT_SEED, open_run

import springgym
from springgym.registration import find
from springgym.strict_yaml import parse_yaml

SAME = 1e-6
"""By how much a task's probe may differ from that of a row if the task is the same [reward]."""
ROUNDED = 1e-5
"""By how much a mean may differ from that of the rounded numbers that it is of."""
REPLAYED = 10
"""Number of episodes that are played again."""
CLOSE = 0.01
"""By how much the median of these may differ, as processors round differently, which impacts magnify."""
COMMIT = r"[0-9a-f]{40}|v?\d+\.\d+\.\d+(-\d+-g[0-9a-f]{40})?"
"""What ``git describe`` says of a tree that does not differ from its commit."""

Row = Mapping[str, Any]


def number(value: object) -> bool:
    """Return whether a value is a finite number, and no bool."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def form(row: object) -> str:
    """Return why something is not a row; an empty text if it is."""
    if not isinstance(row, dict):
        return f"a row is a mapping, got {type(row).__name__}"
    if row.get("protocol") != PROTOCOL:
        return f"its protocol is {row.get('protocol')!r}; this version knows {PROTOCOL}"
    if absent := sorted(FORM.keys() - row.keys()):
        return f"it has no {', '.join(absent)}"
    if unknown := sorted(row.keys() - FORM.keys() - {"data"}):
        return f"it has {', '.join(unknown)}, which is unknown"
    if wrong := mistyped(row, FORM):
        return wrong
    if ("data" in row) != ("data" in row["used"]):
        return "data says what it learned from if 'data' is used, and only then"
    return data_form(row["data"]) if "data" in row else ""


def mistyped(entries: Mapping[str, Any], types: Mapping[str, tuple[type, ...]]) -> str:
    """Return what is wrong with the type of an entry; an empty text if all types are right."""
    for name, kinds in types.items():
        value = entries[name]
        if (
            not isinstance(value, kinds)
            or isinstance(value, bool)
            or (isinstance(value, float) and not number(value))
        ):
            return f"{name} is {value!r}"
    return ""


def data_form(data: object) -> str:
    """Return what is wrong with the list of a row's data sets; an empty text if nothing is."""
    if not isinstance(data, list) or not data:
        return f"data must be a list of the data sets, got {data!r}"
    for own in data:
        if not isinstance(own, dict) or own.keys() != DATA.keys():
            return f"an entry of data must hold {', '.join(DATA)}, got {own!r}"
        if wrong := mistyped(own, DATA):
            return f"data: {wrong}"
        if not 0 < own["episodes"] <= own["transitions"] or not -1 <= own["mean_return"] <= 1:
            return f"data: no such episodes: {own!r}"
    if len({own["id"] for own in data}) < len(data):
        return "data names a data set twice"
    return ""


def version(row: Row) -> str:
    """Return what is wrong with the version of package and task, and with the tree."""
    if row["springgym"] != springgym.__version__:
        return f"it was made with springgym {row['springgym']}; this is {springgym.__version__}"
    if find(row["task"]) is None:
        return f"springgym has no task {row['task']!r}"
    if row["commit"] is not None and not re.fullmatch(COMMIT, row["commit"]):
        return f"its commit is {row['commit']!r}: it must be one, and the tree must not differ from it"
    if not abs(row["probe"] - task_probe(row["task"])) <= SAME:
        return f"its task was another one: the probe is {row['probe']}, and now {task_probe(row['task'])}"
    return ""


@cache
def task_probe(task: str) -> float:
    """Return the probe of a task as it is now."""
    return probe(task)


def configuration(row: Row) -> str:
    """Return what is wrong with the configuration, its digest, and what the row says that it used."""
    algorithm, given = row["algorithm"], row["configuration"]
    if not re.fullmatch(r"[a-z0-9][a-z0-9-]*", algorithm):
        return f"algorithm is {algorithm!r}: write it in lower case, digits and hyphens"
    if wrong := [name for name in row["used"] if name not in USED] or len(set(row["used"])) < len(
        row["used"]
    ):
        return f"used is {row['used']!r}, of which {wrong!r} is wrong: it holds some of {', '.join(USED)}"
    if algorithm in UNTRAINED:
        if given or row["steps"] or row["seconds"] or row["curve"]:
            return "nothing is trained: steps, seconds, curve and configuration must be 0 or empty"
        known = f"{answers(row['task']):.5f}" if algorithm == "classical" else digest_of(None)
        return told(row, known, used(algorithm, None))
    if not given:
        return "it has no configuration"
    if algorithm not in CONFIG_OF:
        return told(row, sha256(json.dumps(given, sort_keys=True).encode()).hexdigest()[:8], row["used"])
    try:
        config = read(row)
    except ConfigError as error:
        return f"configuration: {error}"
    if isinstance(config, IQLConfig) and config.data != learned_from(row):
        return f"its configuration asks for the data {config.data}, and the row has {learned_from(row)}"
    if not config.total_timesteps <= row["steps"] <= 2 * config.total_timesteps:
        return f"it took {row['steps']} steps, and its configuration asks for {config.total_timesteps}"
    return told(row, digest_of(config), used(algorithm, config))


def read(row: Row) -> Config:
    """Return the configuration of a row of an algorithm of the package."""
    algorithm: Any = row["algorithm"]
    tree = parse_yaml(json.dumps({"configuration": row["configuration"]}), "row")
    return build_config(algorithm, tree, ("configuration",))


def told(row: Row, digest: str, means: list[str]) -> str:
    """Return how the digest of a row and what it used differ from these."""
    if row["config"] != digest:
        return f"the digest of its configuration is {digest}, and the row says {row['config']!r}"
    if sorted(row["used"]) != sorted(means):
        return f"by its configuration it used {means!r}, and the row says {row['used']!r}"
    return ""


def episodes(row: Row) -> str:
    """Return what is wrong with seeds and episodes, and how they contradict the summary."""
    if not 0 <= row["seed"] < HELD_OUT_SEED:
        return f"its seed is {row['seed']}: it must lie between 0 and {HELD_OUT_SEED - 1}"
    count, returns, successes = row["episodes"], row["returns"], row["successes"]
    if row["first_seed"] != HELD_OUT_SEED or count < EPISODES:
        return (
            f"it is of {count} episodes from seed {row['first_seed']}: the protocol asks for {EPISODES} "
            f"or more from {HELD_OUT_SEED}"
        )
    if len(returns) != count or not all(number(one) and -1 <= one <= 1 for one in returns):
        return f"returns must be {count} numbers from -1 to 1"
    if abs(sum(returns) / count - row["mean_return"]) > ROUNDED:
        return f"its mean return is {row['mean_return']}, and that of its episodes {sum(returns) / count:.6f}"
    if len(set(returns)) == 1 and returns[0] not in (0, 1):
        return f"all its episodes return {returns[0]}, although their starts differ"
    if (successes is None) != (row["success_rate"] is None):
        return "success_rate and successes must both be there, or neither"
    if successes is None:
        return ""
    if len(successes) != count or not all(type(one) is int and one in (0, 1) for one in successes):
        return f"successes must be {count} of 0 and 1"
    if abs(sum(successes) / count - row["success_rate"]) > 1e-9:
        return f"its success rate is {row['success_rate']}, and that of its episodes {sum(successes) / count}"
    return ""


def learning(row: Row) -> str:
    """Return what is wrong with the learning curve."""
    points = row["curve"]
    if row["algorithm"] in UNTRAINED:
        return ""
    if not points or row["steps"] <= 0 or row["seconds"] <= 0:
        return "it has no learning curve, steps or seconds"
    if not all(
        isinstance(point, list) and len(point) == 4 and all(number(one) or one is None for one in point)
        for point in points
    ) or any(None in point[:3] for point in points):
        return "a point of its curve must hold steps, seconds, return and success, or null for the latter"
    steps, seconds = ([point[n] for point in points] for n in (0, 1))
    if any(a >= b for a, b in pairwise(steps)) or any(a > b for a, b in pairwise(seconds)):
        return "its curve goes back in steps or seconds"
    if steps[0] < 0 or steps[-1] > row["steps"] or seconds[0] < 0 or seconds[-1] > row["seconds"] + 0.01:
        return f"its curve reaches {steps[-1]} steps and {seconds[-1]} s, and the row has less"
    return ""


CHECKS: tuple[Callable[[Any], str], ...] = (form, version, configuration, episodes, learning)
"""Each returns what is wrong with a row, or an empty text; the first finding counts."""


def refusal(row: Any) -> str:
    """Return why a row is refused; an empty text if nothing is found."""
    return next((found for one in CHECKS if (found := one(row))), "")


def replay(row: Row, agents: Path | None) -> str | None:
    """Play a few of a row's episodes again; return what is wrong with them, None if there is no agent."""
    agent = row["algorithm"]
    if agent not in UNTRAINED:
        name = folder_name(row["task"], agent, learned_from(row), row["seed"])
        folder = None if agents is None else agents / name
        if folder is None or not (folder / "agent.npz").is_file():
            return None
        run = open_run(folder)
        if (run.env_id, run.algo, run.seed) != (row["task"], agent, row["seed"]) or run.config != read(row):
            return f"{folder} holds a run of another task, algorithm, seed or configuration"
        agent = str(folder)
    env_id, kwargs = find_task([] if agent in UNTRAINED else [agent], row["task"], [])
    count = row["episodes"] if agent in UNTRAINED else REPLAYED  # random actions depend on how many play
    begin = secrets.randbelow(row["episodes"] - count + 1)
    found = evaluate(agent, env_id, kwargs, count, row["first_seed"] + begin)
    apart = np.abs(np.subtract(found.returns_per_step, row["returns"][begin : begin + count]))
    if np.median(apart) > CLOSE:
        return (
            f"episodes {begin} to {begin + count - 1} return otherwise when they are played again: by "
            f"{np.median(apart):.3f} in the median"
        )
    return ""


def name_of(row: Mapping[str, Any]) -> str:
    """Return a text of what a row is of, whatever its entries are."""
    return json.dumps([row.get(key) for key in (*Cell._fields, "data")])


def check(path: Path, agents: Path | None = None) -> int:
    """Print what is wrong with the rows of a file; the status is 0 if nothing is.

    Raises
    ------
    ConfigError
        If the file does not hold a list.
    """
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ConfigError(f"{path}: the file is not JSON: {error}") from error
    if not isinstance(rows, list):
        raise ConfigError(f"{path}: the file must hold a list of rows")
    known = [row for row in rows if isinstance(row, dict)]
    named = Counter(map(name_of, known))
    refused = unplayed = 0
    for n, row in enumerate(rows):
        found: str | None = refusal(row)
        if not found and named[name_of(row)] > 1:
            found = "there are several rows of this task, algorithm and seed"
        found = found or replay(row, agents)
        if found is None:
            unplayed += 1
        elif found:
            refused += 1
            name = [row.get(k) for k in Cell._fields] if isinstance(row, dict) else ""
            print(f"row {n} {name}: {found}", file=sys.stderr)
    print(f"{path}: {len(rows)} rows, {refused} refused, {unplayed} consistent but not played again")
    if unplayed:
        print(
            "without its agent, a row may have been made up consistently: give the run folders with --agents"
        )
    return 1 if refused else 0
