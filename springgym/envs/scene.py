"""Environments from a scene and user-defined functions: reward, goals, ends of episodes, marks."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Unpack, overload

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import OrderEnforcing, TimeLimit
from numpy.random import Generator

from springgym import checks
from springgym.checks import TINY, chosen, instance, suggestion
from springgym.dynamics.measures import Measures, MeasuresOfBodies
from springgym.envs.arrows import torque_arrow
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.episodes import OF_PAIRS
from springgym.envs.goals import Goals, GoalTolerance, checked_tolerances, mark_reached
from springgym.envs.observation import BOUND, Entry, ObservedParticles, Situation
from springgym.envs.options import Autoreset, RewardedOptions, mapping
from springgym.envs.task import Factors, ResetOptions, Start, Task
from springgym.model.records import read_only
from springgym.model.scene import GRAVITY, Scene, WrenchActuator
from springgym.rendering import Arrow, Camera, Look, Marks, Scenery
from springgym.rendering.look import RED
from springgym.scenes import film
from springgym.simulator import STRAIN_LIMIT

__all__ = [
    "RESERVED",
    "ActuatorLimit",
    "ArrayFunction",
    "MetricsFunction",
    "SceneEnv",
    "SceneOptions",
    "SceneTask",
    "SceneVectorEnv",
    "make_scene_env",
]

WRENCH = ("force", "torque", "body_torque")
ArrayFunction = Callable[[MeasuresOfBodies, Situation], np.ndarray]
"""A function of measures and situation that returns an array of numbers or bools for all copies."""
MetricsFunction = Callable[[MeasuresOfBodies, Situation], Mapping[str, np.ndarray]]
"""A function that returns arrays (n,) by name, with a number for each of n copies."""
StartFunction = Callable[..., Start | tuple[np.ndarray, ...]]
MarksFunction = Callable[[MeasuresOfBodies, Situation], Marks]
ActuatorLimit = float | Sequence[float]
"""The force, torque or acceleration of an actuator at action 1: one number for all axes, or one for each."""

OF_ALL = (
    "is_success",
    "diverged",
    "energy",
    "energy_drift",
    "strain",
    "randomization",
    "success",
    "terminated",
)
RESERVED = (*OF_ALL, "error_bound", *OF_PAIRS)
"""Names that ``info`` and outcomes use already, besides names that begin as below."""
RESERVED_BEGINNINGS = ("reward_", "pairs_", "step_error", "_")


class SceneOptions(RewardedOptions, total=False):
    """The options of `make_scene_env` besides its own arguments."""

    goals: bool
    terminated: ArrayFunction | None
    success: ArrayFunction | None
    achieved: ArrayFunction | None
    goal_tolerances: Sequence[GoalTolerance]
    hold_steps: int
    wins: bool
    observe: ArrayFunction | None
    metrics: MetricsFunction | None
    start: StartFunction | None
    move: ArrayFunction | None
    memory: Sequence[float]
    remember: ArrayFunction | None
    period: float
    position_scale: float | None
    velocity_scale: float | None
    look: Look | None
    camera: Camera | None
    scenery: Scenery | None
    marks: MarksFunction | None


@overload
def make_scene_env(
    scene: Scene | str | Path,
    reward: ArrayFunction | MetricsFunction,
    *,
    actuators: Mapping[str, ActuatorLimit],
    num_envs: None = None,
    max_episode_steps: int | None = 500,
    **options: Unpack[SceneOptions],
) -> gym.Env[np.ndarray, np.ndarray]: ...


@overload
def make_scene_env(
    scene: Scene | str | Path,
    reward: ArrayFunction | MetricsFunction,
    *,
    actuators: Mapping[str, ActuatorLimit],
    num_envs: int,
    max_episode_steps: int | None = 500,
    autoreset_mode: Autoreset = ...,
    **options: Unpack[SceneOptions],
) -> SceneVectorEnv: ...


def make_scene_env(
    scene: Scene | str | Path,
    reward: ArrayFunction | MetricsFunction,
    *,
    actuators: Mapping[str, ActuatorLimit],
    num_envs: int | None = None,
    max_episode_steps: int | None = 500,
    **options: Any,
) -> gym.Env[np.ndarray, np.ndarray] | SceneVectorEnv:
    """Make a Gymnasium environment from a scene, or a native batch of it.

    `gymnasium.make` and `gymnasium.make_vec` make the environment again from its ``spec``. It can be pickled
    if your functions belong to a module, but it cannot be written as JSON. This call calls ``start``,
    ``reward``, ``observe``, ``metrics``, ``success``, ``terminated`` and ``achieved`` once, to find out which
    names and how many numbers they return.

    Parameters
    ----------
    scene
        A `Scene`, the name of a scene of the package, or a YAML file.
    reward
        A function ``reward(m, s)``. It is called after each step for all n copies together, and returns their
        rewards (n,), or a dict of terms (n,) by name. (With ``metrics`` it is also called when an episode
        begins.) The terms sum to the reward, and ``info`` contains them as ``reward_NAME``. ``m`` holds
        `springgym.dynamics.measures.MeasuresOfBodies`: ``m["box"].centre`` are the centres of mass (n, 3) of
        the body named "box", and ``m.centre`` those of the only body. ``s`` is a
        `springgym.envs.observation.Situation`: positions ``s.x`` and velocities ``s.v`` (n, N, 3), clipped
        actions ``s.action`` (n, A), goals ``s.goal`` (n, G), time in the episode ``s.time`` (n,) and memory
        ``s.memory`` (n, K). These arrays are read-only and change with the next step, so copy what you want
        to keep.
    actuators
        The actuators that actions drive, each with its strength at ±1: "force" [N], "torque" and
        "body_torque" [N·m] on the whole body (three entries each), "thrust" [N] (three for each
        thruster), "acceleration" [m/s²] of the drive (three). Give three numbers to set each axis. An axis
        with 0 has no entry in the action. A body without a wrench gets one. In a scene of several bodies,
        the name of the body and a dot come first: "left.force".
    num_envs
        Number of copies in a batch; None for a single environment.
    max_episode_steps
        Time limit; None for none.
    options
        Options of `SceneTask` and of `springgym.envs.base.SpringEnv`.

    Raises
    ------
    TypeError, ValueError
        If an actuator is unknown or not in the scene, a function is not callable, takes other arguments or
        returns something else, or there is no such option; the message names it.
    """
    known = {*SceneOptions.__annotations__, *(() if num_envs is None else ("autoreset_mode",))}
    for name in options:
        if name not in known:
            raise TypeError(f"make_scene_env has no option {name!r}{suggestion(name, sorted(known))}")
    if options.get("goals") is True:
        if options.get("achieved") is None:
            raise ValueError(
                "goals is True; give achieved and goal_tolerances, too: they define when a goal is reached"
            )
        if options.get("observe") is not None:
            raise ValueError(
                "goals is True and observe is given; leave observe out: the goal must not be among what is "
                "observed besides, which only the observation of particles ensures"
            )
    options |= {"scene": scene, "reward": reward, "actuators": actuators}
    spec = EnvSpec(
        id="SpringScene-v0",
        entry_point="springgym.envs.scene:SceneEnv",
        vector_entry_point="springgym.envs.scene:SceneVectorEnv",
        order_enforce=False,
        disable_env_checker=True,
        kwargs=dict(options),
    )
    if max_episode_steps is not None:
        checks.whole("max_episode_steps", max_episode_steps, 1)
    if num_envs is None:
        env: gym.Env = SceneEnv(**options)
        env.unwrapped.spec = spec
        env = OrderEnforcing(env)
        return env if max_episode_steps is None else TimeLimit(env, max_episode_steps)
    envs = SceneVectorEnv(num_envs, max_episode_steps=max_episode_steps, **options)
    spec.max_episode_steps = max_episode_steps
    spec.kwargs |= {"num_envs": num_envs, "vectorization_mode": "vector_entry_point"}
    envs.spec = spec
    return envs


class SceneTask(Task):
    """A task in a given scene.

    Parameters
    ----------
    scene, reward, actuators
        See `make_scene_env`.
    terminated, success
        Functions of (m, s), as the reward. They return bools (n,): whether the episode ends by failure, and
        whether the aim is met now.
    achieved, goal_tolerances
        Alternative to ``success``, where the aim is to reach the goal. ``achieved`` is a function of (m, s)
        that returns which goals (n, G) would be reached now, in SI units. Each
        `springgym.envs.goals.GoalTolerance` names some of the G numbers, in their order: they are reached
        together, if their distance from those of ``s.goal`` is smaller than its limit. The aim is met if all
        are reached. They allow ``goals=True``, which makes goals separate entries of observations, see
        `springgym.envs.base.SpringEnv`.
    hold_steps
        Number of consecutive steps in which the aim must be met for ``info["is_success"]``. Without an aim,
        ``info`` does not have this entry.
    wins
        Whether an episode can end by success. If so, a step in which ``terminated`` and ``success`` are both
        true is a success. Otherwise it is a failure, however long the aim was met before.
    observe
        A function of (m, s) that returns observations (n, D), scaled to order one: they are clipped to ±10.
        By default, the observation holds positions and velocities of all particles that can move, and the
        goal.
    metrics
        A function of (m, s) that returns a dict of numbers (n,). ``info`` contains them by name.
    start
        A function ``start(rng)`` that returns positions and velocities (N, 3) at the start and, if there is
        one, the goal: a fixed number of numbers. `springgym.envs.task.Start` names the three. Further
        arguments with defaults are reset options: ``start(rng, tilt=None)`` allows
        ``env.reset(options={"tilt": 0.1})``. By default, episodes start as the scene does, without a goal.
    move
        A function of (m, s) that returns new goals (n, G). It is called first after each step.
    memory
        The K numbers in ``s.memory`` at the start of an episode.
    remember
        A function of (m, s) that returns the new memory (n, K). It is called at the start of an episode, and
        after each step. Reward, ends and metrics of the step use the old memory.
    period
        Control period [s].
    position_scale, velocity_scale
        Position [m] and velocity [m/s] that are observed as 1. By default they follow from the size and the
        motion of the scene.
    look
        The look of the bodies; `springgym.scenes.film.look` makes one with colours of your choice.
    camera, scenery
        The camera, and the surroundings. By default they follow from the scene.
    marks
        Takes measures and situation of one copy (so ``s.goal`` is (G,)); returns what else is drawn. If it is
        not given, arrows show what the actions drive.
    """

    observations: ClassVar = ("particles", "own")
    actions: ClassVar = {"actuators": 0}
    terms: ClassVar[tuple[str, ...]] = ()
    metrics: ClassVar[tuple[str, ...]] = ()
    entries: tuple[Entry, ...] = ()

    def __init__(
        self,
        scene: Scene | str | Path,
        reward: ArrayFunction | MetricsFunction,
        actuators: Mapping[str, ActuatorLimit],
        terminated: ArrayFunction | None = None,
        success: ArrayFunction | None = None,
        achieved: ArrayFunction | None = None,
        goal_tolerances: Sequence[GoalTolerance] = (),
        hold_steps: int = 1,
        wins: bool = False,
        observe: ArrayFunction | None = None,
        metrics: MetricsFunction | None = None,
        start: StartFunction | None = None,
        move: ArrayFunction | None = None,
        memory: Sequence[float] = (),
        remember: ArrayFunction | None = None,
        period: float = 0.02,
        position_scale: float | None = None,
        velocity_scale: float | None = None,
        look: Look | None = None,
        camera: Camera | None = None,
        scenery: Scenery | None = None,
        marks: MarksFunction | None = None,
    ) -> None:
        super().__init__(observation="particles" if observe is None else "own")
        scene = _loaded(scene) if isinstance(scene, (str, Path)) else instance("scene", scene, Scene)
        given: dict[str, Any] = {"reward": reward, "observe": observe, "metrics": metrics}
        given |= {"success": success, "terminated": terminated, "achieved": achieved}
        given |= {"move": move, "remember": remember, "marks": marks}
        self._functions = {
            name: _function(name, function, "m", "s")
            for name, function in given.items()
            if name == "reward" or function is not None
        }
        self.hold_steps = checks.whole("hold_steps", hold_steps, 1)  # type: ignore[misc]
        self.wins = checks.flag("wins", wins)  # type: ignore[misc]
        self.period = checks.number("period", period, TINY)  # type: ignore[misc]
        self._actuators = {
            name: _most(f"actuators[{name!r}]", most)
            for name, most in mapping("actuators", actuators).items()
        }
        self._scene = _with_actuators(scene, self._actuators)
        self._thrusters = {name: _thrusters(self._scene, name) for name in self._actuators}
        each = (np.tile(most[most > 0], self._thrusters[name]) for name, most in self._actuators.items())
        self.limits = np.concatenate([*each])
        self.actions = {"actuators": len(self.limits)}  # type: ignore[misc]
        self._extent = _extent(scene)
        fastest = float(np.linalg.norm(scene.velocities, axis=1).max())
        self._scales = (
            self._extent if position_scale is None else checks.number("position_scale", position_scale, TINY),
            max(fastest, math.sqrt(-GRAVITY[2] * self._extent))
            if velocity_scale is None
            else checks.number("velocity_scale", velocity_scale, TINY),
        )
        self._start = None if start is None else _function("start", start, "rng")
        self._reset_options = () if start is None else _defaulted(start)
        self._goal = np.zeros(0) if start is None else self._start_state(np.random.default_rng(0), {})[2]
        self.goal_size = len(self._goal)  # type: ignore[misc]
        self.goal_tolerances = _checked_tolerances(goal_tolerances, self.goal_size)  # type: ignore[misc]
        if (achieved is None) != (not self.goal_tolerances):
            raise ValueError(
                f"achieved is {checks.shown(achieved)} and goal_tolerances is "
                f"{checks.shown(goal_tolerances)}; give both or neither"
            )
        if achieved is not None:
            if success is not None:
                raise ValueError("pass either achieved or success, not both")
            self.achieve = self._reached  # type: ignore[misc]
            self._goals = Goals(self.goal_tolerances)
        self.memory = checks.array("memory", memory, (None,)).tolist()  # type: ignore[misc]
        self.has_aim = achieved is not None or success is not None  # type: ignore[misc]
        if move is not None:
            if not self.goal_size:
                raise ValueError("move is given, but there is no goal to move; start must return one")
            self.move = self._moved  # type: ignore[misc]
        if (remember is None) != (not self.memory):
            raise ValueError(
                f"memory is {checks.shown(memory)} and remember is {checks.shown(remember)}; give both "
                "or neither: memory holds the initial values, and remember returns the next ones"
            )
        if remember is not None:
            self.remember = self._remembered  # type: ignore[misc]
        instance("look", look, Look, type(None))
        instance("camera", camera, Camera, type(None))
        instance("scenery", scenery, Scenery, type(None))
        if look is not None and look.particles > len(scene.masses):
            raise ValueError(f"look draws {look.particles} particles; the scene has {len(scene.masses)}")
        self._look = look
        self._camera = camera
        self._scenery = scenery

    def make_scene(self) -> Scene:
        return self._scene

    def observed_particles(self) -> ObservedParticles:
        each = zip(self._scene.bodies, self._scene.slices, strict=True)
        driven = {own.start + placed.drive.particle for placed, own in each if placed.drive}
        held = set(self._scene.pins) - driven
        moving = tuple(i for i in range(len(self._scene.masses)) if i not in held)
        return ObservedParticles(moving, *self._scales)

    def draw_starts(
        self, generators: Sequence[Generator], options: Sequence[ResetOptions], factors: Sequence[Factors]
    ) -> Start:
        each = zip(generators, options, factors, strict=True)
        positions, velocities, goals = zip(*(self._drawn(*own) for own in each), strict=True)
        return Start(np.array(positions), np.array(velocities), goals)

    def _drawn(self, rng: Generator, options: ResetOptions, factors: Factors) -> Start:
        """Draw the start of an episode."""
        if self._start is None:
            x = self._scene.positions
            v = self._scene.velocities
            goal = self._goal
        else:
            own = {name: options.pop(name) for name in self._reset_options if name in options}
            x, v, goal = self._start_state(rng, own, len(self._goal))
        if factors["scale"] != 1:
            x, v = (_scaled(self._scene, u, factors["scale"]) for u in (x, v))
        return Start(x, v, goal.tolist())

    def _start_state(
        self, rng: Generator, options: Mapping[str, Any], goal_size: int | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return positions, velocities and goal that the user's function starts with, checked."""
        assert self._start is not None
        begun = self._start(rng, **options)
        if not isinstance(begun, (tuple, list)) or len(begun) not in (2, 3):
            raise TypeError(
                f"start gave {checks.shown(begun)}; it must give positions and velocities or, with a goal, "
                "these three"
            )
        shape = self._scene.positions.shape
        x = checks.array("the positions that start gave", begun[0], shape)
        v = checks.array("the velocities that start gave", begun[1], shape)
        goal = begun[2] if len(begun) == 3 else ()
        return x, v, checks.array("the goal that start gave", goal, (goal_size,))

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        values = {}
        at = 0
        for name, most in self._actuators.items():
            count = self._thrusters[name]
            driven = most > 0
            size = count * int(driven.sum())
            part = np.zeros((len(action), count, 3))
            part[..., driven] = most[driven] * action[:, at : at + size].reshape(len(action), count, -1)
            values[name] = part if name.endswith("thrust") else part[:, 0]
            at += size
        return values

    def prepare(self, m: Measures, s: Situation) -> None:
        """Find the terms of the reward, the metrics and the size of the observation from the scene at its
        start."""
        copies = len(s.x)
        goal, memory = (read_only(np.tile(first, (copies, 1))) for first in (self._goal, self.memory))
        s = s._replace(goal=goal, memory=memory)
        with _warning_unless_diverged(m):
            self.terms = tuple(self._rewards(m, s))  # type: ignore[misc]
            self.metrics = tuple(self._metrics_now(m, s))  # type: ignore[misc]
            self._success_and_end(m, s)
            if "observe" in self._functions:
                self.entries = (Entry("own", self._numbers("observe", m, s, (copies, None)).shape[1]),)

    def evaluate(self, m: Measures, s: Situation, out: np.ndarray) -> None:
        with _warning_unless_diverged(m):
            for name, numbers in self._rewards(m, s).items():
                out[f"reward_{name}"] = numbers
            for name, values in (self._metrics_now(m, s) | self._success_and_end(m, s)).items():
                out[name] = values

    def _rewards(self, m: Measures, s: Situation) -> dict[str, np.ndarray]:
        """Return the terms of the reward."""
        given = self._functions["reward"](self._named(m), s)
        return _by_name("reward", given if isinstance(given, Mapping) else {"own": given}, m, self.terms)

    def _metrics_now(self, m: Measures, s: Situation) -> dict[str, np.ndarray]:
        """Return the metrics."""
        if "metrics" not in self._functions:
            return {}
        given = mapping("what metrics gave", self._functions["metrics"](self._named(m), s))
        for name in given:
            if name in RESERVED or str(name).startswith(RESERVED_BEGINNINGS):
                raise ValueError(
                    f"metrics gave {name!r}, but info has an entry of that name already; choose another name"
                )
        return _by_name("metrics", given, m, self.metrics)

    def _success_and_end(self, m: Measures, s: Situation) -> dict[str, np.ndarray]:
        """Return whether each copy meets the aim, and whether its episode ends by failure."""
        copies = len(s.x)
        found = dict.fromkeys(("success", "terminated"), np.zeros(copies, bool))
        for name in found:
            if judge := self._functions.get(name):
                found[name] = _of_shape(name, judge(self._named(m), s), (copies,), "b", "bools")
        if self.goal_tolerances:
            achieved, desired = np.empty((2, copies, self.goal_size))
            met = np.zeros(copies)
            self._reached(m, s, achieved, desired)
            mark_reached(achieved, desired, self._goals.ends, self._goals.within, met)
            found["success"] = met > 0
        return found

    def _reached(self, m: Measures, s: Situation, achieved: np.ndarray, desired: np.ndarray) -> None:
        """Set goals (n, G): those that are reached now, and those of the episodes."""
        achieved[:] = self._numbers("achieved", m, s, achieved.shape)
        desired[:] = s.goal

    def _moved(self, m: Measures, s: Situation, goal: np.ndarray) -> None:
        goal[:] = np.where(_not_diverged(m)[:, None], self._numbers("move", m, s, goal.shape), goal)

    def _remembered(self, m: Measures, s: Situation, memory: np.ndarray) -> None:
        given = self._numbers("remember", m, s, memory.shape)
        memory[:] = np.where(_not_diverged(m)[:, None], given, memory)

    def observe_features(self, m: Measures, s: Situation, observation: np.ndarray) -> None:
        observation[:] = np.clip(self._numbers("observe", m, s, observation.shape), -BOUND, BOUND)

    def _named(self, m: Measures) -> MeasuresOfBodies:
        return MeasuresOfBodies(m, [placed.name for placed in self._scene.bodies], self._scene.number)

    def _numbers(self, name: str, m: Measures, s: Situation, shape: tuple[int | None, ...]) -> np.ndarray:
        """Return the result of a user's function, after checking it."""
        with _warning_unless_diverged(m):
            return _numbers(name, self._functions[name](self._named(m), s), shape, m)

    def look(self) -> Look:
        return film.look(self._scene) if self._look is None else self._look

    def camera(self) -> Camera:
        if self._camera is not None:
            return self._camera
        centre = tuple(self._scene.positions.mean(axis=0).tolist())
        return Camera.framing(centre, 2.5 * self._extent)

    def scenery(self) -> Scenery:
        return super().scenery() if self._scenery is None else self._scenery

    def marks(self, m: Measures, s: Situation) -> Marks:
        if "marks" not in self._functions:
            return Marks(arrows=self._acting(self._named(m), s), key=((RED, ", ".join(self._actuators)),))
        given: Marks = instance("what marks gave", self._functions["marks"](self._named(m), s), Marks)
        return given

    def _acting(self, m: MeasuresOfBodies, s: Situation) -> list[Arrow]:
        """Return arrows for the actions: those of forces at 1 are half as long as the largest body."""
        arrows = []
        reach = 0.5 * self._extent
        for name, (values,) in self.actuate(s.action[None]).items():
            n, kind = _named(self._scene, name)
            placed = self._scene.bodies[n]
            x = s.x[self._scene.slices[n]]
            body = m[n]
            thrust = placed.thrust
            drive = placed.drive
            shares = values.reshape(-1, 3) / self._actuators[name].max()
            if kind == "body_torque" or (kind == "thrust" and thrust and thrust.turns):
                shares = shares @ np.array([body.side, np.cross(body.axis, body.side), body.axis])
            if kind.endswith("torque"):
                arrows.append(torque_arrow(body.centre, shares[0], reach))
            elif kind == "force":
                arrows.append(Arrow(body.centre, reach * shares[0]))
            elif kind == "thrust" and thrust:
                pairs = zip(thrust.particles, shares, strict=True)
                arrows += [Arrow(x[particle], reach * share) for particle, share in pairs]
            elif drive:
                arrows.append(Arrow(x[drive.particle], reach * shares[0]))
        return arrows


