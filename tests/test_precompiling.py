"""``springgym compile``: what it leaves in a folder, and who finds it."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from springgym import precompiling
from springgym.cli import main
from springgym.core import compiling
from springgym.core.compiling import LEVELS
from tests.test_compiling import FILES, RUN, finish, start

ROOT = Path(__file__).parents[1]

HAS_V3 = all(compiling._features().get(name) for name in LEVELS["x86-64-v3"])


def steps_of_the_image() -> list[tuple[str, str]]:
    """Instructions and their arguments in the Dockerfile of the documentation."""
    text = (ROOT / "docs" / "start.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```dockerfile\n(.*?)```", text, re.DOTALL)
    return [tuple(line.split(" ", 1)) for line in block.splitlines()]


def entries(folder: Path) -> dict[str, int]:
    return {entry.name: entry.stat().st_mtime_ns for entry in folder.iterdir()}


@pytest.mark.skipif(not HAS_V3, reason="the image is for processors with AVX2")
def test_containers_of_the_image_start_at_once(tmp_path: Path) -> None:
    """Its steps, without Docker: what is compiled into it is found by what it runs, and nothing is added."""
    steps = steps_of_the_image()
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SPRINGGYM_")}
    folder = tmp_path / "springgym"
    (settings,) = (shlex.split(text) for step, text in steps if step == "ENV")
    environment |= dict(setting.split("=", 1) for setting in settings)
    assert environment["SPRINGGYM_CACHE_DIR"] == "/opt/springgym"
    environment |= {"SPRINGGYM_CACHE_DIR": str(folder), "PYTHONPATH": str(ROOT)}
    compiling_step = shlex.split(next(text for step, text in steps if text.startswith("springgym compile")))
    command = [sys.executable, "-m", *compiling_step, "--only", "single"]
    told = subprocess.run(command, env=environment, check=True, capture_output=True, text=True, timeout=300)
    assert re.search(r"^SpringTop-v0, gym\.make: [\d.]+ s\n\d+ entries", told.stdout)
    assert told.stderr == ""
    compiled = entries(folder)
    assert any("integrators.advance" in name for name in compiled)
    (run,) = (shlex.split(text) for step, text in steps if step == "CMD")
    assert run[0] == "python"
    command = [sys.executable, *run[1:]]
    container = {**environment, "HOME": "/nonexistent"}
    told = subprocess.run(command, env=container, check=True, capture_output=True, text=True, timeout=60)
    assert 0.0 < float(told.stdout) <= 1.0
    assert told.stderr == ""
    assert entries(folder) == compiled


def test_levels_are_those_of_the_compiler() -> None:
    assert ("host", *LEVELS) == precompiling.LEVELS


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["SpringTp-v0"], "Did you mean"),
        (["SpringTop-v0", "--jobs", "0"], "--jobs is 0; it must be at least 1"),
        (["SpringTop-v0", "--to", "FILE/folder"], "Not a directory"),
    ],
)
def test_what_cannot_be_compiled_is_told_in_a_line(
    given: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert main(["compile", *(word.replace("FILE", str(tmp_path / "file")) for word in given)]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_a_level_is_of_processors_that_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    everything = dict.fromkeys(LEVELS["x86-64-v4"], True)
    assert compiling._level("", everything) is None
    assert compiling._level("host", {}) is None
    for level, names in LEVELS.items():
        assert compiling._level(level, everything) == level
        for name in names:
            with pytest.warns(RuntimeWarning, match=rf"this processor has no {name}: code is compiled for"):
                assert compiling._level(level, {**everything, name: False}) is None
    assert compiling._level("x86-64-v3", dict.fromkeys(LEVELS["x86-64-v3"], True)) == "x86-64-v3"
    for wrong in ("x86-64-v2", "v3", "X86-64-V3", " "):
        with pytest.raises(ValueError, match=r"SPRINGGYM_CPU is .*; it must be host, x86-64-v3 or x86-64-v4"):
            compiling._level(wrong, everything)
    monkeypatch.setattr(numba.config, "CPU_FEATURES", "")
    with pytest.raises(ValueError, match="unset one"):
        compiling._level("x86-64-v3", everything)


@pytest.mark.skipif(not HAS_V3, reason="this processor has no AVX2")
def test_code_of_a_level_is_found_by_who_is_told_the_level(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody else finds it; and it is of that level for sure, or under another name."""
    package, cache = tmp_path / "user", tmp_path / "cache"
    package.mkdir()
    for name, text in FILES.items():
        (package / name).write_text(text)
    before = "import numba\nnumba.njit(lambda: 1)()\n"  # so that Numba compiles for this processor
    monkeypatch.setenv("SPRINGGYM_CPU", "x86-64-v3")
    assert finish(start(package, cache, before + RUN)) == (8.0, 0)
    assert finish(start(package, cache)) == (8.0, 0)
    assert finish(start(package, cache)) == (8.0, 1)
    monkeypatch.setenv("SPRINGGYM_CPU", "host")
    assert finish(start(package, cache)) == (8.0, 0)
    assert len(list(cache.iterdir())) == 3
