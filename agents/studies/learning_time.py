"""Measure how long PPO takes to learn each task, and the shares of physics, policy and learning.

    python agents/studies/learning_time.py                  # every task of configs/ppo.yaml
    python agents/studies/learning_time.py SpringTop-v0 --seed 1 --json docs/learning_time.json

The script trains as train.py does. It stops when the agent succeeds in 90 % of 20 held-out episodes without
noise, which it checks at every checkpoint, or when all steps of the configuration are taken. Seconds are
those of one processor core, so they do not depend on other programs. Evaluation and compilation do not count.
Physics is the native step of the batch. The rest of a rollout is the policy and Stable-Baselines3. Imitation
counts as learning.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import _path  # noqa: F401  (first)
import numpy as np
import torch
from config import CONFIG_FOLDER, DEFAULT, MENDABLE, Config, command_line, load_config, new_file, whole
from learner import make_training_env, native_env, new_model
from recorder import Recorder, make_logger
from results import change_rows, read_rows
from runs import HELD_OUT_SEED, Run, create_run
from tqdm import tqdm
from train import begin_with_imitation

from benchmarks.conditions import conditions
from springgym.cli import guarded
from springgym.envs.sb3 import StaggeredMonitor
from springgym.scenes.strict_yaml import read_yaml

ENOUGH = 0.9
"""Share of the episodes that must succeed."""


class Stopwatch(Recorder):
    """Takes the time of rollouts and of the native steps in them, and ends the training."""

    def __init__(self, run: Run, env: StaggeredMonitor) -> None:
        super().__init__(run, env)
        self.rollouts = self.physics = 0.0
        native = native_env(env)
        step = native.step

        def timed(actions: np.ndarray) -> object:
            began = self.clock()
            result = step(actions)
            self.physics += self.clock() - began
            return result

        native.step = timed

    @property
    def learned(self) -> bool:
        """Return whether the agent succeeds often enough to have learned the task."""
        return bool(self.progress) and (self.progress[-1][-1] or 0.0) >= ENOUGH

    def _on_rollout_start(self) -> None:
        super()._on_rollout_start()
        self.rollout_at = self.clock()

    def _on_rollout_end(self) -> None:
        self.rollouts += self.clock() - self.rollout_at

    def _on_step(self) -> bool:
        return super()._on_step() and not self.learned


def measure(env_id: str, seed: int, config: Config) -> dict[str, Any]:
    """Train on one task until it is learned."""
    with tempfile.TemporaryDirectory() as folder:
        run = create_run(Run(Path(folder), "ppo", env_id, seed, config))
        env = make_training_env(run)
        env.reset()
        env.step_async(np.stack([env.action_space.sample()] * env.num_envs))  # compiles
        env.step_wait()
        model = new_model(run, env)
        model.set_logger(make_logger(run, 0))
        watch = Stopwatch(run, env)
        watch.write_tables()
        begin_with_imitation(run, model, watch)
        watch.physics = 0.0
        total = run.config.total_timesteps
        with tqdm(desc=env_id, total=total, unit="step", unit_scale=True, mininterval=0.5) as watch.bar:
            left = total - model.num_timesteps
            model.learn(left, watch, log_interval=None, reset_num_timesteps=False)  # type: ignore[arg-type]
        env.close()
    steps, seconds, _, success = next(
        (row for row in watch.progress if (row[-1] or 0.0) >= ENOUGH), watch.progress[-1]
    )
    return {
        "task": env_id,
        "seed": seed,
        "learned": (success or 0.0) >= ENOUGH,
        "steps": steps,
        "seconds": seconds,
        "physics": round(watch.physics, 2),
        "policy": round(watch.rollouts - watch.physics, 2),
        "learning": round(seconds - watch.rollouts, 2),
        "measured": conditions(),
    }


def shown(rows: Sequence[dict[str, Any]]) -> str:
    """Write the rows as a table in Markdown."""
    lines = ["| task | steps to 90 % | seconds | physics | policy | learning |", "|---|---|---|---|---|---|"]
    for row in rows:
        more = "" if row["learned"] else "more than "
        lines.append(
            f"| `{row['task']}` | {more}{row['steps']:,} | {more}{row['seconds']:.0f} | "
            f"{row['physics']:.0f} | {row['policy']:.0f} | {row['learning']:.0f} |"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = command_line(__doc__)
    parser.add_argument("tasks", nargs="*", help="environment ids (default: those in configs/ppo.yaml)")
    parser.add_argument("--config", type=Path, default=CONFIG_FOLDER / "ppo.yaml", help="hyperparameters")
    parser.add_argument("--seed", type=whole(0, HELD_OUT_SEED - 1), default=0)
    parser.add_argument(
        "--json",
        type=new_file(),
        metavar="FILE",
        help="write the rows to this file, replacing those of the same runs",
    )
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    return guarded("learning_time.py", lambda: _measure_all(options), MENDABLE)


def _measure_all(options: argparse.Namespace) -> int:
    tasks = options.tasks or [key for key in read_yaml(options.config).value if key != DEFAULT]
    configs = {task: load_config("ppo", task, (), options.config) for task in tasks}
    key = itemgetter("task", "seed")
    known = read_rows(options.json, key) if options.json else {}
    for task, config in configs.items():
        new = {(task, options.seed): measure(task, options.seed, config)}
        known |= new
        if options.json:
            change_rows(options.json, partial(lambda rows, new: rows | new, new=new), key)
    print(shown([known[task, options.seed] for task in tasks]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
