"""Compilation of functions that extend Numba, and the cache of compiled code."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from springgym.lazy import submodule

if not TYPE_CHECKING:  # for type checkers, every name would exist

    def __getattr__(name: str) -> Any:
        return submodule(__name__, name)
