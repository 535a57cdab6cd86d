"""The largest stable step, the default step without impacts, and harmless cycles of dampers."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from springgym.checks import TINY, array, flag, instance, number, whole
from springgym.dynamics.forces.cycle import FIRST
from springgym.dynamics.methods.record import Integrator
from springgym.model.bodies.elasticity import spring_force_and_jacobian
from springgym.model.scene import Scene

__all__ = [
    "DECAY",
    "FINE_TURN",
    "LONGEST",
    "LONGEST_CYCLE",
    "REFUSED",
    "RIGID",
    "RINGING",
    "SAFETY",
    "SAMPLE",
    "SWEEP",
    "TURN",
    "VARIED",
    "Vibrations",
    "cycles_harmless",
    "cycles_in",
    "damps_each_step",
    "highest_decay_rate",
    "highest_frequency",
    "is_unstable",
    "largest_step",
    "steps_in",
    "usual_step",
    "varied",
    "vibrations",
]

SAFETY = 0.7
"""Largest default step, as a fraction of the stability limit. Stretch and rotation may raise the frequencies
of a body. The error of these steps is smaller than the difference between springs and a rigid body."""

REFUSED = 1 - 1e-3
"""Steps beyond this fraction of the stability limit are refused. At the limit itself, the fastest mode of
verlet grows in proportion to time."""

DECAY = 1.0
"""Default steps of methods that split off the dampers are at most this fraction of 1/λ_max(M⁻¹C). Each damper
decays exactly, but one after the other. Up to this limit, slow motion of a rope (the worst case) loses too
little by 0.55 % (λ h)². Beyond it, the loss is ever smaller than c implies: by 70 % at λ h = 28."""

FINE_TURN = 1 / 40
"""Rotation in a step [rad] up to which cycles of steps are harmless, see `cycles_harmless`: Verlet's own
error is FINE_TURN²/24 per radian there."""

RINGING = 2.0
"""With cycles, no vibration of a body may last longer than its slowest one times this factor."""

RIGID = 1e-9
"""Modes with ω² below this fraction of the largest count as rigid motion."""

VARIED = ("masses", "stiffness", "damping")
"""Parameters on which the length of a cycle depends."""

SAMPLE = 17
"""Number of frequencies that represent the range of a vibration."""

LONGEST_CYCLE = 10
"""Largest number of steps in a cycle."""

LONGEST = 10**12
"""Largest number of steps in a period or a cycle that is considered."""

SWEEP = 0.8
"""Cost of a sweep of dampers, relative to the rest of a top's step."""

TURN = 0.45
"""Cost of an application of the wrench, relative to the rest of a top's step."""


def highest_frequency(scene: Scene) -> float:
    """Return ω_max = √λ_max(M⁻¹K) [rad/s] of the springs of all bodies, about the unstretched shape with
    pins."""
    weighted = (_weighted(part, part.body.stiffness) for part in _different(scene))
    return math.sqrt(max(0.0, *(float(np.linalg.eigvalsh(one)[-1]) for one in weighted)))


def _different(scene: Scene) -> Collection[Scene]:
    """Return the different ones of a scene's bodies, each as a scene: equal ones have the same vibrations."""
    each = zip(instance("scene", scene, Scene).kinds, scene.parts, strict=True)
    return {(kind, part.pinned): part for kind, part in each}.values()


def highest_decay_rate(scene: Scene) -> float:
    """Return λ_max(M⁻¹C) [1/s] of the dampers of all bodies, about the unstretched shape with pins."""
    damped = (part for part in _different(scene) if part.body.damping.any())
    rates = (np.linalg.eigvalsh(_weighted(part, part.body.damping))[-1] for part in damped)
    return max(map(float, rates), default=0.0)


def _weighted(part: Scene, constants: np.ndarray) -> np.ndarray:
    """Return M^(−1/2) A M^(−1/2) of a body, A = K or C by the constants (S,) of its springs or dampers."""
    body = part.body.with_(stiffness=np.maximum(constants, TINY))
    _, jacobian = spring_force_and_jacobian(body, body.positions)
    weight = 1 / np.sqrt(body.masses)
    weight[list(part.pinned)] = 0.0
    weight = np.repeat(weight, 3)
    return np.asarray(weight[:, None] * -jacobian * weight)


