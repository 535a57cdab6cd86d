"""Train an agent, compare it with the baselines and film it.

    springgym train SpringTop-v0
    springgym train SpringTop-v0 --algo sac --seed 1 --run runs/sac-frame \\
        --set env_kwargs.observation=frame learning_rate=3e-4
    springgym train --resume runs/SpringTop-v0-ppo-0

Hyperparameters come from configs/<algo>.yaml. The run folder (see runs.py) holds all that comes
out. A run that was stopped in whatever way goes on from its newest checkpoint with --resume; if
the environment can save its state, exactly as if it had never stopped. It keeps the configuration
that it was started with. --resume unpickles the checkpoint: do that with runs of your own only.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import pickle
import platform
import random
import sys
import time
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import torch
from agent import ALGORITHMS, policy_kwargs, save_agent
from config import (
    CONFIG_OF,
    MENDABLE,
    ConfigError,
    CrossQConfig,
    LinearConfig,
    NetworkConfig,
    OffPolicyConfig,
    PPOConfig,
    SACConfig,
    TQCConfig,
    load_config,
    making,
    whole,
)
from controllers import controllers_of
from evaluate import MOST_EPISODES, Evaluation, evaluate, table, task_kwargs, write_json
from imitation import imitate, teacher
from linear import Search
from runs import (
    HELD_OUT_SEED,
    Run,
    create_run,
    locked,
    open_run,
    time_limit,
    write_atomically,
    write_config,
)
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter, Logger, filter_excluded_keys
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import LinearSchedule, safe_mean
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter
from tqdm import tqdm
from watch import record

import springgym  # noqa: F401  (registers the environments)
from springgym.cli import INTERRUPTED, guarded, whole_file
from springgym.envs.agent import Algorithm
from springgym.envs.sb3 import SB3VecEnv, StaggeredMonitor, make_sb3
from springgym.registration import find

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.ticker import EngFormatter

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
"""The columns of progress.csv: what the agent reaches that acts without noise."""
PLAYED = 20
"""Episodes that it plays at each checkpoint,"""
PROGRESS_SEED = 2 * HELD_OUT_SEED
"""from this seed upwards: neither those of training nor those of the evaluation."""


# ---------------------------------------------------------------- environment and algorithm


def make_training_env(run: Run) -> StaggeredMonitor:
    """The copies the agent learns in. They do not all end together, which would show as saw teeth."""
    with making(run.env_id):
        copies, kwargs = network_config(run).n_envs, run.config.env_kwargs
        env = make_sb3(run.env_id, copies, run.seed, stagger=True, env_kwargs=kwargs)
    assert isinstance(env, StaggeredMonitor)
    time_limit(native_env(env).spec)  # there is one
    return env


def network_config(run: Run) -> NetworkConfig:
    """The configuration of a run that Stable-Baselines3 trains.

    Raises
    ------
    ConfigError
        If it does not.
    """
    if not isinstance(run.config, NetworkConfig):
        raise ConfigError(f"{run.folder} is a run of {run.algo}: Stable-Baselines3 does not train it")
    return run.config


def new_model(run: Run, env: VecEnv) -> BaseAlgorithm:
    """An untrained agent.

    Raises
    ------
    ConfigError
        If it is to imitate what there is not.
    MemoryError
        If it does not fit into memory.
    """
    if isinstance(run.config, PPOConfig) and run.config.imitate:
        teacher(run, env.action_space)
    try:
        return _new_model(run, env)
    except RuntimeError as error:
        if "memory" not in str(error):
            raise
        raise MemoryError(f"not enough memory for the networks of {run.algo}") from error


def _new_model(run: Run, env: VecEnv) -> BaseAlgorithm:
    config = network_config(run)
    common: dict[str, Any] = {
        "policy": "MlpPolicy",
        "env": VecNormalize(env, gamma=config.gamma) if config.normalize else env,
        "learning_rate": LinearSchedule(config.learning_rate, 0.0, 1.0)
        if config.anneal
        else config.learning_rate,
        "batch_size": config.batch_size,
        "gamma": config.gamma,
        "seed": run.seed,
        "device": "cpu",
        "policy_kwargs": policy_kwargs(config),
    }
    names: dict[str, str] = {}
    """argument of Stable-Baselines3 -> field"""
    if isinstance(config, PPOConfig):
        names |= {key: key for key in ("n_steps", "n_epochs", "gae_lambda", "ent_coef")}
    if isinstance(config, OffPolicyConfig):
        names |= {key: key for key in ("buffer_size", "learning_starts", "gradient_steps")}
    if isinstance(config, SACConfig):
        names["tau"] = "tau"
    if isinstance(config, TQCConfig):
        names["top_quantiles_to_drop_per_net"] = "dropped_quantiles"
    if isinstance(config, CrossQConfig):
        names["policy_delay"] = "policy_delay"
    own = {argument: getattr(config, field) for argument, field in names.items()}
    model: BaseAlgorithm = ALGORITHMS[run.algo](**common, **own)
    return model


# ---------------------------------------------------------------- checkpoints

#: What of a configuration may change while a run goes on.
MAY_CHANGE = ("total_timesteps", "log_every", "checkpoint_every", "eval_env_kwargs")


def save_checkpoint(run: Run, env: StaggeredMonitor, model: BaseAlgorithm, recorder: Recorder) -> None:
    """Write the model and all that training depends on into one file, swapped in whole, and the agent.

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
    save_agent(run.agent, model)


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
                raise ConfigError(f"{run.model}: {damaged} in it is damaged")
            whose = json.loads(archive.read("run.json")) if "run.json" in archive.namelist() else None
            if whose is not None:
                check_same(run, whose)
            state = pickle.loads(archive.read("training_state.pkl"))
            normalize = (
                pickle.loads(archive.read("vecnormalize.pkl")) if network_config(run).normalize else None
            )
        return _restore(run, env, recorder, state, normalize, exact=whose is not None)
    except (ConfigError, MemoryError):
        raise
    except Exception as error:  # it may be any file, and be wrong in any way
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ConfigError(
            f"{run.model}: no checkpoint of this run: {reason}. Put a copy of it there, or start a new run"
        ) from error


