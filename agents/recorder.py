"""The files and messages of a run: metrics.csv, progress.csv, checkpoints, and a bar on the terminal."""

from __future__ import annotations

import csv
import math
import time
from typing import Any

from agent import save_agent
from checkpoint import save_checkpoint
from config import ConfigError
from evaluate import evaluate, task_kwargs
from learner import native_env, network_config
from runs import PROGRESS_SEED, Run, time_limit, write_atomically
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import safe_mean
from tqdm import tqdm

from springgym.envs.sb3 import StaggeredMonitor

COLUMNS = (
    "timesteps",  # environment steps of all copies together
    "seconds",  # spent training
    "reward_per_step",  # mean over the steps since the row before
    "episodes",  # that ended since the row before
    "return_per_step",  # return over time limit, mean over the last 100 episodes
    "episode_length",
    "success_rate",
)

PROGRESS = ("timesteps", "seconds", "return_per_step", "success_rate")
"""The columns of progress.csv: the results of the agent without noise."""
PLAYED = 20
"""Number of episodes that the agent plays at each checkpoint."""


class Recorder(BaseCallback):
    """Writes rows and checkpoints between iterations, and moves the progress bar."""

    bar: tqdm
    clock = staticmethod(time.perf_counter)
    """what the column "seconds" counts"""

    def __init__(self, run: Run, env: StaggeredMonitor) -> None:
        super().__init__()
        self.run, self.env, self.config = run, env, network_config(run)
        self.limit = time_limit(native_env(env).spec)
        self.path = run.folder / "metrics.csv"
        self.seconds = 0.0
        self.row_at = self.checkpoint_at = self.steps = self.episodes = 0
        self.reward = 0.0
        self.progress: list[tuple[int, float, float, float | None]] = []

    def state(self) -> dict[str, Any]:
        """Return the state on which the following rows depend."""
        names = ("seconds", "row_at", "steps", "episodes", "reward", "progress")
        return {name: getattr(self, name) for name in names}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a checkpoint's state."""
        self.__dict__.update(state)

    def drop_rows_after(self, timesteps: int) -> None:
        """Keep the rows a checkpoint knows of; a kill may have left later ones, or half a row.

        Raises
        ------
        ConfigError
            If a row cannot be one of this run.
        """
        kept = [",".join(COLUMNS)]
        reached = 0
        for number, line in enumerate(self._lines(), start=2):
            if not line.endswith("\n"):
                break  # cut short
            try:
                cells = [float(cell) if cell else 0.0 for cell in line.rstrip("\n").split(",")]
                steps = int(cells[0]) if len(cells) == len(COLUMNS) and all(map(math.isfinite, cells)) else 0
            except ValueError:
                steps = 0
            if steps <= reached:
                raise ConfigError(
                    f"{self.path}:{number}: this is not a row of this run: "
                    f"{line[:80]!r}; correct or delete it"
                )
            reached = steps
            if steps <= timesteps:
                kept.append(line.rstrip("\n"))
        write_atomically(self.path, "\n".join(kept) + "\n")

    def _lines(self) -> list[str]:
        """Return the lines of metrics.csv below its head, with their ends."""
        if not self.path.exists():
            return []
        try:
            head, *lines = self.path.read_text(encoding="utf-8").splitlines(keepends=True) or [""]
        except UnicodeDecodeError as error:
            raise ConfigError(f"{self.path}: the file is not text: {error}") from error
        if head.rstrip("\n") != ",".join(COLUMNS):
            raise ConfigError(f"{self.path}:1: these are not the columns of this version: {head[:80]!r}")
        return lines

    def _on_training_start(self) -> None:
        self.checkpoint_at = self.num_timesteps
        self.started = self.clock() - self.seconds

    def _on_step(self) -> bool:
        normalize = self.model.get_vec_normalize_env()
        rewards = normalize.get_original_reward() if normalize else self.locals["rewards"]
        self.reward += float(rewards.sum())
        self.steps += len(rewards)
        self.episodes += int(self.locals["dones"].sum())
        self.bar.update(len(rewards))
        return True

    def _on_rollout_start(self) -> None:
        """Note that the agent is up to date and no step is under way, between two iterations."""
        self.seconds = self.clock() - self.started
        if self.num_timesteps - self.row_at >= self.config.log_every:
            self.write_row()
        if self.num_timesteps - self.checkpoint_at >= self.config.checkpoint_every:
            self.play()
            save_checkpoint(self.run, self.env, self.model, self)
            self.checkpoint_at = self.num_timesteps

    def _on_training_end(self) -> None:
        self.seconds = self.clock() - self.started
        if self.steps:
            self.write_row()
        self.play()
        save_checkpoint(self.run, self.env, self.model, self)

    def play(self) -> None:
        """See what the agent reaches without noise; that is no part of the training's seconds."""
        began = self.clock()
        save_agent(self.run.agent, self.model)
        task = task_kwargs(self.config)
        played = evaluate(str(self.run.folder), self.run.env_id, task, PLAYED, PROGRESS_SEED)
        reached = played.return_per_step, played.success_rate
        self.progress.append((self.num_timesteps, round(self.seconds, 2), *reached))
        self.write_progress()
        self.started += self.clock() - began

    def write_progress(self) -> None:
        """Write progress.csv."""
        lines = [",".join("" if cell is None else str(cell) for cell in row) for row in self.progress]
        write_atomically(self.run.folder / "progress.csv", "\n".join([",".join(PROGRESS), *lines]) + "\n")

    def write_row(self) -> None:
        """Append a row and start the next one."""
        reward_per_step = self.reward / self.steps
        episodes, successes = self.model.ep_info_buffer, self.model.ep_success_buffer
        success_rate = safe_mean(successes) if successes else ""
        row = (
            self.num_timesteps,
            round(self.seconds, 2),
            reward_per_step,
            self.episodes,
            safe_mean([episode["r"] for episode in episodes]) / self.limit if episodes else "",
            safe_mean([episode["l"] for episode in episodes]) if episodes else "",
            success_rate,
        )
        with open(self.path, "a", newline="") as file:
            csv.writer(file, lineterminator="\n").writerow(row)
        self.logger.record("rollout/reward_per_step", reward_per_step)
        self.model.dump_logs()
        shown = {"reward/step": f"{reward_per_step:.3f}"}
        reached = self.progress[-1][-1] if self.progress else None
        if reached is not None:
            shown["success"] = f"{100 * reached:.0f} %"
        self.bar.set_postfix(shown, refresh=False)
        self.row_at, self.steps, self.episodes, self.reward = self.num_timesteps, 0, 0, 0.0
