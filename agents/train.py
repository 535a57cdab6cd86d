"""Train an agent, compare it with the baselines and film it.

    python agents/train.py SpringTop-v0
    python agents/train.py SpringTop-v0 --algo sac --seed 1 --run runs/sac-frame \\
        --set env_kwargs.observation=frame learning_rate=3e-4
    python agents/train.py --resume runs/SpringTop-v0-ppo-0

Hyperparameters come from configs/<algo>.yaml. The run folder (see runs.py) holds all that comes
out. A run that was stopped in whatever way goes on from its newest checkpoint with --resume; if
the environment can save its state, exactly as if it had never stopped.
"""

from __future__ import annotations

import argparse
import csv
import pickle
import random
import sys
import time
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import torch
from config import CONFIG_OF, ConfigError, PPOConfig, SACConfig, load_config, making
from controllers import CLASSICAL
from evaluate import Evaluation, evaluate, table, task_kwargs, write_json
from runs import (
    ALGORITHMS,
    HELD_OUT_SEED,
    Run,
    create_run,
    open_run,
    replace_atomically,
    write_atomically,
    write_config,
)
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter, Logger, filter_excluded_keys
from stable_baselines3.common.utils import safe_mean
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize
from torch.utils.tensorboard import SummaryWriter
from tqdm import tqdm
from watch import record

import springgym  # noqa: F401  (registers the environments)
from springgym.envs.sb3 import SB3VecEnv, make_sb3

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


# ---------------------------------------------------------------- environment and algorithm


def make_training_env(run: Run) -> VecMonitor:
    """The copies the agent learns in."""
    with making(run.env_id):
        return make_sb3(run.env_id, run.config.n_envs, seed=run.seed, **run.config.env_kwargs)


def new_model(run: Run, env: VecEnv) -> BaseAlgorithm:
    """An untrained agent."""
    config = run.config
    common: dict[str, Any] = {
        "policy": "MlpPolicy",
        "env": VecNormalize(env, gamma=config.gamma) if config.normalize else env,
        "learning_rate": config.learning_rate,
        "batch_size": config.batch_size,
        "gamma": config.gamma,
        "seed": run.seed,
        "device": "cpu",
    }
    activation = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}[config.activation]
    policy_kwargs: dict[str, Any] = {"net_arch": config.net_arch, "activation_fn": activation}
    if isinstance(config, PPOConfig):
        return PPO(
            **common,
            n_steps=config.n_steps,
            n_epochs=config.n_epochs,
            gae_lambda=config.gae_lambda,
            ent_coef=config.ent_coef,
            policy_kwargs={**policy_kwargs, "log_std_init": config.log_std_init},
        )
    assert isinstance(config, SACConfig)
    return SAC(
        **common,
        tau=config.tau,
        buffer_size=config.buffer_size,
        learning_starts=config.learning_starts,
        gradient_steps=config.gradient_steps,
        policy_kwargs=policy_kwargs,
    )


# ---------------------------------------------------------------- checkpoints


def save_checkpoint(run: Run, env: VecMonitor, model: BaseAlgorithm, recorder: Recorder) -> None:
    """Write the model and all that training depends on into one file, swapped in whole.

    To be called between iterations: after an update and before the next step is taken.
    """
    native = native_env(env)
    normalize = model.get_vec_normalize_env()
    logger = model.logger
    state = {
        "env": native.get_state() if hasattr(native, "get_state") else None,
        "monitor": (env.episode_returns, env.episode_lengths, env.episode_count),
        "discounted_returns": normalize.returns if normalize else None,
        "replay_buffer": model.replay_buffer if isinstance(model, SAC) else None,
        "recorder": recorder.state(),
        "logger": (dict(logger.name_to_value), dict(logger.name_to_count), logger.name_to_excluded),
        "random": (random.getstate(), np.random.get_state(), torch.get_rng_state()),  # noqa: NPY002
    }
    temporary = run.model.with_suffix(".tmp.zip")
    model.save(temporary)
    with zipfile.ZipFile(temporary, "a") as archive:
        archive.writestr("training_state.pkl", pickle.dumps(state))
        if normalize:
            archive.writestr("vecnormalize.pkl", pickle.dumps(normalize))
    replace_atomically(temporary, run.model)


