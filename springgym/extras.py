"""Packages that only some commands need: which extra holds them, and how one installs it."""

from __future__ import annotations

from pathlib import Path

SOURCE = Path(__file__).resolve().parent.parent


def install(extra: str) -> str:
    """The command that installs an extra; in a clone, that of the clone, from whatever folder it is given."""
    if (SOURCE / "pyproject.toml").is_file():
        return f'pip install -e "{SOURCE}[{extra}]"'
    return f'pip install "springgym[{extra}]"'


def missing(purpose: str, package: str, extra: str) -> str:
    """The message of an ImportError: who needs which package, and how one installs it."""
    return f"{purpose} needs {package}: {install(extra)}"
