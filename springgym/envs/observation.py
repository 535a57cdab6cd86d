"""Observations: positions and velocities of particles, or a few named quantities with units.

Both are scaled to order one. `ObservedParticles` describes "particles". "features" come from the task's own
function ``observe_features``, and `Entry` describes its numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from springgym.checks import TINY, instance, number, readings, refusing_unknown, whole
from springgym.core.compiler.decorators import compiled, kernel
from springgym.dynamics import measures

__all__ = [
    "BOUND",
    "Columns",
    "Entry",
    "ObservedParticles",
    "Situation",
    "along",
    "bound",
    "clip",
    "columns",
    "observe_particles",
    "point_to",
    "values",
    "write_goal",
    "write_measures",
]

BOUND = 10.0
"""Bound to which observations of order one are clipped, so that their space is finite."""

ABOUT = ("origin", "centre", "goal")
ABOUT_CENTRE = 1
ABOUT_GOAL = 2


class Situation(NamedTuple):
    """The arguments of a task's functions besides the measures: state, action, goal and memory.

    All arrays but the last have a row for each copy.
    """

    x: np.ndarray
    """(n, N, 3) positions [m]"""
    v: np.ndarray
    """(n, N, 3) velocities [m/s]"""
    action: np.ndarray
    """(n, A) actions of the last step, clipped to ±1; 0 before the first step"""
    goal: np.ndarray
    """(n, G) goals"""
    time: np.ndarray
    """(n,) time since the start of the episode [s]"""
    memory: np.ndarray
    """(n, K) memory of the episode, see `springgym.envs.task.Task`"""
    parameters: np.ndarray
    """parameters of the task"""


@refusing_unknown
@dataclass(frozen=True)
class Entry:
    """Some numbers of the features: (value − ``about``) / ``unit``.

    Raises
    ------
    TypeError, ValueError
        If a field has the wrong type or value; the message names it.
    """

    name: str
    size: int
    """number of values"""
    unit: float = 1.0
    """the value that is observed as 1, in SI units"""
    about: float = 0.0
    """the value that is observed as 0"""

    def __post_init__(self) -> None:
        instance("name of an entry", self.name, str)
        whole(f"size of {self.name!r}", self.size, 1)
        number(f"unit of {self.name!r}", self.unit, TINY)
        number(f"about of {self.name!r}", self.about)


def values(entries: Sequence[Entry], observations: np.ndarray) -> dict[str, np.ndarray]:
    """Return the values that features (n, D) encode, by entry, (n, size) in SI units."""
    for n, entry in enumerate(instance("entries", entries, tuple, list)):
        instance(f"entries[{n}]", entry, Entry)
    unit, about, slices = _scales(tuple(entries))
    seen = readings("observations", observations, (None, None))
    if seen.shape[1] < len(unit):
        raise ValueError(f"observations have {seen.shape[1]} columns; the entries have {len(unit)} numbers")
    told = about + unit * seen[:, : len(unit)]
    return {name: told[:, own] for name, own in slices.items()}


@cache
def _scales(entries: tuple[Entry, ...]) -> tuple[np.ndarray, np.ndarray, dict[str, slice]]:
    """Return units and zeros of all numbers of an observation (D,), and the slice of each entry."""
    ends = np.cumsum([0, *(entry.size for entry in entries)]).tolist()
    sizes = [entry.size for entry in entries]
    unit, about = (
        np.repeat([getattr(entry, of) for entry in entries], sizes).astype(float) for of in ("unit", "about")
    )
    return unit, about, {entry.name: slice(*own) for entry, own in zip(entries, pairwise(ends), strict=True)}


@dataclass(frozen=True)
class ObservedParticles:
    """The "particles" observation: positions and velocities, with a scale for each particle.

    With one scale for all, the motion of a slow particle would be too small beside a fast one.
    """

    observed: tuple[int, ...]
    """observed particles; pinned ones never change, and are left out"""
    position_scale: float | np.ndarray
    """of all particles, or (N,) of each [m]"""
    velocity_scale: float | np.ndarray
    """of all particles, or (N,) of each [m/s]"""
    about: str = "origin"
    """reference of positions: "origin"; "centre", the centre of mass, for velocities too, so that the
    observation of a drifting body stays bounded; or "goal", its first three numbers, which are then not
    observed themselves"""
    pointed: int | None = None
    """the entry of the goal that is the index of a particle: the unit vector from the centre of mass to
    that particle is observed in its place"""
    skipped: tuple[tuple[int, int], ...] = ()
    """(particle, axis) pairs that never change, and are left out"""
    appended: Mapping[str, float] = field(default_factory=dict)
    """appended measures by name (see `springgym.dynamics.measures.FIELDS`), and their scales"""
    turned: bool = False
    """whether the appended measures are vectors in the body's axes"""
    goalless: bool = False
    """whether the goal is left out"""

    def without_goal(self) -> ObservedParticles:
        """Return the same observation without the goal: positions about it are positions in the world."""
        about = "origin" if self.about == "goal" else self.about
        return replace(self, about=about, pointed=None, goalless=True)

    def size(self, goal_size: int) -> int:
        """Return the number of observed values, for goals of ``goal_size`` numbers."""
        goal = goal_size - (3 if self.about == "goal" else 0) + (0 if self.pointed is None else 2)
        appended = sum(measures.FIELDS[name] for name in self.appended)
        return 2 * (3 * len(self.observed) - len(self.skipped)) + (0 if self.goalless else goal) + appended