def load_checkpoint(run: Run, env: VecMonitor, recorder: Recorder) -> BaseAlgorithm:
    """Restore an agent and everything around it as :func:`save_checkpoint` found it."""
    with zipfile.ZipFile(run.model) as archive:
        state = pickle.loads(archive.read("training_state.pkl"))
        normalize = None
        if run.config.normalize:
            normalize = pickle.loads(archive.read("vecnormalize.pkl"))
            normalize.set_venv(env)
    exact = state["env"] is not None
    if exact:
        native_env(env).set_state(state["env"])
        env.episode_returns, env.episode_lengths, env.episode_count = state["monitor"]
        if normalize:
            normalize.returns = state["discounted_returns"]
    else:
        print(f"{run.env_id} cannot save its state: the episodes under way start anew")
    model = ALGORITHMS[run.algo].load(run.model, env=normalize or env, device="cpu", force_reset=not exact)
    if isinstance(model, SAC):
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


def native_env(env: VecMonitor) -> Any:
    """The native vector environment under Stable-Baselines3's wrappers."""
    adapter = env.unwrapped
    assert isinstance(adapter, SB3VecEnv)
    return adapter.vector_env


# ---------------------------------------------------------------- rows of metrics.csv


class TensorBoard(KVWriter):
    """TensorBoard scalars, hiding what a stopped run wrote beyond ``timesteps``."""

    def __init__(self, folder: Path, timesteps: int) -> None:
        self.writer = SummaryWriter(str(folder), purge_step=timesteps + 1)

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        """Write what is a number and not excluded."""
        for key, value in filter_excluded_keys(key_values, key_excluded, "tensorboard").items():
            if isinstance(value, (int, float, np.number)):
                self.writer.add_scalar(key, value, step)
        self.writer.flush()

    def close(self) -> None:
        """Close the file."""
        self.writer.close()


def make_logger(run: Run, timesteps: int) -> Logger:
    """The log of a run that has come to ``timesteps``."""
    folder = run.folder / "tensorboard"
    return Logger(str(folder), [TensorBoard(folder, timesteps)])


class Recorder(BaseCallback):
    """Writes rows and checkpoints between iterations, and moves the progress bar."""

    bar: tqdm

    def __init__(self, run: Run, env: VecMonitor) -> None:
        super().__init__()
        self.run, self.env = run, env
        self.limit = native_env(env).spec.kwargs["max_episode_steps"]
        self.path = run.folder / "metrics.csv"
        self.seconds = 0.0
        self.row_at = self.checkpoint_at = self.steps = self.episodes = 0
        self.reward = 0.0

    def state(self) -> dict[str, Any]:
        """What the rows still to come depend on."""
        names = ("seconds", "row_at", "steps", "episodes", "reward")
        return {name: getattr(self, name) for name in names}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a checkpoint's state."""
        self.__dict__.update(state)

    def drop_rows_after(self, timesteps: int) -> None:
        """Keep the rows a checkpoint knows of; a kill may have left later ones, or half a row."""
        kept = [",".join(COLUMNS)]
        if self.path.exists():
            for line in self.path.read_text().splitlines(keepends=True)[1:]:
                cells = line.rstrip("\n").split(",")
                whole = line.endswith("\n") and len(cells) == len(COLUMNS)
                if whole and int(cells[0]) <= timesteps:
                    kept.append(line.rstrip("\n"))
        write_atomically(self.path, "\n".join(kept) + "\n")

    def _on_training_start(self) -> None:
        self.checkpoint_at = self.num_timesteps
        self.started = time.perf_counter() - self.seconds

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
        self.seconds = time.perf_counter() - self.started
        if self.num_timesteps - self.row_at >= self.run.config.log_every:
            self.write_row()
        if self.num_timesteps - self.checkpoint_at >= self.run.config.checkpoint_every:
            save_checkpoint(self.run, self.env, self.model, self)
            self.checkpoint_at = self.num_timesteps

    def _on_training_end(self) -> None:
        self.seconds = time.perf_counter() - self.started
        if self.steps:
            self.write_row()
        save_checkpoint(self.run, self.env, self.model, self)

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
        if successes:
            shown["success"] = f"{100 * success_rate:.0f} %"
        self.bar.set_postfix(shown, refresh=False)
        self.row_at, self.steps, self.episodes, self.reward = self.num_timesteps, 0, 0, 0.0


# ---------------------------------------------------------------- results


