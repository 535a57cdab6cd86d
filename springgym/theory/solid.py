"""Elastic solids: mass, inertia, free vibration and growth under spin, without a mesh.

Displacements are polynomials, u_i = sum of c_ia phi_a(x), phi_a products of Legendre polynomials of
total degree up to `degree`. With M = rho int phi_a phi_b and

    K_(ia)(jb) = sum over k, l of C_ikjl int (d phi_a/dx_k) (d phi_b/dx_l)

the lowest frequencies of the free solid are those of K c = omega^2 M c after the six of rigid
motion, and its static response to a force f per volume solves K c = int f phi. The integrals are
exact for boxes, cones, balls and polyhedra. By the Rayleigh-Ritz theorem, frequencies are too high and
responses too small, with errors that fall with the degree.

A solid that turns at omega about an axis stretches: its moment of inertia grows by
dI/I = s omega^2, s = 2 int rho r . u / I, where K u = rho r for unit omega and r is the distance
from the axis. Both follow the laws omega_1 ~ sqrt(E/rho)/L and s ~ rho L^2/E.

Sources: Visscher, Migliori, Bell & Reinert, J. Acoust. Soc. Am. 90 (1991) 2154,
doi:10.1121/1.401643, for the method; Nye, *Physical Properties of Crystals*, for the tensors.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from springgym.checks import array, shown, whole_array
from springgym.theory.checking import (
    ROUNDING,
    checked,
    count,
    inside,
    instance_of,
    numbers,
    optional,
    positive,
    positives,
    units,
    whole_numbers,
)
from springgym.theory.frames import Floats

__all__ = [
    "CHUNK",
    "DEGREE",
    "MOST",
    "PAIRS",
    "ElasticSolid",
    "Rule",
    "ball_rule",
    "box_rule",
    "cone_rule",
    "cylinder_rule",
    "elastic_solid",
    "isotropic",
    "orthotropic",
    "polyhedron_rule",
]

DEGREE = 8
"""Lowest frequencies are within 5e-4 of those of degree 12, for cube, bar, plate and cones."""

CHUNK = 20_000
"""Number of points whose polynomials are in memory at once."""


MOST = 16
"""Largest degree: 969 polynomials."""

_degree = count(1, MOST)


@checked(points=numbers((None, 3)), weights=numbers((None,)), degree=_degree)
class Rule(NamedTuple):
    """Points, shape (Q, 3), m, and weights, shape (Q,), m^3, that integrate over a solid.

    Exact for products of two polynomials of total degree up to `degree`.
    """

    points: Floats
    weights: Floats
    degree: int


@checked(
    mass=positive,
    centre=numbers((3,)),
    second=numbers((3, 3)),
    frequencies=numbers((None,), low=0.0),
    stretch=numbers((3,)),
    moved=numbers((3, None, 3)),
)
class ElasticSolid(NamedTuple):
    """The mass, the moments, the vibrations and the growth under spin of an elastic solid.

    `mass`, kg; `centre`, shape (3,), m; `second`, shape (3, 3), int rho r r^T about the centre, kg m^2;
    `frequencies`, shape (n,), rad/s, ascending, those of the free solid without rigid motion;
    `stretch`, shape (3,), s^2: dI/I = stretch * omega^2 for spin about each of the axes given;
    `moved`, shape (3, P, 3), m s^2: how far it moves the marks, per omega^2, from the centre of mass.
    """

    mass: float
    centre: Floats
    second: Floats
    frequencies: Floats
    stretch: Floats
    moved: Floats

    @property
    def inertia(self) -> Floats:
        """Return the inertia tensor about the centre, shape (3, 3), kg m^2."""
        return np.asarray(np.trace(self.second) * np.eye(3) - self.second)


# --- Elasticity -------------------------------------------------------------------------------------


@checked(young=positive, poisson=inside(-1.0, 0.5))
def isotropic(young: float, poisson: float) -> Floats:
    """Return the elasticity tensor C of stress = C strain, shape (3, 3, 3, 3), Pa.

    Parameters
    ----------
    young, poisson : float
        E, Pa, and nu.
    """
    shear = young / (2 * (1 + poisson))
    first = young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    one = np.eye(3)
    return np.asarray(
        first * np.einsum("ij,kl->ijkl", one, one)
        + shear * (np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one))
    )


PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Voigt's order of the components of stress and strain."""


