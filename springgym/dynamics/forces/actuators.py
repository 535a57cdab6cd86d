"""Actuators: forces and torques that are constant over a control period.

Each adds accelerations to an array (N, 3); `push` applies them to the velocities and computes their work.
Values per copy are arrays of blocks. World-fixed values keep their direction during the period; body-fixed
ones are in the `triad` of three particles.
"""

from __future__ import annotations

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number, Numbers, Rows, Vector
from springgym.core.language.lanes import maximum, minimum, select
from springgym.core.language.memory import load, store
from springgym.core.language.vectors import (
    add_row,
    cross,
    dot,
    inertia,
    mass_centre,
    row,
    set_row,
    solve_symmetric,
    triad,
    vec,
    vector,
)
from springgym.dynamics.forces.ledger import LedgerEntry, record
from springgym.dynamics.forces.springs import pull_on
from springgym.dynamics.terms import Drive, Particles, Springs, Thrust, Wrench


@compiled
def set_actuation(
    x: Rows,
    b: Rows,
    particles: Particles,
    springs: Springs,
    wrench: Wrench | None,
    thrust: Thrust | None,
    drive: Drive | None,
) -> None:
    """Set ``b`` (N, 3) to the accelerations by actuators, if there are any.

    The row of a driven particle is the force [N] that holds it against its springs.
    """
    if wrench is not None:
        set_wrench(x, b, particles, wrench)
    if thrust is not None:
        if wrench is None:
            for i in range(particles.mass.size):
                set_row(b, i, vec(0.0, 0.0, 0.0))
        add_thrust(x, b, particles, thrust)
    if drive is not None and drive.particle >= 0:
        set_row(b, drive.particle, -1.0 * pull_on(x, drive.particle, springs))


@compiled
def add_actuation(
    x: Rows,
    v: Rows,
    a: Rows,
    b: Rows,
    particles: Particles,
    wrench: Wrench | None,
    thrust: Thrust | None,
    ledger: Ledger,
    weight: Number,
) -> None:
    """Add the accelerations by wrench and thrust to ``a`` (N, 3); ``b`` is workspace.

    ``weight`` [s] times their power goes to the ledger.
    """
    if wrench is not None or thrust is not None:
        set_actuation(x, b, particles, None, wrench, thrust, None)
        for i in range(particles.mass.size):
            add_row(a, i, row(b, i))
            if ledger is not None:
                power = load(particles.mass, i) * dot(row(b, i), row(v, i))
                record(ledger, LedgerEntry.WORK, weight * power)


@compiled
def set_wrench(x: Rows, acceleration: Rows, particles: Particles, wrench: Wrench) -> None:
    mass = particles.mass
    about = row(x, wrench.pivot) if wrench.pivot >= 0 else mass_centre(x, mass)
    e1, e2, e3 = triad(x, wrench.markers)
    world = vector(wrench.torque)
    torque = world - (1.0 - wrench.axial) * dot(world, e3) * e3
    body = vector(wrench.body_torque)
    torque = torque + (body[0] * e1 + (body[1] * e2 + body[2] * e3))
    angular = solve_symmetric(inertia(x, mass, about), torque)
    total = load(mass, 0)
    for i in range(1, mass.size):
        total = total + load(mass, i)
    linear = 1.0 / total * vector(wrench.force)
    for i in range(mass.size):
        if particles.free[i]:
            change = linear
            if mass.size > 1:  # else r is only round-off of the centre of mass
                change = linear + cross(angular, row(x, i) - about)
            set_row(acceleration, i, change)
        else:
            set_row(acceleration, i, vec(0.0, 0.0, 0.0))


@compiled
def add_thrust(x: Rows, acceleration: Rows, particles: Particles, thrust: Thrust) -> None:
    e1, e2, e3 = triad(x, thrust.markers)
    for n in range(thrust.particle.size):
        force = row(thrust.force, n)
        if thrust.turns:
            force = force[0] * e1 + (force[1] * e2 + force[2] * e3)
        i = thrust.particle[n]
        add_row(acceleration, i, load(particles.inverse_mass, i) * force)


@compiled
def push(
    v: Rows,
    acceleration: Rows,
    tau: Number,
    particles: Particles,
    wrench: Wrench | None,
    thrust: Thrust | None,
    ledger: Ledger,
) -> None:
    """Apply wrench and thrust for ``tau`` seconds; their exact work goes to the ledger."""
    if wrench is not None or thrust is not None:
        work = 0.0 * load(v, (0, 0))
        for i in range(particles.mass.size):
            if particles.free[i]:
                before = row(v, i)
                change = tau * row(acceleration, i)
                after = before + change
                set_row(v, i, after)
                work = work + load(particles.mass, i) * dot(change, before + after)
        record(ledger, LedgerEntry.WORK, 0.5 * work)


@compiled
def record_holding(v: Rows, force: Rows, drive: Drive | None, ledger: Ledger, weight: Number) -> None:
    """Record ``weight`` [s] times the power of the drive that holds its particle against ``force`` [N]."""
    if drive is not None and drive.particle >= 0:
        record(ledger, LedgerEntry.WORK, -weight * dot(row(force, drive.particle), row(v, drive.particle)))


@compiled
def drive_on(v: Rows, acceleration: Rows, drive: Drive | None) -> None:
    """Set the driven particle's row of ``acceleration`` (N, 3) to the drive's, up to its largest speed."""
    if drive is not None and drive.particle >= 0:
        for axis in range(3):
            speed = load(v, (drive.particle, axis))
            asked = load(drive.acceleration, axis)
            store(acceleration, (drive.particle, axis), limited(speed, asked, drive.speed))


@compiled
def limited(velocity: Number, acceleration: Number, speed: Number) -> Number:
    acceleration = select(velocity >= speed, minimum(acceleration, 0.0), acceleration)
    return select(velocity <= -speed, maximum(acceleration, 0.0), acceleration)


@compiled
def move_drive(v: Numbers, force: Numbers, tau: Number, drive: Drive | None, ledger: Ledger) -> None:
    """Accelerate the driven particle for ``tau`` seconds, up to its largest speed.

    Its row of ``force`` (N, 3) [N] is the force of the drive, whose work goes to the ledger.
    """
    if drive is not None:
        drive_by(v, force, vector(drive.acceleration), tau, drive, ledger)


@compiled
def drive_by(
    v: Numbers, force: Numbers, acceleration: Vector, tau: Number, drive: Drive | None, ledger: Ledger
) -> None:
    """`move_drive` with a given acceleration instead of the drive's present one."""
    if drive is not None and drive.particle >= 0:
        for axis in range(3):
            before = load(v, (drive.particle, axis))
            speed = before + tau * acceleration[axis]
            speed = select(speed > drive.speed, drive.speed, speed)
            speed = select(speed < -drive.speed, -drive.speed, speed)
            store(v, (drive.particle, axis), speed)
            record(
                ledger, LedgerEntry.WORK, 0.5 * tau * load(force, (drive.particle, axis)) * (before + speed)
            )
