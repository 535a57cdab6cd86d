"""What a scene file says: what is simulated, for how long, and what is made of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from springgym.bodies import Body
from springgym.bodies.motion import axes
from springgym.scene import Scene
from springgym.surfaces import PaperContact
from springgym.theory.top import HeavyTop

Vector = tuple[float, float, float]
Plot = Literal["top", "pendulum", "rope", "drop", "slide", "rotation", "bodies"]


LEAST = {"duration": 1e-6, "interval": 1e-6, "step": 1e-9}
"""Least times of a run [s]: in shorter ones nothing moves that a plot or a film could show."""


class View(NamedTuple):
    """From where a film is seen."""

    azimuth: float = -1.0
    """of the eye, counted from x about z [rad]"""
    elevation: float = 0.3
    """of the eye above the horizon [rad]"""


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
    """of several bodies, what is checked of each by itself"""


def heavy_top(body: Body, pinned: tuple[int, ...], gravity: Sequence[float]) -> HeavyTop:
    """The rigid symmetric top of a body that is pinned on its axis.

    Raises
    ------
    ValueError
        If it is not pinned at one particle, or not symmetric about its axis, or gravity is not vertical.
    """
    if len(pinned) != 1 or any(gravity[:2]):
        raise ValueError(f"body {body.name!r} is no heavy top: it needs one pin, and vertical gravity")
    pin = body.positions[pinned[0]]
    own = axes(body.positions, body.frame)
    tensor, arm = own.T @ body.inertia(pin) @ own, own.T @ (body.centre - pin)
    i1, i3 = tensor[0, 0], tensor[2, 2]
    if np.abs(tensor - np.diag([i1, i1, i3])).max() > 1e-9 * i1 or np.abs(arm[:2]).max() > 1e-9 * abs(arm[2]):
        raise ValueError(f"body {body.name!r} is no heavy top: it is not symmetric about its axis")
    return HeavyTop(i1, i3, -body.mass * gravity[2] * arm[2])
