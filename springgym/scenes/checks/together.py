"""Checks of all bodies that collide, together, against theory."""

from __future__ import annotations

import math

import numpy as np

from springgym.dynamics.contact.law import SLOW
from springgym.model.collisions import Meeting
from springgym.model.resolution import QUICK
from springgym.model.surfaces import Bowl
from springgym.scenes.checks import needs
from springgym.scenes.checks.basis import Check, applies, gravity, within
from springgym.scenes.checks.contact import WITHIN, at_rest, down_slope
from springgym.scenes.recording import Recording
from springgym.theory import contact as theory
from springgym.theory import dominoes
from springgym.theory.rope import tensions

MET = 0.01
"""Tolerance relative to the speed of approach. Balls are effectively larger by up to Δ, 1 % of their
distance; in oblique impacts this turns the normal, which changes up to 0.8 % of the speed."""

EQUAL = 1e-6
"""The same for equal balls in line, which exchange velocities: contact solves its equation to 1e-10."""

DRAPED = 0.02
"""Relative tolerance of the tension of a hanging rope: its ends swing by 0.1, whose square is half of it."""

SLID = 1e-3
"""Largest motion of a rope that stays draped, in half of the run [m]."""

WAVE = 0.03
"""Relative tolerance of the speed of a wave of dominoes: Δ is 2 % of their free space, and restitution keeps
0.5 % of the energy lost in theory's impacts."""

TURNED = 2e-5
"""Tolerance relative to Σ m |r| |v| about a bowl's vertical axis: (ω h)² of tops at 40 rad/s and 1e-4 s."""

TOPPLED = 0.01
"""Tilt of a domino from which on it counts as hit [rad]."""

SETTLED = 8
"""Number of dominoes after which the speed of the wave is measured: before, it depends on the push."""


def _met(recording: Recording) -> Meeting:
    return recording.plan.scene.meetings[0]


def _late(recording: Recording) -> np.ndarray:
    """Return a mask of the last tenth of the states, at least two."""
    return np.arange(min(int(0.9 * len(recording.times)), len(recording.times) - 2), len(recording.times))


@applies(needs.collide, together=True)
def counted(recording: Recording) -> list[Check]:
    """Check that no contacts were detected too late, moved by more than `QUICK` Δ a step or were left out."""
    pairs = recording.pairs
    fast = pairs.fastest[-1] * recording.step > QUICK * recording.plan.scene.meetings.reach
    wrong = sum(float(of.sum()) for of in (pairs.late_contacts[-1], fast, pairs.overflow[-1]))
    return [Check("contacts too late, too fast or left out", 0.0, wrong, 0.5, "")]


@applies(needs.two, together=True)
def exchange(recording: Recording) -> list[Check]:
    """Check the speeds of two balls after an impact of (1 + e) m v·n along the line of their centres.

    m is the reduced mass. The balls act like hard ones at a distance between that of their surfaces and Δ
    more, and reverse in steps with the relative error (v h/Δ)².
    """
    scene = recording.plan.scene
    met = _met(recording)
    masses = [scene.bodies[n].body.mass for n in (met.first, met.second)]
    start = [recording.bodies[n] for n in (met.first, met.second)]
    radius = sum(scene.bodies[n].body.radius for n in (met.first, met.second))
    x, v = (getattr(start[0], name)[0] - getattr(start[1], name)[0] for name in ("centre", "centre_velocity"))
    speed = float(np.linalg.norm(v))
    restitution = theory.rebound(speed, met.contact.restitution, SLOW)
    way = v / speed
    aside = x - (x @ way) * way
    ends = []
    for distance in (radius, radius + met.reach):
        normal = aside - math.sqrt(distance**2 - float(aside @ aside)) * way
        normal = normal / distance
        given = -(1 + restitution) / (1 / masses[0] + 1 / masses[1]) * float(v @ normal)
        ends.append(
            [
                start[0].centre_velocity[0] + given / masses[0] * normal,
                start[1].centre_velocity[0] - given / masses[1] * normal,
            ]
        )
    off = speed * (speed * recording.step / met.reach) ** 2 * float(np.linalg.norm(aside)) / radius
    rounded = 1e-13 * speed * recording.times[-1] / recording.step
    checks = []
    for n, body in enumerate((met.first, met.second)):
        low, high = (float(np.linalg.norm(end[n])) for end in ends)
        measured = float(np.linalg.norm(recording.bodies[body].centre_velocity[-1]))
        doubt = abs(high - low) / 2 + off + rounded
        name = f"{scene.bodies[body].name}: speed afterwards"
        checks.append(Check(name, (low + high) / 2, measured, MET * speed, "m/s", doubt))
    return checks


