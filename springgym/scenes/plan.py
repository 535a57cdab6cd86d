"""The contents of a scene file: what is simulated, for how long, and how it is shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from springgym.scene import Scene
from springgym.surfaces import PaperContact

Vector = tuple[float, float, float]
Plot = Literal["top", "pendulum", "rope", "drop", "slide", "rotation", "ringing", "bodies"]


LEAST = {"duration": 1e-6, "interval": 1e-6, "step": 1e-9}
"""Least times of a run [s]: in shorter ones nothing moves that a plot or a film could show."""


SPEEDS = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0, 2.0, 4.0, 8.0)
"""Seconds of the motion a second of showing it."""


class View(NamedTuple):
    """From where a film is seen, and how fast it is."""

    azimuth: float = -1.0
    """of the eye, counted from x about z [rad]"""
    elevation: float = 0.3
    """of the eye above the horizon [rad]"""
    speed: float | None = None
    """one of `SPEEDS`; if None, the fastest up to real time at which the eye can follow the rotation"""


@dataclass(frozen=True, eq=False)
class Plan:
    """A scene, and what its file wants done with it."""

    name: str
    title: str
    """what it shows, in a line"""
    scene: Scene
    paper: PaperContact
    """the contact of the paper's method, if that is asked for"""
    stretched: bool
    """whether it starts in the shape that its motion and weight hold"""
    duration: float
    """[s]"""
    interval: float
    """between the states that are recorded [s]"""
    integrator: str
    step: float | None
    """[s], chosen from the stability limit if None"""
    trace: int | None
    """the particle whose path is drawn"""
    plot: Plot
    checks: tuple[str, ...]
    """names in `springgym.scenes.checks.CHECKS`"""
    view: View
    parts: tuple[Plan, ...] = ()
    """of several bodies, what is checked of each by itself; ``checks`` are of all together"""
