"""Names for the arguments of compiled functions, for the reader: Numba infers the types call by call.

One source serves one copy and a block of them (`springgym.core.lanes`): a number is a float, or one of each
copy.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np

Number: TypeAlias = Any
"""A number, or one of each copy of a block."""

Mask: TypeAlias = Any
"""True or false, or one of it for each copy of a block."""

Vector: TypeAlias = Any
"""A `springgym.core.vec.Vec` of three numbers; or a tuple of w, x, y, z, a quaternion."""

Tensor: TypeAlias = tuple[Number, Number, Number, Number, Number, Number]
"""A symmetric tensor: xx, yy, zz, xy, xz, yz."""

Numbers: TypeAlias = Any
"""An array of numbers: `load` and `store` take one."""

Rows: TypeAlias = Any
"""An array (N, 3) of numbers, a row a particle or spring: `row` and `set_row` take a `Vector`."""

Ledger: TypeAlias = Any
"""The `Numbers` of `springgym.forces.ledger`, or None."""


class Ragged(NamedTuple):
    """Rows of several bodies."""

    values: np.ndarray
    """(rows, …) of one body after another"""
    start: np.ndarray
    """(bodies + 1,) where each body's rows begin, and the end"""


class Each(NamedTuple):
    """A number of each body."""

    numbers: np.ndarray
    """(bodies,)"""