class Columns(NamedTuple):
    """`ObservedParticles` for compiled functions: a column of the observation for each entry.

    Code for fields that are None is not compiled.
    """

    entries: np.ndarray
    """(K, 2) particle and axis, positions first, then velocities of the same"""
    per_metre: np.ndarray
    """(K,) factors of the positions [1/m]"""
    per_speed: np.ndarray
    """(K,) factors of the velocities [s/m]"""
    about: int
    """index in `ABOUT`"""
    pointed: int | None
    """the entry of the goal that is the index of a particle, if there is one"""
    measured: np.ndarray | None
    """columns of the rows of measures that are appended, if any are"""
    per_measure: np.ndarray
    """1 over the scales of these measures, in their units"""
    turned: bool | None
    """True or None"""
    goalless: bool


def columns(particles: ObservedParticles) -> Columns:
    """Return the entries of an observation in the form that `observe_particles` takes."""
    every = [(i, axis) for i in particles.observed for axis in range(3)]
    entries = np.array([pair for pair in every if pair not in particles.skipped], np.uint32)
    entries = entries.reshape(-1, 2)
    measured: list[int] = []
    scales: list[float] = []
    for name, scale in particles.appended.items():
        size = measures.FIELDS[name]
        measured += range(getattr(measures.AT, name), getattr(measures.AT, name) + size)
        scales += [scale] * size
    return Columns(
        entries,
        per_metre=1 / _of_each(particles.position_scale, entries[:, 0]),
        per_speed=1 / _of_each(particles.velocity_scale, entries[:, 0]),
        about=ABOUT.index(particles.about),
        pointed=particles.pointed,
        measured=np.array(measured, np.int64) if measured else None,
        per_measure=1 / np.array(scales, float),
        turned=particles.turned or None,
        goalless=particles.goalless,
    )


def _of_each(scale: float | np.ndarray, particles: np.ndarray) -> np.ndarray:
    """Return the scales of some particles (K,), given one scale or those of all particles."""
    return np.asarray(scale, float)[particles] if np.ndim(scale) else np.full(len(particles), float(scale))


