"""Records whose arrays are made from the shapes in their annotations."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
import pytest

from springgym.core.language.blocks import block_dtype
from springgym.dynamics.arrays import allocate, flags, of_copies, whole


class Record(NamedTuple):
    gap: Annotated[np.ndarray, of_copies("rows")]
    arm: Annotated[np.ndarray, of_copies("4 rows", 3)]
    pair: Annotated[np.ndarray, whole("rows", 2)]
    kept: Annotated[np.ndarray, flags(1)]
    loose: Annotated[np.ndarray, whole("rows")]
    other: str


def test_a_record_is_made_of_zeros_of_its_shapes() -> None:
    dtype = block_dtype(np.float32, 4)
    made = allocate(Record, {"rows": 5}, dtype, loose=None, other="given")
    found = [(array.shape, array.dtype) for array in made[:4]]
    assert found == [((5,), dtype), ((20, 3), dtype), ((5, 2), np.int64), ((1,), np.bool_)]
    assert not any(array.view(np.uint8).any() for array in made[:4])
    assert made[4:] == (None, "given")
    assert made.gap is not allocate(Record, {"rows": 5}, dtype, loose=None, other="given").gap


def test_an_extent_and_a_field_that_are_missing_are_named() -> None:
    with pytest.raises(KeyError, match="rows"):
        allocate(Record, {}, np.float64, other="")
    with pytest.raises(TypeError, match="other"):
        allocate(Record, {"rows": 1}, np.float64)
