"""Linear springs (equation 3 of the paper) and their dampers.

A spring pulls its ends together along the unit vector û between them with k(L − L₀) + c dL/dt, the sign for
which the damper opposes the change of length. `add_spring_forces` computes this, for integrators that take
one derivative of all forces. Others split the dampers off, as the exact decay of the relative speed along û
(`damp`), which is dissipative for every c and step, and conserves momentum and angular momentum to round-off.
"""

from __future__ import annotations

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Mask, Number, Numbers, Rows, Vector
from springgym.core.language.lanes import inverse_sqrt, maximum, select, sqrt
from springgym.core.language.memory import load
from springgym.core.language.vectors import GUARD, add_scaled, dot, row, set_row, vec
from springgym.dynamics.forces.ledger import LedgerEntry, record
from springgym.dynamics.terms import Dampers, Decay, Drive, Springs


def decay(
    damping: np.ndarray, inverse_first: np.ndarray | float, inverse_second: np.ndarray | float, time: float
) -> Decay:
    """Return the decays by dampers during a time [s].

    With w = 1/m₁ + 1/m₂, the impulse is g = (1 − exp(−c w time)) / w and the loss g (1 − g w/2).
    """
    w = inverse_first + inverse_second
    moving = w > 0  # between two pinned particles there is nothing to damp
    impulse = np.where(moving, -np.expm1(-damping * w * time) / np.where(moving, w, 1.0), 0.0)
    loss = impulse * (1 - impulse * w / 2)
    return Decay(impulse, impulse * inverse_first, impulse * inverse_second, loss)


