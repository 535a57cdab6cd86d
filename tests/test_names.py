"""What docstrings, pages and tests name is there; what tests call takes what it is given."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import springgym
from tests.test_pages import PAGES, ROOT, prose

SOURCES = sorted(
    path
    for folder in ("springgym", "agents", "benchmarks", "tests", "docs")
    for path in (ROOT / folder).glob("**/*.py")
    if path != Path(__file__)
)
STANDARD = {"copy", "dataclasses", "gymnasium", "numba", "numpy", "pettingzoo", "viser"}
"""Modules of others that are named."""
OBJECTS = {
    "env": "SpringEnv",
    "envs": "SpringVectorEnv",
    "episodes": "Episodes",
    "simulator": "Simulator",
    "m": "Measures",
    "s": "Situation",
}
"""Of what class the objects are that pages name."""
QUOTED = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
NAME = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\(.*\))?")


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


# --- Calls --------------------------------------------------------------------------------------------


def imported(nodes: list[ast.AST]) -> dict[str, Any]:
    """Return what of the package a file imports by name, and by that name nothing else."""
    found: dict[str, Any] = {}
    own = set()
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and str(node.module).partition(".")[0] == "springgym":
            module = import_module(str(node.module))
            for of in node.names:
                name, thing = of.asname or of.name, getattr(module, of.name, None)
                if found.setdefault(name, thing) is not thing:
                    own.add(name)
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            own.add(node.name)
        elif isinstance(node, ast.arg):
            own.add(node.arg)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            own.add(node.id)
    return {name: thing for name, thing in found.items() if name not in own}


def unfit(nodes: list[ast.AST]) -> Iterator[str]:
    """Calls of the package's functions with arguments that these do not take; mypy reads no tests."""
    known = imported(nodes)
    for node in nodes:
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in known):
            continue
        called = known[node.func.id]
        called = getattr(called, "py_func", called)  # of a compiled function
        unpacked = any(isinstance(of, ast.Starred) for of in node.args) or None in [
            of.arg for of in node.keywords
        ]
        if inspect.isfunction(called) and not unpacked:
            try:
                inspect.signature(called).bind(*node.args, **{str(of.arg): of for of in node.keywords})
            except TypeError as error:
                yield f"line {node.lineno}: {node.func.id}: {error}"


def test_functions_are_called_with_what_they_take() -> None:
    """Every call in the tests and scripts fits the signature of what it calls, in slow tests, too."""
    scripts = [p for p in SOURCES if p.relative_to(ROOT).parts[0] in ("tests", "docs")]
    assert [f"{p}, {of}" for p in scripts for of in unfit(nodes_of(p))] == []
    missing = "from springgym.contact.search import find\nfind(1, 2, 3, pairs=4)\nfind(*range(4), 5)\n"
    assert list(unfit(list(ast.walk(ast.parse(missing))))) == [
        "line 2: find: missing a required argument: 'lists'"
    ]


# --- Names --------------------------------------------------------------------------------------------


class Known(NamedTuple):
    """Names that the source files of the project define or use."""

    members: dict[str, set[str]]
    """of each module, by its dotted name, and of each class, by its own: what it defines"""
    bases: dict[str, set[str]]
    """of each class"""
    words: set[str]
    """all identifiers that the project uses, and all strings that look like one"""


@cache
def known() -> Known:
    found = Known({}, {}, set())
    for path in SOURCES:
        parts = path.relative_to(ROOT).with_suffix("").parts
        module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found.words.update(parts)
        docs = {id(node.value) for node in nodes_of(path) if isinstance(node, ast.Expr)}
        tree = nodes_of(path)[0]
        assert isinstance(tree, ast.Module)
        found.members.setdefault(module, set()).update(defined(tree.body))
        found.members.setdefault(module.rpartition(".")[0], set()).add(module.rpartition(".")[2])
        for node in nodes_of(path):
            if isinstance(node, ast.ClassDef):
                own = [
                    of.attr for of in ast.walk(node) if isinstance(of, ast.Attribute) and is_self(of.value)
                ]
                found.members.setdefault(node.name, set()).update(own, defined(node.body))
                found.bases.setdefault(node.name, set()).update(last_name(base) for base in node.bases)
            for name in ("id", "attr", "arg", "name", "value"):
                word = getattr(node, name, None)
                if isinstance(word, str) and id(node) not in docs:
                    found.words.add(word)
    return found


