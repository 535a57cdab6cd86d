"""Write the pages on environments from their docstrings and from what was measured; measure nothing.

python docs/environments.py                       # environments.md, features.md, a page of each environment
python docs/measured.py --write errors variants    # measures, and writes them
"""

from __future__ import annotations

import argparse
import ast
import inspect
import json
import math
import re
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "agents"))

from evaluate import score  # noqa: E402
from results import interval_of_mean, is_old  # noqa: E402

from benchmarks.curves import cost  # noqa: E402
from benchmarks.errors import EPISODES, EVERY, PERIODS  # noqa: E402
from springgym.cli import write_text  # noqa: E402
from springgym.envs.randomisation import RANDOMIZABLE  # noqa: E402
from springgym.envs.registration import ENVIRONMENTS, VARIANTS, Row  # noqa: E402

PAGE = HERE / "environments.md"
FEATURES = HERE / "features.md"
FOLDER = PAGE.with_suffix("")
NUMBERS = HERE / "numbers.json"
CARDS = HERE.parent / "agents" / "trained"
NEW: frozenset[str] = frozenset()
"""Ids of environments and variants whose results and pictures are still to be made: see CONTRIBUTING.md.

They have their pages, and stand in no table or test of what was measured. None is left at a release."""
MEASURED = tuple(row for row in ENVIRONMENTS if row.id not in NEW)
SEEDS = 100
FEWEST = 3
"""Number of training seeds from which an interval is drawn, if rows do not hold their episodes."""
BASELINES = ("noop", "random", "classical")
ALGORITHMS = ("ppo", "classical", "linear", "sac", "tqc", "her", "planner", "random", "noop")
"""In the order of the columns: on a phone, the first is seen without scrolling."""

Report = Mapping[str, Any]


def read() -> dict[str, Any]:
    """Read the measured numbers by section, with the rows of the benchmark and of the learning times."""
    found: dict[str, Any] = json.loads(NUMBERS.read_text(encoding="utf-8"))
    others = {"baselines": "baselines.json", "learning": "learning_time.json"}
    for name, path in others.items():
        found[name] = json.loads((HERE / path).read_text(encoding="utf-8"))
    return found


def environment(row: Row, suffix: str) -> Any:
    """Return a class of an environment: its task, or with a suffix, its single environment or its batch."""
    return getattr(import_module(f"springgym.envs.tasks.{row.module}"), row.name + suffix)


def docstring(row: Row) -> str:
    """Return what the class of an environment says, in Markdown."""
    return inspect.cleandoc(environment(row, "Env").__doc__)


# --- The page of an environment ---------------------------------------------------------------------


def describe(row: Row, report: Report) -> str:
    """Return the page of an environment: film, spaces, error, docstring, baselines and versions."""
    told = [*film(row), *in_short(row, report), docstring(row), "", *baselines(row, report)]
    versions = (
        [] if "## Version History\n" in docstring(row) else ["## Version History\n", "v0: first version.\n"]
    )
    return "\n".join([f"# {row.id}\n", *told, *versions])


def film(row: Row) -> list[str]:
    """Return the poster of the trained agent's film; the site puts the film in its place."""
    if row.id in NEW:
        return []
    card = json.loads((CARDS / row.id / "card.json").read_text(encoding="utf-8"))
    caption = f"The published agent, trained by {card['algorithm'].upper()}."
    return [f"![{caption}](../figures/posters/{row.id}.webp)\n"]


def in_short(row: Row, report: Report) -> list[str]:
    """Return the table that the page of an environment begins with, as Gymnasium's pages do."""
    Made = environment(row, "")
    task = Made()
    actions: dict[object, str] = {}
    for action in Made.actions:
        actions.setdefault(str(Made(action=action).action_space), action)
    observations = {kind: Made(observation=kind).observation_space for kind in Made.observations}
    told = {
        "Import": f'`gymnasium.make("{row.id}")`, after `import springgym`',
        "Action space": _spaces("action", {action: space for space, action in actions.items()}),
        "Observation space": _spaces("observation", observations),
        "Reward": "between 0 and 1 a step",
        "Episode": f"{steps_of(row)}, {row.max_episode_steps * task.periods * task.period:g} s",
        "Tier": f"[{row.tier}](../environments.md#tiers-and-harder-variants); solved at a return of "
        f"{row.reward_threshold:g}",
    }
    for env_id, options, own in _errors(report):
        if env_id == row.id and not options:
            told["Sub-step"] = f"{own['step_ms']:.3g} ms"
            told["Error of a step"] = (
                f"median {own['median']:.1e}, largest {own['high']:.1e} of the body's size "
                "([how measured](../features.md#error-of-a-control-period))"
            )
    head, *lines = (f"| {name} | {what} |" for name, what in told.items())
    return [head, "|---|---|", *lines, ""]


