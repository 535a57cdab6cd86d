"""Steps environments at random for as long as one likes, and checks every step.

    python -m tools.fuzz --steps 1e8
    python -m tools.fuzz --seed 4711 --rounds 1        # one round again, as its line says

Each round draws, from its own seed, which is printed, how an environment is played (copies, threads, reset
mode), and what is done with it: actions that are uniform, at the bounds, held, off and far beyond; resets of
all copies or some, with options; states set and copies made in mid-episode. The environment and its arguments
(observation, action mode, dynamics, precision, variant, randomisation) are those of `--repeats` rounds in a
row: to compile one takes longer than to play it.

Checked are: observations in their space, rewards in [0, 1] and the sum of their terms, info finite, no
divergence, an energy drift within `DRIFT`, no contact missed, no warning; one copy of a batch against a
single environment, to the bit. The exit status is 1 if a round failed.
"""

from __future__ import annotations

import argparse
import copy
import re
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.random import Generator

import springgym
from springgym.envs.randomisation import OF_SPRINGS, RANDOMIZABLE
from springgym.envs.registration import VARIANTS
from springgym.scenes import load, names
from tests.envs.cases import IDS, TWINLESS, task_type

DRIFT, ROUGH_DRIFT = 0.05, 0.25
"""Energy drifts [1] that are too much, as shares of the largest kinetic, elastic and contact energy so far:
in double precision; and in single precision, or where there are surfaces. A rigid body that falls from 5 m
can be off by 8 %, by 0.1 % with steps 16 times finer; a cube of springs that strikes edge first by 6 %."""

QUIVER = 1e-4
"""Way that a body may fall without the energy being noticed, as a share of its size."""

COPIES = (None, None, 1, 2, 3, 8, 9, 17, 64, 257, 1024)
"""Numbers of copies; None is a single environment, as `gymnasium.make` gives it."""

FURTHER: dict[str, tuple[dict[str, Any], ...]] = {
    "SpringTop-v0": ({"body": {"scaled": {"0": 1.1}}}, {"body": {"height": 1.25}}),
    "SpringGyroscope-v0": ({"body": {"ring": 7}},),
    "SpringPendulum-v0": ({"start": "mixed"}, {"body": {"side": 0.7}}),
    "SpringDetumble-v0": ({"body": {"mass": 1.0}},),
    "SpringRope-v0": ({"hard": True}, {"body": {"beads": 5}}),
    "SpringTumble-v0": ({"friction": 0.3},),
    "SpringFreeTop-v0": ({"hard": True}, {"surface": "bowl"}),
    "SpringBalance-v0": ({"hard": True}, {"restitution": 0.8}),
    "SpringShove-v0": ({"friction": 0.3},),
    "SpringStack-v0": ({"step": 6.25e-4},),
    "SpringJuggle-v0": ({"hard": True}, {"restitution": 0.85}),
    "SpringLabyrinth-v0": ({"observation": "features"},),
    "SpringTower-v0": ({"blocks": 2},),
    "SpringBilliards-v0": ({},),
    "SpringDuel-v0": ({"opponent": "still"},),
}
"""Arguments beside the usual ones and those of the registry's variants."""

LENGTH = 300
"""Control periods in a round."""

REPEATS = 8
"""Rounds in a row of one environment with the same arguments."""


class Round(NamedTuple):
    """What is fuzzed in a round."""

    env_id: str
    arguments: dict[str, Any]
    copies: int | None
    autoreset: str
    threads: int

    def __str__(self) -> str:
        how = (
            "single"
            if self.copies is None
            else f"{self.copies} copies, {self.autoreset}, threads={self.threads}"
        )
        return f"{self.env_id} {self.arguments} {how}"


def offered(only: str) -> list[str]:
    """Ids of environments, and names of scenes, that have this in them."""
    return [env_id for env_id in [*IDS, *(f"scene {name}" for name in names())] if only in env_id]


def drawn(rng: Generator, env_id: str, arguments: dict[str, Any]) -> Round:
    """Draw how a round plays an environment."""
    copies = COPIES[rng.integers(len(COPIES))]
    autoreset = str(rng.choice(["NextStep", "SameStep", "Disabled"]))
    return Round(env_id, arguments, copies, autoreset, int(rng.integers(1, 3)))


