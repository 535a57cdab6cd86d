"""Perspective camera: world points in metres to pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from springgym.checks import TINY, array, number, readings, refusing_unknown, whole_array

POINTS = ((3,), (None, 3), (None, None, 3), (None, None, None, 3))  # shapes of points
WIDEST_PICTURE = 2**16  # most pixels of a side
WIDEST_MARGIN = 0.49
FARTHEST = 1e25  # largest coordinate of points that a camera is fitted to, m
FAR = 1e9  # largest coordinate of the target in `keeping`, over the camera's distance
WIDEST = float(np.nextafter(np.pi, 0.0))
_NEAR = 1e-3  # m; nearer points, and those behind the eye, have no image


def _toward(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Return the unit vector (3,) of a direction by its angles, rad, see `Camera.framing`."""
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def _size(size: object) -> tuple[Any, Any]:
    """Return width and height of a picture [pixels], after checking them."""
    width, height = array("size", size, (2,), low=1.0, high=WIDEST_PICTURE).tolist()
    return width, height


@refusing_unknown
@dataclass(frozen=True)
class Camera:
    """A pinhole camera whose picture keeps the world's z axis upright.

    Parameters
    ----------
    eye, target : tuple of 3 floats
        Position of the camera and the point in the middle of its picture, m.
    fov : float
        Vertical angle of view, rad, in (0, pi).

    Raises
    ------
    ValueError
        If ``eye`` and ``target`` coincide, are not finite or lie on one vertical, or if ``fov`` is
        out of range.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float = 0.5

    def __post_init__(self) -> None:
        for name in ("eye", "target"):
            point = array(f"Camera.{name}", getattr(self, name), (3,))
            object.__setattr__(self, name, tuple(point.tolist()))
        number("Camera.fov", self.fov, TINY, WIDEST)
        view = np.subtract(self.target, self.eye)
        if np.hypot(view[0], view[1]) < 1e-6 * max(1.0, float(np.linalg.norm(view))):
            raise ValueError(
                f"Camera.eye {self.eye} must not be straight above, below or at the target "
                f"{self.target}: move it sideways"
            )

    @property
    def distance(self) -> float:
        """Distance from the eye to the target [m]."""
        return float(np.linalg.norm(np.subtract(self.target, self.eye)))

    @classmethod
    def framing(
        cls, center: ArrayLike, size: float, azimuth: float = -1.0, elevation: float = 0.3, fov: float = 0.5
    ) -> Camera:
        """Return a camera for which a sphere just fits into the height of a picture.

        Parameters
        ----------
        center : (3,) array_like
            Centre of the sphere, m.
        size : float
            Its diameter, m.
        azimuth, elevation : float
            Direction from the centre to the eye: angle about z from x, and angle above the
            horizon, rad.
        fov : float
            Vertical angle of view, rad.

        Raises
        ------
        TypeError, ValueError
            If an argument is not a number, the centre not three numbers, or the camera is not possible.
        """
        size = number("size", size, TINY)
        azimuth = number("azimuth", azimuth)
        elevation = number("elevation", elevation)
        fov = number("fov", fov, TINY, WIDEST)
        middle = array("center", center, (3,))
        distance = 0.5 * size / np.sin(0.5 * fov)
        return cls(tuple(middle + distance * _toward(azimuth, elevation)), tuple(middle), fov)

    def keeping(self, points: ArrayLike, size: tuple[int, int], margin: float = 0.03) -> Camera:
        """Return this camera if it shows all of some points, else one from the same side that does.

        It comes no nearer, and goes as far away as needed to show them all. If they are so far out that
        rounding would blur pictures, this camera is returned.

        Parameters
        ----------
        points : (n, 3) array_like
            World points, m. Those that are not finite, or beyond `FARTHEST`, are ignored.
        size : tuple of 2 ints
            Width and height of the picture, pixels.
        margin : float
            Fraction of the picture at each edge that must stay free.
        """
        x = readings("points", points, (None, 3))
        size = _size(size)
        margin = number("margin", margin, 0.0, WIDEST_MARGIN)
        x = x[(np.abs(x) < FARTHEST).all(axis=1)]
        pixels, _ = self.project(x, size)
        rim = margin * np.array(size)
        if not len(x) or ((pixels > rim) & (pixels < size - rim)).all():
            return self
        middle = (x.min(axis=0) + x.max(axis=0)) / 2
        reach = float(np.linalg.norm(x - middle, axis=1).max()) / (1 - 2 * margin) ** 2
        away = np.subtract(self.eye, self.target)
        narrow = np.arctan(np.tan(0.5 * self.fov) * min(1.0, size[0] / size[1]))
        distance = max(float(np.linalg.norm(away)), reach / float(np.sin(narrow)))
        if float(np.abs(middle).max()) > FAR * distance:
            return self
        eye = middle + distance / float(np.linalg.norm(away)) * away
        return Camera(tuple(eye), tuple(middle), self.fov)

    @classmethod
    def fitting(
        cls,
        points: ArrayLike,
        size: tuple[int, int] = (1, 1),
        azimuth: float = -1.0,
        elevation: float = 0.3,
        fov: float = 0.5,
        margin: float = 0.08,
    ) -> Camera:
        """Return the nearest camera that shows all points in a picture.

        In axes right, up, forward, with t the tangent of half the angle of view, a point (a, b, c) is
        seen from the eye (α, β, γ) if |a − α| ≤ t (c − γ), and likewise for b. With
        u = max(a − t c) and l = min(a + t c), α = (u + l)/2 allows the largest γ, (l − u)/(2 t).

        Parameters
        ----------
        points : (..., 3) array_like
            m; those that are not finite, or beyond `FARTHEST`, are left out.
        size : tuple of 2 ints
            Width and height of the picture, of which only the ratio counts.
        azimuth, elevation : float
            Direction from the points to the eye, see `framing`, rad.
        fov : float
            Vertical angle of view, rad.
        margin : float
            Fraction of the picture that stays free at each edge.

        Raises
        ------
        ValueError
            If no point is finite and within `FARTHEST`.
        """
        x = readings("points", points, *POINTS).reshape(-1, 3)
        size = _size(size)
        margin = number("margin", margin, 0.0, WIDEST_MARGIN)
        azimuth = number("azimuth", azimuth)
        elevation = number("elevation", elevation)
        x = x[(np.abs(x) < FARTHEST).all(axis=1)]
        if not len(x):
            raise ValueError(f"points holds no finite point within {FARTHEST:g} m to fit into a picture")
        basis = cls(tuple(_toward(azimuth, elevation)), (0.0, 0.0, 0.0), fov).axes()
        a, b, c = basis @ x.T
        up = np.tan(0.5 * fov) * (1.0 - 2.0 * margin)
        eye = [0.0, 0.0]
        reach = []
        for n, (side, t) in enumerate(((a, up * size[0] / size[1]), (b, up))):
            low = (side + t * c).min()
            high = (side - t * c).max()
            eye[n] = 0.5 * (low + high)
            reach.append((low - high) / (2.0 * t))
        middle = 0.5 * (c.min() + c.max())
        near = min(*reach, c.min() - (0.05 * max(np.ptp(a), np.ptp(b), np.ptp(c)) or 1.0))
        across = np.array(eye) @ basis[:2]
        return cls(tuple(across + near * basis[2]), tuple(across + middle * basis[2]), fov)

    def moved(self, way: ArrayLike) -> Camera:
        """Move the camera by a vector (3,), m."""
        way = array("way", way, (3,))
        return replace(
            self, eye=tuple(np.add(self.eye, way).tolist()), target=tuple(np.add(self.target, way).tolist())
        )

    def axes(self) -> NDArray[np.float64]:
        """Return unit vectors right, up and forward of the picture, as the rows of a (3, 3) array."""
        forward = np.subtract(self.target, self.eye)
        forward /= np.linalg.norm(forward)
        right = np.array([forward[1], -forward[0], 0.0])  # forward x z
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(right, forward), forward])

    def pixels_per_radian(self, height: float) -> float:
        """Return the pixels per radian in the middle of a picture ``height`` pixels high."""
        return 0.5 * number("height", height, TINY) / float(np.tan(0.5 * self.fov))

    def project(
        self, points: ArrayLike, size: tuple[int, int]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Project points into a picture of ``size`` = (width, height) pixels.

        With a = p - eye, s = pixels_per_radian(height): x = W/2 + s (a.right)/(a.forward),
        y = H/2 - s (a.up)/(a.forward).

        Parameters
        ----------
        points : (..., 3) array_like
            World points, m.

        Returns
        -------
        pixels : (..., 2) array
            x to the right and y down from the top left corner; NaN where there is no image.
        depth : (...) array
            Distance along the view, m; NaN where there is no image.
        """
        width, height = _size(size)
        local = (readings("points", points, *POINTS) - self.eye) @ self.axes().T
        depth = np.where(local[..., 2] > _NEAR, local[..., 2], np.nan)
        flat = self.pixels_per_radian(height) * local[..., :2] / depth[..., None]
        return np.array([0.5 * width, 0.5 * height]) + flat * [1.0, -1.0], depth

    def rays(self, size: tuple[int, int]) -> NDArray[np.float64]:
        """Return unit vectors from the eye through the centres of the pixels, (height, width, 3)."""
        width, height = whole_array("size", size, (2,), low=1, high=WIDEST_PICTURE).tolist()
        x = (np.arange(width) + 0.5 - 0.5 * width) / self.pixels_per_radian(height)
        y = (np.arange(height) + 0.5 - 0.5 * height) / self.pixels_per_radian(height)
        right, up, forward = self.axes()
        rays = x[None, :, None] * right - y[:, None, None] * up + forward
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
