"""Arguments that a script refuses: it says what is wrong before anything is run, and makes no file."""

import importlib

import gymnasium as gym
import pytest
from conftest import HERE
from toy_env import ToyEnv

gym.register("ToyEndless-v0", entry_point=ToyEnv)

TOP = "SpringTop-v0"
TOY = "toy_env:Toy-v0"
FEATURES = "env_kwargs.observation=features"
TOY_PPO = ["--config", str(HERE / "toy_ppo.yaml"), "--set"]
CELL = ["--local", "--runs", ".", "--algorithms", "ppo"]

WRONG = [
    ("audit", ["noop"], "name the environment with --env"),
    ("audit", ["noop", "--env", "CartPole-v1"], "CartPole-v1 is not a springgym environment"),
    ("audit", ["nobody", "--env", TOP], "unknown controller 'nobody'"),
    ("benchmark", ["--address", "auto", "--jobs", "2"], "--jobs works on this machine only"),
    ("benchmark", ["--address", "auto", "--local"], "not allowed with argument"),
    ("benchmark", ["--algorithms", "dqn"], "invalid choice: 'dqn'"),
    ("benchmark", ["--seeds", "0"], "'0' must be a whole number from 1"),
    ("benchmark", ["--agents", "runs", "--local"], "--agents belongs to --check"),
    ("benchmark", ["--check", "absent.json"], "absent.json"),
    ("benchmark", [*CELL, "--set", "lr=1"], "unknown key 'lr'"),
    ("benchmark", [*CELL, "--configs", "absent"], "absent/ppo.yaml: cannot read it"),
    *(
        ("dataset", [TOP, "noop", f"--noise={noise}"], f"'{noise}' must be a number from 0 to 1")
        for noise in ("-0.1", "1.5", "nan", "much")
    ),
    ("evaluate", ["noop"], "error: name the environment with --env, or give a run folder"),
    ("evaluate", ["noop", "runs/absent"], "'runs/absent' is no run folder, environment id or baseline; name"),
    ("evaluate", ["clasical", "--env", TOY], "'clasical': use noop, random, classical or module:function"),
    ("evaluate", ["classical", "--env", TOY], "no classical controller for toy_env:Toy-v0 with action=None"),
    ("evaluate", ["noop", "--env", TOY, "--set", "push"], "--set push: write it as key=value"),
    *(
        ("evaluate", ["noop", "--env", TOP, "--set", f"{name}={value}"], name)
        for name, value in (("stagger", "true"), ("seed", 5), ("num_envs", 3), ("env_id", "A-v0"))
    ),
    ("evaluate", ["noop", "--env", "ToyEndless-v0"], "ToyEndless-v0 has no time limit: register it with max"),
    ("generalize", [TOP, "--episodes", "1"], "--episodes: '1' must be a whole number from 2"),
    ("generalize", [TOP, "--rows", "/absent/rows.json"], "there is no folder"),
    ("offline", [TOP], "the following arguments are required: --data"),
    ("offline", [TOP, "--data", "a", "--steps", "0"], "'0' must be a whole number from 1"),
    ("offline", [TOP, "--data", "a", "--steps", "1.5"], "'1.5' must be a whole number from 1"),
    ("offline", [TOP, "--data", "a", "--seed", "1000000"], "must be a whole number from 0 to 999999"),
    *(
        ("plan", ["--tasks", TOP, "--horizon", time], "must be a number from 0.001 to 1000")
        for time in ("0", "-1", "nan", "inf", "far", "1e9")
    ),
    ("rllib_ppo", [TOP, "--out", ".", "--copies", "3"], "= 192 is not a multiple of 512"),
    ("rllib_ppo", [TOP, "--out", ".", "--resume"], "has no checkpoint"),
    ("train", [], "missing environment id (or --resume RUN)"),
    ("train", ["A-v0", "--resume", "x"], "pass either an environment id or --resume RUN, not both"),
    ("train", ["--resume", "x", "--set", "a=1"], "configuration of the run: leave out --set"),
    ("train", ["--resume", "x", "--seed", "0", "--algo", "ppo"], "the run: leave out --algo, --seed"),
    ("train", ["A-v0", "--seed", "1000000"], "--seed: '1000000' must be a whole number from 0 to 999999"),
    ("train", ["A-v0", "--episodes", "-1"], "--episodes: '-1' must be a whole number from 0"),
    ("train", [TOY, *TOY_PPO, "lr=1"], "key 'lr'"),
    ("train", ["--resume", "absent"], "absent/config.yaml: cannot read it"),
    ("train", [TOP, "--timesteps", "0"], "total_timesteps: must lie between 1 and inf, got 0"),
    ("train", [TOP, "--set", "env_kwargs.obs=frame"], "SpringTop-v0: "),
    ("train", [TOP, "--set", "env_kwargs.observation=fram"], "observation is 'fram'"),
    ("train", [TOP, "--set", "bc_steps=100", "env_kwargs={}"], "needs the features"),
    ("train", [TOP, "--set", "bc_steps=-1", FEATURES], "between 0"),
    ("train", [TOP, "--set", "bc_steps=20_000_000", FEATURES], "less than total_timesteps"),
    ("train", [TOP, "--set", "bc_steps=63", FEATURES], "at least n_envs, 64"),
    ("train", [TOP, "--set", "bc_steps=0.5", FEATURES], "whole number"),
    ("train", [TOY, *TOY_PPO, "bc_steps=100", FEATURES], "no classical controller"),
    ("train", ["ToyEndless-v0"], "ToyEndless-v0 has no time limit: register it with max_ep"),
    # the file of an agent cannot hold discrete actions
    (
        "train",
        ["CartPole-v1", "--timesteps", "64"],
        "CartPole-v1 has no continuous actions: its action space",
    ),
    ("transfer", ["SpringRope-v0", "--local"], "has no rigid twin"),
    ("transfer", [TOP, "--local", "--set", "lr=1"], "unknown key 'lr'"),
    ("tune", [TOP, "--set", "lr=1"], "unknown key 'lr'"),
    ("watch", ["clasical", "--env", TOY, "--out", "toy.gif"], "unknown controller 'clasical'"),
    ("watch", ["noop", "--out", "toy.gif"], "name the environment with --env"),
    ("watch", ["noop", "--env", "CartPole-v1", "--out", "a.gif"], "CartPole-v1 has no continuous actions"),
    ("watch", ["noop", "--env", TOY, "--out", "a.avi"], "--out: a.avi: the name must end in .gif or .mp4 or"),
    ("watch", ["noop", "--env", TOP, "--browser", "--out", "a.gif"], "pass either --out or --browser"),
]
"""Scripts, their arguments, and what is said of them; mistyped ids are in `test_ids.py`."""

NEEDS = {"rllib_ppo": "ray", "tune": "optuna"}
"""Packages of scripts that are not in an extra which all tests need."""


@pytest.mark.filterwarnings("ignore:.*was registered without a vector_entry_point")
@pytest.mark.parametrize(("script", "arguments", "says"), WRONG)
def test_what_is_wrong_is_told_and_makes_no_file(script, arguments, says, tmp_path, monkeypatch, capsys):
    if script in NEEDS:
        pytest.importorskip(NEEDS[script])
    monkeypatch.chdir(tmp_path)
    try:
        status = importlib.import_module(script).main(arguments)
    except SystemExit as stop:
        status = stop.code
    assert status == 2
    assert says in capsys.readouterr().err
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
