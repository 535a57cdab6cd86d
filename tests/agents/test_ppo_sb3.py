"""The script to copy: what it imports, and that it trains, evaluates and saves."""

import ast
import runpy
import sys

import config
import gymnasium as gym
import numpy as np
import ppo_sb3
import pytest
from conftest import AGENTS
from stable_baselines3 import PPO

SCRIPT = AGENTS / "ppo_sb3.py"


def test_it_needs_four_packages_and_is_read_in_a_minute():
    text = SCRIPT.read_text(encoding="utf-8")
    found = set()
    for node in ast.walk(ast.parse(text)):
        names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
        names += [node.module] if isinstance(node, ast.ImportFrom) else []
        found |= {name.partition(".")[0] for name in names}
    assert found - sys.stdlib_module_names == {"gymnasium", "numpy", "springgym", "stable_baselines3"}
    assert len([line for line in text.splitlines() if line.strip()]) <= 80


def test_its_hyperparameters_are_those_of_the_task():
    model = PPO("MlpPolicy", ppo_sb3.make("SpringTop-v0", 64), device="cpu", **ppo_sb3.HYPERPARAMETERS)
    settings = config.load_config("ppo", "SpringTop-v0")
    names = (
        "n_envs",
        "n_steps",
        "batch_size",
        "n_epochs",
        "gamma",
        "gae_lambda",
        "learning_rate",
        "ent_coef",
    )
    assert {name: getattr(model, name) for name in names} == {name: getattr(settings, name) for name in names}
    assert model.policy.log_std.mean().item() == settings.log_std_init
    assert settings.net_arch == model.policy.net_arch
    assert settings.activation == "tanh"


def test_it_trains_evaluates_and_saves(tmp_path, monkeypatch, capsys):
    """A tiny budget; the return of an evaluated episode is that of a single environment from its seed."""
    path = tmp_path / "agent.zip"
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), "--timesteps", "100", "--out", str(path)])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    assert "2,048 steps in" in capsys.readouterr().out
    model = PPO.load(path, device="cpu")
    returns, successes = ppo_sb3.evaluate(model, "SpringTop-v0", 3)
    assert successes.shape == (3,)
    env = gym.make("SpringTop-v0", observation="features")
    total = 0.0
    over = False
    observation, _ = env.reset(seed=1_000_001)
    while not over:
        action, _ = model.predict(observation, deterministic=True)
        observation, reward, terminated, truncated, info = env.step(action)
        total = total + reward
        over = terminated or truncated
    assert returns[1] == pytest.approx(total, rel=1e-3)
    assert successes[1] == info["is_success"]
    assert len(np.unique(returns)) == 3


@pytest.mark.slow
def test_it_solves_the_top():
    model = ppo_sb3.train("SpringTop-v0", 200_000)
    _, successes = ppo_sb3.evaluate(model, "SpringTop-v0")
    assert successes.mean() > 0.9
