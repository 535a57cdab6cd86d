"""``springgym compile``: what it leaves in a folder, and who finds it."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import shlex
import subprocess
import sys
import zipfile
from email import message_from_string
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from llvmlite import binding

from springgym.cli import compile_all, main
from springgym.core.compiler import targets
from springgym.core.compiler.cache import KERNELS, MADE, made_here, shipped
from springgym.core.compiler.targets import INTELS, LEVELS, features, fitting_level
from tests.params import slow_but
from tests.test_compiling import FILES, RUN, finish, flipped, start

pytestmark = pytest.mark.own_kernels

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tools"))

import kernels  # noqa: E402

HAS_V3 = all(features().get(name) for name in LEVELS["x86-64-v3"])


def steps_of_the_image() -> list[tuple[str, str]]:
    """Instructions and their arguments in the Dockerfile of the documentation."""
    text = (ROOT / "docs" / "start.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```dockerfile\n(.*?)```", text, re.DOTALL)
    return [tuple(line.split(" ", 1)) for line in block.splitlines()]


def entries(folder: Path) -> dict[str, int]:
    return {entry.name: entry.stat().st_mtime_ns for entry in folder.iterdir()}


@pytest.mark.slow
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
    assert ("host", *LEVELS) == compile_all.LEVELS


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["SpringTp-v0"], "Unknown environment 'SpringTp-v0'. Did you mean 'SpringTop-v0'?"),
        (["SpringTop-v0", "--jobs", "0"], "--jobs is 0; it must be at least 1"),
        (["SpringTop-v0", "--to", "FILE/folder"], "Not a directory"),
        (["SpringTop-v0", "--to", "FILE"], "cannot write compiled code to "),
        (["CartPole-v1"], "CartPole-v1 is not a springgym environment"),
        (["CartPole-v1", "--only", "batch", "--dtype", "float32"], "unexpected keyword argument 'dtype'"),
        (["Pendulum-v1", "--only", "batch"], "Pendulum-v1 is registered without a batch"),
        (["SpringTop-v0", "--only", "single", "--dtype", "float32"], "--dtype float32 applies to batches"),
        (["nowhere:Own-v0"], "Unknown environment 'nowhere:Own-v0'. No module named 'nowhere'"),
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


def test_environments_of_ones_own_are_found_by_their_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own_ids: None
) -> None:
    lines = (
        "import gymnasium",
        "gymnasium.register('Both-v0', entry_point='m:E', vector_entry_point='m:V')",
        "gymnasium.register('Alone-v0', entry_point='m:E')",
    )
    (tmp_path / "with_ids_of_its_own.py").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(tmp_path)
    kinds = compile_all._kinds
    assert kinds("with_ids_of_its_own:Both-v0", None) == ["single", "batch"]
    assert kinds("with_ids_of_its_own:Both-v0", "batch") == ["batch"]
    assert kinds("with_ids_of_its_own:Alone-v0", None) == ["single"]


def test_a_level_is_of_processors_that_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    everything = dict.fromkeys(LEVELS[INTELS], True)
    assert targets._level("", everything) is None
    assert targets._level("host", {}) is None
    for level, names in LEVELS.items():
        assert targets._level(level, everything) == level
        for name in names:
            with pytest.warns(RuntimeWarning, match=rf"this processor has no {name}: code is compiled for"):
                assert targets._level(level, {**everything, name: False}) is None
    assert targets._level("x86-64-v3", dict.fromkeys(LEVELS["x86-64-v3"], True)) == "x86-64-v3"
    for wrong in ("x86-64-v2", "v3", "X86-64-V3", " "):
        with pytest.raises(ValueError, match=r"SPRINGGYM_CPU is .*; it must be host, x86-64-v3, "):
            targets._level(wrong, everything)
    monkeypatch.setattr(numba.config, "CPU_FEATURES", "")
    with pytest.raises(ValueError, match="unset one"):
        targets._level("x86-64-v3", everything)


@pytest.mark.skipif(not HAS_V3, reason="this processor has no AVX2")
@pytest.mark.slow
def test_code_of_a_level_is_found_by_who_is_told_the_level(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody else finds it; and it is of that level for sure, or under another name."""
    package = tmp_path / "user"
    cache = tmp_path / "cache"
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


