"""Compiled code: values of many copies at once, vectors of them, and compilation with a disk cache.

Only this package depends on Numba's internals. User-defined forces, surfaces and methods import from here:
`compiled` makes a function part of the step; `row`, `vector` and `vec` return vectors, on which `+`, `-`, `*`
and `dot` act as on paper; and `select` chooses a value for each copy.
"""

from springgym.core.compiler.decorators import compiled
from springgym.core.language.lanes import any_lane, maximum, minimum, select, sqrt
from springgym.core.language.memory import load, store
from springgym.core.language.vectors import add_row, cross, dot, plus_scaled, row, set_row, unit, vec, vector

__all__ = [
    "add_row",
    "any_lane",
    "compiled",
    "cross",
    "dot",
    "load",
    "maximum",
    "minimum",
    "plus_scaled",
    "row",
    "select",
    "set_row",
    "sqrt",
    "store",
    "unit",
    "vec",
    "vector",
]
