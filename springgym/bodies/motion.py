"""Orientations and motions to start from."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from springgym.bodies.body import Body, assembled, rigid_motions
from springgym.checks import TINY, array, direction, flag, indices, instance, number


class Start(NamedTuple):
    """Where a body starts, and how it moves."""

    positions: np.ndarray
    """(N, 3) [m]"""
    velocities: np.ndarray
    """(N, 3) [m/s]"""


def rotation(axis: Any, angle: float) -> np.ndarray:
    """Matrix (3, 3) of the rotation by ``angle`` [rad] about an axis (Rodrigues' formula)."""
    return _turned(direction("axis", axis), number("angle", angle))


def _turned(axis: np.ndarray, angle: float) -> np.ndarray:
    u = skew(axis)
    return np.eye(3) + np.sin(angle) * u + (1 - np.cos(angle)) * u @ u


def skew(u: np.ndarray) -> np.ndarray:
    """The matrix (3, 3) of u × …"""
    return np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])


def axes(positions: np.ndarray, frame: Sequence[int]) -> np.ndarray:
    """The triad of three particles (`Body.frame`) as the columns of a rotation (3, 3).

    Where they lie on a line, the first axis is any one across it; in a point, they are the world's.
    """
    i, j, k = frame
    third = positions[j] - positions[i]
    if not third.any():
        return np.eye(3)
    third = third / np.linalg.norm(third)
    across = np.eye(3) - np.outer(third, third)
    candidates = across @ np.column_stack([positions[k] - positions[i], np.eye(3)])
    size = np.linalg.norm(candidates, axis=0)
    reach = np.linalg.norm(positions[k] - positions[i])
    best = 0 if size[0] > 1e-9 * reach else 1 + int(np.argmax(size[1:]))
    first = candidates[:, best] / size[best]
    return np.column_stack([first, np.cross(third, first), third])


def spinning(positions: np.ndarray, omega: Any, about: Any) -> np.ndarray:
    """Velocities ω × (x − about) [m/s] of a rigid rotation, shape of ``positions``."""
    arms = array("positions", positions, (3,), (None, 3), (None, None, 3)) - array("about", about, (3,))
    return np.cross(array("omega", omega, (3,)), arms)


def start(
    body: Body,
    *,
    tilt: float | None = None,
    azimuth: float = 0.0,
    roll: float = 0.0,
    hanging: bool = False,
    turn: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    spin: float = 0.0,
    precession: float = 0.0,
    omega: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    position: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    velocity: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    pinned: tuple[int, ...] = (),
    gravity: Sequence[float] | np.ndarray | None = None,
    stretched: bool = True,
) -> Start:
    """Place a body and set it in rigid motion.

    Its triad (`Body.frame`) is put to Rz(azimuth) Ry(tilt) Rz(roll), if a tilt is given, the body then
    turned by ``turn``, and its angular velocity is

    ω = omega + spin e₃ + precession (ẑ − (ẑ·e₃) e₃),

    so that ``spin`` is all of ω along its third axis (ω₃ of a top) and ``precession`` is dφ/dt.

    Parameters
    ----------
    body
        What is placed.
    tilt, azimuth, roll
        [rad]; the third axis is tilted from the upright towards ``azimuth``, counted from x. Without a
        tilt, the body lies as it was made.
    hanging
        Whether it hangs from its first pin, the centre of mass straight below, turned as little as that
        takes, instead of having a tilt.
    turn : (3,)
        A further rotation, as a vector along its axis [rad], world axes.
    spin, precession
        [rad/s]
    omega : (3,)
        A further angular velocity [rad/s], world axes.
    position, velocity : (3,)
        Of the first pinned particle or, without one, of the centre of mass [m], [m/s].
    pinned
        Particles that are held.
    gravity : (3,), optional
        [m/s²], for the shape that carries the weight.
    stretched
        Whether to start in the shape that motion and weight hold (`relative_equilibrium`), so that no
        vibration is excited, rather than in the unstretched one.

    Raises
    ------
    TypeError
        Naming what is of the wrong kind, see `springgym.checks`.
    ValueError
        If a number is not finite, there is no such shape, or the pins do not allow the motion.
    """
    instance("body", body, Body)
    tilt = None if tilt is None else number("tilt", tilt)
    azimuth, roll = number("azimuth", azimuth), number("roll", roll)
    spin, precession = number("spin", spin), number("precession", precession)
    hanging, stretched = flag("hanging", hanging), flag("stretched", stretched)
    turn, omega = array("turn", turn, (3,)), array("omega", omega, (3,))
    position, velocity = array("position", position, (3,)), array("velocity", velocity, (3,))
    gravity = None if gravity is None else array("gravity", gravity, (3,))
    pinned = tuple(indices("pinned", pinned, len(body.masses)).tolist())
    if tilt is None and (azimuth or roll):
        raise ValueError(f"azimuth is {azimuth} and roll is {roll}; they must come with a tilt")
    if tilt is not None and hanging:
        raise ValueError(f"tilt is {tilt}; a body that hangs has none")
    own = axes(body.positions, body.frame)
    if hanging:
        if not pinned:
            raise ValueError(f"body {body.name!r} is not pinned: it cannot hang")
        arm = body.centre - body.positions[pinned[0]]
        if not np.linalg.norm(arm) > 1e-9 * np.ptp(body.positions, axis=0).max():
            raise ValueError(f"body {body.name!r} is pinned at its centre of mass: it hangs in no one way")
        place = _aligning(arm, np.array([0.0, 0.0, -1.0]))
    elif tilt is not None:
        place = _rotating((0, 0, azimuth)) @ _rotating((0, tilt, 0)) @ _rotating((0, 0, roll)) @ own.T
    else:
        place = np.eye(3)
    place = _rotating(turn) @ place
    third = place @ own[:, 2]
    rate = omega + spin * third
    rate = rate + precession * (np.array([0.0, 0.0, 1.0]) - third[2] * third)
    shape = body.positions
    if stretched:
        pull = None if gravity is None else place.T @ gravity
        if pull is not None and body.floppy and pinned:  # what it carries along itself
            along = body.centre - body.positions[pinned[0]]
            pull = along * (along @ pull) / (along @ along) if along.any() else None
        shape = relative_equilibrium(body, place.T @ rate, pinned, pull)
    reference = shape[pinned[0]] if pinned else body.masses @ shape / body.mass
    arm = (shape - reference) @ place.T
    velocities = spinning(arm, rate, (0.0, 0.0, 0.0)) + velocity
    held = list(pinned)
    if np.abs(velocities[held]).max(initial=0.0) > 1e-9 * np.abs(velocities).max(initial=1.0):
        raise ValueError(f"body {body.name!r} is pinned at {held} and cannot move so: the pins would move")
    velocities[held] = 0.0
    return Start(position + arm, velocities)


