"""Checks of rolling bodies against theory: balls, a tippe-top, a rattleback, Euler's disk."""

from __future__ import annotations

import math

import numpy as np

from springgym.model.bodies import Body, Round
from springgym.model.bodies.body import inertia
from springgym.model.surfaces import Contact, Plane, scales
from springgym.scenes.checks import needs
from springgym.scenes.checks.basis import Check, applies, crossings, gravity, slack, turning_rate, within
from springgym.scenes.checks.contact import way_down
from springgym.scenes.plan import Plan
from springgym.scenes.recording import Recording
from springgym.theory import contact as sliding
from springgym.theory import rolling as theory

THIN = 1e-4
"""Ratio of the least to the largest squared semi-axis below which a feature is a disk."""

ROLLED = 1e-3
"""Relative tolerance of a ball's acceleration or speed: its sag by m g/k changes its moment."""

SKIDDED = 0.01
"""Relative tolerance of the time of a skid, during which the ball settles on the floor."""

KEPT = 1e-3
"""Relative tolerance of Jellett's constant: a spinning body, and its sphere, are wider by (ω/ω₁)²."""

RISE = (math.radians(60), math.radians(20))
"""Tilts of an egg between which its rise is timed [rad]: below, it slows down and does not arrive; above, it
does not slide in a single direction yet."""

RISEN = 0.03
"""Relative tolerance of an egg's rise time: theory neglects g against ω² a, some 1 % for a rigid egg."""

TURNED = 0.01
"""Relative tolerance of a rattleback's spin, a tippe-top's height and the rate of Euler's disk: yielding
contacts and stretched springs make half of it."""


def _only_feature(body: Body) -> Round:
    """Return the only round feature of a body.

    Raises
    ------
    ValueError
        If it has none, or several.
    """
    if len(body.rounds) != 1:
        raise ValueError(f"body {body.name!r} has {len(body.rounds)} round features; it needs one")
    return body.rounds[0]


def _feature(plan: Plan) -> Round:
    return _only_feature(plan.scene.body)


def refuse_other_than_balls(body: Body) -> None:
    """Raise ValueError unless a body is a ball with equal moments of inertia.

    Raises
    ------
    ValueError
        If the body has no single sphere about its centre of mass, or moments of inertia that differ.
    """
    feature = _only_feature(body)
    squares = np.linalg.eigvalsh(feature.matrix)
    moments, _ = body.principal()
    off = float(np.linalg.norm(feature.centre - body.centre))
    if np.ptp(squares) > 1e-9 * squares[2] or off > 1e-9 * feature.extent:
        raise ValueError(f"body {body.name!r} is not a sphere about its centre of mass")
    if np.ptp(moments) > 1e-9 * moments[2]:
        raise ValueError(f"the moments of inertia of body {body.name!r} differ")


def _ball(plan: Plan) -> None:
    refuse_other_than_balls(plan.scene.body)


def _tippe_top(plan: Plan) -> None:
    """Raise ValueError unless a body is a symmetric sphere with its centre of mass off its centre."""
    feature = _feature(plan)
    body = plan.scene.body
    squares = np.linalg.eigvalsh(feature.matrix)
    arm = feature.centre - body.centre
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
    """Raise ValueError unless a body has one flat round feature about its centre of mass."""
    feature = _feature(plan)
    body = plan.scene.body
    squares = np.linalg.eigvalsh(feature.matrix)
    off = float(np.linalg.norm(feature.centre - body.centre))
    if squares[0] > THIN * squares[2] or squares[2] - squares[1] > 1e-9 * squares[2] or off > 1e-9:
        raise ValueError(f"body {body.name!r} is not a disk about its centre of mass")


def _solid(plan: Plan) -> None:
    """Raise ValueError for a flat feature, which the theory does not cover."""
    squares = np.linalg.eigvalsh(_feature(plan).matrix)
    if not squares[0] > THIN * squares[2]:
        raise ValueError(f"the round feature of body {plan.scene.body.name!r} is flat")


