"""Environment steps: single, in batches, through Stable-Baselines3, and collected by its PPO."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from math import ceil
from typing import TYPE_CHECKING, Any

import gymnasium as gym

from benchmarks.peers import has
from benchmarks.steady import RandomPlay, adapted, fractions, limit_of, native, single, synchronous
from benchmarks.timing import Case, Row, measured
from springgym.envs.registration import ENVIRONMENTS

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

COLLECTED = 32
"""Steps of each copy in a rollout of PPO's."""


def environments(rounds: int) -> list[Row]:
    """Environment steps a second in steady play: random actions, resets included.

    Before anything counts, the copies have played for a time limit, from clocks at different fractions of it
    (`benchmarks.steady`). One step is ``substeps`` steps of the integrator. "compiled alone" is the control
    period without the environment around it. "PPO collects" is a rollout by Stable-Baselines3: policy,
    environments and buffer, without learning. No error is stated here: the section `errors` has it.
    """
    with ExitStack() as stack:
        cases = [case for row in ENVIRONMENTS for case in cases_of(row.id, stack)]
        return measured(cases, rounds, "env steps/s", seconds=0.1)


def cases_of(env_id: str, stack: ExitStack, most: int = 1024, **options: Any) -> Iterator[Case]:
    """Yield the measurements of an environment; the stack closes what has to be closed.

    ``most`` is the number of copies of the large batch; ``options`` are those of the environment.
    """
    env = gym.make(env_id, **options)
    episodes = env.unwrapped.episodes  # type: ignore[attr-defined]
    facts = {"substeps": episodes.steps * episodes.task.periods}

    def case(how: str, play: RandomPlay, copies: int = 1, **what: int) -> Case:
        many = {"copies": copies} if copies > 1 else {}
        named = {"environment": env_id, "how": how} | many | what
        return Case(named, play.run, play.shape[0] * copies, play.begin, facts)

    top = env_id == "SpringTop-v0"
    yield case("single", single(env_id, **options))
    if top:
        yield compiled_alone(env_id, 1, facts, options)
    yield case("SyncVectorEnv", synchronous(env_id, 64, **options), 64)
    for copies in (64, most):
        for threads in (1, 2) if top else (1,):
            play = native(env_id, copies, threads=threads, **options)
            yield case("native", play, copies, threads=threads)
        if top:
            yield compiled_alone(env_id, copies, facts, options)
    if top:  # the most there is
        for threads in (1, 2):
            play = native(env_id, 4 * most, threads=threads, dtype="float32", **options)
            yield case("native, float32", play, 4 * most, threads=threads)
    if not has("stable_baselines3"):
        return
    yield case("SB3 adapter", adapted(env_id, 64, **options), 64)
    if top:
        from stable_baselines3.common.env_util import make_vec_env
        from stable_baselines3.common.vec_env import SubprocVecEnv

        from springgym.envs.sb3 import make_sb3

        given = {"env_id": env_id, **options}
        adapter = make_sb3(env_id, 64, 0, stagger=True, env_kwargs=options)
        looped = make_vec_env(_made, 64, seed=0, env_kwargs=given)
        processes = make_vec_env(_made, 8, seed=0, env_kwargs=given, vec_env_cls=SubprocVecEnv)
        stack.callback(processes.close)
        for name, envs in (("adapter", adapter), ("DummyVecEnv", looped), ("SubprocVecEnv", processes)):
            what = {"environment": env_id, "how": f"PPO collects, {name}", "copies": envs.num_envs}
            run = collecting(envs, limit_of(env))
            yield Case(what, run, envs.num_envs * COLLECTED, facts=facts)


def _made(env_id: str, **options: Any) -> gym.Env[Any, Any]:
    """Make an environment, also in another process, which finds it by importing this module."""
    return gym.make(env_id, **options)


def compiled_alone(env_id: str, copies: int, facts: Mapping[str, Any], options: Mapping[str, Any]) -> Case:
    """Return 2 control periods of the simulator of an environment in steady play, with what is read off then.

    Each run begins from the same state.
    """
    episodes = native(env_id, copies, **options).envs.episodes
    simulator = episodes.simulator
    steps = episodes.steps
    began = simulator.state()

    def run() -> None:
        for _ in range(2):
            simulator.advance(steps, check=False, read=True)

    what = {"environment": env_id, "how": "compiled alone", "copies": copies}
    return Case(what, run, 2 * copies, lambda: simulator.restore(began), facts)


def collecting(envs: VecEnv, limit: int) -> Callable[[], object]:
    """Return a rollout of Stable-Baselines3's PPO: policy, environments and buffer, without learning.

    The environments are in steady play, by the actions of the policy; ``limit`` is their time limit [steps].
    """
    import torch
    from stable_baselines3 import PPO

    from springgym.envs.sb3 import StaggeredMonitor

    torch.set_num_threads(1)  # the policy is small: threads cost more than they bring
    learner = PPO("MlpPolicy", envs, n_steps=COLLECTED, device="cpu", seed=0)
    _, callback = learner._setup_learn(total_timesteps=10**9)
    if not isinstance(envs, StaggeredMonitor):
        for n, elapsed in enumerate(fractions(limit, envs.num_envs).tolist()):
            envs.env_method("set_wrapper_attr", "_elapsed_steps", elapsed, indices=n)

    def run() -> object:
        return learner.collect_rollouts(envs, callback, learner.rollout_buffer, COLLECTED)

    for _ in range(ceil(limit / COLLECTED)):
        run()
    return run
