"""Drawing of the background: sky, surfaces, target rings and the body's soft shadow."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from springgym.model.surfaces.surface import Surface
from springgym.rendering.canvas import OVERSAMPLE, Array, Canvas
from springgym.rendering.look import GREEN, Color, Look, Scenery
from springgym.rendering.raster import paint_triangles
from springgym.rendering.solids import circle, tangents

_SKY = np.array([[251, 252, 254], [222, 228, 237]], dtype=float)  # top and bottom
_MATT = np.array([247, 250, 255], dtype=float)  # surfaces in full light
_GRID: Color = (104, 121, 148)
_SHADOW: Color = (38, 46, 66)
_MASK = 3  # picture pixels per pixel of the shadow mask
_BLUR = 5  # width of the shadow's edge, mask pixels


class _Plane(NamedTuple):
    """A flat surface that is seen from its free side, and its visible patch."""

    point: Array
    normal: Array  # unit
    foot: Array  # of the camera's target, the middle of the visible patch
    reach: float  # radius of the patch, m
    others: tuple[tuple[Array, Array], ...]  # points and normals of the other surfaces

    def fade(self, points: Array) -> Array:
        """Return 1 in the middle of the patch to 0 at its rim, and 0 behind any other surface."""
        distance = np.linalg.norm(points - self.foot, axis=-1) / self.reach
        seen = np.ones(distance.shape, dtype=bool)
        for point, normal in self.others:
            seen &= (points - point) @ normal > -1e-6 * self.reach
        return np.where(seen, np.maximum(1.0 - distance**2, 0.0) ** 2, 0.0)


def _planes(canvas: Canvas, scenery: Scenery) -> list[_Plane]:
    flat = [] if scenery.floor is None else [((0.0, 0.0, scenery.floor), (0.0, 0.0, 1.0))]
    pairs = []
    for place, direction in [*flat, *scenery.planes]:
        point = np.asarray(place, dtype=float)
        normal = np.asarray(direction, dtype=float)
        normal = normal / np.linalg.norm(normal)
        if (np.asarray(canvas.camera.eye) - point) @ normal > 0.0:
            pairs.append((point, normal))
    target = np.asarray(canvas.camera.target)
    return [
        _Plane(
            point,
            normal,
            target - normal * ((target - point) @ normal),
            1.15 * canvas.extent,
            tuple(pairs[:k] + pairs[k + 1 :]),
        )
        for k, (point, normal) in enumerate(pairs)
    ]


def paint_background(canvas: Canvas, scenery: Scenery) -> None:
    """Paint the sky and everything that neither moves nor hides the body."""
    width, height = canvas.picture_size
    rows = np.linspace(0.0, 1.0, height)[:, None, None] ** 1.3
    colors = np.broadcast_to(_SKY[0] + rows * (_SKY[1] - _SKY[0]), (height, width, 3))
    eye = np.asarray(canvas.camera.eye)
    rays = canvas.camera.rays(canvas.picture_size)
    planes = _planes(canvas, scenery)
    target = np.asarray(canvas.camera.target)
    for plane in planes:
        speed = rays @ plane.normal
        time = np.where(speed < 0.0, ((plane.point - eye) @ plane.normal) / speed, np.nan)
        cover = plane.fade(eye + time[..., None] * rays)
        colors = _cover(colors, np.nan_to_num(cover), float(plane.normal @ canvas.light))
    for surface in scenery.surfaces:
        hit = surface.hit(eye, rays)
        if hit is not None:
            places, normals = hit
            cover = surface.fade(places, target, canvas.extent)
            colors = _cover(colors, np.nan_to_num(cover), np.nan_to_num(normals @ canvas.light))
    canvas.fill(colors)
    for plane in planes:
        _paint_grid(canvas, plane)
    for surface in scenery.surfaces:
        _paint_net(canvas, surface)
    for disk in scenery.disks:
        paint_disk(canvas, *disk)


def _cover(colors: Array, cover: Array, slope: ArrayLike) -> Array:
    """Lay a matt surface over colours; ``slope`` is the cosine between its normal and the light."""
    tone = _MATT * (0.88 + 0.12 * np.maximum(slope, 0.0))[..., None]
    return colors + (0.9 * cover)[..., None] * (tone - colors)


def _fading_paths(canvas: Canvas, paths: list[Array], fade: Callable[[Array], Array]) -> None:
    """Draw thin lines through the points (n, 3) of each path, as opaque as ``fade`` of their middles."""
    ends = np.concatenate([np.stack([path[:-1], path[1:]], axis=1) for path in paths])
    canvas.strokes(ends, 1.1, _GRID, fade(ends.mean(axis=1)))


def round_down(value: float) -> float:
    """Return the largest of 1, 2 or 5 times a power of ten that is not above."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(k * power for k in (1.0, 2.0, 5.0) if k * power <= value))


def _paint_grid(canvas: Canvas, plane: _Plane) -> None:
    spacing = round_down(canvas.extent / 6.0)
    first, second = tangents(plane.normal)
    center = plane.point + sum(
        spacing * np.round((plane.foot - plane.point) @ axis / spacing) * axis for axis in (first, second)
    )
    count = int(plane.reach / spacing) + 1
    along = np.linspace(-count, count, 16 * count + 1)[:, None] * spacing
    across = [spacing * k for k in range(-count, count + 1)]
    paths = [center + k * first + along * second for k in across]
    paths += [center + k * second + along * first for k in across]
    _fading_paths(canvas, paths, lambda middles: 0.5 * plane.fade(middles))