@checked(young=positives((3,)), poisson=numbers((3,)), shear=positives((3,)))
def orthotropic(young: ArrayLike, poisson: ArrayLike, shear: ArrayLike) -> Floats:
    """Return the elasticity tensor of a material with three planes of symmetry, shape (3, 3, 3, 3), Pa.

    Parameters
    ----------
    young : array_like, shape (3,)
        E_x, E_y, E_z, Pa.
    poisson : array_like, shape (3,)
        nu_xy, nu_xz, nu_yz; nu_ij is the contraction along j by a pull along i.
    shear : array_like, shape (3,)
        G_xy, G_xz, G_yz, Pa.

    Raises
    ------
    ValueError
        If the constants belong to no stable material: its strain energy would not be positive.
    """
    e, nu, g = (np.asarray(values, float) for values in (young, poisson, shear))
    compliance = np.diag(np.concatenate([1 / e, 1 / g[::-1]]))
    for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), nu, strict=True):
        compliance[i, j] = compliance[j, i] = -value / e[i]
    if not np.linalg.eigvalsh(compliance)[0] > 0:
        raise ValueError(
            f"no material has E = {e.tolist()} Pa, nu = {nu.tolist()} and G = {g.tolist()} Pa: its strain "
            "energy would not be positive"
        )
    stiffness = np.linalg.inv(compliance)
    tensor = np.zeros((3, 3, 3, 3))
    for a, (i, j) in enumerate(PAIRS):
        for b, (k, l) in enumerate(PAIRS):  # noqa: E741
            for m, n in {(i, j), (j, i)}:
                for p, q in {(k, l), (l, k)}:
                    tensor[m, n, p, q] = stiffness[a, b]
    return tensor


# --- Shapes -----------------------------------------------------------------------------------------


@checked(sides=positives((3,)), degree=_degree)
def box_rule(sides: ArrayLike, degree: int = DEGREE) -> Rule:
    """Return the rule of a box about the origin with these sides, shape (3,), m."""
    t, w = legendre.leggauss(degree + 1)
    half = np.asarray(sides, float) / 2
    grid = np.meshgrid(*(h * t for h in half), indexing="ij")
    weights = np.einsum("i,j,k->ijk", *(h * w for h in half))
    return Rule(np.stack(grid, axis=-1).reshape(-1, 3), weights.ravel(), degree)


@checked(radius=positive, height=positive, degree=_degree)
def cone_rule(radius: float, height: float, degree: int = DEGREE) -> Rule:
    """Return the rule of a circular cone on its tip at the origin, opening along z, m."""
    return _revolved(lambda z: radius * z / height, height, degree)


@checked(radius=positive, height=positive, degree=_degree)
def cylinder_rule(radius: float, height: float, degree: int = DEGREE) -> Rule:
    """Return the rule of a cylinder about z between z = 0 and its height, m."""
    return _revolved(lambda z: np.full_like(z, radius), height, degree)


def _revolved(profile: Callable[[Floats], Floats], height: float, degree: int) -> Rule:
    """Return the rule of a solid about z from z = 0 to its height, of radius profile(z), linear in z."""
    t, w = legendre.leggauss(degree + 2)
    share = (t + 1) / 2
    weight = w / 2
    turns = 2 * degree + 1
    angle = 2 * math.pi * (np.arange(turns) + 0.5) / turns
    z, s, a = np.meshgrid(height * share, share, angle, indexing="ij")
    edge = profile(z)
    points = np.stack([edge * s * np.cos(a), edge * s * np.sin(a), z], axis=-1)
    weights = height * weight[:, None, None] * weight[None, :, None] * (2 * math.pi / turns) * edge**2 * s
    return Rule(points.reshape(-1, 3), weights.ravel(), degree)


@checked(radius=positive, degree=_degree)
def ball_rule(radius: float, degree: int = DEGREE) -> Rule:
    """Return the rule of a ball about the origin, m."""
    t, w = legendre.leggauss(degree + 2)
    share = (t + 1) / 2
    weight = w / 2
    turns = 2 * degree + 1
    angle = 2 * math.pi * (np.arange(turns) + 0.5) / turns
    r, u, a = np.meshgrid(radius * share, t, angle, indexing="ij")
    across = np.sqrt(1 - u**2)
    points = np.stack([r * across * np.cos(a), r * across * np.sin(a), r * u], axis=-1)
    weights = radius * weight[:, None, None] * w[None, :, None] * (2 * math.pi / turns) * r**2
    return Rule(points.reshape(-1, 3), weights.ravel(), degree)


