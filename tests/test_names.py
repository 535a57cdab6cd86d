"""What code calls takes what it is given, wherever no other run would tell."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


def imported(nodes: list[ast.AST]) -> dict[str, Any]:
    """What of the package a file imports by name, and by that name nothing else."""
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


def unfit(source: str) -> Iterator[str]:
    """Calls of the package's functions with arguments that these do not take; mypy reads no tests."""
    nodes = list(ast.walk(ast.parse(source)))
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
    """Slow tests, too, and what only they compile: a signature that changes breaks them unseen."""
    scripts = sorted([*ROOT.glob("tests/**/*.py"), *ROOT.glob("docs/*.py")])
    assert [f"{p}, {of}" for p in scripts for of in unfit(p.read_text(encoding="utf-8"))] == []
    missing = "from springgym.forces.pairs.search import find\nfind(1, 2, 3, pairs=4)\nfind(*range(4), 5)\n"
    assert list(unfit(missing)) == ["line 2: find: missing a required argument: 'room'"]
