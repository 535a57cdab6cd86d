"""Parameters of tests of which some run always, and the others in slow runs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def slow_unless(usual: bool) -> Any:
    """Return the marks of a parameter of a test that every run takes, or only slow ones."""
    return () if usual else pytest.mark.slow


def slow_but(values: Iterable[Any], *usual: Any) -> list[Any]:
    """Return parameters of a test, of which every run takes the ``usual`` ones, and slow runs all others.

    A tuple holds the values of several arguments.
    """
    values = list(values)
    assert all(value in values for value in usual), usual
    return [
        pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=slow_unless(value in usual))
        for value in values
    ]