def largest_step(scene: Scene, integrator: Integrator) -> float:
    """Return the stability limit of an integrator in a scene [s], from ω_max and the decay rate."""
    instance("integrator", integrator, Integrator)
    limits = [math.inf]
    if (frequency := highest_frequency(scene)) > 0:
        limits.append(integrator.imaginary_limit / frequency)
    if (rate := highest_decay_rate(scene)) > 0:
        limits.append(integrator.real_limit / rate)
    return min(limits)


def is_unstable(step: float, limit: float) -> bool:
    """Return whether a step [s] is refused for a stability limit [s]."""
    return number("step", step) > REFUSED * number("limit", limit, 0.0, math.inf)


def usual_step(scene: Scene, integrator: Integrator) -> float:
    """Return the default step [s], which may be too long for impacts, see `springgym.model.resolution`.

    It is at most `SAFETY` × the stability limit and, if dampers are split off, at most `DECAY` / their rate.
    """
    step = SAFETY * largest_step(scene, integrator)
    if integrator.splits_dampers and (rate := highest_decay_rate(scene)) > 0:
        step = min(step, DECAY / rate)
    return step if math.isfinite(step) else 1e-3


class Vibrations(NamedTuple):
    """The vibrations of a scene's bodies about their unstretched shapes, with pins."""

    frequency: np.ndarray
    """ω [rad/s] without dampers"""
    rate: np.ndarray
    """γ [1/s] at which each vibration would decay alone"""
    slowness: float
    """the largest c/k of a spring [s]"""


def vibrations(scene: Scene) -> Vibrations:
    """Return the vibrations of all bodies. The coupling by dampers is neglected."""
    frequencies = []
    rates = []
    for part in _different(scene):
        squares, modes = np.linalg.eigh(_weighted(part, part.body.stiffness))
        swings = squares > RIGID * squares[-1]
        modes = modes[:, swings]
        frequencies.append(np.sqrt(squares[swings]))
        rates.append(0.5 * ((_weighted(part, part.body.damping) @ modes) * modes).sum(axis=0))
    slowness = max(
        float((part.body.damping / part.body.stiffness).max(initial=0.0)) for part in _different(scene)
    )
    return Vibrations(np.concatenate(frequencies), np.concatenate(rates), slowness)


def varied(of: Vibrations, factors: Mapping[str, Sequence[float]]) -> Vibrations:
    """Return a sample of the vibrations of bodies whose `VARIED` are multiplied by factors (low, high)."""
    frequency, rate, slowness = instance("of", of, Vibrations)
    ranges = instance("factors", factors, Mapping)
    masses, stiffness, damping = (
        array(
            f"factors[{name!r}]", ranges.get(name, (1.0, 1.0)), (2,), low=0.0 if name == "damping" else TINY
        )
        for name in VARIED
    )
    slowest, fastest = np.sqrt(stiffness / masses[::-1])
    faster = np.unique(np.geomspace(slowest, fastest, SAMPLE))
    more = np.unique(damping / masses[::-1])
    faster, more = (values.ravel() for values in np.meshgrid(faster, more))
    return Vibrations(
        np.outer(faster, frequency).ravel(),
        np.outer(more, rate).ravel(),
        slowness * damping[1] / stiffness[0],
    )


def damps_each_step(scene: Scene, integrator: Integrator) -> str:
    """Return the reason why dampers and wrench must act in every step of a scene; empty if there is none."""
    instance("scene", scene, Scene)
    if not instance("integrator", integrator, Integrator).cycles:
        return f"{integrator.name} cannot run dampers in cycles"
    if any(placed.body.floppy for placed in scene.bodies):
        return "dampers act on the motion of a floppy body, not on vibrations alone"
    alone = not scene.can_touch  # with contact, actuators act in every step
    if any(placed.drive or placed.forces or (placed.thrust and alone) for placed in scene.bodies):
        return "forces on single particles make bodies vibrate"
    if not any(placed.body.damping.any() for placed in scene.bodies):
        return "the scene has no dampers"
    return ""


