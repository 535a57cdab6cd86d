"""Shapes in which springs support a steady rotation and the weight."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import TINY, array, direction, indices, instance, number, refusing_unknown
from springgym.model.bodies.body import Body, ByValue, rigid_motions
from springgym.model.bodies.elasticity import spring_force_and_jacobian
from springgym.model.bodies.rotations import cross, skew
from springgym.model.records import read_only


@refusing_unknown
def relative_equilibrium(
    body: Body, omega: ArrayLike, pinned: tuple[int, ...] = (), gravity: ArrayLike | None = None
) -> np.ndarray:
    """Return the shape (N, 3) in which the springs support a rotation and the weight.

    Rotation stretches springs, so a body that starts in its unstretched shape vibrates. In the shape returned
    here, every particle satisfies

    spring forces + m g = m [ω × (ω × r) + α × r] (+ m g if nothing is pinned),

    where α follows from Euler's equation I α + ω × I ω = torque of the weight about the pin. In this shape,
    the body moves as a rigid body does. Rotation about a principal axis keeps the shape. In other motions the
    stresses change with time, and the remaining vibration is smaller by the ratio of ω to the frequencies of
    the body. The shape is found by Newton's method, without turning the body.

    Parameters
    ----------
    body
        The body. It rotates about its first pinned particle or, without pins, about its centre of mass.
    omega : (3,)
        Angular velocity ω [rad/s] in the axes of ``body.positions``.
    pinned
        Pinned particles.
    gravity : (3,), optional
        g [m/s²] in the same axes. A floppy body must hang along it.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If there is no such shape: the springs are too weak, the body is floppy, or a pin is off the axis.
    """
    instance("body", body, Body)
    omega = array("omega", omega, (3,))
    pinned = tuple(indices("pinned", pinned, len(body.masses)).tolist())
    pull = np.zeros(3) if gravity is None else array("gravity", gravity, (3,))
    return balanced(body, omega, pinned, pull, body.positions)


def balanced(
    body: Body, omega: np.ndarray, pinned: tuple[int, ...], pull: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Return the `relative_equilibrium`, sought from a shape (N, 3) with the same pins and orientation."""
    mass = body.masses[:, None]
    if not len(body.springs):
        return np.array(body.positions)
    weight = mass * (pull if pinned else np.zeros(3))
    centre = body.positions[pinned[0]] if pinned else body.centre
    free = np.setdiff1d(np.arange(len(mass)), pinned)
    turns = _kernel(_skews(body.positions[list(pinned)] - centre)) if pinned else np.eye(3)
    if np.linalg.norm(omega - turns @ (turns.T @ omega)) > 1e-9 * np.linalg.norm(omega):
        raise ValueError(f"body {body.name!r} is pinned at {list(pinned)} and cannot turn about {omega}")
    rigid = rigid_motions(body.positions, centre)[free].reshape(3 * len(free), 6)
    rigid = rigid[:, 3:] @ turns if pinned else rigid
    deforming = _kernel(rigid.T)  # displacements other than rigid motions
    unknown = (3 * free[:, None] + np.arange(3)).ravel()
    inwards = skew(omega) @ skew(omega)
    scale = (body.stiffness * body.lengths).max(initial=0.0)
    x = near.copy()
    residual = np.full_like(x, np.inf)
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):  # without a shape, the residual shows it
        for _ in range(50):
            r = x - (centre if pinned else body.masses @ x / body.mass)
            # as `springgym.model.bodies.body.inertia`, but summed at once: another order rounds starts
            # differently
            tensor = np.sum(mass * (r * r)) * np.eye(3) - (mass * r).T @ r
            torque = cross(r, weight).sum(axis=0) - cross(omega, tensor @ omega)
            alpha = turns @ np.linalg.lstsq(turns.T @ tensor @ turns, turns.T @ torque, rcond=1e-12)[0]
            turning = inwards + skew(alpha)
            force, jacobian = spring_force_and_jacobian(body, x)
            residual = force + weight - mass * (r @ turning.T)
            if np.abs(residual[free]).max(initial=0.0) < 1e-14 * scale:
                break
            jacobian.reshape(len(x), 3, len(x), 3)[free, :, free] -= mass[free, :, None] * turning
            matrix = deforming.T @ jacobian[np.ix_(unknown, unknown)] @ deforming
            step = deforming @ np.linalg.lstsq(matrix, -deforming.T @ residual[free].ravel(), rcond=1e-12)[0]
            x.reshape(-1)[unknown] += step
            if not np.abs(step).max() < 100 * np.ptp(body.positions, axis=0).max():
                break
    if not np.abs(residual[free]).max(initial=0.0) < 1e-9 * scale:
        raise ValueError(
            f"body {body.name!r} has no steady shape at ω = {omega!s} rad/s under gravity {pull!s}: "
            "its springs are too weak, or it is floppy and does not hang along gravity"
        )
    return x


