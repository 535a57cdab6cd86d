"""Other simulators on the same scene: MuJoCo and SciPy, where they are installed."""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np

from springgym import theory
from springgym.accuracy.problems import Problem
from springgym.accuracy.rungs import SAMPLES, Rung
from springgym.bodies.elasticity import spring_force_and_jacobian
from springgym.checks import TINY
from springgym.integrators import integrator
from springgym.scene import Scene
from springgym.stability import largest_step
from springgym.surfaces import Plane, scales

if TYPE_CHECKING:
    import mujoco
    from scipy.optimize import OptimizeResult

LONGEST_PIECE = 1e-2
"""Timed runs take about this long [s]: slower programs, longer pieces."""


def mujoco_model(scene: Scene, integrator: str, step: float) -> mujoco.MjModel:
    """Make the scene in MuJoCo: particles on slide joints, springs and dampers as spatial tendons."""
    import mujoco

    def numbers(values: Iterable[float]) -> str:
        return " ".join(repr(float(value)) for value in values)

    body, free = scene.body, scene.free
    sites, bodies = "", ""
    for n, (x, m) in enumerate(zip(scene.positions, body.masses.tolist(), strict=True)):
        site = f'<site name="s{n}" pos="{{}}"/>'
        if not free[n]:
            sites += site.format(numbers(x))
            continue
        joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
        bodies += f'<body pos="{numbers(x)}">{joints}{site.format("0 0 0")}'
        bodies += f'<inertial pos="0 0 0" mass="{m!r}" diaginertia="1 1 1"/></body>'
    tendons = "".join(
        f'<spatial springlength="{length!r}" stiffness="{k!r}" damping="{c!r}">'
        f'<site site="s{i}"/><site site="s{j}"/></spatial>'
        for (i, j), length, k, c in zip(
            body.springs.tolist(),
            body.lengths.tolist(),
            body.stiffness.tolist(),
            body.damping.tolist(),
            strict=True,
        )
    )
    gravity = numbers(scene.gravity or (0, 0, 0))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler inertiafromgeom="false"/><option timestep="{step!r}" integrator="{integrator}" '
        f'gravity="{gravity}"><flag contact="disable" autoreset="disable"/></option>'
        f"<worldbody>{sites}{bodies}</worldbody><tendon>{tendons}</tendon></mujoco>"
    )


EVALUATIONS = {"RK4": 4, "Euler": 1, "implicitfast": 1}
EDGE = {"RK4": 2.8, "Euler": 1.98, "implicitfast": 1.98}
"""ω h that explicit springs bear; MuJoCo treats only the dampers implicitly."""


