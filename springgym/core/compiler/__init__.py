"""Compilation of functions that extend Numba, and the cache of compiled code."""
