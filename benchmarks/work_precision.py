"""Error against cost: every method on every problem, over a ladder of steps.

Three errors are kept apart.

*Time*: what the steps do. The same springs, against a reference that two methods of different kind agree
on. It is the largest distance of a particle from the reference, at a quarter, half, three quarters and the
end of the time, over the body's size.

*Model*: what the springs do. The reference against rigid theory at k, 2k and 4k, with the fitted power.

*Local error*: where the motion is chaotic, the time error over one control period, from many states along
a run, in the mean square.

Cost is the time that steps take, in µs per simulated second: the median of runs that take turns with those
of all other methods, with their quartiles. Compiling is not in it.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from benchmarks.conditions import progress
from benchmarks.peers import mujoco_rungs, scipy_rungs
from benchmarks.problems import PROBLEMS, Problem
from benchmarks.timing import SAMPLES, Rung, Stepper, row_of, rows_of, rung_of
from springgym.dynamics.methods import integrator
from springgym.dynamics.methods.record import StepCount
from springgym.dynamics.stability import largest_step
from springgym.dynamics.stepping import plan_steps
from springgym.model.bodies.distances import largest_distance
from springgym.model.scene import Scene
from springgym.model.surfaces import Contact
from springgym.simulator import Simulator

TOLERANCES = (1e-3, 1e-5, 1e-7)
"""Errors that methods are compared at."""


def ladder(problem: Problem, scene: Scene, quick: bool) -> list[Rung]:
    """List all methods with steps, each from its stability limit down."""
    rungs = []
    halvings = 5 if quick else 8
    for name in problem.methods():
        method = integrator(name)
        first = edge(problem, scene, name)
        if method.adaptive:
            for n in range(3, 9 if quick else 13):
                rungs.append(own_rung(problem, scene, name, first, (10.0**-n, 10.0**-n)))
            continue
        if method.implicit:
            tolerance = (1e-10, 0.0) if method.iterative else None
            counts = [first * 2**n for n in range(halvings + 3)]
        else:
            tolerance = None
            counts = [first * 2**n for n in range(halvings)]
        if name == "verlet":
            counts = sorted({*counts, default_count(problem, scene)})
        rungs += [own_rung(problem, scene, name, count, tolerance) for count in counts]
    return rungs


def edge(problem: Problem, scene: Scene, name: str) -> int:
    """Return the fewest steps that a method can take: 2 % within its stability limit, 16 if it has none."""
    limit = min(0.98 * largest_step(scene, integrator(name)), problem.seconds / 16)
    return SAMPLES * math.ceil(problem.seconds / limit / SAMPLES)


def default_count(problem: Problem, scene: Scene) -> int:
    """Return the steps of the default method at its automatic step."""
    return SAMPLES * math.ceil(problem.seconds / plan_steps(scene).step / SAMPLES)


def _simulator(
    scene: Scene, name: str, step: float, tolerance: tuple[float, float] | None = None
) -> Simulator:
    return Simulator(scene, integrator=name, step=step, tolerance=tolerance, ledger=False)


def own_rung(
    problem: Problem, scene: Scene, name: str, count: int, tolerance: tuple[float, float] | None
) -> Rung:
    step = problem.seconds / count
    rung = rung_of(name, step, count, stepper(_simulator(scene, name, step, tolerance)))
    return rung._replace(step=tolerance[0]) if integrator(name).adaptive and tolerance else rung


def stepper(simulator: Simulator) -> Stepper:
    """Let a simulator take steps from the state it is in; it is compiled first."""
    method = simulator.integrator
    began = simulator.state()
    before = np.zeros(3)

    def begin() -> None:
        simulator.restore(began)
        if method.controlled:
            before[:] = simulator.counts()[0]

    def evaluations(steps: int) -> float:
        if not method.controlled:
            return float(method.evaluations * steps)
        counted = simulator.counts()[0] - before
        if method.iterative:
            return float(counted[StepCount.ITERATIONS] + steps)
        return float((counted[StepCount.STEPS] + counted[StepCount.REJECTIONS]) * method.evaluations)

    def advance(steps: int) -> None:
        simulator.advance(steps, check=False)

    advance(1)
    return Stepper(begin, advance, lambda: simulator.positions[0], evaluations)


def advance_and_sample(simulator: Simulator, count: int) -> np.ndarray:
    """Return positions (samples, N, 3) [m] on the way through ``count`` steps."""
    positions = []
    for _ in range(SAMPLES):
        simulator.advance(count // SAMPLES, check=False)
        positions.append(simulator.positions[0])
    return np.array(positions)


# --- References ---------------------------------------------------------------------------------------


def reference(problem: Problem, scene: Scene) -> tuple[np.ndarray, float, str]:
    """Return positions (samples, N, 3) [m], their distance from another method's, and both methods."""
    if scene.surfaces:  # one method meets surfaces: its own limit, extrapolated
        first = 64 * default_count(problem, scene)
        coarse, fine = (
            advance_and_sample(_simulator(scene, "verlet", problem.seconds / n), n)
            for n in (first, 2 * first)
        )
        best = fine + (fine - coarse) / 3
        if isinstance(scene.contact, Contact) and scene.contact.friction == 0:
            (other,) = (rung.run()[0] for rung in scipy_rungs(problem, scene) if rung.step == 1e-12)
            return best, largest_distance(best, other, scene.sizes), "verlet extrapolated and SciPy's DOP853"
        return best, largest_distance(best, fine, scene.sizes), "verlet extrapolated, and verlet"
    damped = scene.body.damping.any()
    name, parts = ("rk4", 128) if damped else ("blanes_moan", 24)
    count = SAMPLES * math.ceil(problem.seconds * parts / largest_step(scene, integrator(name)) / SAMPLES)
    fixed = advance_and_sample(_simulator(scene, name, problem.seconds / count), count)
    count = edge(problem, scene, "dopri5")
    adaptive = advance_and_sample(_simulator(scene, "dopri5", problem.seconds / count, (1e-13, 1e-13)), count)
    return adaptive if damped else fixed, largest_distance(adaptive, fixed, scene.sizes), f"{name} and dopri5"


