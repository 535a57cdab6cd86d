"""Play published agents and classical control in worlds that they were not made for.

    python agents/studies/generalize.py SpringTop-v0 SpringTumble-v0
    python agents/studies/generalize.py --rows docs/generalization.json      # every environment

`WORLDS` lists the worlds. In each of them, every agent plays the same 100 held-out episodes. An episode draws
its parameters from its seed, so the sets of parameters are fixed, too. The script prints a table of success
and of the return as a share of that in the world "as it is". With ``--rows``, it also writes a row for every
agent and world to a JSON file. Rows that are there are kept if neither the task nor the agent has changed, so
the same command continues a run that was stopped. A world that a task cannot have is told with the reason.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from hashlib import sha256
from operator import itemgetter
from pathlib import Path
from typing import Any

import _path  # noqa: F401  (first)
from config import MENDABLE, ConfigError, command_line, making, new_file, whole
from controllers import CLASSICAL
from evaluate import MOST_EPISODES, evaluate, find_task, percent
from results import PROTOCOL, Rows, change_rows, interval_of_returns, made_with, probe, read_rows

from springgym.cli import guarded
from springgym.envs.registration import ENVIRONMENTS, spec_of
from springgym.envs.trained import PUBLISHED, published

WORLDS: Mapping[str, Mapping[str, Any]] = {
    "as it is": {},
    "rigid": {"dynamics": "rigid", "integrator": None, "step": None},
    "soft": {"randomize": {"stiffness": (0.3, 0.3)}},
    "varied": {"randomize": {"masses": (0.8, 1.2), "actuator": (0.8, 1.2)}},
    "light": {"randomize": {"masses": (0.6, 0.8)}},
    "heavy": {"randomize": {"masses": (1.2, 1.4)}},
    "weak": {"randomize": {"actuator": (0.6, 0.8)}},
    "strong": {"randomize": {"actuator": (1.2, 1.4)}},
}
"""The arguments of each world, by its name. Agents may learn in "varied"; the four after it are held out."""


def agents_of(task: str, within: Path = PUBLISHED) -> list[tuple[str, str]]:
    """Return the names and digests of the agents of a task: the published one, and classical control."""
    found = []
    if (within / task / "card.json").exists():
        card = json.loads((published(task, within) / "card.json").read_text(encoding="utf-8"))
        found.append((card["algorithm"], sha256(json.dumps(card["sha256"]).encode()).hexdigest()[:8]))
    if task in CLASSICAL:
        found.append(("classical", ""))
    return found


def played(task: str, agent: str, world: str, episodes: int) -> dict[str, Any]:
    """Return what an agent reaches in a world; of a world that the task cannot have, the reason."""
    name = agent if agent == "classical" else str(published(task))
    with making(task):
        env_id, kwargs = find_task([name], task, ())
    try:
        found = evaluate(name, env_id, {**kwargs, **WORLDS[world]}, episodes)
    except ConfigError as error:
        if not WORLDS[world]:
            raise
        return {"refused": str(error)}
    return {
        "mean_return": round(found.return_per_step, 6),
        "return_interval": [round(end, 4) for end in interval_of_returns(found.returns_per_step)],
        "success_rate": found.success_rate,
        "first_seed": found.first_seed,
        "episodes": episodes,
    }


def rows_of(task: str, kept: Sequence[Mapping[str, Any]], episodes: int) -> list[dict[str, Any]]:
    """Return the rows of a task, one for every agent and world: those that hold still, and new ones."""
    rows: list[dict[str, Any]] = []
    present: dict[str, Any] = {"protocol": PROTOCOL, "probe": probe(task), "asked": episodes}
    for agent, digest in agents_of(task):
        for world, arguments in WORLDS.items():
            whose = {"task": task, "agent": agent, "digest": digest, "world": world}
            whose = {**whose, "arguments": json.loads(json.dumps(arguments)), **present}
            same = [dict(row) for row in kept if {name: row.get(name) for name in whose} == whose]
            rows.append(same[0] if same else whose | played(task, agent, world, episodes) | made_with())
    return rows


def with_task(rows: Rows, task: str, new: Rows) -> Rows:
    """Return rows with ``new`` ones in place of those of a task, ordered by task."""
    others = {name: row for name, row in rows.items() if row["task"] != task}
    return dict(sorted((others | new).items(), key=lambda item: str(item[1]["task"])))


def table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the lines of a table: a row for each agent, and a column for each world."""
    lines = [f"| task | agent | {' | '.join(WORLDS)} |", "|---" * (len(WORLDS) + 2) + "|"]
    for task, agent in dict.fromkeys((row["task"], row["agent"]) for row in rows):
        of = {row["world"]: row for row in rows if (row["task"], row["agent"]) == (task, agent)}
        cells = []
        for world in WORLDS:
            row = of.get(world)
            if row is None or "refused" in row:
                cells.append("")
                continue
            share = row["mean_return"] / of["as it is"]["mean_return"]
            cells.append(f"{percent(row['success_rate'])}, {share:.2f}")
        lines.append(f"| `{task}` | {agent} | {' | '.join(cells)} |")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = command_line(__doc__)
    parser.add_argument("tasks", metavar="ID", nargs="*", help="environment ids (default: all)")
    what = "held-out episodes of each agent and world (default: 100)"
    parser.add_argument("--episodes", type=whole(2, MOST_EPISODES), default=100, help=what)
    parser.add_argument("--rows", type=new_file(), help="JSON file of rows, to be continued")
    options = parser.parse_args(arguments)
    return guarded("generalize.py", lambda: _generalize(options), MENDABLE)


def _generalize(options: argparse.Namespace) -> int:
    known = [row.id for row in ENVIRONMENTS]
    for task in options.tasks:
        spec_of(task)
        if task not in known:
            raise ConfigError(f"{task!r} is not one of {', '.join(known)}")
    key = itemgetter("task", "agent", "world")
    rows = read_rows(options.rows, key) if options.rows else {}
    for task in options.tasks or [row.id for row in ENVIRONMENTS]:
        new = rows_of(task, list(rows.values()), options.episodes)
        taken = partial(with_task, task=task, new={key(row): row for row in new})
        rows = taken(rows)
        print("\n".join(table(new) if options.tasks else [task]), flush=True)
        for row in new:
            if "refused" in row:
                print(f"{task}, {row['world']}: {row['refused']}")
        if options.rows:
            change_rows(options.rows, taken, key)
    if not options.tasks:
        print("\n".join(table(list(rows.values()))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
