"""Imports run downwards only, and `import springgym` stays light."""

from __future__ import annotations

import logging.config
import subprocess
import sys

import pytest
from importlinter.cli import lint_imports


def test_layers(monkeypatch: pytest.MonkeyPatch) -> None:
    """The contracts of pyproject.toml, [tool.importlinter]."""
    # it would silence all loggers that there are, for the tests that follow in this process
    monkeypatch.setattr(logging.config, "dictConfig", lambda settings: None)
    assert lint_imports(no_cache=True) == 0


def loaded_by(statement: str) -> set[str]:
    code = f"{statement}; import sys; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return set(run.stdout.split())


def test_import_is_light() -> None:
    heavy = {"torch", "stable_baselines3", "pygame", "matplotlib", "scipy", "numba", "yaml", "imageio"}
    assert not heavy & loaded_by("import springgym")
    made = loaded_by("import springgym, gymnasium; gymnasium.make('SpringTop-v0')")
    assert "numba" in made
    numbas_own = loaded_by("import numba")  # SciPy and YAML, where they are installed
    assert not heavy & (made - numbas_own)
