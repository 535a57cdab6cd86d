"""What an environment is: a task over a scene, and the episodes of its copies.

A `Task` states the MDP: the scene, how an episode starts, what the actions drive, what is rewarded.
`Episodes` runs it for any number of copies. The Gymnasium classes in `springgym.envs.base`, one for a
single environment and one for a batch, only translate; so each MDP is written once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.random import Generator

from springgym import measures
from springgym.compiling import SameTypes, compiled, kernel
from springgym.measures import Measures
from springgym.rendering import Camera, Look, Marks, Scenery
from springgym.scene import Scene
from springgym.simulator import DYNAMICS, STRAIN_LIMIT, Simulator
from springgym.stability import steps_in
from springgym.surfaces import Contact

BOUND = 10.0
"""Observations are scaled to order one and clipped here, so that their space is finite."""

ABOUT = ("origin", "centre", "goal")
ABOUT_CENTRE, ABOUT_GOAL = 1, 2

RANDOMIZABLE = ("masses", "stiffness", "damping", "scale", "gravity", "friction", "restitution", "actuator")
"""What `randomize` may give a range of factors for, where the scene has it."""

OF_SPRINGS = ("stiffness", "damping", "scale")
"""Those of them that a rigid body does not have; ``scale`` is of the springs' lengths."""


class Start(NamedTuple):
    """How an episode starts."""

    positions: np.ndarray
    """(N, 3) [m]"""
    velocities: np.ndarray
    """(N, 3) [m/s]"""
    goal: Sequence[float] = ()
    """what the task wants this time, of the length `Task.goal_size`"""


@dataclass(frozen=True)
class Particles:
    """The "particles" observation: positions and velocities, scaled particle by particle.

    One scale for all would bury a slow particle under a fast one.
    """

    observed: tuple[int, ...]
    """particles in it: not the pinned ones, they never change"""
    position_scale: np.ndarray
    """(N,) [m]"""
    velocity_scale: np.ndarray
    """(N,) [m/s]"""
    about: str = "origin"
    """what positions count from: "origin"; "centre", the centre of mass, velocities too, so that a drifting
    body stays in view; or "goal", its first three numbers, which then are not observed themselves"""
    pointed: int | None = None
    """the entry of the goal that is the index of a particle: the unit vector from the centre of mass to
    that particle is observed in its place"""
    skipped: tuple[tuple[int, int], ...] = ()
    """(particle, axis) pairs left out, because they never change"""
    appended: Mapping[str, float] = field(default_factory=dict)
    """measures that follow, by name (see `springgym.measures.FIELDS`), and their scales"""
    turned: bool = False
    """whether these are vectors to be seen in the body's axes"""


class Task:
    """The MDP of an environment. A subclass states it; its instances are immutable.

    Compiled functions a subclass provides, over rows of copies:

    - ``evaluate(m, x, v, action, goal, parameters, out)``: for every copy c, from `Measures` m,
      positions x and velocities v (n, N, 3), the clipped action (n, A), the goal (n, G) and the
      task's own `parameters`, set ``out[c]`` to the
      reward's terms, the metrics, whether the aim is met now, and whether the episode has failed;
    - ``frame(m, x, v, goal, parameters, observation)``: the compact observation.
    """

    observations: ClassVar[tuple[str, ...]] = ("particles", "frame")
    actions: ClassVar[Mapping[str, int]]
    """names of the action modes, and their sizes"""
    terms: ClassVar[tuple[str, ...]]
    """names of the reward's terms: each in [0, 1], they sum to the reward"""
    metrics: ClassVar[tuple[str, ...]]
    """names of the quantities reported in ``info``"""
    frame_size: ClassVar[int]
    goal_size: ClassVar[int] = 0
    period: ClassVar[float] = 0.02
    """control period [s]"""
    finest: ClassVar[float] = math.inf
    """automatic steps are no longer than this [s]: impacts may need shorter ones than stability does"""
    hold: ClassVar[int] = 50
    """steps in a row that the aim must be met to count as success"""
    evaluate: ClassVar[Callable[..., None]]
    frame: ClassVar[Callable[..., None]]

    def __init__(self, observation: str = "particles", action: str = "torque") -> None:
        self.observation = chosen("observation", observation, self.observations)
        self.action = chosen("action", action, tuple(self.actions))

    @cached_property
    def reported(self) -> tuple[str, ...]:
        """Names in ``info`` of the reward's terms and the metrics."""
        return (*(f"reward_{name}" for name in self.terms), *self.metrics)

    @property
    def parameters(self) -> np.ndarray:
        """Numbers that ``evaluate`` and ``frame`` need."""
        return np.zeros(0)

    @property
    def scene(self) -> Scene:
        """What is simulated."""
        raise NotImplementedError

    @property
    def particles(self) -> Particles:
        """The "particles" observation."""
        raise NotImplementedError

    def start(self, rng: Generator, options: dict[str, Any], factors: Mapping[str, float]) -> Start:
        """Draw the start of an episode.

        ``options`` holds what the user fixed; what is used is removed from it. ``factors`` are those
        of this episode's randomisation, 1 if there is none.
        """
        raise NotImplementedError

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        """What the actuators do, as `Simulator.actuate` takes it, for clipped actions (n, A)."""
        raise NotImplementedError

    def look(self) -> Look:
        """How the body is drawn."""
        raise NotImplementedError

    def camera(self) -> Camera:
        """Where it is seen from."""
        raise NotImplementedError

    def scenery(self) -> Scenery:
        """What stands around it."""
        return Scenery()

    def marks(self, m: Measures, x: np.ndarray, action: np.ndarray, goal: np.ndarray) -> Marks:
        """What else is drawn; the arguments are those of one copy."""
        raise NotImplementedError

    @property
    def observation_space(self) -> spaces.Box:
        return spaces.Box(-BOUND, BOUND, (self.observation_size,), np.float32)

    @property
    def action_space(self) -> spaces.Box:
        return spaces.Box(-1.0, 1.0, (self.actions[self.action],), np.float32)

    @property
    def observation_size(self) -> int:
        if self.observation == "frame":
            return self.frame_size
        particles = self.particles
        appended = sum(measures.FIELDS[name] for name in particles.appended)
        goal = self.goal_size - (3 if particles.about == "goal" else 0)
        goal += 0 if particles.pointed is None else 2
        return 2 * (3 * len(particles.observed) - len(particles.skipped)) + goal + appended


