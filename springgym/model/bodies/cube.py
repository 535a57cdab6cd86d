"""The paper's cube (section 5.1.2), and boxes like it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from springgym.checks import TINY, array, number, refusing_unknown
from springgym.model.bodies.body import Body

SPRINGS = (
    *((0, 1), (1, 2), (2, 3), (3, 0)),  # top
    *((4, 5), (5, 6), (6, 7), (7, 4)),  # bottom
    *((0, 4), (1, 5), (2, 6), (3, 7)),  # upright
    *((0, 6), (1, 7), (2, 4), (3, 5)),  # through the middle
    *((0, 5), (4, 1), (1, 6), (5, 2)),  # across the sides
    *((2, 7), (6, 3), (3, 4), (7, 0)),
    *((0, 2), (1, 3), (4, 6), (5, 7)),  # across top and bottom
)
"""The 28 pairs of the paper, in its order."""

CORNERS = np.array([(-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)])
FACES = ((0, 1, 2, 3), (4, 7, 6, 5), (4, 5, 1, 0), (7, 3, 2, 6), (5, 6, 2, 1), (4, 0, 3, 7))
"""Corners of each face; opposite faces are split along the same diagonal, so that boxes fit together."""


@refusing_unknown
def box(
    sides: Sequence[float] = (1.0, 1.0, 1.0),
    mass: float | Sequence[float] = 1.0,
    stiffness: float = 1e5,
    damping: float = 10.0,
) -> Body:
    """Make a box about the origin: eight particles at its corners, and a spring between every pair (28).

    Particles 0 to 3 go around the top, anticlockwise from (−x, −y); 4 to 7 lie below them. With equal
    masses, I_x = M (b² + c²)/4 and so on: three times that of a solid box.

    Parameters
    ----------
    sides : (3,)
        Lengths a, b, c along x, y, z [m].
    mass
        Total mass, or the eight masses [kg].
    stiffness, damping
        k [N/m], c [kg/s] of every spring.

    Raises
    ------
    ValueError
        If there are not three positive sides, or neither one mass nor eight, or `Body` refuses the body.
    """
    half = array("sides", sides, (3,), low=TINY) / 2
    masses = array("mass", mass, (), (8,), low=TINY)
    if masses.shape == ():
        masses = np.full(8, masses / 8)
    return Body(
        name="box",
        positions=half * np.vstack([CORNERS, CORNERS * (1, 1, -1)]),
        masses=masses,
        springs=np.array(SPRINGS),
        stiffness=stiffness,  # type: ignore[arg-type]
        damping=damping,  # type: ignore[arg-type]
        markers=(4, 0, 5),
        parts={f"corner {n}": (n,) for n in range(8)} | {"top": (0, 1, 2, 3), "bottom": (4, 5, 6, 7)},
        triangles=np.array([t for a, b, c, d in FACES for t in ((a, b, c), (a, c, d))]),
    )


@refusing_unknown
def cube(side: float = 1.0, mass: float = 1.0, stiffness: float = 1e5, damping: float = 10.0) -> Body:
    """Make the paper's cube: 8 equal masses, 28 springs; the third axis is the diagonal from corner 0 to 6.

    About its centre I = M b²/2 for every axis, about a corner I₃ = M b²/2 along the diagonal and
    I₁ = 5 M b²/4 across it: pinned at a corner it is a Lagrange top.

    Parameters
    ----------
    side
        b [m].
    mass
        M [kg].
    stiffness, damping
        k [N/m], c [kg/s] of every spring.

    Raises
    ------
    ValueError
        If the side is not positive, or `Body` refuses the body.
    """
    side = number("side", side, low=TINY)
    mass = number("mass", mass, low=TINY)
    return box((side, side, side), mass, stiffness, damping).with_(name="cube", markers=(0, 6, 1))
