"""Evaluate agents on the same held-out episodes, without exploration.

    springgym evaluate runs/SpringTop-v0-ppo-0 noop random classical
    springgym evaluate classical --env SpringTop-v0 --set action=impulse --episodes 200
    springgym evaluate SpringTop-v0

An agent is a run folder, an environment id (for the published agent of that environment), the name of a
baseline (noop, random, classical), or ``module:function``, a function from observations to actions. The
return is the sum of rewards divided by the time limit, so an episode that ends early earns nothing for the
rest; SpringDuel, SpringStack and SpringBilliards are scored per episode. The other columns are means over the
episodes of entries of the last ``info``. The number after ± is the standard deviation over the episodes, –
means not defined.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from config import (
    MENDABLE,
    Config,
    ConfigError,
    add_overrides,
    command_line,
    load_config,
    making,
    new_file,
    parse_assignments,
    whole,
)
from controllers import UNTRAINED, controller_env_kwargs, make_controller
from runs import HELD_OUT_SEED, Run, load_policy, open_run, time_limit

import springgym  # noqa: F401  (registers the environments)
from springgym.checks import printable
from springgym.cli import guarded, write_text
from springgym.envs.agent import Policy
from springgym.envs.registration import find, nearest_id, spec_of
from springgym.envs.trained import published

#: Keyword arguments of an environment that belong to the agent and not to the task.
INTERFACE = ("observation", "action", "goals")

MOST_EPISODES = 500_000
LAST_SEED = 2**31 - 1 - MOST_EPISODES


@dataclass(frozen=True)
class Evaluation:
    """The episodes that one agent played (the seeds run upwards from ``first_seed``)."""

    agent: str
    first_seed: int
    returns_per_step: list[float]
    lengths: list[int]
    successes: list[bool] | None
    last_infos: dict[str, list[float]]

    @property
    def return_per_step(self) -> float:
        """Return the mean over the episodes."""
        return float(np.mean(self.returns_per_step))

    @property
    def success_rate(self) -> float | None:
        """Return the fraction of the episodes; None if the environment does not say."""
        return None if self.successes is None else float(np.mean(self.successes))


def task_kwargs(config: Config) -> dict[str, Any]:
    """Return keyword arguments of the environment that a configuration's agents are evaluated in."""
    return {**config.env_kwargs, **config.eval_env_kwargs}


def find_task(
    agents: Sequence[str], env_id: str | None, overrides: Sequence[str]
) -> tuple[str, dict[str, Any]]:
    """Return the environment and keyword arguments: those of the first run folder, or of configs/ppo.yaml.

    A run folder may be anyone's: a module that it names is imported only if ``env_id`` names it, too.
    """
    runs = [open_run(Path(agent)) for agent in agents if Path(agent).is_dir()]
    if not runs and not env_id:
        strange = [a for a in agents if a not in UNTRAINED and ":" not in a]
        which = f"{strange[0]!r} is no run folder, environment id or baseline; " if strange else ""
        raise ConfigError(f"{which}name the environment with --env, or give a run folder")
    if not env_id and ":" in runs[0].env_id:
        raise ConfigError(
            f"{runs[0].folder} names a module to import; to allow this, add --env {runs[0].env_id}"
        )
    env_id = env_id or runs[0].env_id
    kwargs = task_kwargs(runs[0].config if runs else load_config("ppo", env_id))
    return env_id, {**kwargs, **parse_assignments(overrides)}


def evaluate(
    agent: str,
    env_id: str,
    env_kwargs: Mapping[str, Any],
    episodes: int = 100,
    first_seed: int = HELD_OUT_SEED,
) -> Evaluation:
    """Run one episode from each of ``episodes`` seeds, all at once, with one agent."""
    from springgym.envs.sb3 import make_sb3  # the only part that needs Stable-Baselines3: watching does not

    run = trained_on(agent, env_id)
    kwargs = trained_kwargs(run, env_kwargs) if run else controller_env_kwargs(agent, env_id, env_kwargs)
    with making(env_id):
        env = make_sb3(env_id, episodes, env_kwargs=kwargs)
    try:
        policy = (
            load_policy(run, env.observation_space, env.action_space)
            if run
            else make_controller(agent, env_id, env_kwargs, env.action_space)
        )
        limit = time_limit(env.get_attr("spec")[0])
        last_infos = _run_one_episode_each(env, policy, first_seed)
    finally:
        env.close()
    scalars = [
        key
        for key, value in last_infos[0].items()
        if isinstance(value, (bool, int, float)) and key not in ("is_success", "TimeLimit.truncated")
    ]
    return Evaluation(
        agent=agent,
        first_seed=first_seed,
        returns_per_step=[float(info["episode"]["r"]) / limit for info in last_infos],
        lengths=[int(info["episode"]["l"]) for info in last_infos],
        successes=[bool(info["is_success"]) for info in last_infos]
        if "is_success" in last_infos[0]
        else None,
        last_infos={key: [float(info[key]) for info in last_infos] for key in scalars},
    )


