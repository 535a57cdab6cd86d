"""A check that height and gradient of a kind of surface agree, in Python and in compiled code."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import NumbaError, njit
from numpy.typing import ArrayLike

from springgym.checks import array, instance, refusing_unknown
from springgym.core.language.blocks import block_array, numbers, set_copies, to_copies
from springgym.core.language.memory import store
from springgym.core.language.vectors import row, set_row
from springgym.model.own_forces import reason_of
from springgym.model.surfaces.surface import Surface, packed_kind

CLOSE = 1e-9
"""Tolerance of equal heights, relative to the extent. Rounding causes far smaller differences, and mistakes
cause far larger ones."""

STEP = 1e-6
"""Slopes are differences of heights over this fraction of the extent. Rounding makes an error of 1e-10. Where
the surface bends over a fraction s of the extent, the error is 1e-12/s²."""

STEEP = 1e-4
"""Largest error of a slope."""

NEWTON = 20
"""Number of Newton iterations from a place to the surface."""


@refusing_unknown
def check_gradient(surface: Surface, places: ArrayLike) -> None:
    """Check that height and gradient of a surface agree at some points, and that its height is the distance.

    Use it for user-defined kinds of surfaces, because a wrong gradient gives wrong physics without an error.
    It compares the compiled height with that of Python, and the compiled gradient with the slope of the
    height. From each place it follows the gradient to the surface, where the gradient must be a unit vector.

    Parameters
    ----------
    surface
        The surface.
    places : (n, 3)
        Places where bodies will be [m], none of them in an edge of the surface.

    Raises
    ------
    TypeError, ValueError
        If a function does not compile, returns the wrong thing, or they disagree; the message names the
        place, what was found and what it must be.
    """
    instance("surface", surface, Surface)
    at = array("places", places, (None, 3))
    if not len(at):
        raise ValueError("places is empty; it must hold at least one point")
    extent = 1.0 + float(np.abs(at).max(initial=0.0))
    height, gradient = _compiled(surface, at)
    of = type(surface).__name__
    _compare(f"the compiled height of {of}", at, height, _height(surface, at), CLOSE * extent)
    steps = STEP * extent * np.eye(3)
    rises = [_height(surface, at + step) - _height(surface, at - step) for step in steps]
    slope = np.stack(rises, axis=1) / (2 * STEP * extent)
    _compare(f"the compiled gradient of {of}", at, gradient, slope, STEEP)
    for _ in range(NEWTON):
        at = at - (height / np.maximum((gradient**2).sum(axis=1), STEP))[:, None] * gradient
        height, gradient = _compiled(surface, at)
    on = np.abs(height) < CLOSE * extent
    if not on.any():
        raise ValueError(
            f"no path along the gradient leads from the places to the {of}; give points nearer to it"
        )
    length = np.linalg.norm(gradient[on], axis=1)
    what = f"on the surface, where the height is the distance, the length of the gradient of {of}"
    _compare(what, at[on], length, np.ones(len(length)), STEEP)


def _compare(what: str, places: np.ndarray, found: np.ndarray, wanted: np.ndarray, within: float) -> None:
    close = (np.abs(found - wanted) <= within).reshape(len(places), -1).all(axis=1)
    for n in np.flatnonzero(~close)[:1]:
        place, told, must = (np.round(values[n], 6).tolist() for values in (places, found, wanted))
        raise ValueError(f"at {place} {what} is {told}; it must be {must}")


def _height(surface: Surface, places: np.ndarray) -> np.ndarray:
    return array(f"what {type(surface).__name__}.height gave", surface.height(places), (len(places),))


def _compiled(surface: Surface, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the compiled heights (n,) and gradients (n, 3) at places (n, 3)."""
    own = packed_kind(type(surface), [surface])
    copies = max(2, len(places))
    x, found = (block_array(copies, (rows, 3), float) for rows in (1, 2))
    numbers(x)[:] = 1.0
    set_copies(x, np.arange(len(places)), places[:, None])
    kind: Any = type(own)
    evaluate = _evaluator(kind)
    try:
        for one, of_one in zip(x, found, strict=True):
            evaluate(one, of_one, own)
    except NumbaError as error:
        raise TypeError(f"{kind.__name__} does not compile: {reason_of(error)}") from None
    told = to_copies(found, copies)[: len(places)]
    return told[:, 0, 0], told[:, 1]


@cache
def _evaluator(kind: Any) -> Callable[..., None]:
    """Compile a function that writes the height and the gradient of the first surface of a kind."""
    height = kind.height
    gradient = kind.gradient

    @njit(error_model="numpy")
    def evaluate(x: Any, found: Any, own: Any) -> None:
        store(found, (0, 0), height(row(x, 0), 0, own))
        set_row(found, 1, gradient(row(x, 0), 0, own))

    return evaluate
