"""Time-stepping methods: one file each, with its `Integrator` record and ``integrate`` function.

To add one: its file, and its name in `METHODS`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache
from typing import Any

from springgym.blocks import at
from springgym.compiling import kernel
from springgym.integrators.record import Integrator
from springgym.lanes import bodies_of, of_body

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


def integrator(name: str) -> Integrator:
    """The record of a method.

    Raises
    ------
    ValueError
        If there is no method of that name.
    """
    if name not in METHODS:
        raise ValueError(f"unknown integrator {name!r}; there are {', '.join(METHODS)}")
    return importlib.import_module(f"{__name__}.{name}").RECORD


@cache
def advance_kernel(name: str, read: Callable[..., None]) -> Callable[..., None]:
    """The compiled function that takes blocks of copies through a number of steps by a method.

    Then, if it is told so, it reads them off, by a compiled function like `springgym.measures.read`.
    """
    integrate = importlib.import_module(f"{__name__}.{name}").integrate

    @kernel
    def advance(
        x: Any,
        v: Any,
        ledger: Any,
        workspace: Any,
        first: Any,
        last: Any,
        h: Any,
        steps: Any,
        terms: Any,
        reads: Any,
        readout: Any,
        space: Any,
        pivot: Any,
        frame: Any,
    ) -> None:
        for block in range(first, last):
            xb, vb, entries, own = at(x, block), at(v, block), at(ledger, block), at(terms, block)
            if steps > 0:
                for body in range(bodies_of(xb)):
                    integrate(
                        of_body(xb, body),
                        of_body(vb, body),
                        of_body(entries, body),
                        of_body(workspace, body),
                        at(h, block),
                        steps,
                        of_body(own, body),
                    )
            if reads:
                read(block, xb, vb, entries, readout, space, pivot, frame, own)

    return advance
