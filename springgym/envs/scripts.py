"""The scripts in ``agents/`` as commands: ``springgym train`` runs ``agents/train.py``."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from springgym.core.extras import SOURCE

COPY = Path(__file__).resolve().parents[1] / "agents"
AGENTS = COPY if COPY.is_dir() else SOURCE / "agents"
"""Folder of the scripts and the published agents: a copy in an installed package, or that of a clone."""


def run(name: str, arguments: Sequence[str], extra: str) -> int:
    """Run a script, which needs an ``extra``, as ``python agents/NAME.py`` does, and return its exit status.

    The current folder is searched for modules last, so that ``module:ID`` finds an environment there.

    Raises
    ------
    ModuleNotFoundError
        If a package that the script needs is missing.
    """
    # before a package for which another extra would be named
    if extra == "agents" and find_spec("stable_baselines3") is None:
        raise ModuleNotFoundError(f"springgym {name} needs Stable-Baselines3")
    if str(AGENTS) not in sys.path:
        sys.path[:] = [str(AGENTS), *sys.path, os.getcwd()]
    return int(import_module(name).main(arguments, f"springgym {name}"))
