"""Digests of what every scene and every environment computes, to compare two commits to the bit.

    python -m tests.identity --write before.json     # on the commit before
    python -m tests.identity --compare before.json   # on the commit after, on the same machine

A case is a scene × dynamics × method × kind of batch, or an environment × observation × action × dynamics ×
kind of batch. Each of its results (positions, a measure, rewards, an entry of ``info``) has a digest.
Bits depend on the processor and the version of Numba: a file compares on the machine where it was written.
The script calls the public interface alone, so that one text of it runs on both commits.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from springgym import integrators, rigid, scenes
from springgym.bodies import cube, rope, top
from springgym.registration import ENVIRONMENTS
from springgym.scene import DriveActuator, Scene, ThrustActuator, WrenchActuator
from springgym.simulator import Simulator
from springgym.surfaces import Contact, Plane, floor

Case = Callable[[], dict[str, str]]

COPIES = 9
"""More than a block of either precision holds, and no multiple of it."""

CALLS = (13, 27)
"""Steps of the two calls of a scene."""

STEPS = 40
"""Control periods of an environment."""

METHODS = {"springs": tuple(integrators.METHODS), "rigid": tuple(rigid.METHODS)}

DRIVES = {"force": 3, "torque": 3, "body_torque": 3, "acceleration": 3}


def digest(values: Any) -> str:
    array = np.ascontiguousarray(values)
    return hashlib.sha256(f"{array.dtype}{array.shape}".encode() + array.tobytes()).hexdigest()[:16]


# --- Scenes -------------------------------------------------------------------------------------------


def own_scenes() -> dict[str, Scene]:
    """Scenes with what the files of scenes lack: actuators, and surfaces that are not alone."""
    spinner, block, line = top(), cube(), rope()
    crown, tip = spinner.parts["crown"], spinner.parts["tip"]
    wall = Plane((0.0, 0.0, 0.0), (-0.6, 0.0, 0.8))
    return {
        "own-wrench": Scene(spinner, pinned=tip, wrench=WrenchActuator(perpendicular=True)),
        "own-thrust": Scene(spinner, pinned=tip, thrust=ThrustActuator(crown, turns=True)),
        "own-free": Scene(block, gravity=None, wrench=WrenchActuator(), thrust=ThrustActuator((0, 6))),
        "own-drive": Scene(line, pinned=(0,), drive=DriveActuator(0, 2.0)),
        "own-corner": Scene(
            block,
            block.positions + np.array([0.0, 0.0, 2.0]),
            surfaces=(floor(), wall),
            contact=Contact(0.4, 0.3),
        ),
    }


def all_scenes() -> dict[str, Scene]:
    return {name: scenes.load(name).scene for name in scenes.names()} | own_scenes()


def fall(scene: Scene) -> float:
    """Return how far the scene can be moved down until its lowest particle nearly meets a surface [m]."""
    if not scene.surfaces or scene.pins:
        return 0.0

    def clear(way: float) -> bool:
        moved = scene.positions - [0.0, 0.0, way]
        return all((surface.height(moved) > 1e-3).all() for surface in scene.surfaces)

    low, high = 0.0, 10.0
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if clear(middle) else (low, middle)
    return low


def starts(scene: Scene, copies: int) -> tuple[np.ndarray, np.ndarray]:
    """The last copy, and every second before it, about to meet the surfaces; the others as the scene says."""
    rng = np.random.default_rng(0)
    shape = (copies, *scene.positions.shape)
    free = np.array([n not in scene.pins for n in range(shape[1])])[:, None]
    down = np.zeros((copies, 1, 3))
    down[copies - 1 :: -2, 0, 2] = fall(scene)
    velocities = scene.velocities + free * rng.uniform(-1e-2, 1e-2, shape)
    if down.any():
        velocities = velocities - free * np.sign(down) * 0.3
    return scene.positions - down, velocities


def play(simulator: Simulator) -> dict[str, str]:
    """Return what two unequal calls give, with all actuators driven."""
    rng = np.random.default_rng(1)
    scene, copies = simulator.scene, simulator.copies
    simulator.place(*starts(scene, copies))
    for steps in CALLS:
        given = {name: rng.uniform(-3, 3, (copies, size)) for name, size in DRIVES.items()}
        if scene.thrust:
            given["thrust"] = rng.uniform(-3, 3, (copies, len(scene.thrust.particles), 3))
        for name, value in given.items():
            try:
                simulator.actuate(**{name: value})
            except ValueError:
                continue  # the scene has no such actuator
        simulator.advance(steps, check=False)
    results = {"positions": simulator.positions, "velocities": simulator.velocities, "time": simulator.time}
    measured = {f"measures.{name}": value for name, value in simulator.measure()._asdict().items()}
    return {name: digest(value) for name, value in (results | measured).items()}


def refused_or(make: Callable[[], Simulator], run: Callable[[Simulator], dict[str, str]] = play) -> Case:
    """Run a simulator; that it cannot be made is a result, too."""

    def case() -> dict[str, str]:
        try:
            simulator = make()
        except ValueError as error:
            return {"refused": type(error).__name__}
        return run(simulator)

    return case


def varied(simulator: Simulator) -> dict[str, str]:
    """As `play`, each copy with parameters of its own."""
    rng, copies = np.random.default_rng(2), simulator.copies
    scene = simulator.scene
    every = np.arange(copies)

    def near(value: Any) -> np.ndarray:
        return value * rng.uniform(0.95, 1.0, (copies, *np.shape(value)))

    simulator.vary(every, masses=near(scene.body.masses) + 0.05 * scene.body.masses)
    simulator.vary(every, gravity=near(np.array(scene.gravity)))
    if simulator.dynamics == "springs":
        body = scene.body
        simulator.vary(
            every, stiffness=near(body.stiffness), lengths=near(body.lengths), damping=near(body.damping)
        )
    if scene.surfaces:
        simulator.vary(
            every, friction=rng.uniform(0.1, 0.6, copies), restitution=rng.uniform(0.2, 0.9, copies)
        )
    return play(simulator)


VARIED = {
    "springs": ("masses", "gravity", "stiffness", "lengths", "damping"),
    "rigid": ("masses", "gravity"),
    "surfaces": ("friction", "restitution"),
}
VARIED_SCENES = ("top", "cube-drop", "irregular-fall", "own-wrench")


KINDS = (("one", 1, np.float64), ("batch64", COPIES, np.float64), ("batch32", COPIES, np.float32))

SINGLES = ("verlet", "rk4", "suzuki")
"""Methods that run own scenes in float32, too: each costs a compilation."""


def scene_cases() -> Iterator[tuple[str, Case]]:
    for name, scene in all_scenes().items():
        for dynamics, methods in METHODS.items():
            for method in methods:
                options: dict[str, Any] = {"dynamics": dynamics, "integrator": method}
                for kind, copies, dtype in KINDS:
                    if kind == "batch32" and name.startswith("own-") and method not in SINGLES:
                        continue
                    made = partial(Simulator, scene, copies=copies, dtype=dtype, **options)
                    yield f"scene {name} {dynamics} {method} {kind}", refused_or(made)
        yield f"scene {name} paper one", refused_or(partial(Simulator.paper, scene))
        if name in VARIED_SCENES:
            for dynamics in METHODS:
                names = VARIED[dynamics] + (VARIED["surfaces"] if scene.surfaces else ())
                made = partial(
                    Simulator, scene, dynamics=dynamics, copies=COPIES, varying=names, ledger=False
                )
                yield f"scene {name} {dynamics} varied", refused_or(made, varied)


# --- Environments -------------------------------------------------------------------------------------


def numbers(info: dict[str, Any], name: str = "info") -> Iterator[tuple[str, np.ndarray]]:
    """The numbers in ``info``, by name."""
    for key, value in info.items():
        if isinstance(value, dict):
            yield from numbers(value, f"{name}.{key}")
        elif np.asarray(value).dtype.kind in "biuf":
            yield f"{name}.{key}", np.asarray(value)


def note(seen: dict[str, list[np.ndarray]], info: dict[str, Any], **results: Any) -> None:
    for name, value in (results | dict(numbers(info))).items():
        seen.setdefault(name, []).append(np.array(value))


def digests(seen: dict[str, list[np.ndarray]]) -> dict[str, str]:
    return {name: digest([digest(value) for value in values]) for name, values in seen.items()}


def single(env_id: str, **options: Any) -> dict[str, str]:
    """Return what one environment gives in the first steps of two seeds."""
    env = gym.make(env_id, **options)
    seen: dict[str, list[np.ndarray]] = {}
    for seed in (0, 1):
        rng = np.random.default_rng(seed)
        observation, info = env.reset(seed=seed)
        note(seen, info, observation=observation)
        for _ in range(STEPS):
            action = rng.uniform(-1.1, 1.1, env.action_space.shape)
            observation, reward, terminated, truncated, info = env.step(action.astype(np.float32))
            note(seen, info, observation=observation, reward=reward, terminated=terminated)
            if terminated or truncated:
                break
    env.close()
    return digests(seen)


def batch(env_id: str, **options: Any) -> dict[str, str]:
    """Return what a batch gives in its first steps, over the ends of episodes."""
    envs = gym.make_vec(
        env_id, num_envs=COPIES, vectorization_mode="vector_entry_point", max_episode_steps=25, **options
    )
    rng = np.random.default_rng(0)
    seen: dict[str, list[np.ndarray]] = {}
    observation, info = envs.reset(seed=0)
    note(seen, info, observation=observation)
    for _ in range(STEPS):
        action = rng.uniform(-1.1, 1.1, envs.action_space.shape).astype(np.float32)
        observation, reward, terminated, truncated, info = envs.step(action)
        note(seen, info, observation=observation, reward=reward, terminated=terminated, truncated=truncated)
    envs.close()
    return digests(seen)


RANGES = ("masses", "stiffness", "damping", "scale", "gravity", "friction", "restitution", "actuator")


def randomized(env_id: str, dynamics: str) -> dict[str, str]:
    """As `batch`, with all randomised that the environment lets be."""
    ranges = {}
    between = (0.95, 1.05)
    for name in RANGES:
        try:
            gym.make(env_id, dynamics=dynamics, randomize={name: between}).close()
        except ValueError:
            continue
        ranges[name] = between
    return batch(env_id, dynamics=dynamics, randomize=ranges)


RANDOMIZED = (
    ("SpringTop-v0", "springs"),
    ("SpringTumble-v0", "springs"),
    ("SpringTumble-v0", "rigid"),
    ("SpringRope-v0", "springs"),
)


def modes(env_id: str) -> tuple[list[str], list[str]]:
    """Names of an environment's observations and actions: those that it takes out of all there are."""
    row = next(row for row in ENVIRONMENTS if row.id == env_id)
    module = __import__(f"springgym.envs.{row.module}", fromlist=[row.name])
    task = getattr(module, row.name)
    return list(task.observations), list(task.actions)


