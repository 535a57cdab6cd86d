"""The records of a rigid body: its properties, its state and its motion."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from springgym.core.language.kinds import Block, Number, Numbers, Vector
from springgym.dynamics.terms import Terms

Motion: TypeAlias = tuple[Vector, Vector]
"""A velocity and an angular momentum, both in body coordinates."""


class State(NamedTuple):
    """The state of a rigid body: where it is and how it moves."""

    q: Vector
    """the quaternion of the rotation from the body's orientation when the call began"""
    momentum: Vector
    """angular momentum about the body's point, in body coordinates [kg·m²/s]"""
    position: Vector
    """position of that point, the pin or the centre of mass [m]"""
    velocity: Vector
    """velocity of that point [m/s]"""


class Rigid(NamedTuple):
    """The rigid body in the form of its kernel."""

    shape: np.ndarray
    """(N, 3) particles in principal axes, from the pin or the centre of mass [m]"""
    moments: np.ndarray
    """(3,) the principal moments of inertia [kg·m²]"""
    triad: np.ndarray
    """(3, 3) rows: the body's `triad` in principal axes"""
    markers: np.ndarray
    """(3,) the particles of that triad"""
    pivot: int
    """index of the pinned particle, or −1"""
    moves: bool
    """whether any particle is free"""
    turns: bool
    """whether it can rotate: False for a single particle"""
    stages: np.ndarray
    """(stages,) the composition: lengths of its second-order steps as fractions of the step"""


class Solid(NamedTuple):
    """A body during a call, in the form of its steps."""

    rigid: Rigid
    asymmetry: Numbers
    """(1,) the asymmetry 1/I₂ − 1/I₁ [1/(kg·m²)], or None"""
    axes: Block
    """the principal axes in world coordinates, in the orientation for which the quaternion `State.q` is 1"""
    centre: Vector
    """position of the centre of mass in body coordinates [m]"""
    total: Number
    """the mass [kg]"""
    lightness: Number
    """the inverse mass [1/kg]; 0 for a pinned body"""
    terms: Terms
    """the forces, surfaces and actuators of the body"""


Twin: TypeAlias = "tuple[Rigid, Numbers, Terms]"
"""A rigid body for kernels: its `Rigid`, its asymmetry as in `Solid`, and the terms that act on it."""
