"""Check whether an agent exploits errors of the simulation: replay its episodes with smaller errors.

    python agents/studies/audit.py runs/SpringTop-v0-ppo-0
    python agents/studies/audit.py classical --env SpringTop-v0 --episodes 200

An agent that exploits errors of the integrator earns less if these errors are smaller. The script plays the
same held-out episodes with the step h of the training, with h/4, with another method, and with the rigid
twin, which has no springs to exploit. Where bodies collide, the twin is left out: rigid bodies rebound
otherwise, and classical control, too, earns up to a quarter less there. The agent observes and acts in each
of them. The script reports the loss as a share of the return, with a 95 % interval. The agent survives a
simulation if its loss is certainly less than 2 %, and does not survive if it is certainly more. Otherwise
there are too few episodes. Simulations that do not exist for an environment are not played. The exit status
is 0 if the agent survives all simulations that were played, and at least one was.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import _path  # noqa: F401  (first)
import gymnasium as gym
import numpy as np
from config import MENDABLE, ConfigError, add_overrides, command_line, making, new_file, whole
from evaluate import LAST_SEED, MOST_EPISODES, Evaluation, evaluate, find_task, named, percent, score
from runs import HELD_OUT_SEED

from springgym.cli import guarded, write_text
from springgym.dynamics.methods import integrator
from springgym.dynamics.methods.record import refusal
from springgym.envs.randomisation import varying

OTHERS = ("rk4", "dopri5", "pefrl")
"""Methods to replace the usual one: the first that the scene allows is taken."""
FINER = 4
MARGIN = 0.02
"""Share of its return that an agent may lose."""
ONE_SIDED = 1.645

Verdict = Literal["survives", "does not survive", "undecided", "not played"]


def verdict(own: float, lost: float, error: float) -> Verdict:
    """Return whether a return survives a loss of a known standard error, at 95 % certainty.

    A return of 0 has nothing to lose: of it nothing is known.
    """
    most = MARGIN * abs(own)
    doubt = ONE_SIDED * error
    if own == 0 or not math.isfinite(lost + error):
        return "undecided"
    if lost + doubt < most:
        return "survives"
    return "does not survive" if lost - doubt > most else "undecided"


@dataclass(frozen=True)
class Finding:
    """The return of an agent in another simulation, compared with its own."""

    simulation: str
    return_per_step: float | None = None
    success_rate: float | None = None
    lost: float | None = None
    """return per step, in the mean of the episodes"""
    error: float | None = None
    """standard error of the mean"""
    verdict: Verdict = "not played"
    refused: str = ""
    """why there is no such simulation"""


def simulations(env_id: str, kwargs: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any] | str]]:
    """Return names of simulations, and the arguments that make them, or why there is none."""
    with making(env_id):
        env: Any = gym.make(env_id, **kwargs).unwrapped
    if not hasattr(env, "episodes"):
        raise ConfigError(f"{env_id} is not a springgym environment, so its simulation cannot be audited")
    simulator = env.episodes.simulator
    scene = simulator.scene
    step = simulator.step
    method = simulator.integrator.name
    collide = "bodies collide, and rigid ones rebound otherwise" if scene.meetings else None
    yield f"{method}, h = {1e3 * step:.3g} ms", {}
    yield f"{method}, h/{FINER}", {"step": step / FINER}
    if simulator.dynamics == "rigid":
        yield "springs", collide or {"dynamics": "springs"}
        return
    changing = tuple(varying(env.episodes.ranges, scene))
    usable = [name for name in OTHERS if name != method and not refusal(integrator(name), scene, changing)]
    if usable:
        yield f"{usable[0]}, h", {"integrator": usable[0], "step": step}
    else:
        yield "another method", f"only {method} has what the scene needs"
    yield "rigid twin", collide or {"dynamics": "rigid", "integrator": None, "step": None}


def audit(agent: str, env_id: str, kwargs: Mapping[str, Any], episodes: int, seed: int) -> list[Finding]:
    """Play the same episodes in each simulation; the first is the agent's own, which it survives."""
    findings: list[Finding] = []
    own: Evaluation | None = None
    for name, change in simulations(env_id, kwargs):
        if isinstance(change, str):
            findings.append(Finding(name, refused=change))
            continue
        try:
            found = evaluate(agent, env_id, {**kwargs, **change}, episodes, seed)
        except ConfigError as error:
            if own is None:
                raise
            findings.append(Finding(name, refused=str(error)))
            continue
        earned = found.return_per_step
        success = found.success_rate
        if own is None:
            own = found
            findings.append(Finding(name, earned, success, 0.0, 0.0, "survives"))
            continue
        lost = np.subtract(own.returns_per_step, found.returns_per_step)
        mean = float(np.mean(lost))
        error_of_mean = float(np.std(lost, ddof=1) / np.sqrt(len(lost)))
        said = verdict(own.return_per_step, mean, error_of_mean)
        findings.append(Finding(name, earned, success, mean, error_of_mean, said))
    return findings


def survives(findings: Sequence[Finding]) -> bool:
    """Return whether an agent survives all the other simulations that are played, and at least one is."""
    others = [found.verdict for found in findings[1:] if found.verdict != "not played"]
    return bool(others) and all(said == "survives" for said in others)


SAID = {"does not survive": "DOES NOT SURVIVE", "undecided": "undecided: it takes more episodes to tell"}
"""The printed words for verdicts, where they differ."""


def table(findings: Sequence[Finding], env_id: str) -> str:
    """Return the findings as lines of text, a row each."""
    scale, unit = score(env_id)
    rows = [["simulation", f"return/{unit}", "success", "lost", ""]]
    own = findings[0].return_per_step
    size = abs(own or 0.0)
    for n, found in enumerate(findings):
        if found.refused:
            rows.append([found.simulation, "–", "–", "–", f"not played: {found.refused}"])
            continue
        assert found.return_per_step is not None
        assert found.lost is not None
        assert found.error is not None
        lost = f"{100 * found.lost / size:+.2f} ± {196 * found.error / size:.2f} %" if n and size else ""
        said = "" if n == 0 else SAID.get(found.verdict, found.verdict)
        earned = f"{scale * found.return_per_step:.4g}"
        rows.append([found.simulation, earned, percent(found.success_rate), lost, said])
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    return "\n".join(
        "  ".join([cell.ljust(width) for cell, width in zip(row[:4], widths, strict=True)] + row[4:]).rstrip()
        for row in rows
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = command_line(__doc__)
    parser.add_argument("agent", help="a run folder, an environment id, or noop, random, classical")
    parser.add_argument("--env", help="environment id, unless the agent is a run folder")
    parser.add_argument("--episodes", type=whole(2, MOST_EPISODES), default=100)
    parser.add_argument(
        "--seed", type=whole(0, LAST_SEED), default=HELD_OUT_SEED, help="seed of the first episode"
    )
    add_overrides(parser)
    parser.add_argument("--json", type=new_file(), metavar="FILE", help="write the findings to this file")
    options = parser.parse_args(arguments)
    return guarded("audit.py", lambda: _audit(options), MENDABLE)


def _audit(options: argparse.Namespace) -> int:
    agent = named(options.agent)
    env_id, kwargs = find_task([agent], options.env, options.overrides)
    findings = audit(agent, env_id, kwargs, options.episodes, options.seed)
    print(f"{env_id}: {options.agent}, {options.episodes} episodes\n{table(findings, env_id)}")
    if options.json:
        write_text(options.json, json.dumps([vars(found) for found in findings], indent=1) + "\n")
    return 0 if survives(findings) else 1


if __name__ == "__main__":
    sys.exit(main())
