"""The disk cache of compiled code: right after every edit, whole under concurrency, and nobody else's."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import typeof

from springgym.bodies import cube
from springgym.compiling import SameTypes, kernel
from springgym.integrators import advance_kernel
from springgym.measures import read
from springgym.scene import Scene, WrenchActuator
from springgym.simulator import Simulator
from springgym.vectors import plus

RUN = """
import sys
sys.path.insert(0, {folder!r})
from user.outer import double_sum
print(double_sum(3.0), sum(double_sum.stats.cache_hits.values()))
"""
"""Prints what a kernel of a user's own package gives, and how often it came from the cache."""

FILES = {
    "__init__.py": "",
    "constants.py": "OFFSET = 1.0\n",
    "inner.py": (
        "from springgym.compiling import compiled\n"
        "from user.constants import OFFSET\n"
        "@compiled\n"
        "def shifted(a):\n"
        "    return a + OFFSET\n"
    ),
    "outer.py": (
        "from springgym.compiling import kernel\n"
        "from user.inner import shifted\n"
        "@kernel\n"
        "def double_sum(a):\n"
        "    return 2.0 * shifted(a)\n"
    ),
}


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package ``user`` whose kernel calls a function of another file, with a constant of a third."""
    folder = tmp_path / "user"
    folder.mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text)
    return folder


def start(package: Path, cache: Path, run: str = RUN) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-B", "-c", run.format(folder=str(package.parent))],
        env={**os.environ, "SPRINGGYM_CACHE_DIR": str(cache)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> tuple[float, int]:
    """The kernel's value, and its cache hits."""
    out, error = process.communicate(timeout=60)
    assert process.returncode == 0, error
    value, hits = out.split()
    return float(value), int(hits)


def test_edits_in_called_files_are_noticed(package: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert finish(start(package, cache)) == (8.0, 0)
    assert finish(start(package, cache)) == (8.0, 1)
    (package / "inner.py").write_text(FILES["inner.py"].replace("a + OFFSET", "a - OFFSET"))
    assert finish(start(package, cache)) == (4.0, 0)
    (package / "constants.py").write_text("OFFSET = 2.0\n")
    assert finish(start(package, cache)) == (2.0, 0)
    for name, text in FILES.items():
        (package / name).write_text(text)
    assert finish(start(package, cache)) == (8.0, 1)


def test_processes_that_compile_at_once_leave_whole_entries(package: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    together = [start(package, cache) for _ in range(3)]
    assert {finish(process)[0] for process in together} == {8.0}
    (entry,) = cache.iterdir()
    assert finish(start(package, cache)) == (8.0, 1)
    entry.write_bytes(entry.read_bytes()[:100])
    assert finish(start(package, cache)) == (8.0, 0)
    assert finish(start(package, cache)) == (8.0, 1)


def test_a_cache_that_cannot_be_written_costs_a_compilation(package: Path, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    assert finish(start(package, blocked / "cache")) == (8.0, 0)
    assert blocked.read_text() == "no folder"


STEP = """
import os, sys
import springgym
heavy = {"numba", "llvmlite", "scipy", "torch", "matplotlib", "pygame", "stable_baselines3", "mujoco"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
import numba
before, environment = dict(vars(numba.config)), dict(os.environ)
import gymnasium
env = gymnasium.make("SpringTop-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
assert vars(numba.config) == before
assert os.environ == environment
heavy -= {"numba", "llvmlite", "scipy"}  # numba asks for its version
assert not heavy & set(sys.modules), heavy & set(sys.modules)
"""


def test_import_is_light_and_settings_of_numba_stay() -> None:
    """`import springgym` loads no compiler; stepping changes no setting of it, and loads nothing heavy."""
    subprocess.run([sys.executable, "-c", STEP], check=True, timeout=60)


def test_kernels_neither_count_references_nor_allocate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of all that a step runs, nothing counts references to arrays, which would cost as much as physics."""
    monkeypatch.setenv("SPRINGGYM_CACHE_DIR", str(tmp_path))  # what comes from the cache has no assembly
    simulator = Simulator(Scene(cube(), pinned=(0,), wrench=WrenchActuator()))
    simulator._advance = advance_kernel.__wrapped__("verlet", read)
    before = simulator.positions
    simulator.advance(3)
    assert not np.array_equal(simulator.positions, before)
    (assembly,) = simulator._advance.inspect_asm().values()
    assert "sqrt" in assembly
    assert "NRT_incref" not in assembly
    assert "NRT_Allocate" not in assembly


def test_inner_functions_refuse_python() -> None:
    """They have no code for a call from Python, before and after a kernel has compiled them."""
    with pytest.raises(TypeError, match="plus is compiled for kernels only"):
        plus((1.0, 2.0, 3.0), (1.0, 2.0, 3.0))
    Simulator(Scene(cube(), pinned=(0,), wrench=WrenchActuator())).advance()
    with pytest.raises(TypeError, match="plus is compiled for kernels only"):
        plus((1.0, 2.0, 3.0), (1.0, 2.0, 3.0))


LATE = """
import sys, pathlib
sys.path.insert(0, {folder!r})
from user.outer import double_sum
inner = pathlib.Path({folder!r}, "user", "inner.py")
inner.write_text(inner.read_text().replace("a + OFFSET", "a - OFFSET"))
print(double_sum(3.0), sum(double_sum.stats.cache_hits.values()))
"""
"""Edits a file after it was imported, and before the kernel is compiled."""


def test_what_was_edited_since_it_was_imported_is_not_cached(package: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert finish(start(package, cache, LATE)) == (8.0, 0)
    assert finish(start(package, cache)) == (4.0, 0)


@kernel
def total(a: Any) -> float:
    return np.float64(a[0] + a[1])


def test_same_types_asks_once() -> None:
    """The second call would fail to compile if its types were asked for."""
    same = SameTypes(total)
    assert same(np.array([1.0, 2.0])) == same(np.array([0.5, 2.5])) == 3.0
    with pytest.raises(TypeError):
        same("ab")
    assert list(total.signatures) == [(typeof(np.zeros(2)),)]


def test_same_types_leaves_plain_functions_alone() -> None:
    assert SameTypes(lambda *a: len(a))(1, "b", None) == 3
