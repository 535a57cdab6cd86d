"""Everything that acts on the particles. `Terms` is the one list of it.

A scene has some of the terms and None for the others; every compiled function takes them as separate
arguments (``*terms``), and what is None is removed when it is compiled: a scene pays for what it has.
To add a force: its file, its field at the end of `Terms`, its line in the functions below that it
takes part in. A function names the terms up to the last it needs; ``*rest`` are the others.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from springgym.compiling import compiled
from springgym.forces.actuators import (
    Drive,
    Thrust,
    Wrench,
    add_thrust,
    drive_acceleration,
    move_drive,
    push,
    set_wrench,
)
from springgym.forces.contact import (
    Bowl,
    Planes,
    bowl_energy,
    move_above_planes,
    move_in_bowl,
    planes_energy,
)
from springgym.forces.ledger import WORK, record
from springgym.forces.paper_contact import PaperLaw, add_paper_forces, clamp
from springgym.forces.springs import (
    Dampers,
    Springs,
    add_spring_forces,
    damp,
    pull_on,
    spring_energy,
)
from springgym.lanes import load
from springgym.vectors import add_row, add_scaled, dot, row, set_row, times, vector


class Particles(NamedTuple):
    """Point masses, each array of shape (particles,)."""

    mass: np.ndarray
    """[kg]"""
    inverse_mass: np.ndarray
    """[1/kg], 0 if pinned"""
    free: np.ndarray
    """whether the particle moves freely, i.e. is not pinned"""


class Terms(NamedTuple):
    """The particles and what acts on them; None for what a scene does not have."""

    particles: Particles
    springs: Springs | None = None
    dampers: Dampers | None = None
    gravity: np.ndarray | None = None
    """(3,) [m/s²]"""
    wrench: Wrench | None = None
    thrust: Thrust | None = None
    drive: Drive | None = None
    planes: Planes | None = None
    bowl: Bowl | None = None
    friction: np.ndarray | None = None
    """μ of the surfaces [1], (1,)"""
    impact_damping: np.ndarray | None = None
    """d of the surfaces [s/m], (1,)"""
    paper_law: PaperLaw | None = None
    """contact as the paper has it"""


@compiled
def accelerate(
    x: Any,
    a: Any,
    direction: Any,
    particles: Any,
    springs: Any,
    dampers: Any,
    gravity: Any,
    *rest: Any,
) -> None:
    """Set ``a`` (N, 3) to the accelerations that follow from the positions, actuators apart.

    ``direction`` (springs, 3) receives the springs' unit vectors if there are dampers.
    """
    set_weights(a, particles, gravity)
    if springs is not None:
        if dampers is not None:
            add_spring_forces(x, None, a, direction, springs, None, None, 0.0)
        else:
            add_spring_forces(x, None, a, None, springs, None, None, 0.0)
    divide_by_mass(a, particles)


@compiled
def accelerate_and_damp(
    x: Any,
    v: Any,
    a: Any,
    weight: Any,
    ledger: Any,
    particles: Any,
    springs: Any,
    dampers: Any,
    gravity: Any,
    *rest: Any,
) -> None:
    """`accelerate` with the dampers; ``weight`` [s] times their power goes to the ledger."""
    set_weights(a, particles, gravity)
    if springs is not None:
        add_spring_forces(x, v, a, None, springs, dampers, ledger, weight)
    divide_by_mass(a, particles)


@compiled
def set_weights(force: Any, particles: Any, gravity: Any) -> None:
    """Set ``force`` (N, 3) to the weights [N] of the free particles, and else to 0."""
    for i in range(particles.mass.size):
        if gravity is not None and particles.free[i]:
            set_row(force, i, times(load(particles.mass, i), vector(gravity)))
        else:
            set_row(force, i, (0.0, 0.0, 0.0))


@compiled
def divide_by_mass(force: Any, particles: Any) -> None:
    """Turn forces (N, 3) into accelerations."""
    for i in range(particles.mass.size):
        set_row(force, i, times(load(particles.inverse_mass, i), row(force, i)))


@compiled
def actuate(
    x: Any,
    b: Any,
    particles: Any,
    springs: Any,
    dampers: Any,
    gravity: Any,
    wrench: Any,
    thrust: Any,
    drive: Any,
    *rest: Any,
) -> None:
    """Set ``b`` (N, 3) to the accelerations by actuators, if the scene has any.

    The row of a driven particle is the force [N] that holds it against its springs.
    """
    if wrench is not None or thrust is not None:
        if wrench is not None:
            set_wrench(x, b, particles, wrench)
        else:
            set_weights(b, particles, None)
        if thrust is not None:
            add_thrust(x, b, particles, thrust)
    if drive is not None:
        set_row(b, drive.particle, times(-1.0, pull_on(x, drive.particle, springs)))


@compiled
def kick(v: Any, a: Any, tau: Any, particles: Any, *rest: Any) -> None:
    """Let the accelerations ``a`` act for ``tau`` seconds."""
    for i in range(particles.mass.size):
        add_scaled(v, i, tau, row(a, i))


@compiled
def act(
    v: Any,
    b: Any,
    tau: Any,
    ledger: Any,
    particles: Any,
    springs: Any,
    dampers: Any,
    gravity: Any,
    wrench: Any,
    thrust: Any,
    drive: Any,
    *rest: Any,
) -> None:
    """Let the actuators, with their accelerations ``b``, act for ``tau`` seconds."""
    if wrench is not None or thrust is not None:
        push(v, b, tau, particles, ledger)
    if drive is not None:
        move_drive(v, b, tau, drive, ledger)


@compiled
def relax(
    v: Any,
    direction: Any,
    backward: Any,
    ledger: Any,
    particles: Any,
    springs: Any,
    dampers: Any,
    gravity: Any,
    wrench: Any,
    thrust: Any,
    drive: Any,
    *rest: Any,
) -> None:
    """Let the dampers act for half a step."""
    if dampers is not None:
        damp(v, direction, springs, dampers, drive, ledger, backward)


@compiled
def drift(x: Any, v: Any, tau: Any, ledger: Any, particles: Any, *rest: Any) -> None:
    """Let the particles move for ``tau`` seconds, with nothing in their way."""
    for i in range(particles.mass.size):
        add_row(x, i, times(tau, row(v, i)))  # rounded as above a surface


@compiled
def move(
    x: Any,
    v: Any,
    a: Any,
    tau: Any,
    ledger: Any,
    particles: Any,
    springs: Any,
    dampers: Any,
    gravity: Any,
    wrench: Any,
    thrust: Any,
    drive: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    impact_damping: Any,
    *rest: Any,
) -> None:
    """Let the particles move for ``tau`` seconds, and meet the surfaces.

    ``a`` are the accelerations that acted for ``tau`` seconds since the last move.
    """
    if planes is not None:
        move_above_planes(x, v, a, tau, ledger, particles, planes, friction, impact_damping)
    if bowl is not None:
        move_in_bowl(x, v, a, tau, ledger, particles, bowl, friction, impact_damping)
    if planes is None and bowl is None:
        drift(x, v, tau, ledger, particles)


@compiled
def settle(
    x: Any,
    v: Any,
    particles: Any,
    springs: Any,
    dampers: Any,
    gravity: Any,
    wrench: Any,
    thrust: Any,
    drive: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    impact_damping: Any,
    paper_law: Any,
    *rest: Any,
) -> None:
    """What methods that split nothing do after a step: the paper's clamp."""
    if paper_law is not None:
        clamp(x, v, particles, planes, bowl)


