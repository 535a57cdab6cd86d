"""Write the page of baselines from the rows of the benchmark; nothing is trained or measured.

python docs/baselines.py                                         # the page and its figures, from the rows
python docs/baselines.py --rows runs/benchmark/baselines.json    # take these rows in first
python docs/baselines.py --mark    # first mark the rows of tasks that have changed since
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.ticker import EngFormatter

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "agents"), str(HERE.parent / "agents" / "studies")]

from config import CONFIG_OF, load_config  # noqa: E402
from environments import ALGORITHMS, FEWEST, TIERS, earned, measure, shown  # noqa: E402
from evaluate import percent  # noqa: E402
from generalize import table as worlds  # noqa: E402
from learning_time import shown as times  # noqa: E402
from results import (  # noqa: E402
    COLORS,
    LINES,
    PROTOCOL,
    REFERENCES,
    SAMPLES,
    SECONDS,
    SUITE,
    identity,
    interquartile_mean,
    interval,
    interval_of_mean,
    is_old,
    probe,
    reached,
    refusal,
    same_probe,
    scores,
    used,
)
from runs import write_rows  # noqa: E402

from springgym.cli import Parser, guarded, write_text  # noqa: E402
from springgym.envs.registration import ENVIRONMENTS, VARIANTS, Row, Variant  # noqa: E402
from springgym.scenes.strict_yaml import YamlError, read_json  # noqa: E402

ROWS = HERE / "baselines.json"
PAGE = HERE / "baselines.md"
CURVES = HERE / "figures" / "curves"
PLANNER = HERE / "planner.json"
"""Rows of ``agents/plan.py``."""
ELSEWHERE = HERE / "generalization.json"
"""Rows of ``agents/studies/generalize.py``."""
OFFLINE = HERE / "offline.json"
"""Rows of agents that learned from data, which enter no table of those that play to learn."""
COLUMNS = ("ppo", "classical", "planner")
"""Algorithms with columns of their own in the tables of tiers."""
NOTHING = ("random", "noop")
ALWAYS = {("classical", "model"), ("planner", "planning")}
"""What algorithms use by their nature, see `results.USED`."""
TRAINED = ("linear", "ppo", "sac", "tqc", "her")
TIMES = HERE / "learning_time.json"
"""What ``agents/studies/learning_time.py`` measured."""
CARDS = HERE.parent / "agents" / "trained"
NARROW = (4.8, 5.6)
"""Size of a figure of learning curves [inches]: a phone shows it whole, and its text can be read there."""
TASKS: tuple[Row | Variant, ...] = (*ENVIRONMENTS, *VARIANTS)
INTRODUCTION = """# Baselines

![Scores on the suite](figures/baselines.svg)

Mean scores on the [suite](#suite): 0 % is random play, 100 % the better of classical control and a planner.
Bars show interquartile means over tasks and seeds, with 95 % intervals.

This page lists the score of each algorithm on each task, under one [protocol](benchmark.md). In the tables of
tiers, each cell gives

- the return per step (at most 1), or per episode where the task says so, averaged over training seeds;
- the share of held-out episodes that succeed. Agents play without exploration;
- the return's 95 % interval and, for several seeds, their number (for one seed, the interval is over its
  episodes);
