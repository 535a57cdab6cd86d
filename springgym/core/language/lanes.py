"""Lanes: one value for each copy of a block, computed together.

State and per-copy parameters live in arrays whose *element* is a record of ``width`` numbers, one per copy
(`block_dtype`). Inside compiled functions `load` returns such an element as a `Lanes` value, on which ``+ - *
/``, comparisons, `sqrt` and `select` act for all copies at once; `store` puts it back. An array of plain
numbers is a parameter shared by all copies: `load` gives its number, and mixing the two broadcasts. So the
same source serves a single environment (width 1: a plain scalar) and a batch.

A `Lanes` value is an LLVM vector, hence explicit SIMD: nothing depends on an auto-vectoriser, small batches
are as fast as large ones, and since the operations are IEEE and element by element, results are bit-identical
for every width. `multiply_add` is IEEE's fused operation: processors since 2013 have it.

This module has springgym's Numba types, its intrinsics and the addressing of blocks;
`springgym.core.compiler.compiling` has the compilation of functions. Both need more than Numba's public
interface, and there is no replacement for it here: hence the upper bound on Numba in ``pyproject.toml``."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import binding, ir
from numba import types
from numba.core import cgutils, config
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model
from numpy.typing import DTypeLike

from springgym.core.compiler.compiling import INTELS, compiled
from springgym.core.language.kinds import Each, Number
from springgym.core.language.kinds import Ragged as Ragged


def block_dtype(dtype: DTypeLike, width: int) -> np.dtype[Any]:
    """Element type of arrays with one number for each of ``width`` copies."""
    return np.dtype([("lanes", np.dtype(dtype), (width,))])


class Lanes(types.Type):
    """Numba type of ``width`` floats, one per copy."""

    def __init__(self, dtype: types.Float, width: int) -> None:
        self.dtype = dtype
        self.width = width
        super().__init__(name=f"Lanes({dtype} x {width})")


class Mask(types.Type):
    """Numba type of ``width`` truth values, one per copy: the result of comparing `Lanes`."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"Mask({width})")


def _llvm(scalar: types.Type, width: int) -> ir.Type:
    element = {types.float64: ir.DoubleType(), types.float32: ir.FloatType(), types.boolean: ir.IntType(1)}
    return element[scalar] if width == 1 else ir.VectorType(element[scalar], width)


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, lanes: Lanes) -> None:
        super().__init__(manager, lanes, _llvm(lanes.dtype, lanes.width))


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager, mask: Mask) -> None:
        super().__init__(manager, mask, _llvm(types.boolean, mask.width))


# --- Arithmetic -------------------------------------------------------------------------------------


