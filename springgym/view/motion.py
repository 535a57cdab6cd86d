"""Motions for a page: positions over time, with all data for drawing them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from springgym.dynamics.contacts import Contacts
from springgym.model.scene import Scene
from springgym.model.surfaces import scales
from springgym.rendering import Camera, Look, Marks, Scenery
from springgym.rendering.look import GREEN, INK, SLATE, TEAL, Color
from springgym.scenes import film
from springgym.scenes.graphs import Curve, graphs, turns
from springgym.scenes.recording import Recording, rigid_twin

PURPLE: Color = (128, 72, 160)
STEEPEST = 4.0
"""Longest arrow of a force, in lengths of the weight's: impacts would leave the picture."""


class Arrows(NamedTuple):
    """An arrow at each of T times of a motion."""

    origins: np.ndarray
    """(T, 3) points at which the arrow begins [m]"""
    vectors: np.ndarray
    """(T, 3) arrows as drawn [m]; zero where there is none"""
    color: Color


class Touches(NamedTuple):
    """The contacts of a motion, drawn as arrows: at most K at each of T times."""

    points: np.ndarray
    """(T, K, 3) points of contact [m]; NaN where there is none"""
    vectors: np.ndarray
    """(T, K, 3) arrows of the force on the first body, as drawn [m]"""
    mutual: np.ndarray
    """(T, K) mask: True where two bodies touch, and the opposite force acts on the second"""


@dataclass(frozen=True, eq=False)
class Motion:
    """Positions over time, and everything drawn with them."""

    title: str
    times: np.ndarray
    """(T,) times of the states [s], from 0"""
    positions: np.ndarray
    """(T, N, 3) positions of the particles [m]"""
    look: Look
    scenery: Scenery
    lengths: np.ndarray
    """(S,) unstretched lengths of the look's springs [m]"""
    centre: np.ndarray
    """(T, 3) centre of mass [m]"""
    fastest: float
    """largest angular velocity [rad/s]"""
    direction: tuple[float, float]
    """azimuth and elevation of the eye [rad]"""
    graphs: Mapping[str, Mapping[str, Curve]]
    """curves by name, in graphs by name with unit"""
    arrows: Mapping[str, Arrows] = field(default_factory=dict)
    touches: Touches | None = None
    """contacts; None if there are none, or they are not known"""
    paths: Mapping[str, tuple[np.ndarray, Color]] = field(default_factory=dict)
    """(T, 3) static paths, with colours, by name"""
    marks: Sequence[Marks] = ()
    """further marks at each time"""
    camera: Camera | None = None
    """the camera of an environment; if None, the page chooses one"""
    pace: float | None = None
    """speed of playing, if it is given"""
    summary: str = ""
    """description of the simulation and its accuracy, in one line"""
    note: str = ""
    """a note on what pictures do not show"""

    @property
    def extent(self) -> float:
        """Return the extent of the body in the picture [m], see `extent_of`."""
        return extent_of(self.positions)

    @property
    def strain(self) -> np.ndarray:
        """Return the strains of the springs, (T, S)."""
        return film.strains(self.look, self.lengths, self.positions)

    @property
    def glassy(self) -> bool:
        """Whether its springs are shown at first. A round body's rotation is visible on its skin."""
        return len(self.lengths) > 0 and not np.asarray(self.look.skin).size

    @property
    def key(self) -> dict[str, Color]:
        """Return the colours of the marks, by what they mean."""
        return {text: color for marks in self.marks for color, text in marks.key}

    def speed(self, fps: float) -> float:
        """Return the speed of playing: ``pace`` or, without one, the fastest at which the eye can follow the
        rotation."""
        return self.pace or film.visible_speed(self.fastest, fps)

    def at(self, time: float) -> tuple[int, float]:
        """Return the index of the state before a time [s], and the passed fraction of the interval."""
        n = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2))
        share = (time - self.times[n]) / (self.times[n + 1] - self.times[n])
        return n, float(np.clip(share, 0.0, 1.0))


def extent_of(positions: np.ndarray) -> float:
    """Return the longest side of the box around a body that moves through positions (T, N, 3) [m].

    For a single particle, which has none, it is a fraction of its path.
    """
    size = float(np.ptp(positions[0], axis=0).max())
    return size or 0.3 * float(np.ptp(positions, axis=(0, 1)).max()) or 0.5