def cycles_harmless(of: Vibrations, step: float, every: int) -> bool:
    """Return whether dampers can act once in ``every`` steps of ``step`` seconds without harm.

    Dampers respond to the rate of stretch. In a body that turns at Ω, the stretch changes at rates of Ω, and
    dampers change it by a fraction of at most (c/k) Ω, because C ≤ max(c/k) K. In pairs of cycles of n steps
    they do so with a relative error of (n Ω h)²/3. Verlet's own error is (Ω h)²/24 of the body's size. It is
    the larger one if 8 n² (c/k) Ω × strain ≤ 1. This is required for a rotation of `FINE_TURN` per step and
    strains of 1/8.

    That bounds the error of rotation, but not of vibrations. In its phase plane, a vibration of ω turns by 2
    arcsin(ω h/2) per step, and shrinks where dampers act, see `springgym.dynamics.forces.cycle`. Two cycles
    are a matrix, whose spectral radius is the fraction of the vibration that remains. No vibration may last
    longer than `RINGING` times as long as the slowest does if dampers act in every step."""
    instance("of", of, Vibrations)
    step = number("step", step, TINY)
    every = whole("every", every, 1, LONGEST)
    if every**2 * of.slowness * FINE_TURN > step:
        return False
    turn = 2 * np.arcsin(np.minimum(of.frequency * step / 2, 1.0))
    squeezed = np.zeros((len(turn), 2, 2))
    squeezed[:, 0, 0], squeezed[:, 1, 1] = 1.0, np.exp(-2 * of.rate * every * step)
    both = _turned((2 * every - 2 * FIRST) * turn) @ squeezed @ _turned(2 * FIRST * turn) @ squeezed
    left = np.abs(np.linalg.eigvals(both)).max(axis=1)
    under = np.sqrt(np.maximum(of.rate**2 - of.frequency**2, 0.0))
    slowest = (of.rate - under).min(initial=np.inf)
    return bool((left < np.exp(-slowest / RINGING * 2 * every * step)).all())


def _turned(angle: np.ndarray) -> np.ndarray:
    """Return rotations (n, 2, 2) by angles (n,) [rad]."""
    c = np.cos(angle)
    s = np.sin(angle)
    return np.moveaxis(np.array([[c, s], [-s, c]]), -1, 0)


def cycles_in(of: Vibrations, period: float, steps: int, exactly: bool) -> tuple[int, int]:
    """Return the number of steps in the cheapest period [s] of whole cycles, and the number of steps in a
    cycle.

    The period has at least ``steps`` steps, or ``exactly`` as many. If it had an odd number of cycles, copies
    that began in different periods would sweep in different directions, and their block would need two
    sweeps.
    """
    instance("of", of, Vibrations)
    period = number("period", period, TINY)
    steps = whole("steps", steps, 1, LONGEST)
    exactly = flag("exactly", exactly)
    cost = {(steps, 1): steps * (1 + SWEEP + TURN)}
    for every in range(2, LONGEST_CYCLE + 1, 2):
        least = -(-steps // every)
        for cycles in (least, least + 1):
            if not exactly or cycles * every == steps:
                one = every + SWEEP * (1 + cycles % 2) + 2 * TURN
                cost[cycles * every, every] = cycles * one
    return next(
        (count, every)
        for count, every in sorted(cost, key=cost.__getitem__)
        if every == 1 or cycles_harmless(of, period / count, every)
    )


def steps_in(period: float, step: float) -> int:
    """Return the number of steps in a period.

    Raises
    ------
    ValueError
        If the number is not whole.
    """
    period = number("period", period, TINY)
    step = number("step", step, TINY)
    steps = round(period / step)
    if steps < 1 or abs(steps * step - period) > 1e-9 * period:
        raise ValueError(
            f"a period of {period:g} s is not a whole number of steps of {float(step)!r} s; "
            f"take a step of {float(period) / math.ceil(period / step)!r} s"
        )
    return steps