def test_a_processor_runs_the_code_of_its_own_level() -> None:
    everything = {name: True for names in LEVELS.values() for name in names}
    assert fitting_level("icelake-server", everything) == INTELS
    assert fitting_level("znver5", everything) == "x86-64-v4"  # AMD's, which has all of that too
    assert fitting_level("icelake-server", everything | {"aes": False}) == "x86-64-v4"
    assert fitting_level("haswell", everything | {"avx512f": False}) == "x86-64-v3"
    assert fitting_level("nehalem", everything | {"avx2": False}) is None
    assert fitting_level("apple-m1", {}) is None


LEVEL = fitting_level(binding.get_host_cpu_name(), features())

needs_level = pytest.mark.skipif(LEVEL is None, reason="this processor has no level")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel of compiled code, and beside it the package ``user`` whose kernel it holds."""
    folder = tmp_path_factory.mktemp("wheel")
    package = folder / "user"
    compiled = folder / "compiled"
    package.mkdir()
    for name, text in FILES.items():
        (package / name).write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPRINGGYM_CPU", str(LEVEL))
        assert finish(start(package, compiled)) == (8.0, 0)
    kernels.describe(compiled, [str(LEVEL)])
    return kernels.pack(compiled, folder)


@pytest.fixture
def installed(wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The package of compiled code where processes find it that are started now."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path / "site"), str(ROOT)]))
    monkeypatch.delenv("SPRINGGYM_CPU", raising=False)
    return tmp_path / "site" / KERNELS


@needs_level
def test_installed_code_is_found_without_being_told(wheel: Path, installed: Path, tmp_path: Path) -> None:
    """By a process that compiles for its own processor, which keeps nothing of its own then."""
    before = "import numba\nnumba.njit(lambda: 1)()\n"
    process = start(wheel.parent / "user", tmp_path / "cache", before + RUN)
    assert process.communicate(timeout=60) == ("8.0 1\n", "")
    assert not (tmp_path / "cache").exists()


@needs_level
@pytest.mark.parametrize("told", slow_but(["host", "x86-64-v3"], "host"))
def test_who_says_what_to_compile_for_gets_that(
    told: str, wheel: Path, installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that `springgym compile` fills its folder, whatever is installed."""
    monkeypatch.setenv("SPRINGGYM_CPU", told)
    process = start(wheel.parent / "user", tmp_path / "cache")
    assert process.communicate(timeout=60) == ("8.0 0\n", "")
    assert len(list((tmp_path / "cache").iterdir())) == 1


def with_(changes: dict[str, Any]) -> str:
    """What a package says of itself if some of its versions, or its levels, are others."""
    versions = made_here()
    levels = changes.pop("levels", [LEVEL])
    return json.dumps({"versions": versions | changes, "levels": levels})


