"""Lit shapes on an oversampled pygame surface seen through a camera."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import ArrayLike, NDArray

from springgym.core.extras import missing
from springgym.rendering.camera import Camera
from springgym.rendering.raster import paint_rods, paint_triangles

Array = NDArray[np.float64]

OVERSAMPLE = 3  # drawn this much larger, then averaged: smooth edges
_AMBIENT = np.array([0.63, 0.65, 0.69])  # cool ambient light, a little more from above
_DIFFUSE = np.array([0.33, 0.31, 0.27])  # warm light from the lamp
_SHEEN = 257  # size of the table of light on round things, by their normals
_FAR = 16_000  # limit of pygame's 16-bit polygons, canvas pixels


def import_pygame() -> Any:
    """Import pygame, with its fonts and translucent shapes.

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


def light_on(normals: Array, to_eye: Array, light: Array) -> tuple[Array, Array]:
    """Return the effect of light on colours: factors (..., 3), by sky and lamp (Lambert), and gloss (..., 1).

    The gloss (Blinn-Phong) is to be added. All arguments are unit vectors (..., 3).
    """
    half = light + to_eye
    half = half / np.linalg.norm(half, axis=-1, keepdims=True)
    ambient = _AMBIENT * (1.0 + 0.10 * normals[..., 2:])
    diffuse = _DIFFUSE * np.maximum(normals @ light, 0.0)[..., None]
    return ambient + diffuse, 30.0 * np.maximum((normals * half).sum(-1), 0.0)[..., None] ** 24


