"""Checks of pendulums and ropes against theory."""

from __future__ import annotations

import math

import numpy as np

from springgym.scenes.checks import needs
from springgym.scenes.checks.basis import Check, applies, gravity, period, slack, within
from springgym.scenes.recording import Recording
from springgym.theory import pendulum as theory
from springgym.theory import rope

PENDULUM = 1e-3
"""Relative tolerance of the period of a stiff body: strains of 5e-5 change its moments by 1e-4, and its
period at 150° by six times as much."""

SMALL = 0.01
"""Relative tolerance of the frequencies of small swings: rotations by 0.1 do not commute, by 0.1²."""

HANGING = 1e-6
"""Relative tolerance of the length of a hanging rope; the rope still oscillates when it is measured."""

BOUNCE = 0.02
"""Relative tolerance of the frequency of a hanging bounce: beads of 1 % of the mass shift it by as much."""

MODES = 5e-3
"""Relative tolerance of the frequencies of a rope's modes: steps make (ω h)²/24, 1e-3 for the highest."""

SWING = 0.01
"""Relative tolerance of the period of a swinging rope: its stretch, about 1.2 %, varies as it swings."""

DEPTH = 0.01
"""Relative tolerance of the depth of a jump: a cord with 1.4 % of the mass takes as much of the energy as it
falls, and dampers take 1 %; the depth changes by half of that."""


def _pin(recording: Recording) -> np.ndarray:
    """Return the position of the pin, (3,) [m]."""
    scene = recording.plan.scene
    return np.asarray(scene.positions[scene.pinned[0]])


@applies(needs.pinned, needs.gravity)
def pendulum(recording: Recording) -> list[Check]:
    """Check the period of a body swinging in a plane about its pin, released at rest."""
    scene = recording.plan.scene
    pin = _pin(recording)
    arm = recording.measures.centre - pin
    sideways = arm[0] * (1, 1, 0)
    sideways = sideways / np.linalg.norm(sideways)
    angle = np.arctan2(arm @ sideways, -arm[:, 2])
    amplitude = float(angle[0])
    body = scene.body.with_(positions=scene.positions, lengths=scene.body.lengths)
    hinge = np.cross(sideways, (0, 0, 1))
    inertia = float(hinge @ body.inertia(pin) @ hinge)
    mgl = body.mass * gravity(recording) * float(np.linalg.norm(arm[0]))
    expected = theory.period(inertia, mgl, amplitude)
    measured = period(recording.times, -angle)
    rate = 2 * math.sqrt(mgl / inertia)  # of the widest swing, at the lowest point
    # near the top the period depends on the amplitude logarithmically: by 1/(π − θ₀) at most
    by = slack(recording, rate) * (1 + amplitude / (math.pi - amplitude))
    quantity = f"period at {math.degrees(amplitude):.0f}°"
    by += float(recording.measures.damping_loss.max(initial=0.0)) / (mgl * (1 - math.cos(amplitude)))
    return [within(PENDULUM, quantity, expected, measured, "s", by)]


@applies(needs.pinned, needs.gravity)
def small_swings(recording: Recording) -> list[Check]:
    """Check both frequencies of small swings of a body of any shape about its pin.

    For a rotation by a small vector φ from hanging, I φ̈ = −K φ with K = M g l (1 − ẑ ẑᵀ), I about the pin.
    """
    body = recording.plan.scene.body
    pin = _pin(recording)
    hanging = _hanging(recording)
    r = hanging - pin
    inertia = np.sum(body.masses * (r * r).sum(axis=1)) * np.eye(3) - (body.masses * r.T) @ r
    mgl = body.mass * gravity(recording) * float(np.linalg.norm(body.masses @ r / body.mass))
    root = np.linalg.inv(np.linalg.cholesky(inertia))
    squares, shapes = np.linalg.eigh(root @ np.diag([mgl, mgl, 0.0]) @ root.T)
    turned = _rotations(r, recording.positions - pin, body.masses)
    amplitude = float(np.linalg.norm(turned[0]))
    checks = []
    for n, name in ((1, "slower swing"), (2, "quicker swing")):
        coordinate = turned @ inertia @ root.T @ shapes[:, n]
        frequency = math.sqrt(squares[n])
        # rotations do not commute: modes couple at second order in the amplitude
        by = slack(recording, frequency) + amplitude**2
        measured = 2 * math.pi / period(recording.times, coordinate)
        checks.append(within(SMALL, name, frequency, measured, "rad/s", by))
    return checks


def _hanging(recording: Recording) -> np.ndarray:
    from springgym.model.bodies import start

    scene = recording.plan.scene
    pin = _pin(recording)
    return start(
        scene.body, pinned=scene.pinned, position=pin.tolist(), hanging=True, gravity=scene.gravity
    ).positions


