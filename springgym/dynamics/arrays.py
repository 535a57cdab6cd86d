"""The arrays of records: the shape of each stands in its annotation, and `allocate` makes all of a record."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple, TypeVar, get_type_hints

import numpy as np
from numpy.typing import DTypeLike

from springgym.core.language.blocks import aligned_zeros

Record = TypeVar("Record", bound=tuple[Any, ...])


class Shape(NamedTuple):
    """The shape of an array, and the type of its elements."""

    axes: tuple[int | str, ...]
    """the extent of each axis, or its name: "4 rows" is four times the extent called rows"""
    kind: type | None
    """the type of elements; None for a number of each copy of a block"""


def of_copies(*axes: int | str) -> Shape:
    """Return the `Shape` of an array that has a number of each copy of a block as an element."""
    return Shape(axes, None)


def whole(*axes: int | str) -> Shape:
    """Return the `Shape` of an array of whole numbers that all copies share."""
    return Shape(axes, np.int64)


def flags(*axes: int | str) -> Shape:
    """Return the `Shape` of an array of truth values that all copies share."""
    return Shape(axes, np.bool_)


def allocate(record: type[Record], extents: Mapping[str, int], dtype: DTypeLike, **given: Any) -> Record:
    """Return a record of zeros.

    Parameters
    ----------
    record
        A named tuple whose fields are annotated with a `Shape`, unless they are given.
    extents
        The extents of axes by name.
    dtype
        The type of elements with a number of each copy.
    given
        Fields that are not to be made.
    """
    for name, shape in _shapes(record).items():
        if name not in given:
            lengths = tuple(_extent(axis, extents) for axis in shape.axes)
            own = dtype if shape.kind is None else shape.kind
            given[name] = aligned_zeros(lengths, own)
    return record(**given)


@cache
def _shapes(record: type) -> dict[str, Shape]:
    """Return the `Shape` of each field that has one."""
    hints = get_type_hints(record, include_extras=True)
    found = ((name, one) for name, hint in hints.items() for one in getattr(hint, "__metadata__", ()))
    return {name: one for name, one in found if isinstance(one, Shape)}


def _extent(axis: int | str, extents: Mapping[str, int]) -> int:
    if isinstance(axis, int):
        return axis
    return math.prod(int(word) if word.isdigit() else extents[word] for word in axis.split())