def _egg(plan: Plan) -> None:
    """Raise ValueError unless a body is a prolate spheroid about its centre of mass, of the same symmetry."""
    feature = _feature(plan)
    body = plan.scene.body
    squares, axes = np.linalg.eigh(feature.matrix)
    off = float(np.linalg.norm(feature.centre - body.centre))
    if squares[1] - squares[0] > 1e-9 * squares[2] or not squares[1] < 0.999 * squares[2] or off > 1e-9:
        raise ValueError(f"body {body.name!r} is not a prolate spheroid about its centre of mass")
    inertia = axes.T @ body.inertia() @ axes
    if np.ptp(np.linalg.eigvalsh(inertia[:2, :2])) > 1e-9 * inertia[0, 0]:
        raise ValueError(f"the inertia of body {body.name!r} is not symmetric about its long axis")


def moment_share(body: Body) -> tuple[float, float]:
    """Return the radius [m] of a ball, and I/(m r²)."""
    radius = _only_feature(body).extent
    return radius, float(np.trace(body.inertia())) / (3 * body.mass * radius**2)


@applies(_ball, needs.slope, needs.gravity, needs.coulomb)
def rolling(recording: Recording) -> list[Check]:
    """Compare the acceleration of a ball on a slope with theory: it rolls, or skids for lack of friction."""
    scene = recording.plan.scene
    _, share = moment_share(recording.plan.scene.body)
    surface = scene.surfaces[0]
    contact = scene.contact
    assert isinstance(surface, Plane)
    assert isinstance(contact, Contact)
    angle = math.acos(surface.normal[2])
    g = gravity(recording)
    way = way_down(recording, np.array(surface.normal))
    late = recording.times > 0.25 * recording.times[-1]
    measured = 2 * float(np.polyfit(recording.times[late], way[late], 2)[0]) if late.sum() > 3 else math.nan
    expected = theory.acceleration(angle, share, g)
    if contact.friction < theory.needed_friction(angle, share):
        expected = sliding.slope_acceleration(angle, contact.friction, g)
    by = _sag(recording)
    return [within(ROLLED, "acceleration", expected, measured, "m/s²", by)]