def environment(rng: Generator, only: str) -> tuple[str, dict[str, Any]]:
    """Draw an environment and its arguments."""
    ids = offered(only)
    weights = np.array([1.0 if env_id in IDS else 0.05 for env_id in ids])
    env_id = str(rng.choice(ids, p=weights / weights.sum()))
    arguments: dict[str, Any] = {"dtype": "float64" if rng.uniform() < 0.7 else "float32"}
    if env_id in IDS:
        task = task_type(env_id)
        arguments |= {
            "observation": str(rng.choice(task.observations)),
            "action": str(rng.choice([*task.actions])),
            "dynamics": "rigid" if rng.uniform() < 0.3 and env_id not in TWINLESS else "springs",
        }
        if (further := varied(env_id)) and rng.uniform() < 0.4:
            arguments |= further[rng.integers(len(further))]
        if rng.uniform() < 0.3:
            arguments["randomize"] = ranges(env_id, arguments, rng)
    return env_id, arguments


def varied(env_id: str) -> list[dict[str, Any]]:
    """Arguments that make an environment another one."""
    registered = [dict(variant.arguments) for variant in VARIANTS if variant.of == env_id]
    return [*registered, *FURTHER.get(env_id, ())]


def ranges(env_id: str, arguments: dict[str, Any], rng: Generator) -> dict[str, tuple[float, float]]:
    """Ranges of all factors that something answers to: each set of them is compiled anew."""
    scene = task_type(env_id)().scene
    absent = set(OF_SPRINGS) if arguments["dynamics"] == "rigid" else set()
    absent |= set() if scene.surfaces else {"friction", "restitution"}
    absent |= {"gravity"} if scene.gravity is None else set()
    most = {"restitution": 1.0}  # a larger factor may make it more than 1, which is refused
    return {
        name: (float(rng.uniform(0.8, 1.0)), float(rng.uniform(1.0, most.get(name, 1.2))))
        for name in RANDOMIZABLE
        if name not in absent
    }


def made(what: Round, copies: int | None) -> Any:
    """The environment, or a batch."""
    if what.env_id in IDS:
        if copies is None:
            return gym.make(what.env_id, **what.arguments)
        return gym.make_vec(
            what.env_id,
            num_envs=copies,
            vectorization_mode="vector_entry_point",
            autoreset_mode=what.autoreset,
            threads=what.threads,
            **what.arguments,
        )
    scene = load(what.env_id.removeprefix("scene ")).scene
    first = scene.bodies[0]
    name = f"{first.name}." if len(scene.bodies) > 1 else ""
    weight = 9.81 * first.body.mass
    size = float(np.ptp(first.body.positions, axis=0).max())
    actuators = {f"{name}force": 0.3 * weight}
    if size > 0:
        actuators[f"{name}torque"] = 0.03 * weight * size
    batch = {} if copies is None else {"autoreset_mode": what.autoreset, "threads": what.threads}
    make: Any = springgym.make_scene_env
    return make(
        scene,
        lambda m, s: 1 / (1 + np.square(m.centre).sum(axis=1)),
        actuators=actuators,
        num_envs=copies,
        max_episode_steps=100,
        **batch,
        **what.arguments,
    )


def policy(rng: Generator, shape: tuple[int, ...]) -> Callable[[], np.ndarray]:
    """A way to draw actions."""
    held = rng.uniform(-1, 1, shape)
    return [
        lambda: rng.uniform(-1, 1, shape),
        lambda: np.sign(rng.uniform(-1, 1, shape)),
        lambda: held,
        lambda: np.sign(held),
        lambda: np.zeros(shape),
        lambda: rng.uniform(-1, 1, shape) * 10.0 ** rng.integers(-300, 300),
        lambda: np.where(rng.uniform(size=shape) < 0.1, rng.choice([-1.0, 1.0], shape), 0.0),
    ][rng.integers(7)]


def allowed(env: Any) -> dict[str, tuple[float, float]]:
    """Reset options of an environment and their bounds, as its docstring and its refusals tell them."""
    text = type(env.unwrapped).__doc__ or ""
    found = {}
    for name in re.findall(r'"(\w+)": …', text.partition("reset(options=")[2].partition("sets")[0]):
        try:
            env.unwrapped.reset(options={name: 10**6})
        except ValueError as error:
            low, high = re.search(r"from (\S+) to (\S+)$", str(error)).groups()  # type: ignore[union-attr]
            found[name] = (float(low), float(high))
    return found