def _in_all(builder, value, of: ir.Type):
    """Broadcast a number to a vector of type ``of``; return it unchanged if that is not a vector type."""
    if not isinstance(of, ir.VectorType):
        return value
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), of.count), [0] * of.count)
    one = builder.insert_element(ir.Constant(of, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, ir.Constant(of, ir.Undefined), zeros)


def as_lanes(context, builder, value, given: types.Type, of: types.Type):
    """Return ``value`` if it is `Lanes`, else cast to the type ``of``, and broadcast if that is `Lanes`."""
    if isinstance(given, Lanes):
        return value
    if not isinstance(of, Lanes):
        return context.cast(builder, value, given, of)
    return _in_all(builder, context.cast(builder, value, given, of.dtype), _llvm(of.dtype, of.width))


def _common(arguments: tuple[types.Type, ...]):
    """Return the only `Lanes` type among arguments that are lanes or numbers; None unless there is one."""
    found = {a for a in arguments if isinstance(a, Lanes)}
    if len(found) != 1 or not all(isinstance(a, (Lanes, types.Number)) for a in arguments):
        return None
    return found.pop()


def _define(function, emit, *, compares: bool = False) -> None:
    """Overload ``function`` (an operator) for lanes and numbers by ``emit(builder, left, right)``."""

    @infer_global(function)
    class _Template(AbstractTemplate):
        def generic(self, args, kws):
            lanes = _common(args)
            if lanes is None:
                return None
            return signature(Mask(lanes.width) if compares else lanes, *args)

    def lower(context, builder, sig, args):
        lanes = _common(sig.args)
        return emit(
            builder, *(as_lanes(context, builder, v, t, lanes) for v, t in zip(args, sig.args, strict=True))
        )

    for left, right in ((Lanes, Lanes), (Lanes, types.Number), (types.Number, Lanes)):
        lower_builtin(function, left, right)(lower)


for _operator, _inplace, _name in (
    (operator.add, operator.iadd, "fadd"),
    (operator.sub, operator.isub, "fsub"),
    (operator.mul, operator.imul, "fmul"),
    (operator.truediv, operator.itruediv, "fdiv"),
):
    for _function in (_operator, _inplace):
        _define(_function, lambda builder, a, b, name=_name: getattr(builder, name)(a, b))
for _operator, _name in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _define(_operator, lambda builder, a, b, name=_name: builder.fcmp_ordered(name, a, b), compares=True)


@infer_global(operator.neg)
class _Negation(AbstractTemplate):
    def generic(self, args, kws):
        return signature(args[0], args[0]) if isinstance(args[0], Lanes) else None


@lower_builtin(operator.neg, Lanes)
def _negate(context, builder, sig, args):
    return builder.fneg(args[0])


def _call(builder, name: str, *operands):
    """Call LLVM's function of that name for the type of the operands."""
    of = operands[0].type
    element = of.element if isinstance(of, ir.VectorType) else of
    suffix = "f64" if isinstance(element, ir.DoubleType) else "f32"
    if of is not element:
        suffix = f"v{of.count}{suffix}"
    signature = ir.FunctionType(of, [of] * len(operands))
    return builder.call(
        cgutils.get_or_insert_function(builder.module, signature, f"llvm.{name}.{suffix}"), operands
    )


@intrinsic
def sqrt(typingctx, value):
    """Square root of each lane."""

    def codegen(context, builder, sig, args):
        return _call(builder, "sqrt", args[0])

    return value(value), codegen


@cache
def _as_intels() -> bool:
    """Return whether to compile for Intel's AVX-512, with estimates of 1/√d and gathers.

    On AMD's Zen, square roots are fast too, and gathers are slow. The result follows from Numba's target,
    which is in a cache entry's name: kernels have the same digest on all processors.
    """
    if config.CPU_NAME or config.CPU_FEATURES:  # Numba compiles for another processor
        return bool(config.CPU_NAME == INTELS and not config.CPU_FEATURES)
    has = binding.get_host_cpu_features()
    return bool(has.get("avx512f") and not binding.get_host_cpu_name().startswith("znver"))


ESTIMATED = 8
"""Number of double-precision values that are estimated at once."""

BELOW = 0.75 * 2.0**-53
"""Fraction by which the estimate is lowered. Else the root of the number before a power of 4, which lies just
below the midpoint of two floating-point numbers, would be rounded up."""


def _rounded_inverse_sqrt(builder, d):
    """Return 1/√d for a vector of `ESTIMATED` numbers, with correctly rounded root and inverse.

    The estimate has 14 correct bits, and all but the last after a fourth-order step. One step each for root
    and inverse then rounds them (Markstein 1990, doi:10.1147/rd.341.0111), correctly for all of 10⁹ numbers.
    """
    of = d.type

    def each(number: float):
        return ir.Constant(of, [number] * of.count)

    def fused(a, b, c):
        return _call(builder, "fma", a, b, c)

    mask = ir.Constant(ir.IntType(8), -1)
    signature = ir.FunctionType(of, [of, of, mask.type])
    name = "llvm.x86.avx512.rsqrt14.pd.512"
    y = builder.call(cgutils.get_or_insert_function(builder.module, signature, name), [d, d, mask])
    e = fused(builder.fneg(builder.fmul(d, y)), y, each(1.0))
    y = fused(builder.fmul(y, e), fused(fused(e, each(0.3125), each(0.375)), e, each(0.5)), y)
    y = fused(y, each(-BELOW), y)
    root = builder.fmul(d, y)
    root = fused(fused(builder.fneg(root), root, d), builder.fmul(each(0.5), y), root)
    e = fused(builder.fneg(root), y, each(1.0))
    return fused(fused(e, e, e), y, y)


@intrinsic
def inverse_sqrt(typingctx, value):
    """1/√d in each lane, for normal numbers d: root and inverse are rounded as in IEEE 754.

    Some processors take twice as long for a square root and a division as for the products and sums that
    refine an estimate to the same result.
    """

    def codegen(context, builder, sig, args):
        (d,) = args
        of = d.type
        count = of.count if isinstance(of, ir.VectorType) else 1
        if not (_as_intels() and count % ESTIMATED == 0 and isinstance(of.element, ir.DoubleType)):
            one = ir.Constant(of, [1.0] * count) if count > 1 else ir.Constant(of, 1.0)
            return builder.fdiv(one, _call(builder, "sqrt", d))

        def numbers(first: int, behind: int):
            return ir.Constant(ir.VectorType(ir.IntType(32), behind - first), list(range(first, behind)))

        found = [
            _rounded_inverse_sqrt(builder, builder.shuffle_vector(d, d, numbers(n, n + ESTIMATED)))
            for n in range(0, count, ESTIMATED)
        ]
        while len(found) > 1:  # join neighbours
            together = numbers(0, 2 * found[0].type.count)
            found = [
                builder.shuffle_vector(a, b, together) for a, b in zip(found[::2], found[1::2], strict=True)
            ]
        return found[0]

    return value(value), codegen


@intrinsic
def rounded(typingctx, value):
    """Round to the nearest integer in each lane."""

    def codegen(context, builder, sig, args):
        return _call(builder, "rint", args[0])

    return value(value), codegen


@intrinsic
def multiply_add(typingctx, a, b, c):
    """a b + c, rounded once, in each lane: one instruction where a product and a sum are two."""
    result = _common((a, b, c)) or types.float64

    def codegen(context, builder, sig, args):
        each = zip(args, sig.args, strict=True)
        return _call(builder, "fma", *(as_lanes(context, builder, v, t, result) for v, t in each))

    return result(a, b, c), codegen


@intrinsic
def select(typingctx, mask, true, false):
    """``true`` in the lanes where the mask holds, ``false`` in the others."""
    lanes = _common((true, false))

    def codegen(context, builder, sig, args):
        chosen = (
            as_lanes(context, builder, v, t, lanes) for v, t in zip(args[1:], sig.args[1:], strict=True)
        )
        return builder.select(args[0], *chosen)

    return lanes(mask, true, false), codegen


@intrinsic
def any_lane(typingctx, mask):
    """Return whether the mask holds in at least one lane."""

    def codegen(context, builder, sig, args):
        if mask.width == 1:
            return context.cast(builder, args[0], types.boolean, types.boolean)
        bits = builder.bitcast(args[0], ir.IntType(mask.width))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask), codegen