def _loaded(scene: str | Path) -> Scene:
    from springgym.scenes import load

    return load(str(scene)).scene


def _function(name: str, value: object, *takes: str) -> Callable[..., Any]:
    """Return a function after checking that it takes arguments ``takes``."""
    if not callable(value):
        raise TypeError(f"{name} is {checks.shown(value)}; it must be a function")
    try:
        signature = inspect.signature(value)
    except ValueError:  # some built-in functions have no signature
        return value
    try:
        signature.bind(*takes)
    except TypeError:
        raise TypeError(
            f"{name} takes {signature}; it must be called as {name}({', '.join(takes)})"
        ) from None
    return value


def _defaulted(function: Callable[..., Any]) -> tuple[str, ...]:
    """Return names of the further arguments of a function of one argument."""
    try:
        _, *others = inspect.signature(function).parameters.values()
    except ValueError:
        return ()
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return tuple(own.name for own in others if own.kind in kinds)


def _checked_tolerances(given: object, goal_size: int) -> tuple[GoalTolerance, ...]:
    """Return tolerances, which may be lists, after checking that their sizes sum to the size of the goal."""
    tolerances = checked_tolerances("goal_tolerances", given)
    if tolerances and (total := sum(own.size for own in tolerances)) != goal_size:
        raise ValueError(
            f"goal_tolerances have {total} numbers, and the goal that start gave has {goal_size}"
        )
    return tolerances


