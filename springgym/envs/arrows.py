"""Show the action in pictures: red arrows, straight for forces and impulses, around an axis for torques."""

from __future__ import annotations

import numpy as np

from springgym.rendering import Arrow
from springgym.rendering.look import RED, Point

ARC = 3.0
"""Angle that the arrow of a torque of 1 runs over [rad]."""


def torque_arrow(about: Point, torque: np.ndarray, radius: float) -> Arrow:
    """Make an arrow around a point for a torque (3,), a share of the largest one; its radius is in m."""
    return Arrow(about, ARC * radius * torque, RED, radius)


def across(vector: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the part of a vector (3,) that is across a unit vector (3,)."""
    return vector - (vector @ axis) * axis
