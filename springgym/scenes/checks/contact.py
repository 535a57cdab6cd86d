"""Checks of bodies on floors, on slopes, in bowls and in pipes against theory."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from springgym.dynamics.contact.law import SLOW
from springgym.model.bodies.body import rigidity_matrix
from springgym.model.bodies.elasticity import spring_force_and_jacobian
from springgym.model.bodies.precession import axial_moments
from springgym.model.surfaces import Bowl, Contact, PaperContact, Pipe, Plane, scales
from springgym.scenes.checks import needs
from springgym.scenes.checks.basis import (
    Check,
    applies,
    crossings,
    gravity,
    peaks,
    period,
    slack,
    spread,
    within,
)
from springgym.scenes.checks.tops import angles, mean_rate
from springgym.scenes.recording import Recording, record
from springgym.theory import contact as theory
from springgym.theory import impact as impacts
from springgym.theory import pendulum
from springgym.theory import top as tops

WITHIN = 5e-3
"""Relative tolerance for bodies that stand, slide or bounce: sampling of a turning point makes 1.4e-3."""

RESTORED = 0.02
"""Relative tolerance of the restitution. Theory neglects weight, 1.3e-2 at 2 m/s with Δ = 2 cm."""

STILL = 1e-3
"""Speed below which a body is at rest [m/s]."""

ELASTIC = 1e-6
"""Relative tolerance of the height of a bounce without loss: contact solves its equation to 1e-10, and each
step rounds by 1e-12."""

STRAIGHT = 1e-9
"""Tolerance relative to the body's size: round-off of 1e-16 of a path of ten sizes, in 1e6 steps."""

SWUNG = 1e-3
"""Relative tolerance of the period in a bowl or a pipe: the particle's gap in the barrier changes by less
than 1e-4 of the radius."""

STRUCK = 0.03
"""Relative tolerance of contact time and rebound: theory is linear in strains, up to 1.4e-2 in rubber."""

SPUN = 5e-3
"""Relative tolerance of a top's axial spin, and of the coefficient of friction: its strain changes by 6e-4 as
it lands, and its moments by 1.3e-3."""

RESTED = 0.01
"""Relative tolerance of M g l/(I₃ ω₃), a fast top's precession: errors of 1.6e-3 in constants make 5e-3."""

SLIDES = 1e-3
"""Speed of a tip below which it may stick [m/s]."""

CREEP = 1e-6
"""Largest motion of a body that sticks, in half of the run [m]."""


def _met(recording: Recording) -> tuple[Contact | PaperContact, float, float, float]:
    """Return the contact of a scene, its c [N·m²] and Δ [m], and g [m/s²]."""
    scene = recording.plan.scene
    return scene.contact, *scales(scene.contact, scene.body), gravity(recording)


def _carried(recording: Recording) -> np.ndarray:
    """Return the particles that the first surface supports at the end, (N,)."""
    _, _, reach, _ = _met(recording)
    return recording.plan.scene.surfaces[0].height(recording.positions[-1]) < reach


@applies(needs.particle, needs.ground, needs.dropped, needs.gravity)
def bounces(recording: Recording) -> list[Check]:
    """Check the lowest point of a particle dropped on an elastic floor, and the height of its rebounds."""
    _, c, reach, g = _met(recording)
    mass = recording.plan.scene.body.mass
    times = recording.times
    height = recording.positions[:, 0, 2]
    start = float(height[0])
    lowest = theory.turning_point(mass * g * start, c, reach, mass * g)
    # it turns at most half an interval from a state, with a = F/m
    pull = float(theory.force(lowest, c, reach)) / mass
    seen = pull * float(times[1] - times[0]) ** 2 / 8
    _, tops = peaks(times, height)
    apex = float(tops[-1]) if len(tops) else math.nan
    count = recording.times[-1] / recording.step
    return [
        within(WITHIN, "lowest point", lowest, float(height.min()), "m", seen / lowest),
        within(ELASTIC, f"apex {len(tops)}", start, apex, "m", 1e-12 * count),
    ]


