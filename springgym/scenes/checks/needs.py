"""Requirements of the checks on a scene.

Each function raises `ValueError` with the reason if a scene does not meet its requirement.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from springgym.dynamics import rigid
from springgym.dynamics.rigid.shape import check_rigid
from springgym.model.bodies import Body
from springgym.model.bodies.elastic import Cable, Elastic
from springgym.model.bodies.network import vibrations
from springgym.model.bodies.precession import axial_moments, heavy_top
from springgym.model.bodies.rotations import axes
from springgym.model.scene import Scene
from springgym.model.surfaces import Bowl, Contact, Pipe, Plane, scales
from springgym.scenes.checks.basis import Need
from springgym.scenes.plan import Plan

TURNS_OVER = math.radians(45)
"""A body flips if its angular momentum comes this near to its middle axis [rad]: it is then nearer to that
than to the axis about which it spins."""


def _need(holds: Callable[[Any], object], refusal: str, *before: Need) -> Need:
    """Return a requirement: those ``before``, and that ``holds`` is true for the scene."""

    def check(plan: Plan) -> None:
        for need in before:
            need(plan)
        if not holds(plan.scene):
            raise ValueError(refusal)

    return check


def _contacts(scene: Scene) -> list[Contact]:
    """Return the contacts of a scene, with surfaces and between bodies, except paper contacts."""
    every = scene.contact, *(met.contact for met in scene.meetings)
    return [one for one in every if isinstance(one, Contact)]


def _first(scene: Scene) -> Any:
    """Return the first surface."""
    return scene.surfaces[0]


gravity = _need(
    lambda scene: not any(scene.gravity[:2]) and scene.gravity[2] < 0,
    "gravity does not pull straight down",
    _need(lambda scene: any(scene.gravity or ()), "there is no gravity"),
)
surface = _need(lambda scene: scene.surfaces, "it has no surface")
plane = _need(lambda scene: isinstance(_first(scene), Plane), "its first surface is not a plane", surface)
level = _need(lambda scene: _first(scene).normal == (0, 0, 1), "its first surface is not level", plane)
ground = _need(lambda scene: _first(scene).offset == 0, "its floor is not at height 0", level)
slope = _need(
    lambda scene: abs(_first(scene).normal[2]) < 1, "its first surface is level, and not a slope", plane
)
bowl = _need(lambda scene: isinstance(_first(scene), Bowl), "it has no bowl", surface)
level_pipe = _need(
    lambda scene: isinstance(_first(scene), Pipe) and abs(_first(scene).axis[2]) <= 1e-9,
    "it has no level pipe",
    surface,
)
restitution = _need(
    lambda scene: isinstance(scene.contact, Contact), "the paper's contact has no restitution"
)
coulomb = _need(
    lambda scene: not any(one.resists for one in _contacts(scene)),
    "its rolling or spinning is resisted, which theory leaves out",
)
friction = _need(lambda scene: scene.contact.friction > 0, "there is no friction", coulomb)
ice = _need(lambda scene: not scene.contact.friction > 0, "there is friction")
smooth = _need(
    lambda scene: isinstance(scene.contact, Contact) and scene.contact.restitution >= 1,
    "its contact loses energy, which theory leaves out",
    ice,
)
moves = _need(lambda scene: scene.velocities.any(), "it starts at rest")
pinned = _need(lambda scene: scene.pinned, "nothing is pinned")
free = _need(
    lambda scene: not (scene.pinned or scene.surfaces),
    "it does not move freely: it is pinned or has a surface",
)
pair = _need(
    lambda scene: len(scene.body.springs) == 1 and np.array_equal(scene.masses, scene.masses[:1].repeat(2)),
    "it applies to two equal masses on a spring",
)
collide = _need(lambda scene: scene.meetings, "no bodies collide")
apart = _need(
    lambda scene: not (scene.surfaces or scene.pins or any(scene.gravity or ())),
    "the bodies are not free: there is gravity, a surface or a pin",
    collide,
)
balls = _need(
    lambda scene: all(len(placed.body.masses) == 1 for placed in scene.bodies),
    "it applies to balls, and a body has several particles",
    apart,
)
row = _need(
    lambda scene: all(met.contact.restitution >= 1 for met in scene.meetings),
    "the balls lose energy to restitution",
    balls,
    _need(
        lambda scene: len({placed.body.mass for placed in scene.bodies}) == 1,
        "the balls have different masses",
    ),
)
one_held = _need(
    lambda scene: len(scene.bodies) == 2 and sum(bool(placed.pinned) for placed in scene.bodies) == 1,
    "it applies to two bodies, one of them pinned",
    collide,
)
smooth_bowl = _need(lambda scene: not scene.pins, "a particle is pinned", bowl, gravity, ice)


def particle(plan: Plan) -> None:
    if (count := len(plan.scene.body.masses)) != 1:
        raise ValueError(f"it applies to a single particle, and this body has {count}")


def trace(plan: Plan) -> None:
    if plan.trace is None:
        raise ValueError("it has no trace to compare with its rigid twin's")


def solid(plan: Plan) -> None:
    if not isinstance(plan.scene.body.solid, Elastic):
        raise ValueError(f"body {plan.scene.body.name!r} is not made of a material")


def cable(plan: Plan) -> None:
    if not isinstance(plan.scene.body.solid, Cable):
        raise ValueError(f"body {plan.scene.body.name!r} is not a rope made of a material")


def two(plan: Plan) -> None:
    balls(plan)
    if len(plan.scene.bodies) != 2:
        raise ValueError(f"it applies to two balls, and there are {len(plan.scene.bodies)}")


def dominoes(plan: Plan) -> None:
    collide(plan)
    level(plan)
    gravity(plan)
    if len(plan.scene.bodies) < 12:
        raise ValueError(f"it applies to a row of 12 bodies or more, and there are {len(plan.scene.bodies)}")


def dropped(plan: Plan) -> None:
    _, reach = scales(plan.scene.contact, plan.scene.body)
    if plan.scene.positions[0, 2] <= reach or plan.scene.velocities[0, 2] != 0:
        raise ValueError("it is not dropped: it starts within the floor's reach, or moves up or down")


def falls(plan: Plan) -> None:
    if not len(plan.scene.body.springs):
        raise ValueError("it applies to a body with springs")
    _, reach = scales(plan.scene.contact, plan.scene.body)
    if plan.scene.velocities.any() or float(plan.scene.positions[:, 2].min()) <= reach:
        raise ValueError("it is not dropped from rest above the floor's reach")


def on_tip(plan: Plan) -> None:
    symmetric(plan)
    body = plan.scene.body
    if "tip" not in body.parts:
        raise ValueError(f"body {body.name!r} has no tip")
    own = axes(body.positions, body.markers)
    arm = own.T @ (body.positions[body.particle("tip")] - body.centre)
    if np.abs(arm[:2]).max() > 1e-9 * abs(arm[2]):
        raise ValueError(f"the tip of body {body.name!r} is not on its axis")


def top(plan: Plan) -> None:
    heavy_top(plan.scene.body, plan.scene.pinned, plan.scene.gravity or (0.0, 0.0, 0.0))


def _chain(body: Body) -> bool:
    """Return whether springs join each particle of a body to the next, and no others."""
    return len(body.masses) > 1 and np.array_equal(body.springs, list(pairwise(range(len(body.masses)))))


def rope(plan: Plan) -> None:
    if not _chain(plan.scene.body) or plan.scene.pinned != (0,):
        raise ValueError("it applies to a rope: a chain of springs, pinned at its first particle")


def rigid_body(plan: Plan) -> None:
    check_rigid(plan.scene, rigid.integrator(rigid.default(plan.scene)))


def flips(plan: Plan) -> None:
    """Raise ValueError unless a body's angular momentum comes near to its middle axis.

    On the polhode, H² = Σ Hᵢ² and 2T = Σ Hᵢ²/Iᵢ. The middle component is largest where that along the axis
    of least moment or, if H² < 2T I₂, of greatest moment is zero: H₂² (1/I₂ − 1/I_c) = 2T − H²/I_c with the
    other of them, c, about which the body spins.
    """
    scene = plan.scene
    body = scene.body.with_(positions=scene.positions, lengths=scene.body.lengths)
    moments, principal = body.principal()
    if np.ptp(moments[:2]) < 1e-9 * moments[2] or np.ptp(moments[1:]) < 1e-9 * moments[2]:
        raise ValueError("two of its moments of inertia are equal: there is no middle axis")
    drift = scene.body.masses @ scene.velocities / body.mass
    arm = scene.positions - body.centre
    momentum = principal.T @ (scene.body.masses @ np.cross(arm, scene.velocities - drift))
    whole = float(momentum @ momentum)
    energy = float((momentum**2 / moments).sum())
    if not whole > 0:
        raise ValueError("it does not rotate")
    if abs(whole - energy * moments[1]) <= 1e-12 * whole:
        raise ValueError("it spins exactly about its middle axis, and nothing disturbs it")
    about = 2 if whole > energy * moments[1] else 0
    square = (energy - whole / moments[about]) / (1 / moments[1] - 1 / moments[about])
    angle = math.acos(math.sqrt(min(max(square / whole, 0.0), 1.0)))
    if angle > TURNS_OVER:
        raise ValueError(
            f"it spins about its axis of {'least' if about == 0 else 'greatest'} moment, where it is stable: "
            f"its angular momentum stays {math.degrees(angle):.0f}° away from the middle axis"
        )


def symmetric(plan: Plan) -> None:
    axial_moments(plan.scene.body, plan.scene.body.centre)


def struck(plan: Plan) -> None:
    """Raise ValueError if a body's lowest vibrations are not excited, or the body is rotated."""
    scene = plan.scene
    body = plan.scene.body
    frequencies, modes = vibrations(body)
    lowest = modes[frequencies < frequencies[0] * (1 + 1e-6)]
    excited = np.linalg.norm(np.einsum("qni,n,ni->q", lowest, body.masses, scene.velocities))
    if not excited > 1e-9 * np.linalg.norm(np.sqrt(body.masses)[:, None] * scene.velocities):
        raise ValueError("nothing excites its lowest vibration")
    shift = scene.positions - body.positions
    if np.abs(shift - shift.mean(axis=0)).max() > 1e-3 * np.ptp(body.positions, axis=0).max():
        raise ValueError(
            "it is rotated from the orientation in which it was made, and its vibrations with it"
        )


def slab(plan: Plan) -> None:
    one_held(plan)
    gravity(plan)
    held = next(placed for placed in plan.scene.bodies if placed.pinned)
    if not held.body.oriented:
        raise ValueError(
            f"body {held.name!r} has no orientation to define a slope: its markers lie on a line"
        )


def draped(plan: Plan) -> None:
    one_held(plan)
    gravity(plan)
    cord = next(placed.body for placed in plan.scene.bodies if not placed.pinned)
    if not _chain(cord):
        raise ValueError(f"body {cord.name!r} is not a rope, that is, a chain of springs")
