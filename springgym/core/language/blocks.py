"""The layout of a batch: arrays of blocks, and their view as one row per copy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from springgym.core.compiler.decorators import kernel
from springgym.core.compiler.targets import REGISTER
from springgym.core.language.memory import block_dtype

WIDTH = {np.dtype(kind): 2 * REGISTER // np.dtype(kind).itemsize for kind in (np.float64, np.float32)}
"""Number of copies in a block of a batch, which fill two vector registers. While one register waits for the
result of the previous operation, the processor works on the other: dampers, which follow one another, cost
half as much as with one register. With more registers, values spill to memory, and more copies wait for those
in contact. Results are bit-identical for blocks of any width."""

CACHE_LINE = 64
"""[bytes]"""


def block_array(copies: int, shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray:
    """Return zeros of shape (blocks, *shape); each element holds a number for every copy of the block.

    One copy makes a block of width 1; more make blocks of `WIDTH`, the last one padded.
    """
    return aligned_zeros(*block_layout(copies, shape, dtype))


def block_layout(
    copies: int, shape: tuple[int, ...], dtype: DTypeLike
) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return the shape and type of a block array, see `block_array`."""
    dtype = np.dtype(dtype)
    width = 1 if copies == 1 else WIDTH[dtype]
    return (-(-copies // width), *shape), block_dtype(dtype, width)


def layout_for(array: np.ndarray, copies: int) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return the shape and type of a block array like another, for a number of copies."""
    return block_layout(copies, array.shape[1:], numbers(array).dtype)


def aligned_zeros(shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray:
    """Return zeros that start at a cache line, so that no block of a full width straddles two."""
    dtype = np.dtype(dtype)
    size = math.prod(shape) * dtype.itemsize
    raw = np.zeros(size + CACHE_LINE, np.uint8)
    start = -raw.ctypes.data % CACHE_LINE
    return raw[start : start + size].view(dtype).reshape(shape)


def numbers(array: np.ndarray) -> np.ndarray:
    """Return a view of a block array as plain numbers of shape (blocks, *shape, width)."""
    return array["lanes"]


def by_copies(array: np.ndarray) -> np.ndarray:
    """Return a view of a block array as plain numbers of shape (blocks, width, *shape)."""
    lanes = numbers(array)
    return lanes.transpose(0, lanes.ndim - 1, *range(1, lanes.ndim - 1))


def to_copies(array: np.ndarray, copies: int) -> np.ndarray:
    """Return the values of a block array, copied to shape (copies, *shape)."""
    lanes = by_copies(array)
    rows = lanes.reshape(-1, *lanes.shape[2:])
    return np.array(rows[:copies], order="C")


def set_copies(array: np.ndarray, index: np.ndarray, values: ArrayLike) -> None:
    """Set the copies ``index`` (k,) of a block array to ``values`` (k, *shape)."""
    lanes = by_copies(array)
    width = lanes.shape[1]
    lanes[index // width, index % width] = values


def get_copies(array: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return the values (k, *shape) of the copies ``index`` (k,) of a block array, copied."""
    lanes = by_copies(array)
    width = lanes.shape[1]
    return lanes[index // width, index % width]


def chosen_copies(array: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return a block array of only the copies ``index`` (k,) of another; the last of them is its padding."""
    chosen = block_array(len(index), array.shape[1:], numbers(array).dtype)
    blocks = chosen.shape[0]
    width = numbers(chosen).shape[-1]
    padded = np.append(index, np.repeat(index[-1:], blocks * width - len(index)))
    set_copies(chosen, np.arange(blocks * width), get_copies(array, padded))
    return chosen


@kernel
def put(lanes: np.ndarray, index: np.ndarray, rows: np.ndarray, bound: float) -> bool:
    """Set copies ``index`` (k,) of `flat_numbers` (blocks, n, width) to ``rows`` (k, n), or (1, n) for all.

    Return False, and change nothing, if a number is NaN or larger than ``bound`` in size.
    """
    width = lanes.shape[2]
    for k in range(rows.shape[0]):
        for n in range(rows.shape[1]):
            if not abs(rows[k, n]) <= bound:
                return False
    for k in range(index.size):
        block = index[k] // width
        lane = index[k] % width
        row = min(k, rows.shape[0] - 1)
        for n in range(rows.shape[1]):
            lanes[block, n, lane] = rows[row, n]
    return True


def ascending(index: np.ndarray, count: int) -> bool:
    """Return whether each index (k,) is larger than the one before, and all are from 0 to ``count`` − 1."""
    if not index.size:
        return True
    return bool(index[0] >= 0 and index[-1] < count and (index[1:] > index[:-1]).all())


def flat_numbers(array: np.ndarray) -> np.ndarray:
    """Return a view of a block array as plain numbers of shape (blocks, n, width)."""
    lanes = numbers(array)
    return lanes.reshape(lanes.shape[0], math.prod(lanes.shape[1:-1]), lanes.shape[-1])
