"""Values of several bodies in one array, and the view that compiled code has of one body.

What bodies have is stored one body after another: `Ragged` arrays of rows, `Each` numbers. `of_body` gives
one body's share of nested tuples of them, as if there were no other. In a scene of one body nothing is
`Ragged` or `Each`, `of_body` gives back what it is given, and nothing of this is left when compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from springgym.blocks import aligned_zeros
from springgym.lanes import check_index


class Ragged(NamedTuple):
    """Rows of several bodies."""

    values: np.ndarray
    """(rows, …) of one body after another"""
    start: np.ndarray
    """(bodies + 1,) where each body's rows begin, and the end"""


class Each(NamedTuple):
    """A number of each body."""

    numbers: np.ndarray
    """(bodies,)"""


def stacked(terms: Sequence[Any], blocks: bool = True) -> Any:
    """Nested tuples of the same form, one for each body, as one of `Ragged` and `Each`.

    Parameters
    ----------
    terms
        Tuples of arrays and numbers. What is the same object in all is shared.
    blocks
        Whether arrays of blocks have an axis of blocks before that of the rows.
    """
    first = terms[0]
    if all(term is first for term in terms):
        return first
    if isinstance(first, tuple):
        parts = [stacked(of, blocks) for of in zip(*terms, strict=True)]
        return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
    if not isinstance(first, np.ndarray):
        return Each(np.array(terms))
    along = 1 if blocks and first.dtype.names else 0
    start = np.cumsum([0, *(term.shape[along] for term in terms)])
    shape = list(first.shape)
    shape[along] = start[-1]
    values = aligned_zeros(tuple(shape), first.dtype)
    np.concatenate(terms, along, out=values)
    return Ragged(values, start)


def share(term: Any, body: int) -> Any:
    """What a body has of nested tuples that `stacked` made: views, to write to."""
    if isinstance(term, Ragged):
        own = slice(term.start[body], term.start[body + 1])
        return term.values[:, own] if term.values.dtype.names else term.values[own]
    if isinstance(term, Each):
        return term.numbers[body].item()
    if isinstance(term, tuple):
        parts = [share(part, body) for part in term]
        return type(term)(*parts) if hasattr(term, "_fields") else tuple(parts)
    return term


def _is_one_of(kind: type, term: types.Type) -> bool:
    return isinstance(term, types.BaseNamedTuple) and term.instance_class is kind


def _of_body_type(term: types.Type) -> types.Type:
    """The type `of_body` gives for a term."""
    if _is_one_of(Ragged, term):
        return term[0]
    if _is_one_of(Each, term):
        return term[0].dtype
    if isinstance(term, types.BaseTuple):
        return types.BaseTuple.from_types(
            [_of_body_type(t) for t in term], getattr(term, "instance_class", None)
        )
    return term


def _item(context: Any, builder: Any, array_type: Any, value: Any, n: Any) -> Any:
    """A number of a one-dimensional array."""
    array = context.make_array(array_type)(context, builder, value)
    (extent,) = cgutils.unpack_tuple(builder, array.shape, 1)
    check_index(context, builder, n, extent)
    return context.unpack_value(builder, array_type.dtype, builder.gep(array.data, [n]))


def _of_body(context: Any, builder: Any, term: types.Type, value: Any, body: Any) -> Any:
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
        array = context.make_array(term[0])(context, builder, items[0])
        view = context.make_array(term[0])(context, builder)
        shape, strides = (cgutils.unpack_tuple(builder, of) for of in (array.shape, array.strides))
        data = cgutils.pointer_add(builder, array.data, builder.mul(first, strides[0]))
        shape = [builder.sub(last, first), *shape[1:]]
        populate_array(view, data, shape, strides, array.itemsize, array.meminfo, array.parent)
        return view._getvalue()
    chosen = [_of_body(context, builder, t, v, body) for t, v in zip(term, items, strict=True)]
    return context.make_tuple(builder, result, chosen)


@intrinsic
def of_body(typingctx: Any, term: Any, body: Any) -> Any:
    """A term with the values of one body: those of `Ragged` and `Each` are chosen, all else is shared."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        index = context.cast(builder, args[1], sig.args[1], types.intp)
        return _of_body(context, builder, sig.args[0], args[0], index)

    return _of_body_type(term)(term, body), codegen


@intrinsic
def bodies_of(typingctx: Any, term: Any) -> Any:
    """How many bodies' values a `Ragged` holds; 1 if it is an array."""
    several = _is_one_of(Ragged, term)

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if not several:
            return context.get_constant(types.intp, 1)
        start = cgutils.unpack_tuple(builder, args[0])[1]
        array = context.make_array(sig.args[0][1])(context, builder, start)
        (extent,) = cgutils.unpack_tuple(builder, array.shape, 1)
        return builder.sub(extent, extent.type(1))

    return types.intp(term), codegen
