"""For every check of every scene a change of the scene after which the check does not pass.

``python -m tests.scenes.sabotage`` prints all as a table, or those of scenes that it is given.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import yaml

from springgym.scenes import load, names, recording
from springgym.scenes.checks import Check, check, fitting
from springgym.scenes.plan import Plan
from springgym.simulator import Simulator
from springgym.strict_yaml import read_yaml

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


def by_the_papers_method(plan: Plan) -> Plan:
    """In steps of 5 ms: rk4 does not see where the barrier begins."""
    scene = plan.scene.with_(contact=plan.paper)
    return replace(plan, scene=scene, integrator="rk4", step=5e-3, interval=5e-3)


def thrown_by_the_papers_method(plan: Plan) -> Plan:
    """Downwards, with 5 m/s."""
    thrown = plan.scene.with_(velocities=np.array([[0.0, 0.0, -5.0]]))
    return by_the_papers_method(replace(plan, scene=thrown))


SOLID = ("steel", "beech", "nylon", "rubber")


def implicit_euler(step: float) -> dict[str, Any]:
    """It takes energy."""
    return {"integrator": "implicit_euler", "step": step}


def wall(x: float) -> dict[str, Any]:
    """It turns back what comes."""
    return {
        "surfaces": [{"kind": "plane", "point": [x, 0, 0], "normal": [-1, 0, 0]}],
        "contact": {"strength": 4e-4, "reach": 0.002},
    }


SIDEWAYS = [0.5, 0, -9.81]
TURNED = {"gravity": SIDEWAYS, "start.precession": 1.0}
HARD = {"0": [-400, 0, 0], "3": [0, 400, 0], "6": [400, 0, 0], "9": [0, -400, 0]}

_TABLE: tuple[tuple[str, str, Change], ...] = (
    # tops about their tip: softer springs, quakes, less spin
    ("top top-waves elongated-top", "nutation", {"body.stiffness": 1e5}),
    ("steady-top fast-top gyroscope", "steady_precession", {"body.stiffness": 1e5}),
    ("sleeping-top waking-top", "sleep", {"start.spin": 39.2}),
    ("unbalanced-top", "twin", {"body.stiffness": 1e5}),
    ("steel-top beech-top nylon-top rubber-top", "spin_gap", {"start.kick": {"heart": [0.3, 0, 0]}}),
    ("side-by-side", "spin_gap", {f"bodies.{one}.start.kick": {"heart": [0.3, 0, 0]} for one in SOLID}),
    ("top top-waves elongated-top unbalanced-top", "momentum", {"gravity": SIDEWAYS}),
    ("sleeping-top waking-top", "momentum", {"gravity": SIDEWAYS}),
    ("steady-top fast-top gyroscope", "momentum", TURNED),
    ("steel-top beech-top nylon-top rubber-top", "momentum", TURNED),
    (
        "side-by-side",
        "momentum",
        {"gravity": SIDEWAYS} | {f"bodies.{one}.start.precession": 1.0 for one in SOLID},
    ),
    ("top top-waves elongated-top unbalanced-top", "energy", implicit_euler(1e-3)),
    ("sleeping-top waking-top steady-top fast-top gyroscope", "energy", implicit_euler(1e-3)),
    ("steel-top beech-top nylon-top rubber-top side-by-side", "energy", implicit_euler(1e-4)),
    # tops on a surface: so slow that the rim comes down, a tip that sticks or slides
    ("top-on-ice top-with-friction", "axial_spin", {"start.spin": 3}),
    ("top-in-bowl", "axial_spin", {"start.spin": 5}),
    ("top-with-friction", "rubbing", {"contact.friction": 0.5}),
    ("top-in-bowl", "resting_tip", {"contact.friction": 0.001}),
    (
        "top-on-ice",
        "straight_fall",
        {
            "start.velocity": [0.5, 0, 0],
            "surfaces": [{"kind": "floor"}, {"kind": "plane", "point": [0.9, 0, 0], "normal": [-1, 0, 0]}],
        },
    ),
    ("top-in-bowl top-on-ice top-with-friction", "energy", {"start.velocity": [0, 0, -20]}),
    # pendulums and ropes: pushed aside, farther, more damped or less
    ("cube-pendulum cube-pendulum-high", "pendulum", {"start.omega": [0, 0, 1]}),
    ("irregular-pendulum", "small_swings", {"start.turn": [0.3, 0.3, 0]}),
    ("rope-hanging", "rope_stretch", {"body.damping": 50}),
    ("rope-pluck", "rope_modes", {"start.kick.2": [2, 0, 0]}),
    ("rope-swing", "rope_swing", {"start.omega": [0, 0, 1]}),
    ("bungee", "bungee", {"body.bead_mass": 1}),
    ("steel-rope nylon-rope", "cable", {"start.kick": {"weight": [5, 0, 0]}}),
    ("cube-pendulum cube-pendulum-high irregular-pendulum", "energy", implicit_euler(1e-3)),
    ("rope-hanging rope-pluck rope-swing bungee", "energy", implicit_euler(1e-3)),
    ("steel-rope nylon-rope", "energy", implicit_euler(1e-3)),
    # free bodies: with dampers or without, struck too hard, by methods that keep less
    ("flipping-box", "flips", {"body.damping": 1000}),
    ("spun-pair", "spun_length", {"body.damping": 0}),
    ("ringing-rubber-top", "ring_frequency", {"start.kick": {"0": [-20, 0, 0], "6": [20, 0, 0]}}),
    ("ringing-top", "ring_frequency", {"start.kick": HARD}),
    ("ringing-top ringing-rubber-top", "ring_down", dampers_of_a_tenth_more),
    ("turning-over", "wobble", implicit_euler(1.2e-4)),
    ("flipping-box", "momentum", {"integrator": "rk4", "step": 1e-3}),
    ("spun-pair", "momentum", {"integrator": "rk4", "step": 5e-3}),
    ("turning-over", "momentum", {"integrator": "rk4", "step": 2e-5}),
    ("flipping-box spun-pair", "energy", implicit_euler(5e-3)),
    ("ringing-top", "energy", {"step": 5e-7}),
    ("ringing-rubber-top", "energy", {"step": 1e-4}),
    ("turning-over", "energy", {"step": 3e-5}),
    (
        "steel-top beech-top nylon-top rubber-top ringing-top turning-over steel-cube rubber-cube",
        "solid_inertia",
        heavier_by_a_billionth,
    ),
    # contact: without the loss that lets it rest, too deep, too coarse
    ("bouncing-ball", "bounces", {"contact.restitution": 0.9}),
    ("bouncing-ball-lossy", "restitution", {"contact.reach": 0.2}),
    ("cube-drop irregular-fall", "rest_height", {"contact.restitution": 1, "body.damping": 0}),
    ("sliding-block", "stopping", {"start.omega": [0, 0, 6]}),
    ("block-holds", "slope", {"start.velocity": [-3, 0, 0]}),
    ("block-slides", "slope", {"start.omega": [0, 0, 6]}),
    # what rolls: spun the wrong way, too soft, too slow to turn over, on ice, too slow to lie so, thrown
    ("ball-rolls", "rolling", {"start.omega": [0, 40, 0]}),
    ("ball-skids", "skidding", {"body.stiffness": 5e3}),
    ("ball-stops", "rolling_resistance", {"body.stiffness": 5e3}),
    ("tippe-top", "tippe_top", {"start.omega": [0, 0, 30]}),
    ("rattleback", "rattleback", {"contact.friction": 0.02}),
    ("euler-disk", "euler_disk", {"start.precession": 30}),
    (
        "ball-rolls ball-skids ball-stops",
        "energy",
        {"start.velocity": [0, 0, -5], "body.damping": 0, "interval": 0.001, "step": 1e-3},
    ),
    ("tippe-top rattleback", "energy", {"start.velocity": [0, 0, -30]}),
    ("euler-disk", "energy", {"start.velocity": [0, 0, -5]}),
    ("spinning-egg", "egg", {"start.omega": [0, 0, 60]}),
    ("spinning-egg", "energy", {"start.velocity": [0, 0, -30]}),
    ("walking-top", "walking", {"contact.friction": 0.05}),
    ("walking-top", "energy", {"start.velocity": [0, 0, -30]}),
    ("bowl-ball", "bowl_period", {"start.position": [1.0, 0, 0.288]}),
    ("pipe-ball", "pipe_period", {"start.position": [1.0, -1, 0.288]}),
    ("rubber-cube", "impact", {"start.turn": [0.3, 0.2, 0]}),
    ("steel-cube", "impact", {"step": 1e-6}),
    ("bouncing-ball bouncing-ball-lossy", "energy", by_the_papers_method),
    ("bowl-ball pipe-ball wavy-ground", "energy", thrown_by_the_papers_method),
    ("block-holds block-slides sliding-block", "energy", {"start.height": 2.0, "body.damping": 0}),
    ("irregular-fall", "energy", {"step": 4e-4}),
    ("cube-drop", "energy", {"contact.reach": 1e-7}),
    ("rubber-cube", "energy", {"contact.reach": 1e-7, "step": 6e-5}),
    ("steel-cube", "energy", {"contact.reach": 1e-8, "step": 1e-6}),
    # bodies that collide: too soft, three at a time, a wall, too fast
    ("balls-head-on", "exchange", {"bodies.left.start.velocity": [200, 0, 0]}),
    ("balls-oblique", "exchange", {"collisions.reach": 0.05}),
    ("newtons-cradle", "cradle", {"bodies.third.start.position": [0.2002, 0, 0]}),
    ("balls-head-on balls-oblique", "momentum", wall(0.4)),
    ("newtons-cradle", "momentum", wall(0.9)),
    ("balls-head-on balls-oblique", "energy", {"bodies.left.start.velocity": [30, 0, 0]}),
    ("newtons-cradle", "energy", {"bodies.first.start.velocity": [60, 0, 0]}),
    ("balls-head-on balls-oblique two-tops", "counted", {"bodies.left.start.velocity": [200, 0, 0]}),
    ("newtons-cradle", "counted", {"bodies.first.start.velocity": [200, 0, 0]}),
    ("billiard-break", "billiards", {"contact.friction": 0.005}),
    ("billiard-follow", "billiards", {"bodies.cue.start.omega": [0, 0, 0]}),
    ("billiard-cushion", "cushion", {"bodies.reverse.start.velocity": [1, 0.5, -1]}),
    ("turntable", "turntable", {"collisions.friction": 0.02}),
    ("billiard-break", "counted", {"bodies.cue.start.velocity": [8, 0, 0]}),
    ("billiard-follow", "counted", {"bodies.cue.start.velocity": [4, 0, 0]}),
    ("billiard-cushion", "counted", {"bodies.plain.start.velocity": [6, 0.5, 0]}),
    ("turntable", "counted", {"bodies.ball.start.velocity": [0, 0.4, -3]}),
    ("pile", "counted", {"bodies.c35.start.velocity": [0, 0, -10]}),
    ("pile-300", "counted", {"bodies.c300.start.velocity": [0, 0, -10], "duration": 0.2}),
    (
        "billiard-break billiard-follow",
        "energy",
        {"bodies.cue.start.velocity": [0.9, 0, -5], "step": 2e-4, "interval": 0.001},
    ),
    (
        "billiard-cushion",
        "energy",
        {"bodies.plain.start.velocity": [1, 0.5, -5], "step": 2e-4, "interval": 0.001},
    ),
    (
        "turntable",
        "energy",
        {"bodies.table.start.velocity": [0, 0, -20], "bodies.table.body.damping": 0, "step": 3e-4},
    ),
    ("pile", "pile", {"contact.restitution": 1, "contact.friction": 0, "duration": 2}),
    ("pile-300", "pile", {"contact.restitution": 1, "contact.friction": 0, "duration": 2.3}),
    ("pile", "energy", {"step": 5.5e-4, "bodies.c35.start.velocity": [0, 0, -120], "duration": 0.2}),
    ("pile-300", "energy", {"step": 5.5e-4, "bodies.c300.start.velocity": [0, 0, -120], "duration": 0.2}),
    ("slab-holds", "slab", {"bodies.block.start.velocity": [-2, 0, -0.85]}),
    ("slab-slides", "slab", {"bodies.block.start.omega": [0, 0, 4]}),
    (
        "slab-holds slab-slides",
        "energy",
        {"step": 7e-4, "bodies.block.body.damping": 0, "bodies.block.start.velocity": [0, 0, -60]},
    ),
    ("slab-holds slab-slides", "counted", {"bodies.block.start.velocity": [0, 0, -150]}),
    ("stack", "stacked", {"contact.restitution": 1, "contact.friction": 0, "duration": 2}),
    ("stack", "energy", {"bodies.top.start.velocity": [0, 0, -60]}),
    ("stack", "counted", {"bodies.top.start.velocity": [0, 0, -200]}),
    ("draped-rope", "draped", {"contact.friction": 0.05}),
    ("draped-rope", "energy", {"step": 8e-4, "bodies.rope.start.velocity": [0, 0, -30]}),
    ("draped-rope", "counted", {"bodies.rope.start.velocity": [0, 0, -150]}),
    ("dominoes", "wave", {"collisions.restitution": 0.6}),
    (
        "dominoes",
        "energy",
        {"bodies.d0.start.velocity": [0, 0, -6], "bodies.d0.body.damping": 0, "step": 1e-4},
    ),
    ("dominoes", "counted", {"bodies.d0.start.omega": [0, 300, 0]}),
    ("two-tops", "bowl_turning", {"step": 4e-4}),
    ("two-tops", "energy", {"step": 5e-4}),
)

SABOTAGE: dict[tuple[str, str], Change] = {
    (scene, name): change for scenes, name, change in _TABLE for scene in scenes.split()
}
"""By scene and check."""


def pairs() -> list[tuple[str, str]]:
    """Every check of every scene that comes with the package, those of its bodies included."""
    found = []
    for scene in names():
        plan = load(scene)
        checks = {*plan.checks, *(name for part in plan.parts for name in part.checks)}
        found += [(scene, name) for name in sorted(checks)]
    return found


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
    # what is too fast for the step goes on, and is counted
    with mock.patch.object(recording, "Simulator", partial(Simulator, unresolved="count")):
        return check(recording.record(plan))


def notices(found: list[Check]) -> bool:
    """Tell whether a check saw something, and does not pass."""
    return any(not result.passed and not np.isnan(result.measured) for result in found)


def _told(change: Change) -> str:
    if callable(change):
        return change.__name__.replace("_", " ")
    return ", ".join(f"{keys}: {value}" for keys, value in change.items())


def main() -> None:
    """Print the table, with what each check says, and of what."""
    print("| scene | check | change | first to be off | by, in tolerances | verdict |")
    print("|---|---|---|---|---|---|")
    wanted = sys.argv[1:] or names()
    for scene, name in pairs():
        if scene not in wanted:
            continue
        change = SABOTAGE[scene, name]
        with tempfile.TemporaryDirectory() as folder:
            found = after(scene, name, change, Path(folder))
        wrong = [result for result in found if not result.passed and not np.isnan(result.measured)]
        wrong.sort(key=lambda result: not result.covered)
        verdict = "**passes**" if not wrong else "FAILED" if wrong[0].covered else "not covered"
        first = wrong[0] if wrong else found[0]
        by = abs(first.measured - first.theory) / first.tolerance
        print(f"| {scene} | {name} | {_told(change)} | {first.quantity} | {by:.2g} | {verdict} |", flush=True)


if __name__ == "__main__":
    main()
