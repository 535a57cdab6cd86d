"""Environment steps: single, in batches, through Stable-Baselines3, and collected by its PPO."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from itertools import cycle
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from benchmarks.timing import Case, Row, measured
from springgym.registration import ENVIRONMENTS

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

NATIVE = {"vectorization_mode": "vector_entry_point"}
COLLECTED = 32
"""Steps of each copy in a rollout of PPO's."""


def environments(rounds: int) -> list[Row]:
    """Environment steps a second by random actions, resets included.

    One is ``substeps`` steps of the integrator. "compiled alone" is the control period without the
    environment around it. "PPO collects" is a rollout by Stable-Baselines3: policy, environments and buffer,
    without learning. No error is stated here: the section `errors` has it.
    """
    with ExitStack() as stack:
        cases = [case for row in ENVIRONMENTS for case in _cases(row.id, stack)]
        return measured(cases, rounds, "env steps/s")


def _cases(env_id: str, stack: ExitStack) -> Iterator[Case]:
    """Yield the measurements of an environment; the stack closes what has to be closed."""
    episodes = gym.make(env_id).unwrapped.episodes  # type: ignore[attr-defined]
    facts = {"substeps": episodes.steps * episodes.task.periods}

    def case(how: str, run: Callable[[], object], units: int, **what: int) -> Case:
        return Case({"environment": env_id, "how": how} | what, run, units, facts=facts)

    top = env_id == "SpringTop-v0"
    yield case("single", _single(env_id), 20)
    if top:
        yield _compiled_alone(env_id, 1, facts)
    sync = gym.make_vec(env_id, num_envs=64, vectorization_mode="sync")
    sync.reset(seed=0)
    yield case("SyncVectorEnv", _stepping(sync, _actions(sync.action_space)), 128, copies=64)
    for copies in (64, 1024):
        for threads in (1, 2) if top else (1,):
            run = _native(env_id, copies, threads)
            yield case("native", run, 2 * copies, copies=copies, threads=threads)
        if top:
            yield _compiled_alone(env_id, copies, facts)
    if top:  # the most there is
        for threads in (1, 2):
            run = _native(env_id, 4096, threads, dtype="float32")
            what = {"environment": env_id, "how": "native, float32", "copies": 4096, "threads": threads}
            yield Case(what, run, 2 * 4096, facts=facts)
    try:
        from springgym.envs.sb3 import make_sb3
    except ImportError:
        return
    envs = make_sb3(env_id, num_envs=64, seed=0)
    envs.reset()
    yield case("SB3 adapter", _stepping(envs, _actions(envs.action_space, 64)), 128, copies=64)
    if top:
        from stable_baselines3.common.env_util import make_vec_env
        from stable_baselines3.common.vec_env import SubprocVecEnv

        yield case("PPO collects, adapter", _collecting(make_sb3(env_id, 64, 0)), 64 * COLLECTED, copies=64)
        single = {"env_id": env_id}
        looped = make_vec_env(_made, 64, seed=0, env_kwargs=single)
        yield case("PPO collects, DummyVecEnv", _collecting(looped), 64 * COLLECTED, copies=64)
        processes = make_vec_env(_made, 8, seed=0, env_kwargs=single, vec_env_cls=SubprocVecEnv)
        stack.callback(processes.close)
        yield case("PPO collects, SubprocVecEnv", _collecting(processes), 8 * COLLECTED, copies=8)


def _made(env_id: str) -> gym.Env[Any, Any]:
    """Make an environment, also in another process, which finds it by importing this module."""
    return gym.make(env_id)


def _actions(space: Any, copies: int | None = None) -> np.ndarray:
    """20 random actions, of so many copies."""
    shape = space.shape if copies is None else (copies, *space.shape)
    return np.random.default_rng(0).uniform(-1, 1, (20, *shape)).astype(np.float32)


def _single(env_id: str) -> Callable[[], None]:
    """20 steps of an environment as `gymnasium.make` gives it."""
    env = gym.make(env_id)
    env.reset(seed=0)
    actions = _actions(env.action_space)

    def run() -> None:
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    return run


def _native(env_id: str, copies: int, threads: int, **options: object) -> Callable[[], None]:
    """2 steps of a native batch."""
    how: dict[str, Any] = NATIVE | {"threads": threads} | options
    env = gym.make_vec(env_id, num_envs=copies, **how)
    env.reset(seed=0)
    return _stepping(env, _actions(env.action_space))


def _stepping(envs: Any, actions: np.ndarray) -> Callable[[], None]:
    """2 steps of many copies that have been reset, by actions in turn."""
    turn = cycle(actions)

    def run() -> None:
        envs.step(next(turn))
        envs.step(next(turn))

    return run


def _compiled_alone(env_id: str, copies: int, facts: Mapping[str, Any]) -> Case:
    """2 control periods of an environment's simulator from its start, with what is read off then."""
    env: Any = gym.make_vec(env_id, num_envs=copies, **NATIVE)  # type: ignore[arg-type]
    env.reset(seed=0)
    simulator, steps = env.episodes.simulator, env.episodes.steps
    began = simulator.state()

    def run() -> None:
        for _ in range(2):
            simulator.advance(steps, check=False, read=True)

    what = {"environment": env_id, "how": "compiled alone", "copies": copies}
    return Case(what, run, 2 * copies, lambda: simulator.restore(began), facts)


def _collecting(envs: VecEnv) -> Callable[[], object]:
    """Time a rollout of Stable-Baselines3's PPO: policy, environments and buffer, without learning."""
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)  # the policy is small: threads cost more than they bring
    learner = PPO("MlpPolicy", envs, n_steps=COLLECTED, device="cpu", seed=0)
    _, callback = learner._setup_learn(total_timesteps=10**9)
    return lambda: learner.collect_rollouts(envs, callback, learner.rollout_buffer, COLLECTED)