@intrinsic
def lane_of(typingctx, value, lane):
    """Return the number of one lane."""

    def codegen(context, builder, sig, args):
        return builder.extract_element(*args) if value.width > 1 else args[0]

    return value.dtype(value, types.intp), codegen


@intrinsic
def filled(typingctx, mask, value):
    """``value`` where the mask holds; in the other lanes, that of the first lane in which it does.

    If the lanes of the mask have the same row index, all lanes then have it, which makes `load_each` faster.
    """

    def codegen(context, builder, sig, args):
        if mask.width == 1:
            return args[1]
        bits = builder.bitcast(args[0], ir.IntType(mask.width))
        lane = builder.cttz(bits, ir.Constant(ir.IntType(1), 0))  # the width if it holds in none: take any
        lane = builder.and_(lane, ir.Constant(lane.type, mask.width - 1))
        first = builder.extract_element(args[1], lane)
        return builder.select(args[0], args[1], _in_all(builder, first, args[1].type))

    return value(mask, value) if isinstance(value, Lanes) else None, codegen


@intrinsic
def epsilon(typingctx, value):
    """Distance of 1 from the next number of the kind that lanes hold: 2⁻⁵², or 2⁻²³ in single precision."""
    size = float(np.finfo(value.dtype.name).eps)

    def codegen(context, builder, sig, args):
        return context.get_constant(types.float64, size)

    return types.float64(value), codegen


