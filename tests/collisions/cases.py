"""Two cubes that meet in every way that faces, edges and corners can, each along x."""

from __future__ import annotations

import numpy as np

from springgym.model.bodies import Body, cube

CUBE = cube(damping=0.0)


def turned(*steps: tuple[int, float]) -> np.ndarray:
    """A rotation by angles [°] about axes, one after another."""
    whole = np.eye(3)
    for axis, angle in steps:
        c = np.cos(np.radians(angle))
        s = np.sin(np.radians(angle))
        one = np.eye(3)
        i = (axis + 1) % 3
        j = (axis + 2) % 3
        one[i, i] = c
        one[j, j] = c
        one[i, j] = -s
        one[j, i] = s
        whole = one @ whole
    return whole


FACE = np.eye(3)
EDGE = turned((2, 45.0))  # an edge along z points to ±x
TIPPED = turned((1, 45.0))  # an edge along y points to ±x
CORNER = turned((2, 45.0), (1, np.degrees(np.arctan(np.sqrt(0.5)))))

WAYS = {
    "flush faces": (FACE, FACE, (0, 0)),
    "faces, offset": (FACE, FACE, (0.3, 0.2)),
    "faces, turned": (FACE, turned((0, 45.0)), (0, 0)),
    "edge on face": (EDGE, FACE, (0, 0.1)),
    "edge on face, off centre": (EDGE, FACE, (0.2, 0.3)),
    "corner on face": (CORNER, FACE, (0, 0)),
    "corner on face, off centre": (CORNER, FACE, (0.1, 0.15)),
    "crossed edges": (EDGE, TIPPED, (0.1, 0.05)),
    "edges at 40°": (EDGE, turned((2, 45.0), (0, 40.0)), (0, 0.1)),
    "parallel edges": (EDGE, EDGE, (0, 0.2)),
    "corner on corner": (CORNER, CORNER, (0, 0)),
}


def approach(way: str, speed: float, body: Body = CUBE) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (16, 3) of two cubes 3 cm apart along x, that approach each other."""
    left, right, offset = WAYS[way]
    x = [body.positions @ left.T, body.positions @ right.T]
    gap = 0.03 + x[0][:, 0].max() - x[1][:, 0].min()
    x[1] = x[1] + (gap, *offset)
    v = np.repeat([[speed / 2, 0, 0], [-speed / 2, 0, 0]], len(body.masses), axis=0)
    return np.concatenate(x), v
