"""The precession of an elastic top. It differs from that of a rigid top: spin stretches the body, and
friction takes energy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from springgym.checks import array, indices, instance, number
from springgym.model.bodies.body import Body, ByValue, inertia, rigidity_matrix
from springgym.model.bodies.elasticity import spring_force_and_jacobian
from springgym.model.bodies.equilibrium import balanced, relative_equilibrium
from springgym.model.bodies.rotations import axes, rotation, skew
from springgym.theory.top import HeavyTop, steady_precession

UPRIGHT = 1e-6
"""Least tilt of a top that precesses [rad]."""

POSITIONS = 4
"""Number of angles about its axis over which a top is averaged; wood is anisotropic."""


def heavy_top(body: Body, pinned: Sequence[int], gravity: Sequence[float]) -> HeavyTop:
    """Return the rigid symmetric top of a body that is pinned on its axis.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If it is not pinned at one particle, or not symmetric about its axis; or gravity is not vertical, or
        does not pull it over.
    """
    pins = indices("pinned", pinned, len(instance("body", body, Body).masses))
    pull = array("gravity", gravity, (3,))
    if len(pins) != 1 or pull[:2].any():
        raise ValueError(f"body {body.name!r} is not a heavy top: it needs one pin, and vertical gravity")
    pin = body.positions[pins[0]]
    i1, i3 = axial_moments(body, pin, "heavy top")
    own = axes(body.positions, body.markers)
    arm = own.T @ (body.centre - pin)
    if np.abs(arm[:2]).max() > 1e-9 * abs(arm[2]):
        raise ValueError(f"body {body.name!r} is not a heavy top: it is not symmetric about its axis")
    moment = -body.mass * float(pull[2]) * float(arm[2])
    if not moment > 0:
        raise ValueError(f"body {body.name!r} is not a heavy top: gravity does not pull it over its pin")
    return HeavyTop(i1, i3, moment)


def axial_moments(body: Body, about: np.ndarray, kind: str = "symmetric top") -> tuple[float, float]:
    """Return the moments of inertia I₁ and I₃ across and along a body's third axis, about a point [kg·m²].

    ``kind`` is the name of such a body in error messages.

    Raises
    ------
    ValueError
        If the body is floppy, or its inertia not symmetric about that axis.
    """
    if body.floppy:
        raise ValueError(f"body {body.name!r} is not a {kind}: it is floppy")
    own = axes(body.positions, body.markers)
    tensor = own.T @ body.inertia(about) @ own
    i1 = float(tensor[0, 0])
    i3 = float(tensor[2, 2])
    if not np.abs(tensor - np.diag([i1, i1, i3])).max() <= 1e-9 * i1:
        raise ValueError(f"body {body.name!r} is not a {kind}: it is not symmetric about its axis")
    return i1, i3


def precession_gap(
    body: Body, pinned: tuple[int, ...], gravity: Sequence[float], tilt: float, spin: float
) -> float:
    """Return the relative difference of an elastic top's slow steady precession from that of the rigid one.

    In steady precession the top keeps its shape. The shape turns about the vertical together with the axis,
    and the particles pass through it. At each angle about the axis, the springs balance the weight and the
    rotation (`relative_equilibrium`). The weight has the moment T about the pin, and the turning shape has
    the angular momentum L. Then the rate Ω solves T = Ω ẑ × L.

    The result is valid as long as the body spins slowly compared with its vibrations.

    Parameters
    ----------
    body, pinned, gravity
        A heavy top: pinned at one particle on its axis, in vertical gravity (3,) [m/s²].
    tilt, spin
        θ [rad] and ω₃ [rad/s], of the rigid rotation with its angular momentum.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If the body is not a heavy top, if it stands upright, or if it has no such precession or shape.
    """
    tilt = number("tilt", tilt, UPRIGHT, math.pi - UPRIGHT)
    spin = number("spin", spin)
    top = heavy_top(body, pinned, gravity)
    try:
        rigid = steady_precession(top, tilt, spin)[0]
    except ValueError as error:
        raise ValueError(f"spin is {spin:g}: {error}") from error
    pin = int(indices("pinned", pinned, len(body.masses))[0])
    return _gap(ByValue(body), pin, -float(np.asarray(gravity)[2]), tilt, spin, float(rigid))


@lru_cache(maxsize=32)
def _gap(of: ByValue, pin: int, pull: float, tilt: float, spin: float, rigid: float) -> float:
    """Compute by what share a spring top precesses more slowly than a rigid one of rate ``rigid`` [rad/s]."""
    body = of.body
    own = axes(body.positions, body.markers)
    up = np.array([-np.sin(tilt), 0.0, np.cos(tilt)])  # in axes whose third is that of the top
    mass = body.masses[:, None]

    found: dict[float, np.ndarray] = {}  # the last shape at each angle, from which the next is sought

    def shape(turn: float, omega: np.ndarray) -> np.ndarray:
        """Return positions from the pin, in those axes, of the top turned by an angle about its own."""
        placed = rotation((0, 0, 1), turn) @ own.T
        near = found.get(turn, body.positions)
        found[turn] = x = balanced(body, placed.T @ omega, (pin,), -pull * placed.T @ up, near)
        return np.asarray((x - x[pin]) @ placed.T)

    def balance(rate: float, relative: float) -> tuple[float, float]:
        """Return Ω that the moment of the weight gives, and ω₃, for an assumed Ω and spin about the tilt."""
        omega = rate * up + np.array([0.0, 0.0, relative])
        torque = np.zeros(3)
        momentum = np.zeros(3)
        spun = 0.0
        for turn in 2 * np.pi * np.arange(POSITIONS) / POSITIONS + 0.1:
            before, x, after = (shape(turn + step, omega) for step in (-1e-3, 0.0, 1e-3))
            v = np.cross(rate * up, x) + relative * (after - before) / 2e-3
            own_momentum = np.sum(mass * np.cross(x, v), axis=0)
            spun += np.linalg.solve(inertia(x, mass[:, 0]), own_momentum)[2] / POSITIONS
            momentum += own_momentum / POSITIONS
            torque += np.cross(x, -pull * mass * up).sum(axis=0) / POSITIONS
        return float(torque[1] / np.cross(up, momentum)[1]), float(spun)

    rate = rigid
    relative = float(spin - rigid * np.cos(tilt))
    slope = (balance(1.001 * rate, relative)[0] - balance(rate, relative)[0]) / (1e-3 * rate) - 1
    for _ in range(20):  # Newton's method for the rate; the spin is corrected beside it
        given, spun = balance(rate, relative)
        change = (given - rate) / slope
        lack = spin - spun
        rate = rate - change
        relative = relative + lack
        if abs(change) < 1e-11 * abs(rate) and abs(lack) < 1e-11 * abs(spin):
            return rate / rigid - 1
    raise ValueError(f"body {body.name!r} has no steady precession with a spin of {spin:g} rad/s")


def wobble_growth(body: Body, spin: float) -> float:
    """Return the rate [1/s] at which internal friction makes a small wobble of a free symmetric body grow.

    Friction conserves the angular momentum L and reduces the energy L² (cos²θ/I₃ + sin²θ/I₁)/2, θ the angle
    between L and the axis: a slender body, I₁ > I₃, turns over, and a flat one comes to rest (a negative
    rate). This is the real part of the eigenvalue of the wobble, near i (I₃ − I₁) ω/I₁, of motion linearised
    about steady rotation in axes that turn with the body, with centrifugal and Coriolis forces:

    m ü = J u − D u̇ − 2 m ω × u̇ − m ω × (ω × u).

    Parameters
    ----------
    body
        A body whose third axis, see `Body.markers`, is one of symmetry.
    spin
        ω about it [rad/s].

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If it is not symmetric about its axis, or there is no steady shape at this spin.
    """
    spin = number("spin", spin)
    axial_moments(instance("body", body, Body), body.centre)
    axis = axes(body.positions, body.markers)[:, 2]
    shape = relative_equilibrium(body, spin * axis)
    _, jacobian = spring_force_and_jacobian(body, shape)
    rows = rigidity_matrix(shape, body.springs).reshape(len(body.springs), -1)
    dampers = rows.T @ (body.damping[:, None] * rows)
    mass = np.repeat(body.masses, 3)[:, None]
    turning = np.kron(np.eye(len(body.masses)), skew(spin * axis))
    size = len(mass)
    matrix = np.zeros((2 * size, 2 * size))
    matrix[:size, size:] = np.eye(size)
    matrix[size:, :size] = jacobian / mass - turning @ turning
    matrix[size:, size:] = -dampers / mass - 2 * turning
    r = shape - body.masses @ shape / body.mass
    along = float(np.sum(body.masses * ((r * r).sum(axis=1) - (r @ axis) ** 2)))
    across = float(np.sum(body.masses * ((r * r).sum(axis=1) + (r @ axis) ** 2))) / 2
    values = np.linalg.eigvals(matrix)
    wobble = 1j * (along - across) / across * spin
    return float(values[np.abs(values - wobble).argmin()].real)
