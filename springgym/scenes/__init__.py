"""Scenes as text files: those of the paper, and user-defined ones.

The reader is imported on first use: films and plots of scenes made in Python do not need it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from springgym.lazy import submodule

if TYPE_CHECKING:
    from springgym.scenes.plan import Plan
    from springgym.scenes.reading import load, names

__all__ = ["Plan", "load", "names"]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(submodule(__name__, "plan" if name == "Plan" else "reading"), name)
    return submodule(__name__, name)
