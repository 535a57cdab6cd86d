"""Identities and checksums, for refusing states of other objects, and states that were edited."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from springgym.checks import shown


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
    for name in [*own, *(name for name in theirs if name not in own)]:
        if name not in but and not _equal(given := theirs.get(name), here := own.get(name)):
            raise ValueError(
                f"{what} does not match: its {name} is {shown(given)}, here it is {shown(here)}{must}"
            )


def sealed(state: Mapping[str, Any]) -> dict[str, Any]:
    """Return a state with checksums of its entries, by which `check_sealed` detects edits."""
    return {**state, "checksums": _checksums(state)}


def check_sealed(state: Mapping[str, Any]) -> None:
    """Raise ValueError if a state was edited since it was `sealed`.

    Raises
    ------
    ValueError
        The message names the first entry that differs.
    """
    given = state["checksums"]
    for name, checksum in _checksums(state).items():
        if not isinstance(given, Mapping) or given.get(name) != checksum:
            raise ValueError(f"state[{name!r}] was edited; a state can only be set as it was taken")


def _checksums(state: Mapping[str, Any]) -> dict[str, str]:
    """Return a digest of each entry, or of its checksums; identities are left to `check_same`."""
    return {
        name: digest(value.get("checksums", value) if isinstance(value, Mapping) else value)
        for name, value in state.items()
        if name not in ("of", "checksums")
    }


def _equal(one: object, other: object) -> bool:
    """Return whether two values are equal; False for values that cannot be compared."""
    try:
        return bool(one == other)
    except Exception:  # a foreign class may raise any error
        return False