def mujoco_rungs(problem: Problem, scene: Scene) -> list[Rung]:
    """Time MuJoCo's integrators over a ladder of steps; none if it is not installed."""
    if importlib.util.find_spec("mujoco") is None:
        return []
    import mujoco

    mujoco.set_mju_user_warning(lambda message: None)  # a run that fails is drawn as one
    free = scene.free
    limit = largest_step(scene.with_(body=scene.body.with_(damping=0.0)), integrator("verlet")) / 2
    rungs = []
    for name in EVALUATIONS:
        first = SAMPLES * math.ceil(problem.seconds / (EDGE[name] * limit) / SAMPLES)
        for count in (first * 2**n for n in range(4)):
            step = problem.seconds / count
            model = mujoco_model(scene, name, step)
            data = mujoco.MjData(model)

            def begin(model: mujoco.MjModel = model, data: mujoco.MjData = data) -> None:
                mujoco.mj_resetData(model, data)
                data.qvel[:] = scene.velocities[free].ravel()

            def run(
                count: int = count,
                name: str = name,
                data: mujoco.MjData = data,
                model: mujoco.MjModel = model,
                begin: Callable[[], None] = begin,
            ) -> tuple[np.ndarray, float, float]:
                begin()
                positions = []
                started = time.perf_counter()
                for _ in range(SAMPLES):
                    mujoco.mj_step(model, data, count // SAMPLES)
                    x = scene.positions.copy()
                    x[free] += data.qpos.reshape(-1, 3)
                    positions.append(x)
                wall = time.perf_counter() - started
                return np.array(positions), EVALUATIONS[name] * count / problem.seconds, wall

            def piece(
                wall: float,
                count: int = count,
                step: float = step,
                data: mujoco.MjData = data,
                model: mujoco.MjModel = model,
            ) -> tuple[Callable[[], object], float]:
                steps = max(1, min(count, int(count * LONGEST_PIECE / wall)))
                return lambda: mujoco.mj_step(model, data, steps), steps * step

            rungs.append(Rung(f"MuJoCo {name}", step, run, begin, piece))
    return rungs


def derivative(scene: Scene) -> Callable[[float, np.ndarray], np.ndarray]:
    """Return d/dt of positions and velocities, flat, in NumPy; surfaces are smooth planes."""
    body, free = scene.body, scene.free
    gravity = np.array(scene.gravity or (0, 0, 0))
    first, second = body.springs.T
    ends = np.zeros((len(body.masses), len(first)))
    ends[first, np.arange(len(first))], ends[second, np.arange(len(first))] = 1.0, -1.0
    ends *= (free / body.masses)[:, None]
    planes = [plane for plane in scene.surfaces if isinstance(plane, Plane)]
    strength, reach = scales(scene.contact, body) if planes else (0.0, 1.0)

    def slope(_: float, state: np.ndarray) -> np.ndarray:
        x, v = state.reshape(2, -1, 3)
        apart, closing = x[second] - x[first], v[second] - v[first]
        length = np.sqrt((apart * apart).sum(axis=1))
        rate = (apart * closing).sum(axis=1) / length
        pull = (body.stiffness * (length - body.lengths) + body.damping * rate) / length
        acceleration = ends @ (pull[:, None] * apart) + gravity * free[:, None]
        for plane in planes:
            push = theory.contact.force(plane.height(x), strength, reach) * free / body.masses
            acceleration += push[:, None] * plane.normal
        return np.concatenate([v.ravel(), acceleration.ravel()])

    return slope


def jacobian(scene: Scene) -> Callable[[float, np.ndarray], np.ndarray]:
    """Return the derivative of `derivative` by the state; the dampers' along their springs alone."""
    body, count = scene.body, 3 * len(scene.body.masses)
    weight = np.repeat(scene.free / body.masses, 3)[:, None]
    dampers = body.with_(stiffness=np.maximum(body.damping, TINY))

    def matrix(_: float, state: np.ndarray) -> np.ndarray:
        x = state.reshape(2, -1, 3)[0]
        whole = np.zeros((2 * count, 2 * count))
        whole[:count, count:] = np.eye(count)
        whole[count:, :count] = weight * spring_force_and_jacobian(body, x)[1]
        if body.damping.any():
            whole[count:, count:] = weight * spring_force_and_jacobian(dampers, x)[1]
        return whole

    return matrix


def scipy_rungs(problem: Problem, scene: Scene) -> list[Rung]:
    """Time SciPy's DOP853 and Radau over a ladder of tolerances; none if it is not installed."""
    if importlib.util.find_spec("scipy") is None:
        return []
    from scipy.integrate import solve_ivp

    slope, matrix = derivative(scene), jacobian(scene)
    began = np.concatenate([scene.positions.ravel(), scene.velocities.ravel()])
    times = problem.seconds * np.arange(1, SAMPLES + 1) / SAMPLES

    def solve(method: str, tolerance: float, until: float) -> OptimizeResult:
        options = {"jac": matrix} if method == "Radau" else {}
        return solve_ivp(
            slope,
            (0.0, until),
            began,
            method=method,
            t_eval=times[times <= until],
            rtol=tolerance,
            atol=tolerance,
            **options,
        )

    rungs = []
    for method, exponents in (("DOP853", (3, 5, 7, 9, 12)), ("Radau", (3, 5))):
        for tolerance in (10.0**-n for n in exponents):

            def run(method: str = method, tolerance: float = tolerance) -> tuple[np.ndarray, float, float]:
                started = time.perf_counter()
                solution = solve(method, tolerance, problem.seconds)
                wall = time.perf_counter() - started
                positions = np.full((SAMPLES, *scene.positions.shape), np.nan)
                for n, y in enumerate(solution.y.T):
                    positions[n] = y[: scene.positions.size].reshape(-1, 3)
                return positions, solution.nfev / problem.seconds, wall

            def piece(
                wall: float, method: str = method, tolerance: float = tolerance
            ) -> tuple[Callable[[], object], float]:
                until = problem.seconds * min(1.0, LONGEST_PIECE / wall)
                return lambda: solve(method, tolerance, until), until

            rungs.append(Rung(f"SciPy {method}", tolerance, run, lambda: None, piece))
    return rungs
