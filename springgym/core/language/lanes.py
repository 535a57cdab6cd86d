"""Lanes: one value for each copy of a block, computed together.

Inside compiled functions ``+ - * /``, comparisons, `sqrt` and `select` act on a `Lanes` value for all copies
at once. A plain number is shared by all copies, and mixing the two broadcasts. So the same source serves a
single environment (width 1: a plain scalar) and a batch. `springgym.core.language.memory` loads lanes from
arrays.

A `Lanes` value is an LLVM vector, hence explicit SIMD: nothing depends on an auto-vectoriser, small batches
are as fast as large ones, and since the operations are IEEE and element by element, results are bit-identical
for every width. `multiply_add` is IEEE's fused operation: processors since 2013 have it.

What it needs of Numba's private side comes from `springgym.core.compiler.numba_private`."""

from __future__ import annotations

import operator

import numpy as np
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model

from springgym.core.compiler.decorators import compiled
from springgym.core.compiler.numba_private import AbstractTemplate, cgutils, infer_global, ir, signature
from springgym.core.compiler.targets import as_intels
from springgym.core.language.kinds import Number


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


def llvm_type(scalar: types.Type, width: int) -> ir.Type:
    """Return the LLVM type of ``width`` numbers: a vector, or a number if there is one."""
    element = {types.float64: ir.DoubleType(), types.float32: ir.FloatType(), types.boolean: ir.IntType(1)}
    return element[scalar] if width == 1 else ir.VectorType(element[scalar], width)


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, lanes: Lanes) -> None:
        super().__init__(manager, lanes, llvm_type(lanes.dtype, lanes.width))


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager, mask: Mask) -> None:
        super().__init__(manager, mask, llvm_type(types.boolean, mask.width))


# --- Arithmetic -------------------------------------------------------------------------------------


def in_all(builder, value, of: ir.Type):
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
    return in_all(builder, context.cast(builder, value, given, of.dtype), llvm_type(of.dtype, of.width))


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
        if not (as_intels() and count % ESTIMATED == 0 and isinstance(of.element, ir.DoubleType)):
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
        return builder.select(args[0], args[1], in_all(builder, first, args[1].type))

    return value(mask, value) if isinstance(value, Lanes) else None, codegen


@intrinsic
def epsilon(typingctx, value):
    """Distance of 1 from the next number of the kind that lanes hold: 2⁻⁵², or 2⁻²³ in single precision."""
    size = float(np.finfo(value.dtype.name).eps)

    def codegen(context, builder, sig, args):
        return context.get_constant(types.float64, size)

    return types.float64(value), codegen


# --- Compiled of these ------------------------------------------------------------------------------


@compiled
def maximum(a: Number, b: Number):
    """Return the larger of two numbers in each lane."""
    return select(a > b, a, b)


@compiled
def minimum(a: Number, b: Number):
    """Return the smaller of two numbers in each lane."""
    return select(a < b, a, b)
