"""The error of an environment step: one definition, which is that of ``info["step_error"]``, for every table.

After a control period with a random action, how far the particle that is farthest from where exact steps
take it is from there, over the size of its body. Episodes begin and go on as they do for everybody:
`EPISODES` copies, from the seeds 0, 1, …, go through `PERIODS` control periods, of which one in `EVERY`
counts; an episode that ends is followed by another. Of a step of several control periods, the largest of
their errors is taken, and every second step counts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from benchmarks.conditions import progress
from benchmarks.timing import Row
from springgym.envs.registration import ENVIRONMENTS
from springgym.envs.task import Task
from springgym.model.bodies.distances import largest_distances
from springgym.simulator import Simulator

EPISODES = 64
PERIODS = 250
EVERY = 10

References = Callable[[Task, float, int], tuple[Simulator, ...]]
"""From a task, the step of its environment and how many copies: what takes exact steps, the best first."""


class StepErrors(NamedTuple):
    """Errors of control periods, in any order."""

    step: float
    """h [s]"""
    errors: np.ndarray
    estimates: np.ndarray
    """what ``info["step_error"]`` said of them"""
    apart: float
    """how far the other references are from the first at the most"""


def references(task: Task, step: float, copies: int) -> tuple[Simulator, ...]:
    """Return the reference simulator, and a second one whose distance from it bounds its error.

    Contact is met by Verlet's method alone, and converges to first order; all else by Dormand and Prince's
    with a tolerance of 1e-13.
    """
    scene = task.scene
    if scene.can_touch:
        fine, coarse = (64, 16) if scene.meetings else (1024, 256)
        return tuple(Simulator(scene, copies=copies, step=step / finer) for finer in (fine, coarse))
    exact = Simulator(scene, copies=copies, integrator="dopri5", step=step / 4, tolerance=(1e-13, 1e-16))
    return exact, Simulator(scene, copies=copies, integrator="rk4", step=step / 128)


def rigid_references(task: Task, step: float, copies: int) -> tuple[Simulator, ...]:
    """Return the rigid reference: the same method with finer steps."""
    finer = 1024 if task.scene.surfaces else 16
    return (Simulator(task.scene, copies=copies, dynamics="rigid", step=step / finer),)


def step_errors(
    env_id: str,
    references: References,
    episodes: int = EPISODES,
    periods: int = PERIODS,
    every: int = EVERY,
    **options: Any,
) -> StepErrors:
    """Return the errors of an environment's control periods; ``options`` are those of the environment.

    Each that counts is repeated by the references from the same state, with the same action.
    """
    envs = batch(env_id, episodes, error=True, **options)
    at = envs.unwrapped.episodes
    exact, *others = references(at.task, at.simulator.step, episodes)
    errors = []
    estimates = []
    apart = [0.0]
    for step in repeated(envs, (exact, *others), periods, every):
        if not step.repeated:
            continue
        there, *elsewhere = step.repeated
        errors.append(step.distances(step.positions, there, at.task.scene.sizes))
        estimates.append(step.infos["step_error"][step.counts])
        apart += [step.distances(other, there, at.task.scene.sizes).max(initial=0.0) for other in elsewhere]
    return StepErrors(at.simulator.step, np.concatenate(errors), np.concatenate(estimates), max(apart))


def batch(env_id: str, copies: int, **options: Any) -> Any:
    """Return a native batch of an environment."""
    return gym.make_vec(env_id, num_envs=copies, vectorization_mode="vector_entry_point", **options)


class Played(NamedTuple):
    """A step of a batch of environments, and the same step by other simulators if errors are measured."""

    counts: np.ndarray
    """which copies count"""
    positions: np.ndarray
    """(periods, copies, N, 3) positions at the end of each control period [m]"""
    infos: dict[str, Any]
    took: float
    """processor time of the environment's step [s]"""
    repeated: tuple[np.ndarray, ...]
    """where the repetitions end"""
    repeating: np.ndarray
    """(simulators,) processor time of the repetitions by each simulator [s]"""

    def distances(self, positions: np.ndarray, others: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """Return the errors of the copies that count: largest particle distances, divided by body sizes."""
        return np.asarray(largest_distances(positions, others, sizes).max(axis=0)[self.counts])


def repeated(
    envs: Any, simulators: Sequence[Simulator], periods: int = PERIODS, every: int = EVERY
) -> Iterator[Played]:
    """Play episodes with random actions, and yield a `Played` for each environment step.

    The control periods of those that count are repeated by every simulator from the same state, with the same
    action.
    """
    at = envs.unwrapped.episodes
    own = at.simulator
    parts = at.task.periods
    every = every if parts == 1 else 2
    rng = np.random.default_rng(0)
    envs.reset(seed=0)
    goes_on = np.ones(at.copies, bool)
    here: list[np.ndarray] = []
    there: list[list[np.ndarray]] = []
    repeating = np.zeros(len(simulators))

    def repeat() -> None:
        driven = at.driven_by(at.action)
        for k, other in enumerate(simulators):
            other.place(own.positions, own.velocities)
            other.actuate(**driven)
            began = time.process_time()
            other.advance(round(at.task.period / other.step), check=False)
            repeating[k] += time.process_time() - began
        there.append([other.positions for other in simulators])

    def follow() -> None:
        here.append(own.positions)
        if len(here) < parts:
            repeat()

    for n in range(math.ceil(periods / parts)):
        actions = rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)
        at.action[:] = actions  # as in the step, for who responds to it
        counts = goes_on & (n % every == 0)
        here.clear()
        there.clear()
        repeating[:] = 0.0
        if counts.any():
            repeat()
            at.each_period = follow
        began = time.process_time()
        _, _, terminated, truncated, infos = envs.step(actions)
        took = time.process_time() - began
        at.each_period = None
        ends = tuple(np.array(of) for of in zip(*there, strict=True))
        yield Played(counts, np.array(here), infos, took, ends, repeating.copy())
        goes_on = ~(terminated | truncated)  # the others begin anew in the next step


def measured_so() -> Iterator[tuple[str, dict[str, str]]]:
    """Return each environment as it is, the first one in other ways too, and rigid bodies on a floor."""
    for row in ENVIRONMENTS:
        yield row.id, {}
        if row is ENVIRONMENTS[0]:
            yield row.id, {"dtype": "float32"}
            yield row.id, {"integrator": "rk4"}
        if row is ENVIRONMENTS[0] or row.id == "SpringTumble-v0":
            yield row.id, {"dynamics": "rigid"}


def errors(rounds: int) -> list[Row]:
    """Error of a control period: the largest distance of a particle from where exact steps take it, over
    the size of its body.

    Median, least and largest over 64 copies, of which 25 control periods with random actions count, out of
    250. ``apart``: how far a second reference is from the first. ``estimate``: the median of what
    `info["step_error"]` says over the true error, with the middle 90 %. It is the same however often it is
    measured: rounds are ignored.
    """
    return [row_of(env_id, **options) for env_id, options in progress([*measured_so()], "errors")]


def row_of(env_id: str, **options: Any) -> Row:
    """Return the row of an environment in a table of errors."""
    found = step_errors(env_id, rigid_references if "dynamics" in options else references, **options)
    low, middle, high = np.quantile(found.estimates / found.errors, (0.05, 0.5, 0.95)).tolist()
    facts = {
        "step_ms": 1e3 * found.step,
        "apart": found.apart,
        "estimate": middle,
        "estimate_low": low,
        "estimate_high": high,
    }
    median, least, largest = (float(f(found.errors)) for f in (np.median, np.min, np.max))
    return Row({"environment": env_id} | options, median, least, largest, "of the size", facts)
