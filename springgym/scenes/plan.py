"""The contents of a scene file: the scene, the settings of its simulation, and its pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from springgym.checks import apart, chosen, flag, instance, number, refusing_unknown, shown, whole
from springgym.dynamics import rigid
from springgym.dynamics.methods import integrator
from springgym.model.scene import Scene
from springgym.model.surfaces import PaperContact

__all__ = ["LEAST", "OF_ONE_BODY", "RULES", "SPEEDS", "View", "check_plot", "refuse_twice"]

Vector = tuple[float, float, float]
Plot = Literal["top", "pendulum", "rope", "drop", "slide", "rotation", "ringing", "bodies"]

OF_ONE_BODY = ("top", "rope", "ringing")
"""Names of the plots that can only show a scene of one body."""

LEAST = {"duration": 1e-7, "interval": 1e-9, "step": 1e-9}
"""Least times of a run [s]: in a shorter one, no motion would be visible in a plot or a film."""


SPEEDS = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0, 2.0, 4.0, 8.0)
"""Speeds of films: simulated seconds per second of the film."""


def _time(name: str, value: object) -> None:
    """Raise ValueError for a time that is below that of `LEAST`."""
    time = number(name, value)
    if time < LEAST[name]:
        given, least = apart(time, LEAST[name])
        raise ValueError(f"{name} is {given} s; it must be at least {least} s")


def _known_method(name: str, value: object) -> None:
    """Raise ValueError for a name that is a method of neither springs nor rigid bodies."""
    if instance(name, value, str) not in rigid.METHODS:
        integrator(str(value))


RULES: Mapping[str, Callable[[str, Any], object]] = {
    "duration": _time,
    "interval": _time,
    "step": lambda name, value: None if value is None else _time(name, value),
    "integrator": _known_method,
}
"""Checks of the settings of a simulation, by their names, which each takes with the value."""


@refusing_unknown
@dataclass(frozen=True)
class View:
    """The viewpoint and the speed of a film.

    Raises
    ------
    TypeError, ValueError
        If a field has the wrong type or value; the message names it.
    """

    azimuth: float = -1.0
    """azimuth of the eye, counted from x about z [rad]"""
    elevation: float = 0.3
    """elevation of the eye above the horizon [rad]"""
    speed: float | None = None
    """one of `SPEEDS`; None for the fastest speed, up to real time, at which the eye can follow the
    rotation"""
    strain: bool = False
    """whether the film shows the springs, coloured by their strain; for motions too small to be seen"""

    def __post_init__(self) -> None:
        number("azimuth", self.azimuth)
        number("elevation", self.elevation)
        if self.speed is not None and number("speed", self.speed) not in SPEEDS:
            known = ", ".join(f"{speed:g}" for speed in SPEEDS)
            raise ValueError(f"speed is {self.speed:g}; it must be one of {known}")
        flag("strain", self.strain)


@refusing_unknown
@dataclass(frozen=True, eq=False)
class Plan:
    """A scene, and the settings for its simulation, checks and pictures.

    Raises
    ------
    TypeError, ValueError
        If a field has the wrong type or value; the message names it.
    """

    name: str
    title: str
    """description of the scene in one line"""
    scene: Scene
    paper: PaperContact
    """the contact of the paper's settings, if --preset paper chooses them"""
    stretched: bool
    """whether it starts in the shape of a steady motion under its weight"""
    duration: float
    """duration of the motion [s]"""
    interval: float
    """time between recorded states [s]"""
    integrator: str
    step: float | None
    """time step [s], chosen from the stability limit if None"""
    trace: int | None
    """the particle whose path is drawn"""
    plot: Plot
    checks: tuple[str, ...]
    """names in `springgym.scenes.checks.basis.CHECKS`"""
    view: View
    contacts: bool = False
    """whether contacts are recorded, as a check needs them"""
    parts: tuple[Plan, ...] = ()
    """for several bodies, the plan with the checks of each; ``checks`` are those of all together"""

    def __post_init__(self) -> None:
        for name, kind in (("name", str), ("title", str), ("scene", Scene), ("paper", PaperContact)):
            instance(name, getattr(self, name), kind)
        for name, rule in RULES.items():
            rule(name, getattr(self, name))
        for name in ("stretched", "contacts"):
            flag(name, getattr(self, name))
        if self.trace is not None:
            whole("trace", self.trace, high=len(self.scene.masses) - 1)
        bodies = len(self.scene.bodies)
        check_plot(self.plot, bodies)
        for name in instance("checks", self.checks, tuple):
            instance("a name in checks", name, str)
        refuse_twice("checks", self.checks)
        instance("view", self.view, View)
        for n, part in enumerate(instance("parts", self.parts, tuple)):
            instance(f"parts[{n}]", part, Plan)
        if self.parts and len(self.parts) != bodies:
            raise ValueError(f"parts are {len(self.parts)}; there must be one for each of {bodies} bodies")


def check_plot(plot: object, bodies: int) -> None:
    """Raise TypeError or ValueError for a plot that cannot show so many bodies."""
    chosen("plot", plot, get_args(Plot))
    if bodies > 1 and plot in OF_ONE_BODY:
        raise ValueError(f"plot is {plot!r}, which shows a scene of one body, and there are {bodies}")


def refuse_twice(name: str, given: Sequence[object]) -> None:
    """Raise ValueError if something is in a list twice."""
    for n, item in enumerate(given):
        if item in given[:n]:
            raise ValueError(f"{name} names {shown(item)} twice; it must name each once")