def is_self(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and node.id == "self"


def last_name(node: ast.AST) -> str:
    return ast.unparse(node).partition("[")[0].rpartition(".")[2]


def defined(body: list[ast.stmt]) -> set[str]:
    """Return what the lines of a module or class define or import, those under ``if`` among them."""
    found: set[str] = set()
    for line in body:
        if isinstance(line, (ast.FunctionDef, ast.ClassDef)):
            found.add(line.name)
        elif isinstance(line, (ast.Import, ast.ImportFrom)):
            found |= {of.asname or of.name.partition(".")[0] for of in line.names}
        elif isinstance(line, (ast.Assign, ast.AnnAssign, ast.With)):
            found |= {of.id for of in ast.walk(line) if isinstance(of, ast.Name)}
        elif isinstance(line, (ast.If, ast.Try)):
            found |= defined(line.body) | defined(line.orelse)
    return found


def has(owner: str, name: str) -> bool:
    """Tell whether a class or a class it inherits from has a member."""
    bases = known().bases.get(owner, set())
    return name in known().members.get(owner, set()) or any(has(base, name) for base in bases)


def resolves(name: str) -> bool:
    """Tell whether a dotted name is there: of a module of ours, whole or its end; of a class; or of
    others."""
    first, *rest = name.split(".")
    if len(rest) == 1 and first == "springgym" and hasattr(springgym, rest[0]):
        return True  # what is imported when it is asked for
    if first in STANDARD:
        thing = import_module(first)
        for n, part in enumerate(rest, 2):
            if not hasattr(thing, part):
                try:
                    import_module(".".join(name.split(".")[:n]))
                except ModuleNotFoundError:
                    return False
            thing = getattr(thing, part)
        return True
    if first in OBJECTS:
        return all(has(OBJECTS[first], part) or part in ("unwrapped", "spec") for part in rest)
    owner, _, last = name.rpartition(".")
    if has(owner.rpartition(".")[2], last):
        return True
    ends = [module for module in known().members if f".{module}".endswith(f".{owner}")]
    return any(last in known().members[module] for module in ends)


def lost(text: str, plain: bool) -> Iterator[str]:
    """Names in backticks that nothing has: dotted ones, and ``plain`` ones that look like code, too."""
    for quoted in QUOTED.findall(text):
        match = NAME.fullmatch(quoted)
        if match is None or (ROOT / "docs" / quoted).exists():
            continue
        name = match[1]
        looks = name != name.lower() or "_" in name
        if ("." in name and not resolves(name)) or (
            plain and "." not in name and looks and name not in known().words
        ):
            yield quoted


FILE = re.compile(r"`[\w.]+\.(py|md|txt|toml|cff|json|ya?ml|npz|zip|csv)`|`vX\.Y\.Z`")


def test_names_in_docstrings_are_there() -> None:
    """With the modules they are of, or those of their classes."""
    found = [
        f"{path}, line {node.lineno}: {name}"
        for path in SOURCES
        for node in nodes_of(path)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        for name in lost(FILE.sub("", str(node.value.value)), plain=True)
    ]
    assert found == []


@pytest.mark.parametrize("page", [p for p in PAGES if p.name != "CHANGELOG.md"], ids=lambda p: p.name)
def test_dotted_names_of_a_page_are_there(page: Path) -> None:
    assert list(lost(FILE.sub("", prose(page)), plain=False)) == []


def test_what_is_not_there_is_found() -> None:
    wrong = [
        "springgym.contact.search.collide",
        "springgym.forcess.pairs",
        "Body.colour",
        "packing.nothing",
        "gymnasium.vector.nothing",
        "simulator.pears()",
        "Nowhere",
        "NO_SUCH_THING",
        "no_such_thing(1)",
    ]
    text = ", ".join(f"`{name}`" for name in wrong)
    assert list(lost(text, plain=True)) == wrong
    right = "`springgym.contact`, `Body.size`, `simulator.pairs()`, `Elastic.material`, `env.unwrapped`"
    assert list(lost(right, plain=True)) == []