@applies(needs.particle, needs.ground, needs.dropped, needs.restitution, needs.gravity)
def restitution(recording: Recording) -> list[Check]:
    """Check the restitution of the first bounces, by the heights between them, at the speeds they have.

    Theory neglects weight. During the contact time T, weight adds g T to the change of speed v (1 + e), and
    loses in proportion; T is the path 2 Δ, there and back, at a mean speed of a quarter of that change.
    """
    contact, _, reach, g = _met(recording)
    assert isinstance(contact, Contact)
    height = recording.positions[:, 0, 2]
    _, tops = peaks(recording.times, height)
    tops = tops[tops > reach]
    heights = [float(height[0]), *(tops[:5].tolist() or [math.nan])]
    speeds = [math.sqrt(2 * g * (top - reach)) for top in heights]
    checks = []
    for speed, rebound in pairwise(speeds):
        expected = theory.rebound(speed, contact.restitution, SLOW)
        by = (1 - expected) * 8 * g * reach / (speed * (1 + expected)) ** 2
        name = f"restitution at {speed:.2f} m/s"
        checks.append(within(RESTORED, name, expected, rebound / speed, "", by / expected))
    return checks


@applies(needs.level, needs.gravity)
def rest_height(recording: Recording) -> list[Check]:
    """Compare the load on the particles of a body at rest with its weight."""
    _, c, reach, g = _met(recording)
    surface = recording.plan.scene.surfaces[0]
    below = _carried(recording)
    weight = recording.plan.scene.body.mass * g
    late = recording.times >= min(0.9 * recording.times[-1], recording.times[-2])
    heights = surface.height(recording.positions[late][:, below])
    force = theory.force(heights, c, reach).sum(axis=1)
    # force that does not balance the weight moves the body: m Δv in that time
    upwards = recording.measures.momentum[late, 2]
    moved = float(np.ptp(upwards)) / float(np.ptp(recording.times[late]))
    still = at_rest(recording, late)
    carried = float(force.mean()) if still.passed else math.nan  # else it is not at rest yet
    return [within(WITHIN, "force of the floor", weight, carried, "N", moved / weight), still]


def at_rest(recording: Recording, late: np.ndarray) -> Check:
    """Check that no particle moves in some ``late`` states, selected by a mask or indices."""
    speed = float(np.linalg.norm(recording.velocities[late], axis=2).max())
    return Check("largest speed at rest", 0.0, speed, STILL, "m/s")


@applies(needs.level, needs.friction, needs.moves, needs.gravity)
def stopping(recording: Recording) -> list[Check]:
    """Check the distance and time in which a sliding block stops."""
    contact, _, _, g = _met(recording)
    m = recording.measures
    mass = recording.plan.scene.body.mass
    speed = float(np.linalg.norm(m.momentum[0])) / mass
    way = float(np.linalg.norm(m.centre[-1] - m.centre[0]))
    expected = theory.stopping_distance(speed, contact.friction, g)
    moving = np.linalg.norm(m.momentum, axis=1) / mass
    halves = crossings(recording.times, moving - speed / 2, rising=False)
    half = float(halves[0]) if len(halves) and moving[-1] < STILL else math.nan
    by = slack(recording, contact.friction * g / speed)
    return [
        within(WITHIN, "stopping distance", expected, way if moving[-1] < STILL else math.nan, "m", by),
        within(WITHIN, "time to half the speed", speed / (2 * contact.friction * g), half, "s", by),
    ]


@applies(needs.slope, needs.gravity, needs.coulomb)
def slope(recording: Recording) -> list[Check]:
    """Compare a block on a slope with theory: it rests, or slides with a known acceleration."""
    contact = recording.plan.scene.contact
    surface = recording.plan.scene.surfaces[0]
    assert isinstance(surface, Plane)
    angle = math.acos(surface.normal[2])
    way = way_down(recording, np.array(surface.normal))
    return [down_slope(recording, way, angle, contact.friction, recording.plan.scene.body.lengths.min())]


def way_down(recording: Recording, normal: np.ndarray) -> np.ndarray:
    """Return the displacement (T,) [m] of the centre of mass down a slope with a unit normal (3,)."""
    down = normal * (1, 1, 0)
    down = down - (down @ normal) * normal
    moved = recording.measures.centre - recording.measures.centre[0]
    return np.asarray(moved @ (down / np.linalg.norm(down)))


def down_slope(recording: Recording, way: np.ndarray, angle: float, friction: float, length: float) -> Check:
    """Check the displacement (T,) [m] of a body down a slope: it sticks, or slides by Coulomb's law.

    Theory neglects that the body swings, at the rate √(g/``length``) [rad/s].
    """
    late = recording.times > 0.5 * recording.times[-1]
    if theory.holds(angle, friction):
        creep = float(np.abs(way[late] - way[late][0]).max())
        return Check("way in the second half", 0.0, creep, CREEP, "m")
    g = gravity(recording)
    expected = theory.slope_acceleration(angle, friction, g)
    enough = late.sum() > 3
    measured = 2 * float(np.polyfit(recording.times[late], way[late], 2)[0]) if enough else math.nan
    by = slack(recording, math.sqrt(g / length))
    return within(WITHIN, "acceleration", expected, measured, "m/s²", by * g / expected)


