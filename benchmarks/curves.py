"""Error against cost of every environment: what an error costs, and what a larger one would save.

The error is that of `benchmarks.errors`, for steps of other lengths than the default and, where nothing
touches, of methods of higher order. The cost is the processor time of an environment's step, a copy of a
batch: that of the control period with these steps, and that of what stands around it by default.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.conditions import progress
from benchmarks.errors import EPISODES, EVERY, PERIODS, batch, references, repeated
from benchmarks.timing import Row
from springgym.dynamics.methods import integrator
from springgym.envs.registration import ENVIRONMENTS
from springgym.simulator import Simulator

FACTORS = (1 / 4, 2**-1.5, 1 / 2, 2**-0.5, 1, 2, 4, 8, 12)
"""Numbers of force evaluations in a control period, over the default one."""

HIGHER = ("rk4",)
"""Methods that are measured besides the default one where contact is impossible.

Those with negative substeps are refused, as the bodies are damped."""

DIVERGED = 0.1
"""Largest error up to which steps count as stable."""


def curves(rounds: int) -> list[Row]:
    """Error of a control period, as in the section `errors`, against cost, for other steps and methods.

    ``microseconds``: processor time of an environment's step, a copy of a batch of 64. Steps that the
    simulator refuses, or whose largest error exceeds a tenth of the size, are left out. Rounds are ignored.
    """
    return [row for env in progress(ENVIRONMENTS, "curves") for row in curve(env.id)]


def curve(
    env_id: str, episodes: int = EPISODES, periods: int = PERIODS, every: int = EVERY, **options: Any
) -> list[Row]:
    """Return the rows of an environment, with ``options`` of its own; the default method comes first.

    ``every`` is at least 2: periods between those that count tell what a step takes.
    """
    envs = batch(env_id, episodes, **options)
    at = envs.unwrapped.episodes
    task = at.task
    usual = at.simulator
    exact = references(task, usual.step, episodes)[0]
    found = ladder(env_id, episodes, **options)
    played = []
    steps_took = []
    for step in repeated(envs, (exact, *found.values()), periods, every):
        if step.repeated:
            played.append(step)
        else:  # nothing else was in the processor's memory
            steps_took.append(step.took)
    default = usual.integrator.name, at.steps
    times = {key: _typical(step.repeating[n + 1] for step in played) for n, key in enumerate(found)}
    around = _typical(steps_took) - times[default]
    rows = []
    for n, (key, simulator) in enumerate(found.items()):
        errors = np.concatenate(
            [step.distances(step.repeated[n + 1], step.repeated[0], task.scene.sizes) for step in played]
        )
        median, least, largest = (float(f(errors)) for f in (np.median, np.min, np.max))
        if not largest <= DIVERGED:  # nor if it is not a number
            continue
        method, steps = key
        facts = {
            "steps": steps,
            "step_ms": 1e3 * simulator.step,
            "microseconds": 1e6 * (times[key] + around) / episodes,
            "default": key == default,
        }
        rows.append(
            Row({"environment": env_id, "method": method}, median, least, largest, "of the size", facts)
        )
    return rows


def ladder(env_id: str, copies: int, **options: Any) -> dict[tuple[str, int], Simulator]:
    """Return the simulators of an environment by method and steps of a control period, the default among
    them; without those that it refuses to be made with."""
    at = batch(env_id, copies, **options).unwrapped.episodes
    usual = at.simulator.integrator
    scene = at.task.scene
    found: dict[tuple[str, int], Simulator] = {}
    for method in (usual.name, *(() if scene.can_touch else HIGHER)):
        share = usual.evaluations / integrator(method).evaluations
        for factor in FACTORS:
            steps = max(1, round(factor * share * at.steps))
            pace = {"integrator": method, "step": at.task.period / steps}
            try:
                made = batch(env_id, copies, **options, **pace).unwrapped.episodes
            except ValueError:  # such steps are not stable, or the method does not suit the scene
                continue
            found[method, made.steps] = made.simulator
    return found


def _typical(times: Iterable[float]) -> float:
    return float(np.median(list(times)))


def cost(rows: Iterable[Mapping[str, Any]], error: float) -> float | None:
    """Return the least microseconds a step that have a median error; None if no row reaches it.

    Between two rows of a method, the cost is a power of the error.
    """
    found: list[float] = []
    methods: dict[str, list[tuple[int, float, float]]] = {}
    for row in rows:
        methods.setdefault(row["method"], []).append((row["steps"], row["median"], row["microseconds"]))
    for points in methods.values():
        points.sort()
        found += [took for _, at, took in points if at <= error]
        for (_, worse, less), (_, better, more) in pairwise(points):
            if better <= error < worse:
                share = math.log(worse / error) / math.log(worse / better)
                found.append(less * (more / less) ** share)
    return min(found, default=None)