def plot_learning_curve(run: Run, evaluations: Sequence[Evaluation]) -> None:
    """Draw metrics.csv, and what the finished agent and the baselines reach, as a PNG."""
    with open(run.folder / "metrics.csv", newline="") as file:
        rows = list(csv.DictReader(file))

    def curve(column: str, scale: float = 1.0) -> tuple[list[int], list[float]]:
        given = [row for row in rows if row[column]]
        return (
            [int(row["timesteps"]) for row in given],
            [scale * float(row[column]) for row in given],
        )

    end = int(rows[-1]["timesteps"])
    trained, *baselines = evaluations
    figure, (top, bottom) = plt.subplots(
        2, 1, figsize=(7, 6), sharex=True, layout="constrained", height_ratios=(3, 2)
    )
    top.plot(*curve("reward_per_step"), color="C0", alpha=0.3, lw=1)
    top.plot(*curve("return_per_step"), color="C0", label="while training")
    top.plot(end, trained.return_per_step, "o", color="C0", clip_on=False, label="trained")
    for i, baseline in enumerate(baselines, start=1):
        top.axhline(baseline.return_per_step, color=f"C{i}", ls="--", label=baseline.agent)
    top.set(ylabel="return per step", title=f"{run.env_id}, {run.algo.upper()}, seed {run.seed}")
    top.legend()
    bottom.plot(*curve("success_rate", 100))
    if trained.success_rate is not None:
        bottom.plot(end, 100 * trained.success_rate, "o", color="C0", clip_on=False)
    bottom.set(xlabel="environment steps", ylabel="success, %", xlim=(0, None), ylim=(-5, 105))
    bottom.xaxis.set_major_formatter(EngFormatter())
    for axes in (top, bottom):
        axes.grid(alpha=0.3)
    temporary = run.folder / "learning_curve.tmp.png"
    figure.savefig(temporary, dpi=120)
    plt.close(figure)
    replace_atomically(temporary, run.folder / "learning_curve.png")


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("env_id", nargs="?", help="environment id")
    parser.add_argument("--algo", choices=sorted(CONFIG_OF), default="ppo")
    parser.add_argument("--seed", type=int, default=0)
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
    parser.add_argument("--episodes", type=int, default=100, help="to evaluate on, at the end")
    options = parser.parse_args(arguments)
    if bool(options.env_id) == bool(options.resume):
        parser.error("give an environment id, or --resume and a run folder")
    if options.resume and (options.overrides or options.run or options.config):
        parser.error("--resume goes on with the run's own configuration; only --timesteps changes it")
    if not 0 <= options.seed < HELD_OUT_SEED:
        parser.error(f"--seed must lie in [0, {HELD_OUT_SEED}): evaluation uses those from there on")

    torch.set_num_threads(1)  # networks this small are fastest on one
    try:
        if options.resume:
            run = open_run(options.resume)
            if options.timesteps is not None:
                run = run._replace(config=replace(run.config, total_timesteps=options.timesteps))
                write_config(run)
            env = make_training_env(run)
        else:
            if options.timesteps is not None:
                options.overrides.append(f"total_timesteps={options.timesteps}")
            config = load_config(options.algo, options.env_id, options.overrides, options.config)
            name = f"{options.env_id.rpartition(':')[2]}-{options.algo}-{options.seed}"
            folder = options.run or Path("runs") / name
            run = Run(folder, options.algo, options.env_id, options.seed, config)
            env = make_training_env(run)  # before the folder: no run is left of a mistyped argument
            create_run(run)
    except (ConfigError, FileExistsError) as error:
        print(f"train.py: {error}", file=sys.stderr)
        return 2

    recorder = Recorder(run, env)
    if run.model.exists():
        model = load_checkpoint(run, env, recorder)
    else:
        model = new_model(run, env)
        model.set_logger(make_logger(run, 0))
    recorder.drop_rows_after(model.num_timesteps)
    left = run.config.total_timesteps - model.num_timesteps
    try:
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
        print(f"\nstopped; go on with: python agents/train.py --resume {run.folder}")
        return 130
    finally:
        env.close()

    baselines = ["zero", "random", *(["classical"] if run.env_id in CLASSICAL else [])]
    task = task_kwargs(run.config)
    evaluations = [
        evaluate(agent, run.env_id, task, options.episodes) for agent in (str(run.folder), *baselines)
    ]
    write_json(run.folder / "evaluation.json", evaluations)
    plot_learning_curve(run, evaluations)
    record(str(run.folder), run.env_id, task, run.folder / "episode.gif")
    print(f"{run.env_id}: {options.episodes} held-out episodes\n{table(evaluations)}")
    print(f"model.zip, learning_curve.png and episode.gif are in {run.folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
