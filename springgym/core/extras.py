"""Extras with packages that only some commands need: how to install them."""

from __future__ import annotations

from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]


def install(extra: str) -> str:
    """Return the shell command that installs an extra, from the clone if the package runs from one."""
    if (SOURCE / "pyproject.toml").is_file():
        return f'pip install -e "{SOURCE}[{extra}]"'
    return f'pip install "springgym[{extra}]"'


def missing(purpose: str, package: str, extra: str) -> str:
    """Return the message of an ImportError: what needs which package, and how to install it."""
    return f"{purpose} needs {package}: {install(extra)}"
