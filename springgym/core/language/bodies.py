"""Several bodies in one scene: compiled code gets the part of one body, as if it were the only one.

`springgym.core.language.ragged` stacks the values of bodies in Python."""

from __future__ import annotations

from numba import types
from numba.extending import intrinsic

from springgym.core.compiler.numba_private import cgutils
from springgym.core.language.kinds import Each, Ragged
from springgym.core.language.memory import check_index, chosen_by, packed, unpacked


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
    array = unpacked(context, builder, array_type, value)
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
        array = unpacked(context, builder, term[0], items[0])
        data = cgutils.pointer_add(builder, array.data, builder.mul(first, array.strides[0]))
        shape = [builder.sub(last, first), *array.shape[1:]]
        return packed(context, builder, term[0], array._replace(data=data, shape=shape))
    chosen = [_of_body(context, builder, t, v, body) for t, v in zip(term, items, strict=True)]
    return context.make_tuple(builder, result, chosen)


@intrinsic
def of_body(typingctx, term, body):
    """Return a term with the values of one body, taken from each `Ragged` and `Each`; all else is shared."""
    return _of_body_type(term)(term, body), chosen_by(_of_body)


@intrinsic
def bodies_of(typingctx, term):
    """Return the number of bodies in a `Ragged`; 1 for an array."""
    several = _is_one_of(Ragged, term)

    def codegen(context, builder, sig, args):
        if not several:
            return context.get_constant(types.intp, 1)
        start = cgutils.unpack_tuple(builder, args[0])[1]
        (extent,) = unpacked(context, builder, sig.args[0][1], start).shape
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
