"""``springgym compile``: compile environments ahead of their first step.

Compiled code lies in a folder, see `springgym.core.compiler.cache`. You can copy the folder, share it,
mount it read-only, and put it into a container image. With ``--cpu`` the code runs on every processor of a
level."""

from __future__ import annotations

import argparse
import logging
import multiprocessing
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import gymnasium as gym

from springgym.checks import counted
from springgym.envs.registration import ENVIRONMENTS, spec_of

KINDS = {"single": "gym.make", "batch": "gym.make_vec"}
"""Kinds of environments, which run different code."""

DTYPES = ("float64", "float32")

LEVELS = ("host", "x86-64-v3", "x86-64-v4", "skylake-avx512")
"""The names in `springgym.core.compiler.targets.LEVELS`, repeated here because importing it takes a
second."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``springgym compile``."""
    parser.add_argument(
        "ids", nargs="*", metavar="ID", help="environment ids; module:ID for your own (default: all)"
    )
    parser.add_argument(
        "--cpu",
        choices=LEVELS,
        default=os.environ.get("SPRINGGYM_CPU") or "host",
        help="target processor: host, or a level (default: SPRINGGYM_CPU, or host)",
    )
    parser.add_argument(
        "--to", type=Path, metavar="FOLDER", help="output folder (default: the cache that programs use)"
    )
    parser.add_argument(
        "--only",
        choices=sorted(KINDS),
        help="compile only for gymnasium.make (single) or make_vec (batch) (default: both)",
    )
    parser.add_argument("--dtype", choices=DTYPES, default="float64", help="precision of batches")
    parser.add_argument("--jobs", type=int, default=1, help="parallel compilations (default: 1)")


def run(args: argparse.Namespace) -> int:
    """Compile in subprocesses, with folder and level in their environment, and report the result."""
    if args.jobs < 1:
        raise ValueError(f"--jobs is {args.jobs}; it must be at least 1")
    if args.only == "single" and args.dtype != DTYPES[0]:
        raise ValueError(f"--dtype {args.dtype} applies to batches, and --only single compiles none")
    ids = args.ids or [row.id for row in ENVIRONMENTS]
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())  # last, so that module:ID finds an environment there
    tasks = [(name, kind, args.dtype) for name in ids for kind in _kinds(name, args.only)]
    settings = {"SPRINGGYM_CPU": args.cpu}
    if args.to is not None:
        settings["SPRINGGYM_CACHE_DIR"] = str(args.to.absolute())
    spawned = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(args.jobs, len(tasks)), spawned, _begin, (settings,)) as pool:
        for (name, kind, _), seconds in zip(tasks, pool.map(compile_one, tasks), strict=True):
            print(f"{name}, {KINDS[kind]}: {seconds:.1f} s", flush=True)
        folder = pool.submit(_folder).result()
    entries = list(folder.glob("*.nbc"))
    size = sum(entry.stat().st_size for entry in entries)
    print(f"{counted(len(entries), 'entry', 'entries')}, {size / 1e6:.1f} MB, in {folder}")
    told = " ".join(f"{name}={value}" for name, value in settings.items() if value != "host")
    if told:
        print(f"To use them, set {told}")
    return 0


def _kinds(name: str, only: str | None) -> list[str]:
    """Return the kinds to compile for an environment: both by default, if it has a batch.

    Raises
    ------
    ValueError
        If there is no such environment, or it has no batch and only that is requested.
    """
    spec = spec_of(name)
    kinds = [kind for kind in KINDS if only in (None, kind) and (kind == "single" or spec.vector_entry_point)]
    if not kinds:
        raise ValueError(
            f"{name} is registered without a batch (vector_entry_point), so --only must be single"
        )
    return kinds


def _begin(settings: dict[str, str]) -> None:
    """Set environment variables of a new process, before modules that read them are imported."""
    os.environ.update(settings)
    logging.getLogger("springgym").setLevel(logging.ERROR)  # compiling was requested, and needs no message


def _folder() -> Path:
    """Return the folder of compiled code, after checking that it is writable."""
    from springgym.core.compiler.cache import cache_directory

    folder = cache_directory()
    if folder is None:
        raise ValueError("no cache folder is writable; choose one with --to")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ValueError(f"cannot write compiled code to {folder}: {error.strerror or error}") from None
    return folder


def compile_one(task: Sequence[str]) -> float:
    """Compile all code for the first steps of an environment and the end of an episode; return the time [s].

    Raises
    ------
    ValueError
        If this processor does not have the level, compiled code cannot be written, the environment does not
        support the precision, or it is not a springgym environment.
    """
    from springgym.core.compiler import targets
    from springgym.envs.base import SpringEnv, SpringVectorEnv

    name, kind, dtype = task
    asked = os.environ["SPRINGGYM_CPU"]
    if asked not in ("host", targets.LEVEL):
        raise ValueError(
            f"--cpu is {asked}, but this processor does not have that level; compile on one that does"
        )
    _folder()
    began = time.perf_counter()
    options: dict[str, Any] = {"max_episode_steps": 1}
    try:
        if kind == "single":
            env: Any = gym.make(name, **options)
        else:
            options |= {} if dtype == DTYPES[0] else {"dtype": dtype}
            env = gym.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point", **options)
    except TypeError as error:
        raise ValueError(f"{name}, {KINDS[kind]}: {error}") from error
    if not isinstance(env.unwrapped, (SpringEnv, SpringVectorEnv)):
        raise ValueError(f"{name} is not a springgym environment; there is nothing to compile")
    env.reset(seed=0)
    for _ in range(2):  # a batch resets in the second
        env.step(env.action_space.sample())
        if kind == "single":
            env.reset()
    env.close()
    return time.perf_counter() - began
