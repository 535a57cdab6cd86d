"""Imports run downwards only."""

from __future__ import annotations

import ast
import logging.config
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

ROOT = Path(__file__).parents[1]

OURS = {"springgym", *(path.stem for path in (ROOT / "agents").glob("*.py"))}
"""First parts of the names by which files of springgym and agents import each other."""

NAMED_TUPLE = {"_asdict", "_field_defaults", "_fields", "_make", "_replace"}
"""Public in spite of their names."""


def test_layers(monkeypatch: pytest.MonkeyPatch) -> None:
    """The contracts of pyproject.toml, [tool.importlinter]."""
    # it would silence all loggers that there are, for the tests that follow in this process
    monkeypatch.setattr(logging.config, "dictConfig", lambda settings: None)
    assert lint_imports(no_cache=True) == 0


def private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__")


def test_no_underscore_name_is_imported_across_files() -> None:
    """Nor read from an imported module; fields of named tuples have such names in Python itself."""
    found = []
    for path in sorted(path for folder in ("springgym", "agents") for path in (ROOT / folder).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        own: set[str] = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OURS:
                assert node.module is not None
                own |= {alias.asname or alias.name for alias in node.names}
                names = [*node.module.split("."), *(alias.name for alias in node.names)]
                found += [f"{path}:{node.lineno}: {name}" for name in names if private(name)]
        read = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
        for node in read:
            of = node.value.id if isinstance(node.value, ast.Name) else None
            if of in own and private(node.attr) and node.attr not in NAMED_TUPLE:
                found.append(f"{path}:{node.lineno}: {of}.{node.attr}")
    assert not found
