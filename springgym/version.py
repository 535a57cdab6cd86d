"""The version of springgym."""

__version__ = "0.2.0"
