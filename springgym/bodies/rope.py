"""The paper's rope (section 4.1): light beads and a heavy end."""

from __future__ import annotations

import numpy as np

from springgym.bodies.body import MOST_PARTICLES, Body
from springgym.checks import TINY, number, whole


def rope(
    beads: int = 10,
    length: float = 5.0,
    bead_mass: float = 0.1,
    end_mass: float = 70.0,
    stiffness: float = 1e5,
    damping: float = 100.0,
    radius: float = 0.0,
) -> Body:
    """Make a chain of particles from the origin down, with a heavy last one. It is floppy on purpose.

    Its third axis points up, from the weight to the top.

    Parameters
    ----------
    beads
        Particles, with the top one (to be pinned) and the weight at the end; at least 2.
    length
        Unstretched [m].
    bead_mass, end_mass
        Of each bead, of the weight [kg].
    stiffness, damping
        k [N/m], c [kg/s] of each of the ``beads`` − 1 springs.
    radius
        By which it meets other bodies and surfaces [m], see `Body`.

    Raises
    ------
    ValueError
        If there are fewer than two beads, or `Body` finds fault.
    """
    beads = whole("beads", beads, 2, MOST_PARTICLES)
    length, end_mass = number("length", length, low=TINY), number("end_mass", end_mass, low=TINY)
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