@checked(points=numbers((None, 3)), triangles=whole_numbers((None, 3)), degree=_degree)
def polyhedron_rule(points: ArrayLike, triangles: ArrayLike, degree: int = DEGREE) -> Rule:
    """Return a quadrature rule for the solid within a closed surface of triangles.

    The rule sums over the tetrahedra between each triangle and the mean of the points. Where the surface
    is not convex, some have negative volume, and the sum is equally exact.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        m.
    triangles : array_like, shape (T, 3)
        Corners, anticlockwise seen from outside.
    """
    corners = np.asarray(points, float)
    faces = _closed(whole_array("triangles", triangles, (None, 3), high=len(corners) - 1))
    middle = corners.mean(axis=0)
    edges = corners[faces] - middle
    if not np.linalg.det(edges).sum() > 0:
        raise ValueError(f"triangles is {shown(triangles)}; seen from outside, they must be anticlockwise")
    t, w = legendre.leggauss(degree + 2)
    share = (t + 1) / 2
    weight = w / 2
    a, b, c = (axis.ravel() for axis in np.meshgrid(share, share, share, indexing="ij"))
    places = np.stack([a * (1 - b), a * b * (1 - c), a * b * c], axis=-1)  # Duffy's collapsed cube
    collapsed = a**2 * b * np.einsum("i,j,k->ijk", weight, weight, weight).ravel()
    inside = middle + np.einsum("qe,tei->tqi", places, edges)
    weights = np.linalg.det(edges)[:, None] * collapsed
    return Rule(inside.reshape(-1, 3), weights.ravel(), degree)


