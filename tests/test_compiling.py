"""The disk cache of compiled code: right after every edit, whole under concurrency, and nobody else's."""

from __future__ import annotations

import ast
import os
import pickle
import re
import subprocess
import sys
import threading
import time
from collections import namedtuple
from collections.abc import Callable
from enum import IntEnum
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba import typeof
from numba.core.compiler_lock import global_compiler_lock

from springgym.core.compiler import cache as disk
from springgym.core.compiler import decorators, numba_private, progress
from springgym.core.compiler.cache import cache_directory
from springgym.core.compiler.decorators import SameTypes, compiled, kernel
from springgym.core.compiler.numba_private import NEEDS, lacking
from springgym.core.language.blocks import WIDTH, block_array
from springgym.core.language.lanes import any_lane
from springgym.core.language.memory import at, load, store
from springgym.core.language.vectors import dot
from springgym.dynamics import methods as integrators
from springgym.dynamics.measures import read
from springgym.dynamics.methods import verlet
from springgym.dynamics.methods.record import Phase
from springgym.model.bodies import cube
from springgym.model.scene import Scene, WrenchActuator
from springgym.simulator import Simulator
from tests.params import slow_but

pytestmark = pytest.mark.own_kernels

ROOT = Path(__file__).parents[1]

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
        "from springgym.core.compiler.decorators import compiled\n"
        "from user.constants import OFFSET\n"
        "@compiled\n"
        "def shifted(a):\n"
        "    return a + OFFSET\n"
    ),
    "outer.py": (
        "from springgym.core.compiler.decorators import kernel\n"
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


def start(package: Path, cache: Path, run: str = RUN, stderr: int = subprocess.PIPE) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-B", "-c", run.format(folder=str(package.parent))],
        env={**os.environ, "SPRINGGYM_CACHE_DIR": str(cache)},
        stdout=subprocess.PIPE,
        stderr=stderr,
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


@pytest.mark.slow
def test_processes_that_compile_at_once_leave_whole_entries(package: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    together = [start(package, cache) for _ in range(3)]
    assert {finish(process)[0] for process in together} == {8.0}
    assert len(list(cache.iterdir())) == 1
    assert finish(start(package, cache)) == (8.0, 1)


def none_in_an_entry(entry: Path) -> bytes:
    payload = pickle.dumps(None)
    return disk._checksum(entry, payload) + payload


def entry_of_another(entry: Path) -> bytes:
    """As if the file had been renamed."""
    payload = entry.read_bytes()[32:]
    return disk._checksum(entry.with_name("another.nbc"), payload) + payload


def flipped(entry: Path) -> bytes:
    """One bit in the middle: machine code, which unpickles as well as any other."""
    content = bytearray(entry.read_bytes())
    content[len(content) // 2] ^= 1
    return bytes(content)


WRONG: dict[str, Callable[[Path], bytes]] = {
    "empty": lambda entry: b"",
    "cut short": lambda entry: entry.read_bytes()[:100],
    "flipped": flipped,
    "pickled None": lambda entry: pickle.dumps(None),
    "None with its checksum": none_in_an_entry,
    "of another": entry_of_another,
}
"""What may stand in an entry."""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, for kernels of this file."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("SPRINGGYM_CACHE_DIR", str(folder))
    return folder


def hits(value: float = 3.0) -> int:
    """Compile `total` as a new process would; how often it came from the cache."""
    again = kernel(total.py_func)
    assert again(np.array([1.0, value - 1])) == value
    return sum(again.stats.cache_hits.values())


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_entry_costs_a_compilation(what: str, cache: Path) -> None:
    assert hits() == 0
    (entry,) = cache.iterdir()
    assert hits() == 1
    entry.write_bytes(WRONG[what](entry))
    assert hits() == 0
    assert hits() == 1


def test_entries_hold_machine_code_alone(cache: Path) -> None:
    """Not what others would inline; functions that call what came from the cache find it all the same."""
    assert hits() == 0
    (entry,) = cache.iterdir()
    (_, kind, (machine_code, bitcode)), *_ = pickle.loads(entry.read_bytes()[disk.DIGEST :])
    assert kind == "object"
    assert len(bitcode) < 2000 < len(machine_code)
    again = kernel(total.py_func)

    @numba.njit
    def doubled(a: Any) -> float:
        return 2.0 * again(a)

    assert doubled(np.array([1.0, 2.0])) == 6.0
    assert sum(again.stats.cache_hits.values()) == 1


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    """Return what a process that nobody was told in says, where patience is short."""
    monkeypatch.setattr(progress.LOGGER, "disabled", False)  # as import-linter leaves it
    monkeypatch.setattr(progress, "_TOLD", threading.Lock())
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    return caplog


def test_who_waits_for_the_compiler_is_told_once(cache: Path, told: pytest.LogCaptureFixture) -> None:
    assert hits() == 0
    (record,) = told.records
    assert record.levelname == "WARNING"
    assert "up to a minute" in record.getMessage()
    (entry,) = cache.iterdir()
    entry.unlink()
    assert hits() == 0
    assert len(told.records) == 1


def test_who_waits_in_a_thread_is_told(cache: Path, told: pytest.LogCaptureFixture) -> None:
    thread = threading.Thread(target=hits)
    thread.start()
    thread.join()
    assert len(told.records) == 1


@pytest.mark.parametrize("why", ["no folder can be made", "no home"])
def test_who_cannot_keep_compiled_code_is_told_once(
    why: str, tmp_path: Path, told: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise every start would compile again, and nobody would know."""
    monkeypatch.setattr(disk, "_UNSAVED", threading.Lock())
    monkeypatch.setattr(progress, "PATIENCE", 100.0)
    (tmp_path / "file").touch()
    monkeypatch.setenv("SPRINGGYM_CACHE_DIR", str(tmp_path / "file" / "cache"))
    if why == "no home":
        monkeypatch.setattr(disk, "cache_directory", lambda: None)
    assert hits() == 0
    assert hits() == 0
    (record,) = told.records
    assert record.levelname == "WARNING"
    said = record.getMessage()
    assert "compiled code is not kept" in said
    assert ("no home" in said) if why == "no home" else (f"Not a directory: {tmp_path / 'file'}" in said)


def test_who_does_not_wait_is_not_told(
    cache: Path, told: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "PATIENCE", 60.0)
    assert hits() == 0
    assert not [thread for thread in threading.enumerate() if isinstance(thread, threading.Timer)]
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    assert hits() == 1
    assert told.records == []


def test_what_does_not_compile_leaves_nobody_waiting(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "PATIENCE", 60.0)
    with pytest.raises(numba.TypingError):
        kernel(lambda a: a.nothing)(1.0)
    time.sleep(0.1)
    assert not [thread for thread in threading.enumerate() if isinstance(thread, threading.Timer)]


@pytest.mark.slow
def test_a_kernel_that_was_sent_to_another_process_compiles(cache: Path) -> None:
    sent = pickle.dumps(kernel(total.py_func))
    run = "import pickle, sys, numpy as np; print(pickle.load(sys.stdin.buffer)(np.array([1.0, 2.0])))"
    command = [sys.executable, "-c", run]
    assert subprocess.run(command, input=sent, capture_output=True, check=True).stdout == b"3.0\n"


@pytest.mark.parametrize(("quiet", "lines"), slow_but([("", 1), ("logging.disable()", 0)], ("", 1)))
def test_a_script_tells_on_stderr(quiet: str, lines: int, package: Path, tmp_path: Path) -> None:
    patience = "import logging, springgym.core.compiler.progress as progress\nprogress.PATIENCE = 0.0"
    run = f"{patience}\n{quiet}\n{RUN}"
    process = start(package, tmp_path / "cache", run)
    out, error = process.communicate(timeout=60)
    assert out == "8.0 0\n"
    assert error.count("springgym: compiling") == error.count("\n") == lines


def test_a_terminal_counts_the_seconds(package: Path, tmp_path: Path) -> None:
    """In one line that is erased; here one of a compiler that takes two seconds more."""
    reader, writer = os.openpty()
    slow = """import time
from springgym.core.compiler import cache, progress
progress.PATIENCE = 0.0
written = cache.written_result
cache.written_result = lambda *given: time.sleep(2.5) or written(*given)
"""
    process = start(package, tmp_path / "cache", slow + RUN, stderr=writer)
    assert process.communicate(timeout=60)[0] == "8.0 0\n"
    os.close(writer)
    shown = os.read(reader, 10_000).decode()
    os.close(reader)
    assert re.search(r"\rspringgym: compiling kernel 1 \(once, .*\): 2 s", shown)
    assert shown.endswith("\r\033[K")
    assert "\n" not in shown


def test_a_folder_in_place_of_an_entry(cache: Path) -> None:
    assert hits() == 0
    (entry,) = cache.iterdir()
    entry.unlink()
    entry.mkdir()
    assert hits() == 0
    assert list(cache.iterdir()) == [entry]


def test_a_user_without_a_home_has_no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(path: Path) -> Path:
        raise RuntimeError("Could not determine home directory.")

    for variable in ("SPRINGGYM_CACHE_DIR", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(Path, "expanduser", nowhere)
    assert cache_directory() is None
    assert hits() == 0


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="other variables")
@pytest.mark.parametrize("named", ["", "cache", "./cache", "~/cache"])
def test_a_cache_is_never_in_the_current_folder(named: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Entries are run: those that lie in whatever folder Python is started from are not one's own."""
    monkeypatch.delenv("SPRINGGYM_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", named)
    monkeypatch.setenv("HOME", "/home/somebody")
    assert cache_directory() == Path("/home/somebody/.cache/springgym")
    monkeypatch.setenv("HOME", "relative")
    assert cache_directory() is None


@pytest.mark.skipif(sys.platform == "win32", reason="modes are set as on POSIX")
@pytest.mark.parametrize("umask", [0o022, 0o077])
def test_entries_follow_the_umask(umask: int, cache: Path) -> None:
    """So that what root compiled into an image, its users need not."""
    before = os.umask(umask)
    try:
        assert hits() == 0
    finally:
        os.umask(before)
    (entry,) = cache.iterdir()
    assert entry.stat().st_mode & 0o777 == 0o666 & ~umask


FULL = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))  # an error as of a full disk, EFBIG for ENOSPC
""" + RUN.lstrip()


@pytest.mark.skipif(sys.platform == "win32", reason="limits are set as on POSIX")
def test_a_full_disk_costs_a_compilation_and_leaves_nothing(package: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert finish(start(package, cache, FULL)) == (8.0, 0)
    assert list(cache.iterdir()) == []


def test_types_are_those_that_numba_finds() -> None:
    """Arrays differ in one property each, tuples in their entries or names; each is asked for twice."""
    packed, aligned = (np.dtype([("a", "f8")], align=align) for align in (False, True))
    assert packed == aligned
    square = np.zeros((2, 2))
    fixed = np.zeros(2)
    fixed.setflags(write=False)
    arrays = [np.zeros(2), np.zeros(2, int), np.zeros(2, packed), np.zeros(2, aligned), np.zeros(4)[::2]]
    arrays += [fixed, square, np.asfortranarray(square), np.zeros((3, 3))[::2, ::2], np.zeros(())]
    values: list[Any] = [*arrays, *((array,) for array in arrays)]
    values += [(), (1,), (1.0,), (True,), (None,), (0.0, 1)]
    for name in ("One", "Other"):
        kind = namedtuple(name, ("first", "second"))
        values += [kind(1.0, arrays[0]), kind(1.0, fixed), kind(1, (2, 3.0))]
    for value in [*values, *values]:
        assert decorators.type_of(value) == typeof(value)
    assert len({decorators.type_of(value) for value in values}) == len(values)


def test_a_cache_that_cannot_be_written_costs_a_compilation(package: Path, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    assert finish(start(package, blocked / "cache")) == (8.0, 0)
    assert blocked.read_text() == "no folder"


LACKING = """
import sys, warnings
sys.path.insert(0, {folder!r})
import numba
kept = {path}
del {path}
with warnings.catch_warnings(record=True) as given:
    warnings.simplefilter("always")
    import springgym.core.compiler.cache
    {path} = kept  # Numba itself needs it
    from user.outer import double_sum, triple_sum
    value = double_sum(3.0) + triple_sum(3.0)
(warning,) = given
assert {path!r}.rpartition(".")[2] in str(warning.message), warning
assert warning.category is RuntimeWarning
print(value, sum(double_sum.stats.cache_hits.values()))
"""
"""Uses two kernels of a Numba that lacks something."""


def place(part: str) -> tuple[Any, str]:
    """Return the object of Numba that holds a part, and the part's name there."""
    home, _, last = part.partition("(")[0].rpartition(".")
    return attrgetter(home)(numba), last


LACKS = [
    part.partition("(")[0]
    for part in NEEDS["cache"]
    if place(part)[1] in vars(place(part)[0]) and "_CompilerLock" not in part  # which importing Numba takes
]


@pytest.mark.parametrize("lacks", slow_but(LACKS, "core.serialize.dumps"))
def test_a_numba_that_lacks_something_costs_compilations(lacks: str, package: Path, tmp_path: Path) -> None:
    """Whatever of its private side is gone: there is one warning, no cache, and the same value."""
    (package / "outer.py").write_text(
        FILES["outer.py"] + "@kernel\ndef triple_sum(a):\n    return 3.0 * shifted(a)\n"
    )
    path = f"numba.{lacks}"
    run = LACKING.replace("{path!r}", repr(path)).replace("{path}", path)
    assert finish(start(package, tmp_path / "cache", run)) == (20.0, 0)
    assert not (tmp_path / "cache").exists()


PARTS = [(use, part) for use, parts in NEEDS.items() for part in parts]


@pytest.mark.parametrize(("use", "part"), PARTS)
def test_each_private_part_is_looked_for(use: str, part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert lacking(use) == []
    owner, last = place(part)
    if last in vars(owner):
        monkeypatch.delattr(owner, last)
    else:  # set in a method
        monkeypatch.setattr(numba_private, "_sets", lambda owner, name: False)
    assert f"numba.{part}" in lacking(use)


@pytest.mark.parametrize("parameters", ["ptr, builder, offset", "builder, ptr", "builder, ptr, offset, size"])
def test_a_part_with_other_parameters_is_another(parameters: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert lacking("language") == []
    monkeypatch.setattr("numba.core.cgutils.pointer_add", eval(f"lambda {parameters}: None"))
    assert lacking("language") == ["numba.core.cgutils.pointer_add(builder, ptr, offset)"]


def test_the_list_of_private_parts_is_whole() -> None:
    """It has every part that the code names: what begins with an underscore, and what contexts give."""
    known = {place(part)[1] for _, part in PARTS} | {"_fields", "_replace", "_alone", "_called"}
    used = set()
    for path in (ROOT / "springgym" / "core").glob("*/*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute):
                private = path.name == "numba_private.py" and re.match("_[a-z]", node.attr)
                if private or (isinstance(node.value, ast.Name) and node.value.id in ("context", "cgutils")):
                    used.add(node.attr)
            elif isinstance(node, ast.FunctionDef):
                imports = [one for one in ast.walk(node) if isinstance(one, ast.ImportFrom)]
                used |= {name.name for one in imports for name in one.names}
    assert {"_final_module", "pointer_add", "make_tuple", "Assign"} <= used
    assert used <= known


def test_a_numba_without_what_the_language_needs_is_refused_in_a_line() -> None:
    run = "import numba; del numba.core.cgutils.if_unlikely; import springgym.simulator"
    done = subprocess.run(
        [sys.executable, "-c", run], capture_output=True, text=True, check=False, timeout=60
    )
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"ImportError: springgym cannot run with Numba {numba.__version__}, which has no ")
    assert "numba.core.cgutils.if_unlikely(builder, pred): install a version" in last


ALLOWED = "springgym/core/compiler/numba_private.py"
"""The file that may reach into Numba."""


def test_numbas_private_side_is_behind_one_file() -> None:
    """The rest of the package takes what Numba makes public."""
    private = re.compile(
        r"\b(import|from) llvmlite\b|\bnumba\.(core|np)\b|\._(cache|defn)\b|\b_(reduce|rebuild)\("
    )
    found = [
        path
        for path in (file.relative_to(ROOT).as_posix() for file in ROOT.glob("springgym/**/*.py"))
        if private.search((ROOT / path).read_text(encoding="utf-8"))
    ]
    assert found == [ALLOWED]


STEP = """
import os, sys
import springgym
heavy = {"torch", "matplotlib", "pygame", "stable_baselines3", "mujoco", "imageio"}
heavy |= {"numba", "llvmlite", "scipy", "yaml"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
import numba
before, environment = dict(vars(numba.config)), dict(os.environ)
import gymnasium
env = gymnasium.make("SpringTop-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
assert vars(numba.config) == before
assert os.environ == environment
heavy -= {"numba", "llvmlite", "scipy", "yaml"}  # numba asks for the version of the last two
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
    simulator._advance = integrators.kernel_of.__wrapped__(integrators.advance_each(verlet.integrate), read)
    before = simulator.positions
    simulator.advance(3)
    assert not np.array_equal(simulator.positions, before)
    (assembly,) = simulator._advance.inspect_asm().values()
    assert "sqrt" in assembly
    assert "NRT_incref" not in assembly
    assert "NRT_Allocate" not in assembly


def test_inner_functions_refuse_python() -> None:
    """They have no code for a call from Python, before and after a kernel has compiled them."""
    with pytest.raises(TypeError, match="dot is compiled for use in kernels only"):
        dot((1.0, 2.0, 3.0), (1.0, 2.0, 3.0))
    Simulator(Scene(cube(), pinned=(0,), wrench=WrenchActuator())).advance()
    with pytest.raises(TypeError, match="dot is compiled for use in kernels only"):
        dot((1.0, 2.0, 3.0), (1.0, 2.0, 3.0))


@pytest.mark.parametrize("lacking", [False, True])
def test_inner_functions_are_lowered_as_far_as_numba_lets_us(
    lacking: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They stop short of machine code of their own; a Numba that does not know how makes it, to no use."""
    monkeypatch.setenv("SPRINGGYM_CACHE_DIR", str(tmp_path))  # what comes from the cache compiles nothing
    if lacking:
        monkeypatch.setattr(numba_private, "_has", lambda path: path != "core.ir.Assign")
        with pytest.warns(RuntimeWarning, match=r"has no numba\.core\.ir\.Assign: .* takes longer"):
            found = numba_private.pipelines()
        for name, options in zip(("INNER", "OUTER"), found, strict=True):
            monkeypatch.setattr(decorators, name, options)

    @compiled
    def twice(a: float) -> float:
        return 2.0 * a

    @kernel
    def fourfold(a: float) -> float:
        return twice(twice(a))

    assert fourfold(3.0) == 12.0
    for options in (decorators.INNER, decorators.OUTER):
        assert ("pipeline_class" in options) != lacking
    (inner,) = twice.overloads.values()
    passes = inner.metadata["pipeline_times"]["nopython"]
    assert any("native_lowering" in name for name in passes) == lacking


def test_functions_of_users_link_all_that_inner_functions_call() -> None:
    """A function that a user compiles with Numba gets all that inner functions call, directly or not."""

    @compiled
    def third(a: float) -> float:
        return a / 3.0

    @compiled
    def ninth(a: float) -> float:
        return third(third(a))

    @numba.njit
    def twice_ninth(a: float) -> float:
        return ninth(a) + ninth(a)

    @kernel
    def both(a: float) -> float:
        return twice_ninth(a) + third(a)

    assert twice_ninth(9.0) == 2.0
    assert both(9.0) == 5.0


def test_inner_functions_may_hold_functions() -> None:
    @compiled
    def fourth_power(a: float) -> float:
        def square(b: float) -> float:
            return b * b

        return square(square(a))

    @kernel
    def one_more(a: float) -> float:
        increase = lambda b: b + 1.0  # noqa: E731
        return increase(fourth_power(a))

    assert one_more(2.0) == 17.0


class Index(IntEnum):
    THREE = 3


@pytest.mark.usefixtures("cache")
def test_inner_functions_are_compiled_once_for_all_numbers_of_a_kind() -> None:
    @compiled
    def one_after(count: int, first: int, on: bool) -> int:
        return count + 1 if on else first

    @kernel
    def counted(n: int) -> int:
        count = 0
        for _ in range(n):
            first = count
            count = one_after(count, first, on=True)
            count = one_after(count, first=Index.THREE, on=count < 5)
        return count + one_after(Index.THREE, first=0, on=True)

    assert [counted(n) for n in range(5)] == [4, 6, 8, 7, 9]
    assert len(one_after.overloads) == 1


@compiled
def wander(a: float, n: int) -> float:
    """Values that other blocks read: made before, within and after loops, and in one branch of two."""
    first = 2.0 * a
    total = 0.0
    for i in range(n):
        step = first + i
        if step > 3.0:
            high = step * step
            total += high
        else:
            total -= step
            if total < -5.0:
                return total * first
        for j in range(i):
            if j == 2:
                break
            total += j * first - step
    if n == 0:
        return first
    mean = total / n
    while mean > 1.0:
        mean = 0.5 * mean
        total += mean
    return total + first


def test_what_is_kept_as_a_value_is_what_it_was(cache: Path) -> None:
    @kernel
    def wandered(a: float, n: int) -> float:
        return wander(a, n)

    for a in (-2.0, -0.3, 0.0, 0.7, 5.0):
        for n in range(6):
            assert wandered(a, n) == wander.py_func(a, n)


class Pair(NamedTuple):
    """Of a module that is not springgym's."""

    one: np.ndarray
    other: np.ndarray


def test_only_tuples_of_this_package_are_handed_on_whole() -> None:
    """What others have compiled takes theirs apart."""
    x = np.zeros((2, 3))
    model = numba.core.datamodel.default_manager.lookup
    assert isinstance(model(typeof(Pair(x, x[0]))).get_argument_type(), tuple)
    whole = model(typeof(Phase(x, x[0], None)))
    assert whole.get_argument_type() == whole.get_value_type()


LATE = """
import sys, pathlib
sys.path.insert(0, {folder!r})
from user.outer import double_sum
inner = pathlib.Path({folder!r}, "user", "inner.py")
inner.write_text(inner.read_text().replace("a + OFFSET", "a - OFFSET"))
print(double_sum(3.0), sum(double_sum.stats.cache_hits.values()))
"""
"""Edits a file after it was imported, and before the kernel is compiled."""


@pytest.mark.slow
def test_what_was_edited_since_it_was_imported_is_cached_as_it_was(package: Path, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert finish(start(package, cache, LATE)) == (8.0, 0)
    assert finish(start(package, cache)) == (4.0, 0)
    (package / "inner.py").write_text(FILES["inner.py"])
    assert finish(start(package, cache)) == (8.0, 1)


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


def test_what_is_compiled_waits_for_no_compiler(cache: Path) -> None:
    """While another thread compiles, a simulator of a kind that there is already can be made."""
    again = kernel(total.py_func)
    arguments = np.array([1.0, 2.0])
    again(arguments)
    with global_compiler_lock:
        thread = threading.Thread(target=SameTypes(again), args=(arguments,))
        thread.start()
        thread.join(timeout=20)
        assert not thread.is_alive()


FORK = """
import os, sys, threading, time
sys.path.insert(0, {folder!r})
from numba.core.compiler_lock import global_compiler_lock
from user.outer import double_sum

compiling = threading.Event()

def compile_for_long():
    with global_compiler_lock:
        compiling.set()
        time.sleep(0.5)

threading.Thread(target=compile_for_long).start()
compiling.wait()
child = os.fork()
if child == 0:
    os._exit(int(double_sum(3.0)))  # which nobody has compiled yet
_, status = os.waitpid(child, 0)
print(os.waitstatus_to_exitcode(status), 0)
"""
"""Forks while another thread compiles."""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no forks")
def test_a_child_forked_while_another_thread_compiles_can_compile(package: Path, tmp_path: Path) -> None:
    assert finish(start(package, tmp_path / "cache", FORK)) == (8.0, 0)


@compiled
def positive(a: Any, i: Any) -> Any:
    return any_lane(load(a, (i, 2)) > 0.0)


@kernel
def read_outside(array: Any, block: Any, i: Any) -> Any:
    return positive(at(array, block), i)


@kernel
def write_outside(array: Any, block: Any, i: Any) -> None:
    store(at(array, block), (0, i), 0.0)


@pytest.mark.parametrize(
    ("function", "block", "i", "says"),
    [
        (read_outside, 0, 4, "positive: index 4 on axis 0 of length 4"),
        (read_outside, 0, -1, "positive: index -1 on axis 0 of length 4"),
        (read_outside, 2, 0, "read_outside: index 2 on axis 0 of length 2"),
        (read_outside, -1, 0, "read_outside: index -1 on axis 0 of length 2"),
        (write_outside, 0, 3, "write_outside: index 3 on axis 1 of length 3"),
    ],
)
def test_bounds_are_checked_when_that_is_asked_for(
    function: Any,
    block: int,
    i: int,
    says: str,
    cache: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """As ``NUMBA_BOUNDSCHECK=1`` does."""
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1)
    again = kernel(function.py_func)
    array = block_array(WIDTH[np.dtype(float)] + 1, (4, 3), float)
    again(array, 1, 2)
    with pytest.raises(IndexError, match=r"index outside of its array; the numbers are printed"):
        again(array, block, i)
    assert capfd.readouterr().out == f"{__name__}.{says}\n"


def test_rows_of_another_length_are_refused_when_that_is_asked_for(
    cache: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """`load` takes it for granted that a row is three numbers."""
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1)
    with pytest.raises(IndexError):
        kernel(write_outside.py_func)(block_array(10, (4, 2), float), 0, 0)
    assert "write_outside: rows of 2 numbers, not of 3" in capfd.readouterr().out


def test_what_checks_bounds_is_not_what_others_get_from_the_cache(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for checks in (None, 1):
        monkeypatch.setattr(numba.config, "BOUNDSCHECK", checks)
        assert (hits(), hits()) == (0, 1)
    assert len(list(cache.iterdir())) == 2


def test_a_class_of_a_script_is_found_again(tmp_path, monkeypatch):
    """Its class is another object in every run, and in what is kept of an earlier one."""
    monkeypatch.setenv("SPRINGGYM_CACHE_DIR", str(tmp_path))

    def run() -> tuple[float, bool]:
        class Pair(NamedTuple):
            first: float
            second: float

        function = kernel(summed)
        found = SameTypes(function)(Pair(1.0, 2.0))
        return found, bool(function.stats.cache_hits)

    assert run() == (3.0, False)
    assert run() == (3.0, True)


def summed(pair):
    return pair.first + pair.second


def test_code_that_is_not_compiled_is_refused_in_a_line() -> None:
    env = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    run = [sys.executable, "-c", "import springgym; import springgym.simulator"]
    done = subprocess.run(run, env=env, capture_output=True, text=True, check=False, timeout=60)
    last = done.stderr.splitlines()[-1]
    assert last == "ImportError: springgym runs compiled code only: unset NUMBA_DISABLE_JIT"
