"""Write the page of baselines from the rows of the benchmark; nothing is trained or measured.

python docs/baselines.py                                         # the page and its figure, from the rows
python docs/baselines.py --rows runs/benchmark/baselines.json    # take these rows in first
python docs/baselines.py --mark    # first mark the rows of tasks that have changed since
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "agents")]

from environments import ALGORITHMS, shown  # noqa: E402
from learning_time import shown as times  # noqa: E402
from scores import interquartile_mean, interval, profile  # noqa: E402

from springgym.registration import ENVIRONMENTS, VARIANTS, Row, Variant  # noqa: E402

ROWS, PAGE, FIGURE = HERE / "baselines.json", HERE / "baselines.md", HERE / "figures" / "baselines.svg"
TRAINED = ("linear", "ppo", "sac", "tqc", "crossq")
SEEDS, WIDE = 3, 5
"""Seeds of a task, and such tasks, that an algorithm has at the least if it is compared with others."""
TIMES = HERE / "learning_time.json"
"""What ``agents/learning_time.py`` measured."""
SAME = 1e-6
"""By how much a task's probe may differ from that of a row if the task is the same [reward]."""
CARDS = HERE.parent / "agents" / "trained"
TASKS: tuple[Row | Variant, ...] = (*ENVIRONMENTS, *VARIANTS)
TIERS = {
    "first steps": "Even linear control solves these, found in seconds. Begin here.",
    "standard": "PPO solves these with the hyperparameters that ship. Linear control does not.",
    "harder": "PPO still does most of these, from three seeds.",
    "hard": "PPO does not do these, although they can be done.",
}
INTRODUCTION = """# Baselines

These tables show what each algorithm reaches on each task. A cell gives the share of 100 held-out episodes
that succeed, averaged over training seeds. The brackets give the lowest of these seeds and their number, if
there are several. The second line of a cell is the return per step, which is at most 1. Agents play without
exploration.
"""
CHANGED = """Tasks marked † have changed since some of their rows were made: the simulator computes
contact, or a control period, slightly differently now, and the balls of SpringBalance, SpringShove,
SpringStack and SpringJuggle, which slid, roll. Those rows describe the task as it was. The mean reward of
given actions from given starts has changed by {most:.1e} or less.
"""
AGENTS = """## Trained agents

The package contains the best agent of each task: its numbers, its configuration and a card. The card holds
the command that trained it, versions, checksums, its evaluation and its audit.

```sh
springgym evaluate SpringTop-v0
springgym watch SpringTop-v0 --out top.gif
```

The audit asks whether an agent lives on errors of the simulation. It plays the same episodes with a quarter
of the step, with another method and with the rigid twin, and computes which share of the return is lost. An
agent survives if it loses less than 2 %, with a certainty of 95 %. Some simulations cannot play the task;
they tell nothing.
"""
TIME = """## Time to learn

This table shows how long PPO takes, with the configuration that ships, until it succeeds in 90 % of 20
held-out episodes. It is tested every 32,768 steps. The seconds are those of one core of {cpu}, divided into
physics, policy and learning. `python agents/learning_time.py --json docs/learning_time.json` measured them.

{table}
"""
METHOD = """## How it was made

```sh
python -m pip install -c constraints.txt -e ".[agents,ray]"
python agents/benchmark.py --runs runs/benchmark
python docs/baselines.py --rows runs/benchmark/baselines.json
```

The second command trains and evaluates everything, on all cores or on a Ray cluster. If it is stopped, the
same command goes on where it was. The third command writes this page. The same command, seed, machine and
commit give the same curve, to the bit.

- *Linear* is a ← clip(W o + b) over the compact observation, found by the cross-entropy method.
- *Classical* is the controller in `agents/controllers.py`, which does not learn.
- Hyperparameters are those of `configs/`. These files also say what an agent observes: particles for PPO
  where they say nothing, and the compact observation for the others. A variant uses those of its
  environment.
- All algorithms start from nothing, with one exception. PPO of `SpringDuel-v0` and `SpringDuelStrong-v0`
  [imitates](training.md#begin-with-what-is-known) classical control in its first 400,000 steps.
  So do the agents of `SpringShove-v0` and `SpringStack-v0` that the package contains, in their first 250,000;
  the rows of these tasks were made from nothing.
- Each copy of a training batch has its own seed, spawned from the seed of the run. In older rows the seeds
  of the copies counted on from it, so that runs of a task shared most of their starts.
- Seconds are processor time of one core, so they do not depend on what else the machine does.

The rows are in `docs/baselines.json`. Each row holds versions, commit, a digest of its configuration and a
probe of its task. The probe is the mean reward of given actions from given starts. (For classical control,
the digest is a sum over what it does.) A test compares them with the present ones. If a task has changed,
its rows also hold the present probe, until the benchmark runs again.

The interquartile mean over these tasks, and its 95 % intervals by a bootstrap stratified by task, follow
Agarwal et al., [Deep reinforcement learning at the edge of the statistical
precipice](https://arxiv.org/abs/2108.13264).
"""


