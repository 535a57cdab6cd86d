"""The paper's top (section 5.2.2): a circular cone on its tip."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from springgym.checks import TINY, instance, number, refusing_unknown, whole
from springgym.model.bodies.body import MOST_PARTICLES, Body
from springgym.model.bodies.round import sphere


@refusing_unknown
def top(
    ring: int = 12,
    radius: float = 0.5,
    height: float = 1.0,
    mass: float = 12.0,
    stiffness: float = 1e6,
    damping: float = 100.0,
    scaled: Mapping[int, float] | None = None,
    foot: float = 0.0,
) -> Body:
    """Make a top: a ring of particles with half of the mass, and a crown and a tip with a quarter each.

    Springs join ring neighbours, and crown and tip to the ring and to each other: 14 masses and 37
    springs for a ring of 12. Unstretched, about the tip: I₃ = M r²/2, I₁ = M (3h²/4 + r²/4).

    Parameters
    ----------
    ring
        Number of particles in the ring, at least 3.
    radius, height
        Radius and height of the cone [m].
    mass
        Total mass M [kg].
    stiffness, damping
        k [N/m], c [kg/s] of every spring.
    scaled
        Factors for the masses of single ring particles: ``{0: 2.0}`` makes the paper's unbalanced top.

    foot
        Radius of a round foot [m]: a sphere whose lowest point is the tip, and with which the top meets
        surfaces, so that it rolls on it. Without it, the default, the particles meet them, and the top
        stands on its tip.

    Raises
    ------
    ValueError
        If the ring has fewer than three particles, or a factor is given to one that is not in it; if the
        radius of the foot is negative, or more than half of the height.
    """
    ring = whole("ring", ring, 3, MOST_PARTICLES - 2)
    radius = number("radius", radius, low=TINY)
    height = number("height", height, low=TINY)
    mass = number("mass", mass, low=TINY)
    foot = number("foot", foot, 0.0, height / 2)
    masses = np.array([mass / 2 / ring] * ring + [mass / 4, mass / 4])
    for n, factor in instance("scaled", {} if scaled is None else scaled, Mapping).items():
        n = whole("a particle that scaled names", n, 0, ring - 1)
        masses[n] *= number(f"scaled[{n}]", factor, low=TINY)
    angle = 2 * np.pi * np.arange(ring) / ring
    crown = ring
    tip = ring + 1
    positions = np.zeros((ring + 2, 3))
    positions[:ring, 0] = radius * np.cos(angle)
    positions[:ring, 1] = radius * np.sin(angle)
    positions[: ring + 1, 2] = height
    following = [(n + 1) % ring for n in range(ring)]
    springs = [pair for n in range(ring) for pair in ((n, following[n]), (n, crown), (n, tip))]
    springs.append((crown, tip))
    triangles = [(crown, n, following[n]) for n in range(ring)]
    triangles += [(tip, following[n], n) for n in range(ring)]
    return Body(
        name="top",
        positions=positions,
        masses=masses,
        springs=np.array(springs),
        stiffness=stiffness,  # type: ignore[arg-type]
        damping=damping,  # type: ignore[arg-type]
        markers=(tip, crown, 0),
        parts={"ring": tuple(range(ring)), "crown": (crown,), "tip": (tip,)},
        triangles=np.array(triangles),
        rounds=(sphere(foot, (0.0, 0.0, foot)),) if foot > 0 else (),
    )