@applies(needs.row, together=True)
def cradle(recording: Recording) -> list[Check]:
    """Check that equal balls in a row exchange their velocities whenever two collide."""
    scene = recording.plan.scene
    along = int(np.argmax(np.ptp([m.centre[0] for m in recording.bodies], axis=0)))
    order = np.argsort([m.centre[0, along] for m in recording.bodies])
    before = sorted(float(m.centre_velocity[0, along]) for m in recording.bodies)
    most = max(map(abs, before))
    doubt = 1e-13 * most * recording.times[-1] / recording.step
    return [
        Check(
            f"{scene.bodies[n].name}: speed afterwards",
            speed,
            float(recording.bodies[n].centre_velocity[-1, along]),
            EQUAL * most,
            "m/s",
            doubt,
        )
        for n, speed in zip(order.tolist(), before, strict=True)
    ]


@applies(needs.slab, needs.coulomb, together=True)
def slab(recording: Recording) -> list[Check]:
    """Compare a body on a fixed slab with theory: it rests, or slides as on a slope."""
    scene = recording.plan.scene
    met = _met(recording)
    held, free = sorted((met.first, met.second), key=lambda n: not scene.bodies[n].pinned)
    up = recording.bodies[held].axis[0]
    angle = math.acos(float(up[2]))
    down = np.cross(np.cross(up, (0.0, 0.0, -1.0)), up)
    down = down / np.linalg.norm(down)
    centre = recording.bodies[free].centre
    way = (centre - centre[0]) @ down
    return [down_slope(recording, way, angle, met.contact.friction, scene.bodies[free].body.swept)]


@applies(needs.collide, needs.gravity, together=True)
def stacked(recording: Recording) -> list[Check]:
    """Compare the force of each contact in a stack at rest with the weight above it."""
    scene = recording.plan.scene
    late = _late(recording)
    high = [float(m.centre[-1, 2]) for m in recording.bodies]
    time = float(np.ptp(recording.times[late]))
    impulse = recording.pairs.impulse[late]
    # force that does not balance the weight moves the bodies: m Δv in that time
    moved = max(float(np.ptp(m.momentum[late, 2])) for m in recording.bodies) / time
    checks = []
    for n, met in enumerate(scene.meetings):
        if recording.pairs.touching[-1, n]:
            upper = max(high[met.first], high[met.second])
            weight = gravity(recording) * sum(
                placed.body.mass for placed, z in zip(scene.bodies, high, strict=True) if z >= upper
            )
            name = " on ".join(
                scene.bodies[body].name for body in sorted(met[:2], key=lambda body: -high[body])
            )
            measured = float(impulse[-1, n] - impulse[0, n]) / time
            checks.append(within(WITHIN, f"force of {name}", weight, measured, "N", moved / weight))
    return [*checks, at_rest(recording, late)]


@applies(needs.collide, needs.surface, needs.gravity, together=True, contacts=True)
def pile(recording: Recording) -> list[Check]:
    """Compare the forces of all contacts in a pile at rest with the weights: of all bodies, and of each.

    Walls carry a part of the weight by friction.
    """
    scene = recording.plan.scene
    late = _late(recording)
    masses = np.array([placed.body.mass for placed in scene.bodies])
    weights = masses * gravity(recording)
    carried = np.zeros((len(late), len(masses)))
    outside = np.zeros(len(late))
    told = recording.contacts if len(recording.contacts) == len(recording.times) else ()
    for n, found in enumerate(told[state] for state in late if told):
        there = found.there[0]
        upwards = found.force[0, :, 2]
        bodies = found.second[0] >= 0
        np.add.at(carried[n], found.first[0][there], upwards[there])
        np.add.at(carried[n], found.second[0][there & bodies], -upwards[there & bodies])
        outside[n] = upwards[there & ~bodies].sum()
    off = float(np.abs(carried.mean(axis=0) - weights).max()) if told else math.nan
    whole = float(outside.mean()) if told else math.nan
    time = float(np.ptp(recording.times[late]))
    moved = sum(np.ptp(m.momentum[late, 2]) for m in recording.bodies) / time  # unbalanced force
    return [
        within(WITHIN, "force of floor and walls", weights.sum(), whole, "N", moved / weights.sum()),
        Check("largest force that is not balanced", 0.0, off, WITHIN * weights.max(), "N", moved),
        at_rest(recording, late),
    ]


