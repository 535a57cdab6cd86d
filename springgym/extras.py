"""Packages that only some commands need: which extra holds them, and how one installs it."""

from __future__ import annotations

from pathlib import Path

SOURCE = Path(__file__).resolve().parent.parent


def install(extra: str) -> str:
    """Return the command that installs an extra; in a clone, that of the clone, for any folder."""
    if (SOURCE / "pyproject.toml").is_file():
        return f'pip install -e "{SOURCE}[{extra}]"'
    return f'pip install "springgym[{extra}]"'


def missing(purpose: str, package: str, extra: str) -> str:
    """Return the message of an ImportError: who needs which package, and how to install it."""
    return f"{purpose} needs {package}: {install(extra)}"
