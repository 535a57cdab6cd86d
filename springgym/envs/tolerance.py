"""The method and the step that a wanted error asks for.

A control period is tried: `EPISODES` episodes of the task, begun from seeds of their own with factors of
randomisation at the ends of their ranges, go on for `PERIODS` periods with random actions, and the largest of
all errors counts, as `springgym.envs.error` estimates it. A method of order p errs by C hᵖ, which says how
many steps to try next. What is found was tried: its largest error, times `SAFETY` for all that was not, is
below what is wanted.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from springgym import checks
from springgym.checks import TINY
from springgym.envs.episodes import Episodes
from springgym.envs.task import Task

EPISODES, PERIODS = 16, 50

SAFETY = 1.5
"""Factor between the tolerance and the largest error that was seen: estimates during impacts are up to a
third too low, and later episodes may be harder than those tried."""

FINEST = 32
"""At most this many times as many steps as by default are tried."""

ROUNDS = 8
"""At most this many numbers of steps are tried for a method."""

CLOSE = 1.1
"""Ratio of two numbers of steps, one too few and one enough, between which none is looked for."""

HIGHER = ("rk4", "blanes_moan")
"""Methods of higher order, tried where the default one takes `PAYS` times as many steps as by default."""

PAYS = 2


class Choice(NamedTuple):
    """A method and its steps, and the largest error that was seen with them."""

    integrator: str
    steps: int
    """in a control period"""
    error: float
    """as a share of the body's size"""
    cost: int
    """force evaluations in a control period"""


def chosen_for(
    task: Task, copies: int, tolerance: object, integrator: str | None = None, **options: Any
) -> Choice:
    """Return the cheapest method and number of steps of a task whose errors stay below a tolerance.

    Parameters
    ----------
    task, copies
        What is simulated. As many copies are tried as there are to be, so that code is compiled once.
    tolerance
        The largest error of a control period, as a share of the body's size.
    integrator
        The method; if it is None, the default one and those of `HIGHER`.
    options
        The other options of `Episodes`.

    Raises
    ------
    TypeError, ValueError
        If the tolerance is no positive number, or no step that is tried is fine enough; the message says what
        is the least that is to be had.
    """
    wanted = checks.number("tolerance", tolerance, TINY)

    def trial(name: str | None, steps: int | None = None) -> Episodes:
        step = None if steps is None else task.period / steps
        pace: dict[str, Any] = {"integrator": name, "step": None, "wanted_step": step, "error": True}
        return Episodes(task, min(copies, EPISODES), max_episode_steps=None, **pace, **options)

    usual = trial(integrator)
    found = [fewest_steps(wanted, usual, trial)]
    if integrator is None and (found[0].error * SAFETY > wanted or found[0].steps > PAYS * usual.steps):
        for name in HIGHER:
            try:
                first = trial(name)
            except ValueError:  # it does not suit the scene
                continue
            found.append(fewest_steps(wanted, first, trial))
    enough = [choice for choice in found if choice.error * SAFETY <= wanted]
    if not enough:
        least = min(found, key=lambda choice: choice.error)
        raise ValueError(
            f"tolerance is {wanted:g}; the smallest possible one is {least.error * SAFETY:.2g}, with "
            f"{least.steps} steps of {least.integrator} to a control period"
        )
    return min(enough, key=lambda choice: choice.cost)


def fewest_steps(wanted: float, usual: Episodes, trial: Callable[[str, int], Episodes]) -> Choice:
    """Return the fewest steps of a method whose largest error is small enough, or the best that was tried.

    ``usual`` are episodes with the method's own number of steps, which is tried first; ``trial`` makes others
    of a method and a number of steps.
    """
    method, most = usual.simulator.integrator, FINEST * usual.steps
    few, enough, best, episodes = 0, None, None, usual
    for _ in range(ROUNDS):
        tried = Choice(
            method.name, episodes.steps, largest_error(episodes), episodes.steps * method.evaluations
        )
        if best is None or tried.error < best.error:
            best = tried
        if tried.error * SAFETY > wanted:
            few = max(few, tried.steps)
        elif enough is None or tried.steps < enough.steps:
            enough = tried
        else:  # as few as that are not stable
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
    largest, copies = 0.0, episodes.copies
    for first in range(0, EPISODES, copies):
        generators = [np.random.default_rng((EPISODES, first + n)) for n in range(copies)]
        for n, rng in enumerate(generators):
            ends = {name: reach[int(rng.integers(2))] for name, reach in episodes.ranges.items()}
            episodes.begin(np.array([n]), [rng], {"randomize": ends} if ends else None)
        goes_on = np.arange(first, first + copies) < EPISODES
        for _ in range(PERIODS):
            actions = np.stack([rng.uniform(-1, 1, episodes.action.shape[1]) for rng in generators])
            result, _ = episodes.step(actions)
            if goes_on.any():
                largest = max(largest, float(episodes.error.last[goes_on].max()))
            goes_on &= ~(result.terminated | result.truncated)
    return largest
