"""Rules for the arguments of theory, and a decorator that applies them.

A rule is a function of an argument's name and value. It returns the value, numbers as floats and arrays as
float64, or raises the errors of `springgym.checks`, which name the argument. Rules stand above each function;
what several arguments must fulfil together stands in it.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from springgym.checks import HUGE, TINY, array, instance, number, refuse_unknown, shown, whole, whole_array

Rule = Callable[[str, Any], Any]
Shape = tuple[int | None, ...]
Made = TypeVar("Made", bound=Callable[..., Any])

ROUNDING = 1e-6
"""Largest error of unit vectors, of rotations, and of what must be symmetric, relative to its size."""

ANY: tuple[Shape, ...] = ((), (None,), (None, None), (None, None, None))
"""Shapes S of times and angles, for which a function gives one result each."""

VECTORS: tuple[Shape, ...] = ((3,), (None, 3), (None, None, 3), (None, None, None, 3))
"""Shapes S + (3,)."""

FRAMES: tuple[Shape, ...] = ((3, 3), (None, 3, 3), (None, None, 3, 3), (None, None, None, 3, 3))
"""Shapes S + (3, 3)."""


def checked(**rules: Rule) -> Callable[[Made], Made]:
    """Decorate a function, a dataclass or a named tuple, each argument of which has a rule of its name.

    Signatures do not change. Named tuples are checked by `_make` and `_replace`, too.
    """

    def decorate(made: Made) -> Made:
        cls: Any = made if isinstance(made, type) else None
        is_tuple = cls is not None and issubclass(cls, tuple)
        called: Any = made if cls is None else cls.__new__ if is_tuple else cls.__init__
        signature = inspect.signature(made)
        if list(signature.parameters) != list(rules):
            raise TypeError(f"{made.__name__} has {list(signature.parameters)}, and rules for {list(rules)}")
        own = 0 if cls is None else 1  # the class or the object comes first

        @functools.wraps(called)
        def call(*given: Any, **named: Any) -> Any:
            try:
                bound = signature.bind(*given[own:], **named)
            except TypeError as error:
                refuse_unknown(made.__name__, named, made)
                raise TypeError(f"{made.__name__}: {error}") from None
            for name, value in bound.arguments.items():
                bound.arguments[name] = rules[name](name, value)
            return called(*given[:own], *bound.args, **bound.kwargs)

        if cls is None:
            return call  # type: ignore[return-value]
        if is_tuple:
            cls.__new__ = call
            cls._make = classmethod(lambda kind, values: kind(*values))
        else:
            cls.__init__ = call
        return made

    return decorate


# --- Numbers ----------------------------------------------------------------------------------------


def positive(name: str, value: object) -> float:
    """Return a positive number."""
    return number(name, value, TINY)


def not_negative(name: str, value: object) -> float:
    """Return a number of 0 or more."""
    return number(name, value, 0.0)


def between(low: float, high: float) -> Rule:
    """Return the rule of numbers from ``low`` to ``high``."""
    return functools.partial(number, low=low, high=high)


def inside(low: float, high: float) -> Rule:
    """Return the rule of numbers more than ``low`` and less than ``high``."""

    def rule(name: str, value: object) -> float:
        given = number(name, value)
        if not low < given < high:
            raise ValueError(f"{name} is {shown(value)}; it must be more than {low:g} and less than {high:g}")
        return given

    return rule


def not_zero(name: str, value: object) -> float:
    """Return a number whose size is positive."""
    given = number(name, value)
    if abs(given) < TINY:
        raise ValueError(f"{name} is {shown(value)}; it must not be 0")
    return given


def count(low: int, high: int) -> Rule:
    """Return the rule of whole numbers from ``low`` to ``high``."""
    return functools.partial(whole, low=low, high=high)


# --- Arrays -----------------------------------------------------------------------------------------


def numbers(*shapes: Shape, low: float = -HUGE, high: float = HUGE) -> Rule:
    """Return the rule of arrays of one of some shapes, of numbers from ``low`` to ``high``."""
    return lambda name, value: array(name, value, *shapes, low=low, high=high)


def positives(*shapes: Shape) -> Rule:
    """Return the rule of arrays of one of some shapes, of positive numbers."""
    return numbers(*shapes, low=TINY)


def filled(rule: Rule) -> Rule:
    """Return the rule of arrays that obey another one, and are not empty."""

    def found(name: str, value: object) -> np.ndarray:
        given: np.ndarray = rule(name, value)
        if not given.size:
            raise ValueError(f"{name} is {shown(value)}; it must not be empty")
        return given

    return found


def whole_numbers(*shapes: Shape) -> Rule:
    """Return the rule of arrays of one of some shapes, of whole numbers from 0."""
    return lambda name, value: whole_array(name, value, *shapes)


def units(*shapes: Shape) -> Rule:
    """Return the rule of unit vectors (..., 3)."""

    def rule(name: str, value: object) -> np.ndarray:
        given = array(name, value, *shapes)
        lengths = np.linalg.norm(given, axis=-1)
        wrong = abs(lengths - 1) > ROUNDING
        if wrong.any():
            raise ValueError(
                f"{name} is {shown(value)}, of length {lengths[wrong][0]:.9g}; it must be a unit vector"
            )
        return given

    return rule


def rotations(*shapes: Shape) -> Rule:
    """Return the rule of rotation matrices (..., 3, 3)."""

    def rule(name: str, value: object) -> np.ndarray:
        given = array(name, value, *shapes)
        error = abs(given @ np.swapaxes(given, -1, -2) - np.eye(3)).max(initial=0.0)
        if error > ROUNDING or not (np.linalg.det(given) > 0).all():
            raise ValueError(
                f"{name} is {shown(value)}; it must be a rotation, its columns right-handed axes"
            )
        return given

    return rule


def principal_moments(name: str, value: object) -> np.ndarray:
    """Return principal moments of inertia (3,), none of which is larger than the sum of the others."""
    given = array(name, value, (3,), low=TINY)
    largest = given.max()
    if largest > (given.sum() - largest) * (1 + ROUNDING):
        raise ValueError(
            f"{name} is {shown(value)}; no moment of a body must be larger than the sum of the others"
        )
    return given


def symmetric(name: str, given: np.ndarray) -> np.ndarray:
    """Return a symmetric matrix."""
    if abs(given - given.T).max() > ROUNDING * abs(given).max():
        raise ValueError(f"{name} is {shown(given)}; it must be symmetric")
    return given


def fit(**given: np.ndarray) -> None:
    """Raise ValueError if the shapes of some arrays cannot be broadcast to one."""
    shapes = [values.shape for values in given.values()]
    try:
        np.broadcast_shapes(*shapes)
    except ValueError:
        have = " and ".join(f"{name} has shape {shape}" for name, shape in zip(given, shapes, strict=True))
        raise ValueError(f"{have}; these must fit each other") from None


# --- Others -----------------------------------------------------------------------------------------


def instance_of(kind: type) -> Rule:
    """Return the rule of objects of a class."""
    return lambda name, value: instance(name, value, kind)


def optional(rule: Rule) -> Rule:
    """Return the rule of what obeys another one, or is None."""
    return lambda name, value: None if value is None else rule(name, value)