def _restore(
    run: Run, env: StaggeredMonitor, recorder: Recorder, state: dict[str, Any], normalize: Any, exact: bool
) -> BaseAlgorithm:
    """What `load_checkpoint` does with what it read."""
    if normalize:
        normalize.set_venv(env)
    if not exact:
        print("the checkpoint is of springgym 0.1.0: the episodes under way start anew")
    elif state["env"] is None:
        print(f"{run.env_id} cannot save its state: the episodes under way start anew")
        exact = False
    else:
        native_env(env).set_state(state["env"])
        env.episode_returns, env.episode_lengths, env.episode_count, *shortened = state["monitor"]
        if shortened:  # checkpoints from before copies were staggered have no such array
            (env.shortened,) = shortened
        if normalize:
            normalize.returns = state["discounted_returns"]
    model = ALGORITHMS[run.algo].load(run.model, env=normalize or env, device="cpu", force_reset=not exact)
    if isinstance(model, OffPolicyAlgorithm):
        model.replay_buffer = state["replay_buffer"]
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
    """What was asked for of a run, as JSON has it."""
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
                f"{whose.get(key)!r}. A run keeps what it was started with: put it back, or start a new run"
            )


def native_env(env: StaggeredMonitor) -> Any:
    """The native vector environment under Stable-Baselines3's wrappers."""
    adapter = env.unwrapped
    assert isinstance(adapter, SB3VecEnv)
    return adapter.vector_env


# ---------------------------------------------------------------- rows of metrics.csv


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

    def _append(self, *events: Any) -> None:
        with open(self.path, "ab") as file:
            for event in events:
                event.wall_time = time.time()
                RecordWriter(file).write(event.SerializeToString())

    def close(self) -> None:
        """Nothing is left open."""


def make_logger(run: Run, timesteps: int) -> Logger:
    """The log of a run that has come to ``timesteps``."""
    folder = run.folder / "tensorboard"
    return Logger(str(folder), [TensorBoard(folder, timesteps)])


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
        """What the rows still to come depend on."""
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
                    f"{self.path}:{number}: no row of this run: {line[:80]!r}; mend or delete it"
                )
            reached = steps
            if steps <= timesteps:
                kept.append(line.rstrip("\n"))
        write_atomically(self.path, "\n".join(kept) + "\n")

    def _lines(self) -> list[str]:
        """The lines of metrics.csv below its head, with their ends."""
        if not self.path.exists():
            return []
        try:
            head, *lines = self.path.read_text(encoding="utf-8").splitlines(keepends=True) or [""]
        except UnicodeDecodeError as error:
            raise ConfigError(f"{self.path}: no text: {error}") from error
        if head.rstrip("\n") != ",".join(COLUMNS):
            raise ConfigError(f"{self.path}:1: not the columns of this version: {head[:80]!r}")
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
        """Between two iterations: the agent is up to date and no step is under way."""
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


