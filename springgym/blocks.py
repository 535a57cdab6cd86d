"""The layout of a batch: arrays of blocks, and their view as one row a copy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from springgym.lanes import block_dtype, check_index

WIDTH = {np.dtype(np.float64): 16, np.dtype(np.float32): 32}
"""Copies in a block of a batch: two AVX-512 registers, four of AVX2. While one of a pair waits for the result
of the operation before, the other goes on: dampers, one after another, cost half of what they do in one."""

CACHE_LINE = 64
"""[bytes]"""


def block_array(copies: int, shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """Zeros of shape (blocks, *shape), each element a number for every copy of the block.

    One copy makes a block of width 1; more make blocks of `WIDTH`, the last one padded.
    """
    dtype = np.dtype(dtype)
    width = 1 if copies == 1 else WIDTH[dtype]
    return aligned_zeros((-(-copies // width), *shape), block_dtype(dtype, width))


def aligned_zeros(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """Zeros that start at a cache line, so that no block of a full width straddles two."""
    dtype = np.dtype(dtype)
    size = math.prod(shape) * dtype.itemsize
    raw = np.zeros(size + CACHE_LINE, np.uint8)
    start = -raw.ctypes.data % CACHE_LINE
    return raw[start : start + size].view(dtype).reshape(shape)


def numbers(array: np.ndarray) -> np.ndarray:
    """View of a block array as plain numbers of shape (blocks, *shape, width)."""
    return array["lanes"]


def to_copies(array: np.ndarray, copies: int) -> np.ndarray:
    """The values of a block array, copied to shape (copies, *shape)."""
    lanes = numbers(array)
    rows = np.moveaxis(lanes, -1, 1).reshape(-1, *lanes.shape[1:-1])
    return np.array(rows[:copies], order="C")


def set_copies(array: np.ndarray, index: np.ndarray, values: Any) -> None:
    """Set the copies ``index`` (k,) of a block array to ``values`` (k, *shape)."""
    lanes = numbers(array)
    width = lanes.shape[-1]
    np.moveaxis(lanes, -1, 1)[index // width, index % width] = values


def get_copies(array: np.ndarray, index: np.ndarray) -> np.ndarray:
    """The values (k, *shape) of the copies ``index`` (k,) of a block array, copied."""
    lanes = numbers(array)
    width = lanes.shape[-1]
    return np.moveaxis(lanes, -1, 1)[index // width, index % width]


def set_all(array: np.ndarray, values: np.ndarray) -> None:
    """Set all copies of a block array to ``values`` (copies, *shape)."""
    lanes = numbers(array)
    width = lanes.shape[-1]
    if width == 1:
        lanes[..., 0] = values
        return
    lanes = lanes.transpose(0, lanes.ndim - 1, *range(1, lanes.ndim - 1))
    full, rest = divmod(len(values), width)
    lanes[:full] = np.reshape(values[: full * width], (full, *lanes.shape[1:]))
    if rest:
        lanes[full, :rest] = values[full * width :]


def _one_block(term: types.Type) -> types.Type:
    """The type `at` gives for a term."""
    if isinstance(term, types.Array) and isinstance(term.dtype, types.Record):
        return term.copy(ndim=term.ndim - 1)
    if isinstance(term, types.BaseTuple):
        return types.BaseTuple.from_types(
            [_one_block(item) for item in term], getattr(term, "instance_class", None)
        )
    return term


def _at(context: Any, builder: Any, term: types.Type, value: Any, block: Any) -> Any:
    """LLVM value of `at`: blocks lie one after another, so a block is an offset of the data."""
    if _one_block(term) == term:
        return value
    if isinstance(term, types.BaseTuple):
        items = cgutils.unpack_tuple(builder, value)
        chosen = [_at(context, builder, t, v, block) for t, v in zip(term, items, strict=True)]
        return context.make_tuple(builder, _one_block(term), chosen)
    array = context.make_array(term)(context, builder, value)
    view = context.make_array(_one_block(term))(context, builder)
    shape, strides = (cgutils.unpack_tuple(builder, of) for of in (array.shape, array.strides))
    check_index(context, builder, block, shape[0])
    data = cgutils.pointer_add(builder, array.data, builder.mul(block, strides[0]))
    populate_array(view, data, shape[1:], strides[1:], array.itemsize, array.meminfo, array.parent)
    return view._getvalue()


@intrinsic
def at(typingctx: Any, term: Any, block: Any) -> Any:
    """A term with the values of one block: arrays of blocks are indexed, all else is shared."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        index = context.cast(builder, args[1], sig.args[1], types.intp)
        return _at(context, builder, sig.args[0], args[0], index)

    return _one_block(term)(term, block), codegen
