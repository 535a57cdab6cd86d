"""The compiler: functions of the language become machine code, which is kept on disk.

- `decorators`: what a compiled function carries, and calls of kernels;
- `targets`: the processors that code is made for;
- `cache`, `code_digest`: the files of compiled code, and how a kernel gets its name;
- `progress`: what the user is told meanwhile;
- `numba_private`: all that depends on the private side of Numba.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from springgym.lazy import submodule

if not TYPE_CHECKING:  # for type checkers, every name would exist

    def __getattr__(name: str) -> Any:
        return submodule(__name__, name)
