"""Placement and rigid motion of bodies, for the start of scenes and episodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from springgym.checks import array, flag, indices, instance, number, refusing_unknown
from springgym.model.bodies.body import Body
from springgym.model.bodies.equilibrium import relative_equilibrium
from springgym.model.bodies.rotations import aligning, cross, rotating
from springgym.model.bodies.rotations import axes as axes


class InitialState(NamedTuple):
    """The positions and velocities of a body at the start."""

    positions: np.ndarray
    """(N, 3) positions of the particles [m]"""
    velocities: np.ndarray
    """(N, 3) velocities of the particles [m/s]"""


@refusing_unknown
def rigid_velocities(positions: np.ndarray, omega: ArrayLike, about: ArrayLike) -> np.ndarray:
    """Return the velocities ω × (x − about) [m/s] of a rigid rotation, in the shape of ``positions``."""
    arms = array("positions", positions, (3,), (None, 3), (None, None, 3)) - array("about", about, (3,))
    return cross(array("omega", omega, (3,)), arms)


@refusing_unknown
def start(
    body: Body,
    *,
    tilt: float | None = None,
    azimuth: float = 0.0,
    roll: float = 0.0,
    hanging: bool = False,
    rotation: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    spin: float = 0.0,
    precession: float = 0.0,
    omega: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    position: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    velocity: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    pinned: tuple[int, ...] = (),
    gravity: Sequence[float] | np.ndarray | None = None,
    stretched: bool = True,
) -> InitialState:
    """Place a body and set it in rigid motion.

    With a tilt, the triad of the body (`Body.markers`) becomes Rz(azimuth) Ry(tilt) Rz(roll). Then the body
    is turned by ``rotation``. Its angular velocity is

    ω = omega + spin e₃ + precession (ẑ − (ẑ·e₃) e₃),

    so ``spin`` is the component of ω along the third axis (ω₃ of a top), and ``precession`` is dφ/dt.

    Parameters
    ----------
    body
        The body to place.
    tilt, azimuth, roll
        [rad]. The third axis is tilted from the vertical towards ``azimuth``, measured from x. Without a
        tilt, the body keeps its orientation.
    hanging
        Whether the body hangs from its first pin, instead of having a tilt. It is turned as little as
        possible, so that its centre of mass lies straight below the pin.
    rotation : (3,)
        A further rotation, as a vector along its axis [rad], in world axes.
    spin, precession
        [rad/s]
    omega : (3,)
        A further angular velocity [rad/s], in world axes.
    position, velocity : (3,)
        Position and velocity of the first pinned particle or, without one, of the centre of mass [m], [m/s].
    pinned
        Pinned particles.
    gravity : (3,), optional
        [m/s²], for the shape that supports the weight.
    stretched
        Whether to start in the shape of a steady motion under the weight (`relative_equilibrium`), which
        excites no vibration, instead of the unstretched shape.

    Raises
    ------
    TypeError
        If an argument has the wrong type, see `springgym.checks`.
    ValueError
        If a number is not finite, that shape does not exist, or the pins do not allow the motion.
    """
    instance("body", body, Body)
    tilt = None if tilt is None else number("tilt [rad]", tilt, -2 * np.pi, 2 * np.pi)
    azimuth = number("azimuth", azimuth)
    roll = number("roll", roll)
    spin = number("spin", spin)
    precession = number("precession", precession)
    hanging = flag("hanging", hanging)
    stretched = flag("stretched", stretched)
    rotation = array("rotation", rotation, (3,))
    omega = array("omega", omega, (3,))
    position = array("position", position, (3,))
    velocity = array("velocity", velocity, (3,))
    gravity = None if gravity is None else array("gravity", gravity, (3,))
    pinned = tuple(indices("pinned", pinned, len(body.masses)).tolist())
    if tilt is None and (azimuth or roll):
        raise ValueError(f"azimuth is {azimuth} and roll is {roll}; they must come with a tilt")
    if tilt is not None and hanging:
        raise ValueError(f"tilt is {tilt}; it must be left out for a body that hangs")
    own = axes(body.positions, body.markers)
    if hanging:
        if not pinned:
            raise ValueError(f"body {body.name!r} is not pinned: it cannot hang")
        arm = body.centre - body.positions[pinned[0]]
        if not np.linalg.norm(arm) > 1e-9 * np.ptp(body.positions, axis=0).max():
            raise ValueError(
                f"body {body.name!r} is pinned at its centre of mass: its hanging orientation is undefined"
            )
        place = aligning(arm, np.array([0.0, 0.0, -1.0]))
    elif tilt is not None:
        place = rotating((0, 0, azimuth)) @ rotating((0, tilt, 0)) @ rotating((0, 0, roll)) @ own.T
    else:
        place = np.eye(3)
    place = rotating(rotation) @ place
    third = place @ own[:, 2]
    rate = omega + spin * third + precession * (np.array([0.0, 0.0, 1.0]) - third[2] * third)
    shape = body.positions
    if stretched:
        pull = None if gravity is None else place.T @ gravity
        if pull is not None and body.floppy and pinned:  # the pull along the body
            along = body.centre - body.positions[pinned[0]]
            pull = along * (along @ pull) / (along @ along) if along.any() else None
        shape = relative_equilibrium(body, place.T @ rate, pinned, pull)
    reference = shape[pinned[0]] if pinned else body.masses @ shape / body.mass
    arm = (shape - reference) @ place.T
    velocities = cross(rate, arm) + velocity
    held = list(pinned)
    if np.abs(velocities[held]).max(initial=0.0) > 1e-9 * np.abs(velocities).max(initial=1.0):
        raise ValueError(
            f"body {body.name!r} is pinned at {held} and cannot have this motion: the pins would move"
        )
    velocities[held] = 0.0
    return InitialState(position + arm, velocities)
