"""The learner: the copies that an agent trains in, and the untrained agent."""

from __future__ import annotations

from typing import Any

from agent import ALGORITHMS, policy_kwargs
from config import ConfigError, HERConfig, PPOConfig, SACConfig, SB3Config, TQCConfig, making
from gymnasium import spaces
from imitation import teacher
from runs import Run, time_limit
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from springgym.envs.sb3 import SB3VecEnv, StaggeredMonitor, make_sb3


class Falling:
    """A learning rate that falls to 0 in a straight line until the run ends."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self.left = 1.0

    def __call__(self, steps_left: float) -> float:
        """Return the rate, given the share of the steps that is left."""
        return self.rate * min(self.left, steps_left)


def network_config(run: Run) -> SB3Config:
    """Return the configuration of a run that Stable-Baselines3 trains.

    Raises
    ------
    ConfigError
        If it does not.
    """
    if not isinstance(run.config, SB3Config):
        raise ConfigError(f"{run.folder} is a run of {run.algo}, which Stable-Baselines3 cannot train")
    return run.config


def make_training_env(run: Run) -> StaggeredMonitor:
    """Make the batch in which an agent learns, with the ends of episodes spread over time.

    If all copies ended together, learning curves would show saw teeth.

    Raises
    ------
    ConfigError
        If there is no such environment, or its actions are not numbers.
    """
    with making(run.env_id):
        copies = network_config(run).n_envs
        kwargs = run.config.env_kwargs
        env = make_sb3(run.env_id, copies, run.seed, stagger=True, env_kwargs=kwargs)
    assert isinstance(env, StaggeredMonitor)
    if not isinstance(env.action_space, spaces.Box):
        raise ConfigError(f"{run.env_id} has no continuous actions: its action space is {env.action_space}")
    time_limit(native_env(env).spec)  # there is one
    return env


def native_env(env: StaggeredMonitor) -> Any:
    """Make the native vector environment under Stable-Baselines3's wrappers."""
    adapter = env.unwrapped
    assert isinstance(adapter, SB3VecEnv)
    return adapter.vector_env


def new_model(run: Run, env: VecEnv) -> BaseAlgorithm:
    """Make an untrained agent.

    Raises
    ------
    ConfigError
        If it is to imitate what there is not.
    MemoryError
        If it does not fit into memory.
    """
    if isinstance(run.config, PPOConfig) and run.config.bc_steps:
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
        "policy": "MultiInputPolicy" if isinstance(env.observation_space, spaces.Dict) else "MlpPolicy",
        "env": VecNormalize(env, gamma=config.gamma) if config.normalize else env,
        "learning_rate": Falling(config.learning_rate) if config.anneal else config.learning_rate,
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
    if isinstance(config, SACConfig):
        names |= {key: key for key in ("buffer_size", "learning_starts", "gradient_steps", "tau")}
    if isinstance(config, TQCConfig):
        names["top_quantiles_to_drop_per_net"] = "dropped_quantiles"
    own = {argument: getattr(config, field) for argument, field in names.items()}
    if isinstance(config, HERConfig):
        if not isinstance(env.observation_space, spaces.Dict):
            raise ConfigError(
                f"{run.env_id}: hindsight needs observations that tell goals apart: "
                "--set env_kwargs.goals=true env_kwargs.sparse=true"
            )
        own["replay_buffer_class"] = HerReplayBuffer
        own["replay_buffer_kwargs"] = {"n_sampled_goal": config.relabelled}
    model: BaseAlgorithm = ALGORITHMS[run.algo](**common, **own)
    return model
