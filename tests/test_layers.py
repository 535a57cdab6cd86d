"""Imports run downwards only."""

from __future__ import annotations

import logging.config

import pytest
from importlinter.cli import lint_imports


def test_layers(monkeypatch: pytest.MonkeyPatch) -> None:
    """The contracts of pyproject.toml, [tool.importlinter]."""
    # it would silence all loggers that there are, for the tests that follow in this process
    monkeypatch.setattr(logging.config, "dictConfig", lambda settings: None)
    assert lint_imports(no_cache=True) == 0
