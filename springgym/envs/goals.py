"""Goals as separate entries of the observation, in the form of Gymnasium-Robotics' ``GoalEnv``.

This allows hindsight experience replay (Andrychowicz et al. 2017, arXiv:1707.01495): the reward is recomputed
afterwards, with achieved goals instead of the desired ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from springgym.checks import TINY, array, instance, number, shown, whole
from springgym.core.compiler.decorators import kernel

__all__ = ["BOUND", "GoalTolerance", "Goals", "bound", "checked_tolerances", "mark_reached"]

BOUND = 100.0
"""Bound to which goals are clipped, in SI units. An achieved goal at or beyond it reaches no goal."""


class GoalTolerance(NamedTuple):
    """Some of the numbers of a goal, with a common tolerance."""

    name: str
    size: int
    """number of values"""
    within: float
    """the goal is reached if their distance from those that are desired is smaller than this, in SI units"""


def checked_tolerances(called: str, given: object) -> tuple[GoalTolerance, ...]:
    """Return tolerances, which a spec holds as lists, after checking them; errors use the name ``called``."""
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise TypeError(
            f"{called} is {shown(given)}; it must be a sequence of GoalTolerance(name, size, within)"
        )
    tolerances = []
    for n, each in enumerate(given):
        if not isinstance(each, (tuple, list)) or len(each) != 3:
            raise TypeError(f"{called}[{n}] is {shown(each)}; it must be a GoalTolerance(name, size, within)")
        name, size, within = each
        size = whole(f"{called}[{n}].size", size, 1)
        within = number(f"{called}[{n}].within", within, TINY)
        tolerances.append(GoalTolerance(instance(f"{called}[{n}].name", name, str), size, within))
    return tuple(tolerances)


class Goals:
    """The goals of a task: the K numbers of all tolerances, one after another. Instances are immutable.

    Raises
    ------
    TypeError, ValueError
        If a tolerance is none, or one of its fields has the wrong type or value; the message names it.
    """

    def __init__(self, tolerances: Sequence[GoalTolerance]) -> None:
        checked = checked_tolerances("tolerances", tolerances)
        self.size = sum(own.size for own in checked)
        self.ends = np.cumsum([own.size for own in checked])
        self.within = np.array([own.within for own in checked])

    def space(self, observation: spaces.Box) -> spaces.Dict:
        """Return the space of observations with goals, given that of the other observations."""
        instance("observation", observation, spaces.Box)
        goal = spaces.Box(-BOUND, BOUND, (self.size,), np.float64)
        return spaces.Dict({"observation": observation, "achieved_goal": goal, "desired_goal": goal})

    def compute_reward(self, achieved_goal: object, desired_goal: object, info: object) -> Any:
        """Return the sparse reward of a step from its achieved and desired goal.

        Parameters
        ----------
        achieved_goal, desired_goal : (K,) or (n, K)
            Goals as in observations.
        info
            Not used.

        Returns
        -------
        float or (n,)
            1 if the goal is reached, otherwise 0.

        Raises
        ------
        TypeError, ValueError
            If goals have other shapes, different shapes, or values that are not finite.
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
        mark_reached(*rows, self.ends, self.within, reward)
        return reward if achieved.ndim > 1 else float(reward[0])


@kernel
def mark_reached(
    achieved: np.ndarray, desired: np.ndarray, ends: np.ndarray, within: np.ndarray, met: np.ndarray
) -> None:
    """Set ``met`` (n,) to 1 where goals (n, K) are within all tolerances, and to 0 elsewhere."""
    for c in range(achieved.shape[0]):
        met[c] = 1.0
        first = 0
        for n in range(ends.size):
            total = 0.0
            for k in range(first, ends[n]):
                total += (achieved[c, k] - desired[c, k]) ** 2
                if not abs(achieved[c, k]) < BOUND:
                    met[c] = 0.0
            if not math.sqrt(total) < within[n]:
                met[c] = 0.0
            first = ends[n]


@kernel
def bound(goals: np.ndarray, diverged: np.ndarray) -> None:
    """Clip goals to ±`BOUND`, and set those of diverged copies to `BOUND`."""
    for c in range(goals.shape[0]):
        for k in range(goals.shape[1]):
            goals[c, k] = BOUND if diverged[c] else min(max(goals[c, k], -BOUND), BOUND)
