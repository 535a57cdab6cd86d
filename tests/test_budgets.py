"""Limits on circular imports and long signatures: lower a limit when a change makes its count smaller."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]

CIRCLES = 0
"""Most circles of imports among the files of springgym and agents."""

LONG_SIGNATURES = 22
"""Most functions of springgym and agents with eight or more parameters."""


def sources(*folders: str) -> Iterator[tuple[Path, str, ast.Module]]:
    for path in (path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))):
        text = path.read_text(encoding="utf-8")
        yield path, text, ast.parse(text)


def imports() -> dict[str, set[str]]:
    """Return the modules that each module imports names from; the package ``springgym`` itself aside."""

    def name(path: Path) -> str:
        return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")

    trees = {name(path): tree for path, _, tree in sources("springgym", "agents")}
    graph: dict[str, set[str]] = {module: set() for module in trees}
    for module, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    found = (f"{node.module}.{alias.name}", node.module, f"agents.{node.module}")
                    graph[module] |= set([target for target in found if target in trees][:1])
        graph[module] -= {module, "springgym"}
    return graph


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of modules that import each other, directly or through others."""
    reached: dict[str, set[str]] = {}
    for module in graph:
        found = set()
        waiting = [module]
        while waiting:
            new = graph[waiting.pop()] - found
            found |= new
            waiting += new
        reached[module] = found
    groups = {frozenset(m for m in reached[module] if module in reached[m]) for module in graph}
    return sorted(sorted(group) for group in groups if group)


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    return sum(parameter is not None for parameter in named)


def test_circles_of_imports() -> None:
    found = circles(imports())
    assert len(found) <= CIRCLES, found


def test_long_signatures() -> None:
    found = [
        (path.name, node.name)
        for path, _, tree in sources("springgym", "agents")
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and parameters(node) >= 8
    ]
    assert len(found) <= LONG_SIGNATURES, found


def test_counts_notice_what_they_count() -> None:
    assert circles({"a": {"b"}, "b": {"a"}, "c": {"a"}}) == [["a", "b"]]
    assert circles({"a": {"b"}, "b": set()}) == []
    function = ast.parse("def f(a, /, b, *args, c, **rest): ...").body[0]
    assert isinstance(function, ast.FunctionDef)
    assert parameters(function) == 5