- what an algorithm used in addition to the rewards of its own episodes, if it did:
  [the protocol](benchmark.md#what-is-reported) lists these.

**Bold** marks the best known return of a task. A dash means "not run". *Sparse* is PPO with the sparse
reward. *Classical* is a hand-written controller with a model of the task. *Planner* searches with the exact
simulator. [Environments](environments.md#tiers-and-harder-variants) describes the variants. You can
[submit results](benchmark.md#submit-results).
"""
OLD = """† Some results of this task predate the current protocol, physics or reward. This applies to {old} of
all {all} results.
"""
AGENTS = """## Trained agents

The package contains one agent for each environment, the best of those compared on the [selection
episodes](benchmark.md#seeds-and-episodes): its weights, its configuration and a card with the training
command, versions, checksums, evaluation and audit.

```sh
springgym evaluate SpringTop-v0 --seed 2500000   # the episodes of the table
springgym watch SpringTop-v0 --out top.gif
```

The last column is the [audit](training.md#audit-and-generalization), which checks whether an agent exploits
simulation errors. "Not played" means that this simulation could not run the task when the agent was audited,
or would change the task, because colliding rigid bodies rebound differently.
"""
TIME = """## Time to learn

The table gives the training time of PPO, with the package's configuration, until it succeeds in 90 % of 20
held-out episodes (evaluated every 32,768 steps; in SpringTop-v0, every 16,384). Times are seconds of one core
of {cpu}, divided into physics, policy and learning.
`python agents/studies/learning_time.py --json docs/learning_time.json` measures them.

{table}
"""
PLANS = """## Planner

The planner searches with the exact simulator and learns nothing
([method](training.md#plan-without-learning)). The table lists its settings, its results with 95 % intervals,
and its cost in core seconds per simulated second. Where bodies collide, planning is expensive, so most such
tasks have fewer or shorter plans. Classical control earns more in most of these tasks.

{table}
"""
COMPARISON = """## Suite

Algorithms are compared on {tasks} tasks at equal budgets. A score is the return, rescaled from random actions
(0 %) to the better of classical control and the planner (100 %), which plays 10 episodes. *Reference* gives
its return per step (per episode where the task says so), its success, and which of the two it is. Cells give
the mean score over {seeds} seeds and, in brackets, the lowest and the highest; below, the success rate and,
for a budget of time, the number of steps that it bought. *Noop* does nothing. The last row gives the
interquartile mean over all runs and, for several seeds, its 95 % interval, a bootstrap over seeds stratified
by task. An algorithm that used more than the rewards of its own episodes has its own column. A dash means
that there is no result, or that its run was shorter than the budget. The [protocol](benchmark.md) asks for
five seeds; learned results without a seed count come from a single seed.
"""
WORLDS = """## Generalization

Trained agents and classical control play each task with changed physics. Each cell gives the success rate,
and the return as a share of the return in the unchanged task.

- *Rigid*: rigid bodies. *Soft*: springs with 0.3 times the stiffness.
- *Varied*: masses and actuator strength drawn between 0.8 and 1.2 times the default.
- *Light* and *heavy*: masses between 0.6 and 0.8, or 1.2 and 1.4, times the default. *Weak* and *strong*: the
  same factors for actuators.

Factors are drawn from the episode's seed, so these sets are fixed. A dash means that the change does not
apply to the task.

```sh
python agents/studies/generalize.py --rows docs/generalization.json
```

{table}

{missing}
"""
FROM_DATA = """## Offline learning

Agents learn only from [recorded episodes of other agents](training.md#data-for-offline-learning). The data:
*random* actions; the *published* agent; *medium*, PPO that was stopped early; *noisy*, with noise added to
the actions. IQL is implicit Q-learning with the hyperparameters of `configs/iql.yaml`. Brackets give the 95 %
interval over training seeds and episodes. These results enter no other table or mean.

{table}

These commands record the data of SpringTop-v0 and learn from it:

```sh
springgym train SpringTop-v0 --timesteps 100_000 --out runs/medium
python agents/studies/dataset.py SpringTop-v0 random SpringTop-v0 --set observation=features
python agents/studies/dataset.py SpringTop-v0 runs/medium --noise 0.3
python agents/studies/offline.py SpringTop-v0 --data springgym/SpringTop/medium-noisy-v0 \\
    --rows runs/offline.json
python docs/baselines.py --rows runs/offline.json
```

The medium agent was trained for 300,000 steps in SpringTumble-v0, and for 65,536 in SpringRope-v0. The random
data of SpringTumble-v0 is also recorded with `--set observation=features`, which the trained agents observe.
"""
METHOD = """## How it was made

```sh
python -m pip install -c constraints.txt -e ".[agents,ray]"
python agents/benchmark.py --runs runs/benchmark
python agents/benchmark.py --runs runs/benchmark --seconds 0 --tasks SpringTop-v0 SpringRope-v0
python agents/plan.py --json docs/planner.json
python docs/baselines.py --rows runs/benchmark/baselines.json
python docs/environments.py
```

The second command trains and evaluates the suite, on all cores or on a Ray cluster; run again, it continues.
The third does the same for other tasks, and the fourth plans. The last two write this page, all curves and
the environments' pages. Runs with a fixed number of steps (`--seconds 0`) are bit-identical on the same
machine and commit; runs with a fixed number of seconds end at a different step each time.

- *Classical* is the hand-written controller in `agents/controllers.py`.
- `configs/` holds the hyperparameters and the observation. Where a file names no observation, PPO observes
  particles, and the other algorithms `"features"`. A variant without an entry uses the hyperparameters of its
  environment.
- Runs outside the suite take the number of steps in their configuration (`--seconds 0`).
- In some tasks, PPO first [imitates](training.md#warm-starting-from-the-classical-controller) classical
  control: in the first 400,000 steps of `SpringDuel-v0`, and in the first 250,000 steps of `SpringShove-v0`
  and `SpringStack-v0`.
- Seconds are processor time of one core, so they do not depend on what else the machine does.
{older}
The results are in `docs/baselines.json`; [the protocol](benchmark.md) describes its entries.
"""
OLDER = """- {old} of {all} results predate the first protocol. They hold neither episodes nor a learning
  curve, and have an interval only with {fewest} seeds or more. {dirty} of them were made with uncommitted
  changes. In most of them, the runs of a task shared most of their starts. The benchmark now refuses such
  results.
"""


def cells(rows: Iterable[dict[str, Any]]) -> dict[tuple[str, str], list[dict[str, Any]]]:
    """The rows of every task and algorithm."""
    found = defaultdict(list)
    for row in rows:
        found[row["task"], row["algorithm"]].append(row)
    return found


def best_known(task: str, by_cell: dict[tuple[str, str], list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Return the rows of the algorithm that returns most in a task, a planner or controller among them."""
    found = [runs for (name, _), runs in by_cell.items() if name == task]
    return max(found, key=lambda runs: float(np.mean([run["mean_return"] for run in runs])), default=[])


def means_of(runs: Sequence[dict[str, Any]]) -> list[str]:
    """Return what the rows of an algorithm in a task used, of `results.USED`."""
    algorithm: Any = runs[0]["algorithm"]
    if "used" in runs[0]:
        return list(runs[0]["used"])
    return used(algorithm, load_config(algorithm, runs[0]["task"]) if algorithm in CONFIG_OF else None)


def sparse_of(task: str) -> str | None:
    """Return the id of the sparse task of an environment's usual task."""
    return next((own.id for own in VARIANTS if own.of == task and own.arguments == {"sparse": True}), None)


def table_of(tier: str, rows: Sequence[dict[str, Any]]) -> list[str]:
    """The tasks of a tier with what was reached: in columns what most tasks have, and the others in one."""
    tasks = [task.id for task in TASKS if task.tier == tier]
    everything = cells([*rows, *planned()])
    lines = [f"| task | {' | '.join(COLUMNS)} | others | random; noop |", "|---" * (len(COLUMNS) + 3) + "|"]
    for task in tasks:
        by_name = {name: runs for (of, name), runs in everything.items() if of == task}
        if not by_name:
            continue
        best = best_known(task, everything)[0]["algorithm"]
        results = [result(name, by_name.get(name, []), name == best) for name in COLUMNS]
        others = [name for name in ALGORITHMS if name in by_name and name not in (*COLUMNS, *NOTHING)]
        told = [f"{name} {result(name, by_name[name], name == best)}" for name in others]
        if sparse := everything.get((sparse_of(task) or "", "ppo")):
            told.append(f"sparse {result('ppo', sparse)}")
        idle = [shown(by_name[name]).partition("<br>")[0] for name in NOTHING if name in by_name]
        mark = " †" if any(row["task"] == task and is_old(row) for row in rows) else ""
        line = [named(task, mark), *results, "<br>".join(told), "<br>".join(idle)]
        lines.append(f"| {' | '.join(line)} |")
    return lines


def named(task: str, mark: str = "") -> str:
    """Return the first cell of a task."""
    return f"`{task}`{mark}{'<br>per episode' if measure(task)[1] else ''}"


def result(name: str, runs: Sequence[dict[str, Any]], best: bool = False) -> str:
    """Return a cell of an algorithm's runs, and what it used, but for what it uses by its nature."""
    if not runs:
        return ""
    beside = [what for what in means_of(runs) if (name, what) not in ALWAYS]
    return "<br>".join([shown(runs, best), *beside])


def suite(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the section that compares algorithms at equal seconds and at equal steps."""
    current = [row for row in [*rows, *planned()] if not is_old(row)]
    tables = scores_at(rows)
    learned = [own for _, found in tables for name, own in found.items() if name != ("noop",)]
    seeds = sorted({len(scores) for own in learned for scores in own.values()})
    lines = [COMPARISON.format(tasks=len(SUITE), seeds=" or ".join(map(str, seeds)))]
    for column, (budget, found) in ((1, tables[0]), (0, tables[1])):
        names = list(found)
        lines += [f"### After {told(column, budget)}\n"]
        if not names:
            lines.append("There are no results for this protocol yet.\n")
            continue
        lines.append(f"| task | reference | {' | '.join(', '.join(name) for name in names)} |")
        lines.append("|---" * (len(names) + 2) + "|")
        for task in SUITE:
            own = [
                scored(found[name].get(task, np.array([])), name, task, current, column, budget)
                for name in names
            ]
            lines.append(f"| {named(task)} | {reference(task, current)} | {' | '.join(own)} |")
        means = [f"{quartiles([*found[name].values()])}<br>{len(found[name])} tasks" for name in names]
        lines += [f"| all | 100 % | {' | '.join(means)} |", ""]
    return lines


def scores_at(rows: Sequence[dict[str, Any]]) -> list[tuple[float, dict[tuple[str, ...], Any]]]:
    """Return the budgets of the suite, seconds and steps, each with the scores that were reached in it.

    What learns comes first.
    """
    current = [row for row in [*rows, *planned()] if not is_old(row)]
    tables = []
    for column, budget in ((1, SECONDS), (0, SAMPLES)):
        found = scores(current, column, budget)
        order = sorted(found, key=lambda name: (name[0] in NOTHING, name))
        tables.append((budget, {name: found[name] for name in order}))
    return tables


def told(column: int, budget: float) -> str:
    """Return a budget of steps (column 0) or seconds (1) as text."""
    return f"{budget:,.0f} {('steps', 'seconds of one core')[column]}"


def reference(task: str, rows: Sequence[dict[str, Any]]) -> str:
    """Return what scores 100 % in a task: its return and success, and who reached them."""
    known = cells(row for row in rows if row["algorithm"] in REFERENCES)
    best = best_known(task, known)
    return f"{shown(best).partition('<br>')[0]}<br>{best[0]['algorithm']}" if best else ""


def scored(
    found: np.ndarray,
    name: tuple[str, ...],
    task: str,
    rows: Sequence[dict[str, Any]],
    column: int,
    budget: float,
) -> str:
    """Return a cell of the suite: scores (seeds,); below, success and steps, of algorithms that learn."""
    runs = [row for row in rows if row["task"] == task and (row["algorithm"], *row.get("used", ())) == name]
    success, steps = (
        [value for row in runs if row["steps"] and (value := reached(row, column, budget, what)) is not None]
        for what in ("success_rate", "steps")
    )
    if not success:
        return spread(found)
    taken = f", {EngFormatter()(float(f'{np.mean(steps):.2g}'))}" if column else ""
    return f"{spread(found)}<br>{100 * np.mean(success):.0f} %{taken}".replace(" ", "\N{NO-BREAK SPACE}")


def spread(scores: np.ndarray) -> str:
    """Return scores (seeds,) as text in %: their mean and, of several, the lowest and the highest."""
    if not len(scores):
        return ""
    mean, least, most = (f"{100 * score:z.0f}" for score in (scores.mean(), scores.min(), scores.max()))
    return f"{mean} % ({least} to {most})" if len(scores) > 1 else f"{mean} %"


def table_of_plans(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the lines of the table of the planner's settings and results."""
    lines = [
        "| task | samples × iterations | horizon | return per step | success | episodes | "
        "compute s / simulated s |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        scale, unit = measure(row["task"])
        plans = row["planner"]
        low, high = (scale * end for end in row["return_interval"])
        least, most = (max(0.0, 100 * end) for end in row["success_interval"])
        results = [
            f"`{row['task']}`",
            f"{plans['samples']} × {plans['iterations']}",
            f"{plans['horizon']:g} s",
            f"{scale * row['mean_return']:z.2f} ({low:z.2f}–{high:z.2f}){unit}",
            f"{100 * row['success_rate']:.0f} % ({least:.0f}–{most:.0f})",
            str(row["episodes"]),
            f"{row['real_time_factor']:.2f}",
        ]
        lines.append(f"| {' | '.join(results)} |")
    return lines


def planned() -> list[dict[str, Any]]:
    """The rows of the planner, if there are any."""
    return read(PLANNER) if PLANNER.exists() else []


def table_of_worlds() -> list[str]:
    """Return the section on agents in other worlds, if there are rows of it."""
    if not ELSEWHERE.exists():
        return []
    rows = read(ELSEWHERE)
    left = [f"`{row.id}`" for row in ENVIRONMENTS if row.id not in {played["task"] for played in rows}]
    missing = f"These tasks have not been played yet: {', '.join(left)}.\n" if left else ""
    return [WORLDS.format(table="\n".join(worlds(rows)), missing=missing)]


def recorded() -> list[dict[str, Any]]:
    """Return the rows of offline learning, if there are any."""
    return read(OFFLINE) if OFFLINE.exists() else []


def table_of_data(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the lines of the table of what was learned from data."""
    by_data = defaultdict(list)
    for row in rows:
        by_data[row["task"], row["algorithm"], json.dumps(row["data"])].append(row)
    lines = [
        "| task | learned from | transitions | return of the data | algorithm | updates | return per step | "
        "success | seeds |",
        "|---" * 9 + "|",
    ]
    found = list(by_data.values())
    found.sort(key=lambda runs: (*identity(runs[0])[:2], runs[0]["data"][0]["mean_return"]))
    for runs in found:
        task = runs[0]["task"]
        data = runs[0]["data"]
        scale, unit = measure(task)
        mark = " †" if any(map(is_old, runs)) else ""
        returns = " + ".join(f"{scale * own['mean_return']:z.2f}{unit}" for own in data)
        success = np.array([run["success_rate"] for run in runs])
        counts = np.array([run["episodes"] for run in runs])
        likely = (success * counts + 2) / (counts + 4)  # Agresti and Coull: 0 of 100 is no certainty
        errors = np.sqrt(likely * (1 - likely) / (counts + 4))
        low, high = interval_of_mean(success, errors)
        low, high = (100 * min(max(end, 0.0), 1.0) for end in (low, high))
        results = [
            f"`{task}`{mark}",
            " + ".join(own["agent"] for own in data),
            f"{sum(own['transitions'] for own in data):,}",
            returns,
            runs[0]["algorithm"],
            f"{runs[0]['steps']:,}",
            earned(runs),
            f"{100 * success.mean():.0f} % ({low:.0f}–{high:.0f})",
            str(len(runs)),
        ]
        lines.append(f"| {' | '.join(results)} |")
    return lines


def quartiles(scores: Sequence[np.ndarray]) -> str:
    """Return the interquartile mean of scores (seeds,) of tasks [%]; of several seeds, also its interval."""
    mean = f"{100 * interquartile_mean(np.concatenate(scores)):.0f} %"
    if max(map(len, scores)) == 1:
        return mean
    low, high = interval(scores, interquartile_mean)
    return f"{mean} ({100 * low:.0f}–{100 * high:.0f})"


def table_of_times(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return tables of the time that learning takes, see ``agents/studies/learning_time.py``."""
    cpus = ", ".join(sorted({row["measured"]["cpu"] for row in rows}))
    return [TIME.format(table=times(rows), cpu=cpus)]


def table_of_agents() -> list[str]:
    """The agents of the repository, see ``agents/studies/publish.py``."""
    lines = [
        "| task | algorithm | return per step, 95 % interval | success | loss in the audit |",
        "|---|---|---|---|---|",
    ]
    for path in sorted(CARDS.glob("*/card.json")):
        card = json.loads(path.read_text(encoding="utf-8"))
        scale, unit = measure(card["task"])
        low, high = (scale * end for end in card["interval"])
        chosen = "" if "selection_return" in card else " ‡"
        chosen += " §" if "trained_probe" in card else ""
        own, *others = card["audit"]
        lost = [
            f"{found['simulation']}: {found['verdict']}"
            + ("" if found["refused"] else f", {100 * found['lost'] / abs(own['return_per_step']):+z.2f} %")
            for found in others
        ]
        told = f"{scale * card['mean_return']:.3f} ({low:.3f}–{high:.3f}){unit}{chosen}"
        lines.append(
            f"| `{card['task']}` | {card['algorithm']}, seed {card['seed']} | {told} | "
            f"{percent(card['success_rate'])} | {'<br>'.join(lost)} |"
        )
    if any("§" in line for line in lines):
        text = "This agent was trained on an earlier version of the task, with different physics or reward."
        lines.append(f"\n§ {text}")
    if any("‡" in line for line in lines):
        lines.append("\n‡ This agent was selected among several seeds on the episodes in the table.")
    return lines


def page(rows: Sequence[dict[str, Any]]) -> str:
    """The page of these rows."""
    lines = [INTRODUCTION, *suite(rows)]
    offline = recorded()
    if old := sum(map(is_old, [*rows, *offline])):
        lines.append(OLD.format(old=old, all=len(rows) + len(offline)))
    for tier, what in TIERS.items():
        lines += [f"## {tier.capitalize()}\n", what + "\n", *table_of(tier, rows), ""]
    lines += [
        PLANS.format(table="\n".join(table_of_plans(planned()))),
        *(table_of_times(read(TIMES)) if TIMES.exists() else []),
        AGENTS,
        *table_of_agents(),
        "",
        *table_of_worlds(),
        *([FROM_DATA.format(table="\n".join(table_of_data(offline)))] if offline else []),
        METHOD.format(older=older(rows)),
    ]
    cpus = ", ".join(sorted({row["cpu"] for row in rows}))
    commits = ", ".join(sorted({(row["commit"] or "unknown")[:8] for row in rows}))
    lines.append(f"Measured on {cpus}, at commits {commits}.\n")
    return re.sub(r"(?<=\|)  (?=\|)", " – ", "\n".join(lines))


def older(rows: Sequence[dict[str, Any]]) -> str:
    """Return the paragraph on rows that are older than the first protocol."""
    old = [row for row in rows if "protocol" not in row]
    dirty = sum("dirty" in (row["commit"] or "") for row in old)
    return OLDER.format(old=len(old), all=len(rows), dirty=dirty, fewest=FEWEST) if old else ""


def draw_curves(rows: Sequence[dict[str, Any]], folder: Path) -> None:
    """Draw the learning curves of every environment of which rows have some, and remove the others."""
    from matplotlib import pyplot as plt
    from matplotlib.ticker import LogLocator, NullFormatter

    folder.mkdir(exist_ok=True)
    by_cell = cells([*rows, *planned()])
    for row in ENVIRONMENTS:
        path = folder / f"{row.id}.svg"
        curves = {
            name: [run["curve"] for run in by_cell.get((row.id, name), []) if run.get("curve")]
            for name in TRAINED
        }
        if not any(curves.values()):
            path.unlink(missing_ok=True)
            continue
        figure, axes = plt.subplots(2, 1, figsize=NARROW, sharey=True, layout="constrained")
        scale, unit = measure(row.id)
        for column, own in enumerate(axes):
            for name in TRAINED:
                if curves[name]:
                    draw_curve(own, curves[name], column, scale, name)
            for name in REFERENCES:
                if runs := by_cell.get((row.id, name)):
                    level = scale * np.mean([run["mean_return"] for run in runs])
                    own.axhline(level, color="0.25", ls=LINES[name], lw=1.5, label=name)
            own.margins(y=0.1)
            own.grid(alpha=0.3)
            own.set_ylabel(f"return{unit or ' per step'}")
        axes[0].set(xlabel="samples", xscale="log", title=row.id)
        axes[0].set_ylim(bottom=min(0.0, axes[0].get_ylim()[0]))
        axes[0].xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        axes[0].xaxis.set_major_formatter(EngFormatter(sep=""))
        axes[0].xaxis.set_minor_formatter(NullFormatter())
        axes[1].set(xlabel="seconds of one core")
        figure.legend(
            *axes[1].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False
        )
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)


def draw_suite(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw the interquartile means of the suite, a panel for each budget, see `benchmarks.figures`."""
    from benchmarks.figures import Bar, draw_bars

    panels = {}
    for column, (budget, found) in zip((1, 0), scores_at(rows), strict=True):
        bars = []
        for name in found:
            own = [*found[name].values()]
            low, high = (100 * end for end in interval(own, interquartile_mean))
            mean = 100 * interquartile_mean(np.concatenate(own))
            bars.append(Bar(", ".join(name), mean, low, high, COLORS.get(name[0], "0.6")))
        panels[f"after {told(column, budget)}"] = bars
    draw_bars(panels, "interquartile mean of scores, % (dashes: the reference)", path)


def draw_curve(
    axes: Any, curves: Sequence[Sequence[Sequence[float]]], column: int, scale: float, name: str
) -> None:
    """Draw the median of curves against samples (column 0) or seconds (1), and the band of all.

    Every curve is interpolated at common places, as far as all of them reach.
    """
    tables = [np.array([point[:3] for point in points], float) for points in curves]
    first = max(t[0, column] for t in tables)
    last = min(t[-1, column] for t in tables)
    at = np.linspace(first, last, 100) if column else np.geomspace(max(first, 1.0), last, 100)
    values = scale * np.array([np.interp(at, table[:, column], table[:, 2]) for table in tables])
    middle = np.median(values, axis=0)
    told = f"{name}, {len(curves)} seed{'s' * (len(curves) > 1)}"
    axes.plot(at, middle, color=COLORS[name], lw=2, label=told)
    axes.fill_between(at, values.min(axis=0), values.max(axis=0), color=COLORS[name], alpha=0.3, lw=0)


def apart(rows: Iterable[dict[str, Any]]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the rows of what plays or plans, and the rows of what learned from data."""
    found: tuple[list[dict[str, Any]], list[dict[str, Any]]] = [], []
    for row in rows:
        found["data" in row].append(row)
    return found


def read(path: Path) -> list[dict[str, Any]]:
    """The rows of a file."""
    rows = read_json(path)
    if not isinstance(rows, list):
        raise YamlError(f"{path}: the file must hold a list of rows")
    return rows


def refuse(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """End the program if rows are not what the protocol asks for, see `results.refusal`."""
    if found := [f"{path}, row {n}: {why}" for n, row in enumerate(rows) if (why := refusal(row))]:
        sys.exit("\n".join(found))


def mark(rows: Sequence[dict[str, Any]]) -> None:
    """Give rows of a task that has changed since the present probe, and take it from all others.

    Rows of an earlier protocol are old whatever their probe is, and are left as they are.
    """
    for row in rows:
        if row.get("protocol") == PROTOCOL:
            row.pop("present_probe", None)
            if not same_probe(row["probe"], row["task"]):
                row["present_probe"] = probe(row["task"])


def main() -> int:
    """Command line."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=Path, nargs="+", default=[], help="rows to take in")
    parser.add_argument("--mark", action="store_true", help="mark rows of tasks that have changed since")
    options = parser.parse_args()
    return guarded("baselines.py", lambda: write(options))


def write(options: argparse.Namespace) -> int:
    """Take rows in, and write the files of rows, the page and its figures."""
    rows = {identity(row): row for row in [*(read(ROWS) if ROWS.exists() else []), *recorded()]}
    for path in options.rows:
        taken = read(path)
        refuse(path, taken)
        rows |= {identity(row): row for row in taken}
    known = {task.id for task in TASKS}
    everything = [rows[run] for run in sorted(rows) if run[0] in known]
    if options.mark:
        mark(everything)
    kept, offline = apart(everything)
    for path, own in ((ROWS, kept), (OFFLINE, offline)):
        write_rows(path, own)
    write_text(PAGE, page(kept))
    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "springgym"
    draw_curves(kept, CURVES)
    draw_suite(kept, HERE / "figures" / "baselines.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
