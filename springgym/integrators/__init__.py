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
from springgym.core.blocks import at
from springgym.core.compiling import compiled, is_inner, kernel
from springgym.core.kinds import Nested, Number
from springgym.core.lanes import bodies_of, of_body
from springgym.integrators.clock import Clock, tick
from springgym.integrators.record import Control, Integrator, Phase
from springgym.lazy import submodule
from springgym.terms import Terms

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
        A function, compiled by `springgym.core.compiling.compiled`:
        ``integrate(x, v, ledger, workspace, h, steps, terms)`` advances one block of copies by ``steps``
        steps. If the record says that the method controls its error, ``h`` is a
        `springgym.integrators.record.Control`.

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
            f"integrate is {shown(integrate)}; it must be decorated with springgym.core.compiling.compiled"
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
    """Return the compiled function that advances blocks of copies by a method.

    Scenes with ``surfaces`` or of bodies that collide, and ``cycles`` of several steps, have their own
    function, so that other scenes need not wait for this code to compile. Bodies that collide or roll take
    each step ``together``, or only find their contacts if the number of steps is `START`. Other bodies take
    all steps one after another.

    If the kernel is called with ``reads``, it also measures the copies by ``read``, a compiled function like
    `springgym.measures.read`, with ``reading``, a `springgym.measures.Reading`. Only kernels of rigid bodies
    use ``settles``. ``clock`` counts the steps.
    """
    special = "integrate_in_cycles" if cycles else ""
    if surfaces:
        special = "integrate_by_rows" if together else "integrate_through_nodes"
    return _kernel(_method(name, special)[1], at_once if together else one_by_one, read)


@compiled
def one_by_one(
    integrate: Callable[..., None],
    phase: Phase,
    workspace: Nested,
    h: Number | Control,
    steps: int,
    terms: Terms,
) -> None:
    """Advance each body through all steps, one body after another."""
    for body in range(bodies_of(phase.x)):
        own = of_body(phase, body)
        integrate(own.x, own.v, own.ledger, of_body(workspace, body), h, steps, of_body(terms, body))


@compiled
def at_once(
    integrate: Callable[..., None], phase: Phase, workspace: Nested, h: Number, steps: int, terms: Terms
) -> None:
    """Advance all bodies together, step by step."""
    integrate(phase.x, phase.v, phase.ledger, workspace, h, steps, terms)


@cache
def _kernel(
    integrate: Callable[..., None], take: Callable[..., None], read: Callable[..., None]
) -> Callable[..., None]:
    @kernel
    def advance(
        phase: Phase,
        workspace: Nested,
        blocks: tuple[int, int],
        h: Number | Control,
        steps: int,
        settles: bool,
        terms: Terms,
        reading: Nested,
        reads: bool,
        clock: Clock,
    ) -> None:
        for block in range(blocks[0], blocks[1]):
            here, own = at(phase, block), at(terms, block)
            if steps != 0:
                take(integrate, here, workspace, at(h, block), steps, own)
            if steps > 0:
                tick(clock, block, steps)
            if reads:
                read(block, here, reading, own)

    return advance
