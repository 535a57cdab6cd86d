"""Train PPO of Stable-Baselines3 on an environment, evaluate it and save it: a file to copy and change.

python agents/ppo_sb3.py
python agents/ppo_sb3.py --env SpringFreeTop-v0 --timesteps 600_000 --seed 1 --out free_top.zip
"""

import argparse
import os
import time
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"  # networks this small are fastest on one thread

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO

import springgym  # noqa: F401  (registers the environments)
from springgym.envs.sb3 import Monitor, SB3VecEnv, StaggeredMonitor

HYPERPARAMETERS: dict[str, Any] = {
    "n_steps": 32,  # of each environment between two updates
    "batch_size": 512,
    "n_epochs": 5,
    "learning_rate": 2e-3,
    "gamma": 0.98,
    "policy_kwargs": {"log_std_init": -0.5, "net_arch": [32, 32]},
}
"""Those of configs/ppo.yaml for SpringTop-v0; all others are the defaults of Stable-Baselines3."""


def make(env_id: str, num_envs: int, monitor: type[Monitor] = Monitor) -> Monitor:
    """Make environments that are stepped in one compiled call, in the form that Stable-Baselines3 expects."""
    envs = gym.make_vec(
        env_id,
        num_envs=num_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.SAME_STEP,
        observation="features",
    )
    return monitor(SB3VecEnv(envs))


def train(env_id: str, timesteps: int, seed: int = 0) -> PPO:
    """Train an agent in 64 environments, whose first episodes end at different times."""
    envs = make(env_id, 64, StaggeredMonitor)
    model = PPO("MlpPolicy", envs, seed=seed, device="cpu", **HYPERPARAMETERS)
    return model.learn(timesteps)


def evaluate(model: PPO, env_id: str, episodes: int = 100) -> tuple[np.ndarray, np.ndarray]:
    """Play an episode from each of these seeds, none of which trained, without exploration.

    Returns
    -------
    the return and the success of each episode, (episodes,)
    """
    envs: Any = make(env_id, episodes)
    envs.seed(range(1_000_000, 1_000_000 + episodes))
    observations = envs.reset()
    returns = np.zeros(episodes)
    successes = np.zeros(episodes, bool)
    running = np.ones(episodes, bool)
    while running.any():
        actions, _ = model.predict(observations, deterministic=True)
        observations, rewards, dones, infos = envs.step(actions)
        returns += running * rewards
        for i in np.flatnonzero(running & dones):
            successes[i] = infos[i]["is_success"]
        running &= ~dones
    return returns, successes


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--env", default="SpringTop-v0", help="environment id (default: SpringTop-v0)")
    parser.add_argument("--timesteps", type=int, default=200_000, help="steps of all environments together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", default="ppo.zip", help="file for the agent, which PPO.load reads")
    options = parser.parse_args()

    began = time.perf_counter()
    model = train(options.env, options.timesteps, options.seed)
    print(f"{model.num_timesteps:,} steps in {time.perf_counter() - began:.0f} s")
    returns, successes = evaluate(model, options.env)
    print(f"{len(returns)} held-out episodes: return {returns.mean():.0f}, success {successes.mean():.0%}")
    model.save(options.out)
