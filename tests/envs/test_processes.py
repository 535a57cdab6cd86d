"""Environments inside worker processes, also of a parent whose threads have run."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.vec_env import SubprocVecEnv

import springgym  # noqa: F401
from tests.envs.cases import make, make_vec
from tests.params import slow_but


@pytest.fixture
def stepped_parent() -> None:
    """Run the parent's helper threads: a child forked now must not wait for them."""
    envs = make_vec("SpringTop-v0", 64, "native", "SameStep", threads=2)
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())


def expected(steps: int) -> list[np.ndarray]:
    env = make("SpringTop-v0")
    observation, _ = env.reset(seed=3)
    life = [observation]
    for _ in range(steps):
        life.append(env.step(np.zeros(3, np.float32))[0])
    return life


# Forking with threads about is what is tested; Python ≥ 3.12 warns of it.
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.usefixtures("stepped_parent")
@pytest.mark.parametrize("how", slow_but(["fork", "spawn", "sb3"], "fork", "sb3"))
def test_environments_in_subprocesses(how: str) -> None:
    """Of Gymnasium and of Stable-Baselines3."""
    makers = [lambda: gym.make("springgym:SpringTop-v0")] * 2
    if how == "sb3":
        envs: Any = SubprocVecEnv(makers, start_method="fork")
        envs.seed(3)
        seen = [envs.reset()[0]]
    else:
        envs = gym.vector.AsyncVectorEnv(makers, context=how)
        seen = [envs.reset(seed=[3, 4])[0][0]]
    for _ in range(5):
        seen.append(envs.step(np.zeros((2, 3), np.float32))[0][0])
    envs.close()
    np.testing.assert_array_equal(seen, expected(5))


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.usefixtures("stepped_parent")
def test_native_batch_in_a_forked_child() -> None:
    """A child that steps a threaded batch of its own gets the same results as its parent."""
    from multiprocessing import get_context

    def work(pipe: object) -> None:
        pipe.send(run())  # type: ignore[attr-defined]

    def run() -> np.ndarray:
        envs = make_vec("SpringTop-v0", 64, "native", "SameStep", threads=2)
        envs.reset(seed=0)
        return envs.step(np.zeros((64, 3), np.float32))[0]

    here, there = get_context("fork").Pipe()
    child = get_context("fork").Process(target=work, args=(there,))
    child.start()
    assert here.poll(60), "the child hangs"
    np.testing.assert_array_equal(here.recv(), run())
    child.join(10)
    assert child.exitcode == 0
