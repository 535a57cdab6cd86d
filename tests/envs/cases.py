"""Every environment × observation × action, read from the registry."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import gymnasium as gym

from springgym.envs.task import Task
from springgym.registration import ENVIRONMENTS

IDS = [row.id for row in ENVIRONMENTS]


def task_type(env_id: str) -> type[Task]:
    row = next(row for row in ENVIRONMENTS if row.id == env_id)
    return getattr(import_module(f"springgym.envs.{row.module}"), row.name)


CASES = [
    (row.id, {"observation": observation, "action": action})
    for row in ENVIRONMENTS
    for observation in task_type(row.id).observations
    for action in task_type(row.id).actions
]
NAMES = [f"{env_id}-{'-'.join(options.values())}" for env_id, options in CASES]


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
