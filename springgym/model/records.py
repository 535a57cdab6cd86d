"""Records with read-only arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def read_only(value: ArrayLike) -> np.ndarray:
    """Return a read-only copy of an array."""
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
    """Base of frozen dataclasses with arrays. The arrays are read-only, also in copies.

    NumPy does not keep this flag in pickles and deep copies, so it is set again.
    """

    def keep(self, name: str, value: ArrayLike) -> None:
        """Set a field to a read-only copy of an array. Call this only during construction."""
        object.__setattr__(self, name, read_only(value))

    def __setstate__(self, state: dict[str, object]) -> None:
        for value in state.values():
            _protect(value)
        self.__dict__.update(state)
