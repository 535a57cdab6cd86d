"""Write the pages on environments from their docstrings and from what was measured: nothing is measured here.

python docs/environments.py                       # docs/environments.md and a page each in docs/environments/
python docs/measured.py --write errors variants    # measures, and writes them
"""

from __future__ import annotations

import argparse
import ast
import inspect
import json
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from springgym.bench.errors import EPISODES, EVERY, PERIODS
from springgym.envs.randomisation import RANDOMIZABLE
from springgym.registration import ENVIRONMENTS, VARIANTS, Row

PAGE = Path(__file__).with_name("environments.md")
FOLDER = PAGE.with_suffix("")
NUMBERS = PAGE.with_name("numbers.json")
SEEDS = 100
BASELINES = ("zero", "random", "classical")


def environment(row: Row, suffix: str) -> Any:
    return getattr(import_module(f"springgym.envs.{row.module}"), row.name + suffix)


def describe(row: Row) -> str:
    """The page of an environment: its docstring, under its id and a film of the classical controller."""
    text = inspect.cleandoc(environment(row, "Env").__doc__)
    film = "```{film} " + row.id + "\nUnder the classical controller, which is not learned.\n```"
    return f"# {row.id}\n\n{film}\n\n{text}\n"


def write_pages() -> None:
    """Write the page of every environment, and remove those of environments that are gone."""
    FOLDER.mkdir(exist_ok=True)
    for page in FOLDER.glob("*.md"):
        page.unlink()
    for row in ENVIRONMENTS:
        (FOLDER / f"{row.id}.md").write_text(describe(row), encoding="utf-8")


def table_of_environments() -> list[str]:
    """A link to each page, with the first two sentences of its description: what there is, and what to do."""
    lines = ["| environment | the task | tier | episode | solved at |", "|---|---|---|---|---|"]
    for row in ENVIRONMENTS:
        said = re.sub(r"\s+", " ", describe(row).split("## Description\n")[1].split("\n## ")[0])
        aim = " ".join(re.split(r"(?<=[.]) ", said)[:2])
        length = f"{row.max_episode_steps} steps"
        lines.append(
            f"| [`{row.id}`](environments/{row.id}.md) | {aim} | {row.tier} | {length} | "
            f"{row.reward_threshold:g} |"
        )
    pages = "\n".join(f"environments/{row.id}" for row in ENVIRONMENTS)
    return [*lines, "\n```{toctree}\n:hidden:\n\n" + pages + "\n```\n"]


def table_of_named_variants() -> list[str]:
    """The variants that have ids of their own."""
    lines = ["| environment | tier | is | with | what makes it so |", "|---|---|---|---|---|"]
    for variant in VARIANTS:
        arguments = ", ".join(f"`{name}={value!r}`" for name, value in variant.arguments.items())
        lines.append(f"| `{variant.id}` | {variant.tier} | `{variant.of}` | {arguments} | {variant.why} |")
    return [HARDER, *lines, ""]


# --- Variants ---------------------------------------------------------------------------------------


class Variant(NamedTuple):
    """An argument of an environment with a value, as its docstring tells."""

    arguments: dict[str, Any]
    written: str
    change: str
    """what is different"""


def variants(row: Row) -> list[Variant]:
    """Bullets "- `name=value`: what is different" of an environment's arguments."""
    bullets = describe(row).split("## Arguments\n")[1].split("\n## ")[0].split("\n- ")
    found = []
    for bullet in bullets:
        if match := re.match(r"(?:- )?`(\w+)=([^`]+)`: (.*)", re.sub(r"\s+", " ", bullet)):
            name, value, change = match.groups()
            found.append(Variant({name: ast.literal_eval(value)}, f"`{name}={value}`", change.strip(" .")))
    return found


def actions_and_variants(row: Row) -> Iterator[tuple[str, Variant, dict[str, Any]]]:
    """Each action mode as it is and in every variant, with the arguments of both."""
    for action in environment(row, "").actions:
        for variant in (Variant({}, "", "the standard one"), *variants(row)):
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


