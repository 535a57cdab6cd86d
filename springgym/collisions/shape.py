"""The features of a body that others meet: corners, faces and sharp edges, or balls and rods."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from springgym.bodies import Body, surface

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


@lru_cache(maxsize=1024)
def shape(body: Body) -> Shape:
    """Return the features of a body that others meet; `check_shape` tells whether they can."""
    if len(body.triangles):
        lines = surface.all_edges(body.triangles)
        return Shape(np.unique(body.triangles), body.triangles, body.edges, 0.0, lines)
    return Shape(np.arange(len(body.masses)), body.triangles, body.springs, body.radius, body.springs)


def check_shape(name: str, body: Body, reach: float) -> None:
    """Refuse a body that cannot collide with a reach Δ [m].

    Raises
    ------
    ValueError
        Naming the body and the reason.
    """
    if reason := _unfit(body, reach):
        raise ValueError(
            f"body {name!r} cannot collide: {reason}. Leave it out of the scene's collisions, or say "
            "collisions=None to let all bodies pass through each other"
        )


def _unfit(body: Body, reach: float) -> str | None:
    """Return why a body cannot collide with a reach Δ; None if it can."""
    given = shape(body)
    if not len(given.triangles):
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
