"""What libraries that use Gymnasium's environments rely on."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode

import springgym
from springgym.envs.base import frame_rate
from springgym.envs.task import Task
from tests.envs.cases import IDS, QUICK, each_kind, make, make_vec, started, task_type
from tests.envs.test_contract import answered


def ranges(env_id: str) -> dict[str, Any]:
    """Of all factors, as numbers of many kinds; elsewhere than in `QUICK`, of one that compiles nothing."""
    actuator = {"actuator": (np.float32(0.5), 1)}
    return answered(env_id) | {"masses": np.array([0.9, 1.1])} | actuator if env_id in QUICK else actuator


@each_kind
def test_films_play_in_real_time(env_id: str) -> None:
    """The class says how many pictures a second there are, too, for who asks before making one."""
    rate = frame_rate(task_type(env_id))
    env = started(env_id, render_mode="rgb_array", seed=0)
    env.render()
    for metadata in (
        env.metadata,
        type(env.unwrapped).metadata,
        make_vec(env_id, 2, "native", "NextStep").metadata,
    ):
        assert metadata["render_fps"] == rate
    assert env.unwrapped._canvases[0].fps == rate


def test_frame_rates() -> None:
    class Slow(Task):
        period = 0.03

    for kind in map(task_type, IDS):
        assert frame_rate(kind) * kind.period == pytest.approx(1.0, rel=1e-12)
    assert [frame_rate(task_type(own)) for own in ("SpringPendulum-v0", "SpringRope-v0")] == [25, 20]
    assert frame_rate(Slow) == pytest.approx(33.3333, abs=1e-4)
    assert type(frame_rate(task_type(IDS[0]))) is int


@each_kind
@pytest.mark.parametrize("suffix", ["Env", "VectorEnv"])
def test_gymnasiums_class_is_a_direct_base(env_id: str, suffix: str) -> None:
    """Some libraries look no further than the bases of a class to tell whose environment it is."""
    made = make(env_id) if suffix == "Env" else make_vec(env_id, 2, "native", "NextStep")
    kind = type(made.unwrapped)
    assert kind.__name__.endswith(suffix)
    assert {"Env": gym.Env, "VectorEnv": gym.vector.VectorEnv}[suffix] in kind.__bases__


@each_kind
@pytest.mark.parametrize("randomised", [False, True])
def test_info_has_the_same_keys_after_a_reset_and_a_step(env_id: str, randomised: bool) -> None:
    varied = ranges(env_id) if randomised else None
    env = make(env_id, randomize=varied)
    _, first = env.reset(seed=0)
    *_, later = env.step(env.action_space.sample())
    assert list(first) == list(later)
    assert {type(value) for value in first.values()} <= {bool, float, dict}
    assert all(first[f"reward_{name}"] == 0 for name in task_type(env_id).terms)
    envs = make_vec(env_id, 2, "native", "NextStep", randomize=varied)
    _, first = envs.reset(seed=0)
    assert list(first) == list(envs.step(envs.action_space.sample())[-1])


@pytest.mark.parametrize("env_id", ["SpringTop-v0", "SpringLabyrinth-v0", "SpringShove-v0"])
def test_metrics_of_the_start(env_id: str) -> None:
    """They are those of the first observation: a control period changes them little, another start much."""
    env = make(env_id)
    starts = []
    steps = []
    for seed in range(8):
        _, first = env.reset(seed=seed)
        *_, later = env.step(np.zeros(env.action_space.shape, np.float32))
        starts.append([first[name] for name in task_type(env_id).metrics])
        steps.append([later[name] for name in task_type(env_id).metrics])
    change = np.abs(np.subtract(starts, steps)).max(axis=0)
    spread = np.maximum(np.ptp(starts, axis=0), np.abs(starts).max(axis=0))
    assert (spread[0] > 0.05) & (change[0] < 0.3 * spread[0])


ARGUMENTS: dict[str, dict[str, Any]] = {
    env_id: {"dtype": np.float64, "randomize": ranges(env_id), "observation": "features"} for env_id in IDS
}
ARGUMENTS["SpringTop-v0"] |= {"body": {"scaled": {0: np.float64(1.1)}}, "hard": True}


def through_json(env_id: str) -> Iterator[tuple[Any, Any]]:
    """An environment and a batch, each with what is made of its spec as text."""
    for made in (
        make(env_id, **ARGUMENTS[env_id]),
        gym.make_vec(
            env_id,
            num_envs=2,
            vectorization_mode="vector_entry_point",
            autoreset_mode=AutoresetMode.SAME_STEP,
            **ARGUMENTS[env_id],
        ),
    ):
        spec = EnvSpec.from_json(made.spec.to_json())
        assert spec == made.spec
        again = gym.make(spec) if isinstance(made, gym.Env) else gym.make_vec(spec)
        assert again.spec == spec
        yield made, again


@each_kind
def test_what_is_made_of_a_spec_lives_the_same_life(env_id: str) -> None:
    """Specs survive JSON, whatever types the arguments were of."""
    for made, again in through_json(env_id):
        action = made.action_space.sample()
        for env in (made, again):
            env.reset(seed=4)
        np.testing.assert_array_equal(made.step(action)[0], again.step(action)[0])


def test_specs_hold_plain_data() -> None:
    env = make(IDS[0], dtype=np.float64, body={"scaled": {0: 1.1}})
    assert env.spec.kwargs == {"dtype": "float64", "body": {"scaled": {"0": 1.1}}}
    assert json.loads(json.dumps(env.spec.kwargs)) == env.spec.kwargs
    assert make(IDS[0], dtype="float64", randomize={"masses": (1, 2)}).spec.kwargs["randomize"] == {
        "masses": [1, 2]
    }


def test_generators_of_a_batch() -> None:
    """Readable before the first reset, true after it, and assignable, as those of Gymnasium's own are."""
    envs, sync = (make_vec(IDS[0], 3, mode, "SameStep") for mode in ("native", "sync"))
    assert len(set(envs.np_random_seed)) == len(envs.np_random) == 3
    unseeded = envs.np_random_seed
    first, _ = envs.reset()
    again, _ = envs.reset(seed=unseeded)
    np.testing.assert_array_equal(first, again)
    for made in (envs, sync):
        made.reset(seed=7)
        assert made.np_random_seed == (7, 8, 9)
    mask = np.array([False, True, False])
    envs.reset(seed=[None, 20, None], options={"reset_mask": mask})
    assert envs.np_random_seed == (7, 20, 9)
    own = np.random.default_rng(0).spawn(3)
    expected = [np.random.Generator(type(g.bit_generator)()) for g in own]
    for generator, twin in zip(own, expected, strict=True):
        twin.bit_generator.state = generator.bit_generator.state
    gym.wrappers.vector.ClipReward(envs, 0, 1).np_random = own
    assert envs.np_random == tuple(own)
    assert envs.np_random_seed == (-1, -1, -1)
    drawn, _ = envs.reset()
    envs.np_random = expected
    np.testing.assert_array_equal(envs.reset()[0], drawn)