def named(agent: str) -> str:
    """Return the folder of the published agent of an environment, and any other name as it is.

    Raises
    ------
    UnknownEnvironment
        If the name is like an id, and is none.
    """
    if Path(agent).is_dir() or agent in UNTRAINED or ":" in agent:
        return agent
    if find(agent):
        return str(published(agent))
    if nearest_id(agent):
        spec_of(agent)  # which says what is meant
    return agent


def trained_on(agent: str, env_id: str) -> Run | None:
    """Return the run of an agent's folder; None for the name of a baseline."""
    if not Path(agent).is_dir():
        return None
    run = open_run(Path(agent))
    if run.env_id != env_id:
        raise ConfigError(f"{agent} was trained on {run.env_id}, not on {env_id}")
    return run


def trained_kwargs(run: Run, env_kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a task, with observation and action as the agent was trained."""
    task = {k: v for k, v in env_kwargs.items() if k not in INTERFACE}
    return task | {k: v for k, v in run.config.env_kwargs.items() if k in INTERFACE}


def _run_one_episode_each(env: Any, policy: Policy, first_seed: int) -> list[dict[str, Any]]:
    """Return the last info of the first episode of every copy; copy i starts from first_seed + i."""
    env.seed(range(first_seed, first_seed + env.num_envs))
    observations = env.reset()
    last_infos: list[dict[str, Any] | None] = [None] * env.num_envs
    while any(info is None for info in last_infos):
        observations, _, dones, infos = env.step(policy(observations))
        for i in np.flatnonzero(dones).tolist():
            if last_infos[i] is None:
                last_infos[i] = infos[i]
    return [info for info in last_infos if info is not None]


def score(env_id: str) -> tuple[int, str]:
    """Return the factor from return per step to score, and what a task is scored per: "step" or "episode"."""
    found = find(env_id)
    return (
        (found[0].max_episode_steps, "episode") if found and found[0].scored_per == "episode" else (1, "step")
    )


def percent(rate: float | None) -> str:
    """Return a share in per cent; a dash for None."""
    return "–" if rate is None else f"{100 * rate:.0f} %"


def table(evaluations: Sequence[Evaluation], env_id: str) -> str:
    """Return the evaluations as lines of text, one agent a line; the JSON file holds everything."""
    scale, unit = score(env_id)
    extra = [key for key in evaluations[0].last_infos if not key.startswith(("reward_", "energy"))]
    header = ["agent", f"return/{unit} ± SD", "success", "steps", *extra]
    rows = [header]
    for e in evaluations:
        spread = scale * float(np.std(e.returns_per_step))
        rows.append(
            [
                printable(e.agent),
                f"{scale * e.return_per_step:.3f} ± {spread:.3f}",
                percent(e.success_rate),
                f"{np.mean(e.lengths):.0f}",
                *(f"{np.mean(e.last_infos[key]):.3g}" for key in extra),
            ]
        )
    widths = [max(len(row[i]) for row in rows) for i in range(len(header))]
    return "\n".join(
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        for row in rows
    )


def write_json(path: Path, evaluations: Sequence[Evaluation]) -> None:
    """Write the evaluations, summary first."""
    content = [
        {"return_per_step": e.return_per_step, "success_rate": e.success_rate, **asdict(e)}
        for e in evaluations
    ]
    write_text(path, json.dumps(content, indent=1) + "\n")


def main(arguments: Sequence[str] | None = None, program: str = "evaluate.py") -> int:
    """Run the command line."""
    parser = command_line(__doc__, program)
    parser.add_argument(
        "agents", nargs="+", help="run folders; environment ids; noop, random, classical; module:function"
    )
    parser.add_argument("--env", help="environment id (default: that of an agent)")
    parser.add_argument("--episodes", type=whole(1, MOST_EPISODES), default=100)
    parser.add_argument(
        "--seed", type=whole(0, LAST_SEED), default=HELD_OUT_SEED, help="seed of the first episode"
    )
    add_overrides(parser)
    parser.add_argument("--json", type=new_file(), metavar="FILE", help="write the evaluations to this file")
    options = parser.parse_args(arguments)
    return guarded(program, lambda: _compare(options), MENDABLE)


def _compare(options: argparse.Namespace) -> int:
    agents = [named(agent) for agent in options.agents]
    env_id, env_kwargs = find_task(agents, options.env, options.overrides)
    evaluations = [
        replace(evaluate(agent, env_id, env_kwargs, options.episodes, options.seed), agent=name)
        for name, agent in zip(options.agents, agents, strict=True)
    ]
    print(f"{env_id}: {options.episodes} episodes, seeds from {options.seed}\n{table(evaluations, env_id)}")
    if options.json:
        write_json(options.json, evaluations)
    return 0


if __name__ == "__main__":
    sys.exit(main())
