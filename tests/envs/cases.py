"""Every environment × observation × action × dynamics, read from the registry."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
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


def quick_ids(ids: Sequence[str] = IDS) -> list[Any]:
    """Parameters of a test: environments, those that are not quick left to slow runs."""
    return [pytest.param(env_id, marks=() if env_id in QUICK else pytest.mark.slow) for env_id in ids]


def each_case(quick: bool = False) -> pytest.MarkDecorator:
    """Run a test on every case.

    Compiling takes long for rigid twins: they are left to slow runs but, if ``quick``, for the first of each
    of `QUICK`.
    """
    params, twins = [], Counter[str]()
    for env_id, options in CASES:
        marks = ()
        if options["dynamics"] == "rigid":
            marks = () if quick and env_id in QUICK and not twins[env_id] else (pytest.mark.slow,)
            twins[env_id] += 1
        params.append(pytest.param(env_id, options, marks=marks, id="-".join((env_id, *options.values()))))
    return pytest.mark.parametrize(("env_id", "options"), params)


each_id = pytest.mark.parametrize("env_id", IDS)


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
