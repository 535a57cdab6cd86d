"""`springgym view --agent RUN` shows the agent that a run folder holds, as the scripts load it."""

import gymnasium as gym
import numpy as np
import pytest
import runs
from agent import policy_kwargs, save_agent
from config import load_config
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

pytest.importorskip("viser")

from springgym.view.episodes import find_agent, played


@pytest.mark.parametrize("normalize", ["true", "false"])
def test_an_agent_of_a_run_folder(tmp_path, normalize):
    overrides = [f"normalize={normalize}", "env_kwargs.hard=true"]
    config = load_config("ppo", "SpringTop-v0", overrides)
    run = runs.create_run(runs.Run(tmp_path / "run", "ppo", "SpringTop-v0", 0, config))
    envs = DummyVecEnv([lambda: gym.make("SpringTop-v0", **config.env_kwargs)])
    if config.normalize:
        envs = VecNormalize(envs)
        envs.obs_rms.mean[:] = 0.3
        envs.obs_rms.var[:] = 2.0
    save_agent(run.agent, PPO("MlpPolicy", envs, seed=0, policy_kwargs=policy_kwargs(config)))
    agent = find_agent(str(run.folder), "SpringRope-v0")
    assert agent.env_id == "SpringTop-v0"
    assert agent.env_kwargs["hard"] is True
    env = gym.make("SpringTop-v0", **agent.env_kwargs)
    spaces = env.observation_space, env.action_space
    ours = agent.policy(env)
    theirs = runs.load_policy(runs.open_run(run.folder), *spaces)
    observations = np.random.default_rng(0).normal(size=(5, *env.observation_space.shape)).astype(np.float32)
    np.testing.assert_array_equal(ours(observations), theirs(observations))
    assert played(agent, 0).title == "SpringTop-v0: run"


CONFIG = """algo: ppo
env_id: SpringTop-v0
seed: 0
config: {net_arch: [8], activation: tanh, gamma: 0.9}
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tanh", "gelu", r"config\.yaml:4: config\.activation: "),
        ("[8]", "wide", r"config\.yaml:4: config\.net_arch: "),
        ("ppo", "dqn", r"config\.yaml:1: algo: "),
        ("SpringTop-v0", "os:Top-v0", "names a module to import; to allow this, pass os:Top-v0"),
    ],
)
def test_a_configuration_of_another_kind(tmp_path, old, new, message):
    """It may be anyone's: what it says is checked, and a module that it names is not imported."""
    (tmp_path / "config.yaml").write_text(CONFIG.replace(old, new))
    with pytest.raises(ValueError, match=message):
        find_agent(str(tmp_path), "SpringTop-v0")