def _closed(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return triangles (T, 3) of a closed surface: each edge occurs as often in one sense as in the other."""
    there = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    back = there[:, ::-1]
    if not len(faces) or (there[np.lexsort(there.T)] != back[np.lexsort(back.T)]).any():
        raise ValueError(f"triangles is {shown(faces.tolist())}; they must form a closed surface")
    return faces


# --- Rayleigh and Ritz ------------------------------------------------------------------------------


def _elasticity(name: str, value: object) -> Floats:
    """Return an elasticity tensor (3, 3, 3, 3) whose strain energy is positive."""
    given = array(name, value, (3, 3, 3, 3))
    for order in ((1, 0, 2, 3), (2, 3, 0, 1)):
        if abs(given - given.transpose(order)).max() > ROUNDING * abs(given).max():
            raise ValueError(f"{name} is {shown(value)}; C_ijkl, C_jikl and C_klij must be equal")
    weight = np.array([1.0, 1.0, 1.0, math.sqrt(2), math.sqrt(2), math.sqrt(2)])
    matrix = np.array([[given[i, j, k, l] for k, l in PAIRS] for i, j in PAIRS])  # noqa: E741
    if not np.linalg.eigvalsh(matrix * np.outer(weight, weight))[0] > 0:
        raise ValueError(f"{name} is {shown(value)}; the strain energy must be positive")
    return given


def _axes(name: str, value: object) -> Floats:
    """Return axes (3, 3), whose columns are unit vectors."""
    return np.asarray(units((3, 3))(name, array(name, value, (3, 3)).T).T)


@checked(
    rule=instance_of(Rule),
    density=positive,
    elasticity=_elasticity,
    axes=optional(_axes),
    marks=numbers((None, 3), (3,), (0,)),
)
def elastic_solid(
    rule: Rule, density: float, elasticity: ArrayLike, axes: ArrayLike | None = None, marks: ArrayLike = ()
) -> ElasticSolid:
    """Compute mass, inertia, frequencies and spin stretch of a free elastic solid.

    The polynomials have the degree of the rule; degree 8 has 495 unknowns. Their coordinates are the
    principal axes. In other axes, the polynomials of a flat, tilted solid would be almost dependent.

    Parameters
    ----------
    rule : Rule
        Quadrature rule of the solid.
    density : float
        kg/m^3.
    elasticity : array_like, shape (3, 3, 3, 3)
        `isotropic` or `orthotropic`, Pa.
    axes : array_like, shape (3, 3), optional
        The axes of spin, columns; those of the coordinates if not given.
    marks : array_like, shape (P, 3) or (3,), optional
        Points of the solid, m.
    """
    if len(rule.points) != len(rule.weights) or not rule.weights.sum() > 0:
        raise ValueError(
            f"rule has {len(rule.points)} points and {len(rule.weights)} weights of the sum "
            f"{rule.weights.sum():g}; it must have as many of both, of a positive sum"
        )
    mass = density * float(rule.weights.sum())
    centre = density * rule.weights @ rule.points / mass
    arm = rule.points - centre
    second = density * (rule.weights * arm.T) @ arm
    own = np.eye(3)
    if np.abs(second - np.diag(np.diag(second))).max() > 1e-9 * np.trace(second):
        own = np.linalg.eigh(second)[1]
    basis = _basis(rule._replace(points=arm @ own))
    root = np.linalg.inv(np.linalg.cholesky(basis.gram))  # root phi are orthonormal
    slopes = [root @ derivative for derivative in basis.derivatives]
    products = np.array([[a @ basis.gram @ b.T for b in slopes] for a in slopes])
    count = len(root)
    stiffness = np.asarray(elasticity, float)
    for _ in range(4):  # one index after the other
        stiffness = np.tensordot(stiffness, own, (0, 0))
    matrix = np.einsum("ikjl,klab->iajb", stiffness, products, optimize=True)
    matrix = matrix.reshape(3 * count, 3 * count)
    directions = own.T @ (np.eye(3) if axes is None else np.asarray(axes, float))
    across = np.eye(3) - np.einsum("in,jn->nij", directions, directions)
    # the force rho r of unit omega about each axis, its moments with all polynomials; it has no resultant
    forces = density * np.einsum("nij,aj->ian", across, root @ basis.arms).reshape(3 * count, 3)
    parts = [(block, *np.linalg.eigh(matrix[np.ix_(block, block)])) for block in _blocks(matrix)]
    every = np.sort(np.concatenate([values for _, values, _ in parts]))
    response = np.zeros_like(forces)
    for block, values, modes in parts:
        elastic = values > every[5]  # the six lowest are of rigid motion, 0 but for round-off
        load = modes[:, elastic].T @ forces[block]
        response[block] = modes[:, elastic] @ (load / values[elastic, None])
    inertia = np.einsum("nij,ij->n", across, own.T @ second @ own)
    stretch = 2 * np.sum(forces * response, axis=0) / inertia
    at = basis.at((np.reshape(np.asarray(marks, float), (-1, 3)) - centre) @ own) @ root.T
    moved = np.einsum("pa,ian,ji->npj", at, response.reshape(3, count, 3), own, optimize=True)
    return ElasticSolid(mass, centre, second, np.sqrt(every[6:] / density), stretch, moved)


def _blocks(matrix: Floats) -> list[NDArray[np.intp]]:
    """Return unknowns that a symmetric matrix couples: those of one parity, if the solid is symmetric."""
    coupled = np.abs(matrix) > 1e-13 * np.abs(matrix).max()
    np.fill_diagonal(coupled, True)
    label = np.arange(len(matrix))
    while True:
        lower = np.where(coupled, label, len(matrix)).min(axis=1)
        if (lower == label).all():
            return [np.flatnonzero(label == first) for first in np.unique(label)]
        label = lower


class _Basis(NamedTuple):
    """The n products phi of Legendre polynomials, by their integrals and derivatives."""

    gram: Floats
    """int phi_a phi_b, (n, n)"""
    derivatives: tuple[Floats, ...]
    """d phi_a/dx_k = sum of derivatives[k][a, b] phi_b, each (n, n)"""
    arms: Floats
    """int phi_a x, (n, 3)"""
    at: Callable[[Floats], Floats]
    """phi at points (Q, 3), (Q, n)"""


def _basis(rule: Rule) -> _Basis:
    degree = rule.degree
    low = rule.points.min(axis=0)
    high = rule.points.max(axis=0)
    middle = (high + low) / 2
    half = (high - low) / 2
    powers = np.array([p for p in np.ndindex((degree + 1,) * 3) if sum(p) <= degree])
    count = len(powers)
    gram = np.zeros((count, count))
    arms = np.zeros((count, 3))

    def at(points: Floats) -> Floats:
        t = (points - middle) / half
        x, y, z = (legendre.legvander(t[:, k], degree)[:, powers[:, k]] for k in range(3))
        return np.asarray(x * y * z)

    for start in range(0, len(rule.weights), CHUNK):
        points = rule.points[start : start + CHUNK]
        weights = rule.weights[start : start + CHUNK]
        phi = at(points)
        gram += phi.T @ (weights[:, None] * phi)
        arms += phi.T @ (weights[:, None] * points)
    index = {tuple(p): n for n, p in enumerate(powers.tolist())}
    derivatives = tuple(np.zeros((count, count)) for _ in range(3))
    for n, p in enumerate(powers.tolist()):
        for k in range(3):
            # P'_m = sum over j = m - 1, m - 3, ... of (2 j + 1) P_j
            for j in range(p[k] - 1, -1, -2):
                lower = tuple(j if axis == k else p[axis] for axis in range(3))
                derivatives[k][n, index[lower]] = (2 * j + 1) / half[k]
    return _Basis(gram, derivatives, arms, at)
