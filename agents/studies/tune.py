"""Search hyperparameters with Optuna.

    python agents/studies/tune.py SpringGyroscope-v0 --trials 20 --seeds 2
    python agents/studies/tune.py SpringTop-v0 --algo sac --seconds 0 --set total_timesteps=50_000

The first trial is the configuration as it is, the second has wider networks and running normalisation, the
others are drawn. A trial trains agents as agents/train.py does, from several seeds one after another. It ends
early if it is worse than half of the earlier trials were at that point. The criterion is the return on
episodes that neither training nor evaluation uses. The study is stored in the folder of the runs. The same
command continues it, even after a kill, and adds trials until there are --trials. The file
configs/trials/ID-ALGORITHM.json (--out) holds the number of seeds, what --set and --seconds set, the search
space and all trials, and best.yaml in the study's folder the best hyperparameters, as an entry for configs/.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import _path  # noqa: F401  (first)
import numpy as np
import torch
import train
import yaml
from benchmark import Plan, add_hyperparameters, overrides_of, training
from config import (
    CONFIG_FOLDER,
    MENDABLE,
    ONLINE,
    ConfigError,
    check_result,
    command_line,
    config_path,
    load_config,
    whole,
)
from evaluate import evaluate, task_kwargs
from results import Cell
from runs import SELECTION_SEED, locked

from springgym.cli import INTERRUPTED, guarded, write_text

if TYPE_CHECKING:
    import optuna
    from config import Config

EPISODES = 64
WIDER = {"net_arch": "[128, 128]", "normalize": True}
"""Hyperparameters that the second trial changes."""

Space: TypeAlias = dict[str, tuple[float, float] | list[Any]]

#: By algorithm: what is searched, (low, high) on a logarithmic scale, or choices.
SPACES: dict[str, Space] = {
    "ppo": {
        "learning_rate": (1e-4, 3e-3),
        "n_steps": [32, 64, 128, 256],
        "batch_size": [256, 512, 1024, 2048],
        "n_epochs": [3, 5, 10, 20],
        "gamma": [0.97, 0.98, 0.99, 0.995],
        "gae_lambda": [0.9, 0.95, 0.98],
        "log_std_init": [-1.5, -1.0, -0.5, 0.0],
        "net_arch": ["[64, 64]", "[128, 128]"],
        "normalize": [False, True],
    },
    "sac": {
        "learning_rate": (1e-4, 3e-3),
        "batch_size": [128, 256, 512],
        "gamma": [0.95, 0.98, 0.99, 0.995],
        "tau": (3e-3, 5e-2),
        "gradient_steps": [8, 16, 32],
        "net_arch": ["[64, 64]", "[128, 128]"],
        "normalize": [False, True],
    },
    "linear": {
        "population": [16, 32, 64],
        "elites": [4, 6, 8],
        "episodes": [2, 4, 8],
        "spread": (0.1, 3.0),
        "extra_spread": (0.01, 0.5),
    },
}
SPACES["tqc"] = SPACES["sac"] | {"dropped_quantiles": [0, 2, 5]}
SPACES["her"] = SPACES["sac"] | {"relabelled": [1, 2, 4, 8]}


def shipped(config: Config, space: Space) -> dict[str, Any]:
    """Return the hyperparameters of a configuration, by name, whose values lie in the search space."""
    own = {name: getattr(config, name) for name in space}
    own = {name: str(value) if isinstance(value, list) else value for name, value in own.items()}
    return {name: own[name] for name in space if isinstance(space[name], tuple) or own[name] in space[name]}


def suggested(trial: optuna.trial.BaseTrial, algo: str) -> list[str]:
    """Return the settings of a trial, in the form that ``--set`` takes."""
    chosen = []
    for name, space in SPACES[algo].items():
        if isinstance(space, tuple):
            value = f"{trial.suggest_float(name, *space, log=True):.3g}"
        else:
            value = str(trial.suggest_categorical(name, space))
        chosen.append(f"{name}={value}")
    return chosen


def objective(trial: optuna.Trial, options: argparse.Namespace, folder: Path) -> float:
    """Return the mean return per step of the agents of a trial.

    Raises
    ------
    optuna.TrialPruned
        If it is given up, or cannot learn.
    """
    import optuna

    chosen = suggested(trial, options.algo)
    name = sha256(" ".join(chosen).encode()).hexdigest()[:10]
    plan = Plan(folder / name, EPISODES, (*overrides_of(options), *chosen), options.configs)
    returns = []
    for seed in range(options.seeds):
        cell = Cell(options.task, options.algo, seed)
        run = plan.folder(cell)
        run.mkdir(parents=True, exist_ok=True)
        log_file = run / "log.txt"
        try:
            arguments = training(cell, plan)
            with open(log_file, "a", encoding="utf-8") as log, redirect_stdout(log), redirect_stderr(log):
                status = train.main(arguments)
        except ConfigError as error:  # such as a batch that does not divide a rollout
            raise optuna.TrialPruned(str(error)) from error
        if status == INTERRUPTED:
            raise KeyboardInterrupt
        if status:
            raise optuna.TrialPruned(log_file.read_text(encoding="utf-8").splitlines()[-1])
        config = load_config(options.algo, options.task, plan.overrides, plan.config(options.algo))
        played = evaluate(str(run), options.task, task_kwargs(config), EPISODES, SELECTION_SEED)
        returns.append(played.return_per_step)
        trial.set_user_attr(f"success_{seed}", played.success_rate)
        trial.report(float(np.mean(returns)), seed)
        if trial.should_prune():
            raise optuna.TrialPruned(f"behind after seed {seed}")
    return float(np.mean(returns))


def tune(options: argparse.Namespace) -> int:
    """Add trials to a study until it has as many as asked for."""
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.trial import TrialState

    path = config_path(options.algo, options.configs)
    config = load_config(options.algo, options.task, options.overrides, path)  # which refuses wrong ones
    folder = options.runs.absolute() / f"{options.task.rpartition(':')[2]}-{options.algo}"
    folder.mkdir(parents=True, exist_ok=True)
    options.out.mkdir(parents=True, exist_ok=True)
    check_result(trials_file(options.out, folder))  # before hours of learning
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    torch.set_num_threads(1)
    with locked(folder):
        study = optuna.create_study(
            study_name=options.task,
            storage=JournalStorage(JournalFileBackend(str(folder / "study.journal"))),
            sampler=optuna.samplers.TPESampler(seed=options.seed),
            pruner=optuna.pruners.MedianPruner(n_startup_trials=5),
            direction="maximize",
            load_if_exists=True,
        )
        made = {"task": options.task, "algo": options.algo, "seeds": options.seeds}
        made["set"] = list(overrides_of(options))
        if study.user_attrs.get("made", made) != made:
            raise ConfigError(f"{folder} has trials of {study.user_attrs['made']}; name other --runs")
        study.set_user_attr("made", made)
        tried = [trial.system_attrs.get("fixed_params", trial.params) for trial in study.get_trials()]
        for trial in study.get_trials():
            if trial.state == TrialState.RUNNING:  # a kill left it
                study.tell(trial.number, state=TrialState.FAIL)
            if trial.state in (TrialState.RUNNING, TrialState.FAIL) and tried.count(trial.params) == 1:
                study.enqueue_trial(trial.params)  # its run goes on
        space = SPACES[options.algo]
        for change in ({}, {name: value for name, value in WIDER.items() if name in space}):
            study.enqueue_trial(shipped(config, space) | change, skip_if_exists=True)
        try:
            while len(study.get_trials(False, (TrialState.COMPLETE, TrialState.PRUNED))) < options.trials:
                study.optimize(lambda trial: objective(trial, options, folder), n_trials=1)
                tell(study, options, folder, path)
        except KeyboardInterrupt:
            print("\nstopped; the same command continues")
            return INTERRUPTED
    return 0


def trials_file(out: Path, folder: Path) -> Path:
    """Return the file of the trials of a study, whose runs are in ``folder``."""
    return out / f"{folder.name}.json"


def tell(study: optuna.Study, options: argparse.Namespace, folder: Path, path: Path | None) -> None:
    """Write down what was tried, and the best of it as a configuration."""
    trials = [
        {"number": t.number, "state": t.state.name, "value": t.value, **t.params, **t.user_attrs}
        for t in study.get_trials(deepcopy=False)
    ]
    content = {**study.user_attrs["made"], "searched": SPACES[options.algo], "trials": trials}
    write_text(trials_file(options.out, folder), json.dumps(content, indent=1) + "\n")
    print(f"trial {trials[-1]['number']}: {trials[-1]['state'].lower()}, {trials[-1]['value']}")
    if any(trial["state"] == "COMPLETE" for trial in trials):
        overrides = [*options.overrides, *suggested(study.best_trial, options.algo)]
        best = asdict(load_config(options.algo, options.task, overrides, path))
        text = f"# return per step {study.best_value:.4f} on {EPISODES} episodes of {options.seeds} agents\n"
        text += yaml.safe_dump({options.task: best}, sort_keys=False, default_flow_style=None)
        write_text(folder / "best.yaml", text)
        print(f"best: trial {study.best_trial.number}, {study.best_value:.4f}; see {folder / 'best.yaml'}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = command_line(__doc__)
    parser.add_argument("task", metavar="ID", help="environment id")
    parser.add_argument("--algo", choices=sorted(ONLINE), default="ppo", help="algorithm (default: ppo)")
    parser.add_argument("--trials", type=whole(1, 100_000), default=20, help="trials in all (default: 20)")
    parser.add_argument("--seeds", type=whole(1, 1000), default=2, help="agents of each trial (default: 2)")
    parser.add_argument("--seed", type=whole(0, 2**31 - 1), default=0, help="seed of the search")
    parser.add_argument("--runs", type=Path, default=Path("runs/tune"), help="folder for the studies")
    trials = CONFIG_FOLDER / "trials"
    parser.add_argument("--out", type=Path, default=trials, help="for trials (default: configs/trials)")
    add_hyperparameters(parser)
    options = parser.parse_args(arguments)
    return guarded("tune.py", lambda: tune(options), (*MENDABLE, ModuleNotFoundError))


if __name__ == "__main__":
    sys.exit(main())