def _rotating(vector: Sequence[float] | np.ndarray) -> np.ndarray:
    """The rotation by a vector along its axis [rad]."""
    angle = float(np.linalg.norm(vector))
    return _turned(np.asarray(vector) / angle, angle) if angle >= TINY else np.eye(3)


def _aligning(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The least rotation that takes the direction of ``source`` to the unit vector ``target``."""
    source = source / np.linalg.norm(source)
    across = np.cross(source, target)
    size = float(np.linalg.norm(across))
    if size > 1e-12:
        return rotation(across, np.arctan2(size, source @ target))
    any_normal = np.cross(target, np.eye(3)[np.argmin(np.abs(target))])
    return np.eye(3) if source @ target > 0 else rotation(any_normal, np.pi)


def relative_equilibrium(
    body: Body, omega: Any, pinned: tuple[int, ...] = (), gravity: Any = None
) -> np.ndarray:
    """The shape (N, 3) in which the springs carry a rotation, and the weight.

    Rotation stretches springs; a body released in its unstretched shape therefore breathes. Here every
    particle satisfies

    spring forces + m g = m [ω × (ω × r) + α × r] (+ m g if nothing is pinned),

    where α follows from Euler's equation I α + ω × I ω = torque of the weight about the pin: the shape
    in which the body moves as a rigid one does. Rotation about a principal axis keeps it for good; in
    other motions the stresses change with time, and what is left of the breathing is smaller by the
    ratio of ω to the frequencies of the body. Found by Newton's method, without turning the body.

    Parameters
    ----------
    body
        What rotates: about its first pinned particle or, unpinned, about its centre of mass.
    omega : (3,)
        Angular velocity ω [rad/s] in the axes of ``body.positions``.
    pinned
        Particles that are held.
    gravity : (3,), optional
        g [m/s²] in the same axes. A floppy body must hang along it.

    Raises
    ------
    TypeError
        Naming what is of the wrong kind, see `springgym.checks`.
    ValueError
        If there is no such shape: the springs are too weak, the body is floppy, or a pin is off the axis.
    """
    instance("body", body, Body)
    omega, mass = array("omega", omega, (3,)), body.masses[:, None]
    pinned = tuple(indices("pinned", pinned, len(mass)).tolist())
    pull = np.zeros(3) if gravity is None else array("gravity", gravity, (3,))
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
    deforming = _kernel(rigid.T)  # displacements that are no rigid motion
    unknown = (3 * free[:, None] + np.arange(3)).ravel()
    scale = (body.stiffness * body.lengths).max(initial=0.0)
    x = body.positions.copy()
    residual = np.full_like(x, np.inf)
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):  # no shape: the residual says so
        for _ in range(50):
            r = x - (centre if pinned else body.masses @ x / body.mass)
            inertia = np.sum(mass * (r * r)) * np.eye(3) - (mass * r).T @ r
            torque = np.cross(r, weight).sum(axis=0) - np.cross(omega, inertia @ omega)
            alpha = turns @ np.linalg.lstsq(turns.T @ inertia @ turns, turns.T @ torque, rcond=1e-12)[0]
            turning = skew(omega) @ skew(omega) + skew(alpha)
            force, jacobian = spring_force_and_jacobian(body, x)
            residual = force + weight - mass * (r @ turning.T)
            if np.abs(residual[free]).max(initial=0.0) < 1e-14 * scale:
                break
            for i in free:
                jacobian[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] -= mass[i] * turning
            matrix = deforming.T @ jacobian[np.ix_(unknown, unknown)] @ deforming
            step = deforming @ np.linalg.lstsq(matrix, -deforming.T @ residual[free].ravel(), rcond=1e-12)[0]
            x.reshape(-1)[unknown] += step
            if not np.abs(step).max() < 100 * np.ptp(body.positions, axis=0).max():
                break
    if not np.abs(residual[free]).max(initial=0.0) < 1e-9 * scale:
        raise ValueError(
            f"body {body.name!r} has no steady shape at ω = {omega} rad/s under gravity {gravity}: "
            "its springs are too weak, or it is floppy and does not hang along gravity"
        )
    return x


@dataclass(frozen=True)
class StretchedShapes:
    """The `relative_equilibrium` shapes of a body for all spins up to ``fastest`` about one axis."""

    fastest: float
    """[rad/s]"""
    coefficients: np.ndarray
    """(5, N, 3), of the powers 4 … 0 of (spin/fastest)²"""

    def __call__(self, spin: float) -> np.ndarray:
        """The shape (N, 3) at a spin [rad/s]."""
        spin = number("spin", spin)
        return np.tensordot((spin / self.fastest) ** (2 * np.arange(4, -1, -1)), self.coefficients, 1)


def stretched_shapes(body: Body, axis: Any, fastest: float, pinned: tuple[int, ...] = ()) -> StretchedShapes:
    """Find the `StretchedShapes` about an axis (3,) through the pin or the centre of mass.

    Springs are linear, so the shape is a smooth function of ω²: a polynomial through five of them, at
    Chebyshev's points, is exact to about (largest strain)⁵.
    """
    along, fastest = direction("axis", axis), number("fastest", fastest, low=TINY)
    nodes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(5) + 0.5) / 5)  # ω²/fastest²
    shapes = [relative_equilibrium(body, fastest * np.sqrt(u) * along, pinned) for u in nodes]
    coefficients = np.linalg.solve(np.vander(nodes), np.reshape(shapes, (5, -1)))
    return StretchedShapes(fastest, coefficients.reshape(5, *body.positions.shape))


def _skews(vectors: np.ndarray) -> np.ndarray:
    """The matrices of u × … for vectors (n, 3), one below the other: (3 n, 3)."""
    return np.cross(vectors[:, None, :], np.eye(3)).transpose(0, 2, 1).reshape(-1, 3)


def _kernel(matrix: np.ndarray) -> np.ndarray:
    """Orthonormal columns that span what a matrix maps to zero."""
    _, sizes, rows = np.linalg.svd(matrix)
    rank = int(np.sum(sizes > 1e-9 * sizes.max(initial=0.0)))
    return rows[rank:].T


def spring_force_and_jacobian(body: Body, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Spring forces (N, 3) [N] and their derivative ∂F/∂x (3N, 3N) [N/m] at positions ``x``."""
    first, second = body.springs.T
    apart = x[second] - x[first]
    length = np.linalg.norm(apart, axis=1)
    along = apart / length[:, None]
    tension = body.stiffness * (length - body.lengths)
    force = np.zeros_like(x)
    np.add.at(force, first, tension[:, None] * along)
    np.add.at(force, second, -tension[:, None] * along)
    outer = along[:, :, None] * along[:, None, :]
    across = (tension / length)[:, None, None] * (np.eye(3) - outer)
    stiff = body.stiffness[:, None, None] * outer + across
    return force, assembled(-stiff, body.springs, len(x))
