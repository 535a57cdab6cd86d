"""The largest stable step, and the step chosen when none is given."""

from __future__ import annotations

import math

import numpy as np

from springgym.bodies.elasticity import spring_force_and_jacobian
from springgym.checks import TINY
from springgym.integrators.record import Integrator
from springgym.scene import Scene

SAFETY = 0.7
"""Automatic steps stay below this share of the stability limit: room for the frequencies that a body
gains by being stretched or turned, and already finer than the gap to the rigid body."""

DECAY = 1.0
"""Automatic steps of methods that split the dampers off stay below this share of 1/λ_max(M⁻¹C). Each damper
decays exactly, but one after the other: up to there slow motion of a rope, the worst, loses too little by
0.55 % (λ h)², and beyond it ever less than c says, 70 % less at λ h = 28."""


def highest_frequency(scene: Scene) -> float:
    """ω_max = √λ_max(M⁻¹K) [rad/s] of the springs about the unstretched shape, pins held; of all bodies."""
    return max(map(_frequency, scene.parts))


def _frequency(part: Scene) -> float:
    _, jacobian = spring_force_and_jacobian(part.body, part.body.positions)
    return math.sqrt(max(0.0, _largest_eigenvalue(part, -jacobian)))


def highest_decay_rate(scene: Scene) -> float:
    """λ_max(M⁻¹C) [1/s] of the dampers about the unstretched shape, pins held; of all bodies."""
    return max(map(_decay_rate, scene.parts))


def _decay_rate(part: Scene) -> float:
    if not part.body.damping.any():
        return 0.0
    dampers = part.body.with_(stiffness=np.maximum(part.body.damping, TINY))
    _, jacobian = spring_force_and_jacobian(dampers, part.body.positions)
    return _largest_eigenvalue(part, -jacobian)


def _largest_eigenvalue(scene: Scene, matrix: np.ndarray) -> float:
    weight = 1 / np.sqrt(scene.body.masses)
    weight[list(scene.pinned)] = 0.0
    weight = np.repeat(weight, 3)
    return float(np.linalg.eigvalsh(weight[:, None] * matrix * weight)[-1])


def largest_step(scene: Scene, integrator: Integrator) -> float:
    """The stability limit of an integrator in a scene [s]: ω_max h and the decay rate × h at their limits."""
    limits = [math.inf]
    if (frequency := highest_frequency(scene)) > 0:
        limits.append(integrator.imaginary_limit / frequency)
    if (rate := highest_decay_rate(scene)) > 0:
        limits.append(integrator.real_limit / rate)
    return min(limits)


def automatic_step(scene: Scene, integrator: Integrator, period: float | None = None) -> float:
    """The step used when none is given [s], a whole part of ``period``.

    It is `SAFETY` × the stability limit or, where dampers are split off and strong, `DECAY` / their rate.
    """
    step = SAFETY * largest_step(scene, integrator)
    if integrator.splits_dampers and (rate := highest_decay_rate(scene)) > 0:
        step = min(step, DECAY / rate)
    if not math.isfinite(step):
        step = 1e-3
    return step if period is None else period / math.ceil(period / step - 1e-9)


def steps_in(period: float, step: float) -> int:
    """How many steps make a period.

    Raises
    ------
    ValueError
        If they are not a whole number.
    """
    steps = round(period / step)
    if steps < 1 or abs(steps * step - period) > 1e-9 * period:
        raise ValueError(
            f"a period of {period:g} s is not a whole number of steps of {step:g} s; "
            f"take a step of {period / max(1, steps):g} s"
        )
    return steps
