"""Arrays of lanes: how compiled functions read and write them.

State and per-copy parameters live in arrays whose *element* is a record of ``width`` numbers, one per copy
(`block_dtype`). `load` returns such an element as a `Lanes` value; `store` puts it back. An array of plain
numbers is a parameter shared by all copies: `load` gives its number. With `load_each` and `store_each`, each
copy has an index of its own. `at` selects a block of copies."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import DTypeLike

from springgym.core.compiler.numba_private import cgutils, ir
from springgym.core.compiler.targets import as_intels
from springgym.core.language.lanes import Lanes, as_lanes, in_all, llvm_type


def block_dtype(dtype: DTypeLike, width: int) -> np.dtype[Any]:
    """Element type of arrays with one number for each of ``width`` copies."""
    return np.dtype([("lanes", np.dtype(dtype), (width,))])


class _Array(NamedTuple):
    """LLVM values of an array's fields: Numba's own proxy writes the whole array to the stack to read one."""

    meminfo: ir.Value
    parent: ir.Value
    itemsize: ir.Value
    data: ir.Value
    shape: list[Any]
    strides: list[Any]


def unpacked(context, builder, array_type, value) -> _Array:
    """Load the fields of an array."""
    field = context.data_model_manager[array_type].get_field_position

    def axes(name: str) -> list[Any]:
        return [builder.extract_value(value, (field(name), axis)) for axis in range(array_type.ndim)]

    meminfo, parent, itemsize, data = (
        builder.extract_value(value, field(name)) for name in _Array._fields[:4]
    )
    return _Array(meminfo, parent, itemsize, data, axes("shape"), axes("strides"))


def packed(context, builder, array_type, array: _Array):
    """Make an array of these fields."""
    field = context.data_model_manager[array_type].get_field_position
    value = ir.Constant(context.get_value_type(array_type), ir.Undefined)
    count = array.itemsize.type(1)
    for extent in array.shape:
        count = builder.mul(count, extent)
    for name, part in (*zip(_Array._fields[:4], array[:4], strict=True), ("nitems", count)):
        value = builder.insert_value(value, part, field(name))
    for name, parts in (("shape", array.shape), ("strides", array.strides)):
        for axis, part in enumerate(parts):
            value = builder.insert_value(value, part, (field(name), axis))
    return value


def _element(array: types.Array) -> types.Type:
    """Return the type that `load` returns for an array: `Lanes` for one of blocks, else its element type."""
    if isinstance(array.dtype, types.Record):
        lanes = array.dtype.typeof("lanes")
        return Lanes(lanes.dtype, lanes.shape[0])
    return array.dtype


def check_index(context, builder, index, extent, axis: int = 0) -> None:
    """Raise unless 0 ≤ index < extent, if bounds are checked; Numba checks only its own accesses."""
    if context.enable_boundscheck:
        # as an unsigned number, a negative one is too large
        _refuse(context, builder, ">=", index, extent, f"index %lld on axis {axis} of length %lld")


def _refuse(context, builder, when: str, left, right, text: str) -> None:
    """Print both numbers and raise where ``left when right``; a message holds constants only."""
    name = builder.function.name.removeprefix("_ZN")
    lengths = re.compile(r"\d+")
    parts = []  # of a mangled name, each after its length
    while length := lengths.match(name):
        parts.append(name[length.end() :][: int(length[0])])
        name = name[length.end() + int(length[0]) :]
    where = ".".join(parts)
    with cgutils.if_unlikely(builder, builder.icmp_unsigned(when, left, right)):
        cgutils.printf(builder, f"{where}: {text}\n", left, right)
        flush = ir.FunctionType(ir.IntType(32), [cgutils.voidptr_t])
        everything = ir.Constant(cgutils.voidptr_t, None)
        builder.call(cgutils.get_or_insert_function(builder.module, flush, "fflush"), [everything])
        message = f"{where}: index outside of its array; the numbers are printed"
        context.call_conv.return_user_exc(builder, IndexError, (message,))


def _indices(context, builder, index, given: types.Type) -> list[Any]:
    """Unpack an index that all lanes share into integers, one per axis."""
    several = isinstance(given, types.BaseTuple)
    parts = cgutils.unpack_tuple(builder, index) if several else [index]
    kinds = given if several else (given,)
    return [context.cast(builder, part, kind, types.intp) for part, kind in zip(parts, kinds, strict=True)]


def _address(context, builder, array_type, value, indices: list[Any]) -> tuple[Any, int]:
    """Return the pointer to ``array[indices]`` of a C-contiguous array, and its alignment in bytes."""
    element = _element(array_type)
    array = unpacked(context, builder, array_type, value)
    extents = array.shape.copy()
    if array_type.ndim == 2 and isinstance(element, Lanes):
        three = ir.Constant(extents[1].type, 3)  # the second index is an axis: a constant offset
        if context.enable_boundscheck:
            _refuse(context, builder, "!=", extents[1], three, "rows of %lld numbers, not of %lld")
        extents[1] = three
    offset = ir.Constant(extents[0].type, 0)
    for axis, (extent, i) in enumerate(zip(extents, indices, strict=True)):
        check_index(context, builder, i, extent, axis)
        offset = builder.add(builder.mul(offset, extent), i)
    if isinstance(element, Lanes):
        pointer = llvm_type(element.dtype, element.width).as_pointer()
        return builder.gep(builder.bitcast(array.data, pointer), [offset]), element.dtype.bitwidth // 8
    return builder.gep(array.data, [offset]), element.bitwidth // 8


@intrinsic
def load(typingctx, array, index):
    """``array[index]`` for all copies of the block: `Lanes`, or the number if it is shared.

    ``array`` is C-contiguous, of shape (rows,) with an integer index, or with a pair of shape (rows, 3), or
    (rows, columns) if it is shared.
    """

    def codegen(context, builder, sig, args):
        indices = _indices(context, builder, args[1], sig.args[1])
        pointer, alignment = _address(context, builder, sig.args[0], args[0], indices)
        return builder.load(pointer, align=alignment)

    return _element(array)(array, index), codegen


@intrinsic
def store(typingctx, array, index, value):
    """``array[index] = value`` for all copies of the block; a number is stored in every lane."""

    def codegen(context, builder, sig, args):
        indices = _indices(context, builder, args[1], sig.args[1])
        pointer, alignment = _address(context, builder, sig.args[0], args[0], indices)
        lanes = as_lanes(context, builder, args[2], sig.args[2], _element(sig.args[0]))
        builder.store(lanes, pointer, align=alignment)
        return context.get_dummy_value()

    return types.void(array, index, value), codegen


def _each(builder, value) -> list[Any]:
    """Return the value of each lane."""
    if not isinstance(value.type, ir.VectorType):
        return [value]
    lanes = (ir.Constant(ir.IntType(32), lane) for lane in range(value.type.count))
    return [builder.extract_element(value, lane) for lane in lanes]


def _own_numbers(context, builder, sig, args, gathers: bool):
    """Return the addresses of ``array[index]`` in a C-contiguous array, for each lane.

    Returns
    -------
    the data, and the offsets in it: as one vector if it ``gathers``, else as a list
    """
    array_type, index_type = sig.args[:2]
    element = _element(array_type)
    array = unpacked(context, builder, array_type, args[0])
    axis = None
    index = args[1]
    lanes = index_type
    if isinstance(index_type, types.BaseTuple):
        index, axis = cgutils.unpack_tuple(builder, index)
        lanes = index_type[0]
        axis = context.cast(builder, axis, index_type[1], types.intp)
    extents = array.shape
    whole = ir.IntType(32)
    long = extents[0].type
    rows = builder.fptosi(index, whole if lanes.width == 1 else ir.VectorType(whole, lanes.width))
    if context.enable_boundscheck:  # only the largest: that takes a hundredth of the code
        most, *others = (builder.sext(row, long) for row in _each(builder, rows))
        for row in others:
            most = builder.select(builder.icmp_unsigned(">", row, most), row, most)
        check_index(context, builder, most, extents[0])
    own = isinstance(element, Lanes)

    def offset(row, lane):
        place = builder.sext(row, lane.type)
        if axis is not None:
            across = ir.Constant(long, 3) if own else extents[1]
            place = builder.mul(place, in_all(builder, across, place.type))
            place = builder.add(place, in_all(builder, axis, place.type))
        if own:
            place = builder.mul(place, in_all(builder, ir.Constant(long, element.width), place.type))
            place = builder.add(place, lane)
        return place

    data = builder.bitcast(array.data, llvm_type(element.dtype, 1).as_pointer()) if own else array.data
    if gathers:
        every = ir.Constant(ir.VectorType(long, lanes.width), list(range(lanes.width)))
        return data, offset(rows, every)
    return data, [offset(row, ir.Constant(long, lane)) for lane, row in enumerate(_each(builder, rows))]


def _gathered(builder, data, offset, number: types.Float):
    """Return the numbers of all lanes, loaded by a gather instruction."""
    width = offset.type.count
    of = llvm_type(number, width)
    size = number.bitwidth // 8
    places = ir.VectorType(llvm_type(number, 1).as_pointer(), width)
    first = in_all(builder, builder.ptrtoint(data, offset.type.element), offset.type)
    offset = builder.mul(offset, ir.Constant(offset.type, [size] * width))
    pointers = builder.inttoptr(builder.add(first, offset), places)
    mask = ir.Constant(ir.VectorType(ir.IntType(1), width), [1] * width)
    signature = ir.FunctionType(of, [places, ir.IntType(32), mask.type, of])
    name = f"llvm.masked.gather.v{width}f{number.bitwidth}.v{width}p0"
    gather = cgutils.get_or_insert_function(builder.module, signature, name)
    alignment = ir.Constant(ir.IntType(32), size)
    none = ir.Constant(of, ir.Undefined)
    return builder.call(gather, [pointers, alignment, mask, none])


def _rows_of(array, index):
    """Return the `Lanes` type of an index that differs by copy; None for any other index."""
    lanes = index[0] if isinstance(index, types.BaseTuple) else index
    fits = isinstance(lanes, Lanes) and array.ndim == (2 if lanes is not index else 1)
    element = _element(array)
    return lanes if fits and not (isinstance(element, Lanes) and element != lanes) else None


def _same_row(context, builder, sig, args, lanes: Lanes) -> tuple[Any, Any]:
    """Return whether all lanes index the same row of an array, and the address of that row."""
    index = args[1]
    axes = []
    if isinstance(sig.args[1], types.BaseTuple):
        index, axis = cgutils.unpack_tuple(builder, index)
        axes = [context.cast(builder, axis, sig.args[1][1], types.intp)]
    first = builder.extract_element(index, ir.Constant(ir.IntType(32), 0))
    equal = builder.fcmp_ordered("==", index, in_all(builder, first, index.type))
    bits = builder.bitcast(equal, ir.IntType(lanes.width))
    same = builder.icmp_unsigned("==", bits, ir.Constant(bits.type, -1))
    row = builder.fptosi(first, ir.IntType(64))
    return same, _address(context, builder, sig.args[0], args[0], [row, *axes])


def _is_of_blocks(array: types.Type, lanes: Lanes) -> bool:
    return lanes.width > 1 and isinstance(_element(array), Lanes)


@intrinsic
def load_each(typingctx, array, index):
    """``array[index]`` where each copy has its own index: an integral number in each lane.

    ``array`` is as in `load`. From an array of plain numbers, which all copies share, each copy reads its own
    element. If all lanes index the same row of an array of blocks, the row is loaded as by `load`.
    """
    lanes = _rows_of(array, index)

    def each(context, builder, sig, args):
        element = _element(sig.args[0])
        number = element.dtype if isinstance(element, Lanes) else element
        gathers = as_intels() and lanes.width > 1 and number == lanes.dtype
        data, offset = _own_numbers(context, builder, sig, args, gathers)
        if gathers:
            return _gathered(builder, data, offset, number)
        found = [
            context.cast(builder, builder.load(builder.gep(data, [place])), number, lanes.dtype)
            for place in offset  # cast: counts, and numbers of another precision
        ]
        if lanes.width == 1:
            return found[0]
        vector = ir.Constant(llvm_type(lanes.dtype, lanes.width), ir.Undefined)
        for lane, value in enumerate(found):
            vector = builder.insert_element(vector, value, ir.Constant(ir.IntType(32), lane))
        return vector

    def codegen(context, builder, sig, args):
        if not _is_of_blocks(sig.args[0], lanes):
            return each(context, builder, sig, args)
        same, (pointer, alignment) = _same_row(context, builder, sig, args, lanes)
        with builder.if_else(same, likely=True) as (together, apart):
            with together:
                loaded = builder.load(pointer, align=alignment)
                here = builder.block
            with apart:
                collected = each(context, builder, sig, args)
                there = builder.block
        result = builder.phi(loaded.type)
        result.add_incoming(loaded, here)
        result.add_incoming(collected, there)
        return result

    return lanes and lanes(array, index), codegen


@intrinsic
def store_each(typingctx, array, index, value):
    """``array[index] = value`` where each copy has its own index, in an array of blocks."""
    lanes = _rows_of(array, index)

    def each(context, builder, sig, args, values) -> None:
        data, offset = _own_numbers(context, builder, sig, args, gathers=False)
        for place, value in zip(offset, _each(builder, values), strict=True):
            builder.store(value, builder.gep(data, [place]))

    def codegen(context, builder, sig, args):
        values = as_lanes(context, builder, args[2], sig.args[2], lanes)
        if _is_of_blocks(sig.args[0], lanes):
            same, (pointer, alignment) = _same_row(context, builder, sig, args, lanes)
            with builder.if_else(same, likely=True) as (together, apart):
                with together:
                    builder.store(values, pointer, align=alignment)
                with apart:
                    each(context, builder, sig, args, values)
        else:
            each(context, builder, sig, args, values)
        return context.get_dummy_value()

    return lanes and types.void(array, index, value), codegen


# --- Blocks -----------------------------------------------------------------------------------------


def _one_block(term: types.Type) -> types.Type:
    """Return the type `at` gives for a term."""
    if isinstance(term, types.Array) and isinstance(term.dtype, types.Record):
        return term.copy(ndim=term.ndim - 1)
    if isinstance(term, types.BaseTuple):
        return types.BaseTuple.from_types(
            [_one_block(item) for item in term], getattr(term, "instance_class", None)
        )
    return term


def _at(context, builder, term: types.Type, value, block):
    """LLVM value of `at`: blocks lie one after another, so a block is an offset of the data."""
    if _one_block(term) == term:
        return value
    if isinstance(term, types.BaseTuple):
        items = cgutils.unpack_tuple(builder, value)
        chosen = [_at(context, builder, t, v, block) for t, v in zip(term, items, strict=True)]
        return context.make_tuple(builder, _one_block(term), chosen)
    array = unpacked(context, builder, term, value)
    check_index(context, builder, block, array.shape[0])
    data = cgutils.pointer_add(builder, array.data, builder.mul(block, array.strides[0]))
    one = array._replace(data=data, shape=array.shape[1:], strides=array.strides[1:])
    return packed(context, builder, _one_block(term), one)


@intrinsic
def at(typingctx, term, block):
    """Return a term with the values of one block: arrays of blocks are indexed, all else is shared."""
    return _one_block(term)(term, block), chosen_by(_at)


def chosen_by(choose: Callable[..., ir.Value]):
    """Return a code generator of ``choose`` for a term and a whole number."""

    def codegen(context, builder, sig, args):
        index = context.cast(builder, args[1], sig.args[1], types.intp)
        return choose(context, builder, sig.args[0], args[0], index)

    return codegen