def _most(name: str, given: ActuatorLimit) -> np.ndarray:
    """Return the strength of an actuator at action 1 on each axis, (3,)."""
    if not isinstance(given, (Sequence, np.ndarray)) or isinstance(given, str) or np.ndim(given) == 0:
        return np.full(3, checks.number(name, given, TINY))
    most = checks.array(name, given, (3,), low=0.0)
    if not most.any():
        raise ValueError(f"{name} is {checks.shown(given)}; at least one axis must differ from 0")
    return most


def _by_name(
    function: str, given: Mapping[str, Any], m: Measures, names: tuple[str, ...]
) -> dict[str, np.ndarray]:
    """Return numbers (n,) by name from a function's result; ``names`` are those of its first call, if any."""
    for name in given:
        if not isinstance(name, str) or not name:
            raise TypeError(f"{function} gave an entry named {name!r}; a name must be a non-empty string")
    if not given:
        raise ValueError(f"{function} gave an empty dict; it must give at least one number by name")
    if names and set(given) != set(names):
        raise ValueError(
            f"{function} gave {', '.join(given)}, but at first it gave "
            f"{', '.join(names)}; the names must not change"
        )
    own = "own" if function == "reward" else ""
    return {
        name: _numbers(function if name == own else f"{function}, {name!r},", numbers, (len(m.strain),), m)
        for name, numbers in given.items()
    }


