"""Round features of a body of springs: ellipsoids, spheres and rims carried by its particles.

In the rest shape a feature has a centre ξc and a symmetric matrix A: its points are ξc + √A u with |u| ≤ 1.
A = r² 1 is a sphere, A = Q diag(a², b², c²) Qᵀ an ellipsoid of semi-axes a, b, c; a very flat one is a disk.
Its farthest point against a direction g, the support point, is

    ξ = ξc − A g/√(g · A g).

The particles determine the position of a material point ξ by constant weights,

    x(ξ) = Σ wᵢ(ξ) xᵢ,    wᵢ(ξ) = (mᵢ/M) (1 + (Xᵢ − X̄) · C⁻¹ (ξ − X̄)),    C = Σ mᵢ (Xᵢ − X̄)(Xᵢ − X̄)ᵀ/M,

with the rest shape X, its centre of mass X̄ and the mass M. Of all weights with Σ w = 1 and Σ w X = ξ, these
have the least Σ w²/m. So an impulse at ξ, distributed by the weights, moves the particles as it would move a
rigid body. The weights are affine in ξ: a direction n of space is g = Σ (n · xᵢ) ∇wᵢ in the rest shape, and
the feature needs no orientation of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import TINY, array, direction, indices, number, refusing_unknown, whole_array
from springgym.model.records import ReadOnly

EDGE = 3e-3
"""Least ratio of the smallest to the largest semi-axis. The lowest point of a thinner feature jumps from side
to side when it lies flat, and no step can follow that."""

SMALLEST = 1e-14
"""Least semi-axis [m], whose square is checked."""

LARGEST = 1e14
"""Largest semi-axis [m], whose square is checked."""

FLAT = 1e-9
"""Relative extent of the carriers below which they count as coplanar, and carry nothing."""


@refusing_unknown
@dataclass(frozen=True, eq=False)
class Round(ReadOnly):
    """An ellipsoid carried by particles of a body, with which the body touches surfaces.

    Other bodies can touch only a single sphere about the centre of mass, or a capsule, two spheres of one
    radius about two particles, with all between them; all particles must carry these.

    Parameters
    ----------
    matrix : (3, 3)
        A [m²] in the rest shape, symmetric. Its eigenvalues are the squares of the semi-axes. The smallest
        semi-axis is at least `EDGE` times the largest. See `sphere`, `ellipsoid_of`, `rim`.
    centre : (3,)
        ξc [m] in the rest shape.
    particles
        The particles that carry it: at least four, not in one plane. The default is all particles of the
        body.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If the matrix is not symmetric, has a negative eigenvalue, is zero, or belongs to a flatter ellipsoid.
    """

    matrix: np.ndarray
    centre: np.ndarray = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    particles: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        matrix = array("matrix of a round feature", self.matrix, (3, 3))
        size = float(np.abs(matrix).max())
        if not size > TINY:
            raise ValueError("matrix of a round feature is zero; it must not be zero")
        if np.abs(matrix - matrix.T).max() > 1e-12 * size:
            raise ValueError(f"matrix of a round feature is {matrix.tolist()}; it must be symmetric")
        matrix = 0.5 * (matrix + matrix.T)
        if (least := float(np.linalg.eigvalsh(matrix)[0])) < -1e-12 * size:
            raise ValueError(
                f"matrix of a round feature has the eigenvalue {least:g}; none may be negative: they are the "
                "squares of semi-axes"
            )
        if least < (1 - 1e-9) * EDGE**2 * float(np.linalg.eigvalsh(matrix)[-1]):
            raise ValueError(
                f"matrix of a round feature makes it flatter than {EDGE:g} of its largest semi-axis; a "
                "flatter one has no lowest point when it lies flat"
            )
        self.keep("matrix", matrix)
        self.keep("centre", array("centre of a round feature", self.centre, (3,)))
        particles = whole_array("particles of a round feature", self.particles, (None,), (0,))
        object.__setattr__(self, "particles", tuple(particles.tolist()))

    @property
    def extent(self) -> float:
        """Return the largest semi-axis [m]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.matrix)[-1]))

    def principal(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the semi-axes (3,) [m], the smallest first, and the axes along them, the columns of (3, 3).

        The axes are right-handed.
        """
        squares, axes = np.linalg.eigh(self.matrix)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        return np.sqrt(np.maximum(squares, 0.0)), axes

    def carriers(self, count: int, what: str = "particles of a round feature") -> np.ndarray:
        """Return the indices of the particles that carry it, in a body of ``count`` particles.

        Raises
        ------
        TypeError, ValueError
            If one does not exist or is named twice.
        """
        if not self.particles:
            return np.arange(count)
        return indices(what, self.particles, count, once=True)

    def support(self, toward: np.ndarray) -> np.ndarray:
        """Return its points (…, 3) [m] that lie farthest against directions (…, 3) of the rest shape."""
        pull = toward @ self.matrix
        size = np.sqrt(np.maximum((toward * pull).sum(axis=-1, keepdims=True), TINY))
        return np.asarray(self.centre - pull / size)

    def __repr__(self) -> str:
        semi, _ = self.principal()
        return f"Round(semi-axes {', '.join(f'{axis:g}' for axis in semi[::-1])} m)"


@refusing_unknown
def sphere(radius: float, centre: ArrayLike = (0.0, 0.0, 0.0), particles: tuple[int, ...] = ()) -> Round:
    """Return a sphere as a round feature.

    Raises
    ------
    ValueError
        If the radius [m] is not positive.
    """
    return Round(number("radius", radius, SMALLEST, LARGEST) ** 2 * np.eye(3), centre, particles)  # type: ignore[arg-type]


@refusing_unknown
def ellipsoid_of(
    semi_axes: ArrayLike, centre: ArrayLike = (0.0, 0.0, 0.0), particles: tuple[int, ...] = ()
) -> Round:
    """Return an ellipsoid with semi-axes (3,) [m] along x, y and z as a round feature.

    Raises
    ------
    ValueError
        If one is not positive.
    """
    axes = array("semi_axes", semi_axes, (3,), low=SMALLEST, high=LARGEST)
    return Round(np.diag(axes**2), centre, particles)  # type: ignore[arg-type]


@refusing_unknown
def rim(
    radius: float,
    axis: ArrayLike = (0.0, 0.0, 1.0),
    centre: ArrayLike = (0.0, 0.0, 0.0),
    particles: tuple[int, ...] = (),
) -> Round:
    """Return a thin disk perpendicular to an axis as a round feature, with half of its thickness `EDGE` R.

    It is an ellipsoid, so one point at a time touches a surface. That point is near the rim while the disk is
    tilted by more than `EDGE`.

    Raises
    ------
    ValueError
        If the radius [m] is not positive, or the axis has no length.
    """
    along = direction("axis", axis)
    flat = np.eye(3) - (1 - EDGE**2) * np.outer(along, along)
    return Round(number("radius", radius, SMALLEST, LARGEST) ** 2 * flat, centre, particles)  # type: ignore[arg-type]


def weights(masses: np.ndarray, positions: np.ndarray, carriers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return w₀ (n,) and B (n, 3) [1/m] of the weights w(ξ) = w₀ + B ξ of the carriers (n,).

    Raises
    ------
    ValueError
        If the carriers lie in a plane, or are fewer than four.
    """
    mass = masses[carriers]
    place = positions[carriers]
    share = mass / mass.sum()
    centre = share @ place
    arms = place - centre
    extents = np.linalg.svd(arms, compute_uv=False)
    if len(carriers) < 4 or not extents[2] > FLAT * extents[0]:
        raise ValueError("at least four particles that do not lie in a plane must carry a round feature")
    spread = (share * arms.T) @ arms
    slope = np.linalg.solve(spread, (share[:, None] * arms).T).T
    return share - slope @ centre, slope


def points_of(masses: np.ndarray, positions: np.ndarray, feature: Round, points: np.ndarray) -> np.ndarray:
    """Return weights (n, N) of a body's particles for the positions of ``points`` (n, 3) [m] of a feature."""
    carriers = feature.carriers(len(masses))
    base, slope = weights(masses, positions, carriers)
    found = np.zeros((len(points), len(masses)))
    found[:, carriers] = base + points @ slope.T
    return found
