"""Write docs/environments.md from the environments themselves: docstrings, and their error a step.

python docs/environments.py
"""

from __future__ import annotations

import inspect
import platform
from datetime import date
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import numba
import numpy as np

import springgym
from springgym.registration import ENVIRONMENTS, Row

FINER = 64
EPISODES, STEPS = 10, 20
PAGE = Path(__file__).with_name("environments.md")


def describe(row: Row) -> str:
    """The docstring of an environment, under its id."""
    env = getattr(import_module(f"springgym.envs.{row.module}"), f"{row.name}Env")
    text = inspect.cleandoc(env.__doc__).replace("## ", "### ")
    return f"## {row.id}\n\n{text}\n"


def error_per_step(row: Row) -> tuple[float, float, float]:
    """Step h [s]; median and largest error of the particles after a control period, by the body's size.

    Each control period starts from the same state and is repeated with steps of h/`FINER`: of second
    order, that reference is `FINER`² times finer.
    """
    env = gym.make(row.id).unwrapped
    step = env.episodes.simulator.step
    fine = gym.make(row.id, step=step / FINER).unwrapped
    size = float(np.ptp(env.episodes.task.scene.body.positions, axis=0).max())
    rng = np.random.default_rng(0)
    errors = []
    for seed in range(EPISODES):
        env.reset(seed=seed)
        fine.reset(seed=seed)
        for _ in range(STEPS):
            fine.set_state(env.get_state())
            action = rng.uniform(-1, 1, env.action_space.shape)
            env.step(action)
            fine.step(action)
            apart = env.episodes.particles[0] - fine.episodes.particles[0]
            errors.append(np.linalg.norm(apart, axis=-1).max() / size)
    return step, float(np.median(errors)), float(np.max(errors))


def main() -> None:
    """Write the page."""
    lines = [
        "# Environments\n",
        "Written by `python docs/environments.py` from the docstrings of the environments.\n",
        "## Error of a control period\n",
        "What the default step costs in accuracy: the largest distance of a particle, after one control "
        "period with a random action, from where steps "
        f"{FINER} times finer take it, as a share of the body's size; {EPISODES * STEPS} control periods.\n",
        "| environment | step h | median error | largest error |",
        "|---|---|---|---|",
    ]
    for row in ENVIRONMENTS:
        step, median, largest = error_per_step(row)
        lines.append(f"| `{row.id}` | {step * 1e3:.3g} ms | {median:.1e} | {largest:.1e} |")
    versions = f"springgym {springgym.__version__}, Python {platform.python_version()}, "
    versions += f"NumPy {np.__version__}, Numba {numba.__version__}"
    lines.append(f"\nMeasured {date.today()}, {versions}.\n")
    lines += [describe(row) for row in ENVIRONMENTS]
    PAGE.write_text("\n".join(lines))


if __name__ == "__main__":
    main()
