"""Checks of bodies made from a material against the solids that they model."""

from __future__ import annotations

import math

import numpy as np

from springgym.model.bodies import vibrations
from springgym.model.bodies.elastic import Cable, Elastic
from springgym.model.bodies.precession import precession_gap, wobble_growth
from springgym.scenes.checks import needs
from springgym.scenes.checks.basis import Check, applies, crossings, gravity, peaks, period, within
from springgym.scenes.checks.tops import angles, mean_rate, rigid_top
from springgym.scenes.recording import Recording
from springgym.theory import rope, top

EXACT = 1e-12
"""Relative tolerance of properties that a network has exactly: round-off."""

TUNED = 2e-4
"""Relative tolerance of the lowest frequency, to which springs are calibrated; half is due to sampling."""

DAMPED = 0.01
"""Relative tolerance of the damping ratio, half of which is the measurement of decaying peaks."""

GAP = 0.02
"""Relative tolerance of the gap of the precession: theory neglects 1.9e-2 for rubber at 300 rad/s."""

SMALL = 0.14
"""Largest tilt of a small wobble [rad]: the neglected part of its growth is of second order."""

WOBBLE = 0.02
"""Relative tolerance of the growth of a wobble: `SMALL`²."""

STRETCH = 0.02
"""Relative tolerance of the mean stretch of a cable: bounces decay by ζ = 0.015 per radian in nylon."""

BOUNCE = 1e-3
"""Relative tolerance of a cable's frequency: 20 springs for a continuous one make less than 1e-4."""


def _solid(recording: Recording) -> Elastic:
    """Return the solid that the body of a recording models; `needs` ensure that there is one."""
    solid = recording.plan.scene.body.solid
    assert isinstance(solid, Elastic)
    return solid


@applies(needs.solid)
def solid_inertia(recording: Recording) -> list[Check]:
    """Check mass, centre and inertia tensor of the particles against the solid's, by quadrature."""
    body = recording.plan.scene.body
    solid = _solid(recording)
    size = float(np.ptp(body.positions, axis=0).max())
    moments = np.sort(np.linalg.eigvalsh(solid.inertia))
    turned = float(np.abs(body.inertia() - solid.inertia).max())
    centre = float(np.linalg.norm(body.centre - solid.centre))
    checks = [
        within(EXACT, "mass", solid.mass, body.mass, "kg"),
        Check("distance of the centres of mass", 0.0, centre, EXACT * size, "m"),
        Check("difference of the inertia tensors", 0.0, turned, EXACT * float(moments[-1]), "kg·m²"),
    ]
    for name, expected, found in zip(
        ("least", "middle", "largest"), moments, body.principal()[0], strict=True
    ):
        checks.append(within(EXACT, f"{name} moment", float(expected), float(found), "kg·m²"))
    return checks