class Canvas:
    """A surface of ``OVERSAMPLE`` times the size of the picture, with methods to draw on it.

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
        self._picture = self.pygame.Surface(size, 0, 32)
        self._nearness, self._cover = np.zeros((2, *self.size[::-1]), np.float32).transpose(0, 2, 1)
        grid = np.linspace(-1.0, 1.0, _SHEEN)
        right = grid[:, None, None]
        up = grid[None, :, None]
        axes = camera.axes()
        normals = right * axes[0] + up * axes[1] - np.sqrt(np.maximum(1.0 - right**2 - up**2, 0.0)) * axes[2]
        self._sheen = np.concatenate(light_on(normals, -axes[2], self.light), axis=-1)
        self.keep()

    def image(self, points: ArrayLike) -> tuple[Array, Array]:
        """Return canvas pixels (..., 2) and depth (...) of world points; NaN for points without an image."""
        pixels, depth = self.camera.project(points, self.size)
        pixels = np.where((np.abs(pixels) < _FAR).all(-1, keepdims=True), pixels, np.nan)
        return pixels, depth

    def fill(self, colors: Array) -> None:
        """Colour the whole canvas by the pixels of the picture, (height, width, 3) in 0..255."""
        self.pygame.surfarray.blit_array(self._picture, np.rint(colors).astype(np.uint8).swapaxes(0, 1))
        self.pygame.transform.scale(self._picture, self.size, self._surface)

    def keep(self) -> None:
        """Make the present content the background of all later pictures."""
        self._background = self._surface.copy()
        self._small = self.pygame.transform.smoothscale(self._surface, self.picture_size)
        self._touched = self.pygame.Rect(0, 0, 0, 0)

    def wipe(self) -> None:
        """Reset the canvas to the background."""
        self._surface.blit(self._background, self._touched, self._touched)
        self._nearness[self._touched.left : self._touched.right] = 0.0
        self._touched = self.pygame.Rect(0, 0, 0, 0)

    def picture(self) -> Any:
        """Return the finished picture; only parts drawn on since `wipe` are averaged again."""
        self._picture.blit(self._small, (0, 0))
        n = OVERSAMPLE
        left = self._touched.left // n
        top = self._touched.top // n
        size = (-(-self._touched.right // n) - left, -(-self._touched.bottom // n) - top)
        if min(size) > 0:
            region = self._surface.subsurface((n * left, n * top, n * size[0], n * size[1]))
            self._picture.blit(self.pygame.transform.smoothscale(region, size), (left, top))
        return self._picture

    def lay(self, image: Any, corner: Any) -> None:
        """Blend an image over the canvas."""
        self._touch(self._surface.blit(image, corner))

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
            low = np.min(corners, axis=0)
            high = np.max(corners, axis=0)
            box = self.pygame.Rect(low.tolist(), (high - low + 1).tolist())
            self._touch(box.clip(self._surface.get_rect()))
            self.pygame.gfxdraw.filled_polygon(self._surface, corners, (*rgb, alpha))

    def triangles(self, corners: Array, colors: Array, alphas: Array, through: float = 0.0) -> None:
        """Paint triangles (T, 3, 3) [m] of colours (T, 3) and opacities (T,), translucent ones in this order.

        Where they are hidden, their opacity is multiplied by ``through``.
        """
        pixels, depth = self.image(corners)
        shown = np.isfinite(pixels).all((1, 2))
        tables = (pixels[shown], 1.0 / depth[shown], colors[shown], np.outer(alphas[shown], (1.0, through)))
        if self._reach(tables[0], 1.0):
            paint_triangles(self.pygame.surfarray.pixels3d(self._surface), self._nearness, *tables)

    def bars(
        self, ends: Array, radius: ArrayLike, colors: ArrayLike, alphas: ArrayLike = 1.0, through: float = 0.0
    ) -> None:
        """Paint lit round bars, or balls, between points (n, 2, 3), radius in m; see `triangles`."""
        size = np.broadcast_to(np.asarray(radius, float), len(ends))
        half = size[:, None] * (self.camera.pixels_per_radian(self.size[1]) / self.image(ends)[1])
        self._rods(ends, np.maximum(half, 0.5 * OVERSAMPLE), size, colors, alphas, through)

    def strokes(
        self, ends: Array, widths: ArrayLike, colors: ArrayLike, alphas: ArrayLike = 1.0, through: float = 0.0
    ) -> None:
        """Paint flat lines between points (n, 2, 3) [m], ``widths`` in pixels of the finished picture."""
        half = np.broadcast_to(0.5 * OVERSAMPLE * np.asarray(widths), len(ends))
        self._rods(ends, np.column_stack([half, half]), np.zeros(len(ends)), colors, alphas, through)

    def _rods(
        self, ends: Array, half: Array, radius: Array, colors: ArrayLike, alphas: ArrayLike, through: float
    ) -> None:
        pixels, depth = self.image(ends)
        opacity = np.broadcast_to(np.asarray(alphas, float), len(ends))
        shown = np.isfinite(pixels).all((1, 2)) & (half.max(axis=1, initial=0.0) < max(self.size))
        shown &= (depth > 1.01 * radius[:, None]).all(axis=1) & (opacity > 1 / 255)
        box = self._reach(pixels[shown], half[shown].max(initial=0.0))
        if box:
            self._cover[box] = 0.0
            paint_rods(
                self.pygame.surfarray.pixels3d(self._surface),
                self._nearness,
                self._cover,
                pixels[shown],
                1.0 / depth[shown],
                half[shown],
                radius[shown],
                np.broadcast_to(np.asarray(colors, float), (len(ends), 3))[shown],
                np.outer(opacity[shown], (1.0, through)),
                self._sheen,
            )

    def _reach(self, pixels: Array, margin: float) -> tuple[slice, slice] | None:
        """Mark the box around pixels (n, k, 2) as painted, and return it; None if it is empty."""
        if not len(pixels):
            return None
        low = np.floor(np.maximum(pixels.min((0, 1)) - margin, 0)).astype(int)
        high = np.ceil(np.minimum(pixels.max((0, 1)) + margin, self.size)).astype(int)
        if (high <= low).any():
            return None
        self._touch(self.pygame.Rect(low.tolist(), (high - low).tolist()))
        return slice(low[0], high[0]), slice(low[1], high[1])
