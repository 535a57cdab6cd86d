"""User-defined forces: a named tuple with the parameters of a force, and two compiled functions.

For example::

    class Tether(NamedTuple):
        particle: int
        anchor: np.ndarray
        stiffness: float

        @staticmethod
        @compiled
        def add(x, force, tether):          # add the forces [N] that follow from the positions
            ...

        @staticmethod
        @compiled
        def energy(x, tether):              # their energy [J]
            ...

A scene takes any number of forces. It copies their arrays, and the copies are read-only. Fields named
``particle`` or ``particles`` must hold particles of the body. Forces act at the same times as the springs,
so a method keeps its order and its conservation laws. Their energy is counted with that of the springs.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numba import NumbaError, types
from numba.extending import overload

from springgym.checks import LARGEST_WHOLE, array, number, shown, whole, whole_array
from springgym.core.compiler.decorators import OPTIONS, is_inner
from springgym.core.language.kinds import Number, Rows
from springgym.core.language.lanes import Lanes
from springgym.core.language.memory import load
from springgym.core.language.vec import Vec
from springgym.model.records import read_only

MOST_FORCES = 20
"""Largest number of forces of a body: each is compiled into the kernel."""

FUNCTIONS = {"add": ("x", "force", "own"), "energy": ("x", "own")}
"""The functions that a force must have, and their parameters."""

RETURNED = {"add": "nothing: it adds to force", "energy": "a number, the energy [J]"}
"""What these functions must return."""

Force: TypeAlias = Any
"""A user's named tuple, with the functions `FUNCTIONS`."""


class OfBody(NamedTuple):
    """A user-defined force, and the body on which it acts."""

    body: int
    """index of the body"""
    force: Force


Forces: TypeAlias = tuple[OfBody, ...]
"""The user-defined forces of a scene."""


def checked_forces(name: str, given: object, count: int) -> tuple[Force, ...]:
    """Return the forces of a body of ``count`` particles with read-only copies of their arrays.

    The arrays become float64 or int64. Fields named ``particle`` or ``particles`` must hold particles of the
    body. All other fields must hold numbers, see `springgym.checks`.

    Raises
    ------
    TypeError, ValueError
        If a force is not a named tuple, lacks a function, has one with other parameters, or holds something
        that is not a number, or a particle that does not exist; the message names it.
    """
    if not isinstance(given, (tuple, list)) or hasattr(given, "_fields"):
        raise TypeError(f"{name} is {shown(given)}; it must be a tuple of forces")
    if len(given) > MOST_FORCES:
        raise ValueError(f"{name} has {len(given)} entries, too many: at most {MOST_FORCES}")
    return tuple(_checked(f"{name}[{n}]", force, count) for n, force in enumerate(given))


def _checked(name: str, force: object, count: int) -> Force:
    if not isinstance(force, tuple) or not hasattr(force, "_fields"):
        raise TypeError(f"{name} is {shown(force)}; it must be a named tuple, see springgym.model.own_forces")
    kind: Any = type(force)
    check_functions(name, kind, FUNCTIONS)
    return kind._make(
        _particles(f"{name}.{field}", value, count)
        if field in ("particle", "particles")
        else _value(f"{name}.{field}", value)
        for field, value in zip(kind._fields, force, strict=True)
    )


def check_functions(name: str, kind: type, functions: Mapping[str, tuple[str, ...]]) -> None:
    """Raise TypeError if a user's named tuple lacks a compiled function, or one has other parameters.

    Raises
    ------
    TypeError
        The message names the function and the form that it must have.
    """
    for function, takes in functions.items():
        form = f"{function}({', '.join(takes)})"
        given = getattr(kind, function, None)
        if not is_inner(given):
            raise TypeError(
                f"{name} is a {kind.__name__}, which has no compiled function {form}; it must be a "
                "staticmethod, decorated with springgym.core.compiled"
            )
        signature = inspect.signature(given.py_func)
        try:
            signature.bind(*takes)
        except TypeError:
            found = ", ".join(signature.parameters)
            raise TypeError(
                f"{name} is a {kind.__name__}, whose function is {function}({found}); it must be {form}"
            ) from None


