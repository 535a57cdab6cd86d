"""Rasterisation of triangles and round bars, with a depth buffer.

A frame has its colours (W, H, 3) from 0 to 255, and the nearness (W, H) of opaque objects: 1 over the depth
[1/m], which is linear in the picture along straight lines; 0 where there is nothing. Objects have two
opacities, where they are visible and where something nearer hides them.
"""

from __future__ import annotations

import math

import numpy as np

from springgym.core.compiler.decorators import compiled, kernel


@kernel
def paint_triangles(
    colors: np.ndarray,
    nearness: np.ndarray,
    corners: np.ndarray,
    near: np.ndarray,
    paint: np.ndarray,
    alphas: np.ndarray,
) -> None:
    """Paint triangles of corners (T, 3, 2) [pixels], nearness (T, 3), colours (T, 3) and opacities (T, 2)."""
    for n in range(len(corners)):
        (ax, ay), (bx, by), (cx, cy) = corners[n]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        second = near[n, 1] - near[n, 0]
        third = near[n, 2] - near[n, 0]
        rise = (second * (cy - ay) - third * (by - ay)) / area
        fall = (third * (bx - ax) - second * (cx - ax)) / area
        for y in range(max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)) + 1, colors.shape[1])):
            left, right = math.inf, -math.inf  # where the centres of this row's pixels enter and leave
            for k in range(3):
                px, py = corners[n, k]
                qx, qy = corners[n, (k + 1) % 3]
                if (py <= y + 0.5) != (qy <= y + 0.5):
                    crossing = px + (y + 0.5 - py) / (qy - py) * (qx - px)
                    left = min(left, crossing)
                    right = max(right, crossing)
            if left < right:
                for x in range(max(math.ceil(left - 0.5), 0), min(math.ceil(right - 0.5), colors.shape[0])):
                    here = near[n, 0] + rise * (x + 0.5 - ax) + fall * (y + 0.5 - ay)
                    alpha = alphas[n, 1 if here < nearness[x, y] else 0]
                    if alpha >= 1.0:
                        nearness[x, y] = here
                    blend(colors, x, y, alpha, paint[n, 0], paint[n, 1], paint[n, 2])


@kernel
def paint_rods(
    colors: np.ndarray,
    nearness: np.ndarray,
    cover: np.ndarray,
    ends: np.ndarray,
    near: np.ndarray,
    half: np.ndarray,
    radius: np.ndarray,
    paint: np.ndarray,
    alphas: np.ndarray,
    sheen: np.ndarray,
) -> None:
    """Paint rods with round ends; a ball is a rod without length.

    Parameters
    ----------
    cover
        (W, H) opacity already painted, so that overlapping rods are not darker.
    ends, near, half
        (n, 2, 2) and half widths (n, 2) [pixels], nearness (n, 2).
    radius
        (n,) [m]; 0 for flat lines, which are visible on surfaces that they lie on.
    paint, alphas
        Colours (n, 3) and opacities (n, 2).
    sheen
        (K, K, 4) light on round objects, by the normal to the right and up: colour factors, and gloss.
    """
    for n in range(len(ends)):
        (x0, y0), (x1, y1) = ends[n]
        dx = x1 - x0
        dy = y1 - y0
        square = dx * dx + dy * dy
        wide = max(half[n, 0], half[n, 1])
        top = max(int(min(y0, y1) - wide), 0)
        bottom = min(int(max(y0, y1) + wide) + 1, colors.shape[1])
        for y in range(top, bottom):
            first, last = 0.0, 1.0  # the part of the axis that is near this row
            if abs(dy) > 1e-6:
                up = (y + 0.5 - wide - y0) / dy
                low = (y + 0.5 + wide - y0) / dy
                first = max(min(up, low), 0.0)
                last = min(max(up, low), 1.0)
            left = min(first * dx, last * dx) - wide + x0
            right = max(first * dx, last * dx) + wide + x0
            for x in range(max(int(left), 0), min(int(right) + 1, colors.shape[0])):
                across = x + 0.5 - x0
                down = y + 0.5 - y0
                t = min(max((across * dx + down * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
                size = half[n, 0] + t * (half[n, 1] - half[n, 0])
                u = (across - t * dx) / size
                v = (t * dy - down) / size
                rise = 1.0 - u * u - v * v
                if rise < 0.0:
                    continue
                here = near[n, 0] + t * (near[n, 1] - near[n, 0])
                here = here / (1.0 - here * radius[n] * math.sqrt(rise)) if radius[n] else here * ON_IT
                alpha = alphas[n, 1 if here < nearness[x, y] else 0]
                if alpha >= 1.0:
                    nearness[x, y] = here
                elif alpha <= cover[x, y]:
                    continue
                else:
                    cover[x, y], alpha = alpha, (alpha - cover[x, y]) / (1.0 - cover[x, y])
                red = paint[n, 0]
                green = paint[n, 1]
                blue = paint[n, 2]
                if radius[n]:
                    middle = 0.5 * (len(sheen) - 1)
                    light = sheen[int(middle * (1.0 + u) + 0.5), int(middle * (1.0 + v) + 0.5)]
                    red = red * light[0] + light[3]
                    green = green * light[1] + light[3]
                    blue = blue * light[2] + light[3]
                blend(colors, x, y, alpha, red, green, blue)


ON_IT = 1.005
"""Ratio of distances up to which a line behind a surface counts as on it."""


@compiled
def blend(colors: np.ndarray, x: int, y: int, alpha: float, red: float, green: float, blue: float) -> None:
    """Blend a colour over that of a pixel."""
    for n, value in enumerate((red, green, blue)):
        below = colors[x, y, n]
        colors[x, y, n] = int(min(below + alpha * (value - below), 255.0) + 0.5)
