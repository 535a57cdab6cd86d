"""Configuration files: what is accepted, and that an error names file, line and key."""

import argparse
from pathlib import Path

import config
import gymnasium as gym
import pytest
import yaml

import springgym  # noqa: F401  (registers the environments)
from springgym.envs.registration import find
from tests.params import slow_but

GOOD = """\
Task-v0:
  total_timesteps: 1_000
  n_envs: 4
  n_steps: 8
  batch_size: 16
  n_epochs: 2
  learning_rate: 3e-4
  gamma: 1
  gae_lambda: 0.95
  net_arch: [32, 16]
  activation: relu
  log_std_init: -0.5
  env_kwargs: {tilt: 1e-2, body: {mass: 12}}
"""


@pytest.fixture
def load(tmp_path):
    def load(text, overrides=()):
        path = tmp_path / "some.yaml"
        path.write_text(text)
        return config.load_config("ppo", "Task-v0", overrides, path)

    return load


def test_values_arrive_with_their_types(load):
    c = load(GOOD)
    assert yaml.safe_load("3e-4") == "3e-4"  # what this loader mends
    assert (c.learning_rate, type(c.gamma), c.total_timesteps) == (3e-4, float, 1000)
    assert c.net_arch == [32, 16]
    assert c.env_kwargs == {"tilt": 0.01, "body": {"mass": 12}}
    assert c.normalize is False


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("gamma: 1", "gama: 1", 8, "unknown key 'gama'; did you mean 'gamma'?"),
        ("gamma: 1", "n_envs: 5", 8, "duplicate key 'n_envs'"),
        ("mass: 12", "mass: 12, mass: 1", 13, "duplicate key 'mass'"),
        ("learning_rate: 3e-4", "learning_rate: '3e-4'", 7, "learning_rate: expected a number"),
        ("n_envs: 4", "n_envs: 4.0", 3, "n_envs: expected a whole number, got 4.0"),
        ("n_envs: 4", "n_envs: 0", 3, "n_envs: must lie between 1 and 1000000, got 0"),
        ("[32, 16]", "[32, 0]", 10, "net_arch: must lie between 1"),
        ("activation: relu", "activation: gelu", 11, "activation: expected one of tanh, relu"),
        ("  gamma: 1\n", "", 1, "Task-v0 lacks gamma"),
        ("batch_size: 16", "batch_size: 24", 5, "batch_size 24 must divide n_envs * n_steps = 32"),
        ("n_steps: 8", "n_steps: [8", 5, "not valid YAML"),
    ],
)
def test_error_names_file_line_and_key(load, tmp_path, old, new, line, says):
    """All that is read strictly is in `tests.test_strict_yaml`."""
    assert GOOD.count(old) == 1
    with pytest.raises(config.ConfigError) as caught:
        load(GOOD.replace(old, new))
    assert str(caught.value).startswith(f"{tmp_path / 'some.yaml'}:{line}: ")
    assert says in str(caught.value)


def test_an_error_in_any_entry_is_found(load):
    other = GOOD.replace("Task-v0", "Other-v0").replace("n_envs: 4", "n_envs: few")
    with pytest.raises(config.ConfigError, match=r"some.yaml:16: Other-v0.n_envs: expected a whole number"):
        load(GOOD + other)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "the file must be a mapping"),
        ("Task-v0: 3", "some.yaml:1: Task-v0 must be a mapping of keys to values"),
        (GOOD.replace("Task-v0", "Other-v0"), "Unknown environment 'Task-v0'"),
    ],
)
def test_wrong_shape_of_the_file(load, text, says):
    with pytest.raises(ValueError, match=says):
        load(text)


def test_missing_file():
    with pytest.raises(config.ConfigError, match=r"absent.yaml: cannot read it"):
        config.load_config("ppo", "Task-v0", path=Path("absent.yaml"))


def test_overrides(load):
    c = load(
        GOOD, ["learning_rate=1e-3", "net_arch=[8]", "env_kwargs.body.mass=3", "eval_env_kwargs.start=up"]
    )
    assert (c.learning_rate, c.net_arch) == (1e-3, [8])
    assert c.env_kwargs == {"tilt": 0.01, "body": {"mass": 3}}
    assert c.eval_env_kwargs == {"start": "up"}


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("learning_rate", "--set learning_rate: write it as key=value"),
        ("=3", "--set =3: write it as key=value"),
        ("learnrate=3", "--set learnrate=3: unknown key 'learnrate'"),
        ("learning_rate=fast", "--set learning_rate=fast: Task-v0.learning_rate: expected a number"),
        ("gamma.x=1", "--set gamma.x=1: gamma holds a value, not keys"),
        ("net_arch=[1", "--set net_arch=\\[1:1: not valid YAML"),
    ],
)
def test_wrong_override_is_named(load, override, says):
    with pytest.raises(config.ConfigError, match=says):
        load(GOOD, [override])


@pytest.mark.parametrize("algo", slow_but([algo for algo in config.ONLINE if algo != "her"], "ppo", "linear"))
def test_every_environment_has_an_entry(algo):
    ids = [spec.id for spec in gym.registry.values() if str(spec.vector_entry_point).startswith("springgym")]
    assert ids, "springgym registered no environment"
    own = config.read_yaml(config.config_path(algo)).value.keys() - {config.DEFAULT}
    for env_id in ids:
        config.load_config(algo, env_id)
        assert {env_id, find(env_id)[0].id} & own, f"{env_id} has the default hyperparameters"


def test_whole_numbers_may_have_an_exponent():
    parse = config.whole(1, 10**6)
    assert parse("1e4") == 10_000
    for wrong in ("1.5", "1e9", "inf", "nan", "-1e2", "x"):
        with pytest.raises(argparse.ArgumentTypeError, match="must be a whole number from 1 to"):
            parse(wrong)