def model_error(problem: Problem) -> dict[str, Any]:
    """Return the springs' distance from rigid theory at the end, at k, 2k and 4k, and the power of k."""
    assert problem.rigid is not None
    rigid = problem.rigid(problem.seconds)
    factors = (1, 2, 4)
    gaps = []
    for factor in factors:
        scene = problem.scene(factor * problem.stiffness)
        positions, _, _ = reference(problem, scene)
        gaps.append(largest_distance(positions[-1], rigid, scene.sizes))
    stiffness = [factor * problem.stiffness for factor in factors]
    power = float(np.polyfit(np.log(stiffness), np.log(gaps), 1)[0])
    return {"stiffness": stiffness, "errors": gaps, "power": power}


# --- Chaotic motion -----------------------------------------------------------------------------------


def automatic_count(period: float, scene: Scene) -> int:
    """Return the steps of the default method in a control period [s]."""
    return math.ceil(period / plan_steps(scene).step - 1e-9)


def local_errors(problem: Problem, scene: Scene, quick: bool) -> list[dict[str, Any]]:
    """Return the error over one control period by steps, each from the same states along a run."""
    assert problem.period is not None
    method = integrator("verlet")
    first = math.ceil(problem.period / (0.98 * largest_step(scene, method)))
    automatic = automatic_count(problem.period, scene)
    counts = sorted({automatic, *(first * 2**n for n in range(4 if quick else 7))})
    finest = _simulator(scene, "verlet", problem.period / (8 * counts[-1]))
    states = []
    ends = []
    for _ in range(round(problem.seconds / problem.period)):
        states.append((finest.positions[0], finest.velocities[0]))
        finest.advance(8 * counts[-1], check=False)
        ends.append(finest.positions[0])
    rows = []
    for count in progress(counts, "steps"):
        simulator = _simulator(scene, "verlet", problem.period / count)
        errors = []
        for (x, v), end in zip(states, ends, strict=True):
            simulator.place(x, v)
            simulator.advance(count, check=False)
            errors.append(largest_distance(simulator.positions[0], end, scene.sizes))
        walls = []
        for _ in range(5 if quick else 20):
            walls.append(0.0)
            for x, v in states:
                simulator.place(x, v)
                started = time.perf_counter()
                simulator.advance(count, check=False)
                walls[-1] += time.perf_counter() - started
        rows.append(
            row_of(
                "verlet",
                problem.period / count,
                math.sqrt(np.mean(np.square(errors))),
                count / problem.period,
                [1e6 * wall / problem.seconds for wall in walls],
            )
            | {"largest_error": max(errors)}
        )
    return rows


# --- Measuring ----------------------------------------------------------------------------------------


def measure(name: str, quick: bool = False, peers: bool = True) -> dict[str, Any]:
    """Measure all methods on a problem, and return it ready for JSON.

    Parameters
    ----------
    name
        Of a problem, out of `benchmarks.problems.PROBLEMS`.
    quick
        Fewer steps, and 5 timed runs instead of 20.
    peers
        Whether to measure MuJoCo and SciPy too, where they are installed.

    Raises
    ------
    KeyError
        If there is no such problem.
    """
    if name not in PROBLEMS:
        raise KeyError(f"unknown problem {name!r}; there are {', '.join(PROBLEMS)}")
    problem = PROBLEMS[name]
    scene = problem.scene(problem.stiffness)
    result: dict[str, Any] = {"problem": name, "what": problem.what, "seconds": problem.seconds}
    if problem.period is not None:
        step = problem.period / automatic_count(problem.period, scene)
        return result | {
            "kind": f"local error in {1e3 * problem.period:g} ms",
            "default": {"method": "verlet", "step": step},
            "rows": local_errors(problem, scene, quick),
        }
    exact, agreement, methods = reference(problem, scene)
    result |= {"kind": "time error", "reference": methods, "agreement": agreement}
    if problem.rigid is not None:
        result["model"] = model_error(problem)
    rungs = ladder(problem, scene, quick)
    if peers and not scene.surfaces:
        rungs += mujoco_rungs(problem, scene) + scipy_rungs(problem, scene)
    rows = rows_of(rungs, exact, scene, 5 if quick else 20)
    default = problem.seconds / default_count(problem, scene)
    return result | {"default": {"method": "verlet", "step": default}, "rows": rows}


def cheapest(result: dict[str, Any], tolerance: float, among: str = "") -> dict[str, Any] | None:
    """Return the cheapest row with an error of at most ``tolerance``, or None; of one method, if named."""
    rows = [
        row
        for row in result["rows"]
        if row["error"] is not None and row["error"] <= tolerance and among in ("", row["method"])
    ]
    return min(rows, key=lambda row: row["cost"], default=None)
