"""Test whether agents that were trained on rigid bodies work on springs, and the other way round.

    python agents/studies/transfer.py SpringTop-v0 --seeds 3
    python agents/studies/transfer.py SpringTop-v0 --local --jobs 1

The script trains four kinds of agents, on springs and on rigid bodies, with and without randomisation, from
several seeds each. It works as agents/benchmark.py does: if it was stopped, the same command continues it.
Each agent then plays held-out episodes on rigid bodies and on springs of decreasing stiffness. The script
prints a table, and writes it to transfer.json and a figure to transfer.svg, in the folder of the runs.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import _path  # noqa: F401  (first)
import matplotlib
import numpy as np
from benchmark import Plan, add_hyperparameters, is_current, parsed, recorded, run_cells
from config import MENDABLE, ONLINE, ConfigError, command_line, config_path, load_config, making, whole
from evaluate import evaluate, percent, task_kwargs
from results import Cell, interval_of_returns
from runs import locked
from tqdm import tqdm

from springgym.cli import INTERRUPTED, guarded, whole_file, write_text
from springgym.envs.sb3 import make_sb3

DYNAMICS = ("springs", "rigid")
RANDOMIZED = {"masses": (0.8, 1.2), "actuator": (0.8, 1.2)}
"""The randomisation of both dynamics."""
STIFFNESS = (1.0, 0.3, 0.1, 0.03, 0.01)
"""Stiffness of the springs, relative to the default."""
RIGID = "rigid"


def kinds() -> dict[str, dict[str, Any]]:
    """Return names of the kinds of agents, and the arguments of the environments that they learn in."""
    return {
        f"{dynamics}{', randomised' if randomized else ''}": {"dynamics": dynamics}
        | ({"randomize": RANDOMIZED} if randomized else {})
        for dynamics in DYNAMICS
        for randomized in (False, True)
    }


def plan_of(kind: str, folder: Path, options: argparse.Namespace) -> Plan:
    """Return the training plan of a kind of agents."""
    arguments = [f"env_kwargs.{key}={json.dumps(value)}" for key, value in kinds()[kind].items()]
    return Plan(
        folder / kind.replace(", ", "-"), options.episodes, (*options.overrides, *arguments), options.configs
    )


def grid() -> dict[str, dict[str, Any]]:
    """Return the names of the environments in which agents play, and their arguments."""
    softer: dict[str, dict[str, Any]] = {
        f"{factor:g} k": {"dynamics": "springs", "randomize": {"stiffness": (factor, factor)}}
        for factor in STIFFNESS
    }
    return {RIGID: {"dynamics": "rigid", "randomize": None}} | softer


def possible(env_id: str, kwargs: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the part of the grid on which episodes can start: spin tears softer springs."""
    found = {}
    for name, change in grid().items():
        try:
            with making(env_id):
                env = make_sb3(env_id, 64, 0, env_kwargs={**kwargs, **change})
                env.reset()
                env.close()
        except ConfigError as error:
            if name == RIGID:
                raise
            print(f"{name} is left out: {error}")
            continue
        found[name] = change
    return found


def train(options: argparse.Namespace, folder: Path) -> int:
    """Train what is not trained yet; how many runs failed."""
    failed = 0
    for kind in kinds():
        plan = plan_of(kind, folder, options)
        cells = [Cell(options.task, options.algo, seed) for seed in range(options.seeds)]
        rows = {cell: recorded(plan.folder(cell) / "row.json") or {} for cell in cells}
        left = [cell for cell in cells if not is_current(rows[cell], cell, plan)]
        for result in run_cells(left, plan, options) if left else ():
            if result is None:
                continue
            cell, row = result
            if isinstance(row, str):
                failed += 1
                print(f"{kind}: {cell} failed: {row}", file=sys.stderr)
            else:
                write_text(plan.folder(cell) / "row.json", json.dumps(row) + "\n")
                tqdm.write(f"{kind}: {cell}: {row['mean_return']:.3f} where it learned")
    return failed


