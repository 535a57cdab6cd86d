"""Time-stepping methods: one file each, with its `Integrator` record and ``integrate`` function.

A method of one's own needs no edit here: `register` it.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from springgym.checks import instance, shown
from springgym.core.blocks import at
from springgym.core.compiling import compiled, is_inner, kernel
from springgym.core.kinds import Ledger
from springgym.core.lanes import bodies_of, of_body
from springgym.integrators.clock import Clock, tick
from springgym.integrators.record import Integrator, Phase

if TYPE_CHECKING:
    from springgym.forces import Terms


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


TAKEN = ("x", "v", "ledger", "workspace", "h", "steps", "terms")
"""The parameters of the function of a method."""


def integrator(name: str) -> Integrator:
    """The record of a method.

    Raises
    ------
    ValueError
        If there is no method of that name.
    """
    return _method(name)[0]


def register(record: Integrator, integrate: Callable[..., None]) -> None:
    """Make a method of one's own known by the name in its record; the last one of a name counts.

    Parameters
    ----------
    record
        The facts about it, which checks and steps rely on.
    integrate
        Compiled (`springgym.core.compiling.compiled`), as those of `springgym.integrators`:
        ``integrate(x, v, ledger, workspace, h, steps, terms)`` takes one block of copies ``steps`` steps
        further. ``h`` is a `springgym.integrators.record.Control` if the record says it controls its error.

    Raises
    ------
    TypeError
        If one is of the wrong kind, or the function takes something else.
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
            f"record.name is {record.name!r}, which is a method of springgym; choose another name"
        )
    _OWN[record.name] = (record, integrate)


_OWN: dict[str, tuple[Integrator, Callable[..., None]]] = {}


def _method(name: str, special: str = "") -> tuple[Integrator, Callable[..., None]]:
    """Record and function of a method; the ``special`` one for some scenes, if it has one of that name."""
    if name in _OWN:
        return _OWN[name]
    if name not in METHODS:
        raise ValueError(f"unknown integrator {name!r}; there are {', '.join((*METHODS, *_OWN))}")
    module = importlib.import_module(f"{__name__}.{name}")
    return module.RECORD, getattr(module, special, module.integrate)


def advance_kernel(
    name: str,
    read: Callable[..., None],
    surfaces: bool = False,
    together: bool = False,
    cycles: bool = False,
) -> Callable[..., None]:
    """The compiled function that takes blocks of copies through a number of steps by a method.

    The one for scenes with ``surfaces``, or where something acts in ``cycles`` of steps, is another where
    these take code that others should not wait for. Bodies that collide take each step ``together``, or look
    around at their `START`; others one after another take all.

    If the kernel is called with ``reads``, it then reads them off by ``read``, a compiled function like
    `springgym.measures.read`, which takes ``reading``, a `springgym.measures.Reading`. Only kernels of rigid
    bodies make use of ``settles``: springs need not be put into shape. ``clock`` counts the steps.
    """
    if together:
        return _kernel(_method(name, "integrate_together")[1], at_once, read)
    special = "integrate_among_surfaces" if surfaces else "integrate_in_cycles" if cycles else ""
    return _kernel(_method(name, special)[1], one_by_one, read)


@compiled
def one_by_one(
    integrate: Any, x: Any, v: Any, ledger: Ledger, workspace: np.ndarray, h: Any, steps: int, terms: Terms
) -> None:
    """Take each body through all steps, by itself."""
    for body in range(bodies_of(x)):
        integrate(
            of_body(x, body),
            of_body(v, body),
            of_body(ledger, body),
            of_body(workspace, body),
            h,
            steps,
            of_body(terms, body),
        )


@compiled
def at_once(
    integrate: Any, x: Any, v: Any, ledger: Ledger, workspace: np.ndarray, h: Any, steps: int, terms: Terms
) -> None:
    """Take all bodies through the steps together."""
    integrate(x, v, ledger, workspace, h, steps, terms)


@cache
def _kernel(
    integrate: Callable[..., None], take: Callable[..., None], read: Callable[..., None]
) -> Callable[..., None]:
    @kernel
    def advance(
        phase: Phase,
        workspace: np.ndarray,
        blocks: tuple[int, int],
        h: Any,
        steps: int,
        settles: bool,
        terms: Terms,
        reading: Any,
        reads: bool,
        clock: Clock,
    ) -> None:
        for block in range(blocks[0], blocks[1]):
            here, own = at(phase, block), at(terms, block)
            if steps != 0:
                take(integrate, here.x, here.v, here.ledger, workspace, at(h, block), steps, own)
            if steps > 0:
                tick(clock, block, steps)
            if reads:
                read(block, here, reading, own)

    return advance
