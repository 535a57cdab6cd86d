"""The digest of a compiled function: other for whatever changes what is compiled, the same for all else."""

from __future__ import annotations

import ctypes
import enum
import os
import sys
import types
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba import typeof
from numba.extending import intrinsic

from springgym.core.compiler import code_digest
from springgym.core.compiler.cache import SOURCES
from springgym.core.compiler.code_digest import NotHashable, digest
from springgym.core.compiler.decorators import compiled

BASE = {
    "constants": "K = 1.0\n",
    "deep": ("from springgym.core import compiled\nDEEP = 1\n@compiled\ndef deep(a):\n    return a * DEEP\n"),
    "main": (
        "import numpy as np\n"
        "import constants\n"
        "from springgym.core.compiler.decorators import compiled\n"
        "from deep import deep\n"
        "from typing import NamedTuple\n"
        "class Pair(NamedTuple):\n"
        "    first: float = 1.0\n"
        "PAIR = Pair(2.0)\n"
        "SCALAR = np.float32(0.5)\n"
        "ARRAY = np.array([1.0, 2.0])\n"
        "UNUSED = 1\n"
        "def make(k):\n"
        "    @compiled\n"
        "    def inner(a):\n"
        "        '''What it does.'''\n"
        "        return k * a\n"
        "    return inner\n"
        "inner = make(3)\n"
        "def function(a, b=2):\n"
        "    # A remark.\n"
        "    return inner(deep(a)) * constants.K + PAIR.first + SCALAR + ARRAY[0] + b + 0.5\n"
    ),
}
"""Modules by name: the digest is that of ``main.function``."""


@pytest.fixture
def load(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., types.ModuleType]]:
    """Loads the modules of `BASE` as a new process would, with one text replaced; gives ``main``."""
    monkeypatch.setattr(code_digest, "_EARLIER", {})

    def made(module: str = "main", old: str = "", new: str = "") -> types.ModuleType:
        assert old in BASE[module]
        for name, text in BASE.items():
            home = types.ModuleType(name)
            monkeypatch.setitem(sys.modules, name, home)
            exec(text.replace(old, new, 1) if name == module else text, vars(home))
        return sys.modules["main"]

    return made


EDITS = {
    True: [
        ("constants", "1.0", "1.5"),
        ("deep", "DEEP = 1", "DEEP = 2"),
        ("deep", "DEEP = 1", "DEEP = True"),
        ("deep", "a * DEEP", "a / DEEP"),
        ("main", "make(3)", "make(4)"),
        ("main", "Pair(2.0)", "Pair(2.5)"),
        ("main", "first: float = 1.0", "first: float = 1.0\n    second: float = 0.0"),
        ("main", "np.float32(0.5)", "np.float32(0.25)"),
        ("main", "np.float32(0.5)", "np.float64(0.5)"),
        ("main", "[1.0, 2.0]", "[1.0, 3.0]"),
        ("main", "np.array([1.0, 2.0])", "np.array([[1.0, 2.0]])"),
        ("main", "b=2", "b=3"),
        ("main", "+ 0.5", "+ 0.25"),
        ("main", "+ 0.5", "- 0.5"),
        ("main", "k * a\n", "k * a + 0 * k\n"),
        ("main", "    @compiled", "    from springgym.core.compiler.decorators import kernel\n    @kernel"),
    ],
    False: [
        ("main", "UNUSED = 1", "UNUSED = 2\nMORE = object()"),
        ("main", "What it does", "Another text"),
        ("main", "# A remark.\n", "\n\n\n"),
        ("main", "return inner", "return  inner"),
    ],
}
"""Edits of `BASE`, by whether what is compiled is another function then."""


@pytest.mark.parametrize(
    ("anew", "module", "old", "new"), [(anew, *edit) for anew, edits in EDITS.items() for edit in edits]
)
def test_the_digest_is_another_if_what_is_compiled_is(
    load: Any, anew: bool, module: str, old: str, new: str
) -> None:
    before = digest(load().function)
    assert (digest(load(module, old, new).function) != before) == anew


def test_modules_of_the_compiler_enter_whether_they_are_named_or_not() -> None:
    """They make the code of a kernel without lanes, too."""
    several = [(), SOURCES[:1], SOURCES[:2], SOURCES]
    assert len({digest(bound(1), (), sources) for sources in several}) == 4
    assert digest(bound(1), (), SOURCES) == digest(bound(1), (), SOURCES[::-1])


class Colour(enum.Enum):
    RED = 1
    BLUE = 2


class Force(NamedTuple):
    """As forces of one's own are."""

    strength: float

    @staticmethod
    @compiled
    def add(x: Any) -> Any:
        return 2 * x


class OtherForce(NamedTuple):
    strength: float

    @staticmethod
    @compiled
    def add(x: Any) -> Any:
        return 3 * x