def accepted_or_refused(run: Callable[..., dict[str, str]], env_id: str, **options: str) -> dict[str, str]:
    try:
        return run(env_id, **options)
    except ValueError as error:
        return {"refused": type(error).__name__}


def environment_cases() -> Iterator[tuple[str, Case]]:
    for row in ENVIRONMENTS:
        for dynamics, observation, action in product(METHODS, *modes(row.id)):
            options = {"observation": observation, "action": action, "dynamics": dynamics}
            for kind, run in (("single", single), ("batch", batch)):
                case = partial(accepted_or_refused, run, row.id, **options)
                yield f"environment {row.id} {dynamics} {observation} {action} {kind}", case
    for env_id, dynamics in RANDOMIZED:
        yield f"environment {env_id} {dynamics} randomized", partial(randomized, env_id, dynamics)
    yield "environment SpringTop-v0 float32", partial(batch, "SpringTop-v0", dtype="float32")


# --- The command --------------------------------------------------------------------------------------


def compute(only: str, found: Callable[[str, dict[str, str]], str], keep: Callable[[], None]) -> None:
    """Run the cases that ``only`` finds, and say of each what came of it."""
    began = time.perf_counter()
    for cases in (environment_cases, scene_cases):
        for name, case in cases():
            if not re.search(only, name):
                continue
            before = time.perf_counter()
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                results = case()
            verdict = found(name, results)
            now = time.perf_counter()
            print(f"{now - began:7.0f} s  {name} ({now - before:.1f} s) {verdict}", flush=True)
            keep()


