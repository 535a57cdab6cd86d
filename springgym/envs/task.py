"""The task of an environment: the part that differs from one environment to the next.

A `Task` defines the MDP: the scene, the start of an episode, the actuators and the reward.
`springgym.envs.episodes.Episodes` runs it for any number of copies. The Gymnasium classes in
`springgym.envs.base`, one for a single environment and one for a batch, call it. So each MDP is written
once.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Unpack

import numpy as np
from gymnasium import spaces
from numpy.random import Generator

from springgym.checks import chosen
from springgym.dynamics.measures import Measures
from springgym.envs.goals import GoalTolerance
from springgym.envs.observation import BOUND, Entry, ObservedParticles, Situation, values
from springgym.envs.options import Modes
from springgym.model.scene import Scene
from springgym.rendering import Camera, Look, Marks, Scenery
from springgym.scenes import film

__all__ = ["SUCCESS", "TERMINATED", "Drawn", "Factors", "ResetOptions", "Start", "Task", "at_rest", "level"]

KEYWORD = inspect.Parameter.KEYWORD_ONLY

SUCCESS = -2
"""Column of an outcome, beside its metrics: whether the aim is met now."""

TERMINATED = -1
"""Column of an outcome, beside its metrics: whether the episode failed."""


ResetOptions = dict[str, Any]
"""Reset options of the user; a task removes those that it uses."""

Factors = Mapping[str, float]
"""Factors of an episode's randomisation, by name; 1 without randomisation."""

Drawn = Sequence[float]
"""The numbers that determine the start of an episode."""