def interleaved(springs: np.ndarray, particles: int) -> np.ndarray:
    """Return an order (S,) of springs (S, 2) in which neighbours share no particle, as far as possible.

    A spring waits for the springs before it that act on the same particles: dampers one after another take
    up to a third longer. Particles with many springs have theirs spread over the whole order.
    """
    if not len(springs):
        return np.arange(0)
    left = np.bincount(springs.ravel(), minlength=particles)
    apart = -(-len(springs) // int(left.max()))
    last = np.full(particles, -apart)
    waiting = np.arange(len(springs))
    order = []
    for n in range(len(springs)):
        ends = springs[waiting]
        waited = np.minimum(n - last[ends].max(axis=1), apart)
        chosen = np.argmax(waited * len(springs) + left[ends].max(axis=1))
        spring = waiting[chosen]
        order.append(spring)
        last[springs[spring]] = n
        left[springs[spring]] -= 1
        waiting = np.delete(waiting, chosen)
    return np.array(order)


@compiled
def add_spring_forces(
    x: Rows,
    v: Rows,
    force: Rows,
    direction: Rows,
    directs: bool,
    springs: Springs,
    dampers: Dampers | None,
    ledger: Ledger,
    weight: Number,
) -> None:
    """Add the springs' forces [N] to ``force`` (N, 3).

    If ``v`` (N, 3) is given, those of the dampers are added, too; ``weight`` [s] times their power goes to
    the ledger. If ``directs``, ``direction`` (springs, 3) is set to û, which dampers need where they are
    split off.
    """
    if springs is not None:
        power = 0.0 * load(x, (0, 0))
        for s in range(springs.first.size):
            i = springs.first[s]
            j = springs.second[s]
            apart = row(x, j) - row(x, i)
            inverse_length = inverse_sqrt(dot(apart, apart) + GUARD)
            k = load(springs.stiffness, s)
            pull = elastic_pull(k, k * load(springs.length, s), inverse_length)
            if v is not None and dampers is not None:
                rate = dot(row(v, j) - row(v, i), apart)
                pull, lost = damped_pull(pull, load(dampers.coefficient, s), rate, inverse_length)
                power = power + lost
            add_scaled(force, i, pull, apart)
            add_scaled(force, j, -pull, apart)
            if direction is not None and dampers is not None and directs:
                set_row(direction, s, inverse_length * apart)
        if v is not None and dampers is not None:
            record(ledger, LedgerEntry.DAMPING, weight * power)


@compiled
def elastic_pull(k: Number, slack: Number, inverse_length: Number) -> Number:
    """Return the elastic force of a spring divided by its length, k (L − L₀)/L [N/m]; ``slack`` is k L₀."""
    return k - slack * inverse_length


@compiled
def damped_pull(pull: Number, c: Number, rate: Number, inverse_length: Number) -> tuple[Number, Number]:
    """Add the force of a damper divided by its length, c (dL/dt)/L, to a ``pull`` [N/m].

    The ``rate`` is L dL/dt [m²/s].

    Returns
    -------
    the sum, and the power of the damper [W]
    """
    speed = inverse_length * rate
    damping = c * speed
    return pull + damping * inverse_length, damping * speed


@compiled
def spring_energy(x: Rows, springs: Springs) -> tuple[Number, Number]:
    """Return Σ k (L − L₀)²/2 [J] and the largest |L/L₀ − 1|² [1]."""
    energy = 0.0 * load(x, (0, 0))
    largest = energy * energy  # +0, also where the coordinate is negative
    if springs is not None:
        for s in range(springs.first.size):
            apart = row(x, springs.second[s]) - row(x, springs.first[s])
            rest = load(springs.length, s)
            stretch = sqrt(dot(apart, apart)) - rest
            energy = energy + 0.5 * load(springs.stiffness, s) * stretch * stretch
            strain = stretch / rest
            largest = maximum(largest, strain * strain)
    return energy, largest


@compiled
def longest_spring(x: Numbers, springs: Springs) -> Number:
    """Return the largest L₀ [m]; 1 m without springs."""
    longest = 0.0 * load(x, (0, 0))
    if springs is None:
        return longest + 1.0
    for s in range(springs.first.size):
        longest = maximum(longest, load(springs.length, s))
    return longest


@compiled
def pull_jacobian(
    x: Rows, v: Rows, s: int, in_x: Number, in_v: Number, springs: Springs, dampers: Dampers | None
) -> tuple[Vector, Vector, Vector]:
    """Return ``in_x`` ∂f/∂d + ``in_v`` ∂f/∂w of the pull f of spring ``s``, as three rows.

    With d = x_j − x_i, w = v_j − v_i, û = d/L and ḋ = û·w,
    ∂f/∂d = k (1 − L₀/L) 1 + k (L₀/L) û ûᵀ + (c/L) [ḋ 1 + û wᵀ − 2 ḋ û ûᵀ] and ∂f/∂w = c û ûᵀ:
    the stiffness along the spring, the geometric one across it, and the effect of the damper's rotation.
    """
    i = springs.first[s]
    j = springs.second[s]
    apart = row(x, j) - row(x, i)
    inverse_length = inverse_sqrt(dot(apart, apart) + GUARD)
    along = inverse_length * apart
    k = load(springs.stiffness, s)
    slack = in_x * k * load(springs.length, s) * inverse_length
    same = in_x * k - slack
    to = slack * along
    if dampers is not None:
        c = load(dampers.coefficient, s)
        w = row(v, j) - row(v, i)
        turning = in_x * c * inverse_length
        rate = dot(w, along)
        same = same + turning * rate
        to = to + ((in_v * c - 2.0 * turning * rate) * along + turning * w)
    first = along[0] * to
    second = along[1] * to
    third = along[2] * to
    return (
        vec(first[0] + same, first[1], first[2]),
        vec(second[0], second[1] + same, second[2]),
        vec(third[0], third[1], third[2] + same),
    )


@compiled
def pull_on(x: Rows, particle: int, springs: Springs) -> Vector:
    """Return the springs' force [N] on one particle."""
    total = 0.0 * row(x, particle)
    for s in range(springs.first.size):
        i = springs.first[s]
        j = springs.second[s]
        if i == particle or j == particle:
            apart = row(x, j) - row(x, i) if i == particle else row(x, i) - row(x, j)
            inverse_length = inverse_sqrt(dot(apart, apart) + GUARD)
            k = load(springs.stiffness, s)
            total = total + elastic_pull(k, k * load(springs.length, s), inverse_length) * apart
    return total


@compiled
def damp(
    v: Rows,
    direction: Rows,
    springs: Springs,
    dampers: Dampers | None,
    drive: Drive | None,
    ledger: Ledger,
    backward: bool,
    whole: bool,
    among: Mask = None,
) -> None:
    """Damp the relative speed along each spring, one after the other, for a ``whole`` step or for half.

    ``among`` restricts it to some copies.

    A ``backward`` sweep takes the springs in reverse order: it is the adjoint of the forward one, so that a
    pair around a step, or steps of alternating direction, are of second order. In bodies that hold their
    shape the order has no visible effect; in ropes it determines the accuracy.
    """
    if dampers is not None:
        decay = dampers.whole if whole else dampers.half
        count = springs.first.size
        energy = 0.0 * load(v, (0, 0))
        for n in range(count):
            s = count - 1 - n if backward else n
            i = springs.first[s]
            j = springs.second[s]
            along = row(direction, s)
            speed = dot(row(v, j) - row(v, i), along)
            if among is not None:
                speed = select(among, speed, 0.0)
            energy = energy + load(decay.loss, s) * speed * speed
            if drive is not None:
                impulse = load(decay.impulse, s) * speed
                if i == drive.particle:
                    record(ledger, LedgerEntry.WORK, -1.0 * impulse * dot(along, row(v, i)))
                if j == drive.particle:
                    record(ledger, LedgerEntry.WORK, impulse * dot(along, row(v, j)))
            # operations on the speed come last: each spring waits for the velocities of the one before
            add_scaled(v, i, speed, load(decay.first, s) * along)
            add_scaled(v, j, -speed, load(decay.second, s) * along)
        record(ledger, LedgerEntry.DAMPING, energy)
