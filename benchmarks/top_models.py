"""Find the cheapest model of a top that precesses within a given error: ``python -m benchmarks.top_models``.

A real top precesses more slowly than a rigid one, because spin stretches it, see
`springgym.model.bodies.precession.precession_gap`: the relative difference is 7e-7 for steel. If you accept a
larger error, you can make the top softer and take longer steps, or make it rigid. This command tries such
models, and measures their error and cost. *Materials* in the documentation shows it.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from springgym.checks import TINY, number
from springgym.cli import guarded, significant
from springgym.dynamics.methods import METHODS
from springgym.dynamics.stepping import plan_steps
from springgym.model.bodies import Body, softened, solid_top, start
from springgym.model.bodies.elastic import Elastic
from springgym.model.bodies.precession import heavy_top, precession_gap
from springgym.model.bodies.rotations import axes
from springgym.model.materials import MATERIALS, Material
from springgym.model.scene import Scene
from springgym.scenes.checks.tops import angles, mean_rate
from springgym.scenes.plan import Plan
from springgym.scenes.reading import load
from springgym.scenes.recording import record
from springgym.simulator import SimulationDivergedError, Simulator
from springgym.theory.top import steady_precession

SOFTEST = 0.05
"""Largest gap of the tops that are tried: the springs of others stretch beyond the limits of the model."""

COARSEST = 10
"""Least number of steps per revolution for implicit methods. Further trials halve the step."""


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


class Steady(NamedTuple):
    """The slow steady precession of a top."""

    tilt: float
    """[rad]"""
    spin: float
    """[rad/s]"""
    rigid: float
    """rate of the rigid top [rad/s]"""
    gap: float
    """share by which the elastic one is faster (slower if negative)"""


class Need(NamedTuple):
    """A request for a model, and the models that were tried, the cheapest first."""

    steady: Steady
    wanted: float
    """largest error"""
    models: list[Model]

    @property
    def cheapest(self) -> Model:
        """Return the cheapest model whose error is at most the wanted one.

        Raises
        ------
        ValueError
            If none is: not even the real material at a step of the stability limit.
        """
        for model in self.models:
            if model.error <= self.wanted:
                return model
        raise ValueError(f"no model precesses within {self.wanted:g} of the real top; take smaller steps")


def needed(plan: Plan, wanted: float, implicit: Sequence[str] = ("tr_bdf2",), duration: float = 1.0) -> Need:
    """Model a top in slow steady precession in several ways, each with its measured error and cost.

    Parameters
    ----------
    plan
        A top pinned at its tip; its start gives tilt and spin.
    wanted
        Largest share by which the precession may differ from that of the real top, the plan's; below 1.
    implicit
        Methods that are tried on the real material with steps as long as their error allows.
    duration
        Simulated for each [s].

    Raises
    ------
    ValueError
        If the plan is of several bodies or no heavy top, or it has no steady precession.
    """
    steady = steady_of(plan)
    scene = plan.scene

    def tried(dynamics: str, integrator: str, factor: float = 1.0, step: float | None = None) -> Model:
        try:
            body = softened(scene.body, factor)
            rate, simulator = _precessing(plan, body, steady, duration, dynamics, integrator, step)
        except SimulationDivergedError:
            return Model(dynamics, integrator, factor, step or math.nan, math.inf, math.inf)
        error = abs(rate / (steady.rigid * (1 + steady.gap)) - 1)
        cost = _cost(simulator, max(1, round(0.1 * duration / simulator.step)))
        return Model(dynamics, integrator, factor, simulator.step, error, cost)

    models = [
        tried("rigid", plan_steps(scene, dynamics="rigid").method.name),
        real := tried("springs", "verlet"),
    ]
    factor = _softest(scene, steady, wanted)
    if factor > 1.01:
        models.append(tried("springs", "verlet", factor))
    for integrator in implicit:
        step = 2 * math.pi / abs(steady.spin) / COARSEST
        model = tried("springs", integrator, 1.0, step)
        while model.error > wanted and step > 2 * real.step:
            step /= 2
            model = tried("springs", integrator, 1.0, step)
        models.append(model)
    return Need(steady, wanted, sorted(models, key=lambda model: model.cost))


def steady_of(plan: Plan) -> Steady:
    """Return the steady precession of the top of a plan."""
    scene = plan.scene
    if len(scene.bodies) > 1:
        raise ValueError(f"scene {plan.name!r} has {len(scene.bodies)} bodies; it must have one, a heavy top")
    heavy_top(scene.body, scene.pinned, scene.gravity or (0.0, 0.0, 0.0))
    return _steady(scene.body, scene, *_turning(scene))


def _turning(scene: Scene) -> tuple[float, float]:
    """Return the tilt of the axis [rad] and ω along it [rad/s] that a scene starts with."""
    x = scene.positions
    body = scene.body
    axis = axes(x, body.markers)[:, 2]
    r = x - x[scene.pivot]
    momentum = body.masses @ np.cross(r, scene.velocities)
    placed = body.with_(positions=x, lengths=body.lengths)
    omega = np.linalg.solve(placed.inertia(x[scene.pivot]), momentum)
    return math.acos(float(np.clip(axis[2], -1, 1))), float(omega @ axis)


def _steady(body: Body, scene: Scene, tilt: float, spin: float) -> Steady:
    """Put the precession of a body instead of that of a scene."""
    pull = scene.gravity or (0.0, 0.0, 0.0)
    rigid = steady_precession(heavy_top(body, scene.pinned, pull), tilt, spin)[0]
    return Steady(tilt, spin, float(rigid), precession_gap(body, scene.pinned, pull, tilt, spin))


def _precessing(
    plan: Plan,
    body: Body,
    steady: Steady,
    duration: float,
    dynamics: str = "springs",
    integrator: str = "verlet",
    step: float | None = None,
) -> tuple[float, Simulator]:
    """Return a body's mean precession [rad/s] from a start at the rigid top's rate, and its simulator."""
    begun = start(
        body,
        tilt=steady.tilt,
        spin=steady.spin,
        precession=steady.rigid,
        pinned=plan.scene.pinned,
        gravity=plan.scene.gravity,
        stretched=dynamics == "springs",
    )
    scene = plan.scene.with_(body=body, positions=begun.positions, velocities=begun.velocities)
    run = replace(
        plan, scene=scene, integrator=integrator, step=step, duration=duration, interval=duration / 500
    )
    recording = record(run, dynamics=dynamics)
    rate = mean_rate(recording.times, angles(recording)[1])
    return rate, Simulator(scene, dynamics=dynamics, integrator=integrator, step=recording.step)


def _softest(scene: Scene, steady: Steady, wanted: float) -> float:
    """Return the factor by which a top may be made softer to precess within a share of the real one."""
    most = min(abs(steady.gap) + 0.95 * wanted, SOFTEST)  # the rest is for the steps
    factor = most / abs(steady.gap)
    for _ in range(3):  # the gap grows a little faster than the factor
        own = _steady(softened(scene.body, max(1.0, factor)), scene, steady.tilt, steady.spin).gap
        factor *= most / abs(own)
    return max(1.0, factor)


# --- Real tops --------------------------------------------------------------------------------------

COPIES = 256
"""Copies of a batch whose speed is measured."""


def real_top(material: Material | str, duration: float = 1.0) -> dict[str, str]:
    """Return a row of the table of real tops: a solid cone of a material by verlet at its default step.

    The gap is the share by which it precesses faster than a rigid top, measured and predicted, and over that
    of the solid, see `springgym.model.bodies.elastic.Elastic`; dI₃/I₃ the share by which spin makes its
    largest moment grow; alone and batch are simulated seconds in a second, of one copy and of `COPIES`
    together."""
    plan = load("steel-top")
    body = solid_top(0.03, 0.04, material)
    steady = _steady(body, plan.scene, *_turning(plan.scene))
    rate, alone = _precessing(plan, body, steady, duration)
    batch = Simulator(alone.scene, step=alone.step, copies=COPIES)
    steps = max(1, round(0.1 * duration / alone.step))
    solid = body.solid
    assert isinstance(solid, Elastic)
    return {
        "": str(solid.material),
        "g": f"{1e3 * body.mass:.0f}",
        "lowest Hz": significant(solid.frequency / (2 * math.pi), 4),
        "step s": f"{alone.step:.2g}",
        "dI₃/I₃": f"{float(solid.stretch[2]) * steady.spin**2:.1e}",
        "gap": f"{rate / steady.rigid - 1:.3e}",
        "predicted": f"{steady.gap:.3e}",
        "of the solid's": f"{solid.precession_ratio or math.nan:.2f}",
        "alone": significant(1 / _cost(alone, steps), 2),
        "batch": significant(COPIES / _cost(batch, max(1, round(steps / COPIES**0.5))), 2),
    }


def _cost(simulator: Simulator, steps: int) -> float:
    """Return the computing time of a simulated second [s]: the best of three, without compiling."""
    simulator.advance(1)
    costs = []
    for _ in range(3):
        before = time.perf_counter()
        simulator.advance(steps)
        costs.append((time.perf_counter() - before) / (steps * simulator.step))
    return min(costs)


def table_of_tops(materials: Iterable[str]) -> Iterator[str]:
    """Return lines of a table of real tops, in Markdown."""
    for n, row in enumerate(map(real_top, materials)):
        if n == 0:
            yield f"| {' | '.join(row)} |"
            yield "|---" * len(row) + "|"
        yield f"| {' | '.join(row.values())} |"


# --- The command ------------------------------------------------------------------------------------


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit status."""
    parser = argparse.ArgumentParser(
        "benchmarks.top_models", description="Find the cheapest top model that meets an error tolerance."
    )
    parser.add_argument(
        "scene", nargs="?", help="name of a scene with a top, such as steel-top, or a YAML file"
    )
    parser.add_argument(
        "--gap", type=float, default=1e-3, help="largest relative error of the precession (default: 1e-3)"
    )
    parser.add_argument(
        "--implicit",
        nargs="*",
        default=["tr_bdf2"],
        choices=METHODS,
        metavar="METHOD",
        help="implicit methods to try as well",
    )
    parser.add_argument("--tops", action="store_true", help="measure a top of every material")
    args = parser.parse_args(arguments)
    if args.scene is None and not args.tops:
        parser.error("name a scene with a top, such as steel-top, or use --tops for a top of every material")
    return guarded(parser.prog, lambda: run(args), extra="scenes")


def run(args: argparse.Namespace) -> int:
    """Do what the arguments ask for; the exit status."""
    if args.tops:
        lines = table_of_tops(MATERIALS)
    else:
        number("--gap", args.gap, TINY, 1.0)
        plan = load(args.scene)
        lines = _said(plan, needed(plan, args.gap, args.implicit))
    for line in lines:
        print(line, flush=True)
    return 0


def _said(plan: Plan, need: Need) -> Iterator[str]:
    best = need.cheapest
    steady = need.steady
    slower = "slower" if steady.gap < 0 else "faster"
    yield (
        f"{plan.name}: tilt {steady.tilt:.4g} rad, spin {steady.spin:.5g} rad/s; a rigid top precesses at "
        f"{steady.rigid:.7g} rad/s, the real one {abs(steady.gap):.2g} {slower}"
    )
    yield f"wanted: the precession within {need.wanted:g} of the real one"
    yield _row(("", "dynamics", "method", "softer by", "step", "error", "computing a second takes"))
    for model in need.models:
        yield _row(
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


def _row(cells: tuple[str, ...]) -> str:
    widths = (3, 9, 9, 10, 10, 9, 25)
    return "".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()


if __name__ == "__main__":
    sys.exit(main())
