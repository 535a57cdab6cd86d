"""Environments with their observations, actions and dynamics, read from the registry."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from itertools import cycle
from typing import Any

import gymnasium as gym
import pytest

from springgym.envs.registration import ENVIRONMENTS, find
from springgym.envs.task import Task
from tests.params import slow_unless

IDS = [row.id for row in ENVIRONMENTS]


def task_type(env_id: str) -> type[Task]:
    row, _ = find(env_id)  # type: ignore[misc]
    return getattr(import_module(f"springgym.envs.tasks.{row.module}"), row.name)


FLOPPY = [env_id for env_id in IDS if any(p.body.floppy for p in task_type(env_id)().scene.bodies)]
"""Those whose body is meant to change shape."""

COLLIDING = [env_id for env_id in IDS if task_type(env_id)().scene.meetings]
"""Those whose bodies collide."""

TWINLESS = [*FLOPPY, *COLLIDING]
"""They have no rigid twin, or one whose kernel takes a minute to compile: a slow test plays it."""

DUEL = "SpringDuel-v0"
"""Its bowl takes a kernel of its own: slow runs play it."""

QUICK = ("SpringTop-v0", "SpringTumble-v0")
"""Of these, on a pin and among surfaces, what takes kernels of its own is tested always."""

KINDS = (*QUICK, "SpringShove-v0")
"""One on a pin, one among surfaces, one of bodies that collide: code that all environments share is
tested with these three, and what a task owes by lines of its own with the others in slow runs."""


def _cases(env_id: str) -> list[tuple[str, dict[str, str]]]:
    """Each observation and each action of an environment at least once, and its rigid twin once."""
    task = task_type(env_id)
    count = max(len(task.observations), len(task.actions))
    pairs = list(zip(cycle(task.observations), cycle(task.actions), range(count), strict=False))
    springs = [(env_id, {"observation": seen, "action": action}) for seen, action, _ in pairs]
    return [*springs, *([] if env_id in TWINLESS else [(env_id, springs[0][1] | {"dynamics": "rigid"})])]


CASES = [case for env_id in IDS for case in _cases(env_id)]
"""All environments, each with all of its observations and actions, though not with all pairs of them."""


def _parametrized(cases: Iterable[tuple[str, dict[str, str]]]) -> pytest.MarkDecorator:
    params = [
        pytest.param(*case, id="-".join((case[0], *case[1].values())), marks=slow_unless(case[0] != DUEL))
        for case in cases
    ]
    return pytest.mark.parametrize(("env_id", "options"), params)


def _first(env_id: str) -> tuple[str, dict[str, str]]:
    return next(case for case in CASES if case[0] == env_id)


each_case = _parametrized(CASES)
"""Run a test on all `CASES`."""

first_case = _parametrized(
    [*map(_first, IDS), *(case for case in CASES if case[0] in QUICK and "dynamics" in case[1])]
)
"""Run a test on the first observation and action of each environment, and on the rigid twins of `QUICK`."""

case_of_each_kind = _parametrized(
    case
    for case in CASES
    if case in map(_first, KINDS) or (case[0] == KINDS[0] and "dynamics" not in case[1])
)
"""Run a test on the first case of each of `KINDS`, and on the first kind's other observation and action."""


def each_with(name: str, values: Iterable[Any], usual: tuple[str, ...] = KINDS) -> pytest.MarkDecorator:
    """Run a test once on each environment, with the values of another parameter in turn.

    Always on the ``usual`` ones, on the others in slow runs.
    """
    pairs = zip([*KINDS, *(env_id for env_id in IDS if env_id not in KINDS)], cycle(values), strict=False)
    params = [pytest.param(*pair, marks=slow_unless(pair[0] in usual)) for pair in pairs]
    return pytest.mark.parametrize(("env_id", name), params)


each_id = pytest.mark.parametrize("env_id", IDS)
"""Run a test always on every environment: for what is an environment's own, and takes no time."""

each_task = pytest.mark.parametrize(
    "env_id", [pytest.param(env_id, marks=slow_unless(env_id in KINDS)) for env_id in IDS]
)
"""Run a test always on `KINDS`, and on all others in slow runs: for what is an environment's own."""

each_kind = pytest.mark.parametrize("env_id", KINDS)
"""Run a test on `KINDS` alone: for code that all environments share."""


def make(env_id: str, **options: Any) -> gym.Env:
    return gym.make(env_id, **options)


def started(env_id: str, *, seed: int, options: dict[str, Any] | None = None, **arguments: Any) -> gym.Env:
    """An environment whose first episode has begun."""
    env = make(env_id, **arguments)
    env.reset(seed=seed, options=options)
    return env


def make_vec(env_id: str, num_envs: int, mode: str, autoreset: str, **options: Any) -> gym.vector.VectorEnv:
    """A native batch (mode "native"), or Gymnasium's own loop over single environments ("sync")."""
    if mode == "native":
        return gym.make_vec(
            env_id,
            num_envs=num_envs,
            vectorization_mode="vector_entry_point",
            autoreset_mode=autoreset,
            **options,
        )
    return gym.make_vec(
        env_id,
        num_envs=num_envs,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": autoreset},
        **options,
    )


def hindsight_learner(env: Any, starts: int, batch: int) -> Any:
    """Return SAC with hindsight experience replay and a small network; it learns after ``starts`` steps."""
    from stable_baselines3 import SAC, HerReplayBuffer

    return SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4},
        learning_starts=starts,
        batch_size=batch,
        policy_kwargs={"net_arch": [8]},
        device="cpu",
        seed=0,
    )
