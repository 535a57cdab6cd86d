"""What an environment is: a task over a scene, and the episodes of its copies.

A `Task` states the MDP: the scene, how an episode starts, what the actions drive, what is rewarded.
`Episodes` runs it for any number of copies. The Gymnasium classes in `springgym.envs.base`, one for a
single environment and one for a batch, only translate; so each MDP is written once.
"""

from __future__ import annotations

import hashlib
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from gymnasium import spaces
from numba.extending import is_jitted
from numpy.random import Generator

from springgym import checks, measures
from springgym.bodies import Body
from springgym.checks import TINY, chosen, instance
from springgym.compiling import SameTypes, compiled, kernel
from springgym.measures import Measures
from springgym.rendering import Camera, Look, Marks, Scenery
from springgym.scene import Scene
from springgym.simulator import DYNAMICS, STRAIN_LIMIT, Dynamics, Simulator
from springgym.stability import steps_in
from springgym.surfaces import Contact

MOST_STEPS = 100_000
"""Steps in a control period at the most: as many take a control period up to about 0.1 s."""

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
        self.action = chosen("action", action, self.actions)

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

    def prepare(self, m: Measures, x: np.ndarray, v: np.ndarray) -> None:
        """For an observation that is called "own": see the scene once, before the first episode."""

    @property
    def observation_space(self) -> spaces.Box:
        return spaces.Box(-BOUND, BOUND, (self.observation_size,), np.float32)

    @property
    def action_space(self) -> spaces.Box:
        return spaces.Box(-1.0, 1.0, (self.actions[self.action],), np.float32)

    @property
    def observation_size(self) -> int:
        if self.observation != "particles":
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


