"""The paper's rope (section 4.1): light beads and a heavy end."""

from __future__ import annotations

import numpy as np

from springgym.checks import TINY, number, refusing_unknown, whole
from springgym.model.bodies.body import MOST_PARTICLES, Body


@refusing_unknown
def rope(
    beads: int = 10,
    length: float = 5.0,
    bead_mass: float = 0.1,
    end_mass: float = 70.0,
    stiffness: float = 1e5,
    damping: float = 100.0,
    radius: float = 0.0,
) -> Body:
    """Make a rope: a chain of particles from the origin straight down, with a heavy one at the end.

    The body is floppy. Its third axis points up, from the weight to the top.

    Parameters
    ----------
    beads
        Number of particles, at least 2, including the top one (which you pin) and the weight at the end.
    length
        Unstretched length [m].
    bead_mass, end_mass
        Mass of each bead, and of the weight [kg].
    stiffness, damping
        k [N/m], c [kg/s] of each of the ``beads`` − 1 springs.
    radius
        Radius of the rope for contact [m], see `Body`.

    Raises
    ------
    ValueError
        If there are fewer than two beads, or `Body` refuses the body.
    """
    beads = whole("beads", beads, 2, MOST_PARTICLES)
    length = number("length", length, low=TINY)
    end_mass = number("end_mass", end_mass, low=TINY)
    bead_mass = number("bead_mass", bead_mass, low=TINY)
    last = beads - 1
    positions = np.zeros((beads, 3))
    positions[:, 2] = -length * np.arange(beads) / last
    return Body(
        name="rope",
        positions=positions,
        masses=np.array([bead_mass] * last + [end_mass]),
        springs=np.array([(n, n + 1) for n in range(last)]),
        stiffness=stiffness,  # type: ignore[arg-type]
        damping=damping,  # type: ignore[arg-type]
        markers=(last, 0, 0),
        parts={"top": (0,), "beads": tuple(range(last)), "weight": (last,)},
        floppy=True,
        radius=radius,
    )