@applies(needs.level, needs.ice, needs.gravity)
def straight_fall(recording: Recording) -> list[Check]:
    """Check that the centre of mass keeps its horizontal velocity, as nothing pushes sideways on ice."""
    m = recording.measures
    way = m.centre - m.centre[0] - np.outer(recording.times, m.centre_velocity[0])
    moved = float(np.abs(way[:, :2]).max())
    size = float(recording.plan.scene.body.size)
    return [Check("sideways move of the centre", 0.0, moved, STRAIGHT * size, "m")]


@applies(needs.particle, needs.bowl, needs.gravity)
def bowl_period(recording: Recording) -> list[Check]:
    """Compare the period of a particle that slides to and fro in a bowl with that of a pendulum."""
    bowl = recording.plan.scene.surfaces[0]
    assert isinstance(bowl, Bowl)
    return [_sliding(recording, bowl.centre, bowl.radius, (1.0, 0.0, 0.0), "period in the bowl")]


@applies(needs.particle, needs.level_pipe, needs.gravity)
def pipe_period(recording: Recording) -> list[Check]:
    """Compare the period of a particle that slides across a level pipe with that of a pendulum."""
    pipe = recording.plan.scene.surfaces[0]
    assert isinstance(pipe, Pipe)
    across = np.cross(pipe.axis, (0.0, 0.0, 1.0))
    return [_sliding(recording, pipe.point, pipe.radius, across, "period in the pipe")]


def _sliding(recording: Recording, centre: ArrayLike, radius: float, across: ArrayLike, what: str) -> Check:
    """Compare the period of a particle that slides to and fro with that of a pendulum.

    Its rod reaches from the ``centre`` to the particle; it swings along ``across``, a unit vector.
    """
    _, c, reach, g = _met(recording)
    weight = recording.plan.scene.body.mass * g
    arm = recording.positions[:, 0] - np.asarray(centre)
    angle = np.arctan2(arm @ np.asarray(across), -arm[:, 2])
    amplitude = float(np.abs(angle[0]))
    length = radius - theory.rest_height(weight, c, reach)
    expected = pendulum.period(length, g, amplitude)
    # swinging changes the load by less than 3 (1 − cos θ₀), and the height by less than its reach for that
    by = 3 * (1 - math.cos(amplitude)) * reach / length + (math.sqrt(g / length) * recording.step) ** 2
    return within(SWUNG, what, expected, period(recording.times, -angle), "s", by)


@applies(needs.ground, needs.smooth, needs.falls, needs.gravity)
def impact(recording: Recording) -> list[Check]:
    """Compare contact time and rebound speed of a body that is dropped on a floor with theory.

    Theory is `springgym.theory.impact`, for the body's springs, not for the solid that they may model, whose
    waves they do not represent. Every step is measured, from the last recorded state before contact.
    """
    scene = recording.plan.scene
    _, c, reach, g = _met(recording)
    body = scene.body
    start = scene.positions
    _, jacobian = spring_force_and_jacobian(body.with_(positions=start, lengths=body.lengths), start)
    rows = rigidity_matrix(start, body.springs).reshape(len(body.springs), -1)
    height = start[:, 2] - start[:, 2].min()
    speed = math.sqrt(2 * g * (float(start[:, 2].min()) - reach))
    dampers = rows.T @ (body.damping[:, None] * rows)
    expected = impacts.impact(body.masses, -jacobian, dampers, height, speed, c, reach, g)
    quick = float(np.linalg.eigvalsh(-jacobian / np.sqrt(np.outer(*[np.repeat(body.masses, 3)] * 2)))[-1])
    duration, left, strain = _touch(recording, reach, expected)
    by = 2 * strain + quick * recording.step**2 / 24
    return [
        within(STRUCK, "time of contact", expected.duration, duration, "s", by),
        within(STRUCK, "speed of rebound", expected.speed, left, "m/s", by),
    ]