def _spaces(argument: str, spaces: Mapping[str, object]) -> str:
    """Return the spaces of the values of an argument; the first is the usual one."""
    first, *others = spaces.items()
    told = [f"`{first[1]}`", *(f'`{space}` with `{argument}="{value}"`' for value, space in others)]
    return "<br>".join(told)


def steps_of(row: Row) -> str:
    """Return the number of steps of an episode."""
    return f"{row.max_episode_steps} step{'s' * (row.max_episode_steps > 1)}"


def baselines(row: Row, report: Report) -> list[str]:
    """Return what algorithms reach in an environment, in one sentence, and its learning curves."""
    if row.id in NEW:
        return ["## Baselines\n", "Not measured yet.\n"]
    found: dict[str, list[Report]] = defaultdict(list)
    for own in report["baselines"]:
        if own["task"] == row.id:
            found[own["algorithm"]].append(own)
    scale, unit = measure(row.id)
    told = []
    for name in (name for name in ALGORITHMS if name in found):
        runs = found[name]
        earned, success = (np.mean([run[key] for run in runs]) for key in ("mean_return", "success_rate"))
        told.append(f"{name} {scale * earned:z.2f}, {100 * success:.0f} %")
    old = any(is_old(own) for runs in found.values() for own in runs)
    return [
        "## Baselines\n",
        f"Return per {'episode' if unit else 'step'} and success: {'; '.join(told)}. "
        f"[All results](../baselines.md){'; some are outdated.' if old else '.'}\n",
        *learning_curves(row, report),
    ]


def shown(runs: Sequence[Report], best: bool = False) -> str:
    """Return a cell of a table of baselines: mean return and success; below, its interval (seeds)."""
    mean, *others = of_runs(runs)
    success = sum(run["success_rate"] for run in runs) / len(runs)
    first = f"{f'**{mean}**' if best else mean}, {100 * success:.0f} %"
    cell = "<br>".join(filter(None, (first, " ".join(filter(None, others)))))
    return cell.replace(" ", "\N{NO-BREAK SPACE}")  # a phone scrolls sideways and shows whole cells


def earned(runs: Sequence[Report]) -> str:
    """Return the mean return of runs of a task, with its interval, and how many they are.

    It is in the unit of `measure`.
    """
    mean, interval, seeds = of_runs(runs)
    told = ", ".join(filter(None, (interval, seeds.strip("()"))))
    return f"{mean}{told and f' ({told})'}{measure(runs[0]['task'])[1]}"


def of_runs(runs: Sequence[Report]) -> tuple[str, str, str]:
    """Return the mean return of runs of a task, its interval if it is known, and "(seeds)" of several."""
    scale, _ = measure(runs[0]["task"])
    means = scale * np.array([run["mean_return"] for run in runs])
    seeds = f"({len(runs)})" if len(runs) > 1 else ""
    interval = ""
    if len(runs) == 1 and "return_interval" in runs[0]:  # of the planner
        low, high = scale * np.array(runs[0]["return_interval"])
        interval = f"{low:z.2f}–{high:z.2f}"
    elif len(runs) >= FEWEST or all("returns" in run for run in runs):
        errors = [np.std(run.get("returns", [0.0])) / math.sqrt(run["episodes"]) for run in runs]
        low, high = interval_of_mean(means, scale * np.array(errors))
        interval = f"{low:z.2f}–{high:z.2f}"
    return f"{means.mean():z.2f}", interval, seeds


def measure(task: str) -> tuple[int, str]:
    """Return by what returns per step are multiplied on the pages, and what is written behind them.

    The text is empty for returns per step, see `evaluate.score`.
    """
    scale, unit = score(task)
    return scale, "" if unit == "step" else f" per {unit}"


