"""Painting of bodies, and of the marks that they can hide."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from springgym.rendering.canvas import Array, Canvas, light_on
from springgym.rendering.look import GRAPHITE, GREEN, STEEL, Arrow, Color, Look, Point

THROUGH = 0.4
"""Factor of the opacity of a trace, an arrow or a target ball where a body hides it."""

COLD, NEUTRAL, HOT = np.array([[38, 96, 190], [172, 178, 188], [206, 48, 44]], dtype=float)
_SMOOTH = 0.8  # cosine between neighbouring faces above which their edge is not outlined
_GLASS = 0.14  # opacity of a body whose springs are shown
_TARGET = 0.5  # opacity of target balls


def strain_colors(strain: ArrayLike, scale: float) -> NDArray[np.uint8]:
    """Return blue for -scale, grey for 0, red for +scale; (S,) to (S, 3)."""
    x = np.nan_to_num(np.clip(np.asarray(strain, dtype=float) / scale, -1.0, 1.0))[:, None]
    return (NEUTRAL + np.abs(x) ** 0.8 * (np.where(x < 0.0, COLD, HOT) - NEUTRAL)).astype(np.uint8)


def circle(center: ArrayLike, radius: float, corners: int, normal: ArrayLike = (0, 0, 1)) -> Array:
    """Return points of a circle, (corners, 3), anticlockwise about its unit normal."""
    first, second = tangents(normal)
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)[:, None]
    return np.asarray(center) + radius * (np.cos(angle) * first + np.sin(angle) * second)


def tangents(normal: ArrayLike) -> tuple[Array, Array]:
    """Return two unit vectors that make a right-handed triad with the unit vector ``normal``."""
    n = np.asarray(normal, dtype=float)
    seed = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    first = seed - n * (seed @ n)
    first /= np.linalg.norm(first)
    return first, np.cross(n, first)


def body(
    canvas: Canvas, look: Look, x: Array, strain: Array | None, targets: Sequence[tuple[Point, float]] = ()
) -> None:
    """Paint bars, balls, surface, the springs if their strains are given, and target balls.

    Where springs are shown, the surface is translucent.
    """
    radii = np.asarray(look.radii)
    opacity = np.asarray(look.opacity)
    two_sided = opacity < 1.0
    balls = np.flatnonzero(radii > 0.0)
    canvas.bars(x[np.asarray(look.bars)], look.bar_radius, look.bar_colors)  # type: ignore[arg-type]
    canvas.bars(x[balls, None].repeat(2, axis=1), radii[balls], np.asarray(look.ball_colors)[balls])
    if strain is not None:
        canvas.strokes(x[np.asarray(look.springs)], 3.0, strain_colors(strain, look.strain_scale))
        opacity = np.minimum(opacity, _GLASS)
    edges = look.edges[(opacity[look.edges[:, [0, 2]]] == 1.0).all(axis=1)]
    mesh(canvas, x[np.asarray(look.triangles)], look.triangle_colors, opacity, two_sided, edges)  # type: ignore[arg-type]
    for place, radius in targets:
        canvas.bars(np.array([[place, place]], float), radius, GREEN, _TARGET, THROUGH)


def mesh(
    canvas: Canvas,
    corners: Array,
    colors: ArrayLike,
    opacity: ArrayLike = 1.0,
    two_sided: ArrayLike = False,
    edges: NDArray[np.intp] | None = None,
    through: float = 0.0,
) -> None:
    """Paint lit triangles (T, 3, 3) [m]: those that face the eye, and two-sided ones, (T,) or all.

    ``edges`` (`Look.edges`) are outlined where they are sharp or bound the silhouette.
    """
    if not len(corners):
        return
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(across, axis=1, keepdims=True)
    normal = across / np.maximum(size, 1e-300)
    to_eye = np.asarray(canvas.camera.eye) - corners.mean(axis=1)
    distance = np.linalg.norm(to_eye, axis=1, keepdims=True)
    to_eye /= distance
    facing = (normal * to_eye).sum(axis=1)
    factor, gloss = light_on(normal * np.sign(facing)[:, None], to_eye, canvas.light)
    paint = np.clip(np.asarray(colors) * factor + gloss, 0, 255)
    seen = (size[:, 0] > 0.0) & ((facing > 0.0) | np.asarray(two_sided))
    alpha = np.broadcast_to(np.asarray(opacity, float), len(corners))
    # translucent ones last, far to near; opaque ones near to far, so that most are hidden
    order = np.lexsort((np.where(alpha < 1.0, -1.0, 1.0) * distance[:, 0], alpha < 1.0))
    order = order[seen[order]]
    canvas.triangles(corners[order], paint[order], alpha[order], through)
    if edges is not None:
        face, start, other = edges.T
        smooth = (normal[face] * normal[other]).sum(axis=1) > _SMOOTH
        drawn = (seen[face] | seen[other]) & ~(seen[face] & seen[other] & smooth)
        ends = np.stack([corners[face, start], corners[face, (start + 1) % 3]], axis=1)
        dark = 0.55 * np.minimum(*(paint[np.where(seen[a], a, b)] for a, b in ((face, other), (other, face))))
        canvas.strokes(ends[drawn], 1.5, dark[drawn])


def rail(canvas: Canvas, start: ArrayLike, stop: ArrayLike, color: Color = STEEL) -> None:
    """Paint a slender bar, of steel if it belongs to the surroundings."""
    canvas.bars(np.array([[start, stop]], float), 0.006 * canvas.extent, color)


def dashes(canvas: Canvas, foot: ArrayLike, height: float) -> None:
    """Paint a dashed line upwards."""
    steps = np.linspace(0.0, height, 49)[:-1].reshape(-1, 2)  # start and end of each dash
    points = np.asarray(foot, dtype=float) + steps[..., None] * np.array([0.0, 0.0, 1.0])
    canvas.strokes(points, 1.4, GRAPHITE)


def arrow(canvas: Canvas, mark: Arrow) -> None:
    """Paint a bar with a cone, pale where it is hidden; nothing if the vector is too short to be seen."""
    vector = np.asarray(mark.vector, dtype=float)
    length = float(np.linalg.norm(vector))
    if not length > 0.004 * canvas.extent:
        return
    head = min(0.05 * canvas.extent, 0.6 * length)
    points, axis = arrow_path(mark, vector / length, length, head, np.asarray(canvas.camera.eye))
    neck = points[-1]
    tip = points[-1] + head * axis
    rim = circle(neck, 0.36 * head, 14, axis)
    turned = np.roll(rim, -1, axis=0)
    tips = np.broadcast_to(tip, rim.shape)
    hub = np.broadcast_to(neck, rim.shape)
    cone = np.concatenate([np.stack([rim, turned, tips], axis=1), np.stack([turned, rim, hub], axis=1)])
    canvas.bars(np.stack([points[:-1], points[1:]], axis=1), 0.13 * head, mark.color, through=THROUGH)
    mesh(canvas, cone, mark.color, through=THROUGH)


def arrow_path(mark: Arrow, axis: Array, length: float, head: float, eye: Array) -> tuple[Array, Array]:
    """Return points (25, 3) along an arrow up to its head, and the unit vector in which the head points.

    The middle of an arrow around an axis is turned to the eye.
    """
    origin = np.asarray(mark.origin, dtype=float)
    along = np.linspace(0.0, length - head, 25)[:, None]
    if not mark.radius:
        return origin + along * axis, axis
    front = eye - origin
    front -= (front @ axis) * axis
    size = float(np.linalg.norm(front))
    first = front / size if size > 1e-9 else tangents(axis)[0]
    second = np.cross(axis, first)
    angle = (along - 0.5 * length) / mark.radius
    points = origin + mark.radius * (np.cos(angle) * first + np.sin(angle) * second)
    return points, np.cos(angle[-1]) * second - np.sin(angle[-1]) * first