def table_of_variants(report: dict[str, Any]) -> list[str]:
    lines = [
        "## Variants\n",
        "Keyword arguments, and what controllers without learning make of them: success and return per step "
        f"of no action, of random ones, and of the classical controller in `agents/`, on {SEEDS} held-out "
        "seeds.\n",
        f"| environment | arguments | what is different | {' | '.join(BASELINES)} |",
        "|---|---|---|---|---|---|",
    ]
    reached = {(own["environment"], own["arguments"]): own for own in report["variants"]["rows"]}
    for row in ENVIRONMENTS:
        for action, variant, arguments in actions_and_variants(row):
            own = reached[row.id, repr(arguments)]
            figures = " | ".join(f"{100 * own[name][0]:.3g} %, {own[name][1]:.2f}" for name in BASELINES)
            written = ", ".join(filter(None, (f'`action="{action}"`', variant.written)))
            lines.append(f"| `{row.id}` | {written} | {variant.change} | {figures} |")
    return lines


# --- Error of a control period ----------------------------------------------------------------------


def table_of_errors(report: dict[str, Any]) -> list[str]:
    lines = [
        "## Error of a control period\n",
        "What the default step costs in accuracy: the largest distance of a particle, after one control "
        "period with a random action, from where exact steps take it, as a share of the body's size. "
        f"{EPISODES} copies begin episodes as everybody's do, and go on to the next ones, for {PERIODS} "
        f"control periods, of which one in {EVERY} counts. Exact is `dopri5` with a tolerance of 1e-13, on "
        "surfaces `verlet` with steps of h/1024, for bodies that collide of h/64; the last column is its "
        "largest distance from a second reference, `rk4` with h/128, on surfaces `verlet` with h/256, for "
        "bodies that collide with h/16: impacts converge to first order only.\n",
        "| environment | step h | median error | largest error | references apart |",
        "|---|---|---|---|---|",
    ]
    for env_id, options, own in _errors(report):
        if not options:
            lines.append(
                f"| `{env_id}` | {own['step_ms']:.3g} ms | {own['median']:.1e} | {own['high']:.1e} | "
                f"{own['apart']:.0e} |"
            )
    return lines


def _errors(report: dict[str, Any]) -> Iterator[tuple[str, dict[str, str], dict[str, Any]]]:
    """The rows of the errors, as `springgym.bench.errors` has them."""
    names = ("dtype", "integrator", "dynamics")
    for own in report["errors"]["rows"]:
        yield own["environment"], {name: own[name] for name in names if name in own}, own


# --- What error=True says of it ---------------------------------------------------------------------

ESTIMATED = """## The error, while it runs

`error=True` has every control period repeated from the same state in steps of half the length.
`info["step_error"]` then says how far the particle that is farthest from where exact steps would have taken
it is from there, over the size of its body: the error of the table above, estimated from how far the two are
apart (Richardson). Batches have an array, one number for each copy. The trajectory is the same to the bit; a
step costs three times as much, and without `error=True` nothing.

```python
import gymnasium
import springgym

env = gymnasium.make("SpringTop-v0", error=True)
env.reset(seed=0)
*_, info = env.step(env.action_space.sample())
assert 0 < info["step_error"] < 1e-3
```

It is the error of this one period; over many, errors grow as the motion lets them. Randomised parameters are
those of the copy. In an episode's first `info` it is 0, and of a copy that is nowhere it is infinite. Of
rigid bodies it is the error of the rigid motion, not its distance from springs. In float32 both runs have
rounded, and it cannot fall below that, some 1e-7. In impacts it is less sure: they err to first order, and
may fall into one of the two runs alone. `dopri5` and `rodas3`, which choose their steps, are refused.
"""


def table_of_estimates(report: dict[str, Any]) -> list[str]:
    """How good they are."""
    lines = [
        ESTIMATED,
        "Estimate over true error, median and the middle 90 %, of the control periods of the table above; of "
        "rigid bodies, against the same method with steps of h/16, on surfaces of h/1024:\n",
        "| environment | arguments | median error | estimate / error | middle 90 % |",
        "|---|---|---|---|---|",
    ]
    for env_id, options, own in _errors(report):
        arguments = ", ".join(f'`{name}="{value}"`' for name, value in options.items())
        lines.append(
            f"| `{env_id}` | {arguments} | {own['median']:.1e} | {own['estimate']:.3f} | "
            f"{own['estimate_low']:.2f} … {own['estimate_high']:.2f} |"
        )
    return lines