# --- Memory -----------------------------------------------------------------------------------------


class _Array(NamedTuple):
    """LLVM values of an array's fields: Numba's own proxy writes the whole array to the stack to read one."""

    meminfo: ir.Value
    parent: ir.Value
    itemsize: ir.Value
    data: ir.Value
    shape: list[Any]
    strides: list[Any]


def _unpacked(context, builder, array_type, value) -> _Array:
    """Load the fields of an array."""
    field = context.data_model_manager[array_type].get_field_position

    def axes(name: str) -> list[Any]:
        return [builder.extract_value(value, (field(name), axis)) for axis in range(array_type.ndim)]

    meminfo, parent, itemsize, data = (
        builder.extract_value(value, field(name)) for name in _Array._fields[:4]
    )
    return _Array(meminfo, parent, itemsize, data, axes("shape"), axes("strides"))


def _packed(context, builder, array_type, array: _Array):
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
    array = _unpacked(context, builder, array_type, value)
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
        pointer = _llvm(element.dtype, element.width).as_pointer()
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
    array = _unpacked(context, builder, array_type, args[0])
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
            place = builder.mul(place, _in_all(builder, across, place.type))
            place = builder.add(place, _in_all(builder, axis, place.type))
        if own:
            place = builder.mul(place, _in_all(builder, ir.Constant(long, element.width), place.type))
            place = builder.add(place, lane)
        return place

    data = builder.bitcast(array.data, _llvm(element.dtype, 1).as_pointer()) if own else array.data
    if gathers:
        every = ir.Constant(ir.VectorType(long, lanes.width), list(range(lanes.width)))
        return data, offset(rows, every)
    return data, [offset(row, ir.Constant(long, lane)) for lane, row in enumerate(_each(builder, rows))]


def _gathered(builder, data, offset, number: types.Float):
    """Return the numbers of all lanes, loaded by a gather instruction."""
    width = offset.type.count
    of = _llvm(number, width)
    size = number.bitwidth // 8
    places = ir.VectorType(_llvm(number, 1).as_pointer(), width)
    first = _in_all(builder, builder.ptrtoint(data, offset.type.element), offset.type)
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
    equal = builder.fcmp_ordered("==", index, _in_all(builder, first, index.type))
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
        gathers = _as_intels() and lanes.width > 1 and number == lanes.dtype
        data, offset = _own_numbers(context, builder, sig, args, gathers)
        if gathers:
            return _gathered(builder, data, offset, number)
        found = [
            context.cast(builder, builder.load(builder.gep(data, [place])), number, lanes.dtype)
            for place in offset  # cast: counts, and numbers of another precision
        ]
        if lanes.width == 1:
            return found[0]
        vector = ir.Constant(_llvm(lanes.dtype, lanes.width), ir.Undefined)
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
    array = _unpacked(context, builder, term, value)
    check_index(context, builder, block, array.shape[0])
    data = cgutils.pointer_add(builder, array.data, builder.mul(block, array.strides[0]))
    one = array._replace(data=data, shape=array.shape[1:], strides=array.strides[1:])
    return _packed(context, builder, _one_block(term), one)


@intrinsic
def at(typingctx, term, block):
    """Return a term with the values of one block: arrays of blocks are indexed, all else is shared."""
    return _one_block(term)(term, block), _chosen_by(_at)


def _chosen_by(choose: Callable[..., ir.Value]):
    """Return a code generator of ``choose`` for a term and a whole number."""

    def codegen(context, builder, sig, args):
        index = context.cast(builder, args[1], sig.args[1], types.intp)
        return choose(context, builder, sig.args[0], args[0], index)

    return codegen


