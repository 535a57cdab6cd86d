"""Lanes against NumPy, and the promise built on them: every width and thread count gives the same bits."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from springgym.core.compiler.decorators import kernel
from springgym.core.language.blocks import (
    aligned_zeros,
    ascending,
    block_array,
    flat_numbers,
    numbers,
    put,
    set_copies,
    to_copies,
)
from springgym.core.language.lanes import any_lane, inverse_sqrt, maximum, minimum, multiply_add, select, sqrt
from springgym.core.language.memory import block_dtype, load, load_each, store, store_each
from tests.params import slow_but

pytestmark = pytest.mark.own_kernels

WIDTHS = (1, 8, 16)
DTYPES = (np.float32, np.float64)
KINDS = [(1, np.float64), (16, np.float32), (8, np.float64), (1, np.float32)]


@kernel
def invert(a: Any, out: Any) -> None:
    for n in range(a.shape[0]):
        store(out, n, inverse_sqrt(load(a, n)))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("width", WIDTHS)
def test_inverse_roots_are_rounded_as_root_and_division(width: int, dtype: Any) -> None:
    """However they are found: of any size, of squares, and beside powers of 4, which are hard to round."""
    random = np.random.default_rng(0)
    eps = np.finfo(dtype).eps
    spread = np.exp(random.uniform(-60, 60, 160_000))
    squares = (1 + random.integers(0, 4096, 160_000) / 4096) ** 2 * (
        1 + random.integers(-3, 4, 160_000) * eps
    )
    beside = 4.0 ** np.arange(-9, 11)[:, None] * (1 + np.arange(-4000, 4000) * eps / 2)
    given = np.concatenate([spread, squares, beside.ravel()]).astype(dtype)
    a, out = (aligned_zeros((given.size // width,), block_dtype(dtype, width)) for _ in range(2))
    numbers(a)[:] = given.reshape(-1, width)
    invert(a, out)
    assert numbers(out).ravel().tobytes() == (dtype(1) / np.sqrt(given)).tobytes()


@kernel
def operate(a: Any, b: Any, shared: Any, out: Any) -> int:
    """Every operation on lanes, one a row of ``out``; the result counts masks with a lane set."""
    x = load(a, 0)
    y = load(b, 0)
    s = shared[0]
    store(out, 0, x + y)
    store(out, 1, x - y)
    store(out, 2, x * y)
    store(out, 3, x / y)
    store(out, 4, -x)
    store(out, 5, sqrt(x))
    store(out, 6, s * x + 2)
    store(out, 7, x / s - 1.5)
    store(out, 8, select(x < y, x, y))
    store(out, 9, select(x >= s, x, 0.0))
    store(out, 10, select(x <= y, 1.0, x))
    store(out, 11, maximum(x, y))
    store(out, 12, minimum(x, y))
    store(out, 13, s)
    return int(any_lane(x > y)) + int(any_lane(x < s))


def expected(x: np.ndarray, y: np.ndarray, shared: float) -> list[np.ndarray]:
    one = x.dtype.type
    s = one(shared)
    return [
        x + y,
        x - y,
        x * y,
        x / y,
        -x,
        np.sqrt(x),
        s * x + one(2),
        x / s - one(1.5),
        np.where(x < y, x, y),
        np.where(x >= s, x, one(0)),
        np.where(x <= y, one(1), x),
        np.where(x > y, x, y),
        np.where(x < y, x, y),
        np.full_like(x, s),
    ]


def numbers_of(dtype: Any) -> st.SearchStrategy[float]:
    return st.floats(width=np.dtype(dtype).itemsize * 8)  # infinities, NaN and subnormals among them


@pytest.mark.parametrize(("width", "dtype"), slow_but(KINDS, (1, np.float64), (16, np.float32)))
@settings(deadline=None, max_examples=100)
@given(data=st.data())
def test_operations(width: int, dtype: Any, data: st.DataObject) -> None:
    """Each operation gives, to the bit, what NumPy gives number by number."""
    a, b = (data.draw(arrays(dtype, width, elements=numbers_of(dtype))) for _ in range(2))
    shared = data.draw(numbers_of(np.float32))
    blocks = [aligned_zeros((1,), block_dtype(dtype, width)) for _ in range(2)]
    for block, values in zip(blocks, (a, b), strict=True):
        numbers(block)[0] = values
    out = aligned_zeros((14,), block_dtype(dtype, width))
    masks = operate(*blocks, np.array([shared]), out)
    with np.errstate(all="ignore"):
        for row, values in enumerate(expected(a, b, shared)):
            np.testing.assert_array_equal(numbers(out)[row], values)
            known = ~np.isnan(values)
            np.testing.assert_array_equal(np.signbit(numbers(out)[row][known]), np.signbit(values[known]))
    assert masks == int((a > b).any()) + int((a < dtype(shared)).any())


@kernel
def fuse(a: Any, b: Any, c: Any, out: Any) -> float:
    store(out, 0, multiply_add(load(a, 0), load(b, 0), c[0]))
    return multiply_add(c[0], c[0], c[0])


@pytest.mark.parametrize(("width", "dtype"), slow_but(KINDS, (1, np.float64), (16, np.float32)))
@settings(deadline=None, max_examples=100)
@given(data=st.data())
def test_multiply_add_rounds_once(width: int, dtype: Any, data: st.DataObject) -> None:
    """No number is nearer to the exact a b + c, and lanes give what a number alone gives."""
    order_one = st.floats(-4.0, 4.0, width=32).map(lambda x: x + x * 2.0**-20)
    a, b = (data.draw(arrays(dtype, width, elements=order_one.map(dtype))) for _ in range(2))
    c = float(dtype(data.draw(order_one)))
    blocks = [aligned_zeros((1,), block_dtype(dtype, width)) for _ in range(3)]
    for block, values in zip(blocks, (a, b), strict=False):
        numbers(block)[0] = values
    alone = fuse(*blocks[:2], np.array([c]), blocks[2])
    found = numbers(blocks[2])[0]
    exact = [Fraction(float(p)) * Fraction(float(q)) + Fraction(c) for p, q in zip(a, b, strict=True)]
    triples = [*zip(found, exact, strict=True), (np.float64(alone), Fraction(c) * Fraction(c) + Fraction(c))]
    for value, wanted in triples:
        error = abs(Fraction(float(value)) - wanted)
        for neighbour in (np.nextafter(value, value.dtype.type(side)) for side in (-np.inf, np.inf)):
            assert error <= abs(Fraction(float(neighbour)) - wanted)


@kernel
def choose_rows(rows: Any, own: Any, pairs: Any, shared: Any, out: Any) -> Any:
    n = load(rows, 0)
    store_each(out, (n, 1), load_each(own, (n, 2)))
    store_each(rows, load_each(pairs, (n, 1)), load_each(shared, n))
    return load(pairs, (3, 1))


@pytest.mark.parametrize("differ", [0, 1, None])
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("width", WIDTHS)
def test_each_copy_has_a_row_of_its_own(width: int, dtype: Any, differ: int | None) -> None:
    """Of arrays of blocks it is the copy's own number; of shared ones, of any kind, the same for all.

    Rows may be the same in all copies, or in all but the last one.
    """
    random = np.random.default_rng(width)
    count = 7
    rows, own, out = (
        aligned_zeros(shape, block_dtype(dtype, width)) for shape in ((count,), (count, 3), (count, 3))
    )
    n = random.integers(0, count, width)
    lanes = np.arange(width)
    if differ is not None:
        n[:] = 3
        n[width - 1] += differ
    numbers(rows)[0] = n
    numbers(own)[:] = random.random(numbers(own).shape)
    pairs = random.integers(1, count, (count, 2)).astype(np.uint32)
    shared = random.random(count)
    assert choose_rows(rows, own, pairs, shared, out) == pairs[3, 1]
    assert (numbers(out)[n, 1, lanes] == numbers(own)[n, 2, lanes]).all()
    assert np.count_nonzero(numbers(out)) == width
    assert (numbers(rows)[pairs[n, 1], lanes] == shared[n].astype(dtype)).all()
    assert (numbers(rows)[0] == n).all()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("copies", [1, 5, 8, 16, 19, 40])
def test_rows_of_a_batch(copies: int, dtype: Any) -> None:
    """What goes into blocks copy by copy comes out again, and only what was named is changed."""
    rows = np.arange(copies * 6).reshape(copies, 2, 3).astype(dtype)
    array = block_array(copies, (2, 3), dtype)
    put(flat_numbers(array), np.arange(copies), rows.reshape(copies, 6).astype(float), math.inf)
    np.testing.assert_array_equal(to_copies(array, copies), rows)
    chosen = np.unique([0, copies // 2, copies - 1])
    for value, set_chosen in (
        (-1.0, lambda: set_copies(array, chosen, -1.0)),
        (-2.0, lambda: put(flat_numbers(array), chosen, np.full((1, 6), -2.0), 2.0)),
    ):
        set_chosen()
        rows[chosen] = value
        np.testing.assert_array_equal(to_copies(array, copies), rows)
    assert array.ctypes.data % 64 == 0


def test_numbers_beyond_a_bound_are_not_put() -> None:
    rows = np.linspace(-3.0, 3.0, 8).reshape(2, 4)
    lanes = flat_numbers(block_array(2, (4,), np.float64))
    assert not put(lanes, np.arange(2), rows, 2.9)
    for wrong in (math.nan, math.inf, -math.inf):
        assert not put(lanes, np.arange(2), np.where(rows == 3.0, wrong, rows), 1e30)
    assert not lanes.any()
    assert put(lanes, np.arange(0), rows, 3.0)
    assert not lanes.any()
    assert put(lanes, np.arange(2), rows, 3.0)
    assert (rows == lanes[0, :, :2].T).all()


def test_ascending_indices() -> None:
    assert all(ascending(np.array(index, int), 5) for index in ([], [0], [4], [0, 1, 4]))
    assert not any(ascending(np.array(index), 5) for index in ([5], [-1], [0, 0], [1, 0], [0, 5], [-1, 2]))
