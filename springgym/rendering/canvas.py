"""Lit shapes on an oversampled pygame surface seen through a camera."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import ArrayLike, NDArray

from springgym.extras import missing
from springgym.rendering.camera import Camera

Array = NDArray[np.float64]

OVERSAMPLE = 3  # drawn this much larger, then averaged: smooth edges
_BAR_STRIPES = ((1.0, 0.6), (0.82, 0.78), (0.6, 0.93), (0.36, 1.05), (0.14, 1.18))  # width, light
_FLAT_STRIPE = ((1.0, 0.9),)
_AMBIENT = np.array([0.63, 0.65, 0.69])  # cool light from all around, a little more from above
_DIFFUSE = np.array([0.33, 0.31, 0.27])  # warm light from the lamp
_FAR = 16_000  # canvas pixels beyond which pygame's 16-bit polygons cannot go


def import_pygame() -> Any:
    """Import pygame, with its fonts and anti-aliased shapes.

    Raises
    ------
    gymnasium.error.DependencyNotInstalled
    """
    try:
        import pygame
        import pygame.font
        import pygame.gfxdraw
    except ImportError as error:
        raise DependencyNotInstalled(missing("drawing", "pygame", "render")) from error
    return pygame


def lamp(camera: Camera) -> Array:
    """Return a unit vector to the light: high up, over the viewer's left shoulder."""
    right, _, forward = camera.axes()
    ahead = np.array([forward[0], forward[1], 0.0]) / np.hypot(forward[0], forward[1])
    light = np.array([0.0, 0.0, 1.0]) - 0.32 * right - 0.45 * ahead
    return light / np.linalg.norm(light)


def shade(colors: ArrayLike, normals: Array, to_eye: Array, light: Array) -> NDArray[np.uint8]:
    """Compute the light on unit vectors, all (..., 3): sky, Lambert, and a little gloss (Blinn-Phong)."""
    half = light + to_eye
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    ambient = _AMBIENT * (1.0 + 0.10 * normals[..., 2:])
    diffuse = _DIFFUSE * np.maximum(normals @ light, 0.0)[..., None]
    gloss = 30.0 * np.maximum((normals * half).sum(-1), 0.0)[..., None] ** 24
    lit = np.asarray(colors) * (ambient + diffuse) + gloss
    return np.clip(lit, 0, 255).astype(np.uint8)


