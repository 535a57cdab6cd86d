"""Type aliases for annotations of compiled functions; Numba infers the actual types at each call.

The same source serves one copy and a block of copies (`springgym.core.language.lanes`): a number is a float,
or one float per copy."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np

Number: TypeAlias = Any
"""A number, or one number per copy of a block."""

Mask: TypeAlias = Any
"""A truth value, or one per copy of a block."""

Vector: TypeAlias = Any
"""A `springgym.core.language.vec.Vec` of three numbers; or a tuple of w, x, y, z, a quaternion."""

Tensor: TypeAlias = tuple[Number, Number, Number, Number, Number, Number]
"""A symmetric tensor: xx, yy, zz, xy, xz, yz."""

Block: TypeAlias = tuple[Vector, Vector, Vector]
"""A 3×3 matrix: its rows."""

Numbers: TypeAlias = Any
"""An array of numbers: `load` and `store` take one."""

Rows: TypeAlias = Any
"""An array (N, 3) of numbers, one row per particle or spring: `row` and `set_row` take a `Vector`."""

Ledger: TypeAlias = Any
"""The `Numbers` of `springgym.dynamics.forces.ledger`, or None."""

Nested: TypeAlias = Any
"""Nested tuples of arrays and numbers: with a `Ragged` or `Each` for a value that differs between bodies."""


class Ragged(NamedTuple):
    """Rows of several bodies."""

    values: np.ndarray
    """(rows, …) of one body after another"""
    start: np.ndarray
    """(bodies + 1,) where each body's rows begin, and the end"""


class Each(NamedTuple):
    """One number per body."""

    numbers: np.ndarray
    """(bodies,)"""
