"""Scenes as text files: those of the paper, and yours."""

from springgym.scenes.plan import Plan
from springgym.scenes.reading import load, names

__all__ = ["Plan", "load", "names"]