def _particles(name: str, value: object, count: int) -> int | np.ndarray:
    """Return a particle as an int, or several as an array of int64."""
    if isinstance(value, (np.ndarray, list, tuple)):
        return read_only(whole_array(name, value, (None,), high=count - 1))
    return whole(name, value, high=count - 1)


def _value(name: str, value: object) -> bool | int | float | np.ndarray:
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return whole(name, value, low=-LARGEST_WHOLE)
    if not isinstance(value, np.ndarray):
        return number(name, value)
    if value.dtype.kind in "iu":
        return read_only(whole_array(name, value, value.shape, low=-LARGEST_WHOLE))
    return read_only(array(name, value, value.shape))


def to_compiled(force: Force) -> Force:
    """Copy a checked force, with C-contiguous arrays, for compiled functions."""
    return force._make(value.copy() if isinstance(value, np.ndarray) else value for value in force)


def _typed(force: types.NamedTuple, function: str, *arguments: types.Type) -> Callable[..., Any]:
    """Compile a function of a force for arguments of the given types, and return it.

    ``force`` is the type of the force, which is the last argument.

    Raises
    ------
    TypeError
        If a function does not compile, or returns the wrong thing; the message names force and function.
    """
    of = f"{function} of the force {force.instance_class.__qualname__}"
    given = getattr(force.instance_class, function)
    try:
        taken = given.get_call_template((*arguments, force), {})[2]
    except NumbaError as error:
        raise TypeError(f"{of} does not compile: {reason_of(error)}") from None
    found = given.overloads[tuple(taken)].signature.return_type
    wanted = types.NoneType if function == "add" else (Lanes, types.Float, types.Integer)
    if not isinstance(found, wanted):
        said: Any = f"{len(found)} values" if isinstance(found, types.BaseTuple) else found
        said = "a vector" if isinstance(found, Vec) else "nothing" if found == types.none else said
        raise TypeError(f"{of} returns {said}; it must return {RETURNED[function]}")
    return given


def reason_of(error: NumbaError) -> str:
    """Return one line of Numba's error that says why a function does not compile."""
    lines = [line.strip() for line in str(error).splitlines()]
    told = [line for line in lines if line and not line.startswith("Failed in nopython mode")]
    reason = told[0] if told else type(error).__name__
    if reason.endswith(":") and len(told) > 1:
        reason = f"{reason} {told[1].removeprefix('>>> ')}"
    if "bool(Mask(" in reason:
        reason = "`if`, `and`, `or` or `not` tests a number that differs between copies; use select"
    where = getattr(error, "loc", None)
    return reason if where is None else f"{reason} ({where.filename}, line {where.line})"


def add_own_forces(x: Rows, force: Rows, own: Forces | None, body: int) -> None:
    """Add the user-defined forces [N] on a body to ``force`` (N, 3); Numba compiles the overload."""


@overload(add_own_forces, jit_options={**OPTIONS, "forceinline": True})
def _add_own_forces(x: Rows, force: Rows, own: Forces, body: int) -> Callable[..., None]:
    # The annotations are those of the returned functions, as Numba compares them.
    if not isinstance(own, types.BaseTuple) or not len(own):

        def add_none(x: Rows, force: Rows, own: Forces, body: int) -> None:
            pass

        return add_none
    add = _typed(own[0][1], "add", x, force)

    def add_first_and_others(x: Rows, force: Rows, own: Forces, body: int) -> None:
        if own[0].body == body:
            add(x, force, own[0].force)
        add_own_forces(x, force, own[1:], body)

    return add_first_and_others


def own_energy(x: Rows, own: Forces | None, body: int) -> Number:
    """Return the energy [J] of the user-defined forces on a body; Numba compiles the overload."""


@overload(own_energy, jit_options={**OPTIONS, "forceinline": True})
def _own_energy(x: Rows, own: Forces, body: int) -> Callable[..., Number]:
    if not isinstance(own, types.BaseTuple) or not len(own):

        def no_energy(x: Rows, own: Forces, body: int) -> Number:
            return 0.0 * load(x, (0, 0))

        return no_energy
    energy = _typed(own[0][1], "energy", x)

    def energy_of_first_and_others(x: Rows, own: Forces, body: int) -> Number:
        total = own_energy(x, own[1:], body)
        if own[0].body == body:
            total = total + energy(x, own[0].force)
        return total

    return energy_of_first_and_others
