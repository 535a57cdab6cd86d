"""The contents of a scene file: the scene, the settings of its simulation, and its pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from springgym.scene import Scene
from springgym.surfaces import PaperContact

Vector = tuple[float, float, float]
Plot = Literal["top", "pendulum", "rope", "drop", "slide", "rotation", "ringing", "bodies"]

OF_ONE_BODY = ("top", "rope", "ringing")
"""Names of the plots that can only show a scene of one body."""

LEAST = {"duration": 1e-6, "interval": 1e-6, "step": 1e-9}
"""Least times of a run [s]: in shorter ones, no motion would be visible in a plot or a film."""


SPEEDS = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0, 2.0, 4.0, 8.0)
"""Speeds of films: simulated seconds per second of the film."""


class View(NamedTuple):
    """The viewpoint and the speed of a film."""

    azimuth: float = -1.0
    """azimuth of the eye, counted from x about z [rad]"""
    elevation: float = 0.3
    """elevation of the eye above the horizon [rad]"""
    speed: float | None = None
    """one of `SPEEDS`; None for the fastest speed, up to real time, at which the eye can follow the
    rotation"""
    strain: bool = False
    """whether the film shows the springs, coloured by their strain; for motions too small to be seen"""


@dataclass(frozen=True, eq=False)
class Plan:
    """A scene, and the settings for its simulation, checks and pictures."""

    name: str
    title: str
    """description of the scene in one line"""
    scene: Scene
    paper: PaperContact
    """the contact of the paper's settings, if --preset paper chooses them"""
    stretched: bool
    """whether it starts in the shape of a steady motion under its weight"""
    duration: float
    """[s]"""
    interval: float
    """time between recorded states [s]"""
    integrator: str
    step: float | None
    """time step [s], chosen from the stability limit if None"""
    trace: int | None
    """the particle whose path is drawn"""
    plot: Plot
    checks: tuple[str, ...]
    """names in `springgym.scenes.checks.CHECKS`"""
    view: View
    contacts: bool = False
    """whether contacts are recorded, as a check needs them"""
    parts: tuple[Plan, ...] = ()
    """for several bodies, the plan with the checks of each; ``checks`` are those of all together"""