def _ringing(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocity (T,) of the lowest vibration [√kg m/s] that is kicked, and times.

    Modes are orthogonal to all others and to rigid motion, so this is one damped oscillator.
    """
    body = recording.plan.scene.body
    frequencies, modes = vibrations(body)
    lowest = frequencies < frequencies[0] * (1 + 1e-6)
    own = np.einsum("qni,n,tni->tq", modes[lowest], body.masses, recording.velocities)
    kicked = own[0] / np.linalg.norm(own[0])
    return recording.times, own @ kicked


@applies(needs.solid, needs.free, needs.struck)
def ring_frequency(recording: Recording) -> list[Check]:
    """Check the lowest frequency of a body that rings, against that of the solid.

    Verlet steps of h make it ω (1 + (ω h)²/24), friction ω √(1 − ζ²).
    """
    solid = _solid(recording)
    times, ringing = _ringing(recording)
    ratio = solid.frequency_ratio
    damping = solid.damping_ratio
    slow = math.sqrt(1 - damping**2) * (1 + (solid.frequency * recording.step) ** 2 / 24)
    measured = 1 / period(times, ringing) if len(crossings(times, ringing)) > 2 else math.nan
    expected = solid.frequency / (2 * math.pi) * slow
    return [within(TUNED, "lowest frequency", expected, measured, "Hz", abs(ratio - 1) + 1e-4)]


@applies(needs.solid, needs.free, needs.struck)
def ring_down(recording: Recording) -> list[Check]:
    """Compare the decay of the vibration with a damping ratio of half the loss factor."""
    solid = _solid(recording)
    times, ringing = _ringing(recording)
    marks, heights = peaks(times, np.abs(ringing))
    heard = heights > 1e-3 * heights.max(initial=0.0)
    measured = math.nan
    if heard.sum() > 2:
        decay = -np.polyfit(marks[heard], np.log(heights[heard]), 1)[0]
        measured = float(decay / solid.frequency)
    expected = solid.material.loss / 2
    by = 5e-3 + 2 * abs(solid.frequency_ratio - 1)
    return [within(DAMPED, "damping ratio", expected, measured, "", by)]


@applies(needs.solid, needs.top)
def spin_gap(recording: Recording) -> list[Check]:
    """Check the fraction by which an elastic top precesses slower than the rigid one, by its stretch.

    Theory is of a body with static stretch. To loads that rotate relative to the body, those of weight and
    precession, the response is larger by (ω₃/ω₁)²; they are a fraction s = I₁ Ω/(I₃ ω₃) of the load of spin,
    which is constant in the body. The gap itself is small to first order, and since the top starts at the
    rigid body's rate it nutates a little, which makes s².
    """
    scene = recording.plan.scene
    solid = _solid(recording)
    rigid, state = rigid_top(recording)
    _, azimuth = angles(recording)
    rate = top.steady_precession(rigid, state.theta, state.omega3)[0]
    expected = precession_gap(scene.body, scene.pinned, scene.gravity or (), state.theta, state.omega3)
    measured = mean_rate(recording.times, azimuth) / rate - 1
    share = abs(rigid.i1 * rate / (rigid.i3 * state.omega3))
    by = abs(expected) + (state.omega3 / solid.frequency) ** 2 * share + share**2
    resolved = (state.omega3 * recording.step) ** 2 * abs(rate / state.omega3)
    return [within(GAP, "gap of the precession", expected, measured, "", by + resolved / abs(expected))]


def _mean(times: np.ndarray, values: np.ndarray) -> float:
    """Return the mean over time, by the trapezoidal rule."""
    return float(np.trapezoid(values, times) / (times[-1] - times[0]))


@applies(needs.solid, needs.free, needs.symmetric, needs.moves)
def wobble(recording: Recording) -> list[Check]:
    """Check the growth of the wobble of a free symmetric body by internal friction, while it is small."""
    scene = recording.plan.scene
    m = recording.measures
    momentum = m.angular_momentum / np.linalg.norm(m.angular_momentum, axis=1)[:, None]
    across = np.linalg.norm(np.cross(m.axis, momentum), axis=1)
    tilt = np.arctan2(across, np.einsum("ti,ti->t", m.axis, momentum))
    large = tilt > SMALL
    small = slice(0, int(np.argmax(large)) if large.any() else len(tilt))
    measured = math.nan
    if len(tilt[small]) > 9:
        measured = float(np.polyfit(recording.times[small], np.log(tilt[small]), 1)[0])
    growth = wobble_growth(scene.body, float(m.angular_velocity[0] @ m.axis[0]))
    return [within(WOBBLE, "growth of the wobble", growth, measured, "1/s", SMALL**2)]


@applies(needs.cable, needs.rope, needs.gravity)
def cable(recording: Recording) -> list[Check]:
    """Compare mean stretch and frequency of a cable that bounces under a load with a continuous cable.

    In its lowest mode the cable has a phase x = ω L √(ρ/E); n springs of phase x/n each have the relative
    error (x/n)²/24. For a bounce that decays as exp(−γ t), the mean over a period has the relative error γ/ω.
    """
    scene = recording.plan.scene
    made = scene.body.solid
    assert isinstance(made, Cable)
    given = (made.load, made.mass, made.material.young, made.section, made.length)
    stretch = rope.cable_stretch(*given, gravity(recording))
    bounce = rope.cable_bounce(*given)
    ends = recording.positions[:, [0, -1]]
    longer = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) - made.length
    marks = crossings(recording.times, longer - stretch, rising=True)
    mean = measured = math.nan
    if len(marks) > 2:
        during = (recording.times >= marks[0]) & (recording.times <= marks[-1])
        mean = _mean(recording.times[during], longer[during])
        measured = (len(marks) - 1) / (marks[-1] - marks[0])
    phase = bounce * made.length * math.sqrt(made.material.density / made.material.young)
    friction = made.material.loss / 2
    by = (phase / len(scene.body.springs)) ** 2 / 24 + (bounce * recording.step) ** 2 + friction**2
    frequency = bounce / (2 * math.pi)
    return [
        within(STRETCH, "mean stretch", stretch, mean, "m", by + friction),
        within(BOUNCE, "bounce frequency", frequency, measured, "Hz", by),
    ]
