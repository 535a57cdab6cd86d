"""The files and messages of a run: metrics.csv, progress.csv, checkpoints, logs, a figure, a progress bar.

A checkpoint is the whole state of a training in one file, so that a run can continue as if it had not
stopped. Stable-Baselines3's CheckpointCallback and EvalCallback do not do this: what they save leaves out
environments, random numbers and logs, and they write several files one after another.
"""

from __future__ import annotations

import csv
import json
import os
import pickle
import platform
import random
import time
import zipfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import torch
from agent import ALGORITHMS, save_agent
from config import ConfigError
from evaluate import Evaluation, evaluate, task_kwargs
from learner import Falling, native_env, network_config
from results import COLORS, LINES
from runs import PROGRESS_SEED, Run, time_limit
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter, Logger, filter_excluded_keys
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import safe_mean
from stable_baselines3.common.vec_env import VecNormalize
from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter
from tqdm import tqdm

from springgym.cli import whole_file, write_text
from springgym.envs.sb3 import StaggeredMonitor

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import EngFormatter

COLUMNS = (
    "timesteps",  # environment steps of all copies together
    "seconds",  # of processor time, spent training
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
STATE = ("seconds", "row_at", "steps", "episodes", "reward", "rows", "progress")
"""The attributes of a recorder that a checkpoint holds."""
SHORTEST = 1.0
"""Least time of learning between two checkpoints of a run that is measured in seconds [s]; it is a tenth of
the time so far."""
LONGEST = 30.0
"""Largest time of learning between two such checkpoints [s]."""


def line_of(row: Sequence[object]) -> str:
    """Return a line of a table: its cells between commas, and nothing for None."""
    return ",".join("" if cell is None else str(cell) for cell in row) + "\n"


class Recorder(BaseCallback):
    """Writes rows and checkpoints between iterations, and moves the progress bar."""

    bar: tqdm
    clock = staticmethod(time.process_time)
    """processor time [s], which other programs do not lengthen; the column "seconds" holds it"""

    def __init__(self, run: Run, env: StaggeredMonitor) -> None:
        super().__init__()
        self.run, self.env, self.config = run, env, network_config(run)
        self.limit = time_limit(native_env(env).spec)
        self.seconds = self.seconds_at = 0.0
        self.is_over = False
        self.row_at = self.checkpoint_at = self.steps = self.episodes = 0
        self.reward = 0.0
        self.rows: list[tuple[float | None, ...]] = []
        self.progress: list[tuple[int, float, float, float | None]] = []

    def state(self) -> dict[str, Any]:
        """Return the attributes of `STATE` by name, for a checkpoint."""
        return {name: getattr(self, name) for name in STATE}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a checkpoint's state."""
        for name in STATE:
            setattr(self, name, state[name])

    def write_tables(self) -> None:
        """Write metrics.csv and progress.csv, without what a stopped run wrote after its checkpoint."""
        tables = (("metrics.csv", COLUMNS, self.rows), ("progress.csv", PROGRESS, self.progress))
        for name, columns, rows in tables:
            write_text(self.run.folder / name, "".join(map(line_of, [columns, *rows])))

    def add(self, row: tuple[float | None, ...], rows: list[Any], name: str) -> None:
        """Add a row to those of a table, and to its file."""
        rows.append(row)
        with open(self.run.folder / name, "a", encoding="utf-8") as file:
            file.write(line_of(row))

    def _on_training_start(self) -> None:
        self.checkpoint_at, self.seconds_at = self.num_timesteps, self.seconds
        self.started = self.clock() - self.seconds

    def _on_step(self) -> bool:
        normalize = self.model.get_vec_normalize_env()
        rewards = normalize.get_original_reward() if normalize else self.locals["rewards"]
        self.reward += float(rewards.sum())
        self.steps += len(rewards)
        self.episodes += int(self.locals["dones"].sum())
        self.bar.update(len(rewards))
        return not self.is_over

    def _on_rollout_start(self) -> None:
        """Note that the agent is up to date and no step is under way, between two iterations."""
        self.seconds = self.clock() - self.started
        if self.num_timesteps - self.row_at >= self.config.log_every:
            self.write_row()
        done = self.config.share_done(self.num_timesteps, self.seconds)
        if isinstance(rate := self.model.learning_rate, Falling):
            rate.left = 1.0 - done
        self.is_over = done == 1.0
        if self.is_due() and not self.is_over:
            self.write_checkpoint()

    def is_due(self) -> bool:
        """Return whether to write a checkpoint."""
        if self.config.seconds:
            between = min(max(self.seconds_at / 10, SHORTEST), LONGEST)
            return self.seconds - self.seconds_at >= between
        return self.num_timesteps - self.checkpoint_at >= self.config.checkpoint_every

    def _on_training_end(self) -> None:
        self.seconds = self.clock() - self.started
        if self.steps:
            self.write_row()
        self.write_checkpoint()

    def write_checkpoint(self) -> None:
        """Evaluate the agent and write a checkpoint, which is no part of the training's seconds."""
        began = self.clock()
        self.play()
        save_checkpoint(self.run, self.env, self.model, self)
        self.checkpoint_at, self.seconds_at = self.num_timesteps, self.seconds
        self.started += self.clock() - began

    def play(self) -> None:
        """See what the agent reaches without noise."""
        save_agent(self.run.agent, self.model)
        task = task_kwargs(self.config)
        played = evaluate(str(self.run.folder), self.run.env_id, task, PLAYED, PROGRESS_SEED)
        reached = played.return_per_step, played.success_rate
        self.add((self.num_timesteps, round(self.seconds, 2), *reached), self.progress, "progress.csv")

    def write_row(self) -> None:
        """Append a row and start the next one."""
        reward_per_step = self.reward / self.steps
        episodes = self.model.ep_info_buffer
        successes = self.model.ep_success_buffer
        row = (
            self.num_timesteps,
            round(self.seconds, 2),
            reward_per_step,
            self.episodes,
            safe_mean([episode["r"] for episode in episodes]) / self.limit if episodes else None,
            safe_mean([episode["l"] for episode in episodes]) if episodes else None,
            safe_mean(successes) if successes else None,
        )
        self.add(row, self.rows, "metrics.csv")
        self.logger.record("rollout/reward_per_step", reward_per_step)
        self.model.dump_logs()
        shown = {"reward/step": f"{reward_per_step:.3f}"}
        reached = self.progress[-1][-1] if self.progress else None
        if reached is not None:
            shown["success"] = f"{100 * reached:.0f} %"
        self.bar.set_postfix(shown, refresh=False)
        self.row_at = self.num_timesteps
        self.steps = 0
        self.episodes = 0
        self.reward = 0.0


# --- Checkpoints ---------------------------------------------------------------------------------------

MAY_CHANGE = ("total_timesteps", "seconds", "log_every", "checkpoint_every", "eval_env_kwargs")
"""Settings that may change when a run is resumed."""


def save_checkpoint(run: Run, env: StaggeredMonitor, model: BaseAlgorithm, recorder: Recorder) -> None:
    """Write the model and all that training depends on into one file, swapped in whole.

    To be called between iterations: after an update and before the next step is taken.
    """
    native = native_env(env)
    normalize = model.get_vec_normalize_env()
    logger = model.logger
    state = {
        "env": native.get_state() if hasattr(native, "get_state") else None,
        "monitor": (env.episode_returns, env.episode_lengths, env.episode_count, env.shortened),
        "discounted_returns": normalize.returns if normalize else None,
        "replay_buffer": model.replay_buffer if isinstance(model, OffPolicyAlgorithm) else None,
        "recorder": recorder.state(),
        "logger": (dict(logger.name_to_value), dict(logger.name_to_count), logger.name_to_excluded),
        "random": (random.getstate(), np.random.get_state(), torch.get_rng_state()),  # noqa: NPY002
    }
    with whole_file(run.model) as temporary:
        model.save(temporary)
        with zipfile.ZipFile(temporary, "a") as archive:
            archive.writestr("run.json", json.dumps(asked_for(run)))
            archive.writestr("training_state.pkl", pickle.dumps(state))
            if normalize:
                archive.writestr("vecnormalize.pkl", pickle.dumps(normalize))


def load_checkpoint(run: Run, env: StaggeredMonitor, recorder: Recorder) -> BaseAlgorithm:
    """Restore an agent and everything around it as :func:`save_checkpoint` found it.

    Raises
    ------
    ConfigError
        If the checkpoint is damaged, or of another run.
    """
    try:
        with zipfile.ZipFile(run.model) as archive:
            if damaged := archive.testzip():
                raise ConfigError(f"{run.model}: its entry {damaged} is damaged")
            check_same(run, json.loads(archive.read("run.json")))
            state = pickle.loads(archive.read("training_state.pkl"))
            normalize = (
                pickle.loads(archive.read("vecnormalize.pkl")) if network_config(run).normalize else None
            )
        return _restore(run, env, recorder, state, normalize)
    except (ConfigError, MemoryError):
        raise
    except Exception as error:  # it may be any file, and be wrong in any way
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ConfigError(
            f"{run.model}: this is not a checkpoint of this run: {reason}. "
            "Restore it from a copy, or start a new run"
        ) from error


def _restore(
    run: Run, env: StaggeredMonitor, recorder: Recorder, state: dict[str, Any], normalize: VecNormalize | None
) -> BaseAlgorithm:
    """Put what `load_checkpoint` read into the algorithm."""
    if normalize:
        normalize.set_venv(env)
    exact = state["env"] is not None
    if not exact:
        print(f"{run.env_id} cannot save its state: the episodes under way start anew")
    else:
        native_env(env).set_state(state["env"])
        env.episode_returns, env.episode_lengths, env.episode_count, env.shortened = state["monitor"]
        if normalize:
            normalize.returns = state["discounted_returns"]
    model = ALGORITHMS[run.algo].load(run.model, env=normalize or env, device="cpu", force_reset=not exact)
    if isinstance(model, OffPolicyAlgorithm):
        model.replay_buffer = state["replay_buffer"]
        if isinstance(model.replay_buffer, HerReplayBuffer):
            model.replay_buffer.set_env(normalize or env)
    logger = make_logger(run, model.num_timesteps)
    values, counts, excluded = state["logger"]
    logger.name_to_value.update(values)
    logger.name_to_count.update(counts)
    logger.name_to_excluded.update(excluded)
    model.set_logger(logger)
    recorder.restore(state["recorder"])
    python_state, numpy_state, torch_state = state["random"]
    random.setstate(python_state)
    np.random.set_state(numpy_state)  # noqa: NPY002
    torch.set_rng_state(torch_state)
    return model


def asked_for(run: Run) -> dict[str, Any]:
    """Return the settings of a run, in the form that JSON has."""
    asked = {"algo": run.algo, "env_id": run.env_id, "seed": run.seed, **asdict(run.config)}
    return dict(json.loads(json.dumps(asked, default=str)))


def check_same(run: Run, whose: dict[str, Any]) -> None:
    """Refuse a ``config.yaml`` that says something else than when the checkpoint was made.

    Raises
    ------
    ConfigError
        Naming what differs.
    """
    for key, value in asked_for(run).items():
        if key not in MAY_CHANGE and whose.get(key) != value:
            raise ConfigError(
                f"{run.folder / 'config.yaml'}: {key} is {value!r}, but the checkpoint was made with "
                f"{whose.get(key)!r}. A run cannot change this: restore the value, or start a new run"
            )


# --- TensorBoard ---------------------------------------------------------------------------------------


class TensorBoard(KVWriter):
    """TensorBoard scalars, hiding what a stopped run wrote beyond ``timesteps``.

    They are written at once; PyTorch's writer does that in a thread, where nobody hears of a full disk.
    """

    def __init__(self, folder: Path, timesteps: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / f"events.out.tfevents.{time.time_ns()}.{platform.node()}.{os.getpid()}"
        start = SessionLog(status=SessionLog.START)
        self._append(Event(file_version="brain.Event:2"), Event(step=timesteps + 1, session_log=start))

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        """Write what is a number and not excluded."""
        shown = filter_excluded_keys(key_values, key_excluded, "tensorboard")
        scalars = [
            Summary.Value(tag=key, simple_value=float(value))
            for key, value in shown.items()
            if isinstance(value, (int, float, np.number))
        ]
        self._append(Event(step=step, summary=Summary(value=scalars)))

    def _append(self, *events: Event) -> None:
        with open(self.path, "ab") as file:
            for event in events:
                event.wall_time = time.time()
                RecordWriter(file).write(event.SerializeToString())

    def close(self) -> None:
        """Leave nothing open."""


def make_logger(run: Run, timesteps: int) -> Logger:
    """Make the log of a run that has come to ``timesteps``."""
    folder = run.folder / "tensorboard"
    return Logger(str(folder), [TensorBoard(folder, timesteps)])


# --- Figure --------------------------------------------------------------------------------------------


def plot_learning_curve(run: Run, end: int, evaluations: Sequence[Evaluation]) -> None:
    """Draw metrics.csv, and what the agent after ``end`` steps and the baselines reach, as a PNG."""
    with open(run.folder / "metrics.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    progress: list[dict[str, str]] = []
    if (run.folder / "progress.csv").exists():
        with open(run.folder / "progress.csv", newline="") as file:
            progress = list(csv.DictReader(file))

    def curve(column: str, scale: float = 1.0) -> tuple[list[int], list[float]]:
        given = [row for row in rows if row[column]]
        return ([int(row["timesteps"]) for row in given], [scale * float(row[column]) for row in given])

    trained, *baselines = evaluations
    figure, (top, bottom) = plt.subplots(
        2, 1, figsize=(7, 6.6), sharex=True, layout="constrained", height_ratios=(3, 2)
    )
    color = COLORS[run.algo]
    top.plot(*curve("reward_per_step"), color="0.8", lw=1, label="while training, each step")
    for axes, column, scale in ((top, "return_per_step", 1.0), (bottom, "success_rate", 100.0)):
        told = "while training, last 100 episodes"
        axes.plot(*curve(column, scale), color=color, lw=1, alpha=0.6, label=told)
        if any(row[column] for row in progress):
            steps = [int(row["timesteps"]) for row in progress]
            reached = [scale * float(row[column]) for row in progress]
            axes.plot(steps, reached, ".-", color=color, lw=2.5, label="evaluation, without exploration")
        level = getattr(trained, column)
        if level is not None:
            dot = {"color": color, "markeredgecolor": "k", "clip_on": False, "zorder": 3}
            axes.plot(end, scale * level, "o", **dot, label="trained agent, held-out episodes")
    for baseline in baselines:
        style = LINES[baseline.agent]
        top.axhline(baseline.return_per_step, color="0.25", ls=style, lw=1.5, label=baseline.agent)
    top.set(ylabel="return per step", title=f"{run.env_id}, {run.algo.upper()}, seed {run.seed}")
    figure.legend(*top.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    bottom.set(xlabel="environment steps", ylabel="success, %", xlim=(0, None), ylim=(-5, 105))
    bottom.xaxis.set_major_formatter(EngFormatter())
    for axes in (top, bottom):
        axes.grid(alpha=0.3)
    with whole_file(run.folder / "learning_curve.png") as path:
        figure.savefig(path, dpi=120)
    plt.close(figure)
