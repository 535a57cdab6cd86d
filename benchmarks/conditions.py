"""Conditions of a measurement, and what the commands of this folder share."""

from __future__ import annotations

import ast
import datetime
import importlib.metadata
import os
import platform
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeGuard, TypeVar

ROOT = Path(__file__).parents[1]

T = TypeVar("T")


def conditions() -> dict[str, Any]:
    """Return date, commit, processor and versions of what was measured."""
    versions = {"python": platform.python_version()}
    for package in ("springgym", "numpy", "numba", "scipy", "mujoco"):
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "cpu": processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "versions": versions,
        "commit": commit(),
    }


def commit() -> str | None:
    """Return the commit of this clone, with "-dirty" if springgym/ differs from it; None without git."""
    head = git("rev-parse", "--short=8", "HEAD")
    return f"{head}-dirty" if head and git("status", "--porcelain", "--", "springgym") else head


def processor() -> str:
    """Return the model of the processor."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def git(*arguments: str) -> str | None:
    """Return what git prints about this clone; None where it fails or is not there."""
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def changed_since(commit: str | None) -> bool:
    """Return whether the code of springgym/ has changed since a commit; True if that is unknown.

    Comments, docstrings and the layout of lines are no code.
    """
    changed = git("diff", "--name-only", commit, "--", "springgym/**.py") if commit else None
    if changed is None:
        return True
    return any(code(git("show", f"{commit}:{name}")) != code(text_here(name)) for name in changed.split())


def text_here(name: str) -> str | None:
    """Return the text of a file in the working tree of this clone; None if there is no such file."""
    path = ROOT / name
    return path.read_text(encoding="utf-8") if path.exists() else None


def code(text: str | None) -> str | None:
    """Return the syntax tree of Python source as text, without its docstrings; None for None."""
    if text is None:
        return None
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [line for line in body if not is_text(line)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def is_text(line: ast.AST) -> TypeGuard[ast.Expr]:
    """Return whether a statement is a string alone."""
    return (
        isinstance(line, ast.Expr)
        and isinstance(line.value, ast.Constant)
        and isinstance(line.value.value, str)
    )


def progress(items: Iterable[T], name: str, **options: Any) -> Iterable[T]:
    """Show how far a loop is, where somebody looks and tqdm is installed."""
    try:
        from tqdm import tqdm
    except ImportError:
        return items
    return tqdm(items, desc=name, leave=False, disable=not sys.stderr.isatty(), **options)
