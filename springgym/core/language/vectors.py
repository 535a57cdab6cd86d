"""Linear algebra on vectors in compiled code (`springgym.core.language.vec.Vec`), and rows of arrays as
vectors."""

from __future__ import annotations

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Block, Mask, Number, Numbers, Rows, Tensor, Vector
from springgym.core.language.lanes import epsilon as epsilon
from springgym.core.language.lanes import multiply_add, select, sqrt
from springgym.core.language.memory import load, load_each, store, store_each
from springgym.core.language.vec import vec as vec

GUARD = 1e-30
"""Added to a divisor or squared length that may be 0: keeps the quotient finite, and changes no other."""

ROUND_OFF = 1e-13 / 2.0**-52
"""Bound of a relative rounding error, in units of `epsilon`."""


@compiled
def row(array: Numbers, i: int) -> Vector:
    """Return ``array[i]`` of an array (rows, 3), as a vector."""
    return vec(load(array, (i, 0)), load(array, (i, 1)), load(array, (i, 2)))


@compiled
def set_row(array: Numbers, i: int, u: Vector) -> None:
    """Set ``array[i] = u``."""
    store(array, (i, 0), u[0])
    store(array, (i, 1), u[1])
    store(array, (i, 2), u[2])


@compiled
def row_each(array: Numbers, i: Number) -> Vector:
    """Return ``array[i]`` of an array (rows, 3) where each copy has its own index."""
    return vec(load_each(array, (i, 0)), load_each(array, (i, 1)), load_each(array, (i, 2)))


@compiled
def set_row_each(array: Numbers, i: Number, u: Vector) -> None:
    """Set ``array[i] = u`` where each copy has its own index."""
    store_each(array, (i, 0), u[0])
    store_each(array, (i, 1), u[1])
    store_each(array, (i, 2), u[2])


@compiled
def add_row(array: Numbers, i: int, u: Vector) -> None:
    """Add a vector to a row: ``array[i] += u``."""
    store(array, (i, 0), load(array, (i, 0)) + u[0])
    store(array, (i, 1), load(array, (i, 1)) + u[1])
    store(array, (i, 2), load(array, (i, 2)) + u[2])


@compiled
def add_scaled(array: Rows, i: int, s: Number, u: Vector) -> None:
    """Add a scaled vector to a row, ``array[i] += s u``, rounded once."""
    set_row(array, i, plus_scaled(row(array, i), s, u))


@compiled
def plus_scaled(w: Vector, s: Number, u: Vector) -> Vector:
    """Return w + s u, rounded once."""
    return vec(multiply_add(s, u[0], w[0]), multiply_add(s, u[1], w[1]), multiply_add(s, u[2], w[2]))


@compiled
def block(blocks: Rows, n: Number) -> Block:
    """Return rows 3 n to 3 n + 2 of an array (rows, 3), as the rows of a matrix."""
    return row(blocks, 3 * n), row(blocks, 3 * n + 1), row(blocks, 3 * n + 2)


@compiled
def apply(rows: Block, u: Vector) -> Vector:
    """Return the product of a matrix, by its rows, and a vector."""
    return vec(dot(rows[0], u), dot(rows[1], u), dot(rows[2], u))


@compiled
def vector(array: Numbers) -> Vector:
    """Return the three numbers of an array (3,) as a vector."""
    return vec(load(array, 0), load(array, 1), load(array, 2))


@compiled
def dot(u: Vector, w: Vector) -> Number:
    return multiply_add(u[2], w[2], multiply_add(u[1], w[1], u[0] * w[0]))


@compiled
def cross(u: Vector, w: Vector) -> Vector:
    return vec(u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0])


@compiled
def choose(mask: Mask, u: Vector, w: Vector) -> Vector:
    """Return ``u`` in the lanes where the mask holds, and ``w`` in the others."""
    return vec(select(mask, u[0], w[0]), select(mask, u[1], w[1]), select(mask, u[2], w[2]))


@compiled
def unit(u: Vector) -> Vector:
    return 1.0 / sqrt(dot(u, u) + GUARD) * u


@compiled
def triad(x: Rows, markers: np.ndarray) -> tuple[Vector, Vector, Vector]:
    """Return right-handed unit vectors (e1, e2, e3) that turn with the body.

    ``markers`` names three particles: e3 points from the first to the second, e1 from the first towards the
    third, made perpendicular to e3.
    """
    origin = row(x, markers[0])
    e3 = unit(row(x, markers[1]) - origin)
    sideways = row(x, markers[2]) - origin
    e1 = unit(sideways - dot(sideways, e3) * e3)
    return e1, cross(e3, e1), e3


