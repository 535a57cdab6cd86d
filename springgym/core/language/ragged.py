"""Values of several bodies in one array: how they are stacked, and views of each body's part.

Values are stored one body after another: `Ragged` arrays of rows, `Each` numbers. Compiled code gets the part
of one body from nested tuples of them, as if it were the only one, by
`springgym.core.language.bodies.of_body`. In a scene of one body nothing is `Ragged` or `Each`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from springgym.core.language.blocks import aligned_zeros
from springgym.core.language.kinds import Each, Nested, Ragged


def stacked(terms: Sequence[Nested], blocks: bool = True) -> Nested:
    """Stack nested tuples of the same form, one for each body, into one of `Ragged` and `Each`.

    Parameters
    ----------
    terms
        Tuples of arrays and numbers. An object that is the same in all is shared.
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


def share(term: Nested, body: int) -> Nested:
    """Return the part of a body in nested tuples that `stacked` made: arrays are writable views."""
    if isinstance(term, Ragged):
        own = slice(term.start[body], term.start[body + 1])
        return term.values[:, own] if term.values.dtype.names else term.values[own]
    if isinstance(term, Each):
        return term.numbers[body].item()
    if isinstance(term, tuple):
        parts = [share(part, body) for part in term]
        return type(term)(*parts) if hasattr(term, "_fields") else tuple(parts)
    return term
