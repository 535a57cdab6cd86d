"""A body as one rigid body: its particles in principal axes, and its principal moments."""

from __future__ import annotations

from dataclasses import fields
from typing import NamedTuple

import numpy as np

from springgym.checks import instance
from springgym.dynamics.methods.record import Integrator, no_node
from springgym.model.bodies.motion import axes
from springgym.model.scene import Scene
from springgym.model.surfaces import PaperContact

ROUND_OFF = 1e-12
"""Relative difference below which moments are taken as equal."""

NEVER = 1e30
"""Moment of a body that does not turn [kg·m²]: a single particle, or a body that is all pinned."""


class Shape(NamedTuple):
    """The principal axes and moments of inertia of a body about its pin or centre of mass."""

    positions: np.ndarray
    """(N, 3) particles in principal axes, from the pin if there is one, else from the centre of mass [m]"""
    moments: np.ndarray
    """(3,) about that point [kg·m²]. The first two are those whose 1/I are closest to each other."""

    def triad(self, markers: tuple[int, int, int]) -> np.ndarray:
        """Return the body's triad in principal axes, as the rows of a matrix (3, 3)."""
        if self.moments[0] == NEVER:
            return np.eye(3)
        return np.ascontiguousarray(axes(self.positions, markers).T)

    def scaled(self, factor: float) -> Shape:
        """Return the shape in another size, with the same masses: I grows as the square of the factor."""
        never = self.moments[0] == NEVER
        return Shape(factor * self.positions, self.moments if never else factor**2 * self.moments)


def turns(scene: Scene) -> bool:
    """Return whether a scene's body can rotate."""
    return len(scene.body.masses) > 1 and bool(scene.free.any())


def principal_shape(scene: Scene, masses: np.ndarray | None = None) -> Shape:
    """Return the unstretched particles of a scene's body in principal axes about its pin or centre of mass.

    Parameters
    ----------
    scene
        Its body and pin are used.
    masses : (N,), optional
        Instead of those of the body [kg].

    Raises
    ------
    ValueError
        If a principal moment is zero to rounding.
    """
    body = scene.body if masses is None else scene.body.with_(masses=masses)
    if not turns(scene):
        return Shape(body.positions - body.centre, np.full(3, NEVER))
    about = body.positions[scene.pivot] if scene.pinned else body.centre
    moments, principal = body.principal(about)
    if not moments[0] > ROUND_OFF * moments[2]:
        raise ValueError(
            f"the principal moments of body {body.name!r} are {moments} kg·m²: as a rigid body it has no "
            "moment of inertia about one axis"
        )
    inverse = 1 / moments
    if inverse[0] - inverse[1] > inverse[1] - inverse[2]:
        order = [1, 2, 0]  # cyclic: the axes stay right-handed
        moments = moments[order]
        principal = principal[:, order]
    if abs(moments[1] - moments[0]) < ROUND_OFF * moments[1]:
        moments[:2] = moments[:2].mean()
    return Shape((body.positions - about) @ principal, moments)


def settled(
    scene: Scene, positions: np.ndarray, masses: np.ndarray, scales: np.ndarray, copies: np.ndarray
) -> np.ndarray:
    """Return the positions (k, N, 3) of particles moved onto the rigid shape by the body's markers [m].

    Parameters
    ----------
    scene
        Its body and pin are used.
    positions : (k, N, 3)
        [m]
    masses : (k, N)
        [kg]
    scales : (k,)
        Sizes, as factors of that of the scene's body.
    copies : (k,)
        The numbers of the copies, for error messages.

    Raises
    ------
    ValueError
        If the markers define no orientation.
    """
    if not turns(scene):
        return positions
    i, j, k = scene.body.markers
    third = positions[:, j] - positions[:, i]
    sideways = positions[:, k] - positions[:, i]
    across = np.linalg.norm(np.cross(third, sideways), axis=1)
    length = np.linalg.norm(third, axis=1)
    straight = ~(across > 1e-9 * length * np.linalg.norm(sideways, axis=1))
    if straight.any():
        raise ValueError(
            f"the markers {scene.body.markers} of body {scene.body.name!r} start on one line in copy "
            f"{copies[np.argmax(straight)]} and define no orientation; they must span a plane"
        )
    third = third / length[:, None]
    first = sideways - np.sum(sideways * third, axis=1)[:, None] * third
    first = first / np.linalg.norm(first, axis=1)[:, None]
    triad = np.stack([first, np.cross(third, first), third], axis=1)  # rows
    total = masses.sum(axis=1)[:, None]
    body = scene.body.positions
    if scene.pinned:
        here = positions[:, scene.pivot]
        about = body[scene.pivot][None]
    else:
        here = np.einsum("kn,knx->kx", masses, positions) / total
        about = masses @ body / total
    turn = axes(body, scene.body.markers) @ triad
    return here[:, None] + scales[:, None, None] * (body - about[:, None]) @ turn