# --- The page ---------------------------------------------------------------------------------------

INTRODUCTION = """Every environment has its page: what the agent sees, what it may do, what is rewarded, how
an episode starts and ends. All of them

- observe positions and velocities of particles (`observation="particles"`) or a few numbers such as axis
  and spin (`observation="frame"`), scaled to about one;
- take actions in [−1, 1], in one of several modes (`action=…`);
- reward each step with a number from 0 to 1, and say in `info["is_success"]` whether the aim is met: an
  episode that ends by failure is no success, however long the aim was met before;
- run with springs or, except for ropes, as rigid bodies (`dynamics="rigid"`), in a batch, and with
  randomised masses, stiffness, friction and more (`randomize=…`);
- give and take their true state (`get_state`, `set_state`).

"Solved at" is the return from which a task counts as solved; the most that there is is one a step.
"""

HARDER = """## Tiers and harder variants

*First steps* are taken by linear control, too, found in seconds. A *standard* task is solved by PPO with the
hyperparameters that ship, and not by linear control. Of variants, PPO does most of a *harder* one; a *hard*
one can be done, but PPO does not do it.
Variants with ids of their own can be run by programs that take nothing but an id. What each algorithm
reaches stands under [Baselines](baselines.md).
"""

RANDOMISATION = f"""## Randomisation

`randomize={{"masses": (0.8, 1.2), …}}` draws a factor from each range for every episode, and for every copy
of a batch its own, from the same seed as the start. There are
{", ".join(f"`{n}`" for n in RANDOMIZABLE)}:
`scale` is that of the body, `actuator` the strength of the actions, an opponent's too. The factors stand in
`info["randomization"]`; `reset(options={{"randomize": {{"masses": 1.1}}}})` sets some of them. The step is
chosen for the stiffest and lightest body of the ranges, and one that is given is held against it. A factor
that nothing answers to is refused: gravity in free fall, friction and restitution without a surface, springs
in rigid dynamics. What is not randomised is compiled as a constant of all copies, and costs nothing.
"""

PROMISES = """## Seeds, states and versions

**The same seed gives the same episode, to the bit**, on one machine with one set of versions: alone or as
any copy of a batch, of any size, on any number of threads, whatever the other copies do. A reset or a step
that is refused changes nothing, random generators included (but the time limit of `gymnasium.make` counts
from 0 after any call of `reset`).

**With other versions of Python, NumPy or Numba, or on another kind of processor**, the same seed draws the
same numbers, and starts agree to rounding: closed forms place the bodies, and nothing that a linear algebra
library leaves open decides (the sign of an axis, or which axes of equal moments). From there, motion that
is regular stays close, and chaotic motion separates as fast as the physics says. NumPy 2.0.2 and 2.4.6 gave
the same bits for 30 starts of each environment, OpenBLAS's oldest kernels starts that differ by 1e-14 at
the most. A new version of springgym may start a seed otherwise, and says so; what the task is changes with
the number in an environment's id.

**States.** `springgym.get_state(env)` gives the true state of what `gymnasium.make`, `gymnasium.make_vec`,
`springgym.envs.parallel` or `springgym.envs.sb3.make_sb3` made: positions and velocities, clocks, goals,
factors, actuators, the time limit, random generators, and what a monitor counts. After
`springgym.set_state(env, state)`, in the same environment or in another one made alike, what follows is
what followed, to the bit. A state of an environment that was made otherwise, be it by another friction,
step or variant, is refused, and it is said what differs; only the time limit and `error` may be others.
So is a mangled one. Either all of a state is set, or nothing.

Copies of a native batch can be chosen: `springgym.get_state(envs, copies)` gives the state of some, and
`springgym.set_state(envs, state, copies)` sets it into as many, or that of one copy or of a single environment
into all of them, as planning asks for. What follows in each is what would have followed
where the state is from, to the bit, autoreset included: each has a random generator of its own in the state
of the one there, so that copies of one state draw the same next episode. New seeds make them differ.

`env.unwrapped.set_state` leaves the counter of `gymnasium.make`'s time limit as it is. That counter starts
anew whenever Gymnasium's wrapper is asked to reset, even where the environment refuses: a state set back
mends it. `pickle` and `copy.deepcopy` take an environment in mid-episode with all its wrappers.

**Calls that break off.** If Ctrl-C, or a reward of your own that raises, ends a step or a reset in its
middle, the next step asks for a reset; to set a state from before will do, too. `Simulator.advance` needs
none: `time` says how far each copy got.

**Threads.** One thread at a time may use an environment, or a simulator. A call while another thread is
in one raises a `RuntimeError`; it does not wait.

**Divergence.** A copy whose springs are stretched by half, or whose numbers are not finite, ends with
reward 0, an observation of zeros and `info["diverged"]`; `energy` and `strain` in `info` are then what they
are.

**Specs.** `env.spec` holds plain data: `to_json` works whatever types the arguments were of, and what is
made of the text is the same. `render_fps` is one picture a control period: films play in real time.

`python -m tests.fuzz --steps 1e8` steps all of this at random for as long as one likes, and checks every
step; it prints the seed of every round.
"""

