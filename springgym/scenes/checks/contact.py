"""Floors, slopes and bowls against theory."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from springgym.scenes.checks.basis import Check, peaks, period, slack
from springgym.scenes.recording import Recording
from springgym.surfaces import Bowl, Contact, PaperContact, Plane, scales
from springgym.theory import contact as theory
from springgym.theory import pendulum


def _met(recording: Recording) -> tuple[Contact | PaperContact, float, float, float]:
    """The contact of a scene, its c [N·m²] and Δ [m], and g [m/s²]."""
    scene = recording.plan.scene
    return scene.contact, *scales(scene.contact, scene.body), float(np.linalg.norm(scene.gravity or 0.0))


def _carried(recording: Recording) -> np.ndarray:
    """Which particles the first surface carries at the end, (N,)."""
    _, _, reach, _ = _met(recording)
    return recording.plan.scene.surfaces[0].height(recording.positions[-1]) < reach


def bounces(recording: Recording) -> list[Check]:
    """The lowest point of a particle dropped on an elastic floor, and how high it comes back."""
    _, c, reach, g = _met(recording)
    mass, times, height = recording.plan.scene.body.mass, recording.times, recording.positions[:, 0, 2]
    start = float(height[0])
    lowest = theory.turning_point(mass * g * start, c, reach, mass * g)
    # it turns between two states at the most half an interval away, with a = F/m
    pull = float(theory.force(lowest, c, reach)) / mass
    seen = pull * float(times[1] - times[0]) ** 2 / 8
    _, tops = peaks(times, height)
    apex = float(tops[-1]) if len(tops) else math.nan
    count = recording.times[-1] / recording.step
    return [
        Check("lowest point", lowest, float(height.min()), seen, "m"),
        Check(f"apex {len(tops)}", start, apex, 1e-12 * count * start, "m"),
    ]


def restitution(recording: Recording) -> list[Check]:
    """Restitution of the first bounces, by the heights between them, at the speeds they have.

    Theory knows no weight. In contact, for a time T, it adds g T to the change of speed v (1 + e), and its
    share to what is lost; T is the way there and back, 2 Δ, at a quarter of that change on the average.
    """
    contact, _, reach, g = _met(recording)
    assert isinstance(contact, Contact)
    height = recording.positions[:, 0, 2]
    damping = theory.damping_for_restitution(contact.restitution, contact.impact_speed)
    _, tops = peaks(recording.times, height)
    tops = tops[tops > reach]
    heights = [float(height[0]), *(tops[:5].tolist() or [math.nan])]
    speeds = [math.sqrt(2 * g * (top - reach)) for top in heights]
    checks = []
    for speed, rebound in pairwise(speeds):
        expected = theory.restitution_at(speed, damping)
        by = (1 - expected) * 8 * g * reach / (speed * (1 + expected)) ** 2
        checks.append(Check(f"restitution at {speed:.2f} m/s", expected, rebound / speed, by, ""))
    return checks


def rest_height(recording: Recording) -> list[Check]:
    """What the particles carry that a body at rest stands on: together its weight."""
    _, c, reach, g = _met(recording)
    surface, below = recording.plan.scene.surfaces[0], _carried(recording)
    weight = recording.plan.scene.body.mass * g
    late = recording.times >= min(0.9 * recording.times[-1], recording.times[-2])
    heights = surface.height(recording.positions[late][:, below])
    force = theory.force(heights, c, reach).sum(axis=1)
    # what does not balance the weight moves the body: m Δv in that time
    upwards = recording.measures.momentum[late, 2]
    moved = float(np.ptp(upwards)) / float(np.ptp(recording.times[late]))
    speed = float(np.linalg.norm(recording.velocities[late], axis=2).max())
    left = 2 * g * recording.step
    carried = float(force.mean()) if speed <= left else math.nan  # else it does not rest yet
    return [
        Check("force of the floor", weight, carried, moved + weight * 1e-3, "N"),
        Check("largest speed at rest", 0.0, speed, left, "m/s"),
    ]


def stopping(recording: Recording) -> list[Check]:
    """Way and time in which a sliding block stops."""
    contact, _, _, g = _met(recording)
    m, mass = recording.measures, recording.plan.scene.body.mass
    speed = float(np.linalg.norm(m.momentum[0])) / mass
    way = float(np.linalg.norm(m.centre[-1] - m.centre[0]))
    expected = theory.stopping_distance(speed, contact.friction, g)
    moving = np.linalg.norm(m.momentum, axis=1) / mass
    half = recording.times[int(np.argmax(moving < speed / 2))]
    by = slack(recording, contact.friction * g / speed)
    interval = float(recording.times[1])
    return [
        Check("stopping distance", expected, way, by * expected, "m"),
        Check("time to half the speed", speed / (2 * contact.friction * g), float(half), interval, "s"),
    ]


def slope(recording: Recording) -> list[Check]:
    """Whether a block on a slope stays, or how it slides."""
    contact, _, _, g = _met(recording)
    surface = recording.plan.scene.surfaces[0]
    assert isinstance(surface, Plane)
    angle = math.acos(surface.normal[2])
    down = np.array([surface.normal[0], surface.normal[1], 0.0])
    down = np.cross(np.cross(surface.normal, down / np.linalg.norm(down)), surface.normal)
    way = (recording.measures.centre - recording.measures.centre[0]) @ (down / np.linalg.norm(down))
    late = recording.times > 0.5 * recording.times[-1]
    if theory.holds(angle, contact.friction):
        creep = float(np.abs(way[late] - way[late][0]).max())
        return [Check("way in the second half", 0.0, creep, 1e-6, "m")]
    expected = theory.slope_acceleration(angle, contact.friction, g)
    enough = late.sum() > 3
    measured = 2 * float(np.polyfit(recording.times[late], way[late], 2)[0]) if enough else math.nan
    by = slack(recording, math.sqrt(g / recording.plan.scene.body.lengths.min()))
    return [Check("acceleration", expected, measured, by * g, "m/s²")]


def straight_fall(recording: Recording) -> list[Check]:
    """On ice nothing pushes sideways: the centre of mass stays above its place."""
    centre = recording.measures.centre
    moved = float(np.abs(centre[:, :2] - centre[0, :2]).max())
    steps = recording.times[-1] / recording.step
    size = float(np.abs(recording.velocities).max()) * recording.times[-1]
    return [Check("sideways move of the centre", 0.0, moved, 1e-16 * steps * size, "m")]


def bowl_period(recording: Recording) -> list[Check]:
    """Period of a particle sliding to and fro in a bowl: a pendulum whose rod reaches from its centre."""
    _, c, reach, g = _met(recording)
    bowl = recording.plan.scene.surfaces[0]
    assert isinstance(bowl, Bowl)
    weight = recording.plan.scene.body.mass * g
    arm = recording.positions[:, 0] - np.array(bowl.centre)
    angle = np.arctan2(arm[:, 0], -arm[:, 2])
    amplitude = float(np.abs(angle).max())
    length = bowl.radius - theory.rest_height(weight, c, reach)
    expected = pendulum.period(length, g, amplitude)
    # swinging changes the load by less than 3 (1 − cos θ₀), and the height by less than its reach for that
    by = 3 * (1 - math.cos(amplitude)) * reach / length + (math.sqrt(g / length) * recording.step) ** 2
    return [Check("period in the bowl", expected, period(recording.times, -angle), by * expected, "s")]