def _not_diverged(m: Measures) -> np.ndarray:
    """Return a mask (n,) of copies that have not diverged; results for the others are not checked."""
    sound = np.isfinite(m.energy) & (m.strain <= STRAIN_LIMIT)  # for several bodies, of each
    return sound.reshape(len(sound), -1).all(axis=1)


def _warning_unless_diverged(m: Measures) -> AbstractContextManager[None]:
    """Return a context to call functions in; it suppresses NumPy's warnings while a copy has diverged."""
    quick = np.vdot(m.strain, m.strain) < STRAIN_LIMIT**2  # then each is within its limit
    return nullcontext() if quick or _not_diverged(m).all() else np.errstate(all="ignore")


def _numbers(name: str, given: object, shape: tuple[int | None, ...], m: Measures) -> np.ndarray:
    """Return the numbers of a user's function, checked to be finite where the copy has not diverged."""
    values = _of_shape(name, given, shape, "biuf", "numbers")
    if not math.isfinite(np.vdot(values, values)):  # or they are huge
        wrong = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
        wrong &= _not_diverged(m)
        if wrong.any():
            n = int(np.argmax(wrong))
            raise ValueError(f"{name} gave {checks.shown(values[n])} for environment {n}; it must be finite")
    return values


def _of_shape(name: str, given: object, shape: tuple[int | None, ...], kinds: str, what: str) -> np.ndarray:
    try:
        values = np.array(None) if checks.hides(given) else np.asarray(given)
    except ValueError:  # rows of several lengths
        values = np.array(None)
    if values.dtype.kind not in kinds or not checks.fits(values.shape, (shape,)):
        must = str(tuple("D" if n is None else n for n in shape)).replace("'", "")
        error = TypeError if values.dtype.kind not in kinds else ValueError
        raise error(
            f"{name} gave {checks.shown(given)}; it must give {what} of shape {must}, a row for each "
            "environment"
        )
    return values