class Player:
    """One round."""

    def __init__(self, what: Round, rng: Generator) -> None:
        self.what = what
        self.rng = rng
        self.env = made(what, what.copies)
        self.count = what.copies or 1
        self.followed = int(rng.integers(self.count))
        self.single = None if what.copies is None else made(what._replace(copies=None), None).unwrapped
        self.limit = self.env.unwrapped.episodes.max_episode_steps
        self.bounds = allowed(made(what, None)) if what.env_id in IDS else {}
        self.scale = np.zeros(self.count)
        self.over = np.zeros(self.count, bool)
        self.steps = 0
        self.drift = 0.0

    # --- What is done -----------------------------------------------------------------------------

    def play(self, length: int) -> None:
        self.reset(seed=int(self.rng.integers(2**31)), options=None)
        choose = policy(self.rng, self.env.action_space.shape)
        for _ in range(length):
            if self.rng.uniform() < 0.05:
                choose = policy(self.rng, self.env.action_space.shape)
            if self.over.any() and (self.what.copies is None or self.what.autoreset == "Disabled"):
                self.reset(options={} if self.what.copies is None else {"reset_mask": self.over.copy()})
            event = self.rng.uniform()
            if event < 0.01:
                self.reset(options=self.options())
            elif event < 0.015:
                self.env = copy.deepcopy(self.env)
            elif event < 0.02:
                springgym.set_state(self.env, springgym.get_state(self.env))
            self.step(choose())

    def options(self) -> dict[str, Any]:
        """Some options of a reset, each of its edges now and then, of some copies."""
        given: dict[str, Any] = {}
        for name, (low, high) in self.bounds.items():
            kind = self.rng.integers(4)
            if kind < 3:
                given[name] = (low, high, float(self.rng.uniform(low, high)))[kind]
                if name == "corner":
                    given[name] = int(given[name])
        if self.what.copies is not None and self.rng.uniform() < 0.5:
            mask = self.rng.uniform(size=self.count) < 0.5
            mask[self.rng.integers(self.count)] = True
            if self.what.autoreset != "Disabled" or mask[self.over].all():
                given["reset_mask"] = mask
        return given

    def reset(self, *, options: dict[str, Any] | None, seed: int | None = None) -> None:
        observation, info = self.env.reset(seed=seed, options=None if options is None else dict(options))
        others = dict(options or {})
        mask = others.pop("reset_mask", np.ones(self.count, bool))
        self.over[mask] = False
        self.scale[mask] = 0.0
        check(self.env.observation_space.contains(observation), "observation is outside of its space")
        finite(info)
        if self.single is not None and mask[self.followed]:
            mine = None if seed is None else seed + self.followed
            first, _ = self.single.reset(seed=mine, options=others)
            check(
                np.array_equal(first, observation[self.followed]),
                "starts otherwise than a single environment",
            )
            self.elapsed = 0

    def step(self, action: np.ndarray) -> None:
        before = self.over.copy()
        result = self.env.step(action)
        self.steps += self.count
        observation, reward, terminated, truncated, info = result
        done = np.atleast_1d(terminated | truncated)
        fresh = (
            before if self.what.autoreset == "NextStep" and self.what.copies else np.zeros(self.count, bool)
        )
        if self.single is not None:
            self.follow(action[self.followed], result, bool(fresh[self.followed]))
        check(self.env.observation_space.contains(observation), "observation is outside of its space")
        check(np.isfinite(reward).all(), "reward is not finite")
        last = info.get("final_info", info)
        lost = np.atleast_1d(last["diverged"]) & (done | np.atleast_1d(info["diverged"]))
        if not lost.any():
            finite(info)
        if self.what.env_id in IDS:  # a scene that is driven may be torn
            check(not lost.any(), "diverged")
            check(
                np.all((np.asarray(reward) >= 0) & (np.asarray(reward) <= 1)), "reward is outside of [0, 1]"
            )
            terms = [f"reward_{name}" for name in task_type(self.what.env_id).terms]
            ended = done if "final_info" in info else np.zeros(self.count, bool)
            total = sum(
                np.where(ended, np.atleast_1d(last[term]), np.atleast_1d(info[term])) for term in terms
            )
            if self.what.arguments.get("sparse"):  # the aim is met, or it is not
                total = np.rint(reward)
            check(np.allclose(total, reward, rtol=0, atol=1e-12), "terms do not sum to the reward")
        self.bound_drift(done | fresh | lost)
        self.see_misses()
        self.over = done if self.what.autoreset != "SameStep" or not self.what.copies else np.zeros_like(done)

    def bound_drift(self, changed: np.ndarray) -> None:
        """Hold the drift of episodes that go on against the largest energies so far."""
        episodes = self.env.unwrapped.episodes
        m = episodes.measures
        self.scale = np.maximum(self.scale, m.kinetic + m.elastic + m.contact)
        drift = np.abs(m.balance - episodes.balance)
        simulator = episodes.simulator
        scene = simulator.scene
        rough = scene.can_touch or simulator.dtype == np.float32
        # what hardly moves quivers, by as much energy as a fall through a small share of its size gives
        size = float(np.ptp(scene.positions, axis=0).max()) or 1.0
        least = QUIVER * sum(placed.body.mass for placed in scene.bodies) * 9.81 * size
        least += 8 * float(np.finfo(simulator.dtype).eps) * np.abs(m.gravity)
        most = (ROUGH_DRIFT if rough else DRIFT) * self.scale + least
        too_much = ~changed & (drift > most)
        seen = drift / np.maximum(self.scale, least)
        self.drift = max(self.drift, float(seen[~changed].max(initial=0.0)))
        self.scale[changed] = 0.0
        check(not too_much.any(), f"energy drift of copy {int(np.argmax(too_much))}: {drift[too_much][:1]} J")

    def see_misses(self) -> None:
        """Assert that what moves no faster than contact is computed well for misses no contact."""
        simulator = self.env.unwrapped.episodes.simulator
        if simulator.scene.meetings:
            pairs = simulator.pairs()
            slow = pairs.coarse_contacts.sum(axis=-1) == 0
            check(not (slow & (pairs.late_contacts.sum(axis=-1) > 0)).any(), "bodies missed each other")
            check(not pairs.overflow.any(), "more contacts than are listed")

    def follow(self, action: np.ndarray, result: Any, fresh: bool) -> None:
        """Step the single environment, and compare it with its copy in the batch."""
        n = self.followed
        single = self.single
        assert single is not None
        observation, reward, terminated, truncated, info = result
        if fresh:
            expected = (single.reset()[0], 0.0, False, False)
            self.elapsed = 0
        else:
            expected = single.step(action)[:4]
            self.elapsed += 1
            expected = (*expected[:3], 0 <= self.limit <= self.elapsed)
        ended = expected[2] or expected[3]
        seen = observation[n]
        if ended and self.what.autoreset == "SameStep":
            seen = info["final_obs"][n]
            check(
                np.array_equal(single.reset()[0], observation[n]), "new episode differs from a single one's"
            )
            self.elapsed = 0
        same = np.array_equal(expected[0], seen) and expected[1:] == (reward[n], terminated[n], truncated[n])
        check(same, "copy differs from a single environment")


