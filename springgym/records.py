"""Records whose arrays nobody can write to."""

from __future__ import annotations

from typing import Any

import numpy as np


class ReadOnly:
    """Base of frozen dataclasses that hold arrays: no array of theirs can be written to, nor one of a copy.

    NumPy forgets that an array is read-only when it is pickled or copied deeply, so it is said again.
    """

    def keep(self, name: str, value: Any) -> None:
        """Set a field to a read-only copy of an array, while the record is made."""
        kept = np.array(value)
        kept.setflags(write=False)
        object.__setattr__(self, name, kept)

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        self.__dict__.update(state)