@compiled
def along(u: np.ndarray, e1: np.ndarray, e3: np.ndarray, axis: int) -> float:
    """Return the component of a vector u (3,) along axis 0, 1 or 2 of the triad e1, e3 × e1, e3."""
    total = 0.0
    for n in range(3):
        if axis == 0:
            part = e1[n]
        elif axis == 2:
            part = e3[n]
        else:
            part = e3[(n + 1) % 3] * e1[(n + 2) % 3] - e3[(n + 2) % 3] * e1[(n + 1) % 3]
        total += part * u[n]
    return total


@compiled
def point_to(row: np.ndarray, position: np.ndarray, out: np.ndarray) -> None:
    """Return the unit vector from the centre of mass to a position (3,)."""
    length = 0.0
    for axis in range(3):
        out[axis] = position[axis] - row[measures.AT.centre + axis]
        length += out[axis] ** 2
    for axis in range(3):
        out[axis] /= math.sqrt(length)


@compiled
def write_goal(
    n: int, k: int, row: np.ndarray, x: np.ndarray, goal: np.ndarray, pointed: int | None, out: np.ndarray
) -> int:
    """Write entry ``n`` of a goal from column ``k`` on, and return the next column."""
    if pointed is not None and n == pointed:
        point_to(row, x[int(goal[n])], out[k : k + 3])
        return k + 3
    out[k] = goal[n]
    return k + 1


@compiled
def write_measures(
    row: np.ndarray,
    k: int,
    measured: np.ndarray | None,
    per_measure: np.ndarray,
    turned: bool | None,
    out: np.ndarray,
) -> None:
    """Write the appended measures, if there are any, from column ``k`` on."""
    if measured is not None:
        for n in range(measured.size):
            out[k + n] = measured_value(row, n, measured, turned) * per_measure[n]


@compiled
def measured_value(row: np.ndarray, n: int, measured: np.ndarray, turned: bool | None) -> float:
    if turned is None:
        return row[measured[n]]
    side = measures.AT.side
    axis = measures.AT.axis
    first = measured[n - n % 3]
    return along(row[first : first + 3], row[side : side + 3], row[axis : axis + 3], n % 3)


@kernel
def observe_particles(
    rows: np.ndarray, s: Situation, columns: Columns, diverged: np.ndarray, observation: np.ndarray
) -> None:
    """Write positions and velocities of (particle, axis) entries, goal and appended measures, see
    `Columns`, clipped to ±`BOUND`; the observations of diverged copies are 0."""
    count = columns.entries.shape[0]
    unseen = 3 if columns.about == ABOUT_GOAL else 0
    if columns.goalless:
        unseen = s.goal.shape[1]
    for c in range(rows.shape[0]):
        for n in range(count):
            i, axis = columns.entries[n]
            position = s.x[c, i, axis]
            velocity = s.v[c, i, axis]
            if columns.about == ABOUT_CENTRE:
                position -= rows[c, measures.AT.centre + axis]
                velocity -= rows[c, measures.AT.centre_velocity + axis]
            elif columns.about == ABOUT_GOAL:
                position -= s.goal[c, axis]
            observation[c, n] = position * columns.per_metre[n]
            observation[c, count + n] = velocity * columns.per_speed[n]
        k = 2 * count
        for n in range(unseen, s.goal.shape[1]):
            k = write_goal(n, k, rows[c], s.x[c], s.goal[c], columns.pointed, observation[c])
        write_measures(rows[c], k, columns.measured, columns.per_measure, columns.turned, observation[c])
        clip(observation[c], diverged[c])


@kernel
def bound(observation: np.ndarray, diverged: np.ndarray) -> None:
    """Clip observations to ±`BOUND`; those of diverged copies are 0."""
    for c in range(observation.shape[0]):
        clip(observation[c], diverged[c])


@compiled
def clip(seen: np.ndarray, diverged: bool) -> None:
    """Clip the observation of a copy."""
    for n in range(seen.size):
        seen[n] = 0.0 if diverged else min(max(seen[n], -BOUND), BOUND)