def _extent(scene: Scene) -> float:
    """Return the largest extent of a body [m]; 1 for single particles, which have none."""
    return max(float(np.ptp(placed.body.positions, axis=0).max()) for placed in scene.bodies) or 1.0


def _scaled(scene: Scene, values: np.ndarray, factor: float) -> np.ndarray:
    """Scale positions or velocities (N, 3) of bodies by a factor, about pivot or centre of mass."""
    scaled = np.array(values)
    for placed, own in zip(scene.bodies, scene.slices, strict=True):
        u = values[own]
        middle = u[placed.pivot] if placed.pivot >= 0 else np.average(u, 0, placed.body.masses)
        scaled[own] = middle + factor * (u - middle)
    return scaled


def _named(scene: Scene, name: str) -> tuple[int, str]:
    """Return the body that an actuator acts on, and the kind of the actuator."""
    if len(scene.bodies) == 1:
        return 0, name
    body, dot, kind = name.partition(".")
    names = [placed.name for placed in scene.bodies]
    if not dot:
        raise ValueError(
            f"actuators has {name!r}; of several bodies, write the body, a dot and the actuator, such as "
            f"'{names[0]}.force'"
        )
    return names.index(chosen(f"the body that actuators[{name!r}] names", body, names)), kind


def _thrusters(scene: Scene, name: str) -> int:
    """Return the number of thrusters of an actuator; 1 for other kinds."""
    body, kind = _named(scene, name)
    thrust = scene.bodies[body].thrust
    return len(thrust.particles) if kind == "thrust" and thrust else 1


def _with_actuators(scene: Scene, actuators: Mapping[str, Any]) -> Scene:
    """Return the scene with the named actuators, adding a wrench if needed."""
    if not actuators:
        raise ValueError("actuators is empty; actions must drive at least one actuator")
    bodies = list(scene.bodies)
    for name in actuators:
        body, kind = _named(scene, instance("a name in actuators", name, str))
        placed = bodies[body]
        there = {"thrust": placed.thrust, "acceleration": placed.drive}
        chosen("a name in actuators", kind, (*WRENCH, *there))
        if kind in there and there[kind] is None:
            raise ValueError(f"actuators has {name!r}, but the scene has no such actuator")
        if kind in WRENCH and placed.wrench is None:
            bodies[body] = replace(placed, wrench=WrenchActuator())
    return scene.with_(bodies=tuple(bodies))


class SceneEnv(SpringEnv, gym.Env, task=SceneTask):
    """A single environment with a given scene, see `make_scene_env`."""


class SceneVectorEnv(SpringVectorEnv, gym.vector.VectorEnv, task=SceneTask):
    """A native batch of environments with a given scene, see `make_scene_env`."""