def learning_curves(row: Row, report: Report) -> list[str]:
    """Return the figure of the learning curves of an environment, if rows of it have any."""
    if not any(own["task"] == row.id and own.get("curve") for own in report["baselines"]):
        return []
    return [f"![Learning curves](../figures/curves/{row.id}.svg)\n"]


class Trade(NamedTuple):
    """What errors cost in an environment."""

    usual: float
    """processor time of a step by default [µs]"""
    finer: float | None
    """of a tenth of the error, over that; None if no row reaches it"""
    saved: float
    """share that ten times the error saves"""


def trade(env_id: str, report: Report) -> Trade | None:
    """Return what a tenth of the default error costs, and what ten times of it would save.

    None if it was not measured yet.
    """
    rows = [own for own in report["curves"]["rows"] if own["environment"] == env_id]
    if not rows:
        return None
    (own,) = (row for row in rows if row["default"])
    usual = own["microseconds"]
    finer, coarser = (cost(rows, share * own["median"]) for share in (0.1, 10.0))
    return Trade(usual, finer and finer / usual, max(0.0, 1 - (coarser or usual) / usual))


# --- The list of environments -----------------------------------------------------------------------


def table_of_environments() -> list[str]:
    """A link to each page, with the first two sentences of its description: what there is, and what to do."""
    lines = ["| environment | task |", "|---|---|"]
    for row in ENVIRONMENTS:
        said = re.sub(r"\s+", " ", docstring(row).split("## Description\n")[1].split("\n## ")[0])
        aim = " ".join(re.split(r"(?<=[.]) ", said)[:2])
        lines.append(
            f"| [`{row.id}`](environments/{row.id}.md)<br>{row.tier}, {steps_of(row)}<br>"
            f"solved at {row.reward_threshold:g} | {aim} |"
        )
    pages = "\n".join(f"environments/{row.id}" for row in ENVIRONMENTS)
    return [*lines, "\n```{toctree}\n:hidden:\n\n" + pages + "\n```\n"]


def table_of_named_variants() -> list[str]:
    """The variants that have ids of their own."""
    lines = ["| variant | tier | arguments | difference |", "|---|---|---|---|"]
    for variant in VARIANTS:
        arguments = ", ".join(f"`{name}={value!r}`" for name, value in variant.arguments.items())
        lines.append(f"| `{variant.id}` | {variant.tier} | {arguments} | {variant.why} |")
    tiers = "\n".join(f"| {tier} | {what} |" for tier, what in TIERS.items())
    return [HARDER.format(tiers=tiers), *lines, ""]


# --- Variants ---------------------------------------------------------------------------------------


class Variant(NamedTuple):
    """An argument of an environment with a value, as its docstring tells."""

    arguments: dict[str, Any]
    written: str
    change: str
    """what is different"""


def variants(row: Row) -> list[Variant]:
    """Bullets "- `name=value`: what is different" of an environment's arguments."""
    bullets = docstring(row).split("## Arguments\n")[1].split("\n## ")[0].split("\n- ")
    found = []
    for bullet in bullets:
        if match := re.match(r"(?:- )?`(\w+)=([^`]+)`: (.*)", re.sub(r"\s+", " ", bullet)):
            name, value, change = match.groups()
            found.append(Variant({name: ast.literal_eval(value)}, f"`{name}={value}`", change.strip(" .")))
    return found


def actions_and_variants(row: Row) -> Iterator[tuple[str, Variant, dict[str, Any]]]:
    """Each action mode as it is and in every variant, with the arguments of both."""
    for action in environment(row, "").actions:
        for variant in (Variant({}, "", "none"), *variants(row)):
            yield action, variant, {"action": action} | variant.arguments


def measured_variants() -> Iterator[dict[str, Any]]:
    """Success and return per step of the controllers without learning: the rows of a section of numbers."""
    from evaluate import evaluate

    for row in ENVIRONMENTS:
        for *_, arguments in actions_and_variants(row):
            found: dict[str, Any] = {"environment": row.id, "arguments": repr(arguments)}
            for name in BASELINES:
                result = evaluate(name, row.id, arguments, SEEDS)
                found[name] = [result.success_rate, round(result.return_per_step, 4)]
            yield found