def of_recording(recording: Recording, *, twin: bool = True) -> Motion:
    """Return the motion of a recorded scene; with ``twin``, beside the path of its rigid twin, if any."""
    plan = recording.plan
    m = recording.measures
    x = recording.positions
    scene = plan.scene
    rigid = rigid_twin(recording) if twin else None
    paths = {}
    if rigid is not None and plan.trace is not None:
        paths["rigid twin"] = (rigid.positions[:, plan.trace], INK)
    lost = float(m.damping_loss[-1] + m.contact_loss[-1] + m.friction_loss[-1])
    return Motion(
        title=plan.title,
        times=recording.times,
        positions=x,
        look=film.look(scene, plan.trace),
        scenery=film.scenery(recording),
        lengths=scene.of_bodies("lengths"),
        centre=m.centre,
        fastest=film.turning(scene, recording.bodies),
        pace=recording.plan.view.speed,
        direction=(plan.view.azimuth, plan.view.elevation),
        graphs=graphs(m, scene),
        arrows=_arrows(recording),
        touches=touches(scene, recording.contacts, x),
        paths=paths,
        note=lacking(scene),
        summary=(
            f"{recording.integrator.name}, step {1e3 * recording.step:.3g} ms · largest strain "
            f"{m.strain.max():.1e} · energy {m.energy[0]:.4g} → {m.energy[-1]:.4g} J, "
            f"lost {lost:.3g} J, energy error {m.balance[-1] - m.balance[0]:.1e} J"
        ),
    )


def _arrows(recording: Recording) -> dict[str, Arrows]:
    """Return arrows of the weight, the support, the angular velocity and the angular momentum.

    The support follows from the momentum P: pin and surfaces together exert dP/dt − M g.
    """
    scene = recording.plan.scene
    m = recording.measures
    x = recording.positions
    size = 0.6 * extent_of(x)
    drawn: dict[str, Arrows] = {}
    weight = weight_of(scene)
    if weight.any() and len(recording.times) > 2:
        push = np.gradient(m.momentum, recording.times, axis=0) - weight
        longer = np.linalg.norm(push, axis=1) / np.linalg.norm(weight)
        push = push / np.maximum(1.0, longer / STEEPEST)[:, None]
        length = 0.6 * size / float(np.linalg.norm(weight))
        drawn["weight"] = Arrows(m.centre, np.tile(length * weight, (len(x), 1)), SLATE)
        if len(scene.bodies) == 1 and (scene.pinned or scene.surfaces):
            push = np.where((longer > 0.02)[:, None], push, 0.0)
            drawn["support"] = Arrows(_supported_at(recording), length * push, GREEN)
    if turns(scene):
        about = x[:, scene.pivot] if scene.pivot >= 0 else m.centre
        for name, vectors, color in (
            ("angular velocity", m.angular_velocity, TEAL),
            ("angular momentum", m.angular_momentum, PURPLE),
        ):
            largest = float(np.linalg.norm(vectors, axis=1).max())
            if largest > 1e-9:
                drawn[name] = Arrows(about, 2.0 * size / largest * vectors, color)
    return drawn


def touches(scene: Scene, found: Sequence[Contacts], positions: np.ndarray) -> Touches | None:
    """Return contacts in the form for drawing, or None if there are none.

    Parameters
    ----------
    scene
        The scene; forces are drawn in the scale of the weight of all its bodies.
    found
        `Simulator.contacts` of one copy at each time.
    positions
        (T, N, 3) [m].
    """
    most = max((of.there.shape[1] for of in found), default=0)
    if not most:
        return None
    points = np.full((len(found), most, 3), np.nan)
    forces = np.zeros((len(found), most, 3))
    mutual = np.zeros((len(found), most), bool)
    for n, of in enumerate(found):
        there = of.there[0]
        count = int(there.sum())
        points[n, :count] = of.point[0, there]
        forces[n, :count] = of.force[0, there]
        mutual[n, :count] = of.second[0, there] >= 0
    size = np.linalg.norm(forces, axis=2)
    unit = float(np.linalg.norm(weight_of(scene))) or float(size.max()) / STEEPEST or 1.0
    longer = np.maximum(1.0, size / (STEEPEST * unit))[..., None]
    return Touches(points, 0.36 * extent_of(positions) * forces / unit / longer, mutual)


def lacking(scene: Scene) -> str:
    """Return a note for the page on what a scene lacks compared with others; "" if it has surfaces."""
    if scene.surfaces:
        return ""
    if scene.pins:
        return "pinned, no floor: the grid is not solid"
    return "" if weight_of(scene).any() else "no gravity"


def weight_of(scene: Scene) -> np.ndarray:
    """Return the weight of all bodies (3,) [N]."""
    return np.zeros(3) if scene.gravity is None else scene.masses.sum() * np.array(scene.gravity)


def _supported_at(recording: Recording) -> np.ndarray:
    """Return where the support acts, (T, 3) [m]: the pin, or the mean of contacts weighted by force.

    Where no contact is recorded, it is the mean of the particles within 1.5 Δ of a surface, or of the lowest.
    """
    scene = recording.plan.scene
    x = recording.positions
    if scene.pinned:
        return x[:, list(scene.pinned)].mean(axis=1)
    _, reach = scales(scene.contact, scene.body)
    heights = np.min([surface.height(x) for surface in scene.surfaces], axis=0)
    near = np.maximum(1.5 * reach, heights.min(axis=1, keepdims=True) + 1e-9)
    touching = (heights <= near)[..., None]
    at = (x * touching).sum(axis=1) / touching.sum(axis=1)
    for n, found in enumerate(recording.contacts):
        push = np.linalg.norm(found.force[0], axis=1)
        if push.any():
            at[n] = push @ found.point[0] / push.sum()
    return at
