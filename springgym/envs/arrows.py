"""Red arrows that show actions in pictures: straight for forces and impulses, around an axis for torques."""

from __future__ import annotations

import numpy as np

from springgym.rendering import Arrow
from springgym.rendering.look import RED, Point

__all__ = ["ARC", "across", "torque_arrow"]

ARC = 3.0
"""Angle of the arrow of a torque of 1 [rad]."""


def torque_arrow(about: Point, torque: np.ndarray, radius: float) -> Arrow:
    """Return an arrow of a radius [m] around a point for a torque (3,), relative to the largest one."""
    return Arrow(about, ARC * radius * torque, RED, radius)


def across(vector: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the part of a vector (3,) perpendicular to a unit vector (3,)."""
    return vector - (vector @ axis) * axis
