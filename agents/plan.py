"""Plan with the exact model, as a reference for every task, without learning.

    python agents/plan.py --id SpringTop-v0 --episodes 5
    python agents/plan.py --id SpringGyroscopeHard-v0 --horizon 20 --json docs/planner.json

In every control period, the state of the environment is set in all copies of a native batch. Each copy tries
a sequence of actions, and the plan moves towards the best of them, by the cross-entropy method with additions
of Pinneri et al. (2020, *Sample-efficient cross-entropy method for real-time planning*, arXiv:2008.06389):
noise is correlated in time, elites are kept, and the plan is shifted from one period to the next. The
environment then takes the first action of the plan.

The return is that of ``agents/evaluate.py``: the mean reward per step, if an episode that ends early earns
nothing for the rest. Plans are compared by the terms of the reward, which a sparse variant reports in
``info``. Intervals have 95 %: a bootstrap over the episodes for the return, and Wilson's interval for
success. Seconds are those of one processor core.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from benchmark import made_with, probe
from config import MENDABLE, making, whole
from gymnasium.vector import VectorEnv
from runs import HELD_OUT_SEED, time_limit, write_atomically
from scores import interval

import springgym
from springgym.cli import guarded


@dataclass(frozen=True)
class Planner:
    """Settings of the planner."""

    samples: int = 64
    """number of sequences of actions tried in an iteration"""
    horizon: int = 30
    """number of control periods in a sequence"""
    iterations: int = 2
    """number of refinements of the plan in every control period"""
    elites: int = 8
    """number of best sequences, around which the next ones are drawn"""
    spread: float = 0.5
    """standard deviation of actions in the first iteration"""
    colour: float = 1.0
    """power of the noise falls with frequency f as 1/f to this"""


def noise(rng: np.random.Generator, planner: Planner, actions: int) -> np.ndarray:
    """Draw noise (samples, horizon, actions) of unit variance."""
    frequency = np.fft.rfftfreq(planner.horizon)
    amplitude = np.maximum(frequency, 1 / planner.horizon) ** (-planner.colour / 2)
    white = rng.standard_normal((planner.samples, planner.horizon, actions))
    coloured = np.fft.irfft(np.fft.rfft(white, axis=1) * amplitude[:, None], planner.horizon, axis=1)
    return np.asarray(coloured / coloured.std())


def returns(model: VectorEnv, state: Mapping[str, Any], actions: np.ndarray) -> np.ndarray:
    """Return the sum of rewards of each sequence of actions (samples, horizon, actions) from a state."""
    springgym.set_state(model, state, range(len(actions)))
    total, goes_on = np.zeros(len(actions)), np.ones(len(actions), bool)
    for taken in actions.swapaxes(0, 1):
        _, _, terminated, _, infos = model.step(taken)
        total += goes_on * sum(infos[name] for name in infos if name.startswith("reward_"))
        goes_on &= ~terminated
    return total


def improved(
    plan: np.ndarray, judge: Callable[[np.ndarray], np.ndarray], planner: Planner, rng: np.random.Generator
) -> np.ndarray:
    """Return the best plan (horizon, actions) found around one; ``judge`` gives the returns of many."""
    mean, spread, kept = plan, np.full_like(plan, planner.spread), plan[None]
    for _ in range(planner.iterations):
        tried = np.clip(mean + spread * noise(rng, planner, plan.shape[1]), -1.0, 1.0)
        tried[: len(kept)] = kept
        best_first = np.argsort(-judge(tried), kind="stable")
        kept = tried[best_first[: planner.elites]]
        mean, spread = kept.mean(axis=0), kept.std(axis=0)
    return np.asarray(kept[0])


def play(env: Any, model: VectorEnv, seed: int, planner: Planner) -> dict[str, Any]:
    """Play one episode: return per step, success and steps, and how long planning took [s]."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    plan = np.zeros((planner.horizon, *env.action_space.shape))
    total, steps, seconds, over, info = 0.0, 0, 0.0, False, {"is_success": False}
    while not over:
        began, state = time.process_time(), springgym.get_state(env)
        plan = improved(plan, partial(returns, model, state), planner, rng)
        seconds += time.process_time() - began
        _, reward, terminated, truncated, info = env.step(plan[0])
        plan = np.concatenate([plan[1:], plan[-1:]])
        total, steps, over = total + float(reward), steps + 1, terminated or truncated
    return {
        "seed": seed,
        "return": total / time_limit(env.spec),
        "success": bool(info["is_success"]),
        "steps": steps,
        "seconds": seconds,
    }


