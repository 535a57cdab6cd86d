"""Checks of bodies that turn freely, and of conserved quantities."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from springgym.checks import TINY
from springgym.dynamics.stepping import default_step
from springgym.model.bodies.body import inertia
from springgym.model.bodies.precession import heavy_top
from springgym.scenes.checks import needs
from springgym.scenes.checks.basis import Check, applies, crossings, slack, spread, turning_rate, within
from springgym.scenes.plan import Plan
from springgym.scenes.recording import Recording, rigid_twin
from springgym.theory import free_body, oscillation

STIFF = 1e-3
"""Relative tolerance for bodies whose stretch is in the theory, or that hardly stretch."""

TWINNED = 0.05
"""Tolerance relative to the body's size. A strain of 1e-3 makes 2e-3 of the path, which in the 5 s of a
nutating top is some 15 sizes."""

ROUNDED = 1e-8
"""Relative tolerance of exactly conserved quantities: round-off of 1e-15 per step in 1e7 steps."""

BALANCED = 2e-3
"""Tolerance relative to the energy at stake: that of vibrations with all of this energy, at ω h = 0.12."""


@applies(needs.free, needs.flips)
def flips(recording: Recording) -> list[Check]:
    """Check the interval between the flips of a body set spinning about its middle axis."""
    scene = recording.plan.scene
    m = recording.measures
    moments, principal = scene.body.with_(positions=scene.positions, lengths=scene.body.lengths).principal()
    omega = principal.T @ m.angular_velocity[0]
    side = m.side
    axis = m.axis
    triad = np.stack([side, np.cross(axis, side), axis], axis=2)
    middle = triad @ (triad[0].T @ principal[:, 1])
    along = np.einsum("ti,ti->t", middle, m.angular_velocity)
    marks = crossings(recording.times, along)
    measured = float(np.diff(marks).mean()) if len(marks) > 1 else math.nan

    def interval(i1: float, i2: float, i3: float) -> float:
        return free_body.flip_interval((i1, i2, i3), omega)

    expected = interval(*moments.tolist())
    by = slack(recording, float(np.linalg.norm(omega)))
    doubt = spread(interval, *moments.tolist(), by=by) if by < 1 else math.inf
    # friction reduces the energy, which shortens the interval
    doubt += expected * float(m.damping_loss.max(initial=0.0)) / float(m.kinetic[0])
    return [Check("flip interval", expected, measured, STIFF * expected, "s", doubt)]


@applies(needs.pair, needs.free)
def spun_length(recording: Recording) -> list[Check]:
    """Check the length and spin of a pair of masses on a spring, when its vibration has died away.

    Both follow from the initial angular momentum, L = m Ω l²/2 with l = L₀/(1 − m Ω²/2k). The vibration
    decays as exp(−c t/m) (the reduced mass is m/2), and not at all without a damper.
    """
    body = recording.plan.scene.body
    k = float(body.stiffness[0])
    c = float(body.damping[0])
    mass = float(body.masses[0])
    apart = recording.positions[-1, 1] - recording.positions[-1, 0]
    length = float(np.linalg.norm(apart))
    rate = recording.velocities[-1, 1] - recording.velocities[-1, 0]
    omega = float(np.linalg.norm(np.cross(apart, rate))) / length**2
    momentum = float(np.linalg.norm(recording.measures.angular_momentum[0]))
    expected, spin = oscillation.spun_pair(mass, k, float(body.lengths[0]), momentum)
    doubt = math.exp(-c / mass * recording.times[-1]) + (spin * recording.step) ** recording.integrator.order
    return [
        within(STIFF, "length", expected, length, "m", doubt),
        within(STIFF, "spin", spin, omega, "rad/s", doubt),
    ]


@applies()
def momentum(recording: Recording) -> list[Check]:
    """Check conservation of momentum and angular momentum of a free body, and of L_z of a pinned one.

    The tolerance is `ROUNDED` times Σ m |r| |v|, or Σ m |v|, with the initial speeds plus those that gravity
    may add: g t for a free body, 2 √(g r) for one that swings over its pin.
    """
    m = recording.measures
    scene = recording.plan.scene
    duration = float(recording.times[-1])
    pull = np.zeros(3) if scene.gravity is None else np.array(scene.gravity)
    about = scene.positions[scene.pinned[0]] if scene.pinned else m.centre[0]
    arms = np.linalg.norm(scene.positions - about, axis=1)
    g = float(np.linalg.norm(pull))
    added = 2 * math.sqrt(g * float(arms.max())) if scene.pinned else g * duration
    speeds = np.linalg.norm(scene.velocities, axis=1) + added
    doubt = 1e-15 * duration / recording.step / ROUNDED  # rounding of each step

    def kept(quantity: str, change: float, size: float, unit: str) -> Check:
        return Check(quantity, 0.0, change, ROUNDED * size, unit, doubt * ROUNDED * size)

    spun = float(scene.masses @ (arms * speeds))
    if scene.pinned:
        change = float(np.abs(m.angular_momentum[:, 2] - m.angular_momentum[0, 2]).max())
        return [kept("change of L_z", change, spun, "kg·m²/s")]
    change = float(np.linalg.norm(m.angular_momentum - m.angular_momentum[0], axis=1).max())
    fallen = m.momentum[0] + float(scene.masses.sum()) * np.outer(recording.times, pull)
    moved = float(np.linalg.norm(m.momentum - fallen, axis=1).max())
    return [
        kept("change of L", change, spun, "kg·m²/s"),
        kept("change of P", moved, float(scene.masses @ speeds), "kg·m/s"),
    ]


@applies()
def energy(recording: Recording) -> list[Check]:
    """Check that kinetic and potential energy plus losses are constant.

    The tolerance is `BALANCED` times the energy at stake. H varies with vibrations by (ω h)²/4 of their
    energy, see `Simulator.shadow_energy`. The tolerance is far smaller for a stiff body that only turns about
    a pin, see `of_turning`.
    """
    m = recording.measures
    plan = recording.plan
    drift = float(np.abs(m.balance - m.balance[0]).max())
    step = default_step(plan.scene, recording.integrator)  # a run with larger steps has no larger tolerance
    tolerance = min(BALANCED * at_stake(plan), of_turning(plan, step))
    return [Check("change of energy", 0.0, drift, tolerance, "J")]


def of_turning(plan: Plan, step: float) -> float:
    """Return a bound on the variation of H [J] for a stiff body that rotates about a pin; otherwise ∞.

    The terms of order h² of the shadow energy are at most (h²/8) Σ m |a|² there, which varies by (Ω h)² of
    the energy that changes its form, plus `BALANCED` of the energy that is not rotation at the start. Ω is
    the fastest possible rotation: Ω² is at most ω² + 4 g/l, with ω at the start, and l from the pin to the
    centre of mass. The energy of a symmetric top's spin keeps its form.
    """
    scene = plan.scene
    body = plan.scene.bodies[0].body
    if len(scene.bodies) > 1 or scene.can_touch or body.floppy or not plan.stretched or not scene.pinned:
        return math.inf
    masses = body.masses
    pull = scene.gravity or (0.0, 0.0, 0.0)
    x = scene.positions - scene.positions[scene.pivot]
    v = scene.velocities
    omega = np.linalg.pinv(inertia(x, masses)) @ (masses @ np.cross(x, v))
    energy = float(masses @ (v**2).sum(axis=1)) / 2
    rings = float(masses @ ((v - np.cross(omega, x)) ** 2).sum(axis=1)) / 2
    arm = max(float(np.linalg.norm(masses @ x / body.mass)), TINY)
    turning = float(omega @ omega) + 4 * float(np.linalg.norm(pull)) / arm
    at_play = at_stake(plan)
    with suppress(ValueError):
        heavy_top(body, scene.pinned, pull)
        at_play -= energy
    return turning * step**2 * at_play + BALANCED * rings


def at_stake(plan: Plan) -> float:
    """Return the energy [J] that may change its form in a scene, from its start.

    It is the kinetic energy plus the work of weight: down to below the pin, to the first surface, to the
    lowest pinned body, or as far as it falls in the run. For a body that starts unstretched, the energy that
    its weight stores in its springs is added, at most (M g)²/2k each.
    """
    scene = plan.scene
    g = float(np.linalg.norm(scene.gravity or 0.0))
    up = np.array([0.0, 0.0, 1.0]) if g == 0 else -np.array(scene.gravity) / g
    held = [float(p.positions.mean(axis=0) @ up) for p in scene.bodies if len(p.pinned) == len(p.body.masses)]
    whole = float(scene.masses @ (scene.velocities**2).sum(axis=1)) / 2
    for placed in scene.bodies:
        body = placed.body
        pinned = placed.pinned
        if len(pinned) == len(body.masses):
            continue
        centre = body.masses @ placed.positions / body.mass
        fall = g * plan.duration**2 / 2
        if pinned:
            arm = float(np.linalg.norm(body.centre - body.positions[pinned[0]]))
            fall = float((centre - placed.positions[pinned[0]]) @ up) + arm
        elif scene.surfaces:
            fall = float(scene.surfaces[0].height(centre[None])[0])
        elif held:
            fall = float(centre @ up) - min(held)
        whole += body.mass * g * max(fall, 0.0)
        if not plan.stretched:
            whole += (body.mass * g) ** 2 / 2 * float((1 / body.stiffness).sum())
    return whole


@applies(needs.trace, needs.rigid_body)
def twin(recording: Recording) -> list[Check]:
    """Compare the path of the traced particle with that of the rigid twin: the largest distance.

    The tolerance is relative to the body's size; the doubt, to the length of the path.
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
    size = float(plan.scene.body.size)
    return [Check("distance from the rigid twin", 0.0, apart, TWINNED * size, "m", by * length)]
