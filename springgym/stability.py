"""The largest stable step, and the step chosen when none is given."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from springgym.bodies.elasticity import spring_force_and_jacobian
from springgym.checks import TINY
from springgym.forces.cycle import FIRST
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
"""The turn in a step [rad] up to which cycles of steps do no harm, see `cycles_harmless`: Verlet's own error
is FINE_TURN²/24 a radian there."""

RINGING = 2.0
"""With cycles, no vibration of a body may last longer than its slowest one times this factor."""

RIGID = 1e-9
"""Share of the largest ω² up to which a motion is a rigid body's."""

VARIED = ("masses", "stiffness", "damping")
"""Parameters on which the length of a cycle depends."""

SAMPLE = 17
"""Number of frequencies that represent the range of a vibration."""

LONGEST_CYCLE = 10
"""Most steps in a cycle."""

SWEEP, TURN = 0.8, 0.45
"""Costs of a sweep of the dampers and of a push of the wrench, as shares of the rest of a step of a top."""


def highest_frequency(scene: Scene) -> float:
    """ω_max = √λ_max(M⁻¹K) [rad/s] of the springs about the unstretched shape, pins held; of all bodies."""
    return max(map(_frequency, _different(scene)))


def _different(scene: Scene) -> Collection[Scene]:
    """Return of a scene's bodies by themselves those that differ: equal ones vibrate alike."""
    each = zip(scene.kinds, scene.parts, strict=True)
    return {(kind, part.pinned): part for kind, part in each}.values()


def _frequency(part: Scene) -> float:
    return math.sqrt(max(0.0, float(np.linalg.eigvalsh(_weighted(part, part.body.stiffness))[-1])))


def highest_decay_rate(scene: Scene) -> float:
    """λ_max(M⁻¹C) [1/s] of the dampers about the unstretched shape, pins held; of all bodies."""
    return max(map(_decay_rate, _different(scene)))


def _decay_rate(part: Scene) -> float:
    if not part.body.damping.any():
        return 0.0
    return float(np.linalg.eigvalsh(_weighted(part, part.body.damping))[-1])


def _weighted(part: Scene, constants: np.ndarray) -> np.ndarray:
    """M^(−1/2) A M^(−1/2) of a body, with A = K or C by the constants (S,) of its springs or dampers."""
    body = part.body.with_(stiffness=np.maximum(constants, TINY))
    _, jacobian = spring_force_and_jacobian(body, body.positions)
    weight = 1 / np.sqrt(body.masses)
    weight[list(part.pinned)] = 0.0
    weight = np.repeat(weight, 3)
    return np.asarray(weight[:, None] * -jacobian * weight)


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


class Vibrations(NamedTuple):
    """The vibrations of a scene's bodies about their unstretched shapes, pins held."""

    frequency: np.ndarray
    """ω [rad/s] without dampers"""
    rate: np.ndarray
    """γ [1/s] at which each decays, were it alone"""
    slowness: float
    """the largest c/k of a spring [s]"""


def vibrations(scene: Scene) -> Vibrations:
    """Find the vibrations of all bodies. How dampers couple them is left out."""
    frequencies, rates, slowness = [], [], 0.0
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
    """Those of bodies whose `VARIED` are multiplied by factors (low, high), a sample of them all."""
    masses, stiffness, damping = (np.array(factors.get(name, (1.0, 1.0))) for name in VARIED)
    slowest, fastest = np.sqrt(stiffness / masses[::-1])
    faster = np.unique(np.geomspace(slowest, fastest, SAMPLE))
    more = np.unique(damping / masses[::-1])
    faster, more = (values.ravel() for values in np.meshgrid(faster, more))
    return Vibrations(
        np.outer(faster, of.frequency).ravel(),
        np.outer(more, of.rate).ravel(),
        of.slowness * damping[1] / stiffness[0],
    )


def damps_each_step(scene: Scene, integrator: Integrator) -> str:
    """Why dampers and wrench act at every step of a scene; empty if they need not."""
    if not integrator.cycles:
        return f"{integrator.name} knows no cycles"
    if scene.surfaces or scene.meetings:
        return "where bodies meet something, dampers act at each node"
    if any(placed.body.floppy for placed in scene.bodies):
        return "dampers act on the motion of a floppy body, not on vibrations alone"
    if any(placed.thrust or placed.drive or placed.forces for placed in scene.bodies):
        return "what pushes single particles makes bodies ring"
    if not any(placed.body.damping.any() for placed in scene.bodies):
        return "the scene has no dampers"
    return ""


def cycles_harmless(of: Vibrations, step: float, every: int) -> bool:
    """Return whether dampers can act once in ``every`` steps of ``step`` seconds without harm.

    Dampers act on how fast stretch changes. In a body that turns at Ω it changes at rates of Ω, and dampers
    change it by a share of (c/k) Ω at the most, as C ≤ max(c/k) K. In cycles of n steps, two and two, they do
    so with an error of (n Ω h)²/3 of that. Verlet's own is (Ω h)²/24 of the body's size, and the larger one
    as long as 8 n² (c/k) Ω × strain ≤ 1: here for a turn of `FINE_TURN` a step, and strains of up to 1/8.

    That bounds the error of bodies that turn, not of those that ring. A vibration of ω is turned by
    2 arcsin(ω h/2) a step and squeezed where dampers act, see `springgym.forces.cycle`; two cycles are a
    matrix, and what they leave of the vibration is its spectral radius. None may last longer than `RINGING`
    times as long as the slowest does where dampers act at every moment.
    """
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
    """Rotations (n, 2, 2) by angles (n,) [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[c, s], [-s, c]]), -1, 0)


def damping_every(scene: Scene, integrator: Integrator, step: float) -> int:
    """Most steps after which dampers may act at once, see `cycles_harmless`: 1, or an even number."""
    if damps_each_step(scene, integrator):
        return 1
    of = vibrations(scene)
    return next((n for n in range(LONGEST_CYCLE, 1, -2) if cycles_harmless(of, step, n)), 1)


def cycles_in(of: Vibrations, period: float, steps: int, exactly: bool) -> tuple[int, int]:
    """Return the steps of a period [s] of whole cycles that costs the least, and the steps of these.

    Those of the period are at least ``steps``, or ``exactly`` as many. In periods of an odd number of cycles,
    copies that began in different ones disagree on the direction of a sweep, and a block of them needs two.
    """
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
        If they are not a whole number.
    """
    steps = round(period / step)
    if steps < 1 or abs(steps * step - period) > 1e-9 * period:
        raise ValueError(
            f"a period of {period:g} s is not a whole number of steps of {step:g} s; "
            f"take a step of {period / max(1, steps):g} s"
        )
    return steps
