"""Vectors of compiled code against NumPy: each operation is rounded once, at every width."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba.core.errors import NumbaError

from springgym.core.compiler.decorators import kernel
from springgym.core.language.blocks import aligned_zeros, numbers
from springgym.core.language.memory import block_dtype, load
from springgym.core.language.vectors import choose, cross, dot, plus_scaled, row, set_row, vec, vector

WIDTHS = (1, 16)


@kernel
def formulas(x: Any, shared: Any, out: Any) -> None:
    u = row(x, 0)
    w = row(x, 1)
    s = load(x, (2, 0))
    fixed = vector(shared)
    set_row(out, 0, u + w)
    set_row(out, 1, u - w)
    set_row(out, 2, s * u)
    set_row(out, 3, -u)
    set_row(out, 4, 2 * (u + fixed) - 0.5 * s * w)
    set_row(out, 5, fixed - u)
    set_row(out, 6, cross(u, w))
    set_row(out, 7, plus_scaled(u, s, w))
    set_row(out, 8, vec(dot(u, w), u[1], 3.0))
    set_row(out, 9, choose(u[0] > w[0], u, w))
    turned = 0.0 * u
    for axis in range(3):
        turned = turned + vec(u[axis], u[(axis + 1) % 3], 0.0)
    set_row(out, 10, turned)
    set_row(out, 11, 2.0 * (fixed + fixed))


def by_numpy(x: np.ndarray, shared: np.ndarray) -> np.ndarray:
    """Return what `formulas` gives of ``x`` (3, 3, width), but for what is rounded once instead of twice."""
    u = x[0]
    w = x[1]
    s = x[2, 0]
    fixed = shared[:, None].astype(x.dtype)
    products = u[2] * w[2] + (u[1] * w[1] + u[0] * w[0])
    return np.stack(
        [
            u + w,
            u - w,
            s * u,
            -u,
            2 * (u + fixed) - x.dtype.type(0.5) * s * w,
            fixed - u,
            np.cross(u, w, axis=0),
            u + s * w,
            np.stack([products, u[1], np.full_like(s, 3.0)]),
            np.where(u[0] > w[0], u, w),
            np.stack([u[0] + u[1] + u[2], u[1] + u[2] + u[0], 0 * s]),
            np.broadcast_to(4 * fixed, u.shape),
        ]
    )


@pytest.mark.parametrize(("width", "dtype"), [(1, np.float32), (16, np.float64)])
def test_formulas_are_those_of_numpy(width: int, dtype: Any) -> None:
    random = np.random.default_rng(0)
    x, out = (aligned_zeros((rows,), block_dtype(dtype, width)) for rows in (9, 36))
    x = x.reshape(3, 3)
    out = out.reshape(12, 3)
    numbers(x)[:] = random.normal(0, 10, (3, 3, width))
    shared = np.array([0.5, -2.0, 4.0])
    formulas(x, shared, out)
    found = numbers(out)
    right = by_numpy(numbers(x), shared)
    once = [7, 8]  # where a product is added without being rounded
    np.testing.assert_allclose(found[once], right[once], rtol=8 * np.finfo(dtype).eps, atol=1e-4)
    others = [n for n in range(12) if n not in once]
    assert np.array_equal(found[others], right[others])


def test_widths_give_the_same_bits() -> None:
    random = np.random.default_rng(1)
    values = random.normal(0, 10, (3, 3, 16))
    shared = np.array([0.5, -2.0, 4.0])
    made = {}
    for width in WIDTHS:
        made[width] = np.empty((12, 3, 16))
        for first in range(0, 16, width):
            x, out = (aligned_zeros((rows, 3), block_dtype(float, width)) for rows in (3, 12))
            numbers(x)[:] = values[..., first : first + width]
            formulas(x, shared, out)
            made[width][..., first : first + width] = numbers(out)
    assert made[1].tobytes() == made[16].tobytes()


@kernel
def sum_of_vector_and_number(x: Any) -> None:
    set_row(x, 0, row(x, 0) + load(x, (0, 0)))


@kernel
def product_of_vectors(x: Any) -> None:
    set_row(x, 0, row(x, 0) * row(x, 1))


@kernel
def fourth_component(x: Any) -> None:
    set_row(x, 0, row(x, 0)[3] * row(x, 0))


@pytest.mark.parametrize("wrong", [sum_of_vector_and_number, product_of_vectors, fourth_component])
def test_what_has_no_meaning_is_refused(wrong: Any) -> None:
    with pytest.raises((NumbaError, TypeError)):
        wrong(aligned_zeros((2, 3), block_dtype(float, 1)))
