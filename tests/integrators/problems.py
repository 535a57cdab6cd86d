"""Scenes with known answers, built from one set of terms so that each method compiles once a width."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from springgym.dynamics.methods import integrator
from springgym.dynamics.methods.record import Control
from springgym.dynamics.packing import decays
from springgym.model.bodies import Body
from springgym.model.scene import Scene, WrenchActuator
from springgym.simulator import STRAIN_LIMIT, Simulator

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0.3, 0.9, 0], [0.4, 0.3, 0.8]])
PAIRS = [(1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2)]
GRAVITY = np.array([0, 0, -9.81])
SPIN = np.array([0.5, 1.0, 2.0])
NEGLIGIBLE = 1e-12
"""A damping [kg/s] that does nothing but keep the dampers in the compiled code."""


def tetrahedron(name: str, damping: float, stiffness: float = 200.0, gravity: Any = GRAVITY) -> Scene:
    """A soft tetrahedron that spins about a pinned corner; undamped for methods that refuse damping."""
    damping = 0.0 if integrator(name).negative_substeps else damping
    body = Body("tetrahedron", CORNERS, np.array([1, 0.8, 1.2, 0.9]), np.array(PAIRS), stiffness, damping)
    velocities = np.cross(SPIN, CORNERS)
    return Scene(body, CORNERS, velocities, pinned=(0,), gravity=tuple(gravity), wrench=WrenchActuator())


def oscillator(
    name: str, stiffness: float, damping: float, stretch: float = 1e-3, speed: float = 0.0
) -> Scene:
    """Two particles of 1 kg on a spring of 1 m: ω² = 2 k/m, and a rate of decay 2 c/m."""
    damping = 0.0 if integrator(name).negative_substeps else damping
    at_rest = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    # two idle particles on springs of no account make the triad that the actuator needs
    body = Body(
        "oscillator",
        at_rest,
        np.ones(4),
        np.array(PAIRS),
        np.array([stiffness, *[1e-9] * 5]),
        np.array([damping, *[0.0] * 5]),
    )
    positions = at_rest.copy()
    velocities = np.zeros((4, 3))
    positions[0, 0] = -stretch / 2
    positions[1, 0] = 1 + stretch / 2
    velocities[0, 0] = -speed / 2
    velocities[1, 0] = speed / 2
    return Scene(body, positions, velocities, gravity=(0.0, 0.0, 0.0), wrench=WrenchActuator())


def simulator(scene: Scene, name: str, step: float, **options: Any) -> Simulator:
    """A simulator of any step, even one beyond the stability limit; Newton's method to round-off."""
    if integrator(name).iterative:
        options.setdefault("tolerance", (1e-11, 0.0))
    made = Simulator(
        scene, integrator=name, step=1e-9, strain_limit=STRAIN_LIMIT, **options
    )  # soft on purpose
    vars(made)["step"] = step
    made._control = made._control._replace(step=step) if isinstance(made._control, Control) else step
    (packed,) = made._packed
    if packed.terms.dampers:
        time = made.damping_every * step
        of = decays(scene, packed.order, time, scene.body.damping, scene.body.masses)
        for arrays, values in zip(packed.terms.dampers[1:3], of, strict=True):
            for array, value in zip(arrays, values, strict=True):
                array[:] = value
    return made


def accelerations(body: Body, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Accelerations (N, 3) by springs and dampers: equation 3 of the paper, sign corrected."""
    first, second = body.springs.T
    apart = x[second] - x[first]
    length = np.linalg.norm(apart, axis=1)
    along = apart / length[:, None]
    rate = ((v[second] - v[first]) * along).sum(axis=1)
    pull = (body.stiffness * (length - body.lengths) + body.damping * rate)[:, None] * along
    force = np.zeros_like(x)
    np.add.at(force, first, pull)
    np.subtract.at(force, second, pull)
    return force / body.masses[:, None]


@cache
def reference(damping: float, duration: float) -> np.ndarray:
    """Positions and velocities (2, N, 3) of the tetrahedron after ``duration`` [s], to 1e-12."""
    scene = tetrahedron("verlet", damping)

    def derivative(_: float, state: np.ndarray) -> np.ndarray:
        x, v = state.reshape(2, -1, 3)
        a = accelerations(scene.body, x, v) + GRAVITY
        a[0] = 0
        return np.concatenate([v.ravel(), a.ravel()])

    start = np.concatenate([scene.positions.ravel(), scene.velocities.ravel()])
    solution = solve_ivp(derivative, (0, duration), start, method="DOP853", rtol=1e-13, atol=1e-13)
    return solution.y[:, -1].reshape(2, -1, 3)


def error(made: Simulator, exact: np.ndarray) -> float:
    """Largest error of a coordinate [m] or velocity component [m/s] of copy 0."""
    return float(np.abs(np.stack([made.positions[0], made.velocities[0]]) - exact).max())
