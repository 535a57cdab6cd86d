"""Write a row of what the planner reaches in every environment, in the form of ``agents/benchmark.py``.

    python agents/studies/plan_rows.py docs/planner.json

A task that has a row is skipped, unless its planner, the task or the protocol has changed since. Episodes are
written ten at a time: if the command was stopped, the same command continues.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

import _path  # noqa: F401  (first)
from config import MENDABLE, whole
from plan import AT_ONCE, Planner, line_of, planner_of, play_episodes, summary
from results import PROTOCOL, add_row, identity, made_with, probe, read_rows, same_probe
from runs import HELD_OUT_SEED

from springgym.cli import INTERRUPTED, guarded
from springgym.registration import spec_of

CHEAPEST_FIRST = (
    "SpringBilliards-v0",
    "SpringTop-v0",
    "SpringRope-v0",
    "SpringPendulum-v0",
    "SpringDetumble-v0",
    "SpringGyroscope-v0",
    "SpringTumble-v0",
    "SpringFreeTop-v0",
    "SpringLabyrinth-v0",
    "SpringDuel-v0",
    "SpringBalance-v0",
    "SpringShove-v0",
    "SpringStack-v0",
    "SpringTower-v0",
    "SpringJuggle-v0",
)
"""The environments, by what a row costs."""


def digest(planner: Planner) -> str:
    """Return eight letters that depend on the settings of a planner."""
    return sha256(repr(planner).encode()).hexdigest()[:8]


def make_row(task: str, episodes: int, path: Path) -> dict[str, Any]:
    """Play episodes of a task, from where the file of episodes stands, and return the row."""
    planner, seeds = planner_of(task), range(HELD_OUT_SEED, HELD_OUT_SEED + episodes)
    row: dict[str, Any] = {"protocol": PROTOCOL, "task": task, "algorithm": "planner", "seed": 0, "steps": 0}
    row |= {"config": digest(planner), "first_seed": HELD_OUT_SEED, "probe": probe(task), **made_with()}
    part = read_rows(path).get(identity(row), {})
    same = {name: part.get(name) for name in row} == row
    played = part["played"][:episodes] if same else []
    while len(played) < episodes:
        played = [*played, *play_episodes(task, planner, seeds[len(played) : len(played) + AT_ONCE])]
        add_row(path, {**row, "played": played})
    settings = {name: value for name, value in asdict(planner).items() if value is not None}
    return {**row, **summary(task, played), "planner": settings}


def make_rows(options: argparse.Namespace) -> int:
    """Make the rows that are not there, or are old."""
    for task in options.tasks:
        spec_of(task)
    for task in options.tasks:
        now: dict[str, Any] = {"protocol": PROTOCOL, "config": digest(planner_of(task))}
        now["episodes"] = options.episodes
        old = read_rows(options.rows).get(identity({"task": task, "algorithm": "planner", "seed": 0}), {})
        if {name: old.get(name) for name in now} == now and same_probe(old["probe"], task):
            continue
        try:
            row = make_row(task, options.episodes, options.rows.with_suffix(".parts.json"))
        except KeyboardInterrupt:
            print("\nstopped; the same command continues")
            return INTERRUPTED
        add_row(options.rows, row)
        print(line_of(row), flush=True)
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rows", type=Path, metavar="FILE", help="JSON file of rows, to be continued")
    parser.add_argument(
        "--tasks", nargs="+", default=CHEAPEST_FIRST, metavar="ID", help="environment ids (default: all)"
    )
    parser.add_argument("--episodes", type=whole(1, 10_000), default=AT_ONCE, help="of each task")
    options = parser.parse_args(arguments)
    return guarded("plan_rows.py", lambda: make_rows(options), MENDABLE)


if __name__ == "__main__":
    sys.exit(main())
