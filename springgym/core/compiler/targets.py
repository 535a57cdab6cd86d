"""The processors that compiled code is made for.

Code is made for the processor that compiles it; with ``SPRINGGYM_CPU=x86-64-v3`` (or another of `LEVELS`) it
is made for every processor of that level. All levels give bit-identical results. Such code can run in a
process whose Numba compiles for the processor itself: the target is fixed when code is made, and functions of
both kinds pass numbers in the same registers.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from functools import cache

import numba

from springgym.core.compiler.numba_private import binding

V3 = "cx16 popcnt sahf sse3 sse4.1 sse4.2 ssse3 avx avx2 bmi bmi2 f16c fma lzcnt movbe xsave"
V4 = f"{V3} avx512f avx512bw avx512cd avx512dq avx512vl"
INTELS = "skylake-avx512"
"""Level of Intel's processors with AVX-512: its code estimates 1/√d, see `springgym.core.language.lanes`."""

LEVELS = {
    "x86-64-v3": V3.split(),
    "x86-64-v4": V4.split(),
    INTELS: f"{V4} adx aes clflushopt clwb pclmul prfchw rdrnd rdseed xsavec xsaveopt".split(),
}
"""Levels of processors that code can be made for, instead of the compiling one, with the features of each
(x86-64 psABI, table 3.1; Intel's level: LLVM's features for user programs). Names are LLVM's. Levels below
these lack fused multiply-add."""


def fitting_level(name: str, has: Mapping[str, bool]) -> str | None:
    """Return the level whose code is fastest on a processor; None if it supports no level.

    Parameters
    ----------
    name
        LLVM's name of the processor, such as "znver4".
    has
        Its features.
    """
    fits = [level for level, needs in LEVELS.items() if all(map(has.get, needs))]
    if name.startswith("znver"):  # where estimates gain nothing
        fits = [level for level in fits if level != INTELS]
    return fits[-1] if fits else None


def _level(asked: str, has: Mapping[str, bool]) -> str | None:
    """Return the level to compile for; None for this processor itself, whose features are ``has``.

    Raises
    ------
    ValueError
        If there is no such level.
    """
    if asked in ("", "host"):
        return None
    if asked not in LEVELS:
        raise ValueError(f"SPRINGGYM_CPU is {asked!r}; it must be host, {', '.join(LEVELS)}")
    lacks = [name for name in LEVELS[asked] if not has.get(name)]
    if lacks:
        warnings.warn(
            f"SPRINGGYM_CPU is {asked!r}, and this processor has no {', '.join(lacks)}: code is compiled for "
            "this processor, and compiled code for others is not used",
            RuntimeWarning,
            stacklevel=2,
        )
        return None
    if numba.config.CPU_NAME or numba.config.CPU_FEATURES is not None:
        raise ValueError("SPRINGGYM_CPU is set, and so is NUMBA_CPU_NAME or NUMBA_CPU_FEATURES: unset one")
    return asked


def features() -> Mapping[str, bool]:
    """Return the features of this processor, by LLVM's names."""
    try:
        return dict(binding.get_host_cpu_features())
    except RuntimeError:  # LLVM does not know, on some processors other than x86-64
        return {}


LEVEL = _level(os.environ.get("SPRINGGYM_CPU", ""), features())
"""The level of `LEVELS` that code is made for; None for processors like this one."""

if LEVEL is not None:  # before Numba compiles anything; the key of an entry holds both
    numba.config.CPU_NAME = LEVEL
    numba.config.CPU_FEATURES = ""

_FITS = LEVEL or fitting_level(binding.get_host_cpu_name(), features())

REGISTER = 64 if _FITS is not None and "avx512f" in LEVELS[_FITS] else 32
"""Size of a vector register of the target processors [bytes]."""


@cache
def as_intels() -> bool:
    """Return whether to compile for Intel's AVX-512, with estimates of 1/√d and gathers.

    On AMD's Zen, square roots are fast too, and gathers are slow. The result follows from Numba's target,
    which is in a cache entry's name: kernels have the same digest on all processors.
    """
    if numba.config.CPU_NAME or numba.config.CPU_FEATURES:  # Numba compiles for another processor
        return bool(numba.config.CPU_NAME == INTELS and not numba.config.CPU_FEATURES)
    has = binding.get_host_cpu_features()
    return bool(has.get("avx512f") and not binding.get_host_cpu_name().startswith("znver"))