def table_of_variants(report: Report) -> list[str]:
    """Return what controllers without learning make of every action mode and variant of every environment."""
    names = tuple(reversed(BASELINES))
    lines = [
        "## Variants by keyword\n",
        "These keyword arguments make variants; each environment's page describes them. The last "
        f"columns show controllers without learning on {SEEDS} held-out episodes: success rate and return "
        "per step (in SpringDuel, SpringStack and SpringBilliards, success rate alone).\n",
        f"| environment | arguments | {' | '.join(names)} |",
        "|---|---|---|---|---|",
    ]
    reached = {(own["environment"], own["arguments"]): own for own in report["variants"]["rows"]}
    for row in ENVIRONMENTS:
        told = "{success:.3g} %" if measure(row.id)[1] else "{success:.3g} %, {earned:.2f}"
        for action, variant, arguments in actions_and_variants(row):
            own = reached.get((row.id, repr(arguments)))  # None: not measured yet
            figures = " | ".join(
                told.format(success=100 * own[n][0], earned=own[n][1]) if own else "–" for n in names
            )
            written = ", ".join(filter(None, (f'`action="{action}"`', variant.written)))
            lines.append(f"| `{row.id}` | {written} | {figures} |")
    return [*lines, ""]


# --- Error of a control period ----------------------------------------------------------------------


def table_of_errors(report: Report) -> list[str]:
    """Return the error of the default step of every environment."""
    lines = [
        "## Error of a control period\n",
        "The *error* of the default step is the largest distance of a particle from its exact position after "
        "one control period with a random action, relative to the body's size. It was measured in "
        f"{EPISODES} episodes of {PERIODS} control periods, at one period in {EVERY}. The exact motion is "
        "`dopri5` with a tolerance of 1e-13; on surfaces, `verlet` with steps of h/1024; for bodies that "
        "collide, with steps of h/64. The last column is the largest distance of this reference from a "
        "second one: `rk4` with h/128; on surfaces, `verlet` with h/256; for bodies that collide, with h/16. "
        "With friction, the error in contact falls only in proportion to the step.\n",
        "| environment | step h | median error | largest error | difference between references |",
        "|---|---|---|---|---|",
    ]
    for env_id, options, own in _errors(report):
        if not options:
            lines.append(
                f"| `{env_id}` | {own['step_ms']:.3g} ms | {own['median']:.1e} | {own['high']:.1e} | "
                f"{own['apart']:.0e} |"
            )
    return lines


def _errors(report: Report) -> Iterator[tuple[str, dict[str, str], dict[str, Any]]]:
    """The rows of the errors, as `benchmarks.errors` has them."""
    names = ("dtype", "integrator", "dynamics")
    for own in report["errors"]["rows"]:
        yield own["environment"], {name: own[name] for name in names if name in own}, own


# --- What error=True says of it ---------------------------------------------------------------------

WANTED = """## Choosing an error tolerance

`tolerance` sets a target per-step error, relative to the body's size. springgym then chooses the sub-step
and, unless you give one, the cheapest method whose errors stay below the target.

```python
import gymnasium

env = gymnasium.make("SpringTop-v0", tolerance=1e-5)
print(env.unwrapped.chosen)
env.reset(seed=0)
*_, info = env.step(env.action_space.sample())
assert info["error_bound"] <= 1e-5
```

- Making the environment takes a few seconds: springgym plays 16 episodes of 50 periods with random actions,
  starting with the factors of `randomize` at the ends of their ranges. `info["error_bound"]` is 1.5 times the
  largest error in these episodes, as `error=True` estimates it. This is an estimate, not a guarantee.
- `env.unwrapped.chosen` holds the method, the sub-steps of a control period, the largest error observed, and
  the cost in force evaluations.
- A batch makes the same choice as a single environment.
- A target that cannot be reached raises a ValueError, which names the smallest error that can. With friction,
  contact converges only to first order, so `SpringTumble-v0`, for example, stays above 5e-4.
- A larger tolerance takes fewer sub-steps, as far as the method is stable. Where bodies touch anything, it
  never takes fewer than the default.
"""