def _rotations(shape: np.ndarray, placed: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """Return small rotation vectors (T, 3) that best fit a shape (N, 3) to placed positions (T, N, 3)."""
    moment = np.einsum("n,tni,nj->tij", masses, placed, shape)
    inertia = np.trace(moment, axis1=1, axis2=2)[:, None, None] * np.eye(3) - moment
    skew = np.stack(
        [
            moment[:, 2, 1] - moment[:, 1, 2],
            moment[:, 0, 2] - moment[:, 2, 0],
            moment[:, 1, 0] - moment[:, 0, 1],
        ],
        axis=1,
    )
    return np.linalg.solve((inertia + inertia.transpose(0, 2, 1)) / 2, skew[..., None])[..., 0]


@applies(needs.rope, needs.gravity)
def rope_stretch(recording: Recording) -> list[Check]:
    """Check the lengths of the springs of a rope at rest, and its bounce before.

    A mode of frequency ω decays as exp(−γ t), γ = c ω²/2k; so the rest of the bounce is known.
    """
    body = recording.plan.scene.body
    k = float(body.stiffness[0])
    c = float(body.damping[0])
    g = gravity(recording)
    lengths = np.linalg.norm(np.diff(recording.positions, axis=1), axis=2)
    expected = rope.stretched_lengths(body.masses[1:], body.lengths, body.stiffness, g)
    lowest = float(rope.bounce_modes(body.masses[1:], body.stiffness).frequencies[0])
    decay = c * lowest**2 / (2 * k)
    stretch = float((expected - body.lengths).sum())
    left = stretch * math.exp(-decay * recording.times[-1])
    total = lengths.sum(axis=1)
    bounce = math.sqrt(max(lowest**2 - decay**2, 0.0))
    kept = recording.times < 12 / max(decay, 1e-300)  # above round-off
    measured = 2 * math.pi / period(recording.times[kept], (total - expected.sum())[kept])
    # the beads' own modes shift the first crossings by their fraction of the mass
    by = (bounce * recording.step) ** 2 + float(body.masses[1:-1].sum() / body.mass)
    whole = float(expected.sum())
    top = float(expected[0])
    return [
        within(HANGING, "length of the rope", whole, float(total[-1]), "m", left / whole),
        within(HANGING, "length of the top spring", top, float(lengths[-1, 0]), "m", left / top),
        within(BOUNCE, "bounce frequency", bounce, measured, "rad/s", by),
    ]


@applies(needs.rope, needs.gravity)
def rope_modes(recording: Recording) -> list[Check]:
    """Check frequencies of all small sideways modes of a hanging rope."""
    body = recording.plan.scene.body
    masses = body.masses[1:]
    modes = rope.swing_modes(masses, body.lengths, body.stiffness, gravity(recording))
    sideways = recording.positions[:, 1:, 0] - recording.positions[:, :1, 0]
    slope = np.abs(np.diff(recording.positions[:, :, 0], axis=1)).max() / body.lengths.min()
    tension = rope.tensions(masses, gravity(recording)).min()
    # a slope s stretches springs by s²/2 of their length, which adds to the tension
    harder = float(slope**2 / 2 * body.stiffness.max() * body.lengths.max() / tension)
    checks = []
    for n, frequency in enumerate(modes.frequencies.tolist()):
        coordinate = sideways @ (masses * modes.shapes[:, n])
        measured = 2 * math.pi / period(recording.times, coordinate)
        by = harder + (frequency * recording.step) ** recording.integrator.order / 12  # Verlet: /24
        checks.append(within(MODES, f"swing mode {n + 1}", frequency, measured, "rad/s", by))
    return checks


@applies(needs.rope, needs.gravity)
def rope_swing(recording: Recording) -> list[Check]:
    """Check the period of a rope with a heavy end: its lowest mode, slowed by the amplitude."""
    body = recording.plan.scene.body
    masses = body.masses[1:]
    g = gravity(recording)
    modes = rope.swing_modes(masses, body.lengths, body.stiffness, g)
    arm = recording.positions[:, -1] - recording.positions[:, 0]
    angle = np.arctan2(arm[:, 0], -arm[:, 2])
    amplitude = float(angle[0])
    slower = theory.period(1.0, 1.0, amplitude) / theory.small_period(1.0, 1.0)
    expected = 2 * math.pi / float(modes.frequencies[0]) * slower
    stretched = rope.stretched_lengths(masses, body.lengths, body.stiffness, g).sum() / body.lengths.sum() - 1
    # swinging changes the stretch in proportion to the amplitude's square; light beads do not follow it
    by = stretched * amplitude**2 + float(masses[:-1].sum() / body.mass) * amplitude**2
    measured = period(recording.times, -angle)
    by += (float(modes.frequencies[0]) * recording.step) ** recording.integrator.order
    return [within(SWING, f"period at {math.degrees(amplitude):.0f}°", expected, measured, "s", by)]


@applies(needs.rope, needs.gravity)
def bungee(recording: Recording) -> list[Check]:
    """Compare the depth of a jump on a light cord with theory: weight and stretch balance the energy.

    Part of the cord's own energy, at most that of its fall, remains in vibration, and dampers dissipate some:
    both shorten the fall by their energy over the force at the lowest point.
    """
    scene = recording.plan.scene
    m = recording.measures
    g = gravity(recording)
    body = scene.body
    top = float(scene.positions[0, 2])
    length = float(body.lengths.sum())
    cord = float(body.masses[1:-1].sum())
    jumper = float(body.masses[-1])
    stiffness = 1 / float((1 / body.stiffness).sum())
    height = recording.positions[:, -1, 2]
    lowest = int(np.argmin(height))
    weight = (jumper + cord / 2) * g  # the cord's centre is half as deep
    above = float(m.energy[0]) - (jumper + cord) * g * top
    # −weight·(L + s) + stiffness·s²/2 = energy above that of everything at the top
    stretch = (weight + math.sqrt(weight**2 + 2 * stiffness * (above + weight * length))) / stiffness
    left = (cord * g * length + float(m.damping_loss[lowest])) / (stiffness * stretch - weight)
    depth = length + stretch
    turned = 0 < lowest < len(height) - 1
    measured = top - float(height[lowest]) if turned else math.nan
    return [within(DEPTH, "depth of the fall", depth, measured, "m", left / depth)]
