"""Environments over a user's own scene: actuators of theirs, a reward function of theirs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import OrderEnforcing, TimeLimit
from numpy.random import Generator

from springgym.envs.base import SpringEnv, SpringVectorEnv
from springgym.envs.task import Particles, Start, Task
from springgym.measures import Measures
from springgym.rendering import Camera, Look, Marks, Scenery
from springgym.scene import Scene, WrenchActuator
from springgym.scenes import film, load
from springgym.surfaces import Dish, Plane

WRENCH = ("force", "torque", "body_torque")
Reward = Callable[[Measures, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
Ending = Callable[[Measures, np.ndarray, np.ndarray], np.ndarray]
Starting = Callable[[Generator], tuple[np.ndarray, np.ndarray]]


def make_scene_env(
    scene: Scene | str | Path,
    reward: Reward,
    *,
    actuators: Mapping[str, float],
    num_envs: int | None = None,
    max_episode_steps: int = 500,
    **options: Any,
) -> gym.Env | gym.vector.VectorEnv:
    """Make a Gymnasium environment over a scene, or a native batch of it.

    Parameters
    ----------
    scene
        A `Scene`, the name of a shipped one, or a YAML file.
    reward
        Takes the `Measures`, positions and velocities (n, N, 3) and clipped actions (n, A) of all copies
        after a step; returns their rewards (n,).
    actuators
        What the actions drive, and with how much at ±1: "force" [N], "torque", "body_torque" [N·m] on the
        whole body (three entries each), "thrust" [N] (three for each of the scene's thrusters),
        "acceleration" [m/s²] of its drive (three). A wrench is added to a scene that has none.
    num_envs
        None for a single environment, with a time limit; else how many in a batch.
    max_episode_steps
        Time limit.
    options
        Of `SceneTask` and of `springgym.envs.base.SpringEnv`.

    Raises
    ------
    ValueError
        If an actuator is unknown, or is not in the scene.
    """
    if isinstance(scene, (str, Path)):
        scene = load(str(scene)).scene
    options |= {"scene": scene, "reward": reward, "actuators": actuators}
    if num_envs is None:
        return TimeLimit(OrderEnforcing(SceneEnv(**options)), max_episode_steps)
    return SceneVectorEnv(num_envs, max_episode_steps=max_episode_steps, **options)


class SceneTask(Task):
    """A task over a given scene.

    Parameters
    ----------
    scene, reward, actuators
        See `make_scene_env`.
    failed
        Takes `Measures`, positions and velocities of all copies, returns which episodes end (n,).
    start
        Takes a random generator, returns positions and velocities (N, 3) to start from; the scene's own
        start if not given.
    period
        Control period [s].
    position_scale, velocity_scale
        Observed as 1 [m], [m/s]; derived from size and motion of the scene if not given.
    """

    observations: ClassVar = ("particles",)
    actions: ClassVar = {"actuators": 0}
    terms = ("own",)
    metrics = ()
    frame_size = 0

    def __init__(
        self,
        scene: Scene,
        reward: Reward,
        actuators: Mapping[str, float],
        failed: Ending | None = None,
        start: Starting | None = None,
        period: float = 0.02,
        position_scale: float | None = None,
        velocity_scale: float | None = None,
    ) -> None:
        super().__init__("particles", "actuators")
        self.period = period  # type: ignore[misc]
        self._reward, self._failed, self._start = reward, failed, start
        self._actuators = dict(actuators)
        self._scene = _acted_on(scene, self._actuators)
        thrusters = len(scene.thrust.particles) if scene.thrust else 0
        self._sizes = {name: 3 * thrusters if name == "thrust" else 3 for name in self._actuators}
        self.actions = {"actuators": sum(self._sizes.values())}  # type: ignore[misc]
        self._size = float(np.ptp(scene.body.positions, axis=0).max())
        fastest = float(np.linalg.norm(scene.velocities, axis=1).max())
        self._scales = (
            position_scale or self._size,
            velocity_scale or max(fastest, math.sqrt(9.81 * self._size)),
        )

    @property
    def scene(self) -> Scene:
        return self._scene

    @cached_property
    def particles(self) -> Particles:
        scene, count = self._scene, len(self._scene.body.masses)
        held = set(scene.pinned) - ({scene.drive.particle} if scene.drive else set())
        moving = tuple(i for i in range(count) if i not in held)
        return Particles(moving, np.full(count, self._scales[0]), np.full(count, self._scales[1]))

    def start(self, rng: Generator, options: dict[str, Any], factors: Mapping[str, float]) -> Start:
        scene = self._scene
        x, v = (scene.positions, scene.velocities) if self._start is None else self._start(rng)
        if factors["scale"] != 1:
            x, v = (self._middle(u) + factors["scale"] * (u - self._middle(u)) for u in (x, v))
        return Start(x, v)

    def _middle(self, values: np.ndarray) -> np.ndarray:
        """Values (N, 3) at the pivot, or their mean by mass: what a scale leaves."""
        scene = self._scene
        return values[scene.pivot] if scene.pivot >= 0 else np.average(values, 0, scene.body.masses)

    def actuate(self, action: np.ndarray) -> dict[str, np.ndarray]:
        values, at = {}, 0
        for name, size in self._sizes.items():
            part = self._actuators[name] * action[:, at : at + size]
            values[name] = part.reshape(len(action), -1, 3) if name == "thrust" else part
            at += size
        return values

    def evaluate(
        self,
        m: Measures,
        x: np.ndarray,
        v: np.ndarray,
        action: np.ndarray,
        goal: np.ndarray,
        parameters: np.ndarray,
        out: np.ndarray,
    ) -> None:
        out[:, 0] = self._reward(m, x, v, action)
        out[:, 1] = 0.0
        out[:, 2] = 0.0 if self._failed is None else self._failed(m, x, v)

    def look(self) -> Look:
        return film.look(self._scene.body, None)

    def camera(self) -> Camera:
        centre = tuple(self._scene.positions.mean(axis=0).tolist())
        return Camera.framing(centre, 2.5 * self._size)

    def scenery(self) -> Scenery:
        planes = tuple((s.point, s.normal) for s in self._scene.surfaces if isinstance(s, Plane))
        dishes = [(s.centre, s.radius) for s in self._scene.surfaces if isinstance(s, Dish)]
        return Scenery(planes=planes, dish=dishes[0] if dishes else None)

    def marks(self, m: Measures, x: np.ndarray, action: np.ndarray, goal: np.ndarray) -> Marks:
        return Marks()


def _acted_on(scene: Scene, actuators: Mapping[str, float]) -> Scene:
    """The scene with the actuators that are named, a wrench added if need be."""
    there = {"thrust": scene.thrust, "acceleration": scene.drive}
    for name in actuators:
        if name not in (*WRENCH, *there):
            raise ValueError(f"actuator {name!r} is unknown; it is one of {', '.join((*WRENCH, *there))}")
        if name in there and there[name] is None:
            raise ValueError(f"the scene has nothing that {name!r} could drive")
    if scene.wrench is None and set(actuators) & set(WRENCH):
        return scene.with_(wrench=WrenchActuator())
    return scene


class SceneEnv(SpringEnv, gym.Env):
    """One environment over a scene: see `make_scene_env`."""

    task_type = SceneTask


class SceneVectorEnv(SpringVectorEnv, gym.vector.VectorEnv):
    """A native batch over a scene: see `make_scene_env`."""

    task_type = SceneTask