ESTIMATED = """## Error estimates at run time

With `error=True`, an environment estimates the error of each step, at three times the cost. It repeats the
control period from the same state with steps of half the length, and compares the two ends (Richardson
extrapolation). `info["step_error"]` is the largest error of a particle, relative to the size of its body, as
in the table above; batches return one number per environment. The trajectory stays bit-identical.

```python
import gymnasium
import springgym

env = gymnasium.make("SpringTop-v0", error=True)
env.reset(seed=0)
*_, info = env.step(env.action_space.sample())
assert 0 < info["step_error"] < 1e-3
```

- This is the error of one period. How fast errors grow over many periods depends on the motion.
- It uses the environment's randomised parameters.
- The first `info` of an episode reports 0, and after divergence it is infinity.
- With `dynamics="rigid"` it is the error of the rigid motion, not its distance from the motion of the
  springs.
- In float32 both runs round, so the estimate does not fall below about 1e-7.
- During impacts it is less reliable: with friction the method is of first order there, and an impact may fall
  into only one of the two runs.
- Environments with `dopri5`, which chooses its own steps, refuse `error=True`.
"""


def table_of_estimates(report: Report) -> list[str]:
    """Return how good the estimates are."""
    lines = [
        ESTIMATED,
        "This table divides the estimate by the true error, for the periods of the table above. For rigid "
        "bodies, the true error is the distance from the same method with steps of h/16, on surfaces of "
        "h/1024.\n",
        "| environment | arguments | median error | largest error | estimate / error, median | middle 90 % |",
        "|---|---|---|---|---|---|",
    ]
    for env_id, options, own in _errors(report):
        arguments = ", ".join(f'`{name}="{value}"`' for name, value in options.items())
        told = f"{own['estimate']:.3f} | {own['estimate_low']:.2f} … {own['estimate_high']:.2f}"
        if not math.isfinite(own["estimate"]):  # where most periods have no error to speak of
            told = "no error |"
        lines.append(f"| `{env_id}` | {arguments} | {own['median']:.1e} | {own['high']:.1e} | {told} |")
    return lines


# --- Texts ------------------------------------------------------------------------------------------

INTRODUCTION = """Each environment has a page with its spaces, reward, starting states, arguments and
baselines. Shared notation is defined [below](#shared-definitions). *Solved at* is the return of an episode,
the sum of its rewards, above which a task counts as solved (Gymnasium's `reward_threshold`).
"""

SHARED = """## Shared definitions

These definitions hold on the pages of all environments.

- **U(a, b)** is a number drawn uniformly between a and b.
- **Actions** lie in [−1, 1]; values outside are clipped.
- **Observations** are positions and velocities of particles (`observation="particles"`), or a few numbers
  such as axis and spin (`"features"`). Each number is divided by its *scale*, then clipped to ±10.
- **Rewards** lie between 0 and 1; `info` holds their terms, `reward_…`. With d = max(|x| − b, 0)/m, pages
  write G(x; b, m) = 0.1^(d²) and L(x; b, m) = 1/(1 + 9d²): both are 1 up to |x| = b, and 0.1 at b + m. The
  effort of the actions a gives the factor E = 1 − 0.1 mean(a²).
- **Divergence**: if the simulation diverges, the episode terminates with reward 0 and `info["diverged"]`.
- **Success**: `info["is_success"]`. An episode that ends in failure is not a success.
- **Rolling balls** have the inertia of a solid sphere, and are made of four particles and six springs.

In all environments, `info` has these entries, in addition to those on the environment's page:

| entry | meaning |
|---|---|
| `energy` | energy [J] |
| `energy_drift` | change of the energy balance since the start, the integrator's error [J] |
| `strain` | largest strain of any spring |
| `pairs_touching` | number of pairs of bodies in contact now (`pairs_…`: where bodies collide) |
| `pairs_impulse` | sum of the normal impulses between these bodies since the start [N·s] |
| `pairs_min_gap` | smallest gap of any pair since the start [m], at most the contact margin |
| `pairs_late_contacts` | number of contacts since the start that were detected too late |
| `coarse_contacts` | contacts since the start, per sub-step, that were too fast for their restitution |

All environments have these arguments (see `springgym.envs.base.SpringEnv`):

| argument | default | meaning |
|---|---|---|
| `observation` | `"particles"` | or `"features"` (SpringBilliards: `"features"` only) |
| `action` | first mode on the environment's page | action mode |
| `dynamics` | `"springs"` | or `"rigid"` (not SpringRope) |
| `integrator`, `step` | `"verlet"`, the sub-step on the environment's page | integrator and sub-step [s] |
| `dtype` | `"float64"` | or `"float32"` |
| `sparse` | `False` | reward 1 where the goal is met, else 0 |
| `goals` | `False` | [goal environments](features.md#goals), for four tasks |
| `randomize` | none | [ranges of factors](features.md#randomisation), for example for masses |
| `error` | `False` | [estimate](features.md#error-estimates-at-run-time) the error of each step |
| `tolerance` | none | [bound](features.md#choosing-an-error-tolerance) that error |
| `render_mode` | none | `"rgb_array"`, `"rgb_array_list"` or `"human"` |
"""

