"""The two decorators that every compiled function carries, and calls of kernels.

``@kernel`` marks functions that Python calls: they release the GIL and are cached on disk
(`springgym.core.compiler.cache`). ``@compiled`` marks functions that only kernels call; their code is part of
the kernels that use them.

With ``NUMBA_BOUNDSCHECK=1`` in the environment all compiled functions check every index, those of `lanes` and
`blocks` too, and raise an `IndexError`: slow, for debugging. Set ``NUMBA_OPT=1`` as well: where bodies
collide, LLVM takes many minutes to optimise all these checks, but a minute at this level.

With ``NUMBA_DISABLE_JIT=1`` in the environment this module cannot be imported: lanes exist in compiled code
alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeGuard

import numba
import numpy as np
from numba.extending import is_jitted

from springgym.core.compiler.cache import LACKING, DigestKeyedCache
from springgym.core.compiler.numba_private import Inner, keep_in, pipelines

OPTIONS = {"error_model": "numpy", "_nrt": False}
"""IEEE arithmetic (no fastmath); no allocation, hence no reference counts of arrays, which would cost as much
as the physics where small functions pass arrays."""

CHECKED = bool(numba.config.BOUNDSCHECK)
"""Whether compiled functions check indices, and `SameTypes` checks argument types."""

INNER, OUTER = pipelines()


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function that only kernels call, inlined at each call; it returns numbers, not arrays.

    Passing a scene's sixty arrays by value costs a single copy up to a third of its step, and compiling such
    functions separately takes as long as inlining them.
    """
    dispatcher = numba.njit(**OPTIONS, **INNER)(function)
    dispatcher.__class__ = Inner
    return dispatcher


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls: releases the GIL, cached on disk by a digest of its code."""
    dispatcher = numba.njit(**OPTIONS, **OUTER, nogil=True, no_cfunc_wrapper=True)(function)
    if not LACKING:
        keep_in(dispatcher, DigestKeyedCache(function))
    return dispatcher


def is_inner(function: object) -> TypeGuard[Any]:
    """Return whether a function is one of `compiled`."""
    return isinstance(function, Inner)


_TYPES: dict[tuple[object, ...], tuple[numba.types.Type, object]] = {}
"""Numba's types of arrays and tuples, by keys that determine them. Each entry also holds the types whose ids
are in its key: while they live, no other type has these ids."""


def type_of(value: object) -> numba.types.Type:
    """Return Numba's type of a value.

    Types of arrays and tuples are cached: finding those of all arrays of a simulator takes longer than making
    the arrays.
    """
    parts: list[numba.types.Type] = []
    if type(value) is np.ndarray:
        flags = value.flags
        dtype = value.dtype
        layout = (value.ndim, flags.c_contiguous, flags.f_contiguous, flags.writeable)
        key: tuple[object, ...] = (dtype, dtype.isalignedstruct, *layout)
    elif isinstance(value, tuple):
        parts = [type_of(part) for part in value]
        key = (type(value), *map(id, parts))
    else:
        return numba.typeof(value)
    if key not in _TYPES:
        _TYPES[key] = numba.typeof(value), parts
    return _TYPES[key][0]


class SameTypes:
    """A function that is always called with arguments of the types of the first call.

    The types of a kernel's arguments are determined once. Numba determines them at every call, which for a
    simulator's sixty arrays takes five times as long as the call itself. Later calls are not checked:
    arguments of other types are read as if they had the first types. So callers make all arrays themselves,
    and convert other arguments, such as counts to int and flags to bool. If Numba checks bounds
    (``NUMBA_BOUNDSCHECK=1``), the types of every call are compared, and a difference raises a TypeError.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function: Any = function
        self._code: Callable[..., Any] | None = None
        self._types: tuple[numba.types.Type, ...] | None = None

    def __call__(self, *arguments: object) -> object:
        if self._code is None:
            self._code = self._function
            if is_jitted(self._function):
                self._types = types = tuple(map(type_of, arguments))
                if types not in self._function.overloads:  # compiling waits for the compiler's lock
                    self._function.compile(types)
                self._code = self._function.get_overload(types)
        elif CHECKED and self._types and self._types != (types := tuple(map(numba.typeof, arguments))):
            name = self._function.__name__
            raise TypeError(f"{name} was compiled for {self._types} and is called with {types}")
        return self._code(*arguments)