def _sag(recording: Recording) -> float:
    """Return the relative change of a rolling body's moments by the sag of its springs."""
    return 2 * float(recording.measures.strain[len(recording.times) // 2 :].max(initial=0.0))


@applies(_ball, needs.level, needs.friction, needs.moves, needs.gravity)
def skidding(recording: Recording) -> list[Check]:
    """Compare the speed at which a ball rolls after it skidded with theory, and the time to half the slip."""
    contact = recording.plan.scene.contact
    m = recording.measures
    radius, share = moment_share(recording.plan.scene.body)
    slip = m.centre_velocity - np.cross(m.angular_velocity, [0.0, 0.0, radius])
    along = slip[0] * (1, 1, 0) / max(float(np.linalg.norm(slip[0, :2])), 1e-300)
    start = float(m.centre_velocity[0] @ along)
    turning = float((slip - m.centre_velocity)[0] @ along)
    speed, lasts = theory.after_skidding(start + turning, share, contact.friction, gravity(recording))
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


def _resisted(plan: Plan) -> None:
    """Raise ValueError unless a ball has rolling resistance, and rolls from the start until it stops."""
    contact = plan.scene.contact
    radius, share = moment_share(plan.scene.body)
    if not isinstance(contact, Contact) or not contact.rolling_resistance > 0:
        raise ValueError("nothing resists its rolling")
    if contact.friction < contact.rolling_resistance / (radius * (1 + share)):
        raise ValueError("its friction is too small for it to roll to a stop")
    x = plan.scene.positions
    v = plan.scene.velocities
    masses = plan.scene.body.masses
    arms = x - masses @ x / masses.sum()
    centre = masses @ v / masses.sum()
    spin = np.linalg.solve(inertia(arms, masses), masses @ np.cross(arms, v))
    slip = centre - np.cross(spin, [0.0, 0.0, radius])
    if np.linalg.norm(slip) > ROLLED * np.linalg.norm(centre):
        raise ValueError("it does not roll at the start")


@applies(_ball, needs.level, needs.moves, needs.gravity, _resisted)
def rolling_resistance(recording: Recording) -> list[Check]:
    """Compare the distance and the time in which a rolling ball stops with theory."""
    contact = recording.plan.scene.contact
    m = recording.measures
    assert isinstance(contact, Contact)
    radius, share = moment_share(recording.plan.scene.body)
    speed = np.linalg.norm(m.centre_velocity[:, :2], axis=1)
    way, lasts = theory.resisted_way(
        float(speed[0]), share, contact.rolling_resistance, radius, gravity(recording)
    )
    stops = crossings(recording.times, speed - 0.5 * speed[0], rising=False)
    half = float(stops[0]) if len(stops) else math.nan
    gone = float(np.linalg.norm((m.centre[-1] - m.centre[0])[:2]))
    gone = gone if recording.times[-1] > lasts else math.nan
    by = _sag(recording)
    return [
        within(ROLLED, "way to rest", way, gone, "m", by),
        within(ROLLED, "time to half the speed", 0.5 * lasts, half, "s", by),
    ]


@applies(_tippe_top, needs.level, needs.moves, needs.gravity)
def tippe_top(recording: Recording) -> list[Check]:
    """Compare Jellett's constant of a tippe-top with its start, and check the rise of its centre of mass."""
    scene = recording.plan.scene
    m = recording.measures
    feature = _feature(recording.plan)
    body = scene.body
    arm = feature.centre - body.centre
    off = float(np.linalg.norm(arm))
    axis = m.axis * np.sign(float(arm @ (body.positions[body.markers[1]] - body.positions[body.markers[0]])))
    kept = theory.jellett(m.angular_momentum, axis, feature.extent, off)
    last = float(kept[np.abs(kept - kept[0]).argmax()])
    strength, reach = scales(scene.contact, body)
    gap = sliding.rest_height(body.mass * gravity(recording), strength, reach)
    high = float(m.centre[-1, 2]) - gap
    by = slack(recording, 0.0)
    return [
        within(KEPT, "Jellett's constant", float(kept[0]), last, "kg m³/s", by),
        within(TURNED, "height of the centre of mass at the end", feature.extent + off, high, "m", by),
    ]


def _orientation(body: Body, positions: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) from the shape in which a body was made to positions."""
    own = body.positions - body.centre
    now = positions - body.masses @ positions / body.mass
    left, _, right = np.linalg.svd((now.T * body.masses) @ own)
    return np.asarray(left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right)


def _rolled(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Return angular velocities [rad/s] and velocities [m/s], both (T, 3), of a rigid body that rolls."""
    scene = recording.plan.scene
    feature = _feature(recording.plan)
    body = scene.body
    squares, axes = np.linalg.eigh(feature.matrix)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    offset = axes.T @ (feature.centre - body.centre)
    spins, frames = theory.rolling_ellipsoid(
        np.sqrt(squares),
        axes.T @ body.inertia() @ axes / body.mass,
        offset,
        _orientation(body, scene.positions) @ axes,
        recording.measures.angular_velocity[0],
        recording.times,
        gravity(recording),
    )
    upwards = frames[:, 2]
    sizes = np.sqrt((squares * upwards**2).sum(axis=1, keepdims=True))
    touching = offset - squares * upwards / sizes
    return spins, -np.cross(spins, np.einsum("tij,tj->ti", frames, touching))


@applies(_solid, needs.level, needs.friction, needs.moves, needs.gravity)
def rattleback(recording: Recording) -> list[Check]:
    """Compare the vertical spin of a rolling body with that of a rigid one (Kane & Levinson 1982).

    Compared are its mean at the end, as spin and rattling alternate, and the time of its reversal, or its
    least value without one.
    """
    m = recording.measures
    spins, _ = _rolled(recording)
    by = slack(recording, float(np.linalg.norm(m.angular_velocity[0])))
    rigid = spins[:, 2]
    own = m.angular_velocity[:, 2]
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
    """Compare the rate at which a disk rolls on its rim with theory, from its mean tilt."""
    scene = recording.plan.scene
    m = recording.measures
    feature = _feature(recording.plan)
    body = scene.body
    tilt = np.arccos(np.clip(np.abs(m.axis[:, 2]), 0.0, 1.0))
    azimuth = np.unwrap(np.arctan2(m.axis[:, 1], m.axis[:, 0]))
    mean = float(tilt.mean())
    moments = np.linalg.eigvalsh(body.inertia()) / body.mass
    expected = theory.disk_rate(mean, feature.extent, float(moments[0]), gravity(recording))
    measured = abs(float(np.polyfit(recording.times, azimuth, 1)[0]))
    by = slack(recording, turning_rate(recording)) + float(np.ptp(tilt)) / mean
    return [within(TURNED, "rate of rolling round", expected, measured, "rad/s", by)]


@applies(_solid, needs.level, needs.friction, needs.moves, needs.gravity)
def walking(recording: Recording) -> list[Check]:
    """Compare path length and displacement of a rolling body with a rigid one (Kane & Levinson 1982)."""
    m = recording.measures
    times = recording.times
    _, velocities = _rolled(recording)
    mean = 0.5 * (velocities[1:] + velocities[:-1])
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(mean, axis=0) * times[1]])[:, :2]
    own = (m.centre - m.centre[0])[:, :2]
    farthest = int(np.linalg.norm(path, axis=1).argmax())
    length, walked = (float(np.linalg.norm(np.diff(of, axis=0), axis=1).sum()) for of in (path, own))
    far, got = (float(np.linalg.norm(of[farthest])) for of in (path, own))
    by = slack(recording, float(np.linalg.norm(m.angular_velocity[0])))
    return [
        within(TURNED, "way of the centre of mass", length, walked, "m", by),
        within(TURNED, "greatest distance from the start", far, got, "m", by),
    ]