# --- Checks -------------------------------------------------------------------------------------------


class Fault(AssertionError):
    """Something that must hold does not."""


def check(holds: Any, what: str) -> None:
    if not holds:
        raise Fault(what)


def finite(info: dict[str, Any]) -> None:
    for name, value in info.items():
        if isinstance(value, dict):
            finite(value)
        elif name != "final_obs":
            check(np.isfinite(value).all(), f"info[{name!r}] is not finite")


# --- The command --------------------------------------------------------------------------------------


def fuzz(
    seed: int,
    *,
    steps: float,
    rounds: float = np.inf,
    only: str = "",
    length: int = LENGTH,
    repeats: int = REPEATS,
) -> list[int]:
    """Play rounds, seeded one after the other, for so many steps; return the seeds that failed."""
    failed: list[int] = []
    total = 0
    start = time.perf_counter()
    while total < steps and rounds > 0:
        rng = np.random.default_rng(seed)
        shared = np.random.default_rng((seed // repeats, repeats))
        began = time.perf_counter()
        what = None
        player = None
        try:
            with warnings.catch_warnings(), np.errstate(divide="raise", over="raise", invalid="raise"):
                warnings.simplefilter("error")
                what = drawn(rng, *environment(shared, only))
                player = Player(what, rng)
                player.play(length)
            outcome = "ok"
        except Exception:
            failed.append(seed)
            outcome = f"FAILED\n{traceback.format_exc()}"
        done, drift = (player.steps, player.drift) if player else (0, 0.0)
        total += done
        took = time.perf_counter() - began
        print(f"seed {seed}: {what}: {done} steps, drift {drift:.1e}, {took:.1f} s: {outcome}", flush=True)
        seed = seed + 1
        rounds = rounds - 1
    minutes = (time.perf_counter() - start) / 60
    print(f"{total} steps in {minutes:.1f} min; failed seeds: {', '.join(map(str, failed)) or 'none'}")
    return failed


def main() -> int:
    assert __doc__
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=float, default=1e5, help="environment steps, of all copies together")
    parser.add_argument("--rounds", type=float, default=np.inf, help="rounds at the most")
    parser.add_argument("--seed", type=int, help="of the first round; the clock's if not given")
    parser.add_argument("--only", default="", help="environments whose id has this in it")
    parser.add_argument("--length", type=int, default=LENGTH, help="control periods in a round")
    parser.add_argument("--repeats", type=int, default=REPEATS, help="rounds in a row of one environment")
    args = parser.parse_args()
    if not offered(args.only):
        parser.error(f"--only: no environment and no scene has {args.only!r} in its name")
    if min(args.length, args.repeats) < 1:
        parser.error("--length and --repeats are at least 1")
    seed = time.time_ns() % 2**31 if args.seed is None else args.seed
    failed = fuzz(
        seed, steps=args.steps, rounds=args.rounds, only=args.only, length=args.length, repeats=args.repeats
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