# --- Several bodies -----------------------------------------------------------------------------------


def _is_one_of(kind: type, term: types.Type) -> bool:
    return isinstance(term, types.BaseNamedTuple) and term.instance_class is kind


def _of_body_type(term: types.Type) -> types.Type:
    """Return the type `of_body` gives for a term."""
    if _is_one_of(Ragged, term):
        return term[0]
    if _is_one_of(Each, term):
        return term[0].dtype
    if isinstance(term, types.BaseTuple):
        return types.BaseTuple.from_types(
            [_of_body_type(t) for t in term], getattr(term, "instance_class", None)
        )
    return term


def _item(context, builder, array_type, value, n):
    """Read a number of a one-dimensional array."""
    array = _unpacked(context, builder, array_type, value)
    check_index(context, builder, n, array.shape[0])
    return context.unpack_value(builder, array_type.dtype, builder.gep(array.data, [n]))


def _of_body(context, builder, term: types.Type, value, body):
    """LLVM value of `of_body`."""
    result = _of_body_type(term)
    if result == term:
        return value
    items = cgutils.unpack_tuple(builder, value)
    if _is_one_of(Each, term):
        return _item(context, builder, term[0], items[0], body)
    if _is_one_of(Ragged, term):
        first = _item(context, builder, term[1], items[1], body)
        after = builder.add(body, body.type(1))
        last = _item(context, builder, term[1], items[1], after)
        array = _unpacked(context, builder, term[0], items[0])
        data = cgutils.pointer_add(builder, array.data, builder.mul(first, array.strides[0]))
        shape = [builder.sub(last, first), *array.shape[1:]]
        return _packed(context, builder, term[0], array._replace(data=data, shape=shape))
    chosen = [_of_body(context, builder, t, v, body) for t, v in zip(term, items, strict=True)]
    return context.make_tuple(builder, result, chosen)


@intrinsic
def of_body(typingctx, term, body):
    """Return a term with the values of one body, taken from each `Ragged` and `Each`; all else is shared."""
    return _of_body_type(term)(term, body), _chosen_by(_of_body)


@intrinsic
def bodies_of(typingctx, term):
    """Return the number of bodies in a `Ragged`; 1 for an array."""
    several = _is_one_of(Ragged, term)

    def codegen(context, builder, sig, args):
        if not several:
            return context.get_constant(types.intp, 1)
        start = cgutils.unpack_tuple(builder, args[0])[1]
        (extent,) = _unpacked(context, builder, sig.args[0][1], start).shape
        return builder.sub(extent, extent.type(1))

    return types.intp(term) if several or isinstance(term, types.Array) else None, codegen


@intrinsic
def all_rows(typingctx, term):
    """Return the rows of all bodies: those of a `Ragged`, or an array itself."""
    several = _is_one_of(Ragged, term)

    def codegen(context, builder, sig, args):
        return cgutils.unpack_tuple(builder, args[0])[0] if several else args[0]

    return (term.types[0] if several else term)(term), codegen


@intrinsic
def first_row(typingctx, term, body):
    """Return the index of a body's first row among those of all bodies; 0 for an array, which is of one."""
    several = _is_one_of(Ragged, term)

    def codegen(context, builder, sig, args):
        if not several:
            return context.get_constant(types.intp, 0)
        start = cgutils.unpack_tuple(builder, args[0])[1]
        index = context.cast(builder, args[1], sig.args[1], types.intp)
        return _item(context, builder, sig.args[0][1], start, index)

    return types.intp(term, body), codegen


# --- Compiled of these ------------------------------------------------------------------------------


@compiled
def maximum(a: Number, b: Number):
    """Return the larger of two numbers in each lane."""
    return select(a > b, a, b)


@compiled
def minimum(a: Number, b: Number):
    """Return the smaller of two numbers in each lane."""
    return select(a < b, a, b)