def cells(rows: Iterable[dict[str, Any]]) -> dict[tuple[str, str], list[dict[str, Any]]]:
    """The rows of every task and algorithm."""
    found = defaultdict(list)
    for row in rows:
        found[row["task"], row["algorithm"]].append(row)
    return found


def table_of(tier: str, rows: Sequence[dict[str, Any]]) -> list[str]:
    """The tasks of a tier with what was reached."""
    tasks = [task.id for task in TASKS if task.tier == tier]
    by_cell = cells(row for row in rows if row["task"] in tasks)
    present = [name for name in ALGORITHMS if any(algorithm == name for _, algorithm in by_cell)]
    lines = [f"| task | {' | '.join(present)} |", "|---" * (len(present) + 1) + "|"]
    for task in tasks:
        if any(name == task for name, _ in by_cell):
            results = " | ".join(shown(by_cell.get((task, name), [])) for name in present)
            mark = " †" if any(row["task"] == task and "present_probe" in row for row in rows) else ""
            lines.append(f"| `{task}`{mark} | {results} |")
    return lines


def compared(rows: Sequence[dict[str, Any]]) -> tuple[list[str], list[str]]:
    """The algorithms that are compared, and the tasks of which all of them have `SEEDS` seeds or more."""
    seeds = Counter((row["algorithm"], row["task"]) for row in rows)
    tasks = {
        name: {task for (algorithm, task), n in seeds.items() if algorithm == name and n >= SEEDS}
        for name in TRAINED
    }
    wide = [name for name in TRAINED if len(tasks[name]) >= WIDE]
    return wide, sorted(set.intersection(*(tasks[name] for name in wide))) if wide else []


