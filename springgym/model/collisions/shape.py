"""The features of a body that can touch others: corners, faces and edges, or balls, rods and capsules."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from springgym.checks import apart, instance
from springgym.model.bodies import Body, Round, surface

ABOUT = 1e-9
"""Tolerance of a sphere's position and shape, as a fraction of its extent."""

THIN = 4
"""Least thickness of a body in Δ: features deeper than half of it would be nearer to the wrong side."""


class Shape(NamedTuple):
    """Corners, edges and faces of a body that can touch others, as indices of its particles."""

    vertices: np.ndarray
    """(V,) the corners of a closed surface, or all particles"""
    triangles: np.ndarray
    """(T, 3) the faces of a closed surface"""
    edges: np.ndarray
    """(E, 2) its sharp edges, or the rods of a body without faces: its springs"""
    radius: float
    """radius of balls around the vertices and of rods [m]; 0 for a closed surface"""
    lines: np.ndarray
    """(L, 2) all edges of the triangles, flat ones included"""
    turns: bool = False
    """whether the body is a sphere that turns, whose first particle represents its centre of mass in
    contacts, see `as_met`"""
    skin: bool = False
    """whether friction acts at its skin, and so turns it: a sphere or a capsule"""


def shape(body: Body) -> Shape:
    """Return the features of a body that can touch others; `check_shape` checks that they are fit to."""
    return _shape(instance("body", body, Body))


@lru_cache(maxsize=1024)
def _shape(body: Body) -> Shape:
    if len(body.triangles):
        lines = surface.all_edges(body.triangles)
        return Shape(np.unique(body.triangles), body.triangles, body.edges, 0.0, lines)
    none = np.zeros((0, 2), int)
    if body.rounds:
        ends = _ends_of_capsule(body)
        if len(ends):
            rod = ends[None]
            return Shape(ends, body.triangles, rod, body.rounds[0].extent, rod, skin=True)
        radius = _radius_about_centre(body)
        return Shape(np.zeros(1, int), body.triangles, none, radius, none, turns=True, skin=True)
    return Shape(np.arange(len(body.masses)), body.triangles, body.springs, body.radius, body.springs)


def _radius_about_centre(body: Body) -> float:
    """Return the radius [m] of a body's only feature, a sphere about its centre of mass; 0 for any other."""
    feature: Round = body.rounds[0]
    about = np.abs(feature.centre - body.centre).max() <= ABOUT * feature.extent
    whole = _is_ball(feature) and _carried(feature, body)
    return feature.extent if len(body.rounds) == 1 and about and whole else 0.0


def _ends_of_capsule(body: Body) -> np.ndarray:
    """Return the two particles (2,) at the ends of a capsule's axis; an empty array if it is no capsule.

    Its features are two spheres of one radius about these particles, which all particles carry.
    """
    ends = np.zeros(0, int)
    if len(body.rounds) == 2:
        extent = body.rounds[0].extent
        apart = [np.abs(body.positions - feature.centre).max(axis=1) for feature in body.rounds]
        nearest = np.array([one.argmin() for one in apart])
        met = all(one.min() <= ABOUT * extent for one in apart) and nearest[0] != nearest[1]
        whole = all(_is_ball(feature) and _carried(feature, body) for feature in body.rounds)
        if met and whole and abs(body.rounds[1].extent - extent) <= ABOUT * extent:
            ends = nearest
    return ends


def _is_ball(feature: Round) -> bool:
    """Return whether a feature is a sphere."""
    square = feature.matrix[0, 0]
    return bool(np.abs(feature.matrix - square * np.eye(3)).max() <= ABOUT * square)


def _carried(feature: Round, body: Body) -> bool:
    """Return whether all particles of a body carry a feature."""
    return len(feature.carriers(len(body.masses))) == len(body.masses)


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


def check_shape(name: str, body: Body, reach: float, partly_pinned: bool = False) -> None:
    """Raise ValueError if a body, of which maybe only part is pinned, cannot collide with a margin Δ [m].

    Raises
    ------
    ValueError
        The message names the body and the reason.
    """
    if reason := _unfit(body, reach, partly_pinned):
        raise ValueError(
            f"body {name!r} cannot collide: {reason}. Leave it out of the scene's collisions, or say "
            "collisions=None to let all bodies pass through each other"
        )


def _unfit(body: Body, reach: float, partly_pinned: bool) -> str | None:
    """Return why a body cannot collide with a margin Δ [m]; None if it can."""
    given = shape(body)
    if given.skin and partly_pinned:
        return "it is round, and only some of its particles are pinned; pin all or none"
    if given.turns:
        if given.radius == 0:
            return (
                "only surfaces meet ellipsoids and disks. Other bodies meet one sphere about the centre of "
                "mass, as `rolling_ball` has, or two of one radius about two particles, as `capsule` has, if "
                "all particles carry them"
            )
    elif not len(given.triangles):
        if given.radius == 0:
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
            length, least = apart(lengths.min(), reach)
            return (
                f"its edge from particle {i} to {j} is {length} m long, and must not be shorter "
                f"than the reach of the contact, {least} m"
            )
    if len(given.triangles) and body.thickness < THIN * reach:
        thickness, least = apart(body.thickness, THIN * reach)
        return (
            f"it is {thickness} m thick at its thinnest, and must be at least {least} m, "
            f"{THIN} times the reach of the contact"
        )
    return None


@lru_cache(maxsize=1024)
def _faces_out(body: Body) -> bool:
    return surface.faces_out(body.positions, body.triangles)
