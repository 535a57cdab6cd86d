"""Digests of what every environment and every scene computes, to compare two commits to the bit.

    python tools/identity.py --write before.json     # on the commit before
    python tools/identity.py --compare before.json   # on the commit after, on the same machine

Each result (positions, a measure, rewards, an entry of ``info``) of each case has a digest. Bits depend on
the processor and the version of Numba: a file compares on the machine where it was written. The script calls
the public interface alone, so that one text of it runs on both commits.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import sys
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from springgym import scenes
from springgym.cli import check_new, guarded, write_text
from springgym.dynamics import methods as integrators
from springgym.dynamics import rigid
from springgym.envs.registration import ALL_IDS
from springgym.scenes.strict_yaml import read_json
from springgym.simulator import Simulator

Results = dict[str, str]

COPIES = 20
"""More than a block of either precision holds, and no multiple of it."""

PERIODS = 60
"""Control periods of an environment."""

CALLS = (13, 47)
"""Steps of the two calls of a scene."""

OPTIONS: dict[str, dict[str, Any]] = {
    "float64": {},
    "float32": {"dtype": "float32"},
    "features": {"observation": "features"},
    "rigid": {"dynamics": "rigid"},
    "randomised": {"randomize": {"masses": (0.95, 1.05), "gravity": (0.95, 1.05), "actuator": (0.9, 1.0)}},
}
"""Of a batch of each environment; what an environment refuses is a result, too."""

EVERY_METHOD = ("top", "cube-pendulum", "rope-swing")
"""Scenes that are computed by all methods."""


def digest(*values: Any) -> str:
    found = hashlib.sha256()
    for array in map(np.ascontiguousarray, values):
        found.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    return found.hexdigest()[:16]


def numbers(info: dict[str, Any], name: str = "info") -> Iterator[tuple[str, np.ndarray]]:
    """Yield the numbers in ``info``, by name."""
    for key, value in info.items():
        if isinstance(value, dict):
            yield from numbers(value, f"{name}.{key}")
        elif np.asarray(value).dtype.kind in "biuf":
            yield f"{name}.{key}", np.array(value)


def environment(env_id: str, copies: int | None, **options: Any) -> Results:
    """Play one environment, or a batch, with actions at random, over the ends of episodes."""
    options |= {"max_episode_steps": 25}
    how: dict[str, Any] = {"num_envs": copies, "vectorization_mode": "vector_entry_point"}
    env: Any = gym.make(env_id, **options) if copies is None else gym.make_vec(env_id, **how, **options)
    rng = np.random.default_rng(0)
    observation, info = env.reset(seed=0)
    seen: dict[str, list[np.ndarray]] = {}
    for _ in range(PERIODS):
        action = rng.uniform(-1.1, 1.1, env.action_space.shape).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        found = {"observation": observation, "reward": reward, "terminated": terminated}
        for name, value in (found | dict(numbers(info))).items():
            seen.setdefault(name, []).append(np.array(value))
        if copies is None and (terminated or truncated):
            env.reset()
    return {name: digest(*values) for name, values in seen.items()}


def scene(name: str, **options: Any) -> Results:
    """Simulate copies of a scene that start a little otherwise than each other, in two unequal calls."""
    simulator = Simulator(scenes.load(name).scene, unresolved="count", **options)
    free = np.isin(np.arange(len(simulator.scene.masses)), simulator.scene.pins, invert=True)[:, None]
    shape = simulator.velocities.shape
    jitter = np.random.default_rng(0).uniform(-1e-2, 1e-2, shape).astype(simulator.dtype)
    simulator.place(simulator.positions, simulator.velocities + free * jitter)
    for steps in CALLS:
        simulator.advance(steps, check=False)
    measured = {f"measures.{key}": value for key, value in simulator.measure()._asdict().items()}
    found = {"positions": simulator.positions, "velocities": simulator.velocities} | measured
    return {key: digest(value) for key, value in found.items()}


def cases() -> Iterator[tuple[str, Callable[[], Results]]]:
    for env_id in ALL_IDS:
        yield f"environment {env_id} single", partial(environment, env_id, None)
        for kind, options in OPTIONS.items():
            yield f"environment {env_id} {kind}", partial(environment, env_id, COPIES, **options)
    for name in scenes.names():
        yield f"scene {name} single", partial(scene, name)
        for dtype in ("float64", "float32"):
            yield f"scene {name} {dtype}", partial(scene, name, copies=COPIES, dtype=dtype)
    for name in EVERY_METHOD:
        for dynamics, methods in {"springs": integrators.METHODS, "rigid": rigid.METHODS}.items():
            for method in methods:
                made = partial(scene, name, copies=COPIES, dynamics=dynamics, integrator=method)
                yield f"scene {name} {dynamics} {method}", made


def computed(case: Callable[[], Results]) -> Results:
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            return case()
        except (ValueError, TypeError) as error:
            return {"refused": type(error).__name__}


def main() -> int:
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--write", type=Path, help="file for the digests; those of other cases stay")
    what.add_argument("--compare", type=Path, help="file of digests to compare with")
    parser.add_argument("--only", default="", help="cases whose name this regular expression finds")
    args = parser.parse_args()
    return guarded("identity.py", lambda: _identity(args))


def _identity(args: argparse.Namespace) -> int:
    path = args.write or args.compare
    if args.write:
        check_new(path)
    known: dict[str, Results] = read_json(path) if args.compare or path.exists() else {}
    wanted = {name: case for name, case in cases() if re.search(args.only, name)}
    gone = [] if args.write else [name for name in known.keys() - wanted if re.search(args.only, name)]
    bad = [f"{name}: not run" for name in gone]
    for name, case in wanted.items():
        results = computed(case)
        before = results if args.write else known.get(name, results)
        differ = [key for key in before.keys() | results.keys() if before.get(key) != results.get(key)]
        print(name, f"DIFFERS in {', '.join(sorted(differ))}" if differ else "", flush=True)
        if args.write:
            known[name] = results
            write_text(path, json.dumps(known, indent=0, sort_keys=True))
        elif differ:
            bad.append(name)
    print(f"{len(wanted)} cases", *([] if args.write else [f"{len(bad)} not as in {path}", *bad]), sep="\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