OWN_SCENES = """## A scene of one's own

`springgym.make_scene_env(scene, reward, actuators={"force": 20.0, "torque": 2.0})` makes an environment
over a `Scene`, or over a scene file by name (which needs the extra `scenes`); `num_envs` makes a native
batch. Functions take the `Measures`, positions and velocities (n, N, 3) of all copies, and `reward` the
actions, too:

```python
import gymnasium
import numpy as np
import springgym
from springgym.bodies import cube
from springgym.scene import Scene
from springgym.surfaces import floor

scene = Scene(cube(), positions=cube().positions + [0, 0, 1.5], surfaces=(floor(),))


def near_one_metre(m, x, v, action):
    return np.exp(-np.abs(m.centre[:, 2] - 1.0))


env = springgym.make_scene_env(
    scene,
    reward=near_one_metre,
    actuators={"force": 20.0},
    observe=lambda m, x, v: np.concatenate([m.centre, m.centre_velocity], axis=1),
    failed=lambda m, x, v: m.centre[:, 2] < 0.2,
    succeeded=lambda m, x, v: np.abs(m.centre[:, 2] - 1.0) < 0.05,
    hold=50,
)
```

What they give is checked at every step: the shape, and that it is finite. The arrays they see cannot be
written to and change with the next step. `env.spec` makes the environment again, with `gymnasium.make`,
`make_vec` or `springgym.envs.sb3.make_sb3`; it pickles if the functions are those of a module, and JSON has
no functions. Under an id of your own, it is registered like any other:

```python
def hover(**options):
    own = {"actuators": {"force": 20.0}, "max_episode_steps": None}
    return springgym.make_scene_env(scene, near_one_metre, **own, **options)


gymnasium.register("Hover-v0", entry_point=hover, max_episode_steps=200)
```
"""


def page(report: dict[str, Any]) -> str:
    """The page, with what was measured."""
    told = []
    for name in ("variants", "errors"):
        measured = report[name]["measured"]
        versions = ", ".join(f"{package} {version}" for package, version in measured["versions"].items())
        told.append(f"{name.capitalize()} measured {measured['date']}: {versions}.")
    return "\n".join(
        [
            "# Environments\n",
            INTRODUCTION,
            "![The environments in the order of the table](figures/environments.png)\n",
            *table_of_environments(),
            *table_of_named_variants(),
            *table_of_variants(report),
            "",
            RANDOMISATION,
            PROMISES,
            OWN_SCENES,
            *table_of_errors(report),
            "",
            *table_of_estimates(report),
            "",
            "\n".join(told),
            "\nWritten by `python docs/environments.py`, from the docstrings and from `docs/numbers.json`.\n",
        ]
    )


def main() -> None:
    """Write the pages on environments, or check that they are up to date."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.parse_args()
    write()


def write() -> None:
    """Write all pages, from the docstrings and from what was measured."""
    write_pages()
    PAGE.write_text(page(json.loads(NUMBERS.read_text(encoding="utf-8"))), encoding="utf-8")


if __name__ == "__main__":
    main()
