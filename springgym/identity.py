"""What a thing was made of, in plain data by name: whether a state is one of it, and what differs if not."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from springgym.checks import shown


def digest(value: Any) -> str:
    """Arrays, numbers and texts, however nested in tuples, as a short text: others have another."""
    found = hashlib.sha256()

    def add(value: Any) -> None:
        if isinstance(value, np.ndarray):
            found.update(f"{value.dtype} {value.shape} ".encode() + value.tobytes())
        elif isinstance(value, tuple):
            found.update(f"{type(value).__module__}.{type(value).__qualname__} {len(value)} ".encode())
            for part in value:
                add(part)
        else:
            found.update(f"{value!r} ".encode())

    add(value)
    return f"#{found.hexdigest()[:12]}"


def check_same(
    what: str, theirs: Any, own: Mapping[str, Any], but: Collection[str] = (), must: str = ""
) -> None:
    """Refuse what something else is made of, naming the first thing that differs.

    Parameters
    ----------
    what
        What errors call it.
    theirs, own
        What the other and what one's own is made of, by name.
    but
        Names of what may differ.
    must
        What errors add.

    Raises
    ------
    ValueError
        If they differ, or the other is no mapping.
    """
    if not isinstance(theirs, Mapping):
        raise ValueError(f"{what} does not say what it belongs to: its 'of' is {shown(theirs)}")
    for name in [*own, *(name for name in theirs if name not in own)]:
        if name not in but and not _equal(given := theirs.get(name), here := own.get(name)):
            raise ValueError(
                f"{what} is another one: its {name} is {shown(given)}, here it is {shown(here)}{must}"
            )


def _equal(one: Any, other: Any) -> bool:
    """Whether plain data are the same; what is none is not."""
    try:
        return bool(one == other)
    except Exception:  # whatever a foreign class raises
        return False