def played(options: argparse.Namespace, folder: Path, kwargs: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a row for every agent and every place it plays at, given the arguments of the task."""
    places = possible(options.task, kwargs)
    rows = []
    for kind in kinds():
        plan = plan_of(kind, folder, options)
        for seed in range(options.seeds):
            agent = plan.folder(Cell(options.task, options.algo, seed))
            for place, change in places.items():
                found = evaluate(str(agent), options.task, {**kwargs, **change}, options.episodes)
                rows.append(
                    {
                        "task": options.task,
                        "learned": kind,
                        "seed": seed,
                        "played": place,
                        "mean_return": found.return_per_step,
                        "success_rate": found.success_rate,
                        "probe": recorded(agent / "probe.json"),
                    }
                )
    return rows


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return returns per step in the mean of the seeds, the lowest and the highest."""
    places = list(dict.fromkeys(row["played"] for row in rows))
    lines = [f"| learned on | {' | '.join(places)} |", "|---" * (len(places) + 1) + "|"]
    for kind in dict.fromkeys(row["learned"] for row in rows):
        cells = []
        for place in places:
            returns = [r["mean_return"] for r in rows if (r["learned"], r["played"]) == (kind, place)]
            success = [r["success_rate"] for r in rows if (r["learned"], r["played"]) == (kind, place)]
            rate = percent(None if None in success else float(np.mean(success)))
            cells.append(f"{rate}, {np.mean(returns):.3f} ({min(returns):.3f}–{max(returns):.3f})")
        lines.append(f"| {kind} | {' | '.join(cells)} |")
    return "\n".join(lines)


def draw(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Return against stiffness, with bootstrapped intervals over the seeds."""
    matplotlib.use("svg")
    from matplotlib import pyplot as plt

    matplotlib.rcParams["svg.hashsalt"] = "springgym"
    places = list(dict.fromkeys(row["played"] for row in rows))
    figure, axes = plt.subplots(figsize=(6, 3.5), layout="constrained")
    for n, kind in enumerate(dict.fromkeys(row["learned"] for row in rows)):
        by_place = [
            np.array([r["mean_return"] for r in rows if (r["learned"], r["played"]) == (kind, place)])
            for place in places
        ]
        means = np.array([values.mean() for values in by_place])
        seeds = [values.tolist() if len(values) > 1 else [np.nan] for values in by_place]  # one has none
        limits = np.array([interval_of_returns(values) for values in seeds])
        x = np.arange(len(places)) + 0.06 * (n - 1.5)
        errors = np.abs(limits.T - means)
        axes.errorbar(x, means, errors, fmt="o-", ms=3, lw=1, capsize=2, label=f"learned on {kind}")
    axes.set_xticks(range(len(places)), places)
    axes.set(
        xlabel="played on (k: stiffness of the springs)", ylabel="return per step", title=rows[0]["task"]
    )
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="svg", metadata={"Date": None})
    plt.close(figure)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = command_line(__doc__)
    parser.add_argument("task", metavar="ID", help="environment id")
    parser.add_argument("--algo", choices=sorted(ONLINE), default="ppo", help="algorithm (default: ppo)")
    parser.add_argument(
        "--seeds", type=whole(1, 1000), default=3, help="number of seeds, from 0 on (default: 3)"
    )
    parser.add_argument(
        "--episodes", type=whole(1, 100_000), default=100, help="episodes to play (default: 100)"
    )
    parser.add_argument("--runs", type=Path, default=Path("runs/transfer"), help="folder for the run folders")
    add_hyperparameters(parser)
    options = parsed(parser, arguments)
    return guarded("transfer.py", lambda: transfer(options), MENDABLE)


def transfer(options: argparse.Namespace) -> int:
    """Train, play, tell."""
    folder = options.runs.absolute() / options.task.rpartition(":")[2]
    path = config_path(options.algo, options.configs)
    kwargs = task_kwargs(load_config(options.algo, options.task, options.overrides, path))
    for change in kinds().values():  # what cannot be made is told before anything is trained
        with making(options.task):
            make_sb3(options.task, 1, env_kwargs={**kwargs, **change}).close()
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        try:
            if train(options, folder):
                return 1
        except KeyboardInterrupt:
            print("\nstopped; the same command continues")
            return INTERRUPTED
        rows = played(options, folder, kwargs)
        write_text(folder / "transfer.json", json.dumps(rows, indent=0) + "\n")
        draw(rows, folder / "transfer.svg")
        print(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
