"""Bodies that roll: a ball, an ellipsoid, a disk, a capsule. Their particles have a solid's inertia.

The four particles of a ball, and the six of an ellipsoid or a disk, lie at S u about the centre of mass. The
unit vectors u point to the corners of a regular tetrahedron, or of an octahedron, and S = √(3 C). The masses
are equal. Their second moments Σ m X Xᵀ = M C are those of a solid with the mass M, whose inertia is
M (tr C 1 − C). A spring joins every two. The body meets surfaces with one round feature, see
`springgym.model.bodies.round`; only a ball also meets other bodies.

Two particles of a capsule lie at the ends of its axis, at ± l/2. The other four lie at (± b, 0, h) and
(0, ± b, −h), with b² = 3 Cₓₓ and h² = 3/2 C_zz − l²/8, so that the second moments are those of the solid. It
meets surfaces with the spheres about both ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from springgym.checks import TINY, array, number, refusing_unknown, shown
from springgym.model.bodies.body import Body
from springgym.model.bodies.round import LARGEST, SMALLEST, Round, ellipsoid_of, rim, sphere

SOLID = 0.4
"""Moment of inertia of a solid ball over m r²."""

TETRAHEDRON = np.array([[-(2**0.5), -1, -(6**0.5)], [-(2**0.5), -1, 6**0.5], [8**0.5, -1, 0], [0, 3, 0]]) / 3
"""The corners (4, 3) of a regular tetrahedron, at the distance 1 from its centre. The second lies above the
first along z, and the third aside along x, so that they define the axes of a body."""

OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
"""The corners (6, 3) of an octahedron, at the distance 1 from its centre."""


@refusing_unknown
def rolling_ball(
    radius: float = 0.1,
    mass: float = 1.0,
    moment: float = SOLID,
    stiffness: float = 1e5,
    damping: float = 10.0,
) -> Body:
    """Make a rolling ball: four particles inside a sphere, which touches surfaces and other bodies.

    Parameters
    ----------
    radius
        r [m].
    mass
        m [kg].
    moment
        I/(m r²) about any axis: 2/5 for a solid ball, 2/3 for a hollow one, and at most 2/3.
    stiffness, damping
        k [N/m], c [kg/s] of every spring.

    Raises
    ------
    ValueError
        If a value is not positive, or the moment is below 1e-3 or larger than that of a hollow ball.
    """
    feature = sphere(radius)
    mass = number("mass", mass, low=TINY)
    radius = feature.extent
    moment = number("moment", moment, 1e-3, 2 / 3)
    inertia = moment * mass * radius**2 * np.eye(3)
    return _carrier("rolling ball", mass, inertia, TETRAHEDRON, feature, stiffness, damping)


@refusing_unknown
def ellipsoid(
    semi_axes: Sequence[float] = (0.15, 0.1, 0.08),
    mass: float = 1.0,
    inertia: Sequence[float] | Sequence[Sequence[float]] | None = None,
    centre_of_mass: Sequence[float] = (0.0, 0.0, 0.0),
    stiffness: float = 1e5,
    damping: float = 10.0,
) -> Body:
    """Make an ellipsoid about the origin that rolls: a rattleback, a tippe-top, an egg.

    Parameters
    ----------
    semi_axes : (3,)
        Along x, y and z [m].
    mass
        m [kg].
    inertia : (3,) or (3, 3), optional
        Inertia tensor about the centre of mass, or its diagonal [kg·m²]. The default is that of a uniform
        solid, m (b² + c²)/5 and so on.
    centre_of_mass : (3,)
        [m]
    stiffness, damping
        k [N/m], c [kg/s] of every spring.

    Raises
    ------
    ValueError
        If a value is not positive, or no body with some thickness has this inertia: each principal moment
        must be less than the sum of the others.
    """
    feature = ellipsoid_of(semi_axes)
    mass = number("mass", mass, low=TINY)
    centre = array("centre_of_mass", centre_of_mass, (3,))
    if (centre**2 / np.diag(feature.matrix)).sum() >= 1:
        raise ValueError(f"centre_of_mass is {shown(centre_of_mass)}; it must be inside the ellipsoid")
    if inertia is None:
        squares = np.diag(feature.matrix)
        tensor = np.diag(mass / 5 * (squares.sum() - squares))
    else:
        given = array("inertia", inertia, (3,), (3, 3))
        tensor = np.diag(given) if given.ndim == 1 else given
    about = _carrier("ellipsoid", mass, tensor, OCTAHEDRON, feature, stiffness, damping)
    return about.with_(positions=about.positions + centre)


@refusing_unknown
def disk(
    radius: float = 0.1,
    mass: float = 1.0,
    thickness: float = 0.01,
    stiffness: float = 1e5,
    damping: float = 10.0,
) -> Body:
    """Make a coin about the z axis that touches surfaces with the rim of its middle plane.

    Its inertia is that of a cylinder. It is refused among bodies that collide. It touches a plane in one
    point at a time, see `springgym.model.bodies.rim`. If it strikes almost flat, that point runs from side to
    side within a step, and the coin can gain energy. `Measures.balance` shows this.

    Parameters
    ----------
    radius
        R [m].
    mass
        m [kg].
    thickness
        t [m], at least R/100. It enters the moments m (R²/4 + t²/12) and m R²/2, and the springs that keep
        the coin flat.
    stiffness, damping
        k [N/m], c [kg/s] of every spring.

    Raises
    ------
    ValueError
        If a value is not positive, or the disk is thinner than R/100 or thicker than 2 R.
    """
    radius = number("radius", radius, low=TINY)
    mass = number("mass", mass, low=TINY)
    thickness = number("thickness", thickness, radius / 100, 2 * radius)
    across = mass * (radius**2 / 4 + thickness**2 / 12)
    inertia = np.diag([across, across, mass * radius**2 / 2])
    return _carrier("disk", mass, inertia, OCTAHEDRON, rim(radius), stiffness, damping)


@refusing_unknown
def capsule(
    radius: float = 0.05,
    length: float = 0.2,
    mass: float = 1.0,
    stiffness: float = 1e5,
    damping: float = 10.0,
) -> Body:
    """Make a solid capsule about the z axis: a cylinder with half a ball at each end.

    It rolls on surfaces, which it meets with the balls, and on other bodies, which meet all of it.

    Parameters
    ----------
    radius
        r [m].
    length
        l [m] of the cylinder, from r/100 to 1000 r. With both halves of a ball the capsule is l + 2 r long.
    mass
        m [kg].
    stiffness, damping
        k [N/m], c [kg/s] of every spring.

    Raises
    ------
    ValueError
        If a value is not positive, or the cylinder is too short or too long.
    """
    radius = number("radius", radius, SMALLEST, LARGEST)
    length = number("length", length, radius / 100, 1000 * radius)
    mass = number("mass", mass, low=TINY)
    share = 1 / (1 + 4 * radius / (3 * length))  # fraction of the mass in the cylinder
    across = share * radius**2 / 4 + (1 - share) * radius**2 / 5
    beyond = length**2 / 4 + 3 / 8 * length * radius + radius**2 / 5
    along = share * length**2 / 12 + (1 - share) * beyond
    side = np.sqrt(3 * across)
    height = np.sqrt(1.5 * along - length**2 / 8)
    end = length / 2
    ends = [(0.0, 0.0, end), (0.0, 0.0, -end)]
    between = [(side, 0.0, height), (-side, 0.0, height), (0.0, side, -height), (0.0, -side, -height)]
    return Body(
        name="capsule",
        positions=np.array(ends + between),
        masses=np.full(6, mass / 6),
        springs=np.array(list(combinations(range(6), 2))),
        stiffness=stiffness,  # type: ignore[arg-type]
        damping=damping,  # type: ignore[arg-type]
        markers=(1, 0, 2),
        parts={"ends": (0, 1)},
        rounds=tuple(sphere(radius, place) for place in ends),
    )


def _carrier(
    name: str,
    mass: float,
    inertia: np.ndarray,
    corners: np.ndarray,
    feature: Round,
    stiffness: float,
    damping: float,
) -> Body:
    """Make the particles that carry a feature, with a mass and an inertia tensor."""
    size = float(np.abs(inertia).max())
    if np.abs(inertia - inertia.T).max() > 1e-12 * size:
        raise ValueError(f"inertia is {inertia.tolist()}; it must be symmetric")
    second = (np.trace(inertia) / 2 * np.eye(3) - inertia) / mass
    moments, axes = np.linalg.eigh(0.5 * (second + second.T))
    if not moments[0] > 1e-6 * moments[2]:
        principal = ", ".join(f"{moment:g}" for moment in np.linalg.eigvalsh(inertia))
        raise ValueError(
            f"inertia has the principal moments {principal} kg·m²; each must be less than the sum of the "
            "others, because the body is not flat"
        )
    arms = (axes * np.sqrt(3 * moments)) @ axes.T
    return Body(
        name=name,
        positions=corners @ arms,
        masses=np.full(len(corners), mass / len(corners)),
        springs=np.array(list(combinations(range(len(corners)), 2))),
        stiffness=stiffness,  # type: ignore[arg-type]
        damping=damping,  # type: ignore[arg-type]
        markers=(5, 2, 0) if corners is OCTAHEDRON else (0, 1, 2),
        rounds=(feature,),
    )
