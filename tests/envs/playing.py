"""Episodes of a policy, one in each copy of a native batch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from tests.envs.cases import make_vec, task_type

Policy = Callable[[np.ndarray], np.ndarray]


class Played(NamedTuple):
    """How the episodes went."""

    returns: np.ndarray
    """(copies,) sum of rewards over the time limit"""
    successes: np.ndarray
    """(copies,) bool"""
    lengths: np.ndarray
    """(copies,) steps"""
    largest: dict[str, np.ndarray]
    """(copies,) largest size of each of the task's metrics"""


def play(
    env_id: str, policy: Policy, copies: int, options: dict[str, Any] | None = None, **arguments: Any
) -> Played:
    """One episode in each copy, the first seeds that no agent is trained on; ``options`` are the reset's."""
    envs = make_vec(env_id, copies, "native", "SameStep", **arguments)
    observation, _ = envs.reset(seed=1_000_000, options=options)
    limit = envs.unwrapped.episodes.max_episode_steps
    returns = np.zeros(copies)
    lengths = np.zeros(copies, int)
    running = np.ones(copies, bool)
    successes = np.zeros(copies, bool)
    largest = {name: np.zeros(copies) for name in task_type(env_id).metrics}
    while running.any():
        observation, reward, terminated, truncated, info = envs.step(policy(observation))
        returns += reward * running
        lengths += running
        ended = (terminated | truncated) & running
        for name, most in largest.items():
            for report, of in ((info, running & ~ended), (info.get("final_info", {}), ended)):
                if of.any():
                    most[of] = np.maximum(most, np.abs(report[name]))[of]
        if ended.any():
            successes[ended] = info["final_info"]["is_success"][ended]
        running &= ~ended
    return Played(returns / limit, successes, lengths, largest)