class Step(NamedTuple):
    """What a step gave every copy."""

    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray


class Episodes:
    """Copies of a task, each in its own episode, stepped together."""

    def __init__(
        self,
        task: Task,
        copies: int,
        *,
        integrator: str | None,
        step: float | None,
        dynamics: str,
        dtype: Any,
        threads: int,
        randomize: Mapping[str, Sequence[float]] | None,
        max_episode_steps: int | None,
    ) -> None:
        self.task = task
        self.copies = copies
        self.parameters = task.parameters
        self.max_episode_steps = max_episode_steps if max_episode_steps is not None else -1
        chosen("dynamics", dynamics, tuple(DYNAMICS))
        self.ranges = _checked_ranges(randomize or {}, dynamics)
        scene = task.scene
        self.simulator = Simulator(
            scene,
            dynamics=dynamics,
            integrator=integrator,
            step=self._step(scene, dynamics, integrator, step),
            copies=copies,
            dtype=dtype,
            threads=threads,
            varying=_varying(self.ranges, scene),
        )
        self.steps = steps_in(task.period, self.simulator.step)
        columns = len(task.terms) + len(task.metrics) + 2
        self.goal = np.zeros((copies, task.goal_size))
        self.strength = np.ones((copies, 1))
        self.factors = np.ones((copies, len(self.ranges)))
        self.elapsed = np.zeros(copies, np.int64)
        self.held = np.zeros(copies, np.int64)
        self.balance = np.zeros(copies)
        """energy balance at the start of the episode [J]"""
        self.action = np.zeros((copies, task.action_space.shape[0]))
        """clipped to ±1"""
        self._given, self._driven = np.zeros_like(self.action), np.zeros_like(self.action)
        self.out = np.zeros((copies, columns))
        self.diverged = np.zeros(copies, bool)
        self.measures = measures.view(self.simulator.readout.rows)
        self._columns = self._observed_columns()
        self._use_kernels()

    def _step(self, scene: Scene, dynamics: str, integrator: str | None, step: float | None) -> float:
        """The step: given, or automatic for the stiffest and lightest body of the randomisation."""
        if step is not None:
            return step
        body = scene.body
        factor = {name: self.ranges.get(name, (1.0, 1.0)) for name in RANDOMIZABLE}
        hardest = body.with_(
            stiffness=body.stiffness * factor["stiffness"][1],
            damping=body.damping * factor["damping"][1],
            masses=body.masses * factor["masses"][0],
        )
        kind = DYNAMICS[dynamics]
        method = kind.integrator(integrator or kind.default(scene))
        automatic = kind.automatic_step(scene.with_(body=hardest), method, self.task.period)
        return self.task.period / math.ceil(self.task.period / min(automatic, self.task.finest) - 1e-9)

    def _observed_columns(self) -> tuple[Any, ...]:
        """What `observe_particles` takes before the observation."""
        particles = self.task.particles
        every = [(i, axis) for i in particles.observed for axis in range(3)]
        entries = np.array([pair for pair in every if pair not in particles.skipped], np.int64)
        columns: list[int] = []
        scales: list[float] = []
        for name, scale in particles.appended.items():
            size = measures.FIELDS[name]
            columns += range(measures.OFFSETS[name], measures.OFFSETS[name] + size)
            scales += [scale] * size
        return (
            entries,
            1 / np.asarray(particles.position_scale, float)[entries[:, 0]],
            1 / np.asarray(particles.velocity_scale, float)[entries[:, 0]],
            ABOUT.index(particles.about),
            -1 if particles.pointed is None else particles.pointed,
            np.array(columns, np.int64),
            1 / np.array(scales, float),
            particles.turned,
        )

    # --- Episodes ---------------------------------------------------------------------------------

    def begin(self, copies: np.ndarray, generators: Sequence[Generator], options: Mapping[str, Any]) -> None:
        """Start new episodes in some copies (k,), each drawing from its own generator.

        Raises
        ------
        ValueError
            Naming an option that the task does not have, or a value out of range.
        """
        starts = []
        for copy, rng in zip(copies, generators, strict=True):
            given = dict(options)
            factors = self._draw(rng, given)
            starts.append(self.task.start(rng, given, factors))
            if given:
                raise ValueError(f"{type(self.task).__name__} has no reset option {next(iter(given))!r}")
            self.factors[copy] = [factors[name] for name in self.ranges]
            self.strength[copy] = factors["actuator"]
            if self.ranges:
                self._vary(copy, factors)
        self.simulator.place(
            np.stack([s.positions for s in starts]), np.stack([s.velocities for s in starts]), copies
        )
        self.goal[copies] = [s.goal for s in starts]
        self.elapsed[copies] = 0
        self.held[copies] = 0
        self.action[copies] = 0.0
        self.out[copies] = 0.0
        self.diverged[copies] = False
        self.simulator.read(copies)
        self.balance[copies] = self.measures.balance[copies]

    def step(self, action: np.ndarray) -> Step:
        """One control period of all copies. ``action`` (n, A) is clipped to [−1, 1].

        Raises
        ------
        ValueError
            If it holds a value that is not finite.
        """
        task, simulator = self.task, self.simulator
        self._given[:] = action
        if not self._take(self._given, self.strength, self.action, self._driven):
            raise ValueError(f"action holds a value that is not finite: {action}")
        simulator.actuate(**task.actuate(self._driven))
        simulator.advance(self.steps, check=False, read=True)
        self._evaluate(self.measures, *self.particles, self.action, self.goal, self.parameters, self.out)
        result = Step(np.empty(self.copies), np.empty(self.copies, bool), np.empty(self.copies, bool))
        self._finish(
            simulator.readout.rows,
            self.out,
            len(task.terms),
            self.held,
            self.elapsed,
            self.max_episode_steps,
            self.diverged,
            *result,
        )
        return result

    def observe(self) -> np.ndarray:
        """The observations of all copies, (n, D), float32, freshly made."""
        observation = np.empty((self.copies, self.task.observation_size), np.float32)
        if self.task.observation == "frame":
            self._observe(self.measures, *self.particles, self.goal, self.parameters, observation)
        else:
            self._observe(*self.simulator.readout, self.goal, *self._columns, observation)
        self._bound(observation, self.diverged)
        return observation

    # --- Randomisation ----------------------------------------------------------------------------

    def _draw(self, rng: Generator, options: dict[str, Any]) -> dict[str, float]:
        """This episode's factors, drawn unless given in ``options["randomize"]``."""
        given = options.pop("randomize", {})
        if unknown := set(given) - set(self.ranges):
            raise ValueError(
                f"reset cannot set the factor of {sorted(unknown)[0]!r}: "
                f"randomize was given {', '.join(self.ranges) or 'nothing'} when the environment was made"
            )
        factors = dict.fromkeys(RANDOMIZABLE, 1.0)
        for name, (low, high) in self.ranges.items():
            drawn = rng.uniform(low, high)
            factors[name] = float(given.get(name, drawn))
            if not low <= factors[name] <= high:
                raise ValueError(f"factor {factors[name]} of {name!r} is outside {low} … {high}")
        return factors

    def _vary(self, copy: int, factors: Mapping[str, float]) -> None:
        scene = self.simulator.scene
        values = {
            "masses": scene.body.masses * factors["masses"],
            "stiffness": scene.body.stiffness * factors["stiffness"],
            "damping": scene.body.damping * factors["damping"],
            "lengths": scene.body.lengths * factors["scale"],
        }
        if scene.gravity is not None:
            values["gravity"] = np.array(scene.gravity) * factors["gravity"]
        if isinstance(scene.contact, Contact):
            values["friction"] = np.array(scene.contact.friction * factors["friction"])
            values["restitution"] = np.array(scene.contact.restitution * factors["restitution"])
        varying = _varying(self.ranges, scene)
        chosen = {name: value[None] for name, value in values.items() if name in varying}
        if chosen:
            self.simulator.vary(np.array([copy]), **chosen)

    # --- State ------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """All that changes, copied."""
        arrays = ("goal", "strength", "factors", "elapsed", "held", "balance", "action", "out", "diverged")
        return {name: getattr(self, name).copy() for name in arrays} | {"simulator": self.simulator.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Return to what `state` gave, to the bit."""
        for name, value in state.items():
            if name == "simulator":
                self.simulator.restore(value)
            else:
                getattr(self, name)[:] = value
        if self.ranges:
            for copy, row in enumerate(self.factors):
                drawn = dict(zip(self.ranges, row.tolist(), strict=True))
                self._vary(copy, dict.fromkeys(RANDOMIZABLE, 1.0) | drawn)
        self.simulator.read()

    def _use_kernels(self) -> None:
        compact = self.task.observation == "frame"
        self._take = SameTypes(take)
        self._evaluate = SameTypes(self.task.evaluate)
        self._finish = SameTypes(finish)
        self._observe = SameTypes(self.task.frame if compact else observe_particles)
        self._bound = SameTypes(bound)

    def __getstate__(self) -> dict[str, Any]:
        return {
            name: value
            for name, value in vars(self).items()
            if name != "measures" and not isinstance(value, SameTypes)
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.measures = measures.view(self.simulator.readout.rows)  # views do not survive being copied
        self._use_kernels()

    @property
    def particles(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities after the last step or start, (n, N, 3) each; do not change them."""
        return self.simulator.readout.positions, self.simulator.readout.velocities


# --- Compiled ---------------------------------------------------------------------------------------


@kernel
def take(given: Any, strength: Any, action: Any, driven: Any) -> bool:
    """Clip the given actions, and scale what they drive; False if one is not finite, and nothing is taken."""
    for c in range(given.shape[0]):
        for n in range(given.shape[1]):
            if not math.isfinite(given[c, n]):
                return False
    for c in range(given.shape[0]):
        for n in range(given.shape[1]):
            action[c, n] = min(max(given[c, n], -1.0), 1.0)
            driven[c, n] = action[c, n] * strength[c, 0]
    return True


@kernel
def finish(
    rows: Any,
    out: Any,
    terms: Any,
    held: Any,
    elapsed: Any,
    limit: Any,
    diverged: Any,
    reward: Any,
    terminated: Any,
    truncated: Any,
) -> None:
    """Sum rewards, count steps, end episodes; a copy that has diverged ends with reward 0."""
    met, failed = out.shape[1] - 2, out.shape[1] - 1
    for c in range(out.shape[0]):
        total = 0.0
        for n in range(rows.shape[1]):
            total += rows[c, n]
        diverged[c] = not (math.isfinite(total) and rows[c, measures.STRAIN] <= STRAIN_LIMIT)
        if diverged[c]:
            out[c, :] = 0.0
            out[c, failed] = 1.0
        reward[c] = 0.0
        for n in range(terms):
            reward[c] += out[c, n]
        held[c] = held[c] + 1 if out[c, met] > 0 else 0
        elapsed[c] += 1
        terminated[c] = out[c, failed] > 0
        truncated[c] = 0 <= limit <= elapsed[c]


@compiled
def along(row: Any, first: Any, axis: Any) -> Any:
    """Component along an axis of the body's triad of the measured vector that starts at column ``first``."""
    e1, e3 = row[measures.SIDE : measures.SIDE + 3], row[measures.AXIS : measures.AXIS + 3]
    total = 0.0
    for n in range(3):
        if axis == 0:
            part = e1[n]
        elif axis == 2:
            part = e3[n]
        else:
            part = e3[(n + 1) % 3] * e1[(n + 2) % 3] - e3[(n + 2) % 3] * e1[(n + 1) % 3]
        total += part * row[first + n]
    return total


@compiled
def point_to(row: Any, position: Any, out: Any) -> None:
    """The unit vector from the centre of mass to a position (3,)."""
    length = 0.0
    for axis in range(3):
        out[axis] = position[axis] - row[measures.CENTRE + axis]
        length += out[axis] ** 2
    for axis in range(3):
        out[axis] /= math.sqrt(length)


@kernel
def observe_particles(
    rows: Any,
    x: Any,
    v: Any,
    goal: Any,
    entries: Any,
    per_metre: Any,
    per_speed: Any,
    about: Any,
    pointed: Any,
    columns: Any,
    per_measure: Any,
    turned: Any,
    observation: Any,
) -> None:
    """Positions and velocities of the (particle, axis) ``entries``, the goal, and appended measures."""
    count = entries.shape[0]
    unseen = 3 if about == ABOUT_GOAL else 0
    for c in range(x.shape[0]):
        for n in range(count):
            i, axis = entries[n]
            position, velocity = x[c, i, axis], v[c, i, axis]
            if about == ABOUT_CENTRE:
                position -= rows[c, measures.CENTRE + axis]
                velocity -= rows[c, measures.CENTRE_VELOCITY + axis]
            elif about == ABOUT_GOAL:
                position -= goal[c, axis]
            observation[c, n] = position * per_metre[n]
            observation[c, count + n] = velocity * per_speed[n]
        k = 2 * count
        for n in range(unseen, goal.shape[1]):
            if n == pointed:
                point_to(rows[c], x[c, int(goal[c, n])], observation[c, k : k + 3])
                k += 3
            else:
                observation[c, k] = goal[c, n]
                k += 1
        for n in range(columns.size):
            value = rows[c, columns[n]]
            if turned:
                value = along(rows[c], columns[n - n % 3], n % 3)
            observation[c, k + n] = value * per_measure[n]


@kernel
def bound(observation: Any, diverged: Any) -> None:
    """Clip observations to ±`BOUND`; those of diverged copies are 0."""
    for c in range(observation.shape[0]):
        for n in range(observation.shape[1]):
            value = observation[c, n]
            observation[c, n] = 0.0 if diverged[c] else min(max(value, -BOUND), BOUND)


# --- Checks -----------------------------------------------------------------------------------------


def chosen(name: str, value: str, choices: Sequence[str]) -> str:
    if value not in choices:
        raise ValueError(f"{name}={value!r} is unknown; it is one of {', '.join(map(repr, choices))}")
    return value


def number(options: dict[str, Any], name: str, otherwise: float, low: float, high: float) -> float:
    """Take a number out of reset options, if it is there.

    Raises
    ------
    ValueError
        If it is not a number from ``low`` to ``high``.
    """
    value = options.pop(name, otherwise)
    try:
        value = float(value)
    except (TypeError, ValueError):
        raise ValueError(f"reset option {name!r} is {value!r}; it must be a number") from None
    if not low <= value <= high:
        raise ValueError(f"reset option {name!r} is {value}; it must be from {low:g} to {high:g}")
    return value


def _checked_ranges(
    randomize: Mapping[str, Sequence[float]], dynamics: str
) -> dict[str, tuple[float, float]]:
    ranges = {}
    for name, given in randomize.items():
        if name not in RANDOMIZABLE:
            raise ValueError(f"cannot randomize {name!r}; {', '.join(RANDOMIZABLE)} can be")
        if dynamics == "rigid" and name in OF_SPRINGS:
            raise ValueError(f"cannot randomize {name!r}: a rigid body has no springs")
        try:
            low, high = map(float, given)
        except (TypeError, ValueError):
            raise ValueError(f"randomize[{name!r}] is {given!r}; it must be a pair (low, high)") from None
        if not 0 < low <= high < math.inf:
            raise ValueError(f"randomize[{name!r}] is {given!r}; it must be 0 < low ≤ high")
        ranges[name] = (low, high)
    return ranges


def _varying(ranges: Mapping[str, Any], scene: Scene) -> set[str]:
    """What the ranges make vary in the simulator.

    Raises
    ------
    ValueError
        If a range asks for a restitution above 1, or for a gravity that the scene does not have.
    """
    if scene.surfaces and isinstance(scene.contact, Contact) and "restitution" in ranges:
        highest = scene.contact.restitution * ranges["restitution"][1]
        if highest > 1:
            raise ValueError(
                f"randomize['restitution'] makes the restitution {highest:g}; it must be at most 1"
            )
    if "gravity" in ranges and scene.gravity is None:
        raise ValueError("cannot randomize 'gravity': the scene has no gravity")
    return {"lengths" if name == "scale" else name for name in ranges} - {"actuator"}
