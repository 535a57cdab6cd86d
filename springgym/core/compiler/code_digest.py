"""A digest of what a compiled function is compiled from: its code, and all that this code names.

Numba compiles in module constants, closure variables, default arguments, and all functions that are called,
directly or indirectly. `digest` walks through all of it as it is in memory. Comments, docstrings, the order
of definitions and functions that nobody calls are not part of it.

Objects of Python, NumPy or Numba enter by name only, so a key needs the versions of these packages, too. A
module that extends Numba (by `numba.extending`) enters as a whole: the code that it affects does not refer to
it.
"""

from __future__ import annotations

import builtins
import enum
import hashlib
import os
import sys
import time
import types
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import extending
from numba.extending import is_jitted

from springgym.core.compiler.numba_private import definition

IMPORTED = time.time_ns()
"""Time at which this module was imported [ns]: before all others that hold compiled functions."""

KNOWN = frozenset({"numpy", "numba", "llvmlite", "builtins", *sys.stdlib_module_names} - {"__main__"})
"""Packages whose contents follow from a name and their versions."""

EXTENDING = [
    value
    for name, value in vars(extending).items()
    if name.startswith(("lower_", "overload", "register_model", "typeof_impl"))
    or name in ("box", "unbox", "type_callable", "make_attribute_wrapper")
]
"""Functions of `numba.extending` that affect how code is compiled which does not name them."""

OF_EVERY_CLASS = frozenset(
    (
        "__dict__",
        "__weakref__",
        "__doc__",
        "__module__",
        "__annotations__",
        "__annotate__",
        "__annotate_func__",
        "__annotations_cache__",
        "__firstlineno__",
        "__static_attributes__",
        "__orig_bases__",
        "__parameters__",
        "__abstractmethods__",
        "_abc_impl",
    )
)
"""Attributes of a class that no compiled code depends on."""


class NotHashable(TypeError):
    """Raised where a function is compiled from something that has no digest."""


def digest(function: Callable[..., Any], arguments: object = (), by_source: Iterable[str] = ()) -> bytes:
    """Compute a digest of all that a function is compiled from, the same in every process.

    Parameters
    ----------
    function
        What is compiled: a plain function, not what Numba made of it.
    arguments
        Numba's types of its arguments; the code of functions and named tuples among them enters, too.
    by_source
        Names of modules that enter by their source alone, whether the function leads to them or not.

    Raises
    ------
    NotHashable
        If it is compiled from something that has no digest, such as a function written in C; or if a constant
        that a function names has changed since an earlier digest, and may be compiled in.
    """
    by_source = sorted(by_source)
    walk = _Walk(frozenset(by_source))
    walk.value(function)
    walk.of_types(arguments)
    for name in by_source:
        walk.module(name)
    return walk.sum.digest()