def _paint_net(canvas: Canvas, surface: Surface) -> None:
    """Paint rows and columns of a surface; where its back is towards the eye, they are fainter."""
    eye = np.asarray(canvas.camera.eye)
    target = np.asarray(canvas.camera.target)
    net = surface.net(target, canvas.extent)

    def fade(middles: Array) -> Array:
        back = surface.height(middles + 1e-3 * (eye - middles)) < surface.height(middles)
        return surface.fade(middles, target, canvas.extent) * np.where(back, 0.15, 0.6)

    paths = [*net[::4], *net[:, ::6].transpose(1, 0, 2)]
    _fading_paths(canvas, paths, fade)


def paint_disk(canvas: Canvas, center: ArrayLike, radius: float, color: Color, alpha: int = 255) -> None:
    """Draw a horizontal disk, by the part of its rim that is in front of the eye."""
    pixels, _ = canvas.image(circle(center, radius, 144))
    pixels = pixels[np.isfinite(pixels).all(axis=1)]
    if len(pixels) > 2:
        canvas.polygon(pixels, color, alpha)


def paint_ring(canvas: Canvas, center: ArrayLike, radius: float) -> None:
    """Draw a horizontal target ring, where it is not hidden."""
    points = circle(center, radius, 144)
    canvas.strokes(np.stack([points, np.roll(points, -1, axis=0)], axis=1), 2.6, GREEN, 0.9)


def paint_shadows(canvas: Canvas, look: Look, x: Array, scenery: Scenery) -> None:
    """Paint the shadow that the lamp casts on every surface that it lights."""
    light = canvas.light
    for plane in _planes(canvas, scenery):
        slope = float(light @ plane.normal)
        if slope > 0.2:

            def on_plane(p: Array, plane: _Plane = plane, slope: float = slope) -> Array:
                return p - light * (((p - plane.point) @ plane.normal) / slope)[..., None]

            _paint_shadow(canvas, look, x, on_plane)
    for surface in scenery.surfaces:
        if surface.hit(np.asarray(canvas.camera.eye), -light) is not None:

            def on_surface(p: Array, surface: Surface = surface) -> Array:
                hit = surface.hit(p, -light)
                assert hit is not None
                return hit[0]

            _paint_shadow(canvas, look, x, on_surface)


def _paint_shadow(canvas: Canvas, look: Look, x: Array, cast: Callable[[Array], Array]) -> None:
    """Fill the cast outlines on a coarse mask, blur it, and blend it over the canvas."""
    pygame = canvas.pygame
    bars = x[np.asarray(look.bars)]
    radii = np.asarray(look.radii)
    side = np.cross(bars[:, 1] - bars[:, 0], canvas.light)
    side *= (np.asarray(look.bar_radius) / np.maximum(np.linalg.norm(side, axis=1), 1e-12))[:, None]
    strips = np.stack([bars[:, 0] + side, bars[:, 1] + side, bars[:, 1] - side, bars[:, 0] - side], axis=1)
    balls = np.flatnonzero(radii > 0.0)
    rims = x[balls, None] + radii[balls, None, None] * circle((0, 0, 0), 1.0, 16, canvas.light)
    faces = np.concatenate([x[np.asarray(look.triangles)], _fans(strips), _fans(rims)])
    pixels = canvas.image(cast(faces))[0] / (_MASK * OVERSAMPLE)
    pixels = pixels[np.isfinite(pixels).all((1, 2))]
    if not len(pixels):
        return
    low = np.maximum(pixels.min((0, 1)) - _BLUR, 0).astype(int)
    high = np.minimum(pixels.max((0, 1)) + _BLUR + 1, np.array(canvas.picture_size) / _MASK).astype(int)
    if (high <= low).any():
        return
    width, height = (high - low).tolist()
    mask = np.zeros((width, height, 4), np.uint8)
    count = len(pixels)
    flat = np.zeros((height, width), np.float32).T, pixels - low, np.ones((count, 3))
    paint_triangles(mask[..., :3], *flat, np.full((count, 3), 255.0), np.ones((count, 2)))
    dark = np.pad(mask[..., 0].astype(np.float32), 1)
    for _ in range(_BLUR - 1):  # binomial blur
        dark[1:-1] = 0.5 * dark[1:-1] + 0.25 * (dark[2:] + dark[:-2])
        dark[:, 1:-1] = 0.5 * dark[:, 1:-1] + 0.25 * (dark[:, 2:] + dark[:, :-2])
    soft = pygame.Surface((width, height), pygame.SRCALPHA, 32)
    soft.fill((*_SHADOW, 0))
    alpha = pygame.surfarray.pixels_alpha(soft)
    alpha[:] = (0.26 * dark[1:-1, 1:-1]).astype(np.uint8)
    del alpha  # unlocks the surface
    fine = pygame.transform.smoothscale(soft, (width * _MASK, height * _MASK))
    wide = pygame.transform.scale_by(fine, OVERSAMPLE)
    canvas.lay(wide, (low * _MASK * OVERSAMPLE).tolist())


def _fans(outlines: Array) -> Array:
    """Return the triangles (T, 3, 3) of convex outlines (n, k, 3)."""
    corners = range(1, outlines.shape[1] - 1)
    return np.concatenate([outlines[:, [0, k, k + 1]] for k in corners])