TIERS = {
    "easy": "A linear policy (`--algo linear`), found in seconds, solves these tasks.",
    "medium": "PPO solves most of these tasks with the package's hyperparameters; linear policies do not.",
    "hard": "Variants that are harder to control. PPO succeeds in most episodes.",
    "very hard": "PPO fails in most episodes, although these tasks can be solved.",
}
HARDER = """## Tiers and harder variants

| tier | meaning |
|---|---|
{tiers}
| sparse | Tasks with a sparse reward: no reward until the goal is met. |

Each variant has its own id, which begins with the name of its environment. [Baselines](baselines.md) shows
what each algorithm reaches.
"""

RANDOMISATION = f"""## Randomisation

`randomize={{"masses": (0.8, 1.2), …}}` draws a factor from each range at the start of every episode, for each
environment of a batch. You can randomise {", ".join(f"`{n}`" for n in RANDOMIZABLE)}.

- `scale` is the size of the body, of springs or rigid, at the same masses: its inertia grows as `scale`².
  Balls that meet other bodies keep their radius. `actuator` is the strength of the actions, including an
  opponent's.
- `info["randomization"]` holds the factors. `reset(options={{"randomize": {{"masses": 1.1}}}})` sets them.
- The default step is stable for the stiffest and lightest body in the ranges. springgym checks that a step of
  your choice is, too.
- Randomising gravity in free fall, friction and restitution without a surface, or stiffness and damping of
  rigid bodies raises a ValueError. Stiffness, damping and scale have no effect on a body without springs.
"""

GOALS = """## Goals

With `goals=True`, SpringGyroscope, SpringRope, SpringTumble and SpringShove expose the goal separately from
the observation, as [Gymnasium-Robotics](https://robotics.farama.org/content/multi-goal_api/) does, for
hindsight experience replay. Single environments and batches accept it, together with `sparse=True`:

```python
import gymnasium as gym
import numpy as np
import springgym

env = gym.make("SpringRopeSparse-v0", goals=True)
observation, info = env.reset(seed=0)
print({name: values.shape for name, values in observation.items()})
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
achieved, desired = observation["achieved_goal"], observation["desired_goal"]
assert reward == env.unwrapped.compute_reward(achieved, desired, info)
assert env.unwrapped.compute_reward(achieved, achieved, info) == 1.0
```

- `observation` holds the particles, without the goal. Positions are in world coordinates.
- `achieved_goal` and `desired_goal` hold the same quantities, in SI units; each environment's page lists
  them. They include velocities, because a goal must be reached at rest.
- The goal is reached if each quantity is closer to the desired one than its limit for success.
  `compute_reward` returns 1 or 0, for goals (K,) or (n, K). It equals the sparse reward (in SpringTumble, up
  to the strain of the body).
- Episodes do not end when a goal is reached, because success means holding it. Therefore there is no
  `compute_terminated`. Quantities of 100 m or m/s or more, and those after divergence, reach no goal.

[Your own tasks](tutorials/task.md) need two arguments for this. `achieved` returns the current values of the
goal's quantities, computed from the motion alone, not from `s.goal`. Each `GoalTolerance` names some of these
quantities, with their number and the distance within which they count as reached:

```python
from springgym.model.bodies import cube
from springgym.envs.goals import GoalTolerance
from springgym.model.scene import Scene


def start(rng):
    # the cube starts at rest; the goal is a position, and zero velocity there
    return cube().positions, np.zeros((8, 3)), [*rng.uniform(-1, 1, 3), 0, 0, 0]


def achieved(m, s):
    return np.hstack([m.centre, m.centre_velocity])


def reward(m, s):
    return 1 / (1 + np.linalg.norm(achieved(m, s) - s.goal, axis=1))


env = springgym.make_scene_env(
    Scene(cube(), gravity=None),
    reward,
    actuators={"force": 5.0},
    start=start,
    achieved=achieved,
    goal_tolerances=[GoalTolerance("place", 3, 0.1), GoalTolerance("velocity", 3, 0.1)],
    goals=True,
    sparse=True,
)
seen, info = env.reset(seed=0)
print(seen["achieved_goal"], seen["desired_goal"])
```

Without `goals=True`, `achieved` and `goal_tolerances` replace `success`: a step is successful where the goal
is reached.

[Train an agent](training.md#hindsight-experience-replay) shows hindsight experience replay.
"""

