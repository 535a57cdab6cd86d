"""Write docs/environments.md from the environments themselves: docstrings, and their error a step.

python docs/environments.py
"""

from __future__ import annotations

import inspect
import platform
from datetime import date
from importlib import import_module
from pathlib import Path

import numba
import numpy as np

import springgym
from springgym.bench.environments import FINER, error_per_step
from springgym.registration import ENVIRONMENTS, Row

EPISODES, STEPS = 10, 20
PAGE = Path(__file__).with_name("environments.md")


def describe(row: Row) -> str:
    """The docstring of an environment, under its id."""
    env = getattr(import_module(f"springgym.envs.{row.module}"), f"{row.name}Env")
    text = inspect.cleandoc(env.__doc__).replace("## ", "### ")
    return f"## {row.id}\n\n{text}\n"


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
        step, median, largest = error_per_step(row.id, EPISODES, STEPS)
        lines.append(f"| `{row.id}` | {step * 1e3:.3g} ms | {median:.1e} | {largest:.1e} |")
    versions = f"springgym {springgym.__version__}, Python {platform.python_version()}, "
    versions += f"NumPy {np.__version__}, Numba {numba.__version__}"
    lines.append(f"\nMeasured {date.today()}, {versions}.\n")
    lines += [describe(row) for row in ENVIRONMENTS]
    PAGE.write_text("\n".join(lines))


if __name__ == "__main__":
    main()
