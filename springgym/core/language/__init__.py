"""A small language of SIMD values on Numba: numbers of many environments, vectors, blocks.

- `lanes`: one number per copy, its operators and functions;
- `memory`: arrays of them;
- `vec`, `vectors`: three numbers as one value;
- `bodies`, `ragged`: the values of several bodies;
- `blocks`, `kinds`: arrays of a batch in Python, and names for annotations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from springgym.lazy import submodule

if not TYPE_CHECKING:  # for type checkers, every name would exist

    def __getattr__(name: str) -> Any:
        return submodule(__name__, name)
