"""Lanes and vectors in plain Python, by NumPy: what functions compute on where nothing is compiled.

With ``NUMBA_DISABLE_JIT=1`` in the environment, functions marked `springgym.core.compiling.compiled` run as
the Python they are, so that a debugger steps through them and their lines can be counted. Each function here
stands for the intrinsic of its name in `springgym.core.lanes` or `springgym.core.vec`, which says what it
does. Operations are IEEE's, as in compiled code, so the bits are the same, but for functions such as the
sine, which Numba takes from another library, and `multiply_add` in single precision, which in one case of
10⁸ is rounded twice.

Indices are checked: a negative one, or one outside of its array, raises an `IndexError`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from springgym.core.kinds import Each, Mask, Nested, Number, Ragged

FOUR, LOCAL = 4, 64
"""Numbers of lanes and of local rows, as in `springgym.core.lanes`."""

Index: TypeAlias = Number | tuple[Number, ...]
"""A whole number or `Lanes` of them; or a tuple of these, one an axis."""


class Lanes(NDArrayOperatorsMixin):
    """A number of each copy in a block: ``numbers`` (width,)."""

    def __init__(self, numbers: np.ndarray) -> None:
        self.numbers = numbers

    def __repr__(self) -> str:
        return f"Lanes({self.numbers.tolist()})"

    def everywhere(self, value: Number) -> np.ndarray:
        """Return the numbers of lanes of this kind, or a number repeated in each lane."""
        if not isinstance(value, Lanes):
            return np.full_like(self.numbers, value)
        if (value.numbers.dtype, value.numbers.shape) != (self.numbers.dtype, self.numbers.shape):
            raise TypeError(f"{value} and {self} are of different precision or width")
        return value.numbers

    def __array_ufunc__(
        self, function: np.ufunc, method: str, *values: Number, **options: object
    ) -> Lanes | np.ndarray:
        """Let operators and NumPy's functions act on lanes and numbers; comparisons give truth values."""
        if method != "__call__" or options:
            return NotImplemented
        found = function(*(self.everywhere(value) for value in values))
        return found if found.dtype == bool else Lanes(found.astype(self.numbers.dtype, copy=False))


class Vec:
    """Three components, each of them `Lanes`, or each a number."""

    __array_ufunc__ = None  # so that a number of NumPy times a vector is what the vector makes of it

    def __init__(self, *components: Number) -> None:
        self.components = components

    def __repr__(self) -> str:
        return f"Vec{self.components}"

    def __getitem__(self, axis: int) -> Number:
        return self.components[axis]

    def __add__(self, other: Vec) -> Vec:
        return vec(*map(operator.add, self.components, other.components))

    def __sub__(self, other: Vec) -> Vec:
        return vec(*map(operator.sub, self.components, other.components))

    def __rmul__(self, scale: Number) -> Vec:
        return vec(*(scale * component for component in self.components))

    def __neg__(self) -> Vec:
        return vec(*map(operator.neg, self.components))


def _alike(*values: Number) -> list[Number]:
    """Return values as lanes if one of them is, else as numbers in double precision."""
    lanes = next((value for value in values if isinstance(value, Lanes)), None)
    if lanes is None:
        return [np.float64(value) for value in values]
    return [Lanes(lanes.everywhere(value)) for value in values]


def vec(x: Number, y: Number, z: Number) -> Vec:
    return Vec(*_alike(x, y, z))


# --- Arithmetic -------------------------------------------------------------------------------------


def sqrt(value: Number) -> Number:
    return np.sqrt(value)


def inverse_sqrt(value: Number) -> Number:
    return 1.0 / np.sqrt(value)


def nearest(value: Number) -> Number:
    return np.rint(value)


def _rounded_once(a: float, b: float, c: float) -> float:
    """Compute a b + c of fractions of whole numbers, of which Python rounds the quotient as IEEE 754 says."""
    try:
        (p, q), (r, s), (t, u) = (number.as_integer_ratio() for number in (a, b, c))
        return (p * r * u + t * q * s) / (q * s * u) or a * b + c  # which has the sign of a zero
    except (ValueError, OverflowError):  # of what is not finite
        return np.float64(a) * b + c


_fused = np.frompyfunc(_rounded_once, 3, 1)


def multiply_add(a: Number, b: Number, c: Number) -> Number:
    a, b, c = _alike(a, b, c)
    found = _fused(a, b, c)
    return found if isinstance(found, Lanes) else np.float64(found)


def select(mask: Mask, true: Number, false: Number) -> Lanes:
    true, false = _alike(true, false)
    return Lanes(np.where(mask, true.numbers, false.numbers))


def any_lane(mask: Mask) -> bool:
    return bool(np.any(mask))


