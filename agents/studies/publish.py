"""Add trained agents to the repository, with a card for each.

    python agents/studies/publish.py runs/benchmark/SpringTop-v0-ppo-*
    python agents/studies/publish.py --again agents/trained/SpringTop-v0    # evaluate a published agent anew

Of several runs of a task, the script takes the one with the highest return on episodes for the selection, and
reports it on others. It replaces a published agent only if the new one is better in the selection, and if
the audit (see audit.py) does not find that it exploits errors. It writes config.yaml, agent.npz (arrays of
numbers only) and card.json to agents/trained/ID. The card holds the training command, versions and commit,
checksums, the result with a 95 % interval of the mean, and the audit. The audit needs more episodes
(--audited) if the return is earned in few steps.
`springgym evaluate ID`, `springgym watch ID` and `springgym.load_agent` find the agents by the id of their
environment.
"""

from __future__ import annotations

import json
import shlex
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import _path  # noqa: F401  (first)
import numpy as np
from audit import audit
from config import MENDABLE, ConfigError, command_line, config_path, load_config, whole
from evaluate import evaluate, task_kwargs
from results import probe, same_probe
from runs import HELD_OUT_SEED, PUBLISHED_SEED, SELECTION_SEED, Run, open_run

from springgym.cli import guarded, write_text
from springgym.envs.trained import PUBLISHED, checksum

EPISODES = 100
SHARED = ("config.yaml", "agent.npz")


def reached(run: Run, episodes: int) -> dict[str, Any]:
    """Return what an agent reaches on episodes that had no part in choosing it."""
    found = evaluate(str(run.folder), run.env_id, task_kwargs(run.config), episodes, PUBLISHED_SEED)
    returns = np.array(found.returns_per_step)
    half = 1.96 * float(returns.std(ddof=1)) / np.sqrt(len(returns))
    return {
        "first_seed": found.first_seed,
        "episodes": episodes,
        "mean_return": found.return_per_step,
        "interval": [found.return_per_step - half, found.return_per_step + half],
        "success_rate": found.success_rate,
    }


def selected(run: Run, episodes: int) -> float:
    """Return by what agents are compared: the return per step on the episodes for the selection."""
    found = evaluate(str(run.folder), run.env_id, task_kwargs(run.config), episodes, SELECTION_SEED)
    return found.return_per_step


def card(run: Run, episodes: int, audited: int, made_with: dict[str, Any]) -> dict[str, Any]:
    """Return the card of an agent: how and with what it was trained, and what it reaches."""
    findings = audit(str(run.folder), run.env_id, task_kwargs(run.config), audited, HELD_OUT_SEED)
    return {
        "task": run.env_id,
        "algorithm": run.algo,
        "seed": run.seed,
        "command": command(run),
        "selection_return": selected(run, episodes),
        **reached(run, episodes),
        "audited": audited,
        "audit": [vars(finding) for finding in findings],
        "probe": probe(run.env_id),
        "versions": {key: made_with.get(key) for key in ("packages", "python", "git_revision")},
        "sha256": {name: checksum(run.folder / name) for name in SHARED},
    }


def command(run: Run) -> str:
    """Return the command line that trains it.

    Raises
    ------
    ConfigError
        If its configuration, but for its seconds, is not the one that ships: nobody could train it again.
    """
    seconds = f"seconds={run.config.seconds:g}"
    if run.config != load_config(run.algo, run.env_id, [seconds]):
        raise ConfigError(
            f"{run.folder} was trained with a configuration that differs from "
            f"configs/{config_path(run.algo).name}"
        )
    words = ["python", "agents/train.py", run.env_id, "--algo", run.algo, "--seed", str(run.seed)]
    return shlex.join([*words, *(["--set", seconds] if run.config.seconds else [])])


def publish(folders: Sequence[Path], episodes: int, audited: int, into: Path) -> int:
    """Take in the best run of every task."""
    best: dict[str, tuple[float, Path]] = {}
    for folder in folders:
        run = open_run(folder)
        if ":" in run.env_id:
            raise ConfigError(f"{folder}: {run.env_id} belongs to another package")
        command(run)  # which refuses what nobody could train again
        best[run.env_id] = max(best.get(run.env_id, (-np.inf, folder)), (selected(run, episodes), folder))
    for env_id, (earned, folder) in best.items():
        place = into / env_id
        if (place / "card.json").exists():
            there = json.loads((place / "card.json").read_text(encoding="utf-8"))
            if same_probe(there["probe"], env_id) and selected(open_run(place), episodes) >= earned:
                print(f"{env_id}: {there['algorithm']} {there['seed']} stays")
                continue
        made_with = json.loads((folder / "versions.json").read_text(encoding="utf-8"))
        found = card(open_run(folder), episodes, audited, made_with)
        if any(finding["verdict"] == "does not survive" for finding in found["audit"]):
            print(f"{env_id}: {folder} does not survive the audit")
            continue
        place.mkdir(parents=True, exist_ok=True)
        (place / "card.json").unlink(missing_ok=True)  # written last: without it there is no agent
        for name in SHARED:
            shutil.copyfile(folder / name, place / name)
        write_text(place / "card.json", json.dumps(found, indent=1) + "\n")
        print(f"{env_id}: {found['algorithm']} {found['seed']}, {found['mean_return']:.4f}")
    return 0


def again(folders: Sequence[Path], episodes: int, audited: int) -> int:
    """Write anew on cards what published agents reach, and their audits.

    If a task has changed since, the card keeps the probe of the task that its agent was trained for.
    """
    for folder in folders:
        run = open_run(folder)
        there = json.loads((folder / "card.json").read_text(encoding="utf-8"))
        found = card(run, episodes, audited, there["versions"])
        trained_for = there.get("trained_probe", there["probe"])
        if not same_probe(trained_for, run.env_id):
            found["trained_probe"] = trained_for
        write_text(folder / "card.json", json.dumps(found, indent=1) + "\n")
        print(f"{run.env_id}: {there['algorithm']} {there['seed']}, {found['mean_return']:.4f}")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = command_line(__doc__)
    parser.add_argument("runs", nargs="+", type=Path, help="run folders")
    parser.add_argument("--episodes", type=whole(2, 100_000), default=EPISODES)
    parser.add_argument("--audited", type=whole(2, 100_000), default=EPISODES, help="episodes of the audit")
    parser.add_argument("--into", type=Path, default=PUBLISHED, help="folder (default: agents/trained)")
    parser.add_argument("--again", action="store_true", help="evaluate and audit these published agents anew")
    options = parser.parse_args(arguments)

    def run() -> int:
        if options.again:
            return again(options.runs, options.episodes, options.audited)
        return publish(options.runs, options.episodes, options.audited, options.into)

    return guarded("publish.py", run, MENDABLE)


if __name__ == "__main__":
    sys.exit(main())
