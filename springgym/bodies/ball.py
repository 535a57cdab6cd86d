"""A ball: a single particle with a radius."""

from __future__ import annotations

import numpy as np

from springgym.bodies.body import Body
from springgym.checks import TINY, number


def ball(radius: float = 0.1, mass: float = 1.0) -> Body:
    """Make a particle at the origin that meets others at a radius.

    It does not turn: it is smooth, and friction between two balls does nothing. Without springs there is
    nothing to derive a contact from, whose strength and reach are to be given.

    Parameters
    ----------
    radius
        [m]
    mass
        [kg]

    Raises
    ------
    ValueError
        If one is not positive.
    """
    return Body(
        name="ball",
        positions=np.zeros((1, 3)),
        masses=np.array([number("mass", mass, low=TINY)]),
        springs=np.zeros((0, 2), int),
        stiffness=np.zeros(0),
        damping=np.zeros(0),
        radius=number("radius", radius, low=TINY),
    )
