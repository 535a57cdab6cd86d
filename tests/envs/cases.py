"""Every environment × observation × action × dynamics, read from the registry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

import gymnasium as gym
import pytest

from springgym.dynamics import DYNAMICS
from springgym.envs.task import Task
from springgym.registration import ENVIRONMENTS, find

IDS = [row.id for row in ENVIRONMENTS]


def task_type(env_id: str) -> type[Task]:
    row, _ = find(env_id)  # type: ignore[misc]
    return getattr(import_module(f"springgym.envs.{row.module}"), row.name)


FLOPPY = [env_id for env_id in IDS if any(p.body.floppy for p in task_type(env_id)().scene.bodies)]
"""Those whose body is meant to change shape."""

COLLIDING = [env_id for env_id in IDS if task_type(env_id)().scene.meetings]
"""Those whose bodies collide."""

TWINLESS = [*FLOPPY, *COLLIDING]
"""They have no rigid twin, or one whose kernel takes a minute to compile: a slow test plays it."""

CASES = [
    (env_id, {"observation": observation, "action": action, "dynamics": dynamics})
    for env_id in IDS
    for observation in task_type(env_id).observations
    for action in task_type(env_id).actions
    for dynamics in DYNAMICS
    if dynamics == "springs" or env_id not in TWINLESS
]


QUICK = ("SpringTop-v0", "SpringTumble-v0")
"""Of these, on a pin and among surfaces, what takes kernels of its own is tested always."""

KINDS = (*QUICK, "SpringShove-v0")
"""One on a pin, one among surfaces, one of bodies that collide: what every environment owes by the same lines
of code is always tested of these, and of all others in slow runs."""


def _slow_unless(usual: bool) -> Any:
    return () if usual else pytest.mark.slow


def few_ids(usual: Sequence[str], ids: Sequence[str] = IDS) -> list[Any]:
    """Return parameters of a test: environments, all but the ``usual`` ones left to slow runs."""
    return [pytest.param(env_id, marks=_slow_unless(env_id in usual)) for env_id in ids]


def few_cases(usual: Callable[[str, dict[str, str]], bool]) -> pytest.MarkDecorator:
    """Run a test on every case, all but the ``usual`` ones left to slow runs."""
    params = [
        pytest.param(
            env_id,
            options,
            marks=_slow_unless(usual(env_id, options)),
            id="-".join((env_id, *options.values())),
        )
        for env_id, options in CASES
    ]
    return pytest.mark.parametrize(("env_id", "options"), params)


def _first_of(dynamics: str, env_id: str) -> dict[str, str] | None:
    """Return the first case of an environment with these dynamics."""
    return next((own for of, own in CASES if of == env_id and own["dynamics"] == dynamics), None)


each_case = few_cases(
    lambda env_id, options: (
        env_id in KINDS
        and options["dynamics"] == "springs"
        and (env_id == KINDS[0] or options["action"] == next(iter(task_type(env_id).actions)))
    )
)
"""Run a test always on the cases of `KINDS` with springs and, but for the first of `KINDS`, with their first
action; on all other cases, which take kernels of their own, in slow runs."""

first_case = few_cases(
    lambda env_id, options: (
        options in ([_first_of("springs", env_id)] + [_first_of("rigid", env_id)] * (env_id in QUICK))
    )
)
"""Run a test always on each environment's first observation and action, and on the rigid twins of `QUICK`; on
all other cases in slow runs."""

each_id = pytest.mark.parametrize("env_id", IDS)
"""Run a test always on every environment: for what is an environment's own, and takes no time."""

each_kind = pytest.mark.parametrize("env_id", few_ids(KINDS))
"""Run a test always on `KINDS`, and on all other environments in slow runs."""


def make(env_id: str, **options: Any) -> gym.Env:
    return gym.make(env_id, **options)


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