@applies(needs.draped, together=True)
def draped(recording: Recording) -> list[Check]:
    """Compare the tension of a rope where it leaves its support with the weight that hangs below.

    Its ends swing a little, which is the error of theory; the middle is at rest.
    """
    scene = recording.plan.scene
    met = _met(recording)
    over, cord = sorted((met.first, met.second), key=lambda n: not scene.bodies[n].pinned)
    body = scene.bodies[cord].body
    own = scene.slices[cord]
    late = _late(recording)
    x = recording.positions[late][:, own]
    low = float(recording.positions[-1, scene.slices[over], 2].max())
    lengths = np.linalg.norm(np.diff(x, axis=1), axis=2).mean(axis=0)
    pull = body.stiffness * (lengths - body.lengths)
    hangs = x[..., 2].max(axis=0) < low
    checks = []
    for name, order in (("first", slice(None)), ("last", slice(None, None, -1))):
        count = int(np.argmin(hangs[order]))  # particles that hang at this end
        masses = body.masses[order][:count]
        expected = float(tensions(masses[::-1], gravity(recording))[0]) if count else math.nan
        measured = float(pull[order][count - 1]) if count else math.nan
        checks.append(within(DRAPED, f"tension at its {name} end", expected, measured, "N"))
    middle = recording.positions[
        recording.times > 0.5 * recording.times[-1], own.start + len(body.masses) // 2
    ]
    moved = float(np.ptp(middle, axis=0).max(initial=0.0))
    return [*checks, Check("way of its middle in the second half", 0.0, moved, SLID, "m")]


@applies(needs.dominoes, needs.coulomb, together=True)
def wave(recording: Recording) -> list[Check]:
    """Check the speed of the wave in a row of dominoes, see `springgym.theory.dominoes`.

    Contact acts below Δ, as if dominoes were thicker, and spaces narrower; half of Δ is used. Restitution e
    keeps e² of the energy lost in theory's impacts; states have the interval's resolution.
    """
    scene = recording.plan.scene
    tilts = [np.arccos(np.clip(np.einsum("ti,i->t", m.axis, m.axis[0]), -1, 1)) for m in recording.bodies]
    first = min(range(len(tilts)), key=lambda n: float(recording.bodies[n].centre[0, 0]))
    body = scene.bodies[first].body
    thickness, _, height = np.ptp(body.positions, axis=0)
    pitch = float(np.diff(sorted(m.centre[0, 0] for m in recording.bodies)).mean())
    order = np.argsort([m.centre[0, 0] for m in recording.bodies])[1:]
    edge = np.array([thickness / 2, 0.0, -height / 2])
    inertia = float(body.inertia(body.centre + edge)[1, 1]) / body.mass
    start = float(recording.bodies[first].angular_velocity[0, 1])
    reach = _met(recording).reach
    friction = _met(recording).contact.friction
    g = gravity(recording)
    speeds = []
    for more in (0.0, reach, 0.5 * reach):
        hits = dominoes.impacts(
            len(order), height, thickness + more, pitch - thickness - more, inertia, start, g, friction
        )
        speeds.append(pitch * (len(order) - 1 - SETTLED) / float(hits[-1] - hits[SETTLED]))
    when = []
    for n in order:
        leans = tilts[n] > TOPPLED
        when.append(float(recording.times[int(np.argmax(leans))]) if leans.any() else math.nan)
    time = when[-1] - when[SETTLED]
    measured = pitch * (len(order) - 1 - SETTLED) / time
    share = _met(recording).contact.restitution ** 2 / 2 + float(recording.times[1]) / time
    doubt = abs(speeds[1] - speeds[0]) / 2 / speeds[2] + share
    return [within(WAVE, "speed of the wave", speeds[2], measured, "m/s", doubt)]


@applies(needs.smooth_bowl, together=True)
def bowl_turning(recording: Recording) -> list[Check]:
    """Check that a smooth bowl exerts no torque on bodies about the vertical line through its centre.

    The curvature of paths in the bowl makes a relative error (ω h)² per step.
    """
    scene = recording.plan.scene
    bowl = next(surface for surface in scene.surfaces if isinstance(surface, Bowl))
    arm = recording.positions - np.array(bowl.centre)
    each = scene.masses[:, None] * np.cross(arm, recording.velocities)
    about = each[..., 2].sum(axis=1)
    spun = np.linalg.norm(arm[0], axis=1) * np.linalg.norm(recording.velocities[0], axis=1)
    size = float(scene.masses @ spun)
    rate = max(float(np.linalg.norm(m.angular_velocity[0])) for m in recording.bodies)
    doubt = (rate * recording.step) ** 2 * size
    return [Check("change of L_z", 0.0, float(np.ptp(about)), TURNED * size, "kg·m²/s", doubt)]
