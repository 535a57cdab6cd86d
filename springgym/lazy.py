"""Modules that are imported on first use, so that `import springgym` is fast and every dotted name works."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any


def submodule(package: str, name: str) -> Any:
    """Import and return a module of a package, for ``__getattr__`` of that package.

    Raises
    ------
    AttributeError
        If there is none of that name.
    """
    if name.startswith("_") or find_spec(f"{package}.{name}") is None:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    return import_module(f"{package}.{name}")