@pytest.mark.parametrize("wrong", [None, 3, [], [np.random.default_rng(0)] * 3, [np.random.default_rng(0)]])
def test_generators_that_are_none_are_refused(wrong: Any) -> None:
    envs = make_vec(IDS[0], 3, "native", "SameStep")
    envs.reset(seed=1)
    with pytest.raises(ValueError, match="np_random must be 3 different random generators"):
        envs.np_random = wrong
    assert envs.np_random_seed == (1, 2, 3)


BASE_ONLY = """
import sys
EXTRAS = "scipy matplotlib pygame PIL imageio moviepy stable_baselines3 torch trimesh".split()
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in EXTRAS:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
import gymnasium as gym, numpy as np, springgym
from springgym.model.bodies import cube
from springgym.model.scene import Scene
env = springgym.make_scene_env(Scene(cube()), lambda m, s: m.centre[:, 2], actuators={"force": 20.0})
env.reset(seed=0)
env.step(np.ones(3, np.float32))
env.unwrapped.episodes.task.look()
springgym.make_scene_env("top", lambda m, s: m.centre[:, 2], actuators={"force": 20.0})
"""


@pytest.mark.slow
def test_scene_environments_need_the_base_install_alone() -> None:
    done = subprocess.run([sys.executable, "-c", BASE_ONLY], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def test_public_names() -> None:
    for name in springgym.__all__:
        assert getattr(springgym, name).__module__.startswith("springgym")