def wilson(successes: int, episodes: int) -> tuple[float, float]:
    """Return an interval for the rate of success (Wilson 1927, doi:10.1080/01621459.1927.10502953)."""
    z, rate = 1.96, successes / episodes
    centre = rate + z * z / (2 * episodes)
    half = z * math.sqrt(rate * (1 - rate) / episodes + z * z / (4 * episodes**2))
    return tuple((centre + side * half) / (1 + z * z / episodes) for side in (-1, 1))  # type: ignore[return-value]


def measured(env_id: str, planner: Planner, seeds: Sequence[int]) -> dict[str, Any]:
    """Measure the row of a task: an episode from each seed."""
    with making(env_id):
        env = gym.make(env_id)
        model = gym.make_vec(
            env_id, planner.samples, vectorization_mode="vector_entry_point", max_episode_steps=-1
        )
    own: Any = env.unwrapped
    model.reset(seed=0)
    model.step(np.zeros(model.action_space.shape, np.float32))  # compiles
    episodes = []
    for seed in seeds:
        episodes.append(play(env, model, seed, planner))
        print(
            "seed {seed}: return {return:.3f}, success {success}, {seconds:.0f} s".format(**episodes[-1]),
            flush=True,
        )
    found, successes = [one["return"] for one in episodes], sum(one["success"] for one in episodes)
    seconds, steps = sum(one["seconds"] for one in episodes), sum(one["steps"] for one in episodes)
    return {
        "task": env_id,
        "algorithm": "plan",
        "planner": asdict(planner),
        "first_seed": seeds[0],
        "episodes": len(seeds),
        "mean_return": round(float(np.mean(found)), 6),
        "return_interval": [
            round(end, 6) for end in interval([np.array(found)], lambda all_: float(np.mean(all_)))
        ],
        "success_rate": successes / len(seeds),
        "success_interval": [round(end, 4) for end in wilson(successes, len(seeds))],
        "seconds": round(seconds, 1),
        "real_time_factor": round(seconds / (steps * own.episodes.task.period), 2),
        "probe": probe(env_id),
        **made_with(),
    }


def add(path: Path, row: dict[str, Any]) -> None:
    """Write a row to a file of such rows, in place of one of the same task."""
    rows = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    kept = {old["task"]: old for old in rows} | {row["task"]: row}
    write_atomically(path, "[\n" + ",\n".join(json.dumps(kept[task]) for task in sorted(kept)) + "\n]\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    usual = Planner()
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--id", required=True, help="environment id")
    parser.add_argument(
        "--episodes", type=whole(1, 10_000), default=5, help="number of episodes (default: 5)"
    )
    parser.add_argument(
        "--seed", type=whole(0, 2**31), default=HELD_OUT_SEED, help="seed of the first episode"
    )
    for name, most in (("samples", 100_000), ("horizon", 10_000), ("iterations", 1000)):
        value = getattr(usual, name)
        parser.add_argument(
            f"--{name}", type=whole(2 if name != "iterations" else 1, most), default=value, help=f"({value})"
        )
    parser.add_argument("--json", type=Path, help="write the row to this file")
    options = parser.parse_args(arguments)
    planner = Planner(options.samples, options.horizon, options.iterations)

    def run() -> int:
        row = measured(options.id, planner, range(options.seed, options.seed + options.episodes))
        low, high = row["return_interval"]
        least, most = row["success_interval"]
        print(
            f"{options.id}: {options.episodes} episodes, seeds from {options.seed}\n"
            f"return {row['mean_return']:.3f} ({low:.3f}–{high:.3f})\n"
            f"success {100 * row['success_rate']:.0f} % ({100 * least:.0f}–{100 * most:.0f})\n"
            f"{row['real_time_factor']:.2f} s of one core a simulated second"
        )
        if options.json:
            add(options.json, row)
        return 0

    return guarded("plan.py", run, MENDABLE)


if __name__ == "__main__":
    sys.exit(main())
