"""The node of a step: the place where all impulses of the step act at once.

Particles fly straight for half a step, receive the impulses of springs, gravity, actuators, dampers, surfaces
and friction, and fly straight for the other half. With v₋ and v₊ the velocities before and after the node,
the kinetic energy changes by exactly Σ p · (v₋ + v₊)/2 over all impulses p: so the ledger enters for each
kind of impulse its product with that mean velocity. What rests has no mean velocity, hence loses nothing.

Dampers act on the mean velocity as it is without them, contact included: neither turning nor resting looks
like stretching to them. The contact that they disturb is then found again.
"""

from __future__ import annotations

from typing import Any

from springgym.compiling import compiled
from springgym.forces.actuators import driven_acceleration
from springgym.forces.contact import contact_change
from springgym.forces.ledger import CONTACT, DAMPING, FRICTION, WORK, record
from springgym.forces.springs import damp
from springgym.lanes import load
from springgym.vectors import dot, minus, plus, plus_scaled, row, set_row, times


@compiled
def impulse(
    x: Any, v: Any, a: Any, b: Any, tau: Any, backward: Any, space: Any, ledger: Any, terms: Any
) -> None:
    """Change the velocities by all that acts at a node in a step of ``tau`` seconds.

    ``a`` and ``b`` (N, 3) are the accelerations by springs and gravity, and by actuators. The dampers are
    taken in reverse order if ``backward``. ``space`` are workspace arrays: directions of the springs, v₋,
    velocities that dampers start from, one for the surfaces.
    """
    direction, before, half, pushes = space
    particles, dampers = terms.particles, terms.dampers
    surfaces = (terms.planes, terms.bowl, terms.friction, terms.impact_damping)
    for i in range(v.shape[0]):
        start = row(v, i)
        set_row(before, i, start)
        kick = with_actuators(row(a, i), b, i, terms.wrench, terms.thrust)
        kick = unless_driven(kick, start, i, tau, terms.drive)
        set_row(a, i, kick)
        set_middle(i, x, v, start, kick, tau, half, pushes, particles, dampers, *surfaces)
    sweep(v, direction, b, tau, backward, terms.springs, dampers, terms.drive)
    work = 0.0 * load(v, (0, 0))
    damped, rubbed, lost = work, work, work
    for i in range(v.shape[0]):
        start = row(before, i)
        taken = taken_by_dampers(v, half, i, dampers)
        end = plus(plus_scaled(start, tau, row(a, i)), taken)
        change, rub, loss = contact_change(i, row(x, i), start, end, tau, pushes, particles, *surfaces)
        end = plus(end, change)
        set_row(v, i, end)
        if ledger is not None:
            twice = times(load(particles.mass, i), plus(start, end))
            work = work + work_of_actuators(b, i, twice, terms.wrench, terms.thrust)
            damped = damped - dot(taken, twice)
            rubbed = rubbed - dot(rub, twice)
            lost = lost + loss
    if ledger is not None:
        record(ledger, WORK, (0.5 * tau) * (work + work_of_drive(before, v, b, terms.drive)))
        record(ledger, DAMPING, 0.5 * damped)
        record(ledger, CONTACT, lost)
        record(ledger, FRICTION, 0.5 * rubbed)


@compiled
def with_actuators(acceleration: Any, b: Any, i: Any, wrench: Any, thrust: Any) -> Any:
    """An acceleration with that by actuators, if there are any."""
    if wrench is None and thrust is None:
        return acceleration
    return plus(acceleration, row(b, i))


@compiled
def work_of_actuators(b: Any, i: Any, twice: Any, wrench: Any, thrust: Any) -> Any:
    if wrench is None and thrust is None:
        return 0.0 * twice[0]
    return dot(row(b, i), twice)


@compiled
def unless_driven(acceleration: Any, velocity: Any, i: Any, tau: Any, drive: Any) -> Any:
    """An acceleration, or that of the drive for its particle: as asked for, up to its largest speed."""
    if drive is not None and i == drive.particle:
        acceleration = driven_acceleration(velocity, tau, drive)
    return acceleration


@compiled
def work_of_drive(before: Any, v: Any, holding: Any, drive: Any) -> Any:
    if drive is None:
        return 0.0 * load(v, (0, 0))
    i = drive.particle
    return dot(row(holding, i), plus(row(before, i), row(v, i)))


@compiled
def set_middle(
    i: Any,
    x: Any,
    v: Any,
    start: Any,
    kick: Any,
    tau: Any,
    half: Any,
    pushes: Any,
    particles: Any,
    dampers: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    damping: Any,
) -> None:
    """Set the velocity that dampers see: the mean of before and after the node, without them."""
    if dampers is not None:
        middle = plus_scaled(start, 0.5 * tau, kick)
        if planes is not None or bowl is not None:
            free = plus_scaled(start, tau, kick)
            change, _, _ = contact_change(
                i, row(x, i), start, free, tau, pushes, particles, planes, bowl, friction, damping
            )
            middle = plus(middle, times(0.5, change))
        set_row(half, i, middle)
        set_row(v, i, middle)


@compiled
def taken_by_dampers(v: Any, half: Any, i: Any, dampers: Any) -> Any:
    """What dampers have done to a velocity."""
    if dampers is None:
        return times(0.0, row(v, i))
    return minus(row(v, i), row(half, i))


@compiled
def sweep(
    v: Any, direction: Any, holding: Any, tau: Any, backward: Any, springs: Any, dampers: Any, drive: Any
) -> None:
    """Let the dampers act for ``tau`` seconds."""
    if dampers is not None:
        if dampers.paired:
            damp(v, direction, holding, tau, springs, dampers, drive, False)
            damp(v, direction, holding, tau, springs, dampers, drive, True)
        else:
            damp(v, direction, holding, tau, springs, dampers, drive, backward)
