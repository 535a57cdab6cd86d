"""Identities, for refusing states of other objects, and checks of what states hold."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from springgym.checks import instance, shown, sum_of_squares


def digest(value: object) -> str:
    """Return a short digest of arrays, numbers and strings, nested in tuples, lists and mappings."""
    found = hashlib.sha256()

    def add(value: object) -> None:
        if isinstance(value, np.ndarray):
            found.update(f"{value.dtype.str} {value.shape} ".encode() + value.tobytes())
        elif isinstance(value, (str, int, float)):
            found.update(f"{value!r} ".encode())
        elif isinstance(value, Mapping):
            add(tuple(value.items()))
        elif isinstance(value, (tuple, list)):
            found.update(f"{type(value).__module__}.{type(value).__qualname__} {len(value)} ".encode())
            for part in value:
                add(part)
        else:
            found.update(f"{value!r} ".encode())

    add(value)
    return f"#{found.hexdigest()[:12]}"


def check_same(
    what: str, theirs: object, own: Mapping[str, object], but: Collection[str] = (), must: str = ""
) -> None:
    """Compare two identities, and raise an error that names the first difference.

    Parameters
    ----------
    what
        Name in errors.
    theirs, own
        The identity of the other object, and the own one.
    but
        Names of data that may differ.
    must
        Text that errors add.

    Raises
    ------
    ValueError
        If they differ, or the other is not a mapping.
    """
    if not isinstance(theirs, Mapping):
        raise ValueError(f"{what} does not say what it belongs to: its 'of' is {shown(theirs)}")
    if _equal(theirs, own):
        return
    for name in [*own, *(name for name in theirs if name not in own)]:
        if name not in but and not _equal(given := theirs.get(name), here := own.get(name)):
            raise ValueError(
                f"{what} does not match: its {name} is {shown(given)}, here it is {shown(here)}{must}"
            )


def check_keys(name: str, state: object, keys: Collection[str]) -> None:
    """Raise an error if a state, or a part of one, is not a mapping with exactly these keys.

    Raises
    ------
    TypeError
        If it is no mapping.
    ValueError
        If a key is missing, or there is one too many; the message names it.
    """
    given = instance(name, state, Mapping).keys()
    if given != set(keys):
        wrong = sorted(map(str, given ^ set(keys)))[0]
        has = "holds" if wrong in given else "lacks"
        raise ValueError(f"{name} {has} {wrong!r}; it must hold {', '.join(keys)}")


def check_array(
    name: str, value: object, shape: tuple[int, ...], dtype: np.dtype[Any], finite: bool = False
) -> None:
    """Raise an error if an entry of a state is not an array of a shape and a dtype, of finite numbers if so
    said.

    Raises
    ------
    TypeError
        If it is no array.
    ValueError
        If its shape or dtype is another, or a number is not finite.
    """
    if value.__class__ is not np.ndarray:
        raise TypeError(f"state[{name!r}] is {shown(value)}; it must be an array")
    array: Any = value
    if array.shape != shape or array.dtype != dtype:
        raise ValueError(
            f"state[{name!r}] is an array of {array.dtype} of shape {array.shape}; "
            f"it must be one of {dtype} of shape {shape}"
        )
    if finite:
        numbers = array["lanes"] if dtype.names else array
        if not math.isfinite(sum_of_squares(numbers)) and not np.isfinite(numbers).all():
            raise ValueError(f"state[{name!r}] holds a number that is not finite")


def _equal(one: object, other: object) -> bool:
    """Return whether two values are equal; False for values that cannot be compared."""
    try:
        return bool(one == other)
    except Exception:  # a foreign class may raise any error
        return False
