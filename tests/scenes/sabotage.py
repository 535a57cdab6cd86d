"""For every check a scene, and a change of the scene after which the check does not pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import yaml

from springgym.scenes import load, recording
from springgym.scenes.checks import Check, check, fitting
from springgym.scenes.plan import Plan
from springgym.scenes.strict_yaml import read_yaml
from springgym.simulator import Simulator

Change = dict[str, Any] | Callable[[Plan], Plan]
"""Values at keys of the file, joined by dots, or what to make of its plan."""


def heavier_by_a_billionth(plan: Plan) -> Plan:
    """One particle of a body that has the mass, centre and moments of a solid exactly."""
    body = plan.scene.body
    masses = body.masses * np.where(np.arange(len(body.masses)) == 0, 1 + 1e-9, 1.0)
    return replace(plan, scene=plan.scene.with_(body=body.with_(masses=masses, solid=body.solid)))


def dampers_of_a_tenth_more(plan: Plan) -> Plan:
    """Of a body that loses what its material loses."""
    body = plan.scene.body
    return replace(
        plan, scene=plan.scene.with_(body=body.with_(damping=1.1 * body.damping, solid=body.solid))
    )


def implicit_euler(step: float) -> dict[str, Any]:
    """It takes energy."""
    return {"integrator": "implicit_euler", "step": step}


SABOTAGE: dict[str, tuple[str, Change]] = {
    # tops about their tip: softer springs, quakes, less spin, methods that keep less
    "nutation": ("top", {"body.stiffness": 1e5}),
    "steady_precession": ("steady-top", {"body.stiffness": 1e5}),
    "sleep": ("waking-top", {"start.spin": 39.2}),
    "twin": ("unbalanced-top", {"body.stiffness": 1e5}),
    "spin_gap": ("beech-top", {"start.kick": {"heart": [0.3, 0, 0]}}),
    "momentum": ("top", {"gravity": [0.5, 0, -9.81]}),
    "energy": ("cube-pendulum", implicit_euler(1e-3)),
    # tops on a surface: so slow that the rim comes down, a tip that sticks or slides, a wall
    "axial_spin": ("top-with-friction", {"start.spin": 3}),
    "rubbing": ("top-with-friction", {"contact.friction": 0.5}),
    "resting_tip": ("top-in-bowl", {"contact.friction": 0.001}),
    "straight_fall": (
        "top-on-ice",
        {
            "start.velocity": [0.5, 0, 0],
            "surfaces": [{"kind": "floor"}, {"kind": "plane", "point": [0.9, 0, 0], "normal": [-1, 0, 0]}],
        },
    ),
    # pendulums and ropes: pushed aside, farther, more damped or less
    "pendulum": ("cube-pendulum", {"start.omega": [0, 0, 1]}),
    "small_swings": ("irregular-pendulum", {"start.rotation": [0.3, 0.3, 0]}),
    "rope_stretch": ("rope-hanging", {"body.damping": 50}),
    "rope_modes": ("rope-pluck", {"start.kick.2": [2, 0, 0]}),
    "rope_swing": ("rope-swing", {"start.omega": [0, 0, 1]}),
    "bungee": ("bungee", {"body.bead_mass": 1}),
    "cable": ("nylon-rope", {"start.kick": {"weight": [5, 0, 0]}}),
    # free bodies: with dampers or without, struck too hard, by methods that keep less
    "flips": ("flipping-box", {"body.damping": 1000}),
    "spun_length": ("spun-pair", {"body.damping": 0}),
    "ring_frequency": ("ringing-rubber-top", {"start.kick": {"0": [-20, 0, 0], "6": [20, 0, 0]}}),
    "ring_down": ("ringing-rubber-top", dampers_of_a_tenth_more),
    "wobble": ("turning-over", implicit_euler(1.2e-4)),
    "solid_inertia": ("beech-top", heavier_by_a_billionth),
    # contact: without the loss that lets it rest, too deep, too coarse
    "bounces": ("bouncing-ball", {"contact.restitution": 0.9}),
    "restitution": ("bouncing-ball-lossy", {"contact.reach": 0.2}),
    "rest_height": ("cube-drop", {"contact.restitution": 1, "body.damping": 0}),
    "stopping": ("sliding-block", {"start.omega": [0, 0, 6]}),
    "slope": ("block-slides", {"start.omega": [0, 0, 6]}),
    "bowl_period": ("bowl-ball", {"start.position": [1.0, 0, 0.288]}),
    "pipe_period": ("pipe-ball", {"start.position": [1.0, -1, 0.288]}),
    "impact": ("rubber-cube", {"start.rotation": [0.3, 0.2, 0]}),
    # what rolls: spun the wrong way, too soft, too slow to turn over, on ice, too slow to lie so
    "rolling": ("ball-rolls", {"start.omega": [0, 40, 0]}),
    "skidding": ("ball-skids", {"body.stiffness": 5e3}),
    "rolling_resistance": ("ball-stops", {"body.stiffness": 5e3}),
    "tippe_top": ("tippe-top", {"start.omega": [0, 0, 30]}),
    "rattleback": ("rattleback", {"contact.friction": 0.02}),
    "euler_disk": ("euler-disk", {"start.precession": 30}),
    "egg": ("spinning-egg", {"start.omega": [0, 0, 60]}),
    "walking": ("walking-top", {"contact.friction": 0.05}),
    # bodies that collide: too soft, three at a time, too fast
    "exchange": ("balls-oblique", {"collisions.reach": 0.05}),
    "cradle": ("newtons-cradle", {"bodies.third.start.position": [0.2002, 0, 0]}),
    "counted": ("slab-slides", {"bodies.block.start.velocity": [0, 0, -150]}),
    "billiards": ("billiard-follow", {"bodies.cue.start.omega": [0, 0, 0]}),
    "cushion": ("billiard-cushion", {"bodies.reverse.start.velocity": [1, 0.5, -1]}),
    "turntable": ("turntable", {"collisions.friction": 0.02}),
    "pile": ("pile", {"contact.restitution": 1, "contact.friction": 0, "duration": 2}),
    "slab": ("slab-slides", {"bodies.block.start.omega": [0, 0, 4]}),
    "stacked": ("stack", {"contact.restitution": 1, "contact.friction": 0, "duration": 2}),
    "draped": ("draped-rope", {"contact.friction": 0.05}),
    "wave": ("dominoes", {"collisions.restitution": 0.6}),
    "bowl_turning": ("two-tops", {"step": 4e-4}),
}
"""By check: a scene, and a change of it."""


def changed(scene: str, change: Change, folder: Path) -> Plan:
    """The plan of a scene with a change; its file, if that is changed, is written into a folder."""
    if callable(change):
        return change(load(scene))
    with resources.as_file(resources.files("springgym.scenes") / f"{scene}.yaml") as path:
        document = read_yaml(path).value
    for keys, value in change.items():
        *inside, last = keys.split(".")
        place = document
        for key in inside:
            place = place.setdefault(key, {})
        place[last] = value
    path = folder / f"{scene}.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return load(str(path))


class Counting(Simulator):
    """A simulator that goes on, and counts what is too fast for its step."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, unresolved="count", **named)


def after(scene: str, name: str, change: Change, folder: Path) -> list[Check]:
    """Return what a check says of a scene with a change."""
    plan = changed(scene, change, folder)
    parts = tuple(replace(part, checks=(name,)) for part in plan.parts)
    plan = (
        replace(plan, checks=(name,), parts=())
        if name in plan.checks
        else replace(plan, checks=(), parts=parts)
    )
    fitting(plan)
    with mock.patch.object(recording, "Simulator", Counting):
        return check(recording.record(plan))


def notices(found: list[Check]) -> bool:
    """Tell whether a check saw something, and does not pass."""
    return any(not result.passed and not np.isnan(result.measured) for result in found)
