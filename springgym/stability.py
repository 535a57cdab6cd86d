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

FINE_TURN = 1 / 40
"""The turn in a step [rad] up to which a cycle of steps does no harm, see `damping_every`: beyond it, Verlet's
own error is FINE_TURN²/24 a radian and more."""

LONGEST_CYCLE = 10
"""Most steps in a cycle."""


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


def damps_each_step(scene: Scene, integrator: Integrator) -> str:
    """Why dampers and wrench act at every step of a scene; empty if they need not."""
    bodies = [placed.body for placed in scene.bodies]
    if not integrator.cycles:
        return f"{integrator.name} knows no cycles"
    if scene.surfaces or scene.meetings:
        return "where bodies meet something, dampers act at each node"
    if any(body.floppy for body in bodies):
        return "dampers act on the motion of a floppy body, not on vibrations alone"
    if not any(body.damping.any() for body in bodies):
        return "the scene has no dampers"
    return ""


def damping_every(scene: Scene, step: float) -> int:
    """Most steps after which dampers may act at once without an error to be seen: 1, or an even number.

    Dampers act on how fast stretch changes. Of a body that turns at Ω, stretch changes at rates of Ω, and what
    dampers do to it is a share (c/k) Ω of it, as C ≤ max(c/k) K. In cycles of n steps they do it by a share of
    (n ω h)²/24 wrongly to what swings at ω. Verlet errs by (ω h)²/24 itself: the error of cycles stays
    below it as long as n² (c/k) Ω ≤ 1, here for turns of up to `FINE_TURN` a step.
    """
    bodies = [placed.body for placed in scene.bodies]
    slowest = max(float((body.damping / body.stiffness).max(initial=0.0)) for body in bodies)
    longest = math.sqrt(step / (FINE_TURN * slowest)) if slowest > 0 else math.inf
    return max(1, 2 * int(min(longest, LONGEST_CYCLE) / 2))


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
