"""Checks of rolling bodies against theory: balls, a tippe-top, a rattleback, Euler's disk."""

from __future__ import annotations

import math

import numpy as np

from springgym.bodies import Round
from springgym.scenes.checks import needs
from springgym.scenes.checks.basis import Check, applies, crossings, slack, turning_rate, within
from springgym.scenes.plan import Plan
from springgym.scenes.recording import Recording
from springgym.surfaces import Contact, Plane, scales
from springgym.theory import contact as sliding
from springgym.theory import rolling as theory

THIN = 1e-4
"""Share of the largest squared semi-axis below which the least is that of a disk."""

ROLLED = 1e-3
"""Share of the acceleration or speed of a ball: it sags under its weight by m g/k, which its moment knows."""

SKIDDED = 0.01
"""Share of the time of a skid: the ball settles on the floor while it does."""

KEPT = 1e-3
"""Share of Jellett's constant: what spins is wider by the square of ω/ω₁, and so is its sphere."""

TURNED = 0.01
"""Share of the spin of a rattleback, of the height of a tippe-top, of the rate of Euler's disk: a contact
that gives way and springs that stretch make half of it."""


def _feature(plan: Plan) -> Round:
    """Return the one round feature of a body.

    Raises
    ------
    ValueError
        If it has none, or several.
    """
    features = plan.scene.body.rounds
    if len(features) != 1:
        raise ValueError(f"body {plan.scene.body.name!r} has {len(features)} round features; it needs one")
    return features[0]


def _ball(plan: Plan) -> None:
    """Refuse what is no ball, the same in all directions."""
    feature, body = _feature(plan), plan.scene.body
    squares = np.linalg.eigvalsh(feature.matrix)
    moments, _ = body.principal()
    off = float(np.linalg.norm(feature.centre - body.centre))
    if np.ptp(squares) > 1e-9 * squares[2] or off > 1e-9 * feature.extent:
        raise ValueError(f"body {body.name!r} is not a sphere about its centre of mass")
    if np.ptp(moments) > 1e-9 * moments[2]:
        raise ValueError(f"the moments of inertia of body {body.name!r} differ")


def _tippe_top(plan: Plan) -> None:
    """Refuse what is no sphere with a symmetric body, whose centre of mass is on its axis off the centre."""
    feature, body = _feature(plan), plan.scene.body
    squares, arm = np.linalg.eigvalsh(feature.matrix), feature.centre - body.centre
    off = float(np.linalg.norm(arm))
    if np.ptp(squares) > 1e-9 * squares[2] or not off > 1e-6 * feature.extent:
        raise ValueError(f"body {body.name!r} is not a sphere whose centre of mass is off its centre")
    along = body.inertia() @ arm
    across = body.inertia() - np.outer(arm, along) / off**2
    sizes = np.linalg.eigvalsh(across)[1:]
    aside = np.linalg.norm(along - (along @ arm) / off**2 * arm)
    if aside > 1e-9 * np.linalg.norm(along) or np.ptp(sizes) > 1e-9 * sizes[1]:
        raise ValueError(f"body {body.name!r} is not symmetric about the line through both centres")


def _disk(plan: Plan) -> None:
    """Refuse what is no flat round feature about the centre of mass."""
    feature, body = _feature(plan), plan.scene.body
    squares = np.linalg.eigvalsh(feature.matrix)
    off = float(np.linalg.norm(feature.centre - body.centre))
    if squares[0] > THIN * squares[2] or squares[2] - squares[1] > 1e-9 * squares[2] or off > 1e-9:
        raise ValueError(f"body {body.name!r} is not a disk about its centre of mass")


def _solid(plan: Plan) -> None:
    """Refuse what has a flat feature, of which nothing is said."""
    squares = np.linalg.eigvalsh(_feature(plan).matrix)
    if not squares[0] > THIN * squares[2]:
        raise ValueError(f"the round feature of body {plan.scene.body.name!r} is flat")


def _g(recording: Recording) -> float:
    return float(np.linalg.norm(recording.plan.scene.gravity or 0.0))


def _share(recording: Recording) -> tuple[float, float]:
    """Return the radius [m] of a ball, and I/(m r²)."""
    body, radius = recording.plan.scene.body, _feature(recording.plan).extent
    return radius, float(np.trace(body.inertia())) / (3 * body.mass * radius**2)


@applies(_ball, needs.slope, needs.gravity)
def rolling(recording: Recording) -> list[Check]:
    """Compare the acceleration of a ball on a slope with theory: it rolls if friction suffices, or skids."""
    scene, (_, share) = recording.plan.scene, _share(recording)
    surface, contact = scene.surfaces[0], scene.contact
    assert isinstance(surface, Plane)
    assert isinstance(contact, Contact)
    angle, g = math.acos(surface.normal[2]), _g(recording)
    down = np.array([*surface.normal[:2], 0.0])
    down = down - (down @ surface.normal) * np.array(surface.normal)
    way = (recording.measures.centre - recording.measures.centre[0]) @ (down / np.linalg.norm(down))
    late = recording.times > 0.25 * recording.times[-1]
    measured = 2 * float(np.polyfit(recording.times[late], way[late], 2)[0]) if late.sum() > 3 else math.nan
    expected = theory.acceleration(angle, share, g)
    if contact.friction < theory.needed_friction(angle, share):
        expected = sliding.slope_acceleration(angle, contact.friction, g)
    by = _sag(recording)
    return [within(ROLLED, "acceleration", expected, measured, "m/s²", by)]


