"""Records whose arrays nobody can write to."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def read_only(value: ArrayLike) -> np.ndarray:
    """A copy of an array that nobody can write to."""
    kept = np.array(value)
    kept.setflags(write=False)
    return kept


def _protect(value: object) -> None:
    """Make arrays read-only, in nested tuples too."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, tuple):
        for part in value:
            _protect(part)


class ReadOnly:
    """Base of frozen dataclasses that hold arrays: no array of theirs can be written to, nor one of a copy.

    NumPy forgets that an array is read-only when it is pickled or copied deeply, so it is said again.
    """

    def keep(self, name: str, value: ArrayLike) -> None:
        """Set a field to a read-only copy of an array, while the record is made."""
        object.__setattr__(self, name, read_only(value))

    def __setstate__(self, state: dict[str, object]) -> None:
        for value in state.values():
            _protect(value)
        self.__dict__.update(state)
