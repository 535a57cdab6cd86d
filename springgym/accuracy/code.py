"""Digests of the code that is measured, by which a number tells whether it is older than what it is of.

They are of what the code does: comments, docstrings, types and the words of errors do not count.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1]

CORE = (
    *("dynamics", "guard", "materials", "measures", "own_forces", "packing"),
    *("scene", "simulator", "stability"),
)

PARTS: Mapping[str, tuple[str, ...]] = {
    "core": ("core/*.py", "contact/*.py", "surfaces/*.py", *(f"{name}.py" for name in CORE)),
    **{
        name: (f"{name}/**/*.py",)
        for name in ("forces", "integrators", "rigid", "collisions", "bodies", "envs")
    },
    "accuracy": tuple(
        f"accuracy/{name}.py" for name in ("peers", "problems", "rungs", "studies", "work_precision")
    ),
    "bench": tuple(
        f"bench/{name}"
        for name in (
            "curves.py",
            "environments.py",
            "errors.py",
            "peers.py",
            "problem.py",
            "reference.cpp",
            "sections.py",
            "timing.py",
        )
    ),
}
"""Parts of the package, and their files."""

SIMULATION = ("core", "forces", "integrators", "rigid", "collisions", "bodies")
"""Parts that everything measured runs."""


@cache
def digests() -> dict[str, str]:
    """Return the digest of each of `PARTS`."""
    return {name: digest(_files(patterns)) for name, patterns in PARTS.items()}


def _files(patterns: Iterable[str]) -> list[Path]:
    return sorted(path for pattern in patterns for path in PACKAGE.glob(pattern))


def digest(paths: Iterable[Path]) -> str:
    """Return eight hexadecimal digits of a hash of what these files do."""
    found = hashlib.sha256()
    for path in paths:
        text = path.read_text(encoding="utf-8")
        found.update(f"{path.name}\n{meaning(text) if path.suffix == '.py' else text}\n".encode())
    return found.hexdigest()[:8]


def meaning(source: str) -> str:
    """Return code as text, without comments, layout, docstrings, types and words of errors."""
    return "".join(_told(ast.parse(source)))


SILENT = ("annotation", "returns", "type_comment", "type_params", "kind", "ctx")
"""Fields of nodes that are left out."""


def _told(node: object) -> Iterator[str]:
    if isinstance(node, ast.Raise):
        yield "raise;"
    elif isinstance(node, ast.AST):
        yield f"{type(node).__name__}("
        for name, value in sorted(ast.iter_fields(node)):
            if name not in SILENT and value is not None and value != []:
                yield f"{name}="
                yield from _told(value)
        yield ")"
    elif isinstance(node, list):
        for item in node:
            if not _is_text(item):
                yield from _told(item)
        yield ";"
    else:
        yield f"{node!r},"


def _is_text(node: object) -> bool:
    """Return whether a statement is a docstring, of a module, class, function or field."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
