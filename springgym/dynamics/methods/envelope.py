"""Block matrices within an envelope, for the linear systems of implicit methods.

Row i of the matrix has 3×3 blocks from column ``first[i]``, the lowest particle that a spring joins to
particle i, up to the diagonal; columns mirror it. Elimination without pivoting fills nothing outside,
so a rope numbered along its length costs as much as a block-tridiagonal matrix, and a body in which all
particles are joined as much as a dense one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from springgym.core.compiler.decorators import compiled
from springgym.core.language.blocks import aligned_zeros
from springgym.core.language.kinds import Block, Number, Rows, Vector
from springgym.core.language.vectors import apply, block, cross, dot, row, set_row, vec


class Envelope(NamedTuple):
    """A matrix: block (i, j) with j ≤ i in ``lower``, (j, i) with j < i in ``upper``, at ``start[i]`` + j."""

    first: np.ndarray
    """(N,) the column j of the first block of each row i"""
    start: np.ndarray
    """(N,) for each row i, the index of its block of column j, minus j"""
    lower: np.ndarray
    """(3 × blocks, 3): the rows of the blocks one after the other"""
    upper: np.ndarray


def envelope(count: int, springs: np.ndarray, dtype: DTypeLike) -> Envelope:
    """Return an empty matrix for ``count`` particles joined by ``springs`` (S, 2)."""
    first = np.arange(count)
    np.minimum.at(first, springs.max(axis=1), springs.min(axis=1))
    ends = np.cumsum(np.arange(count) + 1 - first)
    blocks = aligned_zeros((2, 3 * ends[-1], 3), dtype)
    return Envelope(first, ends - 1 - np.arange(count), *blocks)


@compiled
def set_block(blocks: Rows, n: Number, values: Block) -> None:
    set_row(blocks, 3 * n, values[0])
    set_row(blocks, 3 * n + 1, values[1])
    set_row(blocks, 3 * n + 2, values[2])


@compiled
def combine(u: Vector, rows: Block) -> Vector:
    """Row vector × matrix."""
    return u[0] * rows[0] + u[1] * rows[1] + u[2] * rows[2]


@compiled
def multiply(rows: Block, others: Block) -> Block:
    return combine(rows[0], others), combine(rows[1], others), combine(rows[2], others)


@compiled
def add(rows: Block, others: Block) -> Block:
    return rows[0] + others[0], rows[1] + others[1], rows[2] + others[2]


@compiled
def subtract(rows: Block, others: Block) -> Block:
    return rows[0] - others[0], rows[1] - others[1], rows[2] - others[2]


@compiled
def transpose(rows: Block) -> Block:
    a, b, c = rows
    return vec(a[0], b[0], c[0]), vec(a[1], b[1], c[1]), vec(a[2], b[2], c[2])


@compiled
def invert(rows: Block) -> Block:
    """Inverse of a 3×3 matrix, by cofactors."""
    a, b, c = rows
    first = cross(b, c)
    share = 1.0 / dot(a, first)
    return transpose((share * first, share * cross(c, a), share * cross(a, b)))


@compiled
def factorise(matrix: Envelope, skew: object) -> None:
    """Turn A into L and U of A = L U, L with unit and U with inverted diagonal blocks.

    If ``skew`` is None, A is symmetric: then U = D Lᵀ, and half of the work is left out.
    """
    first, start, lower, upper = matrix
    for i in range(first.size):
        for j in range(first[i], i):
            left = block(lower, start[i] + j)
            right = block(upper, start[i] + j)
            for k in range(max(first[i], first[j]), j):
                left = subtract(left, multiply(block(lower, start[i] + k), block(upper, start[j] + k)))
                if skew is not None:
                    right = subtract(right, multiply(block(lower, start[j] + k), block(upper, start[i] + k)))
            if skew is None:
                right = transpose(left)
            set_block(lower, start[i] + j, multiply(left, block(lower, start[j] + j)))
            set_block(upper, start[i] + j, right)
        diagonal = block(lower, start[i] + i)
        for k in range(first[i], i):
            left = block(lower, start[i] + k)
            right = block(upper, start[i] + k)
            diagonal = subtract(diagonal, multiply(left, right))
        set_block(lower, start[i] + i, invert(diagonal))


@compiled
def solve(matrix: Envelope, y: Rows) -> None:
    """Replace ``y`` (N, 3) by A⁻¹ y, A factorised."""
    first, start, lower, upper = matrix
    for i in range(first.size):
        total = row(y, i)
        for j in range(first[i], i):
            total = total - apply(block(lower, start[i] + j), row(y, j))
        set_row(y, i, total)
    for i in range(first.size - 1, -1, -1):
        found = apply(block(lower, start[i] + i), row(y, i))
        set_row(y, i, found)
        for j in range(first[i], i):
            set_row(y, j, row(y, j) - apply(block(upper, start[i] + j), found))
