"""Bodies that turn freely, and what every motion keeps."""

from __future__ import annotations

import math

import numpy as np

from springgym.scenes.checks.basis import Check, crossings, slack, spread, turning_rate
from springgym.scenes.recording import Recording, rigid_twin
from springgym.stability import highest_frequency
from springgym.theory import free_body, oscillation


def flips(recording: Recording) -> list[Check]:
    """Interval between the flips of a body set spinning about its middle axis."""
    scene, m = recording.plan.scene, recording.measures
    moments, principal = scene.body.with_(positions=scene.positions, lengths=scene.body.lengths).principal()
    omega = principal.T @ m.angular_velocity[0]
    side, axis = m.side, m.axis
    triad = np.stack([side, np.cross(axis, side), axis], axis=2)
    middle = triad @ (triad[0].T @ principal[:, 1])
    along = np.einsum("ti,ti->t", middle, m.angular_velocity)
    marks = crossings(recording.times, along)
    measured = float(np.diff(marks).mean()) if len(marks) > 1 else math.nan

    def interval(i1: float, i2: float, i3: float) -> float:
        return free_body.flip_interval((i1, i2, i3), omega)

    by = slack(recording, float(np.linalg.norm(omega)))
    tolerance = spread(interval, *moments.tolist(), by=by)
    return [Check("flip interval", interval(*moments.tolist()), measured, tolerance, "s")]


def spun_length(recording: Recording) -> list[Check]:
    """Length of a pair of masses on a spring, when its vibration has died away."""
    body, m = recording.plan.scene.body, recording.measures
    k, c, mass = float(body.stiffness[0]), float(body.damping[0]), float(body.masses[0])
    apart = recording.positions[-1, 1] - recording.positions[-1, 0]
    length, rate = float(np.linalg.norm(apart)), recording.velocities[-1, 1] - recording.velocities[-1, 0]
    omega = float(np.linalg.norm(np.cross(apart, rate))) / length**2
    expected = oscillation.spun_pair_length(mass, k, float(body.lengths[0]), omega)
    spin = float(np.linalg.norm(m.angular_momentum[0])) / (mass * length**2 / 2)
    left = math.exp(-c / mass * recording.times[-1])  # reduced mass m/2: γ = c/m
    by = left + (omega * recording.step) ** recording.integrator.order
    return [
        Check("length", expected, length, by * expected, "m"),
        Check("spin", spin, omega, by * spin, "rad/s"),
    ]


def momentum(recording: Recording) -> list[Check]:
    """What is kept exactly: momentum and angular momentum of a free body, L_z of a pinned one."""
    m, scene = recording.measures, recording.plan.scene
    steps = recording.times[-1] / recording.step
    size = np.linalg.norm(m.angular_momentum, axis=1).max()
    mass = float(scene.masses.sum())
    if len(scene.bodies) > 1:  # each comes with an angular momentum, which may be opposite to another's
        arm = recording.positions - m.centre[:, None]
        size = (scene.masses * np.linalg.norm(np.cross(arm, recording.velocities), axis=2)).sum(axis=1).max()
    if scene.pinned:
        change = float(np.abs(np.diff(m.angular_momentum[[0, -1], 2]))[0])
        return [Check("change of L_z", 0.0, change, 1e-15 * steps * size, "kg·m²/s")]
    change = float(np.linalg.norm(m.angular_momentum - m.angular_momentum[0], axis=1).max())
    checks = [Check("change of L", 0.0, change, 1e-15 * steps * size, "kg·m²/s")]
    pull = np.zeros(3) if scene.gravity is None else np.array(scene.gravity)
    fallen = m.momentum[0] + mass * np.outer(recording.times, pull)
    size = mass * np.linalg.norm(recording.velocities, axis=2).max()
    change = float(np.linalg.norm(m.momentum - fallen, axis=1).max())
    return [*checks, Check("change of P", 0.0, change, 1e-15 * steps * size, "kg·m/s")]


def energy(recording: Recording) -> list[Check]:
    """Kinetic and potential energy plus what was lost: constant.

    Verlet keeps H + h² (vᵀ K v/12 − |M⁻¹ ∇V|²_M/24) (Hairer, Lubich & Wanner, Geometric Numerical
    Integration, 2nd ed., IX.3) to higher order; so H varies as much as that term does. Losses are found
    from speeds between two kicks, which shake what vibrates at ω by a share of (ω h)²/8.
    """
    scene, x, v = recording.plan.scene, recording.positions, recording.velocities
    stiffness, rest = scene.of_bodies("stiffness"), scene.of_bodies("lengths")
    first, second = scene.springs.T
    apart, rate = x[:, second] - x[:, first], v[:, second] - v[:, first]
    length = np.linalg.norm(apart, axis=2)
    along = np.einsum("tsi,tsi->ts", apart, rate) / length
    tension = stiffness * (length - rest)
    bent = stiffness * along**2 + tension / length * ((rate**2).sum(axis=2) - along**2)
    force = np.zeros_like(x)
    pull = (tension / length)[..., None] * apart
    for s, (i, j) in enumerate(scene.springs):
        force[:, i] += pull[:, s]
        force[:, j] -= pull[:, s]
    if scene.gravity is not None:
        force += scene.masses[:, None] * np.array(scene.gravity)
    force[:, list(scene.pins)] = 0.0
    term = bent.sum(axis=1) / 12 - ((force**2).sum(axis=2) / scene.masses).sum(axis=1) / 24
    drift = float(np.abs(recording.measures.balance - recording.measures.balance[0]).max())
    scale = float(np.abs(recording.measures.kinetic).max())
    rounded = 1e-15 * scale * recording.times[-1] / recording.step
    if scene.surfaces or scene.meetings:
        rounded += 1e-8 * scale  # contact solves its equation to 1e-10, in each step of an impact
    tolerance = 2 * recording.step**2 * float(np.abs(term - term[0]).max()) + rounded
    shaken = (highest_frequency(scene) * recording.step) ** 2 / 8
    m = recording.measures
    lost = m.damping_loss + m.contact_loss + m.friction_loss
    tolerance += shaken * min(float(m.damping_loss.max()), float(np.abs(lost).max()))
    return [Check("change of energy", 0.0, drift, tolerance, "J")]


def twin(recording: Recording) -> list[Check]:
    """How far the traced particle strays from that of the rigid twin, at the most.

    A share of the rate at which it moves adds up to that share of its path.
    """
    plan = recording.plan
    assert plan.trace is not None
    rigid = rigid_twin(recording)
    if rigid is None:
        raise ValueError(f"scene {plan.name!r} has no rigid twin to compare with")
    path = recording.positions[:, plan.trace]
    count = min(len(path), len(rigid.times))
    apart = float(np.linalg.norm(path[:count] - rigid.positions[:count, plan.trace], axis=1).max())
    length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    by = slack(recording, turning_rate(recording))
    return [Check("distance from the rigid twin", 0.0, apart, by * length, "m")]