POWERS = np.array([[8.0, 6.0, 4.0, 2.0, 0.0]])


@dataclass(frozen=True)
class StretchedShapes:
    """The `relative_equilibrium` shapes of a body for all spins up to ``fastest`` about one axis."""

    fastest: float
    """the largest spin [rad/s]"""
    coefficients: np.ndarray
    """(5, N, 3), of the powers 4 … 0 of (spin/fastest)²"""

    def __call__(self, spin: float | np.ndarray) -> np.ndarray:
        """Return the shape (N, 3) at a spin [rad/s], or shapes (k, N, 3) at several (k,)."""
        return self.at(array("spin", spin, (), (None,)))

    def at(self, spins: np.ndarray) -> np.ndarray:
        """Return the shapes at spins that have been checked."""
        powers = (spins / self.fastest)[..., None, None] ** POWERS
        shapes = powers @ self.coefficients.reshape(5, -1)
        return shapes.reshape(*spins.shape, *self.coefficients.shape[1:])


@refusing_unknown
def stretched_shapes(
    body: Body, axis: ArrayLike, fastest: float, pinned: tuple[int, ...] = ()
) -> StretchedShapes:
    """Return the `StretchedShapes` about an axis (3,) through the pin or the centre of mass.

    Springs are linear, so the shape is a smooth function of ω²: a polynomial through five of them, at
    Chebyshev's points, is exact to about (largest strain)⁵. Recent results are cached.
    """
    along = direction("axis", axis)
    fastest = number("fastest", fastest, low=TINY)
    held = tuple(indices("pinned", pinned, len(instance("body", body, Body).masses)).tolist())
    return StretchedShapes(fastest, _coefficients(ByValue(body), tuple(along.tolist()), fastest, held))


@lru_cache(maxsize=32)
def _coefficients(
    of: ByValue, along: tuple[float, ...], fastest: float, pinned: tuple[int, ...]
) -> np.ndarray:
    """Compute the coefficients of `StretchedShapes`, read-only, because later calls get the same array."""
    nodes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(5) + 0.5) / 5)  # ω²/fastest²
    spins = fastest * np.sqrt(nodes)
    shapes = [relative_equilibrium(of.body, spin * np.array(along), pinned) for spin in spins]
    found = np.linalg.solve(np.vander(nodes), np.reshape(shapes, (5, -1)))
    return read_only(found.reshape(5, *of.body.positions.shape))


def _skews(vectors: np.ndarray) -> np.ndarray:
    """Return the matrices of u × … for vectors (n, 3), one below the other: (3 n, 3)."""
    return np.cross(vectors[:, None, :], np.eye(3)).transpose(0, 2, 1).reshape(-1, 3)


def _kernel(matrix: np.ndarray) -> np.ndarray:
    """Return orthonormal columns that span the kernel of a matrix."""
    _, sizes, rows = np.linalg.svd(matrix)
    rank = int(np.sum(sizes > 1e-9 * sizes.max(initial=0.0)))
    return rows[rank:].T