UNDERSTOOD = {
    *("body", "positions", "velocities", "pinned", "gravity"),
    *("wrench", "thrust", "drive", "surfaces", "contact", "bodies", "collisions"),
}
"""Fields of a scene that rigid dynamics uses."""


def check_rigid(scene: Scene, method: Integrator) -> None:
    """Raise ValueError if a scene has no rigid twin.

    Raises
    ------
    ValueError
        With the reason: a moving body that is floppy, has its particles on one line, or has several but not
        all pinned; a drive; surfaces or collisions with a method that steps back in time; surfaces with the
        paper's contact; or a field that rigid dynamics does not support.
    """
    instance("scene", scene, Scene)
    instance("method", method, Integrator)
    if scene.meetings and not method.meets_bodies:
        raise ValueError(no_node(method))
    for part in scene.parts:
        _check_body(part)
        _check_rest(part, method)


def _check_body(scene: Scene) -> None:
    """Raise ValueError for a moving body that does not hold its shape, or has no inertia or orientation."""
    body = scene.body
    if not scene.free.any():
        return
    if body.floppy:
        raise ValueError(f"body {body.name!r} is meant to change shape: it has no rigid twin")
    if not turns(scene):
        return
    if _rank(body.positions) < 2:
        raise ValueError(
            f"the particles of body {body.name!r} lie on one line: as a rigid body it has no moment of "
            "inertia about it"
        )
    if _rank(body.positions[list(body.markers)]) < 2:
        raise ValueError(
            f"the markers {body.markers} of body {body.name!r} lie on one line and define no "
            "orientation; name three that span a plane"
        )
    if len(scene.pinned) > 1:
        raise ValueError(
            f"particles {scene.pinned} are pinned; a rigid body rotates about one point: pin one particle, "
            "or all of them"
        )


def _check_rest(scene: Scene, method: Integrator) -> None:
    """Raise ValueError if the scene has a drive, a surface or another field that a rigid body cannot have."""
    if scene.drive:
        raise ValueError("a rigid body cannot have a drive: the pin about which it rotates must stay at rest")
    if scene.surfaces:
        if method.negative_substeps:
            raise ValueError(
                f"{method.name} takes substeps back in time, in which contact is meaningless; use verlet"
            )
        if isinstance(scene.contact, PaperContact):
            raise ValueError("the paper's contact pushes single particles; give the rigid body a Contact")
    principal_shape(scene)
    for field in fields(scene):
        if field.name not in UNDERSTOOD and getattr(scene, field.name) != field.default:
            raise ValueError(f"rigid dynamics does not support {field.name}: leave it out of the scene")


def _rank(positions: np.ndarray) -> int:
    """Return 0, 1 or 2 for particles in one point, on one line, or neither."""
    arms = positions - positions.mean(axis=0)
    return int(np.linalg.matrix_rank(arms, tol=1e-9 * np.abs(arms).max(initial=1e-300)))


def highest_rate(scene: Scene) -> float:
    """Return the fastest rate [rad/s] of a scene's rigid bodies, from its start.

    It is the larger of the initial angular speed and √(M g d / I), with I the smallest moment about the pin,
    and d the distance of the centre of mass from it.
    """
    return max(max(map(_spin, scene.parts)), swing_rate(scene))


def _spin(part: Scene) -> float:
    """Return the initial angular speed [rad/s] of the rigid body with the same angular momentum."""
    if not turns(part):
        return 0.0
    body = part.body.with_(positions=part.positions)
    about = body.positions[part.pivot] if part.pinned else body.centre
    momentum = body.masses @ np.cross(body.positions - about, part.velocities)
    try:
        return float(np.linalg.norm(np.linalg.solve(body.inertia(about), momentum)))
    except np.linalg.LinAlgError:
        raise ValueError(
            f"the particles of body {body.name!r} start on one line: it has no rigid twin"
        ) from None


def swing_rate(scene: Scene) -> float:
    """√(M g d / I) [rad/s] as in `highest_rate`; 0 without pin or gravity."""
    return max(map(_swing_rate, scene.parts))


def _swing_rate(part: Scene) -> float:
    body = part.body
    if not (turns(part) and part.pinned) or part.gravity is None:
        return 0.0
    pin = body.positions[part.pivot]
    moments, _ = body.principal(pin)
    weight = body.mass * np.linalg.norm(part.gravity)
    return float(np.sqrt(weight * np.linalg.norm(body.centre - pin) / moments[0]))
