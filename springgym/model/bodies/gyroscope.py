"""A gyroscope: a ring on an axle."""

from __future__ import annotations

import numpy as np

from springgym.checks import TINY, number, refusing_unknown, whole
from springgym.model.bodies.body import MOST_PARTICLES, Body


@refusing_unknown
def gyroscope(
    ring: int = 12,
    radius: float = 0.5,
    axle: float = 1.0,
    ring_mass: float = 4.0,
    end_mass: float = 0.5,
    centre_mass: float = 1.0,
    stiffness: float = 2e5,
    damping: float = 50.0,
) -> Body:
    """Make a ring around the middle of an axle; pin its ``centre``, or its ``foot`` to make it precess.

    Springs join ring neighbours, the ring to the centre and to both ends of the axle, and the centre to
    the ends. Unstretched, about the centre: I₃ = M_ring r², I₁ = M_ring r²/2 + 2 m_end (axle/2)².

    Parameters
    ----------
    ring
        Number of particles in the ring, at least 3.
    radius, axle
        Radius of the ring, length of the axle [m].
    ring_mass, end_mass, centre_mass
        Masses of the whole ring, of each end of the axle, and of the centre [kg].
    stiffness, damping
        k [N/m], c [kg/s] of every spring.

    Raises
    ------
    ValueError
        If the ring has fewer than three particles, or `Body` refuses the body.
    """
    ring = whole("ring", ring, 3, MOST_PARTICLES - 3)
    radius = number("radius", radius, low=TINY)
    axle = number("axle", axle, low=TINY)
    ring_mass = number("ring_mass", ring_mass, low=TINY)
    end_mass = number("end_mass", end_mass, low=TINY)
    centre_mass = number("centre_mass", centre_mass, low=TINY)
    angle = 2 * np.pi * np.arange(ring) / ring
    centre = ring
    head = ring + 1
    foot = ring + 2
    positions = np.zeros((ring + 3, 3))
    positions[:ring, 0] = radius * np.cos(angle)
    positions[:ring, 1] = radius * np.sin(angle)
    positions[[head, foot], 2] = axle / 2, -axle / 2
    following = [(n + 1) % ring for n in range(ring)]
    springs = [pair for n in range(ring) for pair in ((n, following[n]), (n, centre), (n, head), (n, foot))]
    springs += [(centre, head), (centre, foot)]
    return Body(
        name="gyroscope",
        positions=positions,
        masses=np.array([ring_mass / ring] * ring + [centre_mass, end_mass, end_mass]),
        springs=np.array(springs),
        stiffness=stiffness,  # type: ignore[arg-type]
        damping=damping,  # type: ignore[arg-type]
        markers=(foot, head, 0),
        parts={"ring": tuple(range(ring)), "centre": (centre,), "head": (head,), "foot": (foot,)},
        triangles=np.array([(centre, n, following[n]) for n in range(ring)]),
    )
