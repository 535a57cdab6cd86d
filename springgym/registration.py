"""The one table of environments."""

from __future__ import annotations

from typing import NamedTuple

import gymnasium as gym


class Row(NamedTuple):
    """An environment: its id, its module and class in `springgym.envs`, its episodes."""

    id: str
    module: str
    name: str
    max_episode_steps: int
    reward_threshold: float
    """return of an episode at which the task counts as solved"""


ENVIRONMENTS = (
    Row("SpringTop-v0", "top", "SpringTop", 500, 400.0),
    Row("SpringGyroscope-v0", "gyroscope", "SpringGyroscope", 400, 300.0),
    Row("SpringPendulum-v0", "pendulum", "SpringPendulum", 250, 150.0),
    Row("SpringDetumble-v0", "detumble", "SpringDetumble", 300, 195.0),
    Row("SpringRope-v0", "rope", "SpringRope", 200, 140.0),
    Row("SpringTumble-v0", "tumble", "SpringTumble", 250, 185.0),
    Row("SpringFreeTop-v0", "free_top", "SpringFreeTop", 500, 450.0),
)


def register() -> None:
    """Register all environments with Gymnasium; those that are registered already stay."""
    for row in ENVIRONMENTS:
        if row.id not in gym.registry:
            gym.register(
                row.id,
                entry_point=f"springgym.envs.{row.module}:{row.name}Env",
                vector_entry_point=f"springgym.envs.{row.module}:{row.name}VectorEnv",
                max_episode_steps=row.max_episode_steps,
                reward_threshold=row.reward_threshold,
            )
