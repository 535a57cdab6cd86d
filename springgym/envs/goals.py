"""Goals as separate entries of the observation, in the form of Gymnasium-Robotics' ``GoalEnv``.

An agent can then learn from goals that it reached by chance (Andrychowicz et al. 2017, *Hindsight experience
replay*, arXiv:1707.01495): whether what it achieved is what another goal asks for is computed afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from springgym.checks import array
from springgym.core.compiling import kernel

FARTHEST = 100.0
"""Bound to which goals are clipped, in SI units. What is achieved there, or beyond, reaches no goal."""


class Aim(NamedTuple):
    """Some numbers of a goal, which are reached together."""

    name: str
    size: int
    """how many numbers"""
    within: float
    """the goal is reached if their distance from those that are desired is smaller than this, in SI units"""


class Goals:
    """The goals of a task: the K numbers of all its `Aim`, one after another. Instances are immutable."""

    def __init__(self, aims: Sequence[Aim]) -> None:
        self.size = sum(aim.size for aim in aims)
        self.ends = np.cumsum([aim.size for aim in aims])
        self.within = np.array([aim.within for aim in aims])

    def space(self, observation: spaces.Box) -> spaces.Dict:
        """Return the space of observations with goals, given the space of what else is observed."""
        goal = spaces.Box(-FARTHEST, FARTHEST, (self.size,), np.float64)
        return spaces.Dict({"observation": observation, "achieved_goal": goal, "desired_goal": goal})

    def compute_reward(self, achieved_goal: object, desired_goal: object, info: object) -> Any:
        """Return the reward of a step that ends with ``achieved_goal`` where ``desired_goal`` is wanted.

        Parameters
        ----------
        achieved_goal, desired_goal : (K,) or (n, K)
            Goals as observations show them.
        info
            Not used.

        Returns
        -------
        float or (n,)
            1 if the goal is reached, otherwise 0.

        Raises
        ------
        TypeError, ValueError
            If goals have other shapes than these, or than each other, or hold what is not a finite number.
        """
        shapes = (self.size,), (None, self.size)
        achieved = array("achieved_goal", achieved_goal, *shapes)
        desired = array("desired_goal", desired_goal, *shapes)
        if achieved.shape != desired.shape:
            raise ValueError(
                f"desired_goal has shape {desired.shape}; it must be that of achieved_goal, {achieved.shape}"
            )
        reward = np.zeros(achieved.size // self.size)
        rows = (goals.reshape(-1, self.size) for goals in (achieved, desired))
        reach(*rows, self.ends, self.within, reward)
        return reward if achieved.ndim > 1 else float(reward[0])


@kernel
def reach(
    achieved: np.ndarray, desired: np.ndarray, ends: np.ndarray, within: np.ndarray, met: np.ndarray
) -> None:
    """Set ``met`` (n,) to 1 where goals (n, K) are reached in all aims, and to 0 elsewhere."""
    for c in range(achieved.shape[0]):
        met[c] = 1.0
        first = 0
        for n in range(ends.size):
            total = 0.0
            for k in range(first, ends[n]):
                total += (achieved[c, k] - desired[c, k]) ** 2
                if not abs(achieved[c, k]) < FARTHEST:
                    met[c] = 0.0
            if not math.sqrt(total) < within[n]:
                met[c] = 0.0
            first = ends[n]


@kernel
def bound(goals: np.ndarray, diverged: np.ndarray) -> None:
    """Clip goals to ±`FARTHEST`; those of diverged copies are there."""
    for c in range(goals.shape[0]):
        for k in range(goals.shape[1]):
            goals[c, k] = FARTHEST if diverged[c] else min(max(goals[c, k], -FARTHEST), FARTHEST)