# ---------------------------------------------------------------- results


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
        return (
            [int(row["timesteps"]) for row in given],
            [scale * float(row[column]) for row in given],
        )

    trained, *baselines = evaluations
    figure, (top, bottom) = plt.subplots(
        2, 1, figsize=(7, 6), sharex=True, layout="constrained", height_ratios=(3, 2)
    )
    top.plot(*curve("reward_per_step"), color="C0", alpha=0.3, lw=1)
    top.plot(*curve("return_per_step"), color="C0", alpha=0.5, label="with the noise of training")
    top.plot(end, trained.return_per_step, "o", color="C0", clip_on=False, label="trained")
    for i, baseline in enumerate(baselines, start=1):
        top.axhline(baseline.return_per_step, color=f"C{i}", ls="--", label=baseline.agent)
    top.set(ylabel="return per step", title=f"{run.env_id}, {run.algo.upper()}, seed {run.seed}")
    for axes, column, scale in (
        (top, "return_per_step", 1.0),
        (bottom, "success_rate", 100.0),
    ):
        if any(row[column] for row in progress):
            steps = [int(row["timesteps"]) for row in progress]
            axes.plot(steps, [scale * float(row[column]) for row in progress], "C0.-", label="without noise")
    top.legend()
    bottom.plot(*curve("success_rate", 100), color="C0", alpha=0.3)
    if trained.success_rate is not None:
        bottom.plot(end, 100 * trained.success_rate, "o", color="C0", clip_on=False)
    bottom.set(xlabel="environment steps", ylabel="success, %", xlim=(0, None), ylim=(-5, 105))
    bottom.xaxis.set_major_formatter(EngFormatter())
    for axes in (top, bottom):
        axes.grid(alpha=0.3)
    with whole_file(run.folder / "learning_curve.png") as path:
        figure.savefig(path, dpi=120)
    plt.close(figure)


def main(arguments: Sequence[str] | None = None, program: str = "train.py") -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        program, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("env_id", nargs="?", help="environment id")
    parser.add_argument("--algo", choices=sorted(CONFIG_OF), help="algorithm (ppo)")
    parser.add_argument("--seed", type=whole(0, HELD_OUT_SEED - 1), help="below those of evaluation (0)")
    parser.add_argument("--run", type=Path, help="run folder (runs/<env id>-<algo>-<seed>)")
    parser.add_argument("--config", type=Path, help="hyperparameters (configs/<algo>.yaml)")
    parser.add_argument(
        "--set",
        dest="overrides",
        metavar="KEY=VALUE",
        nargs="+",
        action="extend",
        default=[],
        help="change hyperparameters",
    )
    parser.add_argument("--timesteps", type=int, help="same as --set total_timesteps=...")
    parser.add_argument("--resume", type=Path, metavar="RUN", help="go on with this run")
    parser.add_argument(
        "--episodes",
        type=whole(0, MOST_EPISODES),
        default=100,
        help="to evaluate on, at the end; 0: only train",
    )
    options = parser.parse_args(arguments)
    if bool(options.env_id) == bool(options.resume):
        parser.error("give an environment id, or --resume and a run folder")
    ignored = {name: getattr(options, name) for name in ("algo", "seed", "run", "config")}
    ignored["set"] = options.overrides or None
    if options.resume and (given := [f"--{name}" for name, value in ignored.items() if value is not None]):
        parser.error(f"--resume goes on with the run's own configuration: drop {', '.join(given)}")

    torch.set_num_threads(1)  # networks this small are fastest on one
    return guarded(program, lambda: resume(options) if options.resume else begin(options), MENDABLE)


def begin(options: argparse.Namespace) -> int:
    """Start a new run."""
    algo: Algorithm = options.algo or "ppo"
    seed, overrides = options.seed or 0, options.overrides
    if options.timesteps is not None:
        overrides = [*overrides, f"total_timesteps={options.timesteps}"]
    config = load_config(algo, options.env_id, overrides, options.config)
    if find(options.env_id) is None and options.config is None:
        print(f"{options.env_id} trains with the default hyperparameters of {algo}; --set changes them")
    folder = options.run or Path("runs") / f"{options.env_id.rpartition(':')[2]}-{algo}-{seed}"
    run = Run(folder, algo, options.env_id, seed, config)
    if isinstance(config, LinearConfig):
        search = Search(run, COLUMNS)
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder):
            create_run(run)
            return finish_search(search, options.episodes)
    env = make_training_env(run)  # before the folder: no run is left of a mistyped argument
    model = new_model(run, env)
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        create_run(run)
        recorder = Recorder(run, env)
        recorder.drop_rows_after(0)
        model.set_logger(make_logger(run, 0))
        return finish(run, env, model, recorder, options.episodes)