@applies(_egg, needs.level, needs.friction, needs.moves, needs.gravity)
def egg(recording: Recording) -> list[Check]:
    """Compare the time in which a spinning egg rises, and the height of its centre of mass, with theory.

    Theory is of an egg that slides all the time, spins fast, and does not leave the floor.
    """
    scene = recording.plan.scene
    m = recording.measures
    feature = _feature(recording.plan)
    body = scene.body
    squares, axes = np.linalg.eigh(feature.matrix)
    across = math.sqrt(squares[0])
    along = math.sqrt(squares[2])
    turn = _orientation(body, scene.positions)
    up = np.array([0.0, 0.0, 1.0])
    pull = feature.matrix @ (turn.T @ up)
    arm = turn @ pull / math.sqrt(float(up @ turn @ pull))
    constant = abs(float(m.angular_momentum[0] @ arm))
    triad = np.stack([m.side, np.cross(m.axis, m.side), m.axis], axis=2)
    cosine = np.clip(np.abs(triad[:, 2] @ (triad[0].T @ turn @ axes[:, 2])), 0.0, 1.0)
    tilt = np.arccos(cosine)
    high = np.sqrt(across**2 + (along**2 - across**2) * cosine**2)
    weight = body.mass * gravity(recording)
    passed = [crossings(recording.times, tilt - of, rising=False) for of in RISE]
    rises = float(passed[1][0] - passed[0][0]) if all(map(len, passed)) else math.nan
    expected = theory.egg_rise(*RISE, (along, across), constant, weight, scene.contact.friction)
    strength, reach = scales(scene.contact, body)
    gap = sliding.rest_height(weight, strength, reach)
    leaves = float((m.centre[:, 2] - high).max())
    end = float(m.centre[-1, 2]) - gap
    by = slack(recording, 0.0)
    names = [f"{math.degrees(of):.0f}°" for of in RISE]
    return [
        within(RISEN, f"time from a tilt of {names[0]} to {names[1]}", expected, rises, "s", by),
        within(TURNED, "height of the centre of mass at the end", along, end, "m", by),
        Check("largest gap below it", 0.0, leaves, reach, "m"),
    ]