PROMISES = """## Seeds, states and versions

**Seeds.** Episodes are bit-for-bit reproducible from their seed, on one machine with one set of versions, in
a single environment or in a batch of any size, on any number of threads. A reset or step that raises an error
changes nothing, not even random generators. (Only the time limit of `gymnasium.make` restarts with any call
of `reset`.)

**Other machines and versions.** With other versions of Python, NumPy or Numba, or on another kind of
processor, the same seed draws the same numbers, and initial states agree to rounding. They are computed in
closed form, so they do not depend on LAPACK conventions. From there, regular motion stays close, and chaotic
trajectories diverge at their Lyapunov rate. A new version of springgym may start an episode differently from
the same seed; its changelog then says so. If the task changes, the version in the environment's id changes,
too.

**States.** `springgym.get_state(env)` returns the full state of an environment or a batch: positions and
velocities, clocks, goals, factors, actuators, the time limit, random generators, and the counts of the
monitor of `make_sb3`. `springgym.set_state(env, state)` restores it, in the same environment or in another
one with the same settings; what follows is bit-identical. Both functions work for environments made by
`gymnasium.make`, `gymnasium.make_vec`, `springgym.envs.parallel` and `springgym.envs.sb3.make_sb3`.

In a batch, `springgym.get_state(envs, copies)` returns the states of the environments with the indices
`copies`. `springgym.set_state(envs, state, copies)` sets one state for each of them or, for planning, a
single state in all of them. Each environment then continues as its original would, including resets, because
the state includes the random generator. To make them differ, reset them with new seeds.

- A state of an environment created with other settings, for example friction, step or variant, is refused
  with a message that names the difference. Only the time limit, `error` and, of a batch, the number of copies
  may differ.
- A state may be edited before it is set: the episode continues from the edited positions, velocities, goals
  and factors. Positions [m] are in `state["episodes"]["simulator"]["x"]["lanes"]`, velocities [m/s] likewise
  in `"v"`. Their shape is (blocks, N, 3, environments of a block), or (1, N, 3, 1) for a single environment.
  A state holds nothing twice: what follows from an entry is computed when the state is set. The state of a
  `Simulator` also holds the parameters that vary.
- An entry with a wrong type, shape or dtype, or with numbers that it cannot have, is refused by name.
- `set_state` sets the whole state, or raises an error and changes nothing.
- `env.unwrapped.set_state` leaves the counter of `gymnasium.make`'s time limit alone;
  `springgym.set_state` sets it.
- `pickle` and `copy.deepcopy` copy an environment in the middle of an episode, with all its wrappers.

**Interrupted calls.** If Ctrl-C or an exception in your reward interrupts a step or a reset, the next step
asks for a reset. You can also set an earlier state. `Simulator.advance` needs neither: `time` holds the time
that each simulation has reached.

**Threads.** One thread at a time may use an environment or a simulator. A call while another thread uses it
raises a `RuntimeError` instead of waiting.

**Divergence.** An environment diverges if a spring is strained by more than half, a number is not finite, or
a step cannot resolve a contact. The episode ends with reward 0, an observation of zeros and
`info["diverged"]`. `energy` and `strain` in `info` are reported as they are.

**Specs.** `env.spec` holds plain data. `to_json` works for arguments of all types, and its text recreates the
environment. `render_fps` is one picture per control period, so films play in real time.

In a clone, `python -m tools.fuzz --steps 1e8` tests all of this with random actions, checks every step and
prints the seed of every round.
"""