OtherForce.__qualname__ = Force.__qualname__


def bound(value: Any) -> Callable[..., Any]:
    """A function that binds a value; always of the same name and code."""

    def function() -> Any:
        return value

    return function


SQUARE = np.arange(4).reshape(2, 2)
DIFFER = [
    *(1, 1.0, True, None, "1", b"1", 0.0, -0.0, float("nan"), 1j, np.int32(1), np.int64(1)),
    *((1, 2), (2, 1), [1, 2], {1: 2}, {1, 2}, frozenset({1, 2})),
    *(np.arange(4), SQUARE, np.asfortranarray(SQUARE), np.dtype("f4"), np.dtype("f8")),
    *(numba.float32, numba.float64, Colour.RED, Colour.BLUE, np.sqrt, np.square, abs, max, np),
    *(Force, OtherForce, Force(1.0), Force(2.0), bound(1), bound(2)),
    *(enum.IntEnum("Index", names) for names in ("ONE TWO", "TWO ONE", "ONE TWO THREE")),
]
"""Values of which no two are compiled alike."""


def test_values_are_told_apart() -> None:
    found = [digest(bound(value)) for value in DIFFER]
    assert len(set(found)) == len(DIFFER)
    assert found == [digest(bound(value)) for value in DIFFER]


def test_forces_among_the_arguments_bring_their_functions() -> None:
    kinds = [(), (typeof(Force(1.0)),), (typeof(OtherForce(1.0)),), (typeof((Force(1.0), 2)),)]
    assert len({digest(bound(1), kind) for kind in kinds}) == len(kinds)


def in_a_force(k: int) -> bytes:
    """By a function that the function of a force among the arguments calls."""

    @compiled
    def pull() -> float:
        return k

    class Pull(NamedTuple):
        particle: int

        @staticmethod
        @compiled
        def add(x: Any, force: Any, own: Any) -> Any:
            return pull()

    return digest(bound(1), (typeof(((1, Pull(0)), 2.0)),))


def in_an_argument(k: int) -> bytes:
    """By a function among the arguments."""

    @compiled
    def function(a: int) -> int:
        return k * a

    return digest(bound(1), (typeof(function),))


def in_an_intrinsic(k: int) -> bytes:
    """By what an intrinsic emits."""

    @intrinsic
    def emitted(context: Any) -> Any:
        return numba.int64(), lambda *arguments: k

    return digest(bound(emitted))


def in_a_recursion(k: int) -> bytes:
    """By a function that calls itself."""

    def down(n: int) -> int:
        return k if n == 0 else down(n - 1)

    return digest(down)


@pytest.mark.parametrize("where", [in_a_force, in_an_argument, in_an_intrinsic, in_a_recursion])
def test_what_is_bound_deep_inside_counts(where: Callable[[int], bytes]) -> None:
    assert where(1) == where(1) != where(2)


@pytest.mark.parametrize(
    "value",
    [object(), ctypes.CDLL(None).abs if os.name == "posix" else object(), np.array([object()]), count()],
    ids=["object", "C", "array", "iterator"],
)
def test_what_has_no_digest_is_refused(value: Any) -> None:
    with pytest.raises(NotHashable, match="digest"):
        digest(bound(value))


def test_a_constant_that_changed_since_is_refused(load: Any) -> None:
    """A function that it calls may have been compiled with the constant as it was, by another kernel."""
    main = load()
    digest(main.function)
    sys.modules["deep"].DEEP = 5
    with pytest.raises(NotHashable, match="DEEP, which deep names, has changed"):
        digest(main.function)


def test_a_module_that_teaches_numba_counts_as_a_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing leads from a function to the overload that it is compiled as."""
    text = (
        "from numba.extending import overload\n"
        "SHARE = 2\n"
        "def stub(a):\n"
        "    'Doubles.'\n"
        "@overload(stub)\n"
        "def _stub(a):\n"
        "    return lambda a: SHARE * a\n"
    )
    found = []
    for n, content in enumerate([text, text.replace("= 2", "= 3"), text.replace(" * ", " + ")]):
        path = tmp_path / f"{n}.py"
        path.write_text(content)
        os.utime(path, (0, 0))
        home = types.ModuleType("taught")
        home.__file__ = str(path)
        monkeypatch.setitem(sys.modules, "taught", home)
        exec(content, vars(home))
        code_digest._source.cache_clear()
        monkeypatch.setattr(code_digest, "_EARLIER", {})
        found.append(digest(bound(home.stub)))
    assert len(set(found)) == 3
    path.write_text(text)  # after it was imported: nobody knows what it said
    code_digest._source.cache_clear()
    with pytest.raises(NotHashable, match="no longer"):
        digest(bound(home.stub))
    code_digest._source.cache_clear()