def table_of_costs(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return a table of what a run costs by algorithm, and what all compared ones reach in the same tasks."""
    wide, tasks = compared(rows)
    lines = [
        f"| algorithm | runs | steps each | seconds each | success in {len(tasks)} tasks, interquartile mean "
        "| 95 % interval |",
        "|---|---|---|---|---|---|",
    ]
    for name in TRAINED:
        runs = [row for row in rows if row["algorithm"] == name]
        if not runs:
            continue
        reached = "| |"
        if name in wide:
            scores = by_task([run for run in runs if run["task"] in tasks])
            low, high = interval(scores, interquartile_mean)
            mean = interquartile_mean(np.concatenate(scores))
            reached = f"{100 * mean:.0f} % | {100 * low:.0f}–{100 * high:.0f} % |"
        steps, seconds = (np.array([run[key] for run in runs]) for key in ("steps", "seconds"))
        lines.append(
            f"| {name} | {len(runs)} | {steps.min():,.0f}–{steps.max():,.0f} | {seconds.min():.0f}–"
            f"{seconds.max():.0f} | {reached}"
        )
    if tasks:
        lines += ["", f"These have {SEEDS} seeds or more of all: {', '.join(f'`{task}`' for task in tasks)}."]
    return lines


def table_of_times(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return tables of the time that learning takes, see ``agents/learning_time.py``."""
    cpus = ", ".join(sorted({row["measured"]["cpu"] for row in rows}))
    return [TIME.format(table=times(rows), cpu=cpus)]


def table_of_agents() -> list[str]:
    """The agents of the repository, see ``agents/publish.py``."""
    lines = [
        "| task | trained by | return per step, 95 % interval | success | lost in the audit |",
        "|---|---|---|---|---|",
    ]
    for path in sorted(CARDS.glob("*/card.json")):
        card = json.loads(path.read_text(encoding="utf-8"))
        low, high = card["interval"]
        own, *others = card["audit"]
        lost = [
            f"{found['simulation']}: {found['verdict']}"
            + ("" if found["refused"] else f", {100 * found['lost'] / own['return_per_step']:+.2f} %")
            for found in others
        ]
        lines.append(
            f"| `{card['task']}` | {card['algorithm']}, seed {card['seed']} | {card['mean_return']:.3f} "
            f"({low:.3f}–{high:.3f}) | {100 * card['success_rate']:.0f} % | {'<br>'.join(lost)} |"
        )
    return lines


def by_task(runs: Sequence[dict[str, Any]]) -> list[np.ndarray]:
    """Success rates (seeds,) of every task."""
    found = defaultdict(list)
    for run in runs:
        found[run["task"]].append(run["success_rate"])
    return [np.array(scores) for scores in found.values()]


def page(rows: Sequence[dict[str, Any]]) -> str:
    """The page of these rows."""
    lines = [INTRODUCTION]
    changes = [abs(row["present_probe"] - row["probe"]) for row in rows if "present_probe" in row]
    if changes:
        lines.append(CHANGED.format(most=max(changes)))
    for tier, what in TIERS.items():
        lines += [f"## {tier.capitalize()}\n", what + "\n", *table_of(tier, rows), ""]
        variants = [
            variant
            for variant in VARIANTS
            if variant.tier == tier and any(row["task"] == variant.id for row in rows)
        ]
        if variants:
            lines += [
                f"| task | is | {'what makes it hard' if tier == 'hard' else 'what is different'} |",
                "|---|---|---|",
            ]
            for variant in variants:
                arguments = ", ".join(f"{name}={value!r}" for name, value in variant.arguments.items())
                lines.append(f"| `{variant.id}` | `{variant.of}`, `{arguments}` | {variant.why} |")
            lines.append("")
    lines += [
        "## Algorithms\n",
        *table_of_costs(rows),
        "",
        "![Share of the runs in these tasks above each success rate](figures/baselines.svg)\n",
        *(table_of_times(read(TIMES)) if TIMES.exists() else []),
        AGENTS,
        *table_of_agents(),
        "",
        METHOD,
    ]
    cpus, versions = (sorted({row[key] for row in rows}) for key in ("cpu", "springgym"))
    lines.append(f"Measured with springgym {', '.join(versions)} on {', '.join(cpus)}.\n")
    return "\n".join(lines)


def draw(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Performance profiles: how large a share of an algorithm's runs does better than each level."""
    matplotlib.use("svg")
    from matplotlib import pyplot as plt

    matplotlib.rcParams["svg.hashsalt"] = "springgym"
    figure, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
    levels = np.linspace(0, 1, 101)
    wide, tasks = compared(rows)
    for name in wide:
        runs = [row["success_rate"] for row in rows if row["algorithm"] == name and row["task"] in tasks]
        axes.step(100 * levels, 100 * profile(np.array(runs), levels), where="post", label=name)
    axes.set(xlabel="success, %", ylabel="runs above it, %", xlim=(0, 100), ylim=(0, 102))
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def key(row: dict[str, Any]) -> tuple[str, str, int]:
    """Return the task, the algorithm and the seed that a row is of."""
    return row["task"], row["algorithm"], row["seed"]


def read(path: Path) -> list[dict[str, Any]]:
    """The rows of a file."""
    return list(json.loads(path.read_text(encoding="utf-8")))


def mark(rows: Sequence[dict[str, Any]]) -> None:
    """Give rows of a task that has changed since the present probe, and take it from all others."""
    from benchmark import probe

    present = {task: probe(task) for task in sorted({row["task"] for row in rows})}
    for row in rows:
        row.pop("present_probe", None)
        if abs(row["probe"] - present[row["task"]]) > SAME:
            row["present_probe"] = present[row["task"]]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", type=Path, nargs="+", default=[], help="rows to take in")
    parser.add_argument("--mark", action="store_true", help="mark rows of tasks that have changed since")
    options = parser.parse_args()
    rows = {}
    for path in [*([ROWS] if ROWS.exists() else []), *options.rows]:
        rows |= {key(row): row for row in read(path)}
    known = {task.id for task in TASKS}
    kept = [rows[of] for of in sorted(rows) if of[0] in known]
    if options.mark:
        mark(kept)
    ROWS.write_text("[\n" + ",\n".join(map(json.dumps, kept)) + "\n]\n", encoding="utf-8")
    PAGE.write_text(page(kept), encoding="utf-8")
    draw(kept, FIGURE)


if __name__ == "__main__":
    main()
