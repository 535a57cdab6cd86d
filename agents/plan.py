"""Plan with the exact simulator, as a reference for every task, without learning.

    python agents/plan.py --tasks SpringTop-v0 --episodes 5
    python agents/plan.py --tasks SpringTop-v0 --samples 256 --iterations 4
    python agents/plan.py --json docs/planner.json

A plan is a sequence of actions with linear interpolation. Every --spacing seconds, many plans are simulated
from the environment's state in a native batch, and improved by the cross-entropy method of Pinneri et al.
(2020, *Sample-efficient cross-entropy method for real-time planning*, arXiv:2008.06389): noise is
correlated in time, elites are kept, and the last plan is shifted. The episodes of a task are played at
once, with the same results as one by one.

The return is that of ``agents/evaluate.py``: the mean reward per step, if an episode that ends early earns
nothing for the rest. Plans are compared by the terms of the reward, which a sparse variant reports in
``info``. Intervals have 95 %: a bootstrap over the episodes for the return, and Wilson's interval for
success. Seconds are those of one processor core.

With ``--json``, a task that has a row is skipped, unless its planner, the task or the protocol has changed.
Episodes are written ten at a time: if the command was stopped, the same command continues.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from config import MENDABLE, command_line, making, new_file, number, whole
from evaluate import percent, score
from gymnasium.vector import AutoresetMode, VectorEnv
from results import (
    PROTOCOL,
    SUITE,
    add_row,
    identity,
    interval_of_returns,
    made_with,
    probe,
    read_rows,
    same_probe,
    wilson,
)
from runs import HELD_OUT_SEED, time_limit

import springgym
from springgym.cli import INTERRUPTED, guarded
from springgym.envs.registration import ENVIRONMENTS, find, spec_of

AT_ONCE = 10
"""Number of episodes that are played at once."""


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
        """Return the number of actions in a plan, and the number of control periods from one to the next."""
        between = max(1, round(self.spacing / period))
        return max(1, round(self.horizon / (between * period))), between


SETTINGS: dict[str, dict[str, Any]] = {
    "SpringPendulum-v0": {"horizon": 3.0},  # a swing to the other side takes 1.5 s
    "SpringFreeTop-v0": {"horizon": 1.2, "spread": 0.2},  # larger pushes fell it, whatever comes after
    # one action is all: one stroke of a hundred pots the ball
    "SpringBilliards-v0": {"samples": 1024, "iterations": 3, "spread": 1.0},
    # with 32 samples, it wins a duel against the strong opponent in 40 %; with these, in 90 %
    "SpringDuel-v0": {"samples": 128, "iterations": 3, "horizon": 1.0, "spacing": 0.2},
    # what collides takes longer to simulate: fewer plans, or not so far
    "SpringLabyrinth-v0": {"samples": 48, "horizon": 1.5, "spacing": 0.2},
    "SpringBalance-v0": {"samples": 32, "horizon": 1.0},
    "SpringJuggle-v0": {"samples": 32, "horizon": 1.0},
    "SpringShove-v0": {"samples": 32, "spacing": 0.2},
    "SpringTower-v0": {"samples": 32, "spacing": 0.2},
    "SpringStack-v0": {"samples": 32, "horizon": 1.5, "spacing": 0.2},
}
"""What the planner of an environment and its variants does otherwise than `Planner`."""


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
    total = np.zeros(len(actions))
    goes_on = np.ones(len(actions), bool)
    for now in actions.swapaxes(0, 1):
        _, _, terminated, _, infos = model.step(now)
        total += goes_on * sum(infos[name] for name in infos if name.startswith("reward_"))
        total -= periods * (goes_on & terminated & ~infos.get("is_success", np.zeros(len(total), bool)))
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
    length, between = planner.periods(own.episodes.task.action_period)
    searches = [Search(planner, (length, size), seed) for seed in seeds]
    found: list[dict[str, Any]] = [
        {"seed": seed, "return": 0.0, "success": False, "steps": 0, "seconds": 0.0} for seed in seeds
    ]
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
                    found[n]["success"] = bool(info["is_success"][n]) if "is_success" in info else None
                    playing.remove(n)
    return found


def planner_of(env_id: str, **given: Any) -> Planner:
    """The planner of a task, with what is given instead of its settings."""
    found = find(env_id)
    default = Planner(**(SETTINGS.get(found[0].id, {}) if found else {}))
    return replace(default, **{name: value for name, value in given.items() if value is not None})


def play_episodes(task: str, planner: Planner, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Play episodes of a task at once, see `play`."""
    made: dict[str, Any] = {"vectorization_mode": "vector_entry_point"}
    made["autoreset_mode"] = AutoresetMode.NEXT_STEP
    with making(task):
        envs = gym.make_vec(task, len(seeds), **made)
        model = gym.make_vec(task, len(seeds) * planner.samples, max_episode_steps=-1, **made)
    model.reset(seed=0)
    model.step(np.zeros(model.action_space.shape, np.float32))  # compiles
    try:
        return play(envs, model, seeds, planner)
    finally:
        envs.close()
        model.close()


