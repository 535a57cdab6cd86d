"""Train on many cores with RLlib's PPO, whose env runners step native batches.

    python agents/rllib_ppo.py SpringTop-v0 --runners 2
    python agents/rllib_ppo.py SpringTop-v0 --runners 62 --address auto --timesteps 10_000_000

RLlib requires a certain version of Gymnasium, so use an environment with agents/rllib-constraints.txt. Each
runner steps --copies copies by one call, on its own core; on a cluster, on any node. Hyperparameters are
those of configs/ppo.yaml but for normalize, bc_steps and log_std_init. The run folder holds RLlib's
checkpoints and metrics.csv. --resume continues from the newest checkpoint.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from config import MENDABLE, ConfigError, PPOConfig, command_line, load_config, making, whole
from runs import HELD_OUT_SEED

from springgym.cli import INTERRUPTED, guarded, write_text
from springgym.envs.starts import spawn_seeds

ROOT = Path(__file__).resolve().parent.parent
COLUMNS = ("timesteps", "seconds", "return_per_step", "success_rate")
NATIVE = "vector_entry_point"


def seed_apart(*, env_runner: Any, **given: object) -> None:
    """Give the copies of a runner seeds that no other runner's have; RLlib calls it for each new batch.

    Of itself RLlib seeds runner k by seed + k, and so copy i of it by seed + k + i, as others of the next.
    """
    assert env_runner._seed is not None
    env_runner._seed = spawn_seeds(env_runner.config.seed, env_runner.worker_index + 1)[-1]


def algorithm(env_id: str, config: PPOConfig, options: argparse.Namespace) -> Any:
    """Make RLlib's PPO with the hyperparameters of ``configs/ppo.yaml``."""
    from ray.rllib.algorithms.ppo import PPOConfig as Settings
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    asked = (
        Settings()  # type: ignore[no-untyped-call]
        .environment(f"springgym:{env_id}", env_config=dict(config.env_kwargs))
        .env_runners(
            num_env_runners=options.runners,
            num_envs_per_env_runner=options.copies,
            gym_env_vectorize_mode=NATIVE,
            rollout_fragment_length=config.n_steps,
        )
        .learners(num_learners=0)
        .training(
            train_batch_size_per_learner=options.runners * options.copies * config.n_steps,
            minibatch_size=config.batch_size,
            num_epochs=config.n_epochs,
            lr=[[0, config.learning_rate], [config.total_timesteps, 0.0]]
            if config.anneal
            else config.learning_rate,
            gamma=config.gamma,
            lambda_=config.gae_lambda,
            clip_param=0.2,
            grad_clip=0.5,
            entropy_coeff=config.ent_coef,
            vf_loss_coeff=0.5,
            vf_clip_param=float("inf"),
            use_kl_loss=False,
        )
        .rl_module(
            model_config=DefaultModelConfig(
                fcnet_hiddens=config.net_arch, fcnet_activation=config.activation, vf_share_layers=False
            )
        )
        .debugging(seed=spawn_seeds(options.seed, 1)[0] % 2**31, log_level="ERROR")  # runner k has seed + k
        .callbacks(on_environment_created=seed_apart)
    )
    return asked.build_algo()


def evaluate(module: Any, env_id: str, kwargs: dict[str, Any], episodes: int) -> tuple[float, float | None]:
    """Play held-out episodes with the deterministic policy.

    Returns
    -------
    the mean return per step and the share of successes, None if the environment reports none
    """
    import torch

    with making(env_id):
        env: Any = gym.make_vec(
            env_id,
            num_envs=episodes,
            vectorization_mode=NATIVE,
            autoreset_mode=gym.vector.AutoresetMode.SAME_STEP,
            **kwargs,
        )
    observations, _ = env.reset(seed=HELD_OUT_SEED)
    size = env.single_action_space.shape[0]
    returns = np.zeros(episodes)
    running = np.ones(episodes, bool)
    successes = np.zeros(episodes)
    unknown = np.full(episodes, np.nan)
    while running.any():
        with torch.no_grad():
            out = module.forward_inference({"obs": torch.as_tensor(observations)})
        actions = np.clip(out["action_dist_inputs"].numpy()[:, :size], -1.0, 1.0)
        observations, rewards, terminated, truncated, infos = env.step(actions)
        returns += running * rewards
        over = running & (terminated | truncated)
        if over.any():
            successes[over] = infos["final_info"].get("is_success", unknown)[over]
        running &= ~over
    limit = env.spec.kwargs["max_episode_steps"]
    env.close()
    return float(returns.mean() / limit), None if np.isnan(successes).any() else float(successes.mean())