def _sag(recording: Recording) -> float:
    """Return the share by which springs that give way change the moments of a body that rolls."""
    return 2 * float(recording.measures.strain[len(recording.times) // 2 :].max(initial=0.0))


@applies(_ball, needs.level, needs.friction, needs.moves, needs.gravity)
def skidding(recording: Recording) -> list[Check]:
    """Compare the speed at which a ball rolls after it skidded with theory, and the time to half the slip."""
    contact, m = recording.plan.scene.contact, recording.measures
    radius, share = _share(recording)
    slip = m.centre_velocity - np.cross(m.angular_velocity, [0.0, 0.0, radius])
    along = slip[0] * (1, 1, 0) / max(float(np.linalg.norm(slip[0, :2])), 1e-300)
    start, turning = float(m.centre_velocity[0] @ along), float((slip - m.centre_velocity)[0] @ along)
    speed, lasts = theory.after_skidding(start + turning, share, contact.friction, _g(recording))
    expected = speed - turning
    late = recording.times > max(1.5 * lasts, 0.75 * recording.times[-1])
    rolls = float((m.centre_velocity[late] @ along).mean()) if late.any() else math.nan
    halves = crossings(recording.times, slip @ along - 0.5 * (start + turning), rising=False)
    half = float(halves[0]) if len(halves) else math.nan
    by = _sag(recording)
    return [
        within(ROLLED, "speed of rolling", expected, rolls, "m/s", by),
        within(SKIDDED, "time to half the slip", 0.5 * lasts, half, "s", by + recording.step / lasts),
    ]


@applies(_tippe_top, needs.level, needs.moves, needs.gravity)
def tippe_top(recording: Recording) -> list[Check]:
    """Compare Jellett's constant of a tippe-top with its start, and how high its centre of mass comes."""
    scene, m = recording.plan.scene, recording.measures
    feature, body = _feature(recording.plan), scene.body
    arm = feature.centre - body.centre
    off = float(np.linalg.norm(arm))
    axis = m.axis * np.sign(float(arm @ (body.positions[body.markers[1]] - body.positions[body.markers[0]])))
    kept = theory.jellett(m.angular_momentum, axis, feature.extent, off)
    last = float(kept[np.abs(kept - kept[0]).argmax()])
    strength, reach = scales(scene.contact, body)
    gap = sliding.rest_height(body.mass * _g(recording), strength, reach)
    high = float(m.centre[-1, 2]) - gap
    by = slack(recording, 0.0)
    return [
        within(KEPT, "Jellett's constant", float(kept[0]), last, "kg m³/s", by),
        within(TURNED, "height of the centre of mass at the end", feature.extent + off, high, "m", by),
    ]


@applies(_solid, needs.level, needs.friction, needs.moves, needs.gravity)
def rattleback(recording: Recording) -> list[Check]:
    """Compare the spin about the vertical of what rolls with that of a rigid body (Kane & Levinson 1982).

    In the mean of the end, as spin and rattling take turns; and when it turns back, or the least that it has
    if it does not.
    """
    scene, m = recording.plan.scene, recording.measures
    feature, body = _feature(recording.plan), scene.body
    squares, axes = np.linalg.eigh(feature.matrix)
    own = body.positions - body.centre
    now = scene.positions - body.masses @ scene.positions / body.mass
    left, _, right = np.linalg.svd((now.T * body.masses) @ own)
    turn = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    spins, _ = theory.rolling_ellipsoid(
        np.sqrt(squares),
        axes.T @ body.inertia() @ axes / body.mass,
        axes.T @ (feature.centre - body.centre),
        turn @ axes,
        m.angular_velocity[0],
        recording.times,
        _g(recording),
    )
    by = slack(recording, float(np.linalg.norm(m.angular_velocity[0])))
    rigid, own = spins[:, 2], m.angular_velocity[:, 2]
    late = recording.times > 0.9 * recording.times[-1]
    found = [
        within(
            TURNED, "mean spin at the end", float(rigid[late].mean()), float(own[late].mean()), "rad/s", by
        )
    ]
    sense = float(np.sign(rigid[0]))
    backs = [crossings(recording.times, sense * each, rising=False) for each in (rigid, own)]
    if len(backs[0]):
        turns = float(backs[1][0]) if len(backs[1]) else math.nan
        found.append(within(TURNED, "time at which it turns back", float(backs[0][0]), turns, "s", by))
    else:
        least = float((sense * rigid).min()), float((sense * own).min())
        found.append(within(TURNED, "least spin", *least, "rad/s", by))
    return found


@applies(_disk, needs.level, needs.friction, needs.moves, needs.gravity)
def euler_disk(recording: Recording) -> list[Check]:
    """Compare the rate at which a disk rolls round on its rim with theory, by its mean tilt."""
    scene, m = recording.plan.scene, recording.measures
    feature, body = _feature(recording.plan), scene.body
    tilt = np.arccos(np.clip(np.abs(m.axis[:, 2]), 0.0, 1.0))
    azimuth = np.unwrap(np.arctan2(m.axis[:, 1], m.axis[:, 0]))
    mean = float(tilt.mean())
    moments = np.linalg.eigvalsh(body.inertia()) / body.mass
    expected = theory.disk_rate(mean, feature.extent, float(moments[0]), _g(recording))
    measured = abs(float(np.polyfit(recording.times, azimuth, 1)[0]))
    by = slack(recording, turning_rate(recording)) + float(np.ptp(tilt)) / mean
    return [within(TURNED, "rate of rolling round", expected, measured, "rad/s", by)]