OWN_SCENES = """## A scene of your own

`springgym.make_scene_env(scene, reward, actuators={"force": 20.0, "torque": 2.0})` makes an environment from
a `Scene`, or from a scene file by name. With `num_envs` it makes a batch. Your functions compute for all
environments of the batch at once, from the measures `m` (centre, energy, …) and the situation `s` (goal,
action, …). With several bodies, `m["box"]` holds the measures of one. [A tutorial](tutorials/task.md) shows
goals, memory, reward terms, marks and colours:

```python
import gymnasium
import numpy as np
import springgym
from springgym.model.bodies import cube
from springgym.model.scene import Scene
from springgym.model.surfaces import floor

scene = Scene(cube(), positions=cube().positions + [0, 0, 1.5], surfaces=(floor(),))


def near_one_metre(m, s):
    return np.exp(-np.abs(m.centre[:, 2] - 1.0))


env = springgym.make_scene_env(
    scene,
    reward=near_one_metre,
    actuators={"force": 20.0},
    observe=lambda m, s: np.concatenate([m.centre, m.centre_velocity], axis=1),
    terminated=lambda m, s: m.centre[:, 2] < 0.2,
    success=lambda m, s: np.abs(m.centre[:, 2] - 1.0) < 0.05,
    hold_steps=50,
)
```

At every step, springgym checks that the return values of your functions are finite and have the right shape.
The arrays that they receive are read-only, and change with the next step. `gymnasium.make`, `make_vec` and
`springgym.envs.sb3.make_sb3` recreate the environment from `env.spec`, which pickles if the functions belong
to a module; JSON cannot hold functions. You can register an id:

```python
def hover(**options):
    own = {"actuators": {"force": 20.0}, "max_episode_steps": None}
    return springgym.make_scene_env(scene, near_one_metre, **own, **options)


gymnasium.register("Hover-v0", entry_point=hover, max_episode_steps=200)
```
"""


# --- The pages --------------------------------------------------------------------------------------


def page(report: Report) -> str:
    """Return the list of environments."""
    return "\n".join(
        [
            "# Environments\n",
            INTRODUCTION,
            *table_of_environments(),
            "![The environments, in the order of the table](figures/environments.webp)\n",
            *table_of_named_variants(),
            SHARED,
            *table_of_variants(report),
            "Written by `python docs/environments.py`.\n",
        ]
    )


def features(report: Report) -> str:
    """Return the page on what all environments share, with the errors that were measured."""
    measured = report["errors"]["measured"]
    versions = ", ".join(f"{package} {version}" for package, version in measured["versions"].items())
    return "\n".join(
        [
            "# Common features\n",
            "All environments, including environments made from your own scenes, share these features.\n",
            RANDOMISATION,
            GOALS,
            PROMISES,
            OWN_SCENES,
            *table_of_errors(report),
            "",
            *table_of_estimates(report),
            "",
            WANTED,
            "",
            f"Errors were measured {measured['date']} with {versions}.\n",
            "Written by `python docs/environments.py`.\n",
        ]
    )


def main() -> None:
    """Write the pages."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.parse_args()
    write()


def pages() -> dict[Path, str]:
    """Return all pages by their paths, from the docstrings and from what was measured."""
    report = read()
    own = {FOLDER / f"{row.id}.md": describe(row, report) for row in ENVIRONMENTS}
    return {PAGE: page(report), FEATURES: features(report)} | own


def write() -> None:
    """Write all pages, and remove those of environments that are gone."""
    wanted = pages()
    FOLDER.mkdir(exist_ok=True)
    for path in FOLDER.glob("*.md"):
        if path not in wanted:
            path.unlink()
    for path, text in wanted.items():
        write_text(path, text)


if __name__ == "__main__":
    main()
