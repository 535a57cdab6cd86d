"""Record episodes of agents as Minari data sets, for offline learning.

    python agents/studies/dataset.py SpringTop-v0 random classical SpringTop-v0
    python agents/studies/dataset.py SpringTop-v0 planner --episodes 10 --set observation=features
    python agents/studies/dataset.py SpringTop-v0 runs/medium --noise 0.3

An agent is what ``agents/evaluate.py`` takes, or ``planner``, which is ``agents/plan.py``. Each becomes a
data set ``springgym/TASK/AGENT-v0`` in Minari's folder, which the variable ``MINARI_DATASETS_PATH`` names.
The agent that is published is called ``published`` there, and a run folder by its name. Agents observe what
they observe in an evaluation; ``--set`` says it for those that do not look. An episode of each seed is
played, without exploration. ``--noise`` adds random numbers to all actions, so that the data shows what other
actions lead to, and the data set is called AGENT-noisy-v0. From data without such variety one can only learn
to imitate.

For data of medium quality, record an agent that was trained for a part of the steps, as by
``springgym train SpringTop-v0 --timesteps 150000 --out runs/medium``.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import _path  # noqa: F401  (first)
import gymnasium as gym
import numpy as np
from config import (
    MENDABLE,
    ConfigError,
    add_overrides,
    command_line,
    making,
    number,
    parse_assignments,
    whole,
)
from controllers import controller_env_kwargs, make_controller
from evaluate import named, trained_kwargs, trained_on
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from plan import planner_of
from plan import play as play_plans
from runs import DATASET_SEED, load_policy, time_limit

import springgym  # noqa: F401  (registers the environments)
from springgym.cli import guarded
from springgym.core.extras import missing
from springgym.envs.registration import find, spec_of


class Recorded(VectorWrapper):
    """A batch that records the first episode of each copy.

    Normal noise is added to the actions, of a standard deviation of ``noise`` times half their range.
    """

    def __init__(self, env: VectorEnv, noise: float = 0.0) -> None:
        super().__init__(env)
        self.noise, self.rng = noise, np.random.default_rng()
        self.seeds: list[int] = []
        self.observations: list[Any] = []
        self.steps: list[tuple[np.ndarray, ...]] = []
        """actions, rewards, and whether episodes terminated and were truncated, of each step"""

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        observations, infos = self.env.reset(seed=seed, options=options)
        self.seeds = list(seed)
        self.observations = [observations]
        self.steps = []
        self.rng = np.random.default_rng(self.seeds)
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        if self.noise:
            low, high = self.action_space.low, self.action_space.high  # type: ignore[attr-defined]
            added = 0.5 * self.noise * (high - low) * self.rng.standard_normal(np.shape(actions))
            actions = np.clip(actions + added, low, high).astype(np.float32)
        result = self.env.step(actions)
        self.observations.append(result[0])
        self.steps.append((np.array(actions), *result[1:4]))
        return result

    def episodes(self) -> list[dict[str, Any]]:
        """Return what was recorded of each copy, until its episode ended."""
        found = []
        for copy, seed in enumerate(self.seeds):
            ends = [bool(ended[copy] or cut[copy]) for _, _, ended, cut in self.steps]
            count = ends.index(True) + 1
            columns = zip(*((values[copy] for values in step) for step in self.steps[:count]), strict=True)
            actions, rewards, terminations, truncations = map(list, columns)
            found.append(
                {
                    "id": copy,
                    "seed": seed,
                    "observations": [_of(seen, copy) for seen in self.observations[: count + 1]],
                    "actions": actions,
                    "rewards": [float(reward) for reward in rewards],
                    "terminations": [bool(ended) for ended in terminations],
                    "truncations": [bool(cut) for cut in truncations],
                }
            )
        return found


def _of(seen: Any, copy: int) -> Any:
    """Return what one copy observes."""
    if isinstance(seen, dict):
        return {name: own[copy] for name, own in seen.items()}
    return np.array(seen[copy])


def recorded(
    agent: str, env_id: str, env_kwargs: Mapping[str, Any], seeds: Sequence[int], noise: float = 0.0
) -> tuple[list[dict[str, Any]], Any]:
    """Play an episode from each seed; return them, and the spec of a single environment for them."""
    own = named(agent)
    run = trained_on(own, env_id)
    kwargs = trained_kwargs(run, env_kwargs) if run else controller_env_kwargs(agent, env_id, env_kwargs)
    kwargs = kwargs if agent != "planner" else dict(env_kwargs)
    made: dict[str, Any] = {"vectorization_mode": "vector_entry_point"}
    made["autoreset_mode"] = AutoresetMode.NEXT_STEP
    with making(env_id):
        spec = gym.make(env_id, **kwargs).spec
        envs = Recorded(gym.make_vec(env_id, len(seeds), **made, **kwargs), noise)
    try:
        if agent == "planner":
            planner = planner_of(env_id)
            endless = {**kwargs, "max_episode_steps": -1}
            model = gym.make_vec(env_id, len(seeds) * planner.samples, **made, **endless)
            model.reset(seed=0)
            play_plans(envs, model, seeds, planner)
        else:
            spaces = envs.single_observation_space, envs.single_action_space
            policy = (
                load_policy(run, *spaces) if run else make_controller(agent, env_id, env_kwargs, spaces[1])
            )
            seen, _ = envs.reset(seed=list(seeds))
            over = np.zeros(len(seeds), bool)
            for _ in range(time_limit(envs.spec)):  # type: ignore[arg-type]
                seen, _, terminated, truncated, _ = envs.step(policy(seen))
                over |= terminated | truncated
                if over.all():
                    break
        return envs.episodes(), spec
    finally:
        envs.close()


def write(
    agent: str, env_id: str, env_kwargs: Mapping[str, Any], seeds: Sequence[int], noise: float = 0.0
) -> Any:
    """Record an agent and return its data set, replacing one of the same name."""
    import minari
    from minari.data_collector.episode_buffer import EpisodeBuffer

    episodes, spec = recorded(agent, env_id, env_kwargs, seeds, noise)
    name = Path(agent).name if Path(agent).is_dir() else "published" if find(agent) else agent
    name += "-noisy" if noise else ""
    of = env_id.rpartition(":")[2].partition("-v")[0]
    dataset_id = f"springgym/{of}/{name.replace(':', '-')}-v0"
    if dataset_id in minari.list_local_datasets():
        minari.delete_dataset(dataset_id)
    return minari.create_dataset_from_buffers(
        dataset_id,
        [EpisodeBuffer(**episode) for episode in episodes],
        env=spec,
        eval_env=spec,
        algorithm_name=name,
        author="springgym",
        description=f"{len(episodes)} episodes of {env_id}, seeds from {seeds[0]}, by {name}, {noise=:g}.",
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = command_line(__doc__)
    parser.add_argument("env_id", help="environment id")
    parser.add_argument(
        "agents", nargs="+", help="run folders; the environment's id; noop, random, classical, planner"
    )
    parser.add_argument("--episodes", type=whole(1, 100_000), default=100, help="of each (default: 100)")
    parser.add_argument("--seed", type=whole(0, 2**31), default=DATASET_SEED, help="of the first episode")
    parser.add_argument("--noise", type=number(0, 1), default=0.0, help="of actions, 1 for half their range")
    add_overrides(parser)
    options = parser.parse_args(arguments)

    def run() -> int:
        spec_of(options.env_id)
        if find_spec("minari") is None:
            raise ConfigError(missing("dataset.py", "Minari", "minari"))
        kwargs = parse_assignments(options.overrides)
        for agent in options.agents:
            seeds = range(options.seed, options.seed + options.episodes)
            data = write(agent, options.env_id, kwargs, seeds, options.noise)
            print(f"{data.spec.dataset_id}: {data.total_episodes} episodes, {data.total_steps} steps")
        return 0

    return guarded("dataset.py", run, MENDABLE)


if __name__ == "__main__":
    sys.exit(main())