def level(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (n, 2) as level ones (n, 3): their third component is 0."""
    found = np.zeros((len(vectors), 3))
    found[:, :2] = vectors
    return found


class Start(NamedTuple):
    """The start of an episode, or of k episodes, with arrays of shape (k, …)."""

    positions: np.ndarray
    """(N, 3) positions of the particles [m]"""
    velocities: np.ndarray
    """(N, 3) velocities of the particles [m/s]"""
    goal: Sequence[Any] | np.ndarray = ()
    """the goal of this episode, of length `Task.goal_size`"""


def at_rest(positions: np.ndarray, goal: Sequence[Any] | np.ndarray = ()) -> Start:
    """Return the starts of k episodes where nothing moves."""
    return Start(positions, np.zeros_like(positions), goal)


class Task:
    """The MDP of an environment. Subclasses define it, and their instances are immutable.

    A subclass gets these compiled functions by ``class Own(Task, kernels=(evaluate, observe_features))``.
    They act on consecutive copies:

    - ``evaluate(m, s, out)``: for every copy c, from `Measures` m and the `Situation` s, set ``out[name][c]``
      for each name in `outcome`: the reward's terms, the metrics, whether the aim is met now, and whether the
      episode has failed;
    - ``observe_features(m, s, observation)``: the features (n, D);
    - ``move(m, s, goal)``, where there is one: sets the goals (n, G) of the next control period;
    - ``remember(m, s, memory)``, where there is one: sets the memory (n, K);
    - ``achieve(m, s, achieved, desired)``, where there are `goal_tolerances`: sets achieved and desired
      goals, (n, K) each, in SI units, in the order of these.

    After a step, ``move`` comes first, then ``evaluate``, which sees the old ``s.memory``, then ``remember``,
    and the observation last. At the start of an episode, the memory is `memory`, and ``remember`` is called
    once. In a step of several control periods, ``move`` and ``remember`` are called after each of them,
    ``evaluate`` after the last one.

    For several bodies, m holds the measures of each: scalars (n, bodies), vectors (n, bodies, 3).
    """

    observations: ClassVar[tuple[str, ...]] = ("particles", "features")
    actions: ClassVar[Mapping[str, int]]
    """names of the action modes, and their sizes"""
    terms: ClassVar[tuple[str, ...]]
    """names of the reward's terms: each in [0, 1], they sum to the reward"""
    metrics: ClassVar[tuple[str, ...]]
    """names of the quantities reported in ``info``"""
    entries: tuple[Entry, ...]
    """meaning of the numbers among the features, in order"""
    limits: np.ndarray
    """(A,) effect of each entry of an action at 1, in the units that the docstring states"""
    parameters: np.ndarray = np.zeros(0)
    """parameters of the task for ``evaluate`` and ``observe_features``"""
    goal_size: ClassVar[int] = 0
    counts_in_goal: tuple[tuple[int, int], ...] = ()
    """(column, largest value) of whole numbers from 0 in the goal, such as indices; no state holds others"""
    memory: ClassVar[Sequence[float]] = ()
    """the K numbers of the memory before the first call of ``remember``"""
    period: ClassVar[float] = 0.02
    """control period [s]"""
    periods: ClassVar[int] = 1
    """number of control periods in an environment step, which takes one action"""
    finest: ClassVar[float] = math.inf
    """largest automatic step [s], if the task chooses it for its impacts; else `springgym.model.resolution`
    does"""
    damping_every: ClassVar[int] = 1
    """number of steps in a cycle of dampers where there is contact and cycles are harmless, see
    `springgym.dynamics.forces.cycle`: 1, or an even number"""
    hold_steps: ClassVar[int] = 50
    """number of consecutive steps in which the aim must be met to count as success"""
    wins: ClassVar[bool] = False
    """whether an episode can end by success, as a won duel does; otherwise a failure is never a success"""
    has_aim: ClassVar[bool] = True
    """whether there is an aim: without one, "success" is always 0, and ``info`` has no ``is_success``"""
    checks_starts: bool = True
    """whether every start is checked. If it is False, starts with reset options or randomisation still are;
    tests show that all others are possible"""
    evaluate: ClassVar[Callable[..., None]]
    observe_features: ClassVar[Callable[..., None]]
    move: ClassVar[Callable[..., None] | None] = None
    remember: ClassVar[Callable[..., None] | None] = None
    goal_tolerances: ClassVar[tuple[GoalTolerance, ...]] = ()
    """the parts of the goal that must be reached for the aim to be met, if that follows from K achieved and K
    desired numbers"""
    achieve: ClassVar[Callable[..., None] | None] = None
    prepare: ClassVar[Callable[..., None] | None] = None
    """called once, before the first episode, with measures m and situation s of the scene; it may set
    `terms`, `metrics` and `entries`"""

    def __init_subclass__(cls, kernels: Sequence[Callable[..., None]] = ()) -> None:
        super().__init_subclass__()
        for kernel in kernels:
            setattr(cls, kernel.__name__, staticmethod(kernel))
        own = dict(inspect.signature(cls.__init__).parameters)
        if own.pop("modes", None) and hasattr(cls, "actions"):  # the signature lists all arguments
            usual = {"observation": cls.observations[0], "action": next(iter(cls.actions))}
            modes = (inspect.Parameter(name, KEYWORD, default=default) for name, default in usual.items())
            cls.__signature__ = inspect.Signature([*[*own.values()][1:], *modes])  # type: ignore[attr-defined]

    def __init__(self, **modes: Unpack[Modes]) -> None:
        self.observation = chosen(
            "observation", modes.pop("observation", self.observations[0]), self.observations
        )
        self.action = chosen("action", modes.pop("action", next(iter(self.actions))), self.actions)
        if modes:
            raise TypeError(f"{type(self).__name__} has no argument {next(iter(modes))!r}")

    @cached_property
    def reported(self) -> tuple[str, ...]:
        """Return the names in ``info`` of the reward's terms and the metrics."""
        return (*(f"reward_{name}" for name in self.terms), *self.metrics)

    @cached_property
    def outcome(self) -> tuple[str, ...]:
        """Return the names of all that ``evaluate`` sets: those in ``info``, "success" and "terminated"."""
        return (*self.reported, "success", "terminated")

    def seen(self, observations: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values that features (n, D) encode, by entry, (n, size) in SI units."""
        return values(self.entries, observations)

    @cached_property
    def scene(self) -> Scene:
        """Return the scene, which `make_scene` has made."""
        return self.make_scene()

    @cached_property
    def particles(self) -> ObservedParticles:
        """Return the "particles" observation, see `observed_particles`."""
        return self.observed_particles()

    def make_scene(self) -> Scene:
        """Make the scene."""
        raise NotImplementedError

    def observed_particles(self) -> ObservedParticles:
        """Return the "particles" observation; nothing is observed where `observations` lacks "particles"."""
        return ObservedParticles((), 1.0, 1.0)

    def draw(self, rng: Generator, options: ResetOptions, factors: Factors) -> Drawn:
        """Draw the numbers that determine the start of an episode."""
        raise NotImplementedError

    def starts(self, drawn: np.ndarray) -> Start:
        """Compute the starts of k episodes from what `draw` returned for each, (k, numbers)."""
        raise NotImplementedError

    def draw_starts(
        self, generators: Sequence[Generator], options: Sequence[ResetOptions], factors: Sequence[Factors]
    ) -> Start:
        """Draw the starts of k episodes."""
        each = zip(generators, options, factors, strict=True)
        return self.starts(np.array([self.draw(*own) for own in each]))

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values for `Simulator.actuate` of clipped actions (n, A)."""
        return {}

    def respond(self, m: Measures, s: Situation) -> dict[str, np.ndarray]:
        """Return further values for `Simulator.actuate` that depend on the state, such as an opponent's.

        ``s.action`` is the action of the period that begins.
        """
        return {}

    def look(self) -> Look:
        """Return the `Look` of the bodies."""
        raise NotImplementedError

    def points(self, s: Situation) -> np.ndarray:
        """Return the points (P, 3) that `look` draws, for the situation of one copy: its particles."""
        return s.x

    def framed(self, s: Situation) -> np.ndarray:
        """Return the points (n, 3) [m] that a picture of one environment must hold: all that is drawn."""
        return self.points(s)

    def camera(self) -> Camera:
        """Return the closest camera; it is moved away, and aside, to show the points of `framed`."""
        raise NotImplementedError

    def scenery(self) -> Scenery:
        """Return the scenery around the bodies: the surfaces of the scene, unless a task says otherwise."""
        return film.surfaces(self.scene)

    def marks(self, m: Measures, s: Situation) -> Marks:
        """Return the marks to draw. The arguments belong to one copy."""
        raise NotImplementedError

    @property
    def action_period(self) -> float:
        """Return the time from one action to the next [s]."""
        return self.periods * self.period

    @property
    def observation_space(self) -> spaces.Box:
        return spaces.Box(-BOUND, BOUND, (self.observation_size,), np.float32)

    @property
    def action_space(self) -> spaces.Box:
        return spaces.Box(-1.0, 1.0, (self.actions[self.action],), np.float32)

    @property
    def observation_size(self) -> int:
        if self.observation != "particles":
            return sum(entry.size for entry in self.entries)
        return self.particles.size(self.goal_size)