def summary(task: str, played: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return mean return and success with their intervals, and what planning takes, of episodes of a task."""
    own: Any = gym.make(task).unwrapped
    returns = [one["return"] for one in played]
    successes = [one["success"] for one in played]
    known = None not in successes
    seconds = sum(one["seconds"] for one in played)
    steps = sum(one["steps"] for one in played)
    return {
        "task": task,
        "seconds": round(seconds, 2),
        "success_rate": sum(successes) / len(played) if known else None,
        "mean_return": round(float(np.mean(returns)), 6),
        "episodes": len(played),
        "return_interval": [round(end, 4) for end in interval_of_returns(returns)],
        "success_interval": [round(end, 4) for end in wilson(sum(successes), len(played))] if known else None,
        "real_time_factor": round(seconds / (steps * own.episodes.task.action_period), 3),
    }


def line_of(row: Mapping[str, Any]) -> str:
    """Return a `summary` as a line of text."""
    scale, unit = score(row["task"])
    low, high = (scale * end for end in row["return_interval"])
    success = percent(row["success_rate"])
    if interval := row["success_interval"]:
        success += f" ({100 * interval[0]:.0f}–{100 * interval[1]:.0f})"
    return (
        f"{row['task']}: return {scale * row['mean_return']:.3f} ({low:.3f}–{high:.3f}) per {unit}, success "
        f"{success} of {row['episodes']} episodes, "
        f"{row['real_time_factor']:.2f} s of one core a simulated second"
    )


def digest(planner: Planner) -> str:
    """Return eight letters that depend on the settings of a planner."""
    return sha256(repr(planner).encode()).hexdigest()[:8]


def make_row(task: str, planner: Planner, first: int, episodes: int, partial: Path | None) -> dict[str, Any]:
    """Play episodes of a task, from where a file of episodes stands if there is one, and return the row."""
    row: dict[str, Any] = {}
    if partial:
        row = {"protocol": PROTOCOL, "task": task, "algorithm": "planner", "seed": 0, "steps": 0}
        row |= {"config": digest(planner), "first_seed": first, "probe": probe(task), **made_with()}
    part = read_rows(partial).get(identity(row), {}) if partial else {}
    same = part and {name: part.get(name) for name in row} == row
    played = part["played"][:episodes] if same else []
    while len(played) < episodes:
        start = first + len(played)
        count = min(AT_ONCE, episodes - len(played))
        played = [*played, *play_episodes(task, planner, range(start, start + count))]
        if partial:
            add_row(partial, {**row, "played": played})
    settings = {name: value for name, value in asdict(planner).items() if value is not None}
    return {**row, **summary(task, played), "planner": settings}


def plan_tasks(options: argparse.Namespace) -> int:
    """Play the episodes of the tasks that are asked for, print what the planner reaches, and write it."""
    names = ("samples", "horizon", "spacing", "iterations", "temperature")
    given = {name: getattr(options, name) for name in names}
    for task in options.tasks:
        spec_of(task)
    for task in options.tasks:
        planner = planner_of(task, **given)
        planner = replace(planner, elites=min(planner.elites, planner.samples // 2))
        if options.json:
            now = {"protocol": PROTOCOL, "config": digest(planner), "episodes": options.episodes}
            run = {"task": task, "algorithm": "planner", "seed": 0}
            old = read_rows(options.json).get(identity(run), {})
            if {name: old.get(name) for name in now} == now and same_probe(old["probe"], task):
                continue
        try:
            partial = options.json and options.json.with_suffix(".parts.json")
            row = make_row(task, planner, options.seed, options.episodes, partial)
        except KeyboardInterrupt:
            print("\nstopped" + ("; the same command continues" if options.json else ""))
            return INTERRUPTED
        if options.json:
            add_row(options.json, row)
        print(line_of(row), flush=True)
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    default = Planner()
    parser = command_line(__doc__)
    every = list(dict.fromkeys((*(row.id for row in ENVIRONMENTS), *SUITE)))
    parser.add_argument(
        "--tasks", nargs="+", default=every, metavar="ID", help="environment ids (default: all, and suite)"
    )
    parser.add_argument(
        "--json", type=new_file(), metavar="FILE", help="file of rows, in the form of agents/benchmark.py"
    )
    parser.add_argument(
        "--episodes", type=whole(1, 10_000), default=AT_ONCE, help=f"number of episodes (default: {AT_ONCE})"
    )
    parser.add_argument(
        "--seed", type=whole(0, 2**31), default=HELD_OUT_SEED, help="seed of the first episode"
    )
    for name, least, most in (("samples", 2, 100_000), ("iterations", 1, 1000)):
        parser.add_argument(
            f"--{name}", type=whole(least, most), help=f"number of {name} (default: {getattr(default, name)})"
        )
    for name, told_ in (
        ("horizon", f"length of a plan [s] (default: {default.horizon:g})"),
        ("spacing", f"time between actions of a plan [s] (default: {default.spacing:g})"),
        ("temperature", "weigh all plans by their returns, instead of choosing the best"),
    ):
        parser.add_argument(f"--{name}", type=number(0.001, 1000), help=told_)
    options = parser.parse_args(arguments)
    return guarded("plan.py", lambda: plan_tasks(options), MENDABLE)


if __name__ == "__main__":
    sys.exit(main())