STATE = ("goal", "strength", "factors", "elapsed", "held", "balance", "action", "out", "diverged")
"""Arrays of `Episodes` that change."""


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
        self.max_episode_steps = _checked_limit(max_episode_steps)
        kind = DYNAMICS[chosen("dynamics", dynamics, DYNAMICS)]
        self.ranges = _checked_ranges({} if randomize is None else randomize, dynamics)
        scene = task.scene
        self.simulator = Simulator(
            scene,
            dynamics=dynamics,
            integrator=integrator,
            step=self._step(scene, kind, integrator, step),
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
        self.out, self._fresh = np.zeros((copies, columns)), np.zeros((copies, columns))
        self.diverged = np.zeros(copies, bool)
        self._columns = self._observed_columns()
        self._of = self._identity()
        self._use_kernels()
        if task.observation == "own":
            self.simulator.read()
            task.prepare(*self._shown)

    def _step(self, scene: Scene, kind: Dynamics, integrator: str | None, step: float | None) -> float:
        """The step: given, or automatic, for the stiffest and lightest body of the randomisation.

        Raises
        ------
        ValueError
            If a given one is unstable for that body, or more than `MOST_STEPS` make a control period.
        """
        if integrator is not None:
            instance("integrator", integrator, str)
        body, period = scene.body, self.task.period
        factor = {name: self.ranges.get(name, (1.0, 1.0)) for name in RANDOMIZABLE}
        if self.ranges:
            scene = scene.with_(
                body=body.with_(
                    stiffness=body.stiffness * factor["stiffness"][1],
                    damping=body.damping * factor["damping"][1],
                    masses=body.masses * factor["masses"][0],
                )
            )
        method = kind.integrator(kind.default(scene) if integrator is None else integrator)
        ranges = f" with randomize={self.ranges}" if self.ranges else ""
        if step is not None:
            step = checks.number("step", step, TINY)
            if self.ranges and step > (limit := kind.largest_step(scene, method)):
                raise ValueError(
                    f"a step of {step:g} s is unstable: {method.name} on this body{ranges} allows at most "
                    f"{limit:.4g} s. Take a smaller step, or narrower ranges"
                )
            if period / step > MOST_STEPS:
                raise ValueError(
                    f"step is {step:g} s, {period / step:.3g} to a control period of {period:g} s; "
                    f"there must be at most {MOST_STEPS:,}"
                )
            return step
        automatic = min(kind.automatic_step(scene, method), self.task.finest)
        if not period <= MOST_STEPS * automatic:
            raise ValueError(
                f"{method.name} needs steps of {automatic:.3g} s on this body{ranges}, more than "
                f"{MOST_STEPS:,} to a control period of {period:g} s: {_fastest(scene, kind)}"
            )
        return period / math.ceil(period / automatic - 1e-9)

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

    def begin(
        self, copies: np.ndarray, generators: Sequence[Generator], options: Mapping[str, Any] | None
    ) -> None:
        """Start new episodes in some copies (k,), each drawing from its own generator.

        What is refused changes nothing, the generators included.

        Raises
        ------
        TypeError, ValueError
            Naming an option that the task does not have, or a value that is none or out of range.
        """
        given = {} if options is None else dict(mapping("options", options))
        before = [rng.bit_generator.state for rng in generators]
        try:
            self._begin(copies, generators, given)
        except BaseException:
            for rng, state in zip(generators, before, strict=True):
                rng.bit_generator.state = state
            raise

    def _begin(self, copies: np.ndarray, generators: Sequence[Generator], options: dict[str, Any]) -> None:
        starts, drawn = [], []
        for rng in generators:
            left = dict(options)
            factors = self._draw(rng, left)
            starts.append(self.task.start(rng, left, factors))
            drawn.append(factors)
            if left:
                raise ValueError(f"{type(self.task).__name__} has no reset option {next(iter(left))!r}")
        positions = np.stack([s.positions for s in starts])
        self._check_strain(positions, drawn)
        before = [self._drawn(copy) for copy in copies] if self.ranges else []
        self._vary(copies, drawn)
        try:
            self.simulator.place(positions, np.stack([s.velocities for s in starts]), copies)
        except BaseException:
            self._vary(copies, before)
            raise
        self.goal[copies] = [s.goal for s in starts]
        self.elapsed[copies] = 0
        self.held[copies] = 0
        self.action[copies] = 0.0
        self.out[copies] = 0.0
        self.diverged[copies] = False
        self.simulator.read(copies)
        self.balance[copies] = self.measures.balance[copies]
        if self.task.metrics:
            self._evaluate(*self._shown, self._shown_action, self.goal, self.parameters, self._fresh)
            metrics = slice(len(self.task.terms), -2)  # nothing has been earned yet
            self.out[copies, metrics] = self._fresh[copies, metrics]

    def _check_strain(self, positions: np.ndarray, drawn: Sequence[Mapping[str, float]]) -> None:
        """Refuse starts (k, N, 3) in a shape that has diverged already."""
        body = self.simulator.scene.body
        if self.simulator.dynamics == "rigid" or not len(body.springs):
            return
        first, second = body.springs.T
        scale = np.array([[factors["scale"]] for factors in drawn])
        apart = np.linalg.norm(positions[:, second] - positions[:, first], axis=-1)
        strain = np.abs(apart / (scale * body.lengths) - 1).max(axis=1)
        if not (strain <= STRAIN_LIMIT).all():
            n = int(np.argmax(~(strain <= STRAIN_LIMIT)))
            factors = ", ".join(f"{name} × {drawn[n][name]:g}" for name in self.ranges)
            raise ValueError(
                f"{type(self.task).__name__} would start with a strain of {strain[n]:.3g}"
                f"{f' ({factors})' if factors else ''}; it must be at most {STRAIN_LIMIT}"
            )

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
        self._evaluate(*self._shown, self._shown_action, self.goal, self.parameters, self.out)
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
        if self.task.observation != "particles":
            self._observe(*self._shown, self.goal, self.parameters, observation)
        else:
            self._observe(*self.simulator.readout, self.goal, *self._columns, observation)
        self._bound(observation, self.diverged)
        return observation

    # --- Randomisation ----------------------------------------------------------------------------

    def _draw(self, rng: Generator, options: dict[str, Any]) -> dict[str, float]:
        """This episode's factors, drawn unless given in ``options["randomize"]``."""
        given = mapping("reset option 'randomize'", options.pop("randomize", {}))
        for name in given:
            if name not in self.ranges:
                raise ValueError(
                    f"reset cannot set the factor of {name!r}: "
                    f"randomize was given {', '.join(self.ranges) or 'nothing'} when the environment was made"
                )
        factors = dict.fromkeys(RANDOMIZABLE, 1.0)
        for name, (low, high) in self.ranges.items():
            factors[name] = rng.uniform(low, high)
            if name in given:
                factors[name] = checks.number(f"reset option 'randomize', {name!r},", given[name], low, high)
        return factors

    def _drawn(self, copy: int) -> dict[str, float]:
        """The factors of a copy's episode."""
        return dict.fromkeys(RANDOMIZABLE, 1.0) | dict(zip(self.ranges, self.factors[copy], strict=True))

    def _vary(self, copies: np.ndarray, drawn: Sequence[Mapping[str, float]]) -> None:
        """Give some copies (k,) their factors."""
        if not self.ranges:
            return
        for copy, factors in zip(copies, drawn, strict=True):
            self.factors[copy] = [factors[name] for name in self.ranges]
            self.strength[copy] = factors["actuator"]
            self._vary_simulator(copy, factors)

    def _vary_simulator(self, copy: int, factors: Mapping[str, float]) -> None:
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

    def _identity(self) -> dict[str, Any]:
        """What a state belongs to."""
        body, simulator = self.simulator.scene.body, self.simulator
        digest = hashlib.sha256(repr(simulator.scene.pinned).encode())
        for values in (body.masses, body.springs, body.lengths, body.stiffness, body.damping):
            digest.update(values.tobytes())
        return {
            "task": type(self.task).__name__,
            "action": self.task.action,
            "copies": self.copies,
            "dynamics": simulator.dynamics,
            "dtype": simulator.dtype.name,
            "randomized": list(self.ranges),
            "body": digest.hexdigest()[:16],
        }

    def state(self) -> dict[str, Any]:
        """All that changes, copied, and what it belongs to."""
        arrays = {name: getattr(self, name).copy() for name in STATE}
        return {"of": dict(self._of), **arrays, "simulator": self.simulator.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Return to what `state` gave, to the bit.

        Raises
        ------
        ValueError
            If it belongs to something else, or is mangled. Nothing is changed then.
        """
        if not isinstance(state, Mapping) or set(state) != {"of", "simulator", *STATE}:
            raise ValueError("state is not one of an environment of springgym")
        of = mapping("state['of']", state["of"])
        for name, own in self._of.items():
            if of.get(name) != own:
                raise ValueError(
                    f"state is one of another environment: its {name} is {of.get(name)!r}, here it is {own!r}"
                )
        for name in STATE:
            given, own = np.asarray(state[name]), getattr(self, name)
            if given.shape != own.shape or given.dtype != own.dtype:
                raise ValueError(
                    f"state[{name!r}] is {given.dtype} of shape {given.shape}; it must be {own.dtype} of "
                    f"shape {own.shape}"
                )
        self.simulator.restore(state["simulator"])
        for name in STATE:
            getattr(self, name)[:] = state[name]
        self._vary(np.arange(self.copies), [self._drawn(copy) for copy in range(self.copies)])
        self.simulator.read()

    def _use_kernels(self) -> None:
        self.measures = measures.view(self.simulator.readout.rows)
        self._shown: tuple[Measures, np.ndarray, np.ndarray] = (self.measures, *self.particles)
        self._shown_action = self.action
        if not is_jitted(self.task.evaluate):  # a user's own functions see, and change nothing
            x, v = self.particles
            self._shown = Measures(*map(_locked, self.measures)), _locked(x), _locked(v)
            self._shown_action = _locked(self.action)
        compact = self.task.observation != "particles"
        self._take = SameTypes(take)
        self._evaluate = SameTypes(self.task.evaluate)
        self._finish = SameTypes(finish)
        self._observe = SameTypes(self.task.frame if compact else observe_particles)
        self._bound = SameTypes(bound)

    def __getstate__(self) -> dict[str, Any]:
        return {
            name: value
            for name, value in vars(self).items()
            if name not in ("measures", "_shown", "_shown_action") and not isinstance(value, SameTypes)
        }  # views do not survive being copied

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
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


def mapping(name: str, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} is {checks.shown(value)}; it must be a mapping, as a dict is")
    return value


def number(options: dict[str, Any], name: str, otherwise: float, low: float, high: float) -> float:
    """Take a number from ``low`` to ``high`` out of reset options, if it is there."""
    if name not in options:
        return otherwise
    return checks.number(f"reset option {name!r}", options.pop(name), low, high)


def made(maker: Callable[..., Body], body: Mapping[str, Any] | None, **usual: Any) -> Body:
    """A body from the arguments of its maker that the user gave as ``body``, over the usual ones.

    Keys that are numbers may be texts: JSON makes them so.

    Raises
    ------
    TypeError, ValueError
        Naming an argument that the maker does not have, or what it finds fault with.
    """
    given = {} if body is None else dict(mapping("body", body))
    known = inspect.signature(maker).parameters
    for name, value in given.items():
        if name not in known:
            raise ValueError(f"body has no {name!r}; {maker.__name__} takes {', '.join(known)}")
        if isinstance(value, Mapping):
            numbers = (int(key) if isinstance(key, str) and key.isdecimal() else key for key in value)
            given[name] = dict(zip(numbers, value.values(), strict=True))
    try:
        return maker(**(usual | given))
    except (TypeError, ValueError) as error:
        raise type(error)(f"body: {error}") from error


def _locked(array: np.ndarray) -> np.ndarray:
    """A view that cannot be written to."""
    view = array.view()
    view.flags.writeable = False
    return view


def _fastest(scene: Scene, kind: Dynamics) -> str:
    """What asks for the shortest steps, in words."""
    if kind is not DYNAMICS["springs"]:
        return "it starts to turn too fast"
    body = scene.body
    stiffness, damping = np.zeros(len(body.masses)), np.zeros(len(body.masses))
    for end in body.springs.T:
        np.add.at(stiffness, end, body.stiffness)
        np.add.at(damping, end, body.damping)
    rate = np.maximum(np.sqrt(stiffness / body.masses), damping / body.masses) * scene.free
    n = int(np.argmax(rate))
    return (
        f"particle {n} of {body.masses[n]:.3g} kg is held by springs of {stiffness[n]:.3g} N/m and dampers "
        f"of {damping[n]:.3g} kg/s in all"
    )


def _checked_limit(steps: int | None) -> int:
    """A time limit; −1 if there is none."""
    if steps is None or (isinstance(steps, int) and steps == -1):
        return -1
    return checks.whole("max_episode_steps", steps, 1)


def _checked_ranges(
    randomize: Mapping[str, Sequence[float]], dynamics: str
) -> dict[str, tuple[float, float]]:
    ranges = {}
    for name, given in mapping("randomize", randomize).items():
        if name not in RANDOMIZABLE:
            raise ValueError(f"cannot randomize {name!r}; {', '.join(RANDOMIZABLE)} can be")
        if dynamics == "rigid" and name in OF_SPRINGS:
            raise ValueError(f"cannot randomize {name!r}: a rigid body has no springs")
        low, high = checks.array(f"randomize[{name!r}]", given, (2,), low=TINY).tolist()
        if low > high:
            raise ValueError(f"randomize[{name!r}] is {given!r}; it must be (low, high) with low ≤ high")
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
