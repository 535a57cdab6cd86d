"""The choice of method and step for a given error.

A trial runs `EPISODES` episodes of the task for `PERIODS` control periods with random actions. The episodes
have seeds of their own, and factors of randomisation at the ends of their ranges. The result of a trial is
the largest error, as `springgym.envs.error` estimates it. A method of order p has an error C hᵖ, which
suggests the number of steps for the next trial. The chosen method and step were tried, with a largest error
that times `SAFETY` is below the given one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from springgym import checks
from springgym.checks import TINY
from springgym.dynamics.stepping import StepPlan
from springgym.envs.episodes import Episodes, plan_of
from springgym.envs.options import Settings
from springgym.envs.task import Task

__all__ = [
    "CLOSE",
    "FINEST",
    "HIGHER",
    "SAFETY",
    "TRIALS",
    "Choice",
    "chosen_for",
    "fewest_steps",
    "largest_error",
]

EPISODES = 16
PERIODS = 50

SAFETY = 1.5
"""Safety factor between the tolerance and the largest observed error: estimates during impacts are up to a
third too low, and later episodes may be harder than those tried."""

FINEST = 32
"""Largest number of steps that is tried, in units of the default number."""

TRIALS = 8
"""Largest number of trials for a method."""

CLOSE = 1.1
"""The search ends if a sufficient number of steps is at most this factor above an insufficient one."""

HIGHER = ("rk4", "blanes_moan")
"""Methods of higher order. They are tried if the default method needs `PAYS` times its default steps."""

PAYS = 2


class Choice(NamedTuple):
    """How to take steps, and the largest error observed with them."""

    plan: StepPlan
    steps: int
    """number of steps in a control period"""
    error: float
    """largest error, relative to the body's size"""
    cost: int
    """force evaluations in a control period"""


def chosen_for(task: Task, copies: int, tolerance: object, settings: Settings) -> Choice:
    """Return the cheapest method and number of steps of a task whose errors stay below a tolerance.

    Parameters
    ----------
    task, copies
        The task, and the number of copies. Trials use the same number, so that code is compiled once.
    tolerance
        The largest error of a control period, relative to the body's size.
    settings
        The settings of the episodes. If they name no method, the default one and those of `HIGHER` are tried.

    Raises
    ------
    TypeError, ValueError
        If the tolerance is not a positive number, or no step that is tried is fine enough; the message says
        which tolerance is possible.
    """
    wanted = checks.number("tolerance", tolerance, TINY)

    def trial(name: str | None, steps: int | None = None) -> Episodes:
        step = None if steps is None else task.period / steps
        tried = settings._replace(
            integrator=name, sparse=False, goals=False, max_episode_steps=None, error=True
        )
        return Episodes(task, min(copies, EPISODES), tried, plan=plan_of(task, tried, step))

    usual = trial(settings.integrator)
    found = [fewest_steps(wanted, usual, trial)]
    if settings.integrator is None and (
        found[0].error * SAFETY > wanted or found[0].steps > PAYS * usual.steps
    ):
        for name in HIGHER:
            try:
                first = trial(name)
            except ValueError:  # the method does not suit the scene
                continue
            found.append(fewest_steps(wanted, first, trial))
    enough = [choice for choice in found if choice.error * SAFETY <= wanted]
    if not enough:
        least = min(found, key=lambda choice: choice.error)
        raise ValueError(
            f"tolerance is {wanted:g}; the smallest possible one is {least.error * SAFETY:.2g}, with "
            f"{least.steps} steps of {least.plan.method.name} per control period"
        )
    return min(enough, key=lambda choice: choice.cost)


def fewest_steps(wanted: float, usual: Episodes, trial: Callable[[str, int], Episodes]) -> Choice:
    """Return the smallest number of steps whose largest error is small enough, or the best that was tried.

    ``usual`` are episodes with the default number of steps, which is tried first. ``trial`` makes episodes
    with another method and number of steps.
    """
    method = usual.simulator.integrator
    most = FINEST * usual.steps
    few = 0
    enough = None
    best = None
    episodes = usual
    for _ in range(TRIALS):
        tried = Choice(
            episodes.plan, episodes.steps, largest_error(episodes), episodes.steps * method.evaluations
        )
        if best is None or tried.error < best.error:
            best = tried
        if tried.error * SAFETY > wanted:
            few = max(few, tried.steps)
        elif enough is None or tried.steps < enough.steps:
            enough = tried
        else:  # so few steps are unstable
            break
        top = most if enough is None else enough.steps - 1
        if top <= few * CLOSE:
            break
        ratio = (tried.error * SAFETY / wanted) ** (1 / method.order)
        steps = math.ceil(tried.steps * min(max(ratio, 1 / FINEST), FINEST))
        if enough and few and not few < steps <= top:
            steps = math.ceil(math.sqrt(few * top))
        episodes = trial(method.name, min(max(steps, few + 1), top))
    assert best is not None
    return enough or best


def largest_error(episodes: Episodes) -> float:
    """Return the largest error of a control period over the episodes that are tried."""
    assert episodes.error is not None
    largest = 0.0
    copies = episodes.copies
    for first in range(0, EPISODES, copies):
        generators = [np.random.default_rng((EPISODES, first + n)) for n in range(copies)]
        for n, rng in enumerate(generators):
            ends = {name: reach[int(rng.integers(2))] for name, reach in episodes.ranges.items()}
            episodes.begin(np.array([n]), [rng], {"randomize": ends} if ends else None)
        goes_on = np.arange(first, first + copies) < EPISODES
        for _ in range(math.ceil(PERIODS / episodes.task.periods)):
            actions = np.stack([rng.uniform(-1, 1, episodes.action.shape[1]) for rng in generators])
            result, _ = episodes.step(actions)
            if goes_on.any():
                largest = max(largest, float(episodes.error.last[goes_on].max()))
            goes_on &= ~(result.terminated | result.truncated)
    return largest