@needs_level
@pytest.mark.parametrize(
    ("made", "why"),
    [
        (with_({"springgym": "0.0.1"}), "it is for springgym 0.0.1, and this is "),
        (with_({"Python": "cpython-27"}), "it is for Python cpython-27, and this is "),
        (with_({"NumPy": "1.0"}), "it is for NumPy 1.0, and this is "),
        (with_({"Numba": "0.1"}), "it is for Numba 0.1, and this is "),
        (with_({"levels": ["x86-64-v5"]}), "it is for processors of x86-64-v5, and this is one of "),
        (with_({"levels": [1, None]}), "it is for processors of 1, None, and this is one of "),
        (with_({"levels": 1}), "it is damaged (TypeError: "),
        ("[" * 10**5, "it is damaged (RecursionError: "),
        ("{}", "it is damaged (KeyError: 'versions')"),
        ("", "it is damaged (JSONDecodeError: "),
    ],
)
def test_installed_code_that_does_not_fit_is_not_used(
    made: str, why: str, installed: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.syspath_prepend(installed.parent)
    monkeypatch.setattr(numba.config, "CPU_NAME", None)
    monkeypatch.setattr(numba.config, "CPU_FEATURES", None)
    assert shipped.__wrapped__() == (installed, LEVEL)
    (installed / MADE).write_text(made)
    assert shipped.__wrapped__() is None
    (message,) = caplog.messages
    assert message.startswith(f"springgym: the compiled code of springgym-kernels is not used: {why}")


@needs_level
def test_a_process_that_compiles_instead_says_so(wheel: Path, installed: Path, tmp_path: Path) -> None:
    (installed / MADE).write_text(with_({"Numba": "0.1"}))
    out, error = start(wheel.parent / "user", tmp_path / "cache").communicate(timeout=60)
    assert out == "8.0 0\n"
    assert "is not used: it is for Numba 0.1, and this is " in error
    assert error.count("\n") == 1


@needs_level
@pytest.mark.slow
def test_a_broken_entry_of_installed_code_costs_a_compilation(
    wheel: Path, installed: Path, tmp_path: Path
) -> None:
    (entry,) = installed.glob("*.nbc")
    broken = flipped(entry)
    entry.write_bytes(broken)
    for hits in (0, 1):
        assert finish(start(wheel.parent / "user", tmp_path / "cache")) == (8.0, hits)
    assert entry.read_bytes() == broken
    assert len(list((tmp_path / "cache").iterdir())) == 1


def test_the_wheel_asks_for_what_its_code_is_made_for(wheel: Path) -> None:
    tags = wheel.stem.split("-", 2)[2].split("-")
    with zipfile.ZipFile(wheel) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    texts = {name.rpartition("/")[2]: content.decode() for name, content in files.items() if "-info/" in name}
    told = message_from_string(texts["METADATA"])
    assert told["Name"] == "springgym-kernels"
    assert set(told.get_all("Requires-Dist", [])) == {
        f"springgym=={made_here()['springgym']}",
        f"numpy=={np.__version__}",
        f"numba=={numba.__version__}",
    }
    assert told["Requires-Python"] == f"=={sys.version_info.major}.{sys.version_info.minor}.*"
    assert tags[:2] == [f"cp{sys.version_info.major}{sys.version_info.minor}"] * 2
    assert "any" not in tags[2].split("_")
    rows = [row.rsplit(",", 2) for row in texts["RECORD"].splitlines()]
    assert {name for name, *_ in rows} == set(files)
    for name, digest, size in rows[:-1]:
        sha = base64.urlsafe_b64decode(digest.removeprefix("sha256=") + "=")
        assert (sha, int(size)) == (hashlib.sha256(files[name]).digest(), len(files[name]))
    assert not [name for name, content in files.items() if str(ROOT).encode() in content]


STEPS = """
import hashlib, gymnasium, numpy, springgym
envs = gymnasium.make_vec("SpringTop-v0", num_envs=16, vectorization_mode="vector_entry_point")
envs.reset(seed=0)
draw = numpy.random.default_rng(0)
for _ in range(50):
    seen = envs.step(draw.uniform(-1, 1, envs.action_space.shape).astype(numpy.float32))[0]
print(hashlib.sha256(seen.tobytes()).hexdigest())
"""


@pytest.mark.slow
@pytest.mark.skipif(not HAS_V3, reason="this processor has no level")
def test_all_levels_compute_the_same_bits() -> None:
    """With estimates of 1/√d, where the processor can run those, and without."""
    levels = [level for level, names in LEVELS.items() if all(map(features().get, names))]
    seen = set()
    for level in ("host", *levels):
        told = {**os.environ, "SPRINGGYM_CPU": level}
        seen.add(
            subprocess.run([sys.executable, "-c", STEPS], env=told, check=True, capture_output=True).stdout
        )
    assert len(seen) == 1
