"""``springgym model``: only what a scene needs. The cheapest model of a top for a wanted precession.

A real top precesses slower than a rigid one by the share that its spin stretches it, see
`springgym.bodies.precession.precession_gap`: 7e-7 for steel. Whoever can do with less than that may make it
softer, and so take longer steps; or rigid. Here each is tried, its error measured and its cost.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from springgym.bodies import Body, softened, start
from springgym.bodies.motion import axes
from springgym.bodies.precession import heavy_top, precession_gap
from springgym.scene import Scene
from springgym.scenes.checks.tops import angles, mean_rate
from springgym.scenes.plan import Plan
from springgym.scenes.reading import load
from springgym.scenes.recording import record
from springgym.simulator import DYNAMICS, SimulationDivergedError, Simulator
from springgym.theory.top import steady_precession

SOFTEST = 0.05
"""Tops whose own gap would be larger than this are not made: their springs leave what they are meant for."""

COARSEST = 10
"""Implicit methods are tried from so many steps a revolution on, and then with ever half the step."""


class Model(NamedTuple):
    """A way to simulate a top."""

    dynamics: str
    integrator: str
    softened: float
    """factor by which its material is made softer; 1 for rigid dynamics, which has none"""
    step: float
    """[s]"""
    error: float
    """measured share by which it precesses faster or slower than the real top"""
    cost: float
    """computing time of a simulated second [s], on this machine, without compiling"""


class Need(NamedTuple):
    """What is asked for, and the models that were tried, the cheapest first."""

    tilt: float
    """[rad]"""
    spin: float
    """[rad/s]"""
    rigid: float
    """precession of the rigid top [rad/s]"""
    gap: float
    """share by which the real one is faster (slower if negative)"""
    wanted: float
    """largest error"""
    models: list[Model]

    @property
    def cheapest(self) -> Model:
        """The cheapest whose error is at most the one wanted.

        Raises
        ------
        ValueError
            If none is: not even the real material at a step of the stability limit.
        """
        for model in self.models:
            if model.error <= self.wanted:
                return model
        raise ValueError(f"no model precesses within {self.wanted:g} of the real top; take smaller steps")


def needed(
    plan: Plan, wanted: float, implicit: tuple[str, ...] = ("tr_bdf2",), duration: float = 1.0
) -> Need:
    """The models of a top in slow steady precession, each with its measured error and cost.

    Parameters
    ----------
    plan
        A top pinned at its tip; its start gives tilt and spin.
    wanted
        Largest share by which the precession may differ from that of the real top, the plan's.
    implicit
        Methods that are tried on the real material with steps as long as their error allows.
    duration
        Simulated for each [s].

    Raises
    ------
    ValueError
        If the plan is of no heavy top, it has no steady precession, or the share is not positive.
    """
    if not 0 < wanted < 1:
        raise ValueError(f"the wanted share is {wanted}; it must lie between 0 and 1")
    scene = plan.scene
    pull = scene.gravity or (0.0, 0.0, 0.0)
    top = heavy_top(scene.body, scene.pinned, pull)
    tilt, spin = _turning(scene)
    rigid = float(steady_precession(top, tilt, spin)[0])
    gap = precession_gap(scene.body, scene.pinned, pull, tilt, spin)

    def tried(dynamics: str, integrator: str, factor: float, step: float | None) -> Model:
        body = softened(scene.body, factor)
        begun = start(
            body,
            tilt=tilt,
            spin=spin,
            precession=rigid,
            pinned=scene.pinned,
            gravity=scene.gravity,
            stretched=dynamics == "springs",
        )
        made = scene.with_(body=body, positions=begun.positions, velocities=begun.velocities)
        run = replace(
            plan, scene=made, integrator=integrator, step=step, duration=duration, interval=duration / 500
        )
        try:
            recording = record(run, dynamics=dynamics)
        except SimulationDivergedError:
            return Model(dynamics, integrator, factor, step or math.nan, math.inf, math.inf)
        rate = mean_rate(recording.times, angles(recording)[1])
        error = abs(rate / (rigid * (1 + gap)) - 1)
        simulator = Simulator(made, dynamics=dynamics, integrator=integrator, step=recording.step)
        steps = max(1, round(0.1 * duration / recording.step))
        costs = []
        for _ in range(3):
            before = time.perf_counter()
            simulator.advance(steps)
            costs.append((time.perf_counter() - before) / (steps * recording.step))
        return Model(dynamics, integrator, factor, recording.step, error, min(costs))

    models = [
        tried("rigid", DYNAMICS["rigid"].default(scene), 1.0, None),
        tried("springs", "verlet", 1.0, None),
    ]
    factor = _softest(scene.body, scene.pinned, pull, tilt, spin, gap, wanted)
    if factor > 1.01:
        models.append(tried("springs", "verlet", factor, None))
    for integrator in implicit:
        step = 2 * math.pi / spin / COARSEST
        model = tried("springs", integrator, 1.0, step)
        while model.error > wanted and step > 2 * models[1].step:
            step /= 2
            model = tried("springs", integrator, 1.0, step)
        models.append(model)
    return Need(tilt, spin, rigid, gap, wanted, sorted(models, key=lambda model: model.cost))


def _turning(scene: Scene) -> tuple[float, float]:
    """Tilt of the axis [rad] and ω along it [rad/s] that a scene starts with."""
    x, body = scene.positions, scene.body
    axis = axes(x, body.frame)[:, 2]
    r = x - x[scene.pivot]
    momentum = body.masses @ np.cross(r, scene.velocities)
    placed = body.with_(positions=x, lengths=body.lengths)
    omega = np.linalg.solve(placed.inertia(x[scene.pivot]), momentum)
    return math.acos(float(np.clip(axis[2], -1, 1))), float(omega @ axis)


def _softest(
    body: Body,
    pinned: tuple[int, ...],
    gravity: tuple[float, float, float],
    tilt: float,
    spin: float,
    gap: float,
    wanted: float,
) -> float:
    """The factor by which a top may be made softer to precess within a share of the real one."""
    most = min(abs(gap) + 0.95 * wanted, SOFTEST)  # the rest is for the steps
    factor = most / abs(gap)
    for _ in range(3):  # the gap grows a little faster than the factor
        own = precession_gap(softened(body, max(1.0, factor)), pinned, gravity, tilt, spin)
        factor *= most / abs(own)
    return max(1.0, factor)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument("scene", help="name of a scene with a top, as steel-top, or a YAML file")
    parser.add_argument(
        "--gap", type=float, default=1e-3, help="largest error of the precession, a share (1e-3)"
    )
    parser.add_argument(
        "--implicit", nargs="*", default=["tr_bdf2"], metavar="METHOD", help="implicit methods to try, too"
    )


def run(args: argparse.Namespace) -> int:
    """Do what the arguments ask for; the exit status."""
    plan = load(args.scene)
    need = needed(plan, args.gap, tuple(args.implicit))
    print(
        f"{plan.name}: tilt {need.tilt:.4g} rad, spin {need.spin:.5g} rad/s; a rigid top precesses at "
        f"{need.rigid:.7g} rad/s, the real one {abs(need.gap):.2g} {'slower' if need.gap < 0 else 'faster'}"
    )
    print(f"wanted: the precession within {need.wanted:g} of the real one")
    best = need.cheapest
    heads = ("", "dynamics", "method", "softer by", "step", "error", "computing a second takes")
    print(_row(heads))
    for model in need.models:
        print(
            _row(
                (
                    "→" if model == best else "" if model.error <= need.wanted else "no",
                    model.dynamics,
                    model.integrator,
                    "" if model.dynamics == "rigid" else f"{model.softened:.4g}",
                    f"{model.step:.2g} s",
                    f"{model.error:.1e}",
                    f"{1e3 * model.cost:.3g} ms",
                )
            )
        )
    return 0


def _row(cells: tuple[str, ...]) -> str:
    widths = (3, 9, 9, 10, 10, 9, 25)
    return "".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()