def _touch(recording: Recording, reach: float, expected: impacts.Impact) -> tuple[float, float, float]:
    """Return duration of the first contact [s], speed after it [m/s], and largest strain in it, or NaN."""
    low = recording.positions[:, :, 2].min(axis=1)
    upwards = np.diff(recording.measures.centre_velocity[:, 2]) > 0
    before = np.flatnonzero(upwards | (low[1:] < reach))
    if not len(before) or low[before[0]] < reach:
        return math.nan, math.nan, 0.0
    n = int(before[0])
    plan = recording.plan
    scene = plan.scene.with_(positions=recording.positions[n], velocities=recording.velocities[n])
    away = float(recording.times[1]) + 1.1 * expected.until
    seen = record(replace(plan, scene=scene, step=recording.step, interval=recording.step, duration=away))
    above = seen.positions[:, :, 2].min(axis=1) - reach
    down, up = (crossings(seen.times, above, rising=rising) for rising in (False, True))
    if not len(down) or not len(up):
        return math.nan, math.nan, 0.0
    speed = np.interp(down[0] + expected.until, seen.times, seen.measures.centre_velocity[:, 2])
    up = up[up < down[0] + expected.until]
    return float(up[-1] - down[0]) if len(up) else math.nan, float(speed), float(seen.measures.strain.max())


def _alone(recording: Recording) -> bool:
    """Return whether only the tip of a top came near to the surface."""
    scene = recording.plan.scene
    _, _, reach, _ = _met(recording)
    x = np.delete(recording.positions, scene.body.particle("tip"), axis=1)
    return bool((scene.surfaces[0].height(x.reshape(-1, 3)) > reach).all())


@applies(needs.surface, needs.on_tip, needs.moves)
def axial_spin(recording: Recording) -> list[Check]:
    """Compare the spin of a symmetric top about its axis with its start: contact at the tip conserves it."""
    m = recording.measures
    spin = np.einsum("ti,ti->t", m.angular_velocity, m.axis)
    doubt = slack(recording, float(spin[0])) if _alone(recording) else math.inf
    last = float(spin[np.abs(spin - spin[0]).argmax()])
    return [within(SPUN, "spin about its axis", float(spin[0]), last, "rad/s", doubt)]


@applies(needs.level, needs.on_tip, needs.friction, needs.moves, needs.gravity)
def rubbing(recording: Recording) -> list[Check]:
    """Check friction on a tip that slides over a floor: its impulse is μ times the normal impulse.

    Both follow from momentum and weight. In an interval the direction of the slip turns by an angle α, so
    that the sum of friction is a chord, short by α²/24. A tip that sticks is not covered.
    """
    scene = recording.plan.scene
    m = recording.measures
    contact, _, _, g = _met(recording)
    given = np.diff(m.momentum, axis=0)
    given[:, 2] += scene.body.mass * g * np.diff(recording.times)
    slip = recording.velocities[:, scene.body.particle("tip"), :2]
    fast = np.linalg.norm(slip, axis=1)
    turn = np.diff(np.unwrap(np.arctan2(slip[:, 1], slip[:, 0])))
    slow = float((fast < SLIDES).mean())
    doubt = slow + float((turn**2).mean()) / 24 if _alone(recording) else math.inf
    share = float(np.linalg.norm(given[:, :2], axis=1).sum() / given[:, 2].sum())
    return [within(SPUN, "friction over force of the floor", contact.friction, share, "", doubt)]


@applies(needs.surface, needs.on_tip, needs.friction, needs.moves, needs.gravity)
def resting_tip(recording: Recording) -> list[Check]:
    """Compare the mean precession in the second half, when the tip rests, with that of a pinned top."""
    scene = recording.plan.scene
    m = recording.measures
    body = scene.body
    g = gravity(recording)
    tip = body.particle("tip")
    late = recording.times >= 0.5 * recording.times[-1]
    tilt, azimuth = angles(recording)
    moved = float(np.ptp(recording.positions[late, tip], axis=0).max())
    spin = float(m.angular_velocity[0] @ m.axis[0])
    lean = float(tilt[late].mean())
    arm = float(np.linalg.norm(body.centre - body.positions[tip]))

    def rate(i1: float, i3: float, mgl: float) -> float:
        return tops.steady_precession(tops.HeavyTop(i1, i3, mgl), lean, spin)[0]

    constants = (*axial_moments(body, body.positions[tip]), body.mass * g * arm)
    doubt = math.inf
    if _alone(recording) and moved < CREEP:
        # its tilt swings a little, which changes the rate to second order
        doubt = (
            spread(rate, *constants, by=slack(recording, spin))
            + rate(*constants) * float(np.ptp(tilt[late])) ** 2
        )
    tolerance = RESTED * constants[2] / (constants[1] * abs(spin))
    measured = mean_rate(recording.times[late], azimuth[late])
    return [Check("precession when its tip rests", rate(*constants), measured, tolerance, "rad/s", doubt)]
