"""Questions with one answer: what implicit methods do to spin, when they pay, how springs tend to rigid."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.peers import MUJOCO, MuJoCo, has
from benchmarks.problems import CUSPS, PROBLEMS, TOP
from benchmarks.timing import rows_of, rung_of
from benchmarks.work_precision import edge, own_rung, reference, stepper
from springgym import theory
from springgym.dynamics.rigid import METHODS
from springgym.model.bodies import cube, start, top
from springgym.model.bodies.distances import largest_distance
from springgym.model.scene import Scene
from springgym.simulator import Simulator
from springgym.theory.frames import carry

SPIN = 2 * math.pi * 5
"""5 rev/s"""


def spin_down(quick: bool = False) -> dict[str, Any]:
    """Spin of a free cube under implicit methods, beside Ω₀/√(1 + 2 h Ω₀² t).

    The steps are the paper's 0.5 ms, and 10 ms. ``growth`` is the distance of the corner farthest from the
    centre at the end, over that at the start: 1 for a body that keeps its shape.
    """
    body = cube(damping=0.0)
    scene = Scene(body, *start(body, omega=(0.0, 0.0, SPIN)), gravity=(0.0, 0.0, 0.0))
    curves: list[dict[str, Any]] = []
    for step in (5e-4, 1e-2):
        times = np.arange(1, 51) * 0.04
        curves.append(
            {
                "method": "theory of implicit_euler",
                "step": step,
                "times": times.tolist(),
                "spins": (theory.oscillation.implicit_euler_spin(SPIN, step, times) / SPIN).tolist(),
            }
        )
        for name in ("implicit_euler", "tr_bdf2", "implicit_midpoint"):
            simulator = Simulator(scene, integrator=name, step=step, ledger=False, tolerance=(1e-10, 0.0))
            spins = []
            for _ in times:
                simulator.advance(round(0.04 / step), check=False)
                x = simulator.positions[0]
                v = simulator.velocities[0]
                x = x - body.masses @ x / body.mass
                turning = body.masses @ (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])
                spins.append(float(turning / (body.masses @ (x[:, :2] ** 2).sum(axis=1)) / SPIN))
            reach = np.linalg.norm(simulator.positions[0] - simulator.positions[0].mean(axis=0), axis=1).max()
            curves.append(
                {
                    "method": name,
                    "step": step,
                    "times": times.tolist(),
                    "spins": spins,
                    "growth": float(reach / (math.sqrt(3) / 2)),
                }
            )
    errors = [
        float(np.abs(np.array(euler["spins"]) / np.array(expected["spins"]) - 1).max())
        for expected, euler in (curves[0:2], curves[4:6])
    ]
    return {"kind": "spin-down", "spin": SPIN, "curves": curves, "theory_errors": errors}


def rigid_gap(quick: bool = False) -> dict[str, Any]:
    """Distance of the springs from rigid theory over k = 1e5 … 1e8, and the fitted power of k."""
    stiffness = [1e5, 1e6, 1e7, 1e8]
    result: dict[str, Any] = {"kind": "rigid gap", "stiffness": stiffness, "gaps": {}, "powers": {}}
    for name in ("cusp-top", "cube-swing", "free-body"):
        problem = PROBLEMS[name]
        gaps = []
        assert problem.rigid is not None
        for k in stiffness:
            scene = problem.scene(k)
            positions, _, _ = reference(problem, scene)
            gaps.append(largest_distance(positions[-1], problem.rigid(problem.seconds), scene.sizes))
        result["gaps"][name] = gaps
        result["powers"][name] = float(np.polyfit(np.log(stiffness), np.log(gaps), 1)[0])
    return result


def crossover(quick: bool = False) -> dict[str, Any]:
    """Cost of verlet and of the implicit methods to an error of 1e-3 over 0.25 s, by stiffness."""
    result: dict[str, Any] = {"kind": "crossover", "tolerance": 1e-3, "bodies": {}}
    for name in ("stiff-chain", "cube-swing", "cusp-top"):
        rows = []
        for k in 10.0 ** np.arange(5, 9 if quick else 11):
            problem = PROBLEMS[name]._replace(stiffness=float(k), seconds=0.25)
            scene = problem.scene(float(k))
            exact, _, _ = reference(problem, scene)
            rungs = []
            for method, halvings in (("verlet", 5), ("implicit_midpoint", 9), ("tr_bdf2", 9)):
                first = edge(problem, scene, method)
                tolerance = None if method == "verlet" else (1e-8, 0.0)
                rungs += [own_rung(problem, scene, method, first * 2**n, tolerance) for n in range(halvings)]
            enough = [
                row for row in rows_of(rungs, exact, scene, 5 if quick else 20) if (row["error"] or 1) <= 1e-3
            ]
            explicit, implicit = (
                min((r for r in enough if (r["method"] == "verlet") is own), key=_cost, default=None)
                for own in (True, False)
            )
            rows.append({"stiffness": float(k), "explicit": explicit, "implicit": implicit})
        result["bodies"][name] = {"rows": rows, "crossover": _crossing(rows)}
    return result


def _cost(row: dict[str, Any]) -> float:
    return float(row["cost"])


def _crossing(rows: list[dict[str, Any]]) -> float | None:
    """Return the stiffness at which the costs are equal, between powers of ten; None if they never are."""
    known = [row for row in rows if row["explicit"] and row["implicit"]]
    ratio = [math.log(row["explicit"]["cost"] / row["implicit"]["cost"]) for row in known]
    for n in range(1, len(known)):
        if ratio[n - 1] < 0 <= ratio[n]:
            share = ratio[n - 1] / (ratio[n - 1] - ratio[n])
            below = known[n - 1]["stiffness"]
            above = known[n]["stiffness"]
            return float(below * (above / below) ** share)
    return None


# --- The rigid twin -----------------------------------------------------------------------------------

SECONDS = 10.0


def rigid_twin(quick: bool = False) -> dict[str, Any]:
    """Error of the rigid top and its cost over 10 s, beside MuJoCo's, against theory."""
    body = top(damping=0.0)
    tip = body.particle("tip")

    def exact(t: float) -> tuple[np.ndarray, np.ndarray]:
        motion = theory.top.motion(TOP, CUSPS, np.array([t]))
        return carry(motion.attitude[0], motion.omega_world[0], body.positions)

    x, v = exact(0.0)
    v[tip] = 0.0
    scene = Scene(body, x, v, pinned=(tip,))
    rungs = []
    for name in METHODS:
        for count in (2000 * 2**n for n in range(4 if quick else 7)):
            step = SECONDS / count
            rigid = Simulator(scene, dynamics="rigid", integrator=name, step=step, ledger=False)
            rungs.append(rung_of(f"rigid {name}", step, count, stepper(rigid), samples=1))
    for name in MUJOCO if has("mujoco") else ():
        for count in (2000 * 2**n for n in range(3 if quick else 6)):
            step = SECONDS / count
            other = MuJoCo(scene, name, step, rigid=True).stepper()
            rungs.append(rung_of(f"MuJoCo {name}", step, count, other, samples=1, longest=5e-3))
    rows = rows_of(rungs, exact(SECONDS)[0][None], scene, 5 if quick else 20)
    return {"kind": "rigid twin", "seconds": SECONDS, "rows": rows}


STUDIES: dict[str, Callable[[bool], dict[str, Any]]] = {
    "spin-down": spin_down,
    "rigid-gap": rigid_gap,
    "crossover": crossover,
    "rigid-twin": rigid_twin,
}
"""All studies by name."""
