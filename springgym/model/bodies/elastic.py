"""The solid or cable that a body of springs represents, and the properties that it lacks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from springgym.model.materials import Material
from springgym.model.records import ReadOnly

HIGHER = "higher frequencies and the contraction across a stretch"
"""Properties of a solid that bodies with calibrated springs lack."""


@dataclass(frozen=True, eq=False)
class Elastic(ReadOnly):
    """The elastic solid that a body represents.

    The body has exactly the mass, centre of mass and inertia tensor of the solid. Its springs are calibrated
    to the solid's lowest frequency and growth under spin, and its dampers to the loss factor.
    """

    material: Material
    shape: str
    """description of the shape"""
    mass: float
    """mass [kg]"""
    centre: np.ndarray
    """(3,) centre of mass [m]"""
    inertia: np.ndarray
    """(3, 3) about it [kg·m²]"""
    frequency: float
    """lowest frequency ω₁ of the free solid [rad/s]"""
    axes: np.ndarray
    """(3, 3) axes of spin, its columns"""
    stretch: np.ndarray
    """(3,) s of each axis [s²]: with a spin ω, the moment of inertia about it grows by the fraction s ω²"""
    frequency_ratio: float
    """lowest frequency of the springs over that of the solid, after calibration"""
    stretch_ratios: np.ndarray
    """(3,) the same for s"""
    precession_ratio: float | None = None
    """for a top pinned at its tip, the slowing of its precession by stretch over that of the solid"""
    missed: str = HIGHER
    """description of the properties of the solid that the body lacks"""

    def __post_init__(self) -> None:
        for name in ("centre", "inertia", "axes", "stretch", "stretch_ratios"):
            self.keep(name, getattr(self, name))

    @property
    def damping_ratio(self) -> float:
        """Return ζ of the lowest vibration of the springs. At a frequency ω it is larger by ω/ω₁."""
        return self.material.loss / 2 * self.frequency_ratio

    def __repr__(self) -> str:
        ratios = ", ".join(_ratio(value) for value in self.stretch_ratios)
        if self.precession_ratio is not None:
            ratios += f", slowing of its precession × {self.precession_ratio:.2f}"
        return (
            f"as a {self.shape} of {self.material}: mass, centre and inertia exact; lowest frequency "
            f"{self.frequency / (2 * math.pi):.5g} Hz × {_ratio(self.frequency_ratio)}, growth under spin × "
            f"{ratios}; damping ratio {self.damping_ratio:.3g} there; not matched: {self.missed}"
        )


def _ratio(value: float) -> str:
    """Return a ratio near 1 with four digits, or as many as distinguish it from 1."""
    return f"{value:.4f}" if abs(value - 1) >= 5e-5 else "1"


@dataclass(frozen=True)
class Cable:
    """The round cable that a rope represents."""

    material: Material
    diameter: float
    """diameter [m]"""
    length: float
    """length [m]"""
    load: float
    """mass of the weight at its end [kg]"""

    @property
    def section(self) -> float:
        """Return the area A of the section [m²]."""
        return math.pi * self.diameter**2 / 4

    @property
    def mass(self) -> float:
        """Return the mass of the cable alone [kg]."""
        return self.material.density * self.section * self.length

    def bending_length(self, gravity: float = 9.81) -> float:
        """Return √(EI/T) [m] under the weight T of the load: the length over which bending rounds kinks."""
        moment = math.pi * self.diameter**4 / 64
        return math.sqrt(self.material.young * moment / (self.load * gravity))

    def __repr__(self) -> str:
        return (
            f"as a cable of {self.material}, {1e3 * self.diameter:g} mm thick: mass and stiffness along "
            f"itself exact; not matched: bending, which matters over {self.bending_length():.3g} m"
        )
