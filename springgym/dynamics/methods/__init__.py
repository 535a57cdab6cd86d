"""Time-stepping methods. Each has a file with its `Integrator` record and its ``integrate`` function.

`register` adds a method of your own.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

from springgym.checks import instance, shown, suggestion
from springgym.core.compiler.decorators import compiled, is_inner, kernel
from springgym.core.language.bodies import bodies_of, of_body
from springgym.core.language.kinds import Nested, Number
from springgym.core.language.memory import at
from springgym.dynamics.methods.clock import Clock, tick
from springgym.dynamics.methods.node import SPRINGS, Space
from springgym.dynamics.methods.record import Control, Integrator, Phase
from springgym.dynamics.step import Bodies, advance_together
from springgym.dynamics.terms import Terms
from springgym.lazy import submodule

__all__ = ["TAKEN", "advance_all", "advance_each", "advance_kernel", "integrator", "kernel_of", "register"]

METHODS = (
    "verlet",
    "symplectic_euler",
    "rk4",
    "pefrl",
    "blanes_moan",
    "dopri5",
    "implicit_euler",
    "implicit_midpoint",
    "tr_bdf2",
    "rodas3",
)


if not TYPE_CHECKING:  # for type checkers, every name would exist

    def __getattr__(name: str) -> Any:
        return submodule(__name__, name)


TAKEN = ("x", "v", "ledger", "workspace", "h", "steps", "terms")
"""Names of the arguments of a method's function."""


def integrator(name: str) -> Integrator:
    """Return the record of a method.

    Raises
    ------
    TypeError
        If the name is not a string.
    ValueError
        If there is no method of that name.
    """
    return _method(instance("name", name, str))[0]


def register(record: Integrator, integrate: Callable[..., None]) -> None:
    """Register a method of your own under the name in its record. It replaces an earlier one of that name.

    Parameters
    ----------
    record
        The properties of the method, on which checks and steps rely.
    integrate
        A function, compiled by `springgym.core.compiler.decorators.compiled`:
        ``integrate(x, v, ledger, workspace, h, steps, terms)`` advances one block of copies by ``steps``
        steps. If the record says that the method controls its error, ``h`` is a
        `springgym.dynamics.methods.record.Control`.

    Raises
    ------
    TypeError
        If an argument has the wrong type, or the function has other parameters.
    ValueError
        If a method of springgym has the name.
    """
    instance("record", record, Integrator)
    if not is_inner(integrate):
        raise TypeError(
            f"integrate is {shown(integrate)}; it must be decorated with "
            "springgym.core.compiler.decorators.compiled"
        )
    try:
        inspect.signature(integrate.py_func).bind(*TAKEN)
    except TypeError:
        found = ", ".join(inspect.signature(integrate.py_func).parameters)
        raise TypeError(f"integrate takes ({found}); it must take ({', '.join(TAKEN)})") from None
    if record.name in METHODS:
        raise ValueError(
            f"record.name is {record.name!r}, which is a built-in integrator; choose another name"
        )
    _OWN[record.name] = (record, integrate)


_OWN: dict[str, tuple[Integrator, Callable[..., None]]] = {}


def _method(name: str, special: str = "") -> tuple[Integrator, Callable[..., None]]:
    """Return record and function of a method: its function named ``special``, if it has one."""
    if name in _OWN:
        return _OWN[name]
    if name not in METHODS:
        raise ValueError(f"unknown integrator {name!r}{suggestion(name, (*METHODS, *_OWN))}")
    module = importlib.import_module(f"{__name__}.{name}")
    return module.RECORD, getattr(module, special, module.integrate)


def advance_kernel(
    name: str, read: Callable[..., None], surfaces: bool = False, together: bool = False, cycles: bool = False
) -> Callable[..., None]:
    """Return the compiled function that advances blocks of copies by a method, see `kernel_of`.

    Scenes with ``surfaces`` or of bodies that collide, and ``cycles`` of several steps, have their own
    function, so that other scenes need not wait for this code to compile. Bodies that collide or roll take
    each step ``together``; others take all steps one after another.
    """
    if surfaces and together:
        return kernel_of(advance_all, read)
    special = "integrate_in_cycles" if cycles else ""
    if surfaces:
        special = "integrate_at_surfaces"
    return kernel_of(advance_each(_method(name, special)[1]), read)


@cache
def advance_each(integrate: Callable[..., None]) -> Callable[..., None]:
    """Return a function that advances bodies by a method, one after another."""

    @compiled
    def advance(
        phase: Phase, workspace: Nested, h: Number | Control, steps: int, placed: bool, terms: Terms
    ) -> None:
        if not placed:
            for body in range(bodies_of(phase.x)):
                own = of_body(phase, body)
                space = of_body(workspace, body)
                integrate(own.x, own.v, own.ledger, space, h, steps, of_body(terms, body))

    return advance


@compiled
def advance_all(phase: Phase, workspace: Space, h: Number, steps: int, placed: bool, terms: Terms) -> None:
    """Advance all bodies together, step by step, or find which touch in copies that were just ``placed``."""
    bodies = Bodies(phase.x, phase.v, phase.ledger, workspace, terms, None)
    advance_together(SPRINGS, bodies, h, steps, placed)


@cache
def kernel_of(advance: Callable[..., None], read: Callable[..., None]) -> Callable[..., None]:
    """Return the compiled function that Python calls for a range of blocks.

    In each block it prepares copies that were just ``placed``, or advances all copies by ``steps``, and their
    ``clock``. Then it measures them if it ``reads``, by a compiled function like
    `springgym.dynamics.measures.read` with ``reading``, a `springgym.dynamics.measures.Reading`."""

    @kernel
    def advance_blocks(
        phase: Phase,
        workspace: Nested,
        blocks: tuple[int, int],
        h: Number | Control,
        steps: int,
        placed: bool,
        terms: Nested,
        reading: Nested,
        reads: bool,
        clock: Clock,
    ) -> None:
        for block in range(blocks[0], blocks[1]):
            here = at(phase, block)
            own = at(terms, block)
            if placed or steps > 0:
                advance(here, workspace, at(h, block), steps, placed, own)
                tick(clock, block, steps)
            if reads:
                read(block, here, reading, own)

    return advance_blocks