class _Walk:
    """Feeds values to a hash; an object that it meets again is fed as the number of its first visit."""

    def __init__(self, by_source: frozenset[str]) -> None:
        self.sum = hashlib.sha256()
        self.by_source = by_source
        self.met: dict[int, tuple[int, object]] = {}  # holds the objects, so that no other gets their id
        self.modules: set[str] = set()

    def text(self, *parts: object) -> None:
        """Feed values whose `repr` is the same in every process."""
        self.sum.update(repr(parts).encode())

    def of_types(self, kind: object) -> None:
        """Feed the types of arguments, and the code of functions and named tuples among them."""
        if isinstance(kind, (tuple, list, numba.types.BaseTuple)):
            self.text("types", type(kind).__name__, len(kind))
            if hasattr(kind, "instance_class"):
                self.value(kind.instance_class)
            for one in kind:
                self.of_types(one)
        elif isinstance(kind, numba.types.Dispatcher):
            self.value(kind.dispatcher)
        else:
            self.text(str(kind))

    def value(self, value: Any) -> None:
        """Feed any value that Numba may compile in.

        Raises
        ------
        NotHashable
        """
        plain = _plain(value)
        if plain is not None:
            self.text(*plain)
            return
        if id(value) in self.met:
            self.text("met", self.met[id(value)][0])
            return
        self.met[id(value)] = len(self.met), value
        if isinstance(value, tuple):
            self.text("tuple", len(value))
            if type(value) is not tuple:
                self.value(type(value))
            for item in value:
                self.value(item)
        elif isinstance(value, (list, dict, set, frozenset)):
            self.collection(value)
        elif is_jitted(value):
            self.text("compiled", *sorted(map(str, value.targetoptions.items())))
            self.function(value.py_func)
        elif isinstance(value, types.FunctionType):
            self.function(value)
        elif isinstance(value, (staticmethod, classmethod, types.MethodType)):
            self.text(type(value).__name__)
            self.value(value.__func__)
        elif isinstance(value, property):
            self.text("property")
            self.value(value.fget)
        elif isinstance(value, types.ModuleType):
            self.text("module", value.__name__)
        elif isinstance(value, type):
            self.a_class(value)
        elif (made_by := definition(value)) is not None:
            self.text("intrinsic")
            self.value(made_by)
        elif hasattr(value, "__wrapped__"):  # by functools.cache and its like
            self.text("wrapped", type(value).__qualname__)
            self.value(value.__wrapped__)
        else:
            raise NotHashable(f"{value!r} has no digest")

    def collection(
        self, values: list[object] | dict[object, object] | set[object] | frozenset[object]
    ) -> None:
        """Feed a list, a dictionary or a set."""
        self.text(type(values).__name__, len(values))
        if isinstance(values, (set, frozenset)):
            for one in sorted(values, key=repr):
                self.value(one)
            return
        for one in values.items() if isinstance(values, dict) else values:
            self.value(one)

    def a_class(self, kind: type) -> None:
        """Feed a class: its bases and what it defines."""
        self.text("class", kind.__module__, kind.__qualname__)
        self.module(kind.__module__)
        if kind.__module__ in self.by_source:
            return
        own = {name: value for name, value in vars(kind).items() if name not in OF_EVERY_CLASS}
        if issubclass(kind, tuple) and hasattr(kind, "_fields"):
            self.value((kind._fields, tuple(vars(kind)["_field_defaults"].items())))
            made = set(kind._fields)  # by NamedTuple, as is all that begins with an underscore
            own = {name: value for name, value in own.items() if name[0] != "_" and name not in made}
        if issubclass(kind, enum.Enum):  # Numba compiles in its members; the rest is made by Python
            self.value(tuple(kind.__members__.items()))
            own = {}
        for base in kind.__bases__:
            self.value(base)
        for name in sorted(own):
            self.text(name)
            self.value(own[name])

    def function(self, function: types.FunctionType) -> None:
        """Feed a function: its code, its default arguments and all that it names."""
        self.text("function", function.__module__, function.__qualname__)
        self.module(function.__module__)
        if function.__module__ in self.by_source:
            return
        self.code(function.__code__)
        self.value((function.__defaults__, tuple(sorted((function.__kwdefaults__ or {}).items()))))
        named = dict(_bound(function))
        names = _names(function.__code__)
        scope = function.__globals__
        named.update((name, scope[name]) for name in sorted(names) if name in scope and name not in named)
        self.unchanged(function, named)
        for name, value in named.items():
            self.text(name)
            self.value(value)
            if isinstance(value, types.ModuleType):
                self.attributes(value, names)

    def unchanged(self, function: types.FunctionType, named: dict[str, object]) -> None:
        """Raise `NotHashable` if a function may have been compiled with other values of its constants."""
        for name, value in named.items():
            now = _plain(value)
            if now is not None and _EARLIER.setdefault((function, name), now) != now:
                raise NotHashable(f"{name}, which {function.__qualname__} names, has changed")

    def attributes(self, module: types.ModuleType, names: Iterable[str]) -> None:
        """Feed the attributes ``names`` of a module, unless the module is `KNOWN`."""
        if _known(module.__name__):
            return
        self.module(module.__name__)
        for name in sorted(names):
            if hasattr(module, name):
                self.text(name)
                value = getattr(module, name)
                self.value(value)
                if isinstance(value, types.ModuleType) and value is not module:
                    self.attributes(value, names)

    def code(self, code: types.CodeType) -> None:
        """Feed code, without line numbers and docstrings."""
        told = {"co_argcount", "co_kwonlyargcount", "co_posonlyargcount", "co_flags", "co_code", "co_names"}
        told |= {"co_varnames", "co_freevars", "co_cellvars", "co_exceptiontable"}
        self.text(*(getattr(code, name, None) for name in sorted(told)))
        for n, constant in enumerate(code.co_consts):
            if isinstance(constant, types.CodeType):
                self.code(constant)
            elif n or not isinstance(constant, str):  # a string that comes first is the docstring
                self.value(constant)

    def module(self, name: str) -> None:
        """Feed all of a module that extends Numba, or the source of one that is in ``by_source``."""
        if name in self.modules or _known(name):
            return
        self.modules.add(name)
        module = sys.modules.get(name)
        if module is None:
            return
        if name in self.by_source:
            self.code(_source(name))
            return
        if not _teaches(module):
            return
        code = _source(name)
        self.code(code)
        names = _names(code)
        for key, value in sorted(vars(module).items()):
            if key in names and not key.startswith("__"):
                self.text(key)
                try:
                    self.value(value)
                except NotHashable:  # made by this code, from what was fed
                    self.text("made")


