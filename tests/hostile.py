"""Calls of public functions with one wrong argument at a time.

A `Call` is a function with right arguments. `complaints` replaces each argument by each value of `HOSTILE`
and, if it is a number or an array, by each of `spoiled`. The call must be refused by a TypeError or
ValueError that names the argument, unless `Call.takes` lists the value for this argument.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np


class Strange:
    """An object that is no number, no array and no text."""

    def __repr__(self) -> str:
        return "Strange()"


HOSTILE: dict[str, Any] = {
    "None": None,
    "True": True,
    "text": "x",
    "empty": "",
    "bytes": b"1",
    "1j": 1j,
    "strange": Strange(),
    "nan": math.nan,
    "inf": math.inf,
    "-inf": -math.inf,
    "-1": -1,
    "-0.5": -0.5,
    "0": 0,
    "2.5": 2.5,
    "1e40": 1e40,
    "10**400": 10**400,
    "10**9": 10**9,
    "()": (),
    "[]": [],
    "{}": {},
    "[[1], [2, 3]]": [[1], [2, 3]],
    "[text]": ["x"],
    "[None]": [None],
    "two": np.ones(2),
    "three": np.ones(3),
    "function": len,
    "class": int,
}
"""Values by name."""

NUMBERS = ["True", "1j", "nan", "inf", "-inf", "-1", "-0.5", "0", "2.5", "1e40", "10**400", "10**9"]
"""Names of the values that a number could be mistaken for, of which some are right for some numbers."""


def spoiled(right: Any) -> Iterator[tuple[str, Any]]:
    """Yield copies of a number or an array of numbers that are wrong, by name."""
    if isinstance(right, (bool, str)) or right is None:
        return
    try:
        given = np.asarray(right)
    except ValueError:
        return
    if given.dtype.kind not in "iuf" or not given.size:
        return
    mask = np.zeros(given.shape, bool)
    mask.flat[-1] = True
    yield "masked", np.ma.MaskedArray(given, mask)
    yield "as complex numbers", given + 0j
    yield "as text", given.astype(str)
    yield "as objects", np.full(given.shape, Strange(), object)
    yield "as bools", given.astype(bool)
    for bad in (math.nan, math.inf, -math.inf, 1e40):
        held = given.astype(float)
        held.flat[-1] = bad
        yield f"{bad} inside", held[()]
    if given.ndim:
        yield "masked in a list", [*given[:-1], np.ma.MaskedArray(given[-1], np.ones_like(given[-1], bool))]
        yield "one axis more", given[None]
        yield "one row more", np.concatenate([given, given[-1:]])
        yield "one row fewer", given[:-1]


@dataclass(frozen=True)
class Call:
    """A function and arguments that are right."""

    function: Callable[..., Any]
    right: Mapping[str, Any]
    takes: Mapping[str, str] = field(default_factory=dict)
    """names of values, separated by "; ", that an argument may have, too"""
    called: Mapping[str, str] = field(default_factory=dict)
    """patterns of the names of arguments in messages, if they differ"""
    beyond: str = ""
    """pattern of the message of a call whose arguments are all right, but which must not go on"""
    positional: tuple[str, ...] = ()
    """arguments that are passed by position, or several if their name begins with *"""

    @property
    def name(self) -> str:
        return getattr(self.function, "__qualname__", type(self.function).__qualname__)

    def __call__(self, **changed: Any) -> Any:
        given = {**self.right, **changed}
        first = [given.pop(name) for name in self.positional]
        return self.function(*first, **given)


def values(right: Any) -> Iterator[tuple[str, Any]]:
    """Yield all wrong values in place of a right one, by name."""
    yield from HOSTILE.items()
    yield from spoiled(right)


def outcome(call: Call, argument: str, value: Any) -> str:
    """Return what a call makes of a value: "refused", "accepted", or a description of a foreign error."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            call(**{argument: value})
    except Exception as error:
        message = str(error)
        name = call.called.get(argument, argument)
        if call.beyond and re.search(call.beyond, message):
            return "accepted"
        named = re.search(rf"(?<![A-Za-z_])({name})(?![A-Za-z])", message)
        right = isinstance(error, (TypeError, ValueError)) and named and len(message) <= 1500
        return "refused" if right else f"{type(error).__name__}: {message}"
    return "accepted"


def complaints(call: Call) -> Iterator[str]:
    """Yield what is wrong: values that are taken or refused against `Call.takes`, and foreign errors."""
    assert not set(call.takes) - set(call.right), f"{call.name}: takes names no argument"
    for argument, right in call.right.items():
        taken = set(call.takes.get(argument, "").split("; ")) - {""}
        seen = set()
        for name, value in values(right):
            found = outcome(call, argument, value)
            if found == "accepted":
                seen.add(name)
            elif found != "refused":
                yield f"{call.name}({argument}={name}): {found[:200]}"
        yield from (f"{call.name}({argument}={name}): accepted" for name in sorted(seen - taken))
        yield from (f"{call.name}({argument}={name}): not accepted" for name in sorted(taken - seen))
