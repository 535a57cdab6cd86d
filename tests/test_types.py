"""Type checkers know the public names and arguments that the package accepts, and no others."""

import inspect
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

import springgym
from springgym.envs import options
from springgym.envs.base import Common, SpringEnv
from springgym.envs.registration import ENVIRONMENTS
from springgym.envs.scene import SceneOptions, SceneTask, make_scene_env
from springgym.envs.tasks.duel import OPPONENTS
from tests.envs.cases import IDS, task_type

ROOT = Path(__file__).parent.parent


def keywords(function):
    kinds = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return {p.name for p in inspect.signature(function).parameters.values() if p.kind in kinds} - {"self"}


def test_every_environment_declares_what_it_takes():
    common = keywords(SpringEnv.__init__) | keywords(Common._make) - {"copies"} | keywords(options.Settings)
    assert set(get_type_hints(options.EnvOptions)) == common | {"observation"}
    for row in ENVIRONMENTS:
        module = import_module(f"springgym.envs.tasks.{row.module}")
        task = task_type(row.id)
        declared = get_type_hints(getattr(module, f"{row.name.removeprefix('Spring')}Options"))
        taken = get_type_hints(task.__init__)
        del taken["return"], taken["modes"]
        assert get_args(declared.pop("action")) == tuple(task.actions), row.id
        assert declared == get_type_hints(options.EnvOptions) | taken, row.id
        assert set(inspect.signature(task).parameters) == {"observation", "action", *taken}
        assert set(task.observations) <= set(get_args(declared["observation"]))


def test_the_choices_declared_are_those_there_are():
    for env_id in IDS:
        task = task_type(env_id)
        hints = get_type_hints(task.__init__)
        for name, hint in hints.items():
            for choice in get_args(hint) if name in ("start", "surface") else ():
                task(**{name: choice})
    opponents, _ = get_args(get_type_hints(task_type("SpringDuel-v0").__init__)["opponent"])
    assert get_args(opponents) == tuple(OPPONENTS)


def test_an_environment_over_a_scene_declares_what_it_takes():
    given = keywords(make_scene_env)
    assert {"scene", "reward", "actuators"} <= given
    own = keywords(SceneTask.__init__) - given
    assert set(get_type_hints(SceneOptions)) == own | {"goals"} | set(get_type_hints(options.RewardedOptions))


CLIENT = """
from gymnasium import spaces

import springgym
from springgym.envs import parallel
from springgym.envs.tasks.top import SpringTopEnv, SpringTopVectorEnv

env = SpringTopEnv(action="impulse", render_mode="rgb_array", step=1e-4, body={"height": 1.0})
envs = SpringTopVectorEnv(4, autoreset_mode="SameStep", observation="features", max_episode_steps=10)
box: spaces.Box = env.action_space
boxes: tuple[spaces.Box, spaces.Box] = envs.single_action_space, envs.observation_space
print(env.action_space.low, envs.action_space.high, springgym.get_state(env))
duel = parallel("SpringDuel-v0", observation="features")
print(duel.action_space("first").low)
SpringTopEnv(observation="wrong")  # type: ignore[arg-type]
SpringTopEnv(hard="yes")  # type: ignore[arg-type]
SpringTopVectorEnv(2, autoreset_mode="never")  # type: ignore[arg-type]
parallel("SpringDuel-v0", opponent="script")  # type: ignore[call-arg]
springgym.nonsense  # type: ignore[attr-defined]
scene = springgym.Scene("top")  # type: ignore[arg-type]
one = springgym.make_scene_env(scene, print, actuators={"force": 1.0})  # type: ignore[arg-type]
more = springgym.make_scene_env(scene, lambda m, s: s.action[:, 0], actuators={}, num_envs=3, hold_steps=2)
print(more.num_envs, more.single_action_space.low)
springgym.make_scene_env(scene, lambda m, s: s.v, actuators={}, odd=1)  # type: ignore[call-overload]
"""
"""Each line without a comment is right; each with one is wrong, and one that were not would be told."""


@pytest.mark.slow  # half a minute
def test_a_type_checker_knows_the_package(tmp_path):
    pytest.importorskip("mypy")
    lines = [CLIENT]
    for name in springgym.__all__:  # what is Any would pass
        lines.append(f"_{name}: int = springgym.{name}  # type: ignore[assignment]")
    for row in ENVIRONMENTS:
        lines.append(f"from springgym.envs.tasks.{row.module} import {row.name}Env")
        lines.append(f"{row.name}Env(nonsense=1)  # type: ignore[call-arg]")
    client = tmp_path / "client.py"
    client.write_text("\n".join(lines) + "\n")
    checked = subprocess.run(
        [
            *(sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml")),
            *("--cache-dir", str(tmp_path / "cache"), str(client)),
        ],
        capture_output=True,
        text=True,
        env=os.environ | {"MYPYPATH": str(ROOT)},
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr
