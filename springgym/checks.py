"""Checks of arguments. Each rule is written once, for all public functions.

- A number is an int or a float, finite and at most `HUGE` in size. Bools, strings and None are not numbers.
- A positive number is at least `TINY`: say ``low=TINY``.
- A whole number has an integer type. 2.0 and True are not whole numbers.
- A flag is a bool.
- An array has exactly one of the allowed shapes. Nothing is broadcast.
- An array must not hide values by a mask: NumPy would use what is hidden.
- Readings are measured numbers: they may be NaN or infinite, as after divergence.
- Indices count from 0, and are never negative. A mask, one bool for each thing, stands for the indices of
  what it is True for.

An argument of the wrong type raises TypeError, and a wrong value of the right type raises ValueError. Both
messages name the argument, its value, and what it must be.
"""

from __future__ import annotations

import difflib
import functools
import inspect
import math
import operator
import os
import stat
import unicodedata
from collections.abc import Callable, Collection, Iterable
from numbers import Real
from typing import Any, TypeVar

import numpy as np

TINY = 1e-30
"""Least positive number, in SI units. Products of nine of them, as in the determinant of an inertia tensor,
(m r²)³, are still doubles."""

HUGE = 1e30
"""Largest number, in SI units. Products of nine of them are still doubles."""

LARGEST_WHOLE = 2**53
"""Bound on whole numbers: up to here each is a double, too."""

FLOAT = np.dtype(np.float64)
INDEX = np.dtype(np.int64)

FEW = 4096
"""Largest size of an array that BLAS processes on one thread."""

Made = TypeVar("Made", bound=Callable[..., Any])


def number(name: str, value: object, low: float = -HUGE, high: float = HUGE) -> float:
    """Return a number from ``low`` to ``high`` as a float; errors call it ``name``."""
    given: Any = value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value
    given = given.item() if isinstance(given, np.generic) else given
    real = isinstance(given, Real) and not isinstance(given, bool)
    try:
        return float(_within(name, value, given if real else None, "number", low, high))
    except OverflowError:  # of a whole number
        raise ValueError(_wrong(name, value, _range("number", low, high))) from None


def whole(name: str, value: Any, low: int = 0, high: float = LARGEST_WHOLE) -> int:
    """Return a whole number from ``low`` to ``high`` as an int; errors call it ``name``."""
    try:
        given = None if hides(value) else operator.index(value)
    except TypeError:
        given = None
    return _within(name, value, None if isinstance(value, bool) else given, "whole number", low, high)


def _within(name: str, value: object, given: Any, what: str, low: float, high: float) -> Any:
    """Return the number ``given``; raise TypeError if it is None, and ValueError if it is out of bounds."""
    if given is None or not low <= given <= high:
        raise (TypeError if given is None else ValueError)(_wrong(name, value, _range(what, low, high)))
    return given


def flag(name: str, value: object) -> bool:
    """Return a bool; errors call it ``name``."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(_wrong(name, value, "True or False"))
    return bool(value)


def chosen(name: str, value: object, choices: Collection[str]) -> str:
    """Return one of some strings; errors call it ``name``."""
    if isinstance(value, str) and value in choices:
        return value
    kind = ValueError if isinstance(value, str) else TypeError
    raise kind(_wrong(name, value, f"one of {', '.join(map(repr, choices))}"))


def instance(name: str, value: object, *kinds: type) -> Any:
    """Return an object of one of some classes; errors call it ``name``."""
    if not isinstance(value, kinds):
        names = ("None" if kind is type(None) else kind.__name__ for kind in kinds)
        raise TypeError(_wrong(name, value, " or ".join(names)))
    return value


def array(
    name: str, value: object, *shapes: tuple[int | None, ...], low: float = -HUGE, high: float = HUGE
) -> np.ndarray:
    """Return numbers as an array of float64, without a copy if they are one.

    Parameters
    ----------
    name
        Name in errors.
    value
        The argument.
    shapes
        The allowed shapes. None stands for any length, () for a single number.
    low, high
        Bounds of each number.
    """
    # Fast path for arrays that simulators and episodes pass to each other.
    if (
        value.__class__ is np.ndarray
        and value.dtype is FLOAT
        and (low, high) == (-HUGE, HUGE)
        and fits(value.shape, shapes)
        and sum_of_squares(value) <= HUGE  # bounds each number
    ):
        return value
    given = _shaped(name, value, shapes)
    if given.dtype == object:  # as numbers beyond 64 bits
        for where in np.ndindex(given.shape):
            number(f"{name}{list(where) or ''}", given[where], low, high)
    elif given.dtype.kind not in "iuf":
        raise TypeError(_wrong(name, value, "an array of numbers"))
    floats = given
    if given.dtype != np.float64:
        with np.errstate(over="ignore"):
            floats = np.asarray(given, np.float64)
    within = (floats >= low) & (floats <= high)
    if not within.all():
        where = np.argwhere(~within)[0].tolist()
        raise ValueError(_wrong(f"{name}{where or ''}", given[tuple(where)], _range("number", low, high)))
    return floats


def readings(name: str, value: object, *shapes: tuple[int | None, ...]) -> np.ndarray:
    """Return measured numbers as an array of float64: some may be NaN or infinite, as after divergence."""
    given = _shaped(name, value, shapes)
    if given.dtype.kind not in "iuf":
        raise TypeError(_wrong(name, value, "an array of numbers"))
    return np.asarray(given, np.float64)


def function(name: str, value: Any) -> Any:
    """Return something that can be called; errors call it ``name``."""
    if not callable(value):
        raise TypeError(_wrong(name, value, "a function"))
    return value


def direction(name: str, value: object) -> np.ndarray:
    """Return the unit vector (3,) along a vector that is not zero; errors call it ``name``."""
    given = array(name, value, (3,))
    length = math.sqrt(given.dot(given))
    if length < TINY:
        raise ValueError(_wrong(name, value, "a vector that is not zero"))
    return given / length


def whole_array(
    name: str, value: object, *shapes: tuple[int | None, ...], low: int = 0, high: int = LARGEST_WHOLE
) -> np.ndarray:
    """Return whole numbers as an array of int64; the parameters are those of `array`."""
    given = _shaped(name, value, shapes)
    if given.size and given.dtype.kind not in "iuO":
        raise TypeError(_wrong(name, value, "an array of whole numbers"))
    if given.dtype == object:
        for where in np.ndindex(given.shape):
            whole(f"{name}{list(where) or ''}", given[where], low, high)
    within = (given >= low) & (given <= high)
    if not within.all():
        where = np.argwhere(~within)[0].tolist()
        whole(f"{name}{where or ''}", given[tuple(where)], low, high)
    return given.astype(np.int64)


def indices(name: str, value: object, count: int, *, once: bool = False) -> np.ndarray:
    """Return a selection of ``count`` items as indices (k,) of int64.

    Parameters
    ----------
    name
        Name in errors.
    value
        Indices in any order, or a mask (count,).
    count
        Number of items.
    once
        Whether to raise an error if one occurs twice.
    """
    given = _shaped(name, list(value) if isinstance(value, range) else value, ((None,),))
    if given.dtype == bool:
        if len(given) != count:
            raise ValueError(f"{name} is a mask of shape {given.shape}; its shape must be {(count,)}")
        return np.flatnonzero(given)
    index = given.copy()
    if given.dtype != np.int64 or (given.view(np.uint64) >= count).any():  # negative ones are large
        index = whole_array(name, given, (None,), high=count - 1)
    if once and len(index) > 1:
        ordered = np.sort(index)
        again = ordered[1:][ordered[1:] == ordered[:-1]]
        if again.size:
            raise ValueError(f"{name} names {again[0]} twice; it must name each once")
    return index


def unreadable(path: os.PathLike[str], most: int) -> str:
    """Return the reason why a file cannot or must not be read; empty if it can.

    It must be a regular file, because pipes and devices may have no end, of at most ``most`` bytes.
    """
    try:
        found = os.stat(path)
    except (OSError, ValueError) as error:  # a null character in the name
        return getattr(error, "strerror", None) or str(error)
    if not stat.S_ISREG(found.st_mode):
        return "it is a folder" if stat.S_ISDIR(found.st_mode) else "it is not a regular file"
    return f"it has {found.st_size:,} bytes, and at most {most:,} are read" if found.st_size > most else ""


def sum_of_squares(values: np.ndarray) -> float:
    """Return Σ values²; it is not finite if a value is not. For many numbers, BLAS would start its own
    threads, which then wait for work on the cores that step the copies."""
    if values.size < FEW:
        return float(np.vdot(values, values))
    with np.errstate(over="ignore"):
        return float(np.square(values).sum())


def refuse_unknown(what: str, given: Iterable[str], *takers: Callable[..., Any]) -> None:
    """Raise TypeError for arguments that are not in the signature of the first function.

    Raises
    ------
    TypeError
        The message names the argument, and a similar one of any of the functions, or all of them.
    """
    each = [inspect.signature(taker).parameters.values() for taker in takers]
    named = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    names = [[one.name for one in parameters if one.kind in named] for parameters in each]
    for name in given:
        if name not in names[0]:
            known = [one for listed in names for one in listed if one != "self"]
            raise TypeError(f"{what} has no argument {name!r}{suggestion(name, dict.fromkeys(known))}")


def refusing_unknown(made: Made) -> Made:
    """Decorate a public function or class, so that an unknown argument is refused by `refuse_unknown`.

    Right calls cost one more call of a function, and signatures do not change.
    """
    called: Any = made.__init__ if isinstance(made, type) else made  # type: ignore[misc]

    @functools.wraps(called)
    def call(*given: Any, **named: Any) -> Any:
        try:
            return called(*given, **named)
        except TypeError:
            try:
                refuse_unknown(made.__name__, named, made)
            except TypeError as refusal:
                raise refusal from None
            raise

    if not isinstance(made, type):
        return call  # type: ignore[return-value]
    made.__init__ = call  # type: ignore[misc]
    return made


def similar(key: object, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: a similar name, or one that contains it; else ""."""
    names = list(known)
    close = difflib.get_close_matches(key, names, n=1) if isinstance(key, str) else []
    if isinstance(key, str) and len(key) >= 3:
        close += [name for name in names if name.startswith(key)]
        close += [name for name in names if key in name]
    return f"; did you mean {close[0]!r}?" if close else ""


def suggestion(key: object, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown name: a `similar` name, or all names."""
    names = list(known)
    return similar(key, names) or f"; choose from: {', '.join(names)}"


def printable(text: str) -> str:
    """Return a text with escapes in place of characters that a terminal would obey: ``\\x1b`` for ESC.

    Use it for text from files and names of files, which may be anyone's, before you print it.
    """
    harmless = (char.isprintable() or unicodedata.category(char) == "Zs" for char in text)  # Zs: all spaces
    return "".join(char if fine else repr(char)[1:-1] for char, fine in zip(text, harmless, strict=True))


def counted(count: int, one: str, several: str = "") -> str:
    """Return a number of things in words: "1 step", "2 steps"; ``several`` is an irregular plural."""
    return f"{count:,} {one if count == 1 else several or one + 's'}"


def shown(value: object) -> str:
    """Return a value in the form of error messages, at most a line long."""
    if isinstance(value, np.generic):
        value = value.item()
    try:
        written = " ".join(repr(value).split())
    except Exception:  # the repr of a foreign class may fail, and an int may have too many digits
        written = f"a {type(value).__name__}"
    return written if len(written) <= 80 else f"{written[:79]}…"


def hides(value: object) -> bool:
    """Return whether an array, or one in nested lists, hides values by a mask."""
    if isinstance(value, (list, tuple)):
        return any(map(hides, value))
    return isinstance(value, np.ma.MaskedArray) and bool(np.ma.is_masked(value))


def apart(*values: float) -> tuple[str, ...]:
    """Return numbers as texts of six digits, or of so many that none looks like another that it is not."""
    different = len(set(values))
    for digits in range(6, 18):
        texts = tuple(f"{value:.{digits}g}" for value in values)
        if len(set(texts)) == different:
            break
    return texts


def _wrong(name: str, value: object, must: str) -> str:
    return f"{name} is {shown(value)}; it must be {must}"


def _range(what: str, low: float, high: float) -> str:
    """Return a phrase that describes the allowed numbers."""
    ends = " to ".join(f"{end:g}" if float(f"{end:g}") == end else repr(float(end)) for end in (low, high))
    if low == TINY:
        return f"a positive {what}, from {ends}"
    if what == "number":
        return f"a number from {ends}"
    if high in (LARGEST_WHOLE, math.inf):
        return f"a {what}, at least {low}"
    return f"a {what} from {low} to {high}"


def _shaped(name: str, value: object, shapes: tuple[tuple[int | None, ...], ...]) -> np.ndarray:
    """Return a value as an array of one of some shapes, of any type."""
    if value.__class__ is np.ndarray and fits(value.shape, shapes):
        return value
    if hides(value):
        raise ValueError(_wrong(name, value, "an array without hidden values"))
    try:
        given = np.asarray(value)
    except ValueError:
        must = f"{_shapes(shapes)}, and its rows of one length"
        raise ValueError(_wrong(name, value, must)) from None
    except Exception:  # a foreign class may raise any error
        raise TypeError(_wrong(name, value, _shapes(shapes))) from None
    if given.dtype != bool and _mixed(value):
        raise TypeError(f"{name} is {shown(value)}; it must not mix numbers and bools")
    if given.ndim == 0 and given.dtype.kind not in "iufb" and () not in shapes:
        raise TypeError(_wrong(name, value, _shapes(shapes)))
    if fits(given.shape, shapes):
        return given
    raise ValueError(f"{name} is {shown(value)}, of shape {given.shape}; it must be {_shapes(shapes)}")


def fits(given: tuple[int, ...], shapes: tuple[tuple[int | None, ...], ...]) -> bool:
    """Return whether a shape is one of the allowed ones."""
    if given in shapes:
        return True
    for shape in shapes:
        if len(shape) == len(given):
            for n, m in zip(shape, given, strict=True):
                if n is not None and n != m:
                    break
            else:
                return True
    return False


def _shapes(shapes: tuple[tuple[int | None, ...], ...]) -> str:
    """Return a phrase that describes the allowed arrays."""
    return f"an array of shape {' or '.join(map(_shape, shapes))}"


def _shape(shape: tuple[int | None, ...]) -> str:
    lengths = str(tuple("nmk"[axis] if n is None else n for axis, n in enumerate(shape)))
    return lengths.replace("'", "") if shape else "() (a number)"


def _mixed(value: object) -> bool:
    """Return whether nested lists contain a bool, which NumPy would convert to 0 or 1 among numbers."""
    if isinstance(value, (list, tuple)):
        return any(map(_mixed, value))
    return isinstance(value, (bool, np.bool_))
