"""Checks of tops against Lagrange's theory: turning points, nutation, both precessions, sleep."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from springgym.model.bodies.precession import heavy_top
from springgym.scenes.checks import needs
from springgym.scenes.checks.basis import Check, applies, peaks, slack, spread
from springgym.scenes.recording import Recording
from springgym.theory import top as theory
from springgym.theory.top import HeavyTop, TopState

WITHIN = 0.015
"""Relative tolerance. The paper's top stretches by 1e-3, and has steps of 5e-4 s: its three constants have
errors of 2.4e-3, and its nutation period of 1.2e-2."""

ASLEEP = 0.1
"""The same for the tilt of a sleeping top: 2 % from the threshold, errors of the constants of 1.7e-3 make 50
times as much in the tilt."""


def rigid_top(recording: Recording) -> tuple[HeavyTop, TopState]:
    """Return the rigid top of a recording, and its initial motion."""
    scene = recording.plan.scene
    m = recording.measures
    axis = m.axis[0]
    omega = m.angular_velocity[0]
    tilt = math.atan2(math.hypot(axis[0], axis[1]), axis[2])
    rate = np.cross(omega, axis)
    sideways = max(axis[0] ** 2 + axis[1] ** 2, 1e-300)
    state = TopState(
        theta=tilt,
        omega3=float(omega @ axis),
        theta_dot=float(-rate[2] / max(math.sin(tilt), 1e-300)),
        phi_dot=float((axis[0] * rate[1] - axis[1] * rate[0]) / sideways),
    )
    return heavy_top(scene.body, scene.pinned, scene.gravity or (0.0, 0.0, 0.0)), state


def angles(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Return the tilt and azimuth of the axis [rad], each (T,)."""
    x, y, z = recording.measures.axis.T
    return np.arctan2(np.hypot(x, y), z), np.unwrap(np.arctan2(y, x))


def mean_rate(times: np.ndarray, angle: np.ndarray) -> float:
    """Return the mean rate [rad/s] of an angle that also oscillates; NaN for fewer than five samples.

    Weights that vanish at both ends suppress the oscillation.
    """
    if len(times) < 5:
        return math.nan
    weights = np.sin(math.pi * np.arange(len(times)) / (len(times) - 1)) ** 2
    middle = weights @ times / weights.sum()
    return float(weights * (times - middle) @ angle / (weights @ (times - middle) ** 2))


def _compared(
    share: float,
    quantity: str,
    of: Callable[[HeavyTop], float],
    top: HeavyTop,
    measured: float,
    by: float,
    unit: str,
) -> Check:
    """Return a check whose doubt is the change of theory for errors ``by`` of the top's constants."""

    def value(i1: float, i3: float, mgl: float) -> float:
        return of(HeavyTop(i1, i3, mgl))

    theory = of(top)
    doubt = spread(value, top.i1, top.i3, top.mgl, by=by) if by < 1 else math.inf
    return Check(quantity, theory, measured, share * abs(theory), unit, doubt)


@applies(needs.top)
def nutation(recording: Recording) -> list[Check]:
    """Check turning points, nutation period and mean precession of a top, from any start."""
    top, state = rigid_top(recording)
    by = slack(recording, state.omega3)
    tilt, azimuth = angles(recording)
    times, lowest = peaks(recording.times, tilt)
    _, highest = peaks(recording.times, -tilt)
    around = np.interp(times[[0, -1]], recording.times, azimuth) if len(times) > 1 else np.full(2, math.nan)

    def turning(n: int) -> Callable[[HeavyTop], float]:
        return lambda top: math.acos(min(1.0, theory.turning_points(top, state)[n]))

    def duration(top: HeavyTop) -> float:
        return theory.nutation_period(top, state)

    def precession(top: HeavyTop) -> float:
        return float(theory.motion(top, state, duration(top)).phi) / duration(top)

    passed = times[-1] - times[0] if len(times) > 1 else math.nan
    rate = float(around[1] - around[0]) / passed
    checks = [
        _compared(WITHIN, "largest tilt", turning(0), top, _mean(lowest), by, "rad"),
        _compared(WITHIN, "smallest tilt", turning(1), top, -_mean(highest), by, "rad"),
        _compared(WITHIN, "nutation period", duration, top, passed / max(len(times) - 1, 1), by, "s"),
    ]
    if precession(top):  # else it swings in a vertical plane, where its azimuth jumps
        checks.append(_compared(WITHIN, "mean precession", precession, top, rate, by, "rad/s"))
    return checks


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else math.nan


@applies(needs.top)
def steady_precession(recording: Recording) -> list[Check]:
    """Check the rate of a top started near a steady precession, and the frequency of its small nutation."""
    top, state = rigid_top(recording)
    by = slack(recording, state.omega3)
    tilt, azimuth = angles(recording)
    marks, _ = peaks(recording.times, tilt)
    nutates = len(marks) > 1
    if not nutates:
        marks = recording.times[[0, -1]]
    around = np.interp(marks, recording.times, azimuth)
    rate = float((around[-1] - around[0]) / (marks[-1] - marks[0]))
    roots = theory.steady_precession(top, state.theta, state.omega3)
    fast = abs(rate - roots[1]) < abs(rate - roots[0])

    def steady(top: HeavyTop) -> float:
        return theory.steady_precession(top, state.theta, state.omega3)[1 if fast else 0]

    def frequency(top: HeavyTop) -> float:
        return theory.nutation_frequency(top, state.theta, steady(top))

    measured = 2 * math.pi * (len(marks) - 1) / (marks[-1] - marks[0]) if nutates else math.nan
    name = f"{'fast' if fast else 'slow'} precession"
    return [
        _compared(WITHIN, name, steady, top, rate, by, "rad/s"),
        _compared(WITHIN, "nutation frequency", frequency, top, measured, by, "rad/s"),
    ]


@applies(needs.top)
def sleep(recording: Recording) -> list[Check]:
    """Check the largest tilt of a top that starts almost upright: it sleeps, or falls to a known tilt."""
    top, state = rigid_top(recording)
    by = slack(recording, state.omega3)
    tilt, _ = angles(recording)

    def largest(top: HeavyTop) -> float:
        return math.acos(theory.turning_points(top, state)[0])

    return [_compared(ASLEEP, "largest tilt", largest, top, float(tilt.max()), by, "rad")]