@compiled
def derivative(
    x: Any,
    v: Any,
    a: Any,
    b: Any,
    weight: Any,
    ledger: Any,
    particles: Any,
    springs: Any,
    dampers: Any,
    gravity: Any,
    wrench: Any,
    thrust: Any,
    drive: Any,
    planes: Any,
    bowl: Any,
    friction: Any,
    impact_damping: Any,
    paper_law: Any,
    *rest: Any,
) -> None:
    """Set ``a`` (N, 3) to the accelerations by everything, for methods that split nothing.

    ``weight`` [s] times the power of what is not conservative is added to the ledger; ``b`` is
    workspace.
    """
    set_weights(a, particles, gravity)
    if springs is not None:
        add_spring_forces(x, v, a, None, springs, dampers, ledger, weight)
    if drive is not None:  # it holds its particle, which has no weight here, against springs and dampers
        record(ledger, WORK, -weight * dot(row(a, drive.particle), row(v, drive.particle)))
    if paper_law is not None:
        add_paper_forces(x, v, a, particles, planes, bowl, friction, paper_law, ledger, weight)
    divide_by_mass(a, particles)
    if wrench is not None or thrust is not None:
        actuate(x, b, particles, springs, dampers, gravity, wrench, thrust, None)
        for i in range(particles.mass.size):
            add_row(a, i, row(b, i))
            if ledger is not None:
                power = load(particles.mass, i) * dot(row(b, i), row(v, i))
                record(ledger, WORK, weight * power)
    if drive is not None:
        set_row(a, drive.particle, drive_acceleration(v, drive))


@compiled
def potential_energy(
    x: Any,
    particles: Any,
    springs: Any,
    dampers: Any,
    gravity: Any,
    wrench: Any,
    thrust: Any,
    drive: Any,
    planes: Any,
    bowl: Any,
    *rest: Any,
) -> Any:
    """Energies [J] of gravity (0 at the origin), springs and contact, and the largest |L/L₀ − 1|²."""
    weight = 0.0 * load(x, (0, 0))
    elastic, contact, strain = weight, weight, weight
    if gravity is not None:
        for i in range(particles.mass.size):
            if particles.free[i]:
                weight = weight - load(particles.mass, i) * dot(vector(gravity), row(x, i))
    if springs is not None:
        elastic, strain = spring_energy(x, springs)
    if planes is not None:
        contact = planes_energy(x, particles, planes)
    if bowl is not None:
        contact = bowl_energy(x, particles, bowl)
    return weight, elastic, contact, strain
