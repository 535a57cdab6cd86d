"""The features of a body that others meet: corners, faces and sharp edges, or balls, spheres and rods."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from springgym.bodies import Body, Round, surface

ABOUT = 1e-9
"""Share of its extent by which a sphere may be off the centre of mass, or off a sphere."""

THIN = 4
"""A body is at least so many Δ thick: what is deeper in it than half of that is nearer to the wrong side."""


class Shape(NamedTuple):
    """Features by the numbers of the body's particles."""

    vertices: np.ndarray
    """(V,) the corners of a closed surface, or all particles"""
    triangles: np.ndarray
    """(T, 3) the faces of a closed surface"""
    edges: np.ndarray
    """(E, 2) its sharp edges, or the rods of a body without faces: its springs"""
    radius: float
    """[m] of balls around the vertices and of rods; 0 for a closed surface"""
    lines: np.ndarray
    """(L, 2) all edges of the triangles, flat ones included"""
    turns: bool = False
    """whether the body is a sphere that turns, whose first particle contacts see at its centre of mass, see
    `as_met`"""


@lru_cache(maxsize=1024)
def shape(body: Body) -> Shape:
    """Return the features of a body that others meet; `check_shape` tells whether they can."""
    if len(body.triangles):
        lines = surface.all_edges(body.triangles)
        return Shape(np.unique(body.triangles), body.triangles, body.edges, 0.0, lines)
    if body.rounds:
        none = np.zeros((0, 2), int)
        return Shape(np.zeros(1, int), body.triangles, none, _radius_about_centre(body), none, turns=True)
    return Shape(np.arange(len(body.masses)), body.triangles, body.springs, body.radius, body.springs)


def _radius_about_centre(body: Body) -> float:
    """Return the radius [m] of a body's only feature, a sphere about its centre of mass; 0 of any other."""
    feature: Round = body.rounds[0]
    square = feature.matrix[0, 0]
    about = np.abs(feature.centre - body.centre).max() <= ABOUT * feature.extent
    ball = np.abs(feature.matrix - square * np.eye(3)).max() <= ABOUT * square
    carried = len(feature.carriers(len(body.masses))) == len(body.masses)
    return feature.extent if len(body.rounds) == 1 and about and ball and carried else 0.0


def as_met(
    shapes: Sequence[Shape], bodies: Sequence[Body], starts: np.ndarray, positions: np.ndarray
) -> np.ndarray:
    """Return positions (…, N, 3) of all particles, where the first of each sphere is at its centre of mass.

    The particles of the bodies begin at ``starts`` (bodies,) or (bodies + 1,).
    """
    if not any(shape.turns for shape in shapes):
        return positions
    positions = np.array(positions)
    for shape, body, first in zip(shapes, bodies, starts, strict=False):
        if shape.turns:
            own = positions[..., first : first + len(body.masses), :]
            own[..., 0, :] = np.einsum("i,...ij->...j", body.masses / body.mass, own)
    return positions


def check_shape(name: str, body: Body, reach: float, held: bool = False) -> None:
    """Refuse a body that cannot collide with a reach Δ [m]; ``held`` says that it is pinned in part.

    Raises
    ------
    ValueError
        Naming the body and the reason.
    """
    if reason := _unfit(body, reach, held):
        raise ValueError(
            f"body {name!r} cannot collide: {reason}. Leave it out of the scene's collisions, or say "
            "collisions=None to let all bodies pass through each other"
        )


def _unfit(body: Body, reach: float, held: bool) -> str | None:
    """Return why a body cannot collide with a reach Δ; None if it can."""
    given = shape(body)
    if given.turns:
        if held:
            return "it is a sphere that turns, and only some of its particles are pinned; pin all or none"
        if given.radius == 0:
            return (
                "of round features, others meet a single sphere about the centre of mass, which all "
                "particles carry, as `rolling_ball` makes it"
            )
    elif not len(given.triangles):
        if body.radius == 0:
            return "it has neither triangles nor a radius, so that there is nothing to meet"
    elif not body.closed:
        return "its triangles do not enclose it, and an open sheet has no inside to be kept out of"
    elif not _faces_out(body):
        return "its triangles enclose nothing, cut each other, or their normals point inwards"
    lines = given.lines
    if len(lines):
        ends = body.positions[lines]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        if lengths.min() < reach:
            i, j = lines[int(np.argmin(lengths))]
            return (
                f"its edge from particle {i} to {j} is {lengths.min():g} m long, and must not be shorter "
                f"than the reach of the contact, {reach:g} m"
            )
    if len(given.triangles) and body.thickness < THIN * reach:
        return (
            f"it is {body.thickness:g} m thick at its thinnest, and must be at least {THIN * reach:g} m, "
            f"{THIN} times the reach of the contact"
        )
    return None


@lru_cache(maxsize=1024)
def _faces_out(body: Body) -> bool:
    return surface.faces_out(body.positions, body.triangles)
