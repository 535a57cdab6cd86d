"""Linear springs (equation 3 of the paper) and their dampers.

A spring pulls its ends together along the unit vector û between them with k(L − L₀) + c dL/dt: read so
that the damper opposes the change of length. `add_spring_forces` is that, for integrators that take one
derivative of everything; or the dampers are left out there and split off, as the exact decay of the relative
speed along û (`damp`): dissipative for every c and step, and momentum and angular momentum are kept to
round-off.
"""

from __future__ import annotations

import numpy as np

from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Mask, Number, Numbers, Rows, Vector
from springgym.core.lanes import (
    FOUR,
    LOCAL,
    alone,
    columns,
    in_four,
    in_precision_of,
    inverse_sqrt,
    load,
    local_rows,
    maximum,
    multiply_add,
    next_four,
    of_four,
    row_of_four,
    select,
    sqrt,
    store,
)
from springgym.core.vectors import TINY, add_scaled, dot, row, set_row, vec
from springgym.forces.ledger import DAMPING, WORK, record
from springgym.terms import Dampers, Decay, Drive, Springs

SPRINGS_A_ROW = 2
"""Rows are taken as vectors in bodies with at least so many springs per particle, see `pays_by_rows`."""


def decay(
    damping: np.ndarray, inverse_first: np.ndarray | float, inverse_second: np.ndarray | float, time: float
) -> Decay:
    """Return the decays of dampers in a time [s].

    With w = 1/m₁ + 1/m₂, the impulse is g = (1 − exp(−c w time)) / w and the loss g (1 − g w/2).
    """
    w = inverse_first + inverse_second
    moving = w > 0  # between two pinned particles there is nothing to damp
    impulse = np.where(moving, -np.expm1(-damping * w * time) / np.where(moving, w, 1.0), 0.0)
    loss = impulse * (1 - impulse * w / 2)
    return Decay(impulse, impulse * inverse_first, impulse * inverse_second, loss)