def learn(options: argparse.Namespace) -> int:
    """Train, and tell after every tenth iteration how the agent does."""
    config = load_config("ppo", options.env_id)
    import ray
    import torch

    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    assert isinstance(config, PPOConfig)
    total = options.timesteps or config.total_timesteps
    batch = options.runners * options.copies * config.n_steps
    if batch % config.batch_size:
        raise ConfigError(
            f"--runners × --copies × n_steps = {batch} is not a multiple of {config.batch_size}"
        )
    folder = (options.out or Path("runs") / f"{options.env_id}-rllib-{options.seed}").absolute()
    checkpoint = folder / "checkpoint"
    table = folder / "metrics.csv"
    if checkpoint.exists() != options.resume:
        what = "holds a run: give --resume, or another --out" if checkpoint.exists() else "has no checkpoint"
        raise ConfigError(f"{folder} {what}")
    torch.set_num_threads(1)
    path = os.pathsep.join([str(ROOT / "agents"), str(ROOT), os.environ.get("PYTHONPATH", "")])
    cores: dict[str, Any] = {} if options.address else {"include_dashboard": False}
    environment = {"env_vars": {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"}}
    ray.init(options.address or "local", runtime_env=environment, log_to_driver=False, **cores)
    try:
        algo = algorithm(options.env_id, config, options)
        if options.resume:
            algo.restore_from_path(str(checkpoint))
        folder.mkdir(parents=True, exist_ok=True)
        rows = list(csv.reader(table.read_text().splitlines()))[1:] if options.resume else []
        steps, seconds = (int(rows[-1][0]), float(rows[-1][1])) if rows else (0, 0.0)
        kwargs = {**config.env_kwargs, **config.eval_env_kwargs}
        started = time.perf_counter() - seconds
        n = 0
        while steps < total:
            algo.train()
            steps = steps + batch
            n = n + 1
            if n % 10 == 0 or steps >= total:
                seconds = time.perf_counter() - started
                earned, success = evaluate(algo.get_module(), options.env_id, kwargs, options.episodes)
                rate = "" if success is None else f"{success:.3f}"
                rows.append([str(steps), f"{seconds:.1f}", f"{earned:.4f}", rate])
                algo.save_to_path(str(checkpoint))
                write_text(table, "\n".join(",".join(row) for row in [COLUMNS, *rows]) + "\n")
                print(f"{steps} steps, {seconds:.0f} s: return/step {earned:.3f}, success {rate or '–'}")
        return 0
    except KeyboardInterrupt:
        print("\nstopped; continue with --resume")
        return INTERRUPTED
    finally:
        ray.shutdown()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = command_line(__doc__)
    parser.add_argument("env_id", help="environment id")
    parser.add_argument(
        "--runners", type=whole(1, 10_000), default=2, help="number of environment processes (default: 2)"
    )
    parser.add_argument(
        "--copies", type=whole(1, 100_000), default=32, help="environments per process (default: 32)"
    )
    parser.add_argument(
        "--timesteps", type=whole(1, 10**12), help="number of steps (default: that in configs/ppo.yaml)"
    )
    parser.add_argument("--seed", type=whole(0, HELD_OUT_SEED - 1), default=0)
    parser.add_argument(
        "--episodes", type=whole(1, 100_000), default=100, help="episodes of the evaluation (default: 100)"
    )
    parser.add_argument("--out", type=Path, help="run folder (default: runs/<env id>-rllib-<seed>)")
    parser.add_argument("--resume", action="store_true", help="continue this run")
    parser.add_argument("--address", help="address of a Ray cluster (auto: this machine's)")
    options = parser.parse_args(arguments)
    return guarded("rllib_ppo.py", lambda: learn(options), (*MENDABLE, ImportError))


if __name__ == "__main__":
    sys.exit(main())