def compared(reference: dict[str, str] | None, results: dict[str, str]) -> tuple[bool, str]:
    """Tell whether results equal those of the reference, and name the results that differ."""
    if reference is None:
        return True, "NEW"
    gone = sorted(reference.keys() - results.keys())
    differ = [name for name in reference if name in results and results[name] != reference[name]]
    new = sorted(results.keys() - reference.keys())
    words = [f"DIFFERS in {', '.join(differ)}"] if differ else []
    words += [f"LACKS {', '.join(gone)}"] if gone else []
    words += [f"new: {', '.join(new)}"] if new else []
    return not differ and not gone, "; ".join(words) or "same"


def main() -> int:
    assert __doc__
    parser = argparse.ArgumentParser(prog="python -m tests.identity", description=__doc__.partition("\n")[0])
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--write", type=Path, help="file for the digests; those of other cases stay")
    what.add_argument("--compare", type=Path, help="file of digests to compare with")
    parser.add_argument("--only", default="", help="cases whose name this regular expression finds")
    args = parser.parse_args()
    path = args.write or args.compare
    known: dict[str, dict[str, str]] = (
        json.loads(path.read_text(encoding="utf-8")) if args.compare or path.exists() else {}
    )
    bad: list[str] = []
    seen: set[str] = set()

    def found(name: str, results: dict[str, str]) -> str:
        seen.add(name)
        if args.write:
            known[name] = results
            return "refused" if "refused" in results else ""
        same, words = compared(known.get(name), results)
        if not same:
            bad.append(name)
        return words

    def keep() -> None:
        if args.write:
            path.write_text(json.dumps(known, indent=0, sort_keys=True), encoding="utf-8")

    compute(args.only, found, keep)
    if args.write:
        print(f"{len(seen)} cases written to {path}")
        return 0
    bad += [f"{name}: not run" for name in known if name not in seen and re.search(args.only, name)]
    print(f"{len(seen)} cases, {len(bad)} not as in {path}", *bad, sep="\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