_EARLIER: dict[tuple[types.FunctionType, str], tuple[object, ...]] = {}
"""Constants as a function's first digest found them."""


def _known(module: str) -> bool:
    return module.partition(".")[0] in KNOWN


def _plain(value: object) -> tuple[object, ...] | None:
    """Return the full content of a value that refers to no other values; None if it refers to some."""
    if isinstance(value, enum.Enum):
        return type(value).__qualname__, value.name, repr(value.value)
    if value is None or value is ... or type(value) in (bool, int, float, complex, str, bytes):
        return type(value).__name__, repr(value)
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise NotHashable(f"an array of {value.dtype} has no digest")
        return "array", repr(value.dtype), value.shape, value.strides, value.tobytes()
    if isinstance(value, np.generic):
        return "number", repr(value.dtype), value.tobytes()
    if isinstance(value, (np.dtype, numba.types.Type)):
        return type(value).__name__, str(value)
    if isinstance(value, np.ufunc):
        return "ufunc", value.__name__
    if isinstance(value, types.BuiltinFunctionType) and not _known(value.__module__ or "builtins"):
        raise NotHashable(f"{value!r} is written in C")
    if isinstance(value, types.ModuleType):
        return ("module", value.__name__) if _known(value.__name__) else None
    home = getattr(value, "__module__", None)
    name = getattr(value, "__qualname__", None)
    if isinstance(home, str) and _known(home) and isinstance(name, str) and not is_jitted(value):
        return "known", home, name
    if _known(type(value).__module__) and type(value).__module__ in ("typing", "types"):
        return ("typing", repr(value)) if not isinstance(value, types.FunctionType) else None
    return None


def _bound(function: types.FunctionType) -> Iterable[tuple[str, object]]:
    """Yield the names and values that a closure binds; cells that are still empty are left out."""
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            yield name, cell.cell_contents
        except ValueError:
            continue


def _names(code: types.CodeType) -> set[str]:
    """Return all names in code: those of globals and of attributes."""
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            names |= _names(constant)
    return names - vars(builtins).keys()


def _teaches(module: types.ModuleType) -> bool:
    """Return whether a module uses one of `EXTENDING`, imported by name or as ``numba.extending``."""
    values = list(vars(module).values())
    if any(value is one for value in values for one in (*EXTENDING, extending)):
        return True
    return any(value is numba for value in values) and "extending" in _names(_source(module.__name__))


@cache
def _source(name: str) -> types.CodeType:
    """Compile the source of a module without docstrings, and return the code.

    Raises
    ------
    NotHashable
        If it has no source file, or a file that is newer than the import.
    """
    path = getattr(sys.modules[name], "__file__", None)
    try:
        if path is None or os.stat(path).st_mtime_ns > IMPORTED:
            raise NotHashable(f"{name} is not, or no longer, what {path} says")
        return compile(Path(path).read_bytes(), "", "exec", dont_inherit=True, optimize=2)
    except (OSError, SyntaxError, ValueError) as error:  # it is in an archive, or was removed since
        raise NotHashable(f"{name} has no source ({error})") from error
