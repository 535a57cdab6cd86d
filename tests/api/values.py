"""Values that an argument could be given by mistake, and what a call may make of them."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest


class Strange:
    """An object of no use, which cannot even be shown."""

    def __repr__(self) -> str:
        raise RuntimeError("no repr")

    def __array__(self, *arguments: Any, **options: Any) -> Any:
        raise RuntimeError("no array")


KINDS = [
    *("", "1", "tip", b"1", Strange(), object(), print, Decimal(1), 1j),
    *({}, {"tip": 1}, {1, 2}, slice(3), Ellipsis, [None], ["a", "b", "c"], [[1, 2], [3]], [1j, 2, 3]),
    *([object()] * 2, np.array(["a"] * 3), np.array([None] * 3), [True, 1.0, 2.0], iter([1, 2, 3])),
    *(np.array(["2026-01-01"] * 3, "datetime64[D]"), np.zeros(3, [("x", float)])),
]
"""What is of no kind that a number, an array or an object of ours is of."""

NUMBERS = [
    *(math.nan, math.inf, -math.inf, -1, -1.0, 0, 0.0, -0.0, 0.5, 2.7, 1, 2, 3, 4, 5, 8, 1e-300, 5e-324),
    *(1e-31, 1e-20, 1e10, 1e20, 1e29, 1e30, 1e31, 1e200, 1e308, 10**9, 2**31, 2**53, 2**63, 2**64, 10**400),
    *(Fraction(1, 3), np.float32(1.5), np.float16(np.inf), np.int8(-3), np.int8(5), np.uint64(2**64 - 1)),
    *(np.array(2), np.array(math.nan), np.longdouble(1), True, False, np.True_, None),
]
"""Numbers and what passes for them."""


Door = tuple[Callable[..., Any], dict[str, Any]]


def door(call: Callable[..., Any], **given: Any) -> Door:
    """A call, and arguments for it that are right: its defaults where none is given."""
    parameters = inspect.signature(call).parameters.values()
    return call, {p.name: p.default for p in parameters if p.default is not p.empty} | given


def arguments(doors: Sequence[Door]) -> list[Any]:
    """Parameters of a test: the number of a door and one of its arguments."""
    return [
        pytest.param(n, argument, id=f"{getattr(call, '__name__', type(call).__name__)}-{argument}")
        for n, (call, right) in enumerate(doors)
        for argument in right
    ]


def arrays(shape: tuple[int, ...]) -> list[Any]:
    """Arrays that are not of a shape, or are and hold a wrong number."""
    right = np.ones(shape)
    wrong = [
        np.ones((*shape, 1)),
        np.ones((1, *shape)),
        np.ones((0, *shape)),
        np.ones(shape[:-1]),
        [],
        (),
        [[]],
    ]
    wrong += [
        np.ones((shape[0] + 1, *shape[1:])),
        np.ones((shape[0] - 1, *shape[1:])),
        np.ones((1,) * len(shape)),
    ]
    for value in (math.nan, math.inf, -math.inf, -1.0, 0.0, 0.5, 1e-300, 1e29, 1e30, 1e31, 1e300):
        held = right.copy()
        held.flat[-1] = value
        wrong += [held, np.full(shape, value), held.tolist()]
    wrong += [
        right.astype(kind) for kind in (bool, np.int8, np.uint64, np.float16, np.float32, np.longdouble)
    ]
    wrong += [np.ma.masked_all(shape), [np.ma.masked] * shape[0]]
    return [*wrong, right[::-1], np.asfortranarray(right), right.tolist(), np.broadcast_to(1.0, shape)]


def attempt(names: Sequence[str], value: Any, call: Callable[[], Any], *also: type[Exception]) -> Any:
    """Return what a call gives with a value of an argument; None if it is refused as it must be.

    A refusal is a TypeError or ValueError whose message names the argument, the first of the names, or if the
    value is of the right kind another argument that it does not fit, or the body that cannot be so.
    """
    try:
        return call()
    except (TypeError, ValueError) as error:
        kind = type(error).__name__
        message = str(error)
    except also:
        return None
    named = names[:1] if any(value is other for other in KINDS) else (*names, "body '")
    assert any(name in message for name in named), f"{names[0]}: {kind}: {message}"
    assert len(message) < 500, message
    return None