class Canvas:
    """A surface of ``OVERSAMPLE`` times the size of the picture, with ways to draw on it.

    Parameters
    ----------
    size : tuple of 2 ints
        Width and height of the finished picture.
    camera : Camera
    """

    def __init__(self, size: tuple[int, int], camera: Camera) -> None:
        self.pygame = import_pygame()
        self.camera = camera
        self.light = lamp(camera)
        self.picture_size = size
        self.size = (OVERSAMPLE * size[0], OVERSAMPLE * size[1])
        distance = camera.distance
        self.extent = size[1] / camera.pixels_per_radian(size[1]) * distance  # picture's height at target, m
        self._surface = self.pygame.Surface(self.size, 0, 32)
        self._layer = self.pygame.Surface(self.size, self.pygame.SRCALPHA, 32)
        self._picture = self.pygame.Surface(size, 0, 32)
        self._balls: dict[tuple[Any, ...], Any] = {}
        self.keep()

    def image(self, points: ArrayLike) -> tuple[Array, Array]:
        """Return canvas pixels (..., 2) and depth (...) of world points; NaN for points without an image."""
        pixels, depth = self.camera.project(points, self.size)
        pixels = np.where((np.abs(pixels) < _FAR).all(-1, keepdims=True), pixels, np.nan)
        return pixels, depth

    def pixels_per_meter(self, depth: ArrayLike) -> Array:
        """Return the canvas pixels a metre across the view at a depth."""
        return self.camera.pixels_per_radian(self.size[1]) / np.asarray(depth)

    def fill(self, colors: Array) -> None:
        """Colour the whole canvas by the pixels of the picture, (height, width, 3) in 0..255."""
        self.pygame.surfarray.blit_array(self._picture, np.rint(colors).astype(np.uint8).swapaxes(0, 1))
        self.pygame.transform.scale(self._picture, self.size, self._surface)

    def keep(self) -> None:
        """Make what has been drawn so far the background of every picture to come."""
        self._background = self._surface.copy()
        self._small = self.pygame.transform.smoothscale(self._surface, self.picture_size)
        self._touched = self.pygame.Rect(0, 0, 0, 0)

    def wipe(self) -> None:
        """Go back to the background."""
        self._surface.blit(self._background, self._touched, self._touched)
        self._touched = self.pygame.Rect(0, 0, 0, 0)

    def picture(self) -> Any:
        """Return the finished picture; only what was drawn on since `wipe` is averaged anew."""
        self._picture.blit(self._small, (0, 0))
        n = OVERSAMPLE
        left, top = self._touched.left // n, self._touched.top // n
        size = (-(-self._touched.right // n) - left, -(-self._touched.bottom // n) - top)
        if min(size) > 0:
            region = self._surface.subsurface((n * left, n * top, n * size[0], n * size[1]))
            self._picture.blit(self.pygame.transform.smoothscale(region, size), (left, top))
        return self._picture

    def lay(self, image: Any, corner: Any, area: Any = None) -> None:
        """Blend an image, or an area of it, over the canvas."""
        self._touch(self._surface.blit(image, corner, area))

    def _touch(self, box: Any) -> None:
        if box.width and box.height:
            self._touched = self._touched.union(box) if self._touched.width else box

    def polygon(self, pixels: Array, color: ArrayLike, alpha: int = 255) -> None:
        """Fill a polygon of (n, 2) pixels."""
        corners = np.rint(pixels).astype(int).tolist()
        rgb = np.asarray(color, dtype=int).tolist()
        if alpha == 255:
            self._touch(self.pygame.draw.polygon(self._surface, rgb, corners))
        else:
            low, high = np.min(corners, axis=0), np.max(corners, axis=0)
            box = self.pygame.Rect(low.tolist(), (high - low + 1).tolist())
            self._touch(box.clip(self._surface.get_rect()))
            self.pygame.gfxdraw.filled_polygon(self._surface, corners, (*rgb, alpha))

    def strokes(self, segments: Array, widths: ArrayLike, color: ArrayLike, alphas: Array) -> None:
        """Draw translucent segments (n, 2, 2) with round joints, not darker where they overlap.

        ``widths`` are in pixels of the finished picture, ``alphas`` in 0..1; the last one wins.
        """
        draw = self.pygame.draw
        half = np.broadcast_to(0.5 * OVERSAMPLE * np.asarray(widths), len(segments))
        seen = np.isfinite(segments).all((1, 2)) & (alphas > 1 / 255)
        if not seen.any():
            return
        segments, half, alphas = segments[seen], half[seen], alphas[seen]
        margin = half.max() + 2
        low = np.maximum(segments.min((0, 1)) - margin, 0)
        high = np.minimum(segments.max((0, 1)) + margin, self.size)
        if (high <= low).any():
            return
        box = (*low.astype(int).tolist(), *(high - low).astype(int).tolist())
        along = segments[:, 1] - segments[:, 0]
        length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
        side = along[:, ::-1] * [-1.0, 1.0] / length * half[:, None]
        corners = np.stack(
            [segments[:, 0] + side, segments[:, 1] + side, segments[:, 1] - side, segments[:, 0] - side],
            axis=1,
        )
        tangent = along / length
        bend = np.append((tangent[1:] * tangent[:-1]).sum(axis=1) < 0.98, True)
        self._layer.fill((0, 0, 0, 0), box)
        rgb = np.asarray(color, dtype=int).tolist()
        for quad, stop, radius, rounded, alpha in zip(
            np.rint(corners).astype(int).tolist(),
            np.rint(segments[:, 1]).astype(int).tolist(),
            half.tolist(),
            bend.tolist(),
            np.rint(255 * alphas).astype(int).tolist(),
            strict=True,
        ):
            paint = (*rgb, alpha)
            draw.polygon(self._layer, paint, quad)
            if rounded:
                draw.circle(self._layer, paint, stop, radius)
        self.lay(self._layer, box[:2], box)

    def line(self, ends: Array, width: float, color: ArrayLike) -> None:
        """Draw a flat line between two pixels (2, 2), ``width`` canvas pixels wide."""
        along = ends[1] - ends[0]
        side = np.array([-along[1], along[0]]) * (0.5 * width / max(float(np.hypot(*along)), 1e-9))
        self.polygon(np.concatenate([ends + side, (ends - side)[::-1]]), color)

    def bar(
        self, ends: Array, depth: Array, radius: float, color: ArrayLike, caps: bool = True, alpha: int = 255
    ) -> None:
        """Draw a round bar between pixels (2, 2) at depths (2,), radius in m: lit, or flat if translucent."""
        half = np.maximum(radius * self.pixels_per_meter(depth), 0.5 * OVERSAMPLE)
        along = ends[1] - ends[0]
        length = float(np.hypot(*along))
        right, up, _ = self.camera.axes()
        glow = np.array([right @ self.light, -(up @ self.light)])
        side = np.array([-along[1], along[0]]) / length if length > 1e-9 else glow
        tilt = float(side @ glow)
        rgb = np.asarray(color, dtype=float)
        for share, bright in _BAR_STRIPES if alpha == 255 else _FLAT_STRIPE:
            middle = ends + np.outer(half, side) * (0.75 * tilt * (1.0 - share))
            edge = np.outer(half * share, side)
            paint = np.clip(rgb * bright, 0, 255).astype(int).tolist()
            if caps:
                for center, r in zip(np.rint(middle).tolist(), half * share, strict=True):
                    self._touch(self.pygame.draw.circle(self._surface, paint, center, float(r)))
            self.polygon(np.concatenate([middle + edge, (middle - edge)[::-1]]), paint, alpha)

    def ball(
        self, center: Array, depth: float, radius: float, color: ArrayLike, opacity: float = 1.0
    ) -> None:
        """Draw a lit ball about a pixel, radius in m."""
        pixels = radius * float(self.pixels_per_meter(depth))
        if pixels > max(self.size):
            return
        sprite = self._ball_sprite(max(round(pixels), 1), tuple(np.asarray(color).tolist()), opacity)
        corner = np.rint(center - 0.5 * sprite.get_width()).astype(int)
        self.lay(sprite, corner.tolist())

    def _ball_sprite(self, radius: int, color: tuple[int, ...], opacity: float) -> Any:
        key = (radius, color, opacity)
        if key not in self._balls:
            grid = (np.arange(2 * radius + 2) - radius - 0.5) / radius
            x, y = np.meshgrid(grid, -grid)
            flat = np.hypot(x, y)
            normal = np.stack([x, y, np.sqrt(np.maximum(1.0 - flat**2, 0.0))], axis=-1)
            right, up, forward = self.camera.axes()
            world = normal @ np.array([right, up, -forward])
            rgb = shade(color, world, -forward, self.light)
            edge = np.clip((1.0 - flat) * radius + 0.5, 0.0, 1.0)
            alpha = (255 * edge * opacity).astype(np.uint8)
            rgba = np.concatenate([rgb, alpha[..., None]], axis=-1)
            image = self.pygame.image.frombuffer(rgba.tobytes(), rgba.shape[:2], "RGBA")
            if len(self._balls) > 256:
                self._balls.clear()
            self._balls[key] = image.copy()
        return self._balls[key]
