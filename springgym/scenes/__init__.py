"""Scenes as text files: those of the paper, and user-defined ones.

The reader is imported on first use: films and plots of scenes made in Python do not need it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from springgym.scenes.plan import Plan
    from springgym.scenes.reading import load, names

__all__ = ["Plan", "load", "names"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{'plan' if name == 'Plan' else 'reading'}"), name)
