"""Train an agent, compare it with the baselines and record a video.

    springgym train SpringTop-v0
    springgym train SpringTop-v0 --algo sac --seed 1 --out runs/sac-features \\
        --set env_kwargs.observation=features learning_rate=3e-4
    springgym train --resume runs/SpringTop-v0-ppo-0

Hyperparameters come from configs/<algo>.yaml of the package or the clone. The run folder holds all results,
with the hyperparameters in config.yaml. --resume continues a run from its newest checkpoint, with the same
configuration; if the environment can save its state, results are bit-identical to an uninterrupted run.
--resume unpickles the checkpoint, so use it with your own runs only.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import torch
from agent import save_agent
from config import (
    MENDABLE,
    ONLINE,
    ConfigError,
    LinearConfig,
    PPOConfig,
    add_overrides,
    command_line,
    load_config,
    whole,
)
from controllers import controllers_of
from evaluate import MOST_EPISODES, evaluate, table, task_kwargs, write_json
from imitation import imitate
from learner import make_training_env, new_model
from linear import Search
from recorder import COLUMNS, Recorder, load_checkpoint, make_logger, plot_learning_curve
from runs import HELD_OUT_SEED, Run, create_run, locked, open_run, write_config
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from tqdm import tqdm
from watch import record

import springgym  # noqa: F401  (registers the environments)
from springgym.cli import INTERRUPTED, guarded
from springgym.envs.agent import Algorithm
from springgym.envs.registration import find
from springgym.envs.sb3 import StaggeredMonitor

MOST_STEPS = 10**12


def main(arguments: Sequence[str] | None = None, program: str = "train.py") -> int:
    """Run the command line."""
    parser = command_line(__doc__, program)
    parser.add_argument("env_id", nargs="?", help="environment id")
    parser.add_argument("--algo", choices=sorted(ONLINE), help="algorithm (default: ppo)")
    parser.add_argument(
        "--seed",
        type=whole(0, HELD_OUT_SEED - 1),
        help=f"training seed (must be < {HELD_OUT_SEED:,}; default: 0)",
    )
    parser.add_argument("--out", type=Path, help="output folder (default: runs/<env id>-<algo>-<seed>)")
    parser.add_argument("--config", type=Path, help="hyperparameter file (default: configs/<algo>.yaml)")
    add_overrides(parser, "change hyperparameters")
    parser.add_argument("--timesteps", type=whole(0, MOST_STEPS), help="same as --set total_timesteps=...")
    parser.add_argument("--resume", type=Path, metavar="RUN", help="continue this run")
    parser.add_argument(
        "--episodes",
        type=whole(0, MOST_EPISODES),
        default=100,
        help="episodes of the evaluation at the end; 0 for none",
    )
    options = parser.parse_args(arguments)
    if options.env_id and options.resume:
        parser.error("pass either an environment id or --resume RUN, not both")
    if not options.env_id and not options.resume:
        parser.error("missing environment id (or --resume RUN)")
    ignored = {name: getattr(options, name) for name in ("algo", "seed", "out", "config")}
    ignored["set"] = options.overrides or None
    if options.resume and (given := [f"--{name}" for name, value in ignored.items() if value is not None]):
        parser.error(f"--resume continues with the configuration of the run: leave out {', '.join(given)}")

    torch.set_num_threads(1)  # networks this small are fastest on one
    return guarded(program, lambda: resume(options) if options.resume else begin(options), MENDABLE)


def begin(options: argparse.Namespace) -> int:
    """Start a new run."""
    algo: Algorithm = options.algo or "ppo"
    seed = options.seed or 0
    overrides = options.overrides
    if options.timesteps is not None:
        overrides = [*overrides, f"total_timesteps={options.timesteps}"]
    config = load_config(algo, options.env_id, overrides, options.config)
    if find(options.env_id) is None and options.config is None:
        print(f"{options.env_id} trains with the default hyperparameters of {algo}; --set changes them")
    folder = options.out or Path("runs") / f"{options.env_id.rpartition(':')[2]}-{algo}-{seed}"
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
        recorder.write_tables()
        model.set_logger(make_logger(run, 0))
        return finish(run, env, model, recorder, options.episodes)


def resume(options: argparse.Namespace) -> int:
    """Go on with a run."""
    folder = options.resume
    open_run(folder)  # whether there is one, before its folder is locked
    with locked(folder):
        run = open_run(folder, [] if options.timesteps is None else [f"total_timesteps={options.timesteps}"])
        if options.timesteps is not None and run.config.seconds:
            raise ConfigError(
                f"{folder}: the run ends after {run.config.seconds:g} s, so --timesteps has no effect"
            )
        if isinstance(run.config, LinearConfig):
            if options.timesteps is not None:
                raise ConfigError(
                    f"{folder}: the length of a search cannot change, because its "
                    "steps depend on it: start a new run"
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
                    f"--timesteps {options.timesteps}: the run has {model.num_timesteps} steps already"
                )
            write_config(run)
        recorder.write_tables()
        save_agent(run.agent, model)
        return finish(run, env, model, recorder, options.episodes)


def finish(run: Run, env: StaggeredMonitor, model: BaseAlgorithm, recorder: Recorder, episodes: int) -> int:
    """Train what is left, then evaluate and show the agent."""
    try:
        begin_with_imitation(run, model, recorder)
        steps = MOST_STEPS if run.config.seconds else run.config.total_timesteps
        if run.config.share_done(model.num_timesteps, recorder.seconds) < 1.0:
            with tqdm(
                desc=run.env_id,
                initial=model.num_timesteps,
                total=None if run.config.seconds else steps,
                unit="step",
                unit_scale=True,
                mininterval=0.5,
            ) as recorder.bar:
                # No log_interval: the recorder logs, at every row.
                left = steps - model.num_timesteps
                model.learn(left, recorder, log_interval=None, reset_num_timesteps=False)  # type: ignore[arg-type]
    except KeyboardInterrupt:
        saved = recorder.checkpoint_at
        print(f"\nstopped; continue from step {saved:,} with: springgym train --resume {run.folder}")
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
        and config.bc_steps
        and not model.num_timesteps
    ):
        began = recorder.clock()
        model.num_timesteps = recorder.row_at = imitate(run, model)
        recorder.seconds = recorder.clock() - began


def finish_search(search: Search, episodes: int) -> int:
    """Search what is left, then evaluate and show the agent."""
    run = search.run
    total = search.config.total_timesteps
    started = Recorder.clock() - search.seconds
    try:
        with tqdm(
            desc=run.env_id, initial=search.timesteps, total=total, unit="step", unit_scale=True
        ) as bar:
            while search.config.share_done(search.timesteps, search.seconds) < 1.0:
                search.generation()
                search.seconds = Recorder.clock() - started
                search.save()
                bar.update(search.timesteps - bar.n)
    except KeyboardInterrupt:
        print(f"\nstopped; continue with: springgym train --resume {run.folder}")
        return INTERRUPTED
    finally:
        search.env.close()
    return report(run, search.timesteps, episodes) if episodes else 0


def report(run: Run, timesteps: int, episodes: int) -> int:
    """Compare the agent with the baselines, draw how it learnt, and film it."""
    baselines = ["noop", "random", *(["classical"] if controllers_of(run.env_id) else [])]
    task = task_kwargs(run.config)
    evaluations = [evaluate(agent, run.env_id, task, episodes) for agent in (str(run.folder), *baselines)]
    write_json(run.folder / "evaluation.json", evaluations)
    plot_learning_curve(run, timesteps, evaluations)
    record(str(run.folder), run.env_id, task, run.folder / "episode.gif")
    print(f"{run.env_id}: {episodes} held-out episodes\n{table(evaluations, run.env_id)}")
    print(f"agent.npz, learning_curve.png and episode.gif are in {run.folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
