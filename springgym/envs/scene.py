"""Environments over a user's own scene: actuators of theirs, a reward function of theirs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Unpack, overload

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import OrderEnforcing, TimeLimit
from numpy.random import Generator

from springgym import checks
from springgym.checks import TINY, chosen, instance
from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.observation import BOUND, Entry, ObservedParticles, Situation
from springgym.envs.options import Autoreset, RewardedOptions, mapping
from springgym.envs.task import Start, Task
from springgym.measures import Measures
from springgym.rendering import Camera, Look, Marks, Scenery
from springgym.scene import Scene, WrenchActuator
from springgym.scenes import film
from springgym.simulator import STRAIN_LIMIT

WRENCH = ("force", "torque", "body_torque")
LOUD = nullcontext()
Reward = Callable[[Measures, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
Seeing = Callable[[Measures, np.ndarray, np.ndarray], np.ndarray]
Starting = Callable[[Generator], tuple[np.ndarray, np.ndarray]]


class SceneOptions(RewardedOptions, total=False):
    """List what `make_scene_env` takes beside its own arguments."""

    failed: Seeing | None
    succeeded: Seeing | None
    hold: int
    wins: bool
    observe: Seeing | None
    start: Starting | None
    period: float
    position_scale: float | None
    velocity_scale: float | None


@overload
def make_scene_env(
    scene: Scene | str | Path,
    reward: Reward,
    *,
    actuators: Mapping[str, float],
    num_envs: None = None,
    max_episode_steps: int | None = 500,
    **options: Unpack[SceneOptions],
) -> gym.Env[np.ndarray, np.ndarray]: ...


@overload
def make_scene_env(
    scene: Scene | str | Path,
    reward: Reward,
    *,
    actuators: Mapping[str, float],
    num_envs: int,
    max_episode_steps: int | None = 500,
    autoreset_mode: Autoreset = ...,
    **options: Unpack[SceneOptions],
) -> SceneVectorEnv: ...


def make_scene_env(
    scene: Scene | str | Path,
    reward: Reward,
    *,
    actuators: Mapping[str, float],
    num_envs: int | None = None,
    max_episode_steps: int | None = 500,
    **options: Any,
) -> gym.Env[np.ndarray, np.ndarray] | SceneVectorEnv:
    """Make a Gymnasium environment over a scene, or a native batch of it.

    Its ``spec`` makes it again, with `gymnasium.make` or `gymnasium.make_vec`. It pickles if the functions
    are those of a module; JSON has no functions.

    Parameters
    ----------
    scene
        A `Scene`, the name of a shipped one, or a YAML file; reading those needs the extra ``scenes``.
    reward
        Takes the `Measures`, positions and velocities (n, N, 3) and clipped actions (n, A) of all copies
        after a step; returns their rewards (n,). These arrays cannot be written to, and change with the next
        step: copy what is to be kept.
    actuators
        What the actions drive, and with how much at ±1: "force" [N], "torque", "body_torque" [N·m] on the
        whole body (three entries each), "thrust" [N] (three for each of its thrusters), "acceleration"
        [m/s²] of its drive (three). A wrench is added to a body that has none. Of several bodies, the body
        is named before a dot: "left.force".
    num_envs
        None for a single environment, else how many in a batch.
    max_episode_steps
        Time limit; None for none.
    options
        Of `SceneTask` and of `springgym.envs.base.SpringEnv`.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong: an actuator that is unknown or not in the scene, a function that is none.
    """
    options |= {"scene": scene, "reward": reward, "actuators": actuators}
    spec = EnvSpec(
        id="SpringScene-v0",
        entry_point="springgym.envs.scene:SceneEnv",
        vector_entry_point="springgym.envs.scene:SceneVectorEnv",
        order_enforce=False,
        disable_env_checker=True,
        kwargs=dict(options),
    )
    if num_envs is None:
        env: gym.Env = SceneEnv(**options)
        env.unwrapped.spec = spec
        env = OrderEnforcing(env)
        if max_episode_steps is None:
            return env
        return TimeLimit(env, checks.whole("max_episode_steps", max_episode_steps, 1))
    envs = SceneVectorEnv(num_envs, max_episode_steps=max_episode_steps, **options)
    spec.max_episode_steps = max_episode_steps
    spec.kwargs |= {"num_envs": num_envs, "vectorization_mode": "vector_entry_point"}
    envs.spec = spec
    return envs


class SceneTask(Task):
    """Make a task of a given scene.

    Parameters
    ----------
    scene, reward, actuators
        See `make_scene_env`.
    failed, succeeded
        Take `Measures`, positions and velocities of all copies; return bools (n,): whether the episode ends,
        and whether the aim is met now.
    hold
        Steps in a row that the aim must be met for ``info["is_success"]``.
    wins
        Whether an episode may end by success: where ``failed`` and ``succeeded`` are both true, it is won.
        Else it is lost there, however long the aim was met before.
    observe
        Takes the same; returns what is observed (n, D), scaled to order one: it is clipped to ±10. Positions
        and velocities of all particles that can move, if not given.
    start
        Takes a random generator, returns positions and velocities (N, 3) to start from; the scene's own
        start if not given.
    period
        Control period [s].
    position_scale, velocity_scale
        Observed as 1 [m], [m/s]; derived from size and motion of the scene if not given.
    """

    observations: ClassVar = ("particles", "own")
    actions: ClassVar = {"actuators": 0}
    terms = ("own",)
    metrics = ()
    entries: tuple[Entry, ...] = ()
    apart = False

    def __init__(
        self,
        scene: Scene | str | Path,
        reward: Reward,
        actuators: Mapping[str, float],
        failed: Seeing | None = None,
        succeeded: Seeing | None = None,
        hold: int = 1,
        wins: bool = False,
        observe: Seeing | None = None,
        start: Starting | None = None,
        period: float = 0.02,
        position_scale: float | None = None,
        velocity_scale: float | None = None,
    ) -> None:
        super().__init__("particles" if observe is None else "own", "actuators")
        scene = _loaded(scene) if isinstance(scene, (str, Path)) else instance("scene", scene, Scene)
        self._reward = _callable("reward", reward)
        given = {"failed": failed, "succeeded": succeeded, "observe": observe, "start": start}
        for name, function in given.items():
            if function is not None:
                _callable(name, function)
        self._observe, self._start = observe, start
        self._judges = (("met", "succeeded", succeeded), ("failed", "failed", failed))
        self.hold = checks.whole("hold", hold, 1)  # type: ignore[misc]
        self.wins = checks.flag("wins", wins)  # type: ignore[misc]
        self.period = checks.number("period", period, TINY)  # type: ignore[misc]
        self._actuators = {
            name: checks.number(f"actuators[{name!r}]", most, TINY)
            for name, most in mapping("actuators", actuators).items()
        }
        self._scene = _acted_on(scene, self._actuators)
        self._sizes = {name: 3 * _thrusters(self._scene, name) for name in self._actuators}
        self.actions = {"actuators": sum(self._sizes.values())}  # type: ignore[misc]
        self._extent = _extent(scene)
        fastest = float(np.linalg.norm(scene.velocities, axis=1).max())
        self._scales = (
            self._extent if position_scale is None else checks.number("position_scale", position_scale, TINY),
            max(fastest, math.sqrt(9.81 * self._extent))
            if velocity_scale is None
            else checks.number("velocity_scale", velocity_scale, TINY),
        )

    @property
    def scene(self) -> Scene:
        return self._scene

    @cached_property
    def particles(self) -> ObservedParticles:
        scene, count = self._scene, len(self._scene.masses)
        each = zip(scene.bodies, scene.slices, strict=True)
        held = set(scene.pins) - {own.start + placed.drive.particle for placed, own in each if placed.drive}
        moving = tuple(i for i in range(count) if i not in held)
        return ObservedParticles(moving, np.full(count, self._scales[0]), np.full(count, self._scales[1]))

    def start(self, rng: Generator, options: dict[str, Any], factors: Mapping[str, float]) -> Start:
        x, v = self._scene.positions, self._scene.velocities
        if self._start is not None:
            begun = self._start(rng)
            if not isinstance(begun, (tuple, list)) or len(begun) != 2:
                raise TypeError(f"start gave {checks.shown(begun)}; it must give positions and velocities")
            shape = x.shape
            x = checks.array("the positions that start gave", begun[0], shape)
            v = checks.array("the velocities that start gave", begun[1], shape)
        if factors["scale"] != 1:
            x, v = (_scaled(self._scene, u, factors["scale"]) for u in (x, v))
        return Start(x, v)

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        values, at = {}, 0
        for name, size in self._sizes.items():
            part = self._actuators[name] * action[:, at : at + size]
            values[name] = part.reshape(len(action), -1, 3) if name.endswith("thrust") else part
            at += size
        return values

    def evaluate(self, m: Measures, s: Situation, out: np.ndarray) -> None:
        shape = (len(out),)
        with _hearing(m):
            out["reward_own"] = _numbers("reward", self._reward(m, s.x, s.v, s.action), shape, m)
            for field, name, judge in self._judges:
                given = np.zeros(shape, bool) if judge is None else judge(m, s.x, s.v)
                out[field] = _of_shape(name, given, shape, "b", "bools")

    def compact(self, m: Measures, s: Situation, observation: np.ndarray) -> None:
        observation[:] = np.clip(self._seen(m, s, observation.shape), -BOUND, BOUND)

    def prepare(self, m: Measures, s: Situation) -> None:
        if self._observe is not None:
            size = self._seen(m, s, (len(s.x), None)).shape[1]
            self.entries = (Entry("own", size),)

    def _seen(self, m: Measures, s: Situation, shape: tuple[int | None, ...]) -> np.ndarray:
        assert self._observe is not None
        with _hearing(m):
            return _numbers("observe", self._observe(m, s.x, s.v), shape, m)

    def look(self) -> Look:
        return film.look(self._scene, None)

    def camera(self) -> Camera:
        centre = tuple(self._scene.positions.mean(axis=0).tolist())
        return Camera.framing(centre, 2.5 * self._extent)

    def scenery(self) -> Scenery:
        return film.surfaces(self._scene)

    def marks(self, m: Measures, x: np.ndarray, action: np.ndarray, goal: np.ndarray) -> Marks:
        return Marks()


def _loaded(scene: str | Path) -> Scene:
    from springgym.scenes import load  # which needs PyYAML

    return load(str(scene)).scene


def _callable(name: str, value: Any) -> Any:
    if not callable(value):
        raise TypeError(f"{name} is {checks.shown(value)}; it must be a function")
    return value


def _sound(m: Measures) -> np.ndarray:
    """Which copies have not diverged (n,): of the others, functions may say what they like."""
    return np.isfinite(m.energy) & (m.strain <= STRAIN_LIMIT)


def _hearing(m: Measures) -> AbstractContextManager[None]:
    """Where functions are called: warnings are not heard while a copy has diverged."""
    quick = m.strain.dot(m.strain) < STRAIN_LIMIT**2  # then each is within its limit
    return LOUD if quick or _sound(m).all() else np.errstate(all="ignore")


def _numbers(name: str, given: object, shape: tuple[int | None, ...], m: Measures) -> np.ndarray:
    """What a function gave, as numbers that are finite where the copy has not diverged."""
    values = _of_shape(name, given, shape, "biuf", "numbers")
    if not math.isfinite(np.vdot(values, values)):  # or they are huge
        wrong = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
        wrong &= _sound(m)
        if wrong.any():
            n = int(np.argmax(wrong))
            raise ValueError(f"{name} gave {checks.shown(values[n])} for copy {n}; it must be finite")
    return values


def _of_shape(name: str, given: object, shape: tuple[int | None, ...], kinds: str, what: str) -> np.ndarray:
    try:
        values = np.asarray(given)
    except ValueError:  # rows of several lengths
        values = np.array(None)
    fits = values.shape == shape or (
        values.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, values.shape, strict=True))
    )
    if values.dtype.kind not in kinds or not fits:
        must = str(tuple("D" if n is None else n for n in shape)).replace("'", "")
        error = TypeError if values.dtype.kind not in kinds else ValueError
        raise error(
            f"{name} gave {checks.shown(given)}; it must give {what} of shape {must}, a row for each copy"
        )
    return values


def _extent(scene: Scene) -> float:
    """The largest extent of a body [m]; 1 of single particles, which have none."""
    return max(float(np.ptp(placed.body.positions, axis=0).max()) for placed in scene.bodies) or 1.0


def _scaled(scene: Scene, values: np.ndarray, factor: float) -> np.ndarray:
    """Positions or velocities (N, 3) of bodies that are larger by a factor, about pivot or centre of mass."""
    scaled = np.array(values)
    for placed, own in zip(scene.bodies, scene.slices, strict=True):
        u = values[own]
        middle = u[placed.pivot] if placed.pivot >= 0 else np.average(u, 0, placed.body.masses)
        scaled[own] = middle + factor * (u - middle)
    return scaled


def _named(scene: Scene, name: str) -> tuple[int, str]:
    """The body that an actuator acts on, and the kind of the actuator."""
    if len(scene.bodies) == 1:
        return 0, name
    body, _, kind = name.partition(".")
    names = [placed.name for placed in scene.bodies]
    return names.index(chosen(f"the body that actuators[{name!r}] names", body, names)), kind


def _thrusters(scene: Scene, name: str) -> int:
    """How many thrusters an actuator has; anything else is one."""
    body, kind = _named(scene, name)
    thrust = scene.bodies[body].thrust
    return len(thrust.particles) if kind == "thrust" and thrust else 1


def _acted_on(scene: Scene, actuators: Mapping[str, float]) -> Scene:
    """The scene with the actuators that are named, a wrench added if need be."""
    if not actuators:
        raise ValueError("actuators is empty; the actions must drive something")
    bodies = list(scene.bodies)
    for name in actuators:
        body, kind = _named(scene, instance("a name in actuators", name, str))
        placed = bodies[body]
        there = {"thrust": placed.thrust, "acceleration": placed.drive}
        chosen("a name in actuators", kind, (*WRENCH, *there))
        if kind in there and there[kind] is None:
            raise ValueError(f"actuators has {name!r}, but the scene has nothing that it could drive")
        if kind in WRENCH and placed.wrench is None:
            bodies[body] = replace(placed, wrench=WrenchActuator())
    return scene.with_(bodies=tuple(bodies))


class SceneEnv(SpringEnv, gym.Env):
    """Run one environment over a scene, see `make_scene_env`."""

    task_type = SceneTask


class SceneVectorEnv(SpringVectorEnv, gym.vector.VectorEnv):
    """Run a native batch over a scene, see `make_scene_env`."""

    task_type = SceneTask
