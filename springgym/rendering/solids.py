"""Solid things as items (depth, draw), to be drawn from the farthest to the nearest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import cycle

import numpy as np
from numpy.typing import ArrayLike, NDArray

from springgym.rendering.canvas import OVERSAMPLE, Array, Canvas, shade
from springgym.rendering.look import GRAPHITE, GREEN, STEEL, Arrow, Look, Point
from springgym.rendering.occlusion import Occluders

Item = tuple[float, Callable[[], None]]

THROUGH = 0.4
"""Opacity of a trace or an arrow where a body hides it."""

COLD, NEUTRAL, HOT = np.array([[38, 96, 190], [172, 178, 188], [206, 48, 44]], dtype=float)
_SMOOTH = 0.8  # cosine between neighbouring faces above which their edge is not outlined
_GLASS = 0.14  # opacity of a body whose springs are shown
_TARGET = 0.5  # opacity of target balls


def paint_all(items: list[Item]) -> None:
    """Draw items from the farthest to the nearest."""
    for _, draw in sorted(items, key=lambda item: -item[0]):
        draw()


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


def opacities(look: Look, strain: Array | None) -> Array:
    """Return the opacity (T,) of the triangles: where springs are shown, the surface is glass."""
    whole = np.asarray(look.opacity)
    return whole if strain is None else np.minimum(whole, _GLASS)


def body(
    canvas: Canvas, look: Look, x: Array, strain: Array | None, targets: Sequence[tuple[Point, float]] = ()
) -> list[Item]:
    """Draw surface, bars, balls, and the springs if their strains are given; among them target balls."""
    opacity = opacities(look, strain)
    faces = x[np.asarray(look.triangles)]
    normal, _ = normals(faces)
    keys = depths(canvas, faces, normal, look.solids)
    eye, (corners, _) = np.asarray(canvas.camera.eye), canvas.image(faces)
    items = mesh(
        canvas,
        faces,
        np.asarray(look.triangle_colors),
        opacity,
        two_sided=np.asarray(look.opacity) < 1.0,
        edges=look.edges[(opacity[look.edges[:, [0, 2]]] == 1.0).all(axis=1)],
        keys=keys,
    )
    radii = np.asarray(look.radii)
    pixels, depth = canvas.image(x)

    pairs = np.asarray(look.bars)
    ends, trimmed = x[pairs], np.zeros(len(x))
    trimmed[: len(radii)] = radii  # a bar starts at the skin of its ball
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    for pair, end, unit, full, radius, color in zip(
        pairs,
        ends,
        along / np.maximum(length, 1e-12)[:, None],
        length,
        np.asarray(look.bar_radius),
        np.asarray(look.bar_colors),
        strict=True,
    ):
        cut = np.sqrt(np.maximum(trimmed[pair] ** 2 - radius**2, 0.0))
        if full > cut.sum():
            shown, far = canvas.image([end[0] + cut[0] * unit, end[1] - cut[1] * unit])
            if np.isfinite(shown).all():
                items.append((far.mean(), partial(canvas.bar, shown, far, radius, color)))

    own = zip(x, pixels, depth, radii, np.asarray(look.ball_colors), cycle((1.0,)), strict=False)
    marked = [
        (np.asarray(place), *canvas.image(place), radius, np.array(GREEN), _TARGET)
        for place, radius in targets
    ]
    for place, center, far, radius, color, whole in (*own, *marked):
        if radius > 0.0 and np.isfinite(center).all():
            size = radius * float(canvas.pixels_per_meter(far))
            under = keys[beneath(eye, faces, corners, normal, place, center, size, radius)]
            key = min(far, under.min(initial=np.inf) * (1 - 1e-9))
            items.append((key, partial(canvas.ball, center, far, radius, color, whole)))

    if strain is not None:
        springs = np.asarray(look.springs)
        middle = depth[springs].mean(axis=1)
        for end, far, color in zip(
            pixels[springs], middle, strain_colors(strain, look.strain_scale), strict=True
        ):
            if np.isfinite(end).all():
                items.append((far, partial(canvas.line, end, 2.6 * OVERSAMPLE, color)))
    return items


def mesh(
    canvas: Canvas,
    corners: Array,
    colors: ArrayLike,
    opacity: ArrayLike = 1.0,
    two_sided: ArrayLike = False,
    edges: NDArray[np.intp] | None = None,
    keys: Array | None = None,
) -> list[Item]:
    """Draw lit triangles (T, 3, 3): those that face the eye, and two-sided ones, (T,) or all.

    ``edges`` (`Look.edges`) are outlined where they are sharp or bound the silhouette. The faces are painted
    in the order of ``keys`` (T,), the largest first, in place of that of their middles.
    """
    if not len(corners):
        return []
    normal, size = normals(corners)
    to_eye = np.asarray(canvas.camera.eye) - corners.mean(axis=1)
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    facing = (normal * to_eye).sum(axis=1)
    paint = shade(colors, normal * np.sign(facing)[:, None], to_eye, canvas.light)
    pixels, depth = canvas.image(corners)
    middle = depth.mean(axis=1) if keys is None else keys
    seen = np.isfinite(pixels).all((1, 2)) & (size[:, 0] > 0.0)
    seen &= (facing > 0.0) | np.asarray(two_sided)
    alpha = np.rint(255 * np.broadcast_to(opacity, len(corners))).astype(int).tolist()
    items: list[Item] = [
        (middle[i], partial(canvas.polygon, pixels[i], paint[i], alpha[i])) for i in np.flatnonzero(seen)
    ]
    if edges is not None:
        face, start, other = edges.T
        smooth = (normal[face] * normal[other]).sum(axis=1) > _SMOOTH
        drawn = (seen[face] | seen[other]) & ~(seen[face] & seen[other] & smooth)
        ends = np.stack([pixels[face, start], pixels[face, (start + 1) % 3]], axis=1)
        near = np.minimum(*(np.where(seen[i], middle[i], np.inf) for i in (face, other)))
        dark = 0.55 * np.minimum(*(paint[np.where(seen[a], a, b)] for a, b in ((face, other), (other, face))))
        for i in np.flatnonzero(drawn & np.isfinite(ends).all((1, 2))):
            items.append((near[i], partial(canvas.line, ends[i], 1.1 * OVERSAMPLE, dark[i])))
    return items


def normals(faces: Array) -> tuple[Array, Array]:
    """Return unit normals (T, 3) of faces (T, 3, 3) and twice their areas (T, 1); both may be 0."""
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    return normal / np.maximum(size, 1e-300), size


def depths(canvas: Canvas, corners: Array, normal: Array, solids: NDArray[np.intp]) -> Array:
    """Return the depths (T,) by which faces (T, 3, 3) are painted: those of their middles, for one solid.

    Of several ``solids`` (`Look.solids`) one is painted whole before the next: what lies on a large face may
    be farther than its middle.
    """
    pixels, depth = canvas.image(corners)
    middle = depth.mean(axis=1) if len(depth) else np.zeros(0)
    if not len(solids) or solids.max() == 0:
        return middle
    return one_by_one(solids, corners, normal, middle, pixels, np.asarray(canvas.camera.eye))


def beneath(
    eye: Array,
    corners: Array,
    pixels: Array,
    normal: Array,
    place: Array,
    center: Array,
    size: float,
    radius: float,
) -> NDArray[np.bool_]:
    """Return which faces (T, 3, 3) a ball hides, if any: they look at the eye, and it is outside of them.

    Their middles may be nearer than the ball's. ``pixels`` (T, 3, 2) is where their corners are seen,
    ``center`` and ``size`` the ball's place and radius there.
    """
    if not len(corners):
        return np.zeros(0, bool)
    looks = ((eye - corners[:, 0]) * normal).sum(axis=1) > 0.0
    outside = ((place - corners[:, 0]) * normal).sum(axis=1) > 0.9 * radius
    meets = (pixels.min(axis=1) <= center + size).all(axis=1)
    meets &= (pixels.max(axis=1) >= center - size).all(axis=1)
    return looks & outside & meets


def one_by_one(
    solids: NDArray[np.intp], corners: Array, normal: Array, middle: Array, pixels: Array, eye: Array
) -> Array:
    """Return depths (T,) by which each solid is painted whole, those behind others first.

    One of two that are apart is in front if a face of either parts them and the eye is on its side; where no
    face does, and where more than two hide each other in turn, the nearer one is.
    """
    count = int(solids.max()) + 1
    own = [np.flatnonzero(solids == n) for n in range(count)]
    points = [np.unique(corners[of].reshape(-1, 3), axis=0) for of in own]
    far = np.array([middle[of].mean() for of in own])
    low = np.array([pixels[of].min(axis=(0, 1)) for of in own])
    high = np.array([pixels[of].max(axis=(0, 1)) for of in own])
    meets = (low[:, None] <= high).all(axis=2)
    behind = np.zeros((count, count), bool)  # [n, m]: n is painted before m
    for n, m in np.argwhere(np.tril(meets & meets.T, -1)).tolist():
        back = is_behind(n, m, own, points, corners, normal, eye)
        behind[n, m] = far[n] >= far[m] if back is None else back
        behind[m, n] = not behind[n, m]
    before = behind.sum(axis=0)  # how many are left that are painted before each
    left, depth, key = np.ones(count, bool), middle.copy(), np.inf
    for _ in range(count):
        free = left & (before == 0)
        n = int(np.argmax(np.where(free if free.any() else left, far, -np.inf)))
        left[n] = False
        before -= behind[n]
        key = min(far[n], key - 1e-6 * abs(key)) if np.isfinite(key) else far[n]
        depth[own[n]] = key + 1e-9 * (middle[own[n]] - far[n])
    return depth


def is_behind(
    n: int,
    m: int,
    own: list[NDArray[np.intp]],
    points: list[Array],
    corners: Array,
    normal: Array,
    eye: Array,
) -> bool | None:
    """Return whether solid n lies behind m, by the face of either that parts them most; None if none does."""
    best, found = 0.0, None
    for one, other in ((n, m), (m, n)):
        on = corners[own[one], 0]
        size = float(np.ptp(points[one], axis=0).max())
        along = normal[own[one]]
        apart = (along @ points[other].T).min(axis=1) - (on * along).sum(axis=1)
        face = int(np.argmax(apart))
        share = float(apart[face]) / size + 0.02  # what touches may be a little in the other's plane
        if share > best:
            best = share
            outside = float((eye - on[face]) @ normal[own[one][face]]) > 0.0
            found = outside == (one == n)
    return found


def tube(canvas: Canvas, points: Array, radius: float, color: ArrayLike, opacity: Array) -> list[Item]:
    """Draw a round bar along points (n, 3), in pieces of their own opacity (n − 1,) and depth."""
    pixels, depth = canvas.image(points)
    return [
        (far.mean(), partial(canvas.bar, ends, far, radius, color, False, round(255 * whole)))
        for ends, far, whole in zip(
            np.stack([pixels[:-1], pixels[1:]], axis=1),
            np.stack([depth[:-1], depth[1:]], axis=1),
            opacity.tolist(),
            strict=True,
        )
        if whole > 0.0 and np.isfinite(ends).all()
    ]


def rail(canvas: Canvas, start: ArrayLike, stop: ArrayLike, occluders: Occluders) -> list[Item]:
    """Draw a slender bar that belongs to the surroundings, where it is not hidden."""
    ends = np.asarray(start, dtype=float), np.asarray(stop, dtype=float)
    points = ends[0] + np.linspace(0.0, 1.0, 97)[:, None] * (ends[1] - ends[0])
    shown = 1.0 - occluders.hide(0.5 * (points[:-1] + points[1:]))
    return tube(canvas, points, 0.006 * canvas.extent, STEEL, shown)


def dashes(canvas: Canvas, foot: ArrayLike, height: float, occluders: Occluders) -> list[Item]:
    """Draw a dashed line upwards, where it is not hidden."""
    steps = np.linspace(0.0, height, 49)[:-1].reshape(-1, 2)  # start and end of each dash
    points = np.asarray(foot, dtype=float) + steps[..., None] * np.array([0.0, 0.0, 1.0])
    pixels, depth = canvas.image(points[~occluders.hide(points.mean(axis=1))])
    return [
        (far.mean(), partial(canvas.line, ends, 1.4 * OVERSAMPLE, GRAPHITE))
        for ends, far in zip(pixels, depth, strict=True)
        if np.isfinite(ends).all()
    ]


def arrow(canvas: Canvas, mark: Arrow, occluders: Occluders) -> list[Item]:
    """Draw a bar with a cone, pale where it is hidden; nothing if the vector is negligible in the picture."""
    vector = np.asarray(mark.vector, dtype=float)
    length = float(np.linalg.norm(vector))
    if not length > 0.004 * canvas.extent:
        return []
    head = min(0.05 * canvas.extent, 0.6 * length)
    points, axis = arrow_path(mark, vector / length, length, head, np.asarray(canvas.camera.eye))
    neck, tip = points[-1], points[-1] + head * axis
    middles = np.vstack([0.5 * (points[:-1] + points[1:]), 0.5 * (neck + tip)])
    opacity = np.where(occluders.hide(middles), THROUGH, 1.0)
    rim = circle(neck, 0.36 * head, 14, axis)
    turned = np.roll(rim, -1, axis=0)
    tips, hub = np.broadcast_to(tip, rim.shape), np.broadcast_to(neck, rim.shape)
    cone = np.concatenate([np.stack([rim, turned, tips], axis=1), np.stack([turned, rim, hub], axis=1)])
    shaft = tube(canvas, points, 0.13 * head, mark.color, opacity[:-1])
    return shaft + mesh(canvas, cone, mark.color, opacity[-1])


def arrow_path(mark: Arrow, axis: Array, length: float, head: float, eye: Array) -> tuple[Array, Array]:
    """Return points (25, 3) along an arrow up to its head, and the unit vector in which the head points.

    The middle of an arrow around an axis is turned to the eye.
    """
    origin, along = np.asarray(mark.origin, dtype=float), np.linspace(0.0, length - head, 25)[:, None]
    if not mark.radius:
        return origin + along * axis, axis
    front = eye - origin
    front -= (front @ axis) * axis
    size = float(np.linalg.norm(front))
    first = front / size if size > 1e-9 else tangents(axis)[0]
    second, angle = np.cross(axis, first), (along - 0.5 * length) / mark.radius
    points = origin + mark.radius * (np.cos(angle) * first + np.sin(angle) * second)
    return points, np.cos(angle[-1]) * second - np.sin(angle[-1]) * first