def interleaved(springs: np.ndarray, particles: int) -> np.ndarray:
    """Order springs (S, 2) so that neighbours share no particle, as far as possible.

    A spring waits for the springs before it that act on the same particles: dampers one after another take
    up to a third longer. Particles with many springs have theirs spread over the whole order.
    """
    if not len(springs):
        return np.arange(0)
    left = np.bincount(springs.ravel(), minlength=particles)
    apart = -(-len(springs) // int(left.max()))
    last = np.full(particles, -apart)
    waiting, order = np.arange(len(springs)), []
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

    Given ``v`` (N, 3), those of the dampers too; ``weight`` [s] times their power goes to the ledger. If it
    ``directs``, ``direction`` (springs, 3) receives û: the dampers' share of the square root where they are
    split off.
    """
    if springs is not None:
        done, power = add_in_fours(x, v, force, direction, directs, springs, dampers, alone(x))
        for s in range(done, springs.first.size):
            i, j = springs.first[s], springs.second[s]
            apart = row(x, j) - row(x, i)
            inverse_length = inverse_sqrt(dot(apart, apart) + TINY)
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
            record(ledger, DAMPING, weight * power)


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
def add_in_fours(
    x: Rows,
    v: Rows,
    force: Rows,
    direction: Rows,
    directs: bool,
    springs: Springs,
    dampers: Dampers | None,
    single: bool | None,
) -> tuple[int, Number]:
    """Add the forces of a single copy's springs as `add_spring_forces` does, four at a time.

    Each row of particles is one vector, and so are the lengths of four springs. The bits are the same.

    Returns
    -------
    how many springs that were, and the power of their dampers [W]; 0 for several copies
    """
    power = 0.0 * load(x, (0, 0))
    if single is None:
        return 0, power
    if not pays_by_rows(x, springs):
        return 0, power
    count, places, forces, moves = x.shape[0], local_rows(x), local_rows(x), local_rows(x)
    copy_rows(count, x, places)
    copy_rows(count, force, forces)
    if v is not None and dampers is not None:
        copy_rows(count, v, moves)
    end = springs.first.size // FOUR * FOUR
    for s in range(0, end, FOUR):
        d0, d1 = apart(places, s, springs), apart(places, s + 1, springs)
        d2, d3 = apart(places, s + 2, springs), apart(places, s + 3, springs)
        d = vec_of(columns(d0, d1, d2, d3))
        inverse_length = inverse_sqrt(dot(d, d) + TINY)
        k = next_four(springs.stiffness, s)
        slack = in_precision_of(k * next_four(springs.length, s), inverse_length)
        pull = elastic_pull(in_precision_of(k, inverse_length), slack, inverse_length)
        if v is not None and dampers is not None:
            u0, u1 = apart(moves, s, springs), apart(moves, s + 1, springs)
            u2, u3 = apart(moves, s + 2, springs), apart(moves, s + 3, springs)
            rate = dot(vec_of(columns(u0, u1, u2, u3)), d)
            c = in_precision_of(next_four(dampers.coefficient, s), inverse_length)
            pull, lost = damped_pull(pull, c, rate, inverse_length)
            w0, w1, w2, w3 = of_four(lost)
            power = power + w0 + w1 + w2 + w3
        p0, p1, p2, p3 = of_four(pull)
        add_pull(forces, s, p0, d0, springs)
        add_pull(forces, s + 1, p1, d1, springs)
        add_pull(forces, s + 2, p2, d2, springs)
        add_pull(forces, s + 3, p3, d3, springs)
        if direction is not None and dampers is not None and directs:
            i0, i1, i2, i3 = of_four(inverse_length)
            set_row(direction, s, first_three(in_four(i0, d0) * d0))
            set_row(direction, s + 1, first_three(in_four(i1, d1) * d1))
            set_row(direction, s + 2, first_three(in_four(i2, d2) * d2))
            set_row(direction, s + 3, first_three(in_four(i3, d3) * d3))
    for i in range(count):
        set_row(force, i, first_three(load(forces, i)))
    return end, power


@compiled
def pays_by_rows(rows: Rows, springs: Springs) -> bool:
    """Tell whether a body is faster with its rows as vectors: few enough to fit, for enough springs."""
    return rows.shape[0] <= LOCAL and springs.first.size >= SPRINGS_A_ROW * rows.shape[0]


@compiled
def copy_rows(count: int, rows: Rows, local: Rows) -> None:
    """Copy the first ``count`` rows of an array to `local_rows`; an array of a workspace may have more."""
    for i in range(count):
        store(local, i, row_of_four(rows, i))


@compiled
def first_three(lanes: Number) -> Vector:
    """Return the first three of `FOUR` lanes as a vector."""
    x, y, z, _ = of_four(lanes)
    return vec(x, y, z)


@compiled
def vec_of(components: tuple[Number, Number, Number]) -> Vector:
    return vec(components[0], components[1], components[2])


@compiled
def apart(local: Rows, s: int, springs: Springs) -> Number:
    """Return the row of the second end of spring ``s`` minus that of its first end, of `local_rows`."""
    return load(local, springs.second[s]) - load(local, springs.first[s])


@compiled
def add_pull(local: Rows, s: int, pull: Number, apart: Number, springs: Springs) -> None:
    """Add the pull of spring ``s`` to the forces on its ends, in `local_rows`."""
    i, j, pulls = springs.first[s], springs.second[s], in_four(pull, apart)
    store(local, i, multiply_add(pulls, apart, load(local, i)))
    store(local, j, multiply_add(-pulls, apart, load(local, j)))


@compiled
def spring_energy(x: Rows, springs: Springs) -> tuple[Number, Number]:
    """Σ k (L − L₀)²/2 [J] and the largest |L/L₀ − 1|² [1]."""
    energy = 0.0 * load(x, (0, 0))
    largest = energy
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
    """``in_x`` ∂f/∂d + ``in_v`` ∂f/∂w of the pull f of spring ``s``: three rows.

    With d = x_j − x_i, w = v_j − v_i, û = d/L and ḋ = û·w,
    ∂f/∂d = k (1 − L₀/L) 1 + k (L₀/L) û ûᵀ + (c/L) [ḋ 1 + û wᵀ − 2 ḋ û ûᵀ] and ∂f/∂w = c û ûᵀ:
    the stiffness along the spring, the geometric one across it, and the turning of the damper.
    """
    i, j = springs.first[s], springs.second[s]
    apart = row(x, j) - row(x, i)
    inverse_length = inverse_sqrt(dot(apart, apart) + TINY)
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
    first, second, third = along[0] * to, along[1] * to, along[2] * to
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
        i, j = springs.first[s], springs.second[s]
        if i == particle or j == particle:
            apart = row(x, j) - row(x, i) if i == particle else row(x, i) - row(x, j)
            inverse_length = inverse_sqrt(dot(apart, apart) + TINY)
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
    """Let the relative speed along each spring decay, one after the other, for a ``whole`` step or for half.

    Only ``among`` some copies, if that is given.

    A sweep ``backward`` takes the springs in reverse order: it is the adjoint of the forward one, so that
    a pair around a step, or steps of alternating direction, are of second order. In bodies that hold their
    shape the order makes no difference beyond round-off of what is seen; in ropes it is their accuracy.
    """
    if dampers is not None:
        decay = dampers.whole if whole else dampers.half
        count = springs.first.size
        done, energy = 0, 0.0 * load(v, (0, 0))
        if among is None and drive is None:
            done, energy = damp_in_rows(v, direction, springs, decay, backward, alone(v))
        for n in range(done, count):
            s = count - 1 - n if backward else n
            i, j = springs.first[s], springs.second[s]
            along = row(direction, s)
            speed = dot(row(v, j) - row(v, i), along)
            if among is not None:
                speed = select(among, speed, 0.0)
            energy = energy + load(decay.loss, s) * speed * speed
            if drive is not None:
                impulse = load(decay.impulse, s) * speed
                if i == drive.particle:
                    record(ledger, WORK, -1.0 * impulse * dot(along, row(v, i)))
                if j == drive.particle:
                    record(ledger, WORK, impulse * dot(along, row(v, j)))
            # what needs the speed comes last: each spring waits for the velocities of the one before
            add_scaled(v, i, speed, load(decay.first, s) * along)
            add_scaled(v, j, -speed, load(decay.second, s) * along)
        record(ledger, DAMPING, energy)


@compiled
def damp_in_rows(
    v: Rows, direction: Rows, springs: Springs, decay: Decay, backward: bool, single: bool | None
) -> tuple[int, Number]:
    """Let the relative speeds of a single copy decay as `damp` does, to the bit; each row is one vector.

    Returns
    -------
    how many springs that were, and the energy lost [J]; 0 for several copies
    """
    energy = 0.0 * load(v, (0, 0))
    if single is None:
        return 0, energy
    if not pays_by_rows(v, springs):
        return 0, energy
    moves = local_rows(v)
    copy_rows(v.shape[0], v, moves)
    count = springs.first.size
    for n in range(count):
        s = count - 1 - n if backward else n
        i, j = springs.first[s], springs.second[s]
        along = row_of_four(direction, s)
        speed = dot(first_three(apart(moves, s, springs)), first_three(along))
        energy = energy + load(decay.loss, s) * speed * speed
        speeds = in_four(speed, along)
        store(moves, i, multiply_add(speeds, in_four(load(decay.first, s), along) * along, load(moves, i)))
        store(moves, j, multiply_add(-speeds, in_four(load(decay.second, s), along) * along, load(moves, j)))
    for i in range(v.shape[0]):
        set_row(v, i, first_three(load(moves, i)))
    return count, energy