def resume(options: argparse.Namespace) -> int:
    """Go on with a run."""
    folder = options.resume
    open_run(folder)  # whether there is one, before its folder is locked
    with locked(folder):
        run = open_run(folder)
        if options.timesteps is not None:
            run = run._replace(config=replace(run.config, total_timesteps=options.timesteps))
        if isinstance(run.config, LinearConfig):
            if options.timesteps is not None:
                raise ConfigError(
                    f"{folder}: how far a search narrows depends on its length: start a new run"
                )
            search = Search(run, COLUMNS)
            if search.path.exists():
                search.load()
                search.write()
            return finish_search(search, options.episodes)
        env = make_training_env(run)
        recorder = Recorder(run, env)
        if run.model.exists():
            model = load_checkpoint(run, env, recorder)
        else:
            print(f"{folder} has no checkpoint yet: training starts from the beginning")
            model = new_model(run, env)
            model.set_logger(make_logger(run, 0))
        if options.timesteps is not None:
            if options.timesteps < model.num_timesteps:
                raise ConfigError(
                    f"--timesteps {options.timesteps}: the run has come to {model.num_timesteps} already"
                )
            write_config(run)
        recorder.drop_rows_after(model.num_timesteps)
        recorder.write_progress()
        save_agent(run.agent, model)
        return finish(run, env, model, recorder, options.episodes)


def finish(run: Run, env: StaggeredMonitor, model: BaseAlgorithm, recorder: Recorder, episodes: int) -> int:
    """Train what is left, then evaluate and show the agent."""
    try:
        begin_with_imitation(run, model, recorder)
        left = run.config.total_timesteps - model.num_timesteps
        if left > 0:
            with tqdm(
                desc=run.env_id,
                initial=model.num_timesteps,
                total=run.config.total_timesteps,
                unit="step",
                unit_scale=True,
                mininterval=0.5,
            ) as recorder.bar:
                # No log_interval: the recorder logs, at every row.
                model.learn(left, recorder, log_interval=None, reset_num_timesteps=False)  # type: ignore[arg-type]
    except KeyboardInterrupt:
        print(f"\nstopped; go on with: springgym train --resume {run.folder}")
        return INTERRUPTED
    except OSError as error:
        if str(run.folder) in str(error):
            raise
        raise OSError(f"{run.folder}: {error.strerror or error}") from error
    except ValueError as error:
        if all(bool(tensor.isfinite().all()) for tensor in model.policy.parameters()):
            raise
        raise ConfigError(
            f"{run.folder}: after {model.num_timesteps} steps the networks hold numbers that are not finite: "
            "learning diverged. Start a new run, with a smaller learning_rate"
        ) from error
    finally:
        env.close()
    if not episodes:
        return 0
    try:
        return report(run, model.num_timesteps, episodes)
    except KeyboardInterrupt:
        print(f"\nstopped, with the agent trained; to see it: springgym train --resume {run.folder}")
        return INTERRUPTED


def begin_with_imitation(run: Run, model: BaseAlgorithm, recorder: Recorder) -> None:
    """Let an untrained agent imitate classical control, if it is asked to; those steps are its own."""
    config = run.config
    if (
        isinstance(config, PPOConfig)
        and isinstance(model, PPO)
        and config.imitate
        and not model.num_timesteps
    ):
        began = recorder.clock()
        model.num_timesteps = recorder.row_at = imitate(run, model)
        recorder.seconds = recorder.clock() - began


def finish_search(search: Search, episodes: int) -> int:
    """Search what is left, then evaluate and show the agent."""
    run, total = search.run, search.config.total_timesteps
    started = Recorder.clock() - search.seconds
    try:
        with tqdm(
            desc=run.env_id, initial=search.timesteps, total=total, unit="step", unit_scale=True
        ) as bar:
            while search.timesteps < total:
                search.generation()
                search.seconds = Recorder.clock() - started
                search.save()
                bar.update(search.timesteps - bar.n)
    except KeyboardInterrupt:
        print(f"\nstopped; go on with: springgym train --resume {run.folder}")
        return INTERRUPTED
    finally:
        search.env.close()
    return report(run, search.timesteps, episodes) if episodes else 0


def report(run: Run, timesteps: int, episodes: int) -> int:
    """Compare the agent with the baselines, draw how it learnt, and film it."""
    baselines = ["zero", "random", *(["classical"] if controllers_of(run.env_id) else [])]
    task = task_kwargs(run.config)
    evaluations = [evaluate(agent, run.env_id, task, episodes) for agent in (str(run.folder), *baselines)]
    write_json(run.folder / "evaluation.json", evaluations)
    plot_learning_curve(run, timesteps, evaluations)
    record(str(run.folder), run.env_id, task, run.folder / "episode.gif")
    print(f"{run.env_id}: {episodes} held-out episodes\n{table(evaluations)}")
    print(f"agent.npz, learning_curve.png and episode.gif are in {run.folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
