"""A ball: a single particle with a radius."""

from __future__ import annotations

import numpy as np

from springgym.checks import TINY, number, refusing_unknown
from springgym.model.bodies.body import Body


@refusing_unknown
def ball(radius: float = 0.1, mass: float = 1.0) -> Body:
    """Make a ball that is a single particle at the origin.

    It does not turn. It is smooth, and there is no friction between two such balls. The strength and reach of
    a contact cannot be derived without springs, so you must give both. `rolling_ball` makes a ball that
    rolls.

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
