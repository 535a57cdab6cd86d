"""Plan with the exact model, as a reference for every task, without learning.

    python agents/plan.py --tasks SpringTop-v0 --episodes 5
    python agents/plan.py --rows docs/planner.json          # a row for every environment, cheapest first

A plan is a sequence of actions, and straight lines between them. Whenever the environment has taken the first
of them, its state is set in many copies of a native batch. Each copy tries a plan, and the plans move towards
the best of them, by the cross-entropy method with additions of Pinneri et al. (2020, *Sample-efficient
cross-entropy method for real-time planning*, arXiv:2008.06389): noise is correlated in time, elites are kept,
and the plan is shifted from one time to the next. The episodes of a task are played at once, and are the same
as one by one.

The return is that of ``agents/evaluate.py``: the mean reward per step, if an episode that ends early earns
nothing for the rest. Plans are compared by the terms of the reward, which a sparse variant reports in
``info``. Intervals have 95 %: a bootstrap over the episodes for the return, and Wilson's interval for
success. Seconds are those of one processor core.

With ``--rows``, rows are written to a file, in the form of ``agents/benchmark.py``. A task that has a row is
skipped, unless its planner or the task itself has changed since. Rows come ten episodes at a time: if the
command was stopped, the same command continues.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from benchmark import made_with, probe
from config import MENDABLE, ConfigError, making, number, whole
from gymnasium.vector import AutoresetMode, VectorEnv
from runs import HELD_OUT_SEED, time_limit, write_rows
from scores import interval

import springgym
from springgym.cli import INTERRUPTED, guarded
from springgym.registration import find

AT_ONCE = 10
"""Number of episodes that are played at once, and written down together."""


@dataclass(frozen=True)
class Planner:
    """Settings of the planner."""

    samples: int = 64
    """number of plans tried in an iteration"""
    horizon: float = 2.0
    """how far a plan reaches [s]"""
    spacing: float = 0.1
    """from one action of a plan to the next, and from one plan to the next [s]: a whole number of control
    periods near this"""
    iterations: int = 2
    """number of refinements of a plan"""
    elites: int = 8
    """number of best plans, around which the next ones are drawn; half of them are tried again next time"""
    spread: float = 0.5
    """standard deviation of actions in the first iteration, of the plan that differs most"""
    finest: float = 0.03
    """the same of the plan that differs least, as a part of it; others lie between, in a geometric row"""
    colour: float = 2.0
    """power of the noise falls with frequency f as 1/f to this"""
    temperature: float | None = None
    """if given, the next plan is the mean of all, weighted by exp(return/temperature), with returns in units
    of their standard deviation: model predictive path integral control (Williams et al. 2017,
    arXiv:1509.01149)"""

    def periods(self, period: float) -> tuple[int, int]:
        """Return the number of actions of a plan, and the number of control periods between two of them."""
        between = max(1, round(self.spacing / period))
        return max(2, round(self.horizon / (between * period))), between


SETTINGS: dict[str, dict[str, Any]] = {
    "SpringPendulum-v0": {"horizon": 3.0},  # a swing to the other side takes 1.5 s
    "SpringFreeTop-v0": {"horizon": 1.2, "spread": 0.2},  # larger pushes fell it, whatever comes after
    # one stroke of a hundred pots the ball, and the planner waits until it has found one
    "SpringBilliards-v0": {"samples": 1024, "horizon": 4.0, "spacing": 2.0, "iterations": 3, "spread": 1.0},
    # what collides takes longer to simulate: fewer plans, or not so far
    "SpringLabyrinth-v0": {"samples": 48, "horizon": 1.5, "spacing": 0.2},
    "SpringBalance-v0": {"samples": 32, "horizon": 1.0},
    "SpringJuggle-v0": {"samples": 32, "horizon": 1.0},
    "SpringShove-v0": {"samples": 32, "spacing": 0.2},
    "SpringDuel-v0": {"samples": 32, "horizon": 1.0, "spacing": 0.2},
    "SpringTower-v0": {"samples": 32, "spacing": 0.2},
    "SpringStack-v0": {"samples": 32, "horizon": 1.5, "spacing": 0.2},
}
"""What the planner of an environment and its variants does otherwise than `Planner`."""

CHEAPEST_FIRST = (
    "SpringBilliards-v0",
    "SpringTop-v0",
    "SpringRope-v0",
    "SpringPendulum-v0",
    "SpringDetumble-v0",
    "SpringGyroscope-v0",
    "SpringTumble-v0",
    "SpringFreeTop-v0",
    "SpringLabyrinth-v0",
    "SpringDuel-v0",
    "SpringBalance-v0",
    "SpringShove-v0",
    "SpringStack-v0",
    "SpringTower-v0",
    "SpringJuggle-v0",
)
"""The environments, by what a row costs."""


def noise(rng: np.random.Generator, shape: tuple[int, int, int], colour: float) -> np.ndarray:
    """Noise of unit variance and a shape (plans, actions of a plan, entries of an action)."""
    length = shape[1]
    amplitude = np.maximum(np.fft.rfftfreq(length), 1 / length) ** (-colour / 2)
    white = rng.standard_normal(shape)
    coloured = np.fft.irfft(np.fft.rfft(white, axis=1) * amplitude[:, None], length, axis=1)
    return np.asarray(coloured / coloured.std())


def taken(plans: np.ndarray, between: int) -> np.ndarray:
    """The actions (…, periods, A) of plans (…, length, A), on straight lines: ``between`` periods each."""
    after = np.concatenate([plans[..., 1:, :], plans[..., -1:, :]], axis=-2)
    share = np.arange(between)[:, None] / between
    actions = (1 - share) * plans[..., None, :] + share * after[..., None, :]
    return actions.reshape(*plans.shape[:-2], -1, plans.shape[-1]).astype(np.float32)


def returns(model: VectorEnv, actions: np.ndarray) -> np.ndarray:
    """Return the sum of rewards of sequences of actions (copies, periods, A), each in its copy.

    A failure costs 1 a period: what comes after the plan is lost, too, and is more than what a plan earns.
    """
    periods = actions.shape[1]
    total, goes_on = np.zeros(len(actions)), np.ones(len(actions), bool)
    for now in actions.swapaxes(0, 1):
        _, _, terminated, _, infos = model.step(now)
        total += goes_on * sum(infos[name] for name in infos if name.startswith("reward_"))
        total -= periods * (goes_on & terminated & ~infos["is_success"])
        goes_on &= ~terminated
    return total


class Search:
    """Plans of one episode, with its own random numbers."""

    def __init__(self, planner: Planner, shape: tuple[int, int], seed: int) -> None:
        self.planner, self.rng = planner, np.random.default_rng(seed)
        self.best = np.zeros(shape)
        """the best plan (length, A)"""
        self._kept = self.best[None]
        self.begin()

    def begin(self) -> None:
        """Search around the best plan again."""
        self._mean, self._spread = self.best, np.full_like(self.best, self.planner.spread)

    def tried(self) -> np.ndarray:
        """Draw the plans (samples, length, A) of an iteration."""
        planner = self.planner
        drawn = noise(self.rng, (planner.samples, *self.best.shape), planner.colour)
        drawn *= planner.finest ** np.linspace(0.0, 1.0, planner.samples)[:, None, None]
        drawn = self._mean + self._spread * drawn
        drawn[len(drawn) - len(self._kept) :] = self._kept
        return np.clip(drawn, -1.0, 1.0)

    def learn(self, tried: np.ndarray, returns: np.ndarray) -> None:
        """Move to the plans that had the highest returns (samples,)."""
        planner = self.planner
        if planner.temperature is None:
            self._kept = tried[np.argsort(-returns, kind="stable")[: planner.elites]]
            self._mean, self._spread = self._kept.mean(axis=0), self._kept.std(axis=0)
            self.best = self._kept[0]
        else:
            weight = np.exp((returns - returns.max()) / (planner.temperature * max(returns.std(), 1e-9)))
            self.best = self._mean = np.einsum("n,nha->ha", weight / weight.sum(), tried)
            self._kept = self.best[None]

    def shift(self) -> None:
        """Go on from one action of the plan to the next."""
        self.best = np.concatenate([self.best[1:], self.best[-1:]])
        half = self._kept[: (len(self._kept) + 1) // 2]
        self._kept = np.concatenate([half[:, 1:], half[:, -1:]], axis=1)
        self.begin()


def improve(searches: Sequence[Search], judge: Callable[[np.ndarray], np.ndarray], planner: Planner) -> None:
    """Improve the plans of some episodes; ``judge`` gives the returns of plans (n, length, A)."""
    for search in searches:
        search.begin()
    for _ in range(planner.iterations):
        tried = [search.tried() for search in searches]
        found = judge(np.concatenate(tried)).reshape(len(searches), -1)
        for search, plans, own in zip(searches, tried, found, strict=True):
            search.learn(plans, own)


def play(envs: VectorEnv, model: VectorEnv, seeds: Sequence[int], planner: Planner) -> list[dict[str, Any]]:
    """An episode from each seed: its return per step, success and steps, and how long planning took [s]."""
    envs.reset(seed=list(seeds))  # type: ignore[arg-type]
    limit, size = time_limit(envs.spec), envs.single_action_space.shape[0]  # type: ignore[arg-type, index]
    own: Any = model.unwrapped
    length, between = planner.periods(own.episodes.task.period)
    searches = [Search(planner, (length, size), seed) for seed in seeds]
    found = [{"seed": seed, "return": 0.0, "success": False, "steps": 0, "seconds": 0.0} for seed in seeds]
    playing = list(range(len(seeds)))
    while playing:
        began = time.process_time()
        states = [springgym.get_state(envs, [n]) for n in playing]

        def judge(plans: np.ndarray, states: Sequence[Mapping[str, Any]] = states) -> np.ndarray:
            for n, state in enumerate(states):
                springgym.set_state(model, state, np.arange(planner.samples) + n * planner.samples)
            idle = model.num_envs - len(plans)  # of episodes that are over
            actions = taken(np.concatenate([plans, np.zeros((idle, *plans.shape[1:]))]), between)
            return returns(model, actions)[: len(plans)]

        improve([searches[n] for n in playing], judge, planner)
        seconds = (time.process_time() - began) / len(playing)
        actions = np.zeros((between, *envs.action_space.shape), np.float32)  # type: ignore[misc]
        for n in playing:
            actions[:, n] = taken(searches[n].best, between)[:between]
            searches[n].shift()
            found[n]["seconds"] += seconds
        for now in actions:
            if not playing:
                break
            _, reward, terminated, truncated, info = envs.step(now)
            for n in list(playing):
                found[n]["return"] += float(reward[n]) / limit
                found[n]["steps"] += 1
                if terminated[n] or truncated[n]:
                    found[n]["success"] = bool(info["is_success"][n])
                    playing.remove(n)
    return found


def wilson(successes: int, episodes: int) -> tuple[float, float]:
    """Return an interval for the rate of success (Wilson 1927, doi:10.1080/01621459.1927.10502953)."""
    z, rate = 1.96, successes / episodes
    centre = rate + z * z / (2 * episodes)
    half = z * math.sqrt(rate * (1 - rate) / episodes + z * z / (4 * episodes**2))
    low, high = ((centre + side * half) / (1 + z * z / episodes) for side in (-1, 1))
    return max(low, 0.0), min(high, 1.0)


class Tables:
    """Files of rows, and of the episodes of which rows are made."""

    def __init__(self, rows: Path | None) -> None:
        self.rows = rows
        self.parts = None if rows is None else rows.with_suffix(".parts.json")

    @staticmethod
    def read(path: Path | None) -> dict[str, Any]:
        """What a file holds, by task."""
        if path is None or not path.exists():
            return {}
        try:
            return {row["task"]: row for row in json.loads(path.read_text(encoding="utf-8"))}
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"{path}: the file does not hold rows of tasks: {error!r}") from error

    @classmethod
    def write(cls, path: Path | None, row: dict[str, Any]) -> None:
        """Write a row in place of one of the same task."""
        if path is not None:
            rows = cls.read(path) | {row["task"]: row}
            write_rows(path, (rows[task] for task in sorted(rows)))


def digest(planner: Planner) -> str:
    """A few letters that change with the settings of a planner."""
    return sha256(repr(planner).encode()).hexdigest()[:8]


def planner_of(env_id: str, **given: Any) -> Planner:
    """The planner of a task, with what is given in place of its settings."""
    found = find(env_id)
    usual = Planner(**(SETTINGS.get(found[0].id, {}) if found else {}))
    return replace(usual, **{name: value for name, value in given.items() if value is not None})


def row_of(task: str, planner: Planner, played: Sequence[Mapping[str, Any]], period: float) -> dict[str, Any]:
    """The row of a task whose episodes have been played, in the form of ``agents/benchmark.py``."""
    returned, successes = [one["return"] for one in played], sum(one["success"] for one in played)
    seconds, steps = sum(one["seconds"] for one in played), sum(one["steps"] for one in played)
    return {
        "task": task,
        "algorithm": "planner",
        "seed": 0,
        "steps": 0,
        "seconds": round(seconds, 2),
        "success_rate": successes / len(played),
        "mean_return": round(float(np.mean(returned)), 6),
        "episodes": len(played),
        "config": digest(planner),
        "planner": {name: value for name, value in asdict(planner).items() if value is not None},
        "return_interval": [
            round(end, 4) for end in interval([np.array(returned)], lambda all_: float(np.mean(all_)))
        ],
        "success_interval": [round(end, 4) for end in wilson(successes, len(played))],
        "real_time_factor": round(seconds / (steps * period), 3),
    }


def measured(task: str, planner: Planner, seeds: Sequence[int], tables: Tables) -> dict[str, Any]:
    """Play an episode of a task from each seed, from where the file of episodes stands, and make the row."""
    whose = {"task": task, "config": digest(planner), "first_seed": seeds[0], "probe": probe(task)}
    whose |= {"commit": made_with()["commit"]}
    part = tables.read(tables.parts).get(task, {})
    played = part["played"] if {name: part.get(name) for name in whose} == whose else []
    played = played[: len(seeds)]
    while len(played) < len(seeds):
        now = seeds[len(played) : len(played) + AT_ONCE]
        with making(task):
            made: dict[str, Any] = {"vectorization_mode": "vector_entry_point"}
            made["autoreset_mode"] = AutoresetMode.NEXT_STEP
            envs = gym.make_vec(task, len(now), **made)
            model = gym.make_vec(task, len(now) * planner.samples, max_episode_steps=-1, **made)
        model.reset(seed=0)
        model.step(np.zeros(model.action_space.shape, np.float32))  # compiles
        played = [*played, *play(envs, model, now, planner)]
        envs.close()
        model.close()
        tables.write(tables.parts, {**whose, "played": played})
    own: Any = gym.make(task).unwrapped
    row = row_of(task, planner, played, own.episodes.task.period)
    return {**row, "first_seed": seeds[0], "probe": whose["probe"], **made_with()}


def told(row: Mapping[str, Any]) -> str:
    """A row in a line."""
    (low, high), (least, most) = row["return_interval"], row["success_interval"]
    return (
        f"{row['task']}: return {row['mean_return']:.3f} ({low:.3f}–{high:.3f}), success "
        f"{100 * row['success_rate']:.0f} % ({100 * least:.0f}–{100 * most:.0f}) of {row['episodes']} "
        f"episodes, {row['real_time_factor']:.2f} s of one core a simulated second"
    )


def plan_all(options: argparse.Namespace) -> int:
    """Make the rows that are asked for."""
    names = ("samples", "horizon", "spacing", "iterations", "temperature")
    given = {name: getattr(options, name) for name in names}
    tables = Tables(options.rows)
    done = tables.read(options.rows)
    for task in options.tasks:
        planner = planner_of(task, **given)
        if planner.elites > planner.samples:
            planner = replace(planner, elites=planner.samples)
        old = done.get(task, {})
        asked = {"config": digest(planner), "episodes": options.episodes, "first_seed": options.seed}
        if old and {name: old.get(name) for name in asked} == asked and old["probe"] == probe(task):
            continue
        try:
            row = measured(task, planner, range(options.seed, options.seed + options.episodes), tables)
        except KeyboardInterrupt:
            print("\nstopped; the same command goes on" if options.rows else "\nstopped")
            return INTERRUPTED
        tables.write(options.rows, row)
        print(told(row), flush=True)
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    usual = Planner()
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--tasks", nargs="+", default=CHEAPEST_FIRST, metavar="ID", help="environment ids (default: all)"
    )
    parser.add_argument(
        "--episodes", type=whole(1, 10_000), default=AT_ONCE, help=f"number of episodes (default: {AT_ONCE})"
    )
    parser.add_argument(
        "--seed", type=whole(0, 2**31), default=HELD_OUT_SEED, help="seed of the first episode"
    )
    for name, least, most in (("samples", 2, 100_000), ("iterations", 1, 1000)):
        parser.add_argument(f"--{name}", type=whole(least, most), help=f"({getattr(usual, name)})")
    for name, told_ in (
        ("horizon", f"how far a plan reaches [s] ({usual.horizon:g})"),
        ("spacing", f"from one action of a plan to the next [s] ({usual.spacing:g})"),
        ("temperature", "weigh all plans by their returns, instead of choosing the best"),
    ):
        parser.add_argument(f"--{name}", type=number(0.001, 1000), help=told_)
    parser.add_argument("--rows", type=Path, help="write rows to this file")
    options = parser.parse_args(arguments)
    return guarded("plan.py", lambda: plan_all(options), MENDABLE)


if __name__ == "__main__":
    sys.exit(main())