@compiled
def mass_centre(x: Rows, mass: Numbers) -> Vector:
    """Return the centre of mass of the positions (or, given velocities, its velocity)."""
    total = load(mass, 0)
    first = total * row(x, 0)
    for i in range(1, mass.size):
        total = total + load(mass, i)
        first = first + load(mass, i) * row(x, i)
    return 1.0 / total * first


@compiled
def angular_momentum(x: Rows, v: Rows, mass: Numbers, about: Vector) -> Vector:
    """Return Σ m (x − about) × v."""
    total = load(mass, 0) * cross(row(x, 0) - about, row(v, 0))
    for i in range(1, mass.size):
        moment = cross(row(x, i) - about, row(v, i))
        total = total + load(mass, i) * moment
    return total


@compiled
def inertia(x: Rows, mass: Numbers, about: Vector) -> Tensor:
    """Return the inertia tensor Σ m (r² 1 − r rᵀ) about a point: (Ixx, Iyy, Izz, Ixy, Ixz, Iyz)."""
    r = row(x, 0) - about
    m = load(mass, 0)
    xx = m * r[0] * r[0]
    yy = m * r[1] * r[1]
    zz = m * r[2] * r[2]
    xy = m * r[0] * r[1]
    xz = m * r[0] * r[2]
    yz = m * r[1] * r[2]
    for i in range(1, mass.size):
        r = row(x, i) - about
        u = load(mass, i) * r
        xx = xx + u[0] * r[0]
        yy = yy + u[1] * r[1]
        zz = zz + u[2] * r[2]
        xy = xy + u[0] * r[1]
        xz = xz + u[0] * r[2]
        yz = yz + u[1] * r[2]
    return yy + zz, xx + zz, xx + yy, -xy, -xz, -yz


@compiled
def cofactors(tensor: Tensor) -> tuple[Vector, Vector, Vector, Number]:
    """Return the cofactors of a symmetric tensor (xx, yy, zz, xy, xz, yz), in rows, and its determinant."""
    xx, yy, zz, xy, xz, yz = tensor
    first = vec(yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy)
    second = vec(first[1], xx * zz - xz * xz, xy * xz - xx * yz)
    third = vec(first[2], second[2], xx * yy - xy * xy)
    return first, second, third, dot(vec(xx, xy, xz), first)


@compiled
def solve_symmetric(tensor: Tensor, b: Vector) -> Vector:
    """Return the solution of A u = b for the inertia A (xx, yy, zz, xy, xz, yz) of particles, by cofactors.

    For particles on a line along n, A = λ (1 − n nᵀ) is singular: the result is the smallest solution, b/λ
    without its part along n. For particles in one point, it is zero.
    """
    xx, yy, zz, _, _, _ = tensor
    first, second, third, determinant = cofactors(tensor)
    u = vec(dot(first, b), dot(second, b), dot(third, b))  # on a line λ² n nᵀ b
    size = 0.5 * (xx + yy + zz)
    straight = b - 1.0 / (first[0] + second[1] + third[2] + GUARD) * u
    flat = determinant <= ROUND_OFF * epsilon(size) * size * size * size
    return choose(flat, 1.0 / (size + GUARD) * straight, 1.0 / determinant * u)


@compiled
def inverse_symmetric(tensor: Tensor) -> tuple[Vector, Vector]:
    """Return the inverse of a symmetric tensor: diagonal (xx, yy, zz), off-diagonal entries (xy, xz, yz)."""
    xx, yy, zz, _, _, _ = tensor
    first, second, third, determinant = cofactors(tensor)
    size = 0.5 * (xx + yy + zz)
    flat = determinant <= ROUND_OFF * epsilon(size) * size * size * size
    share = 1.0 / (size + GUARD)
    trace = -1.0 * share / (first[0] + second[1] + third[2] + GUARD)
    scale = select(flat, trace, 1.0 / select(flat, 1.0, determinant))
    diagonal = scale * vec(first[0], second[1], third[2])
    diagonal = choose(flat, diagonal + vec(share, share, share), diagonal)
    return diagonal, scale * vec(first[1], first[2], second[2])


@compiled
def multiplied(diagonal: Vector, across: Vector, b: Vector) -> Vector:
    """Multiply a symmetric tensor, xx, yy, zz and xy, xz, yz, by a vector."""
    return vec(
        dot(vec(diagonal[0], across[0], across[1]), b),
        dot(vec(across[0], diagonal[1], across[2]), b),
        dot(vec(across[1], across[2], diagonal[2]), b),
    )