def filled(mask: Mask, value: Number) -> Lanes:
    return Lanes(np.where(mask, value.numbers, value.numbers[np.argmax(mask)]))


def epsilon(value: Number) -> float:
    return float(np.finfo(value.numbers.dtype if isinstance(value, Lanes) else np.float64).eps)


# --- Memory -----------------------------------------------------------------------------------------


def _check(n: int | np.ndarray, extent: int, axis: int = 0) -> None:
    """Raise an `IndexError` unless 0 ≤ n < extent, in each lane."""
    if not np.all((n >= 0) & (n < extent)):
        raise IndexError(f"index {n} on axis {axis} of length {extent}")


def _place(array: np.ndarray, index: Index) -> tuple[int | np.ndarray, ...]:
    """Check an index of an array, and return it as a tuple of whole numbers, one an axis."""
    index = index if isinstance(index, tuple) else (index,)
    found = tuple(n.numbers.astype(np.int64) if isinstance(n, Lanes) else n for n in index)
    for axis, (n, extent) in enumerate(zip(found, array.shape, strict=True)):
        _check(n, extent, axis)
    return found


def load(array: np.ndarray, index: Index) -> Number:
    place = _place(array, index)
    return Lanes(array["lanes"][place].copy()) if array.dtype.names else array[place]


def store(array: np.ndarray, index: Index, value: Number) -> None:
    numbers = array["lanes"][_place(array, index)]
    numbers[...] = Lanes(numbers).everywhere(value)


def _lanes_of(index: Index) -> Lanes:
    return index[0] if isinstance(index, tuple) else index


def load_each(array: np.ndarray, index: Index) -> Lanes:
    place, lanes = _place(array, index), _lanes_of(index).numbers
    found = array["lanes"][*place, np.arange(lanes.size)] if array.dtype.names else array[place]
    return Lanes(found.astype(lanes.dtype))


def store_each(array: np.ndarray, index: Index, value: Number) -> None:
    lanes = _lanes_of(index)
    array["lanes"][*_place(array, index), np.arange(lanes.numbers.size)] = lanes.everywhere(value)


# --- Rows of a single copy --------------------------------------------------------------------------


def alone(array: np.ndarray) -> bool | None:
    return True if array.dtype.names and array["lanes"].shape[-1] == 1 else None


def local_rows(array: np.ndarray) -> np.ndarray:
    return np.zeros(LOCAL, [("lanes", array["lanes"].dtype, (FOUR,))])


def row_of_four(array: np.ndarray, i: int) -> Lanes:
    _check(i, len(array))
    return Lanes(np.append(array["lanes"][i, :, 0], array["lanes"].dtype.type(0)))


def next_four(array: np.ndarray, first: int) -> Lanes:
    _check(first, len(array) - (FOUR - 1))
    found = array[first : first + FOUR]
    return Lanes(found["lanes"][:, 0].copy() if array.dtype.names else found.copy())


def in_precision_of(lanes: Lanes, like: Lanes) -> Lanes:
    return Lanes(lanes.numbers.astype(like.numbers.dtype))


def in_four(number: Number, like: Lanes) -> Lanes:
    return Lanes(like.everywhere(number.numbers[0] if isinstance(number, Lanes) else number))


def of_four(lanes: Lanes) -> tuple[Lanes, ...]:
    return tuple(Lanes(lanes.numbers[n : n + 1]) for n in range(FOUR))


def columns(a: Lanes, b: Lanes, c: Lanes, d: Lanes) -> tuple[Lanes, ...]:
    rows = np.array([lanes.numbers for lanes in (a, b, c, d)])
    return tuple(Lanes(rows[:, axis].copy()) for axis in range(3))


# --- Blocks and bodies ------------------------------------------------------------------------------


def _in_each(choose: Callable[[Nested, int], Nested], term: tuple[Nested, ...], n: int) -> Nested:
    """Choose from each item of a tuple."""
    items = [choose(item, n) for item in term]
    return type(term)(*items) if hasattr(term, "_fields") else tuple(items)


def at(term: Nested, block: int) -> Nested:
    if isinstance(term, tuple):
        return _in_each(at, term, block)
    if not (isinstance(term, np.ndarray) and term.dtype.names):
        return term
    _check(block, len(term))
    return term[block, ...]


def of_body(term: Nested, body: int) -> Nested:
    if isinstance(term, Ragged):
        return term.values[term.start[body] : term.start[body + 1]]
    if isinstance(term, Each):
        return term.numbers[body]
    return _in_each(of_body, term, body) if isinstance(term, tuple) else term


def bodies_of(term: Nested) -> int:
    return len(term.start) - 1 if isinstance(term, Ragged) else 1
