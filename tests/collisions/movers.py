"""Make scenes in which a body meets a floor, a ramp, a pinned block or a free body, on two kernels in all."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from springgym.dynamics.stepping import plan_steps
from springgym.model.bodies import (
    Body,
    ball,
    box,
    capsule,
    cube,
    disk,
    ellipsoid,
    from_points,
    rolling_ball,
    rotation,
    start,
)
from springgym.model.collisions import Pair
from springgym.model.scene import Placed, Scene
from springgym.model.surfaces import Bowl, Contact, Plane, heights
from springgym.simulator import Simulator
from springgym.theory.contact import rest_height
from tests.collisions.stepped import FAR, full

G = 9.81
SURFACES = ("floor", "ramp", "bowl")
STRENGTH, REACH = 2e-4, 2e-3
"""c [N·m²] and Δ [m] of contacts that are hard beside the weight of a body."""


def body(name: str, stiffness: float = 1e5, damping: float = 0.0) -> Body:
    """Return a body of 1 kg that is about 20 cm large, or a die."""
    of: dict[str, Any] = {"stiffness": stiffness, "damping": damping}
    corners = [(0.13, 0, -0.06), (-0.07, 0.12, -0.05), (-0.06, -0.11, -0.07), (0.02, 0.01, 0.14)]
    made: dict[str, Any] = {
        "bead": lambda: ball(0.1),
        "ball": lambda: rolling_ball(0.1, **of),
        "capsule": lambda: capsule(0.1, 0.3, **of),
        "disk": lambda: disk(0.1, **of),
        "ellipsoid": lambda: ellipsoid((0.12, 0.1, 0.08), **of),
        "cube": lambda: cube(0.2, **of),
        "die": lambda: cube(0.016, mass=0.005, **of),
        "stone": lambda: from_points([*corners, (0.08, 0.09, 0.05)], **of),
    }
    return made[name]()


ON_SURFACES_ONLY = ("disk", "ellipsoid")
LYING = {"capsule": (np.pi / 2, 0.0, 0.0)}
"""The rotation by which a body lies on the ground: a capsule along y."""
CARRIERS = {"capsule": 2, "cube": 4, "stone": 3}
"""The number of contacts of a body that lies on the ground, if it is not one."""
BLOCK = box((4.0, 2.0, 0.5), 8.0, damping=0.0)
FAR_BALL = rolling_ball(0.09, damping=0.0)
FAR_PAIR = tuple(Placed(FAR_BALL, np.add(FAR_BALL.positions, (x, 0, 300)), name=f"far{x}") for x in (50, 60))
BESIDE = Placed(FAR_BALL, np.add(FAR_BALL.positions, (5, 0, 0)), name="far")
"""Bodies far away that collide, or could: with them every scene uses the kernel of bodies that collide."""


class World(NamedTuple):
    """A `World` holds a simulator and the axes of the surface that its first body meets: x points downhill, z
    along the normal."""

    simulator: Simulator
    axes: np.ndarray

    def velocity(self, n: int = 0) -> np.ndarray:
        """Return the velocity of the centre of mass of a body (copies, 3) [m/s]."""
        return np.asarray(self.simulator.measure(n).centre_velocity @ self.axes)

    def spin(self, n: int = 0) -> np.ndarray:
        """Return the angular velocity of a body (copies, 3) [rad/s]."""
        return np.asarray(self.simulator.measure(n).angular_velocity @ self.axes)

    def centre(self, n: int = 0) -> np.ndarray:
        return np.asarray(self.simulator.measure(n).centre @ self.axes)

    def place(self, shifts: Any = 0.0, velocities: Any = 0.0, spins: Any = 0.0) -> None:
        """Place the first body of each copy aside by ``shifts`` (copies, 3), with further ``velocities`` and
        ``spins``."""
        simulator = self.simulator
        own = self.simulator.scene.slices[0]
        x, v = (
            np.repeat(each[None], simulator.copies, axis=0)
            for each in (simulator.scene.positions, simulator.scene.velocities)
        )
        shifts, velocities, spins = (
            np.broadcast_to(each, (len(x), 3))[:, None] @ self.axes.T for each in (shifts, velocities, spins)
        )
        arms = x[:, own] - simulator.measure(0).centre[:, None]
        x[:, own] += shifts
        v[:, own] += velocities + np.cross(spins, arms)
        simulator.place(x, v)


def alone(of: Scene, on: str) -> Scene:
    """Return a `scene` without what only shares its code: it has steps and speeds of its own."""
    if on in SURFACES:
        return of.with_(bodies=of.bodies[:1], collisions="all")
    return of.with_(bodies=of.bodies[:2], surfaces=())


def automatic(of: Scene, dynamics: str) -> float:
    """Return the default step of a scene [s]."""
    return plan_steps(of, dynamics=dynamics).step


def axes_of(on: str, tilt: float) -> np.ndarray:
    return rotation((0, 1, 0), tilt) if on == "ramp" else np.eye(3)


def scene(
    of: Body,
    on: str,
    contact: Contact,
    up: float | None = None,
    tilt: float | None = None,
    other: Body | None = None,
    aside: Any = (0.0, 0.0, 0.0),
    **begins: Any,
) -> Scene:
    """Return a scene of a body above or at rest on what it meets, whose top is z = 0 by the axes of `World`.

    ``begins`` are arguments of `start`. Gravity is turned by ``tilt`` from the normal, as a ramp is; without
    it, there is none. A "mate" is a free body, equal to the first if no ``other`` is given.
    """
    begun = start(of, **{"rotation": LYING.get(of.name, (0.0, 0.0, 0.0)), "stretched": False} | begins)
    if up is None:
        share = of.mass * G * np.cos(tilt or 0.0) / CARRIERS.get(of.name, 1)
        up = rest_height(share, contact.strength or STRENGTH, contact.reach or REACH)
    low = heights(of, begun.positions, Plane()).min()
    axes = axes_of(on, tilt or 0.0)
    x, v = ((each @ axes.T) for each in (begun.positions + np.add(aside, (0, 0, up - low)), begun.velocities))
    gravity = np.zeros(3) if tilt is None else G * axes @ (np.sin(tilt), 0.0, -np.cos(tilt))
    first = Placed(of, x, v, name="first")
    if on in SURFACES:
        plane = Plane((0.0, 0.0, 0.0), tuple(axes[:, 2]))
        surface = Bowl((0.0, 0.0, 1.5), 1.5) if on == "bowl" else plane
        apart = (Pair(1, 2, Contact(strength=STRENGTH, reach=REACH)),)
        return Scene(
            bodies=(first,) if on == "bowl" else (first, *FAR_PAIR),
            surfaces=(surface,),
            contact=contact,
            collisions=None if on == "bowl" else apart,
            gravity=tuple(gravity),
        )
    partner = BLOCK if on == "block" else other or of
    below = start(partner, rotation=LYING.get(partner.name, (0.0, 0.0, 0.0)), stretched=False).positions
    below[:, 2] += heights(partner, below, Plane((0, 0, 0), (0, 0, -1))).min()
    pins = tuple(range(len(partner.masses))) if on == "block" else ()
    return Scene(
        bodies=(first, Placed(partner, below, pinned=pins, name="second"), BESIDE),
        surfaces=(FAR,),
        contact=contact,
        collisions="all",
        gravity=tuple(gravity),
    )


def world(
    of: Body,
    on: str,
    contact: Contact,
    up: float | None = None,
    *,
    dynamics: str = "springs",
    step: float | None = None,
    copies: int = 2,
    unresolved: str = "raise",
    tilt: float | None = None,
    **more: Any,
) -> World:
    """Return a simulator of a body above what it meets, see `scene`."""
    made = scene(of, on, contact, up, tilt, **more)
    simulator = full(made, dynamics=dynamics, step=step, copies=copies, unresolved=unresolved)
    return World(simulator, axes_of(on, tilt or 0.0))
