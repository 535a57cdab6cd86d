"""The problem that programs are compared on: the paper's top, and how far they are from its motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from benchmarks.timing import Case
from springgym.model.bodies import rotation, start, top
from springgym.model.bodies.distances import rms_distance
from springgym.model.scene import Scene
from springgym.simulator import PAPER_STEP, Simulator

WORK = 16e6
"""Springs × force evaluations in a run: some 20 ms. Threads are woken once in it."""


@cache
def paper_top(damping: float = 0.0, ring: int = 12) -> Scene:
    """Make the paper's top on its tip, tilted and spinning at 50 rad/s."""
    body = top(ring=ring, damping=damping)
    tip = body.parts["tip"]
    return Scene(body, *start(body, tilt=0.3, spin=50.0, pinned=tip), pinned=tip)


def stepping(
    what: Mapping[str, Any],
    scene: Scene,
    *,
    facts: Mapping[str, Any] | None = None,
    per_step: float = 1.0,
    **options: Any,
) -> Case:
    """Steps of all copies by a simulator without a ledger, and nothing else.

    At most 2000 steps are taken from the scene's start; each counts ``per_step`` units of work.
    """
    simulator = Simulator(scene, **({"ledger": False} | options))
    steps = WORK / (len(scene.springs) * simulator.integrator.evaluations * simulator.copies)
    count = int(min(max(steps, 20), 2000))
    began = simulator.state()
    return Case(
        what,
        lambda: simulator.advance(count, check=False),
        count * simulator.copies * per_step,
        lambda: simulator.restore(began),
        facts or {},
    )


def error(scene: Scene, dynamics: str = "springs", **options: Any) -> dict[str, float]:
    """Return the step of a simulator [ms], and its `rms_distance` from the exact motion after some 1 s."""
    simulator = Simulator(scene, dynamics=dynamics, ledger=False, **options)
    steps = round(1 / simulator.step)
    simulator.advance(steps)
    exact = exact_positions(scene, steps * simulator.step, dynamics)
    return {
        "step_ms": 1e3 * simulator.step,
        "error": rms_distance(simulator.positions[0], exact, scene.sizes),
    }


@cache
def exact_positions(scene: Scene, seconds: float, dynamics: str = "springs") -> np.ndarray:
    """Return nearly exact positions of the particles, (N, 3) [m]: steps of about 0.03 ms by a method of sixth
    order, or fourth order with dampers."""
    name = {"springs": "blanes_moan", "rigid": "kahan_li"}[dynamics]
    if dynamics == "springs" and scene.body.damping.any():
        name = "rk4"
    steps = math.ceil(16 * seconds / PAPER_STEP)
    simulator = Simulator(scene, dynamics=dynamics, integrator=name, step=seconds / steps, ledger=False)
    simulator.advance(steps)
    return simulator.positions[0]


def rounding(scene: Scene, **options: Any) -> dict[str, float]:
    """`rms_distance` of float32 from float64 in the same steps after 1 s and 10 s.

    The root mean square of 16 starts that differ by a turn about the vertical: the same but for rounding.
    """
    turns = [rotation((0, 0, 1), angle) for angle in 2 * math.pi * np.arange(16) / 16]
    both = [Simulator(scene, copies=16, dtype=dtype, ledger=False, **options) for dtype in ("f8", "f4")]
    for simulator in both:
        simulator.place(*(np.array([a @ r.T for r in turns]) for a in (scene.positions, scene.velocities)))
    found = {}
    for seconds, more in ((1, 1), (10, 9)):
        for simulator in both:
            simulator.advance(round(more / simulator.step))
        found[f"rounding_after_{seconds}_s"] = rms_distance(both[1].positions, both[0].positions, scene.sizes)
    return found
