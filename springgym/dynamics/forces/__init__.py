"""All forces on the particles, from the `springgym.dynamics.terms.Terms` of a scene.

User-defined forces need no change here, see `springgym.model.own_forces`.
"""

from __future__ import annotations

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number, Numbers, Rows
from springgym.core.language.memory import load
from springgym.core.language.vectors import add_row, add_scaled, dot, plus_scaled, row, set_row, vec, vector
from springgym.dynamics.contact.round import feature_energy, rolls
from springgym.dynamics.contact.surfaces import contact_energy
from springgym.dynamics.forces.actuators import (
    add_actuation,
    drive_on,
    move_drive,
    push,
    record_holding,
    set_actuation,
)
from springgym.dynamics.forces.paper_contact import Sampled, add_paper_forces
from springgym.dynamics.forces.springs import add_spring_forces, damp, spring_energy
from springgym.dynamics.records import Rounds
from springgym.dynamics.terms import Dampers, Particles, Terms
from springgym.model.own_forces import add_own_forces, own_energy

__all__ = [
    "accelerate",
    "accelerate_and_damp",
    "act",
    "actuate",
    "barriers_energy",
    "derivative",
    "divide_and_kick",
    "divide_by_mass",
    "drift",
    "gravity_energy",
    "kick",
    "kick_and_drift",
    "kick_through",
    "paired",
    "potential_energy",
    "relax",
    "set_forces",
    "set_weights",
    "stored_energy",
]


@compiled
def accelerate(x: Rows, a: Rows, direction: Rows, terms: Terms) -> None:
    """Set ``a`` (N, 3) to the accelerations by all position-dependent forces except actuators.

    ``direction`` (springs, 3) receives the springs' unit vectors if there are dampers.
    """
    set_forces(x, a, direction, True, terms)
    divide_by_mass(a, terms.particles)


@compiled
def set_forces(x: Rows, force: Rows, direction: Rows, directs: bool, terms: Terms) -> None:
    """Set ``force`` (N, 3) to the forces [N] from which `accelerate` gets the accelerations.

    ``direction`` is set only if ``directs``.
    """
    set_weights(force, terms.particles, terms.gravity)
    add_spring_forces(x, None, force, direction, directs, terms.springs, terms.dampers, None, 0.0)
    add_own_forces(x, force, terms.own, terms.body)


@compiled
def accelerate_and_damp(x: Rows, v: Rows, a: Rows, weight: Number, ledger: Ledger, terms: Terms) -> None:
    """Set ``a`` (N, 3) to the acceleration [m/s²] by weight, springs and dampers, not by user-defined forces.

    ``weight`` [s] times the dampers' power is added to the ledger.
    """
    set_weights(a, terms.particles, terms.gravity)
    add_spring_forces(x, v, a, None, False, terms.springs, terms.dampers, ledger, weight)
    divide_by_mass(a, terms.particles)


@compiled
def derivative(x: Rows, v: Rows, a: Rows, b: Rows, weight: Number, ledger: Ledger, terms: Terms) -> None:
    """Set ``a`` (N, 3) to the accelerations by all forces, for methods without splitting.

    ``weight`` [s] times the power of non-conservative forces is added to the ledger; ``b`` is workspace.
    """
    particles = terms.particles
    set_weights(a, particles, terms.gravity)
    add_spring_forces(x, v, a, None, False, terms.springs, terms.dampers, ledger, weight)
    add_own_forces(x, a, terms.own, terms.body)
    record_holding(v, a, terms.drive, ledger, weight)
    sampled = Sampled(x, v, a, ledger, weight)
    add_paper_forces(sampled, particles, terms.surfaces, terms.friction, terms.paper_law)
    divide_by_mass(a, particles)
    add_actuation(x, v, a, b, particles, terms.wrench, terms.thrust, ledger, weight)
    drive_on(v, a, terms.drive)


@compiled
def set_weights(force: Rows, particles: Particles, gravity: Numbers) -> None:
    """Set ``force`` (N, 3) to the weights [N] of free particles, and to 0 for pinned ones."""
    for i in range(particles.mass.size):
        if gravity is not None and particles.free[i]:
            set_row(force, i, load(particles.mass, i) * vector(gravity))
        else:
            set_row(force, i, vec(0.0, 0.0, 0.0))


@compiled
def divide_by_mass(force: Rows, particles: Particles) -> None:
    """Convert forces (N, 3) [N] to accelerations [m/s²], in place."""
    for i in range(particles.mass.size):
        set_row(force, i, load(particles.inverse_mass, i) * row(force, i))


@compiled
def divide_and_kick(force: Rows, v: Rows, kicked: Rows, tau: Number, particles: Particles) -> None:
    """`divide_by_mass`, and set ``kicked`` to ``v`` after these accelerations have acted for ``tau`` seconds.

    Both at once, as values in registers need not be read again.
    """
    for i in range(v.shape[0]):
        acceleration = load(particles.inverse_mass, i) * row(force, i)
        set_row(force, i, acceleration)
        set_row(kicked, i, plus_scaled(row(v, i), tau, acceleration))


@compiled
def kick_and_drift(x: Rows, v: Rows, a: Rows, h: Number) -> None:
    """`kick` for h/2, then `drift` for h, at once."""
    for i in range(x.shape[0]):
        after = plus_scaled(row(v, i), 0.5 * h, row(a, i))
        set_row(v, i, after)
        add_row(x, i, h * after)


@compiled
def kick_through(x: Rows, v: Rows, force: Rows, before: Number, h: Number, particles: Particles) -> None:
    """`divide_and_kick` for ``before`` seconds and `kick_and_drift` at once, with bit-identical results."""
    for i in range(x.shape[0]):
        acceleration = load(particles.inverse_mass, i) * row(force, i)
        halfway = plus_scaled(row(v, i), before, acceleration)
        after = plus_scaled(halfway, 0.5 * h, acceleration)
        set_row(v, i, after)
        add_row(x, i, h * after)


@compiled
def actuate(x: Rows, b: Rows, terms: Terms) -> None:
    """Set ``b`` (N, 3) to the accelerations by actuators, if the scene has any.

    The row of a driven particle is the force [N] that holds it against its springs.
    """
    set_actuation(x, b, terms.particles, terms.springs, terms.wrench, terms.thrust, terms.drive)


@compiled
def kick(v: Rows, a: Rows, tau: Number) -> None:
    """Add the accelerations ``a`` [m/s²] times ``tau`` [s] to the velocities."""
    for i in range(v.shape[0]):
        add_scaled(v, i, tau, row(a, i))


@compiled
def act(v: Rows, b: Rows, tau: Number, ledger: Ledger, terms: Terms) -> None:
    """Apply the actuators, with their accelerations ``b`` [m/s²], for ``tau`` seconds."""
    push(v, b, tau, terms.particles, terms.wrench, terms.thrust, ledger)
    move_drive(v, b, tau, terms.drive, ledger)


@compiled
def relax(v: Rows, direction: Rows, backward: bool, whole: bool, ledger: Ledger, terms: Terms) -> None:
    """Apply the dampers for a ``whole`` step, or for half of one."""
    damp(v, direction, terms.springs, terms.dampers, terms.drive, ledger, backward, whole)


@compiled
def paired(dampers: Dampers | None) -> bool:
    """Return whether there are dampers that take two sweeps per step."""
    if dampers is None:
        return True
    return dampers.paired


@compiled
def drift(x: Rows, v: Rows, tau: Number) -> None:
    """Move the particles at their velocities for ``tau`` seconds, without contact."""
    for i in range(x.shape[0]):
        add_row(x, i, tau * row(v, i))


@compiled
def potential_energy(x: Numbers, terms: Terms) -> tuple[Number, ...]:
    """Energies [J] of gravity (0 at the origin), springs and contact, and the largest |L/L₀ − 1|²."""
    weight, elastic, strain = stored_energy(x, terms)
    return weight, elastic, barriers_energy(x, terms, terms.rounds), strain


@compiled
def barriers_energy(x: Numbers, terms: Terms, rounds: Rounds | None) -> Number:
    """Return the energy of a body in the barriers of all surfaces [J]."""
    if rounds is None:
        return contact_energy(x, terms.particles, terms.surfaces)
    if rolls(rounds):
        return feature_energy(x, rounds, terms.surfaces)
    return contact_energy(x, terms.particles, terms.surfaces)


@compiled
def stored_energy(x: Numbers, terms: Terms) -> tuple[Number, ...]:
    """Energies [J] of gravity and springs, without contact, and the largest |L/L₀ − 1|²."""
    weight = gravity_energy(x, terms.particles, terms.gravity)
    elastic, strain = spring_energy(x, terms.springs)
    if terms.own is not None:
        elastic = elastic + own_energy(x, terms.own, terms.body)
    return weight, elastic, strain


@compiled
def gravity_energy(x: Numbers, particles: Particles, gravity: Numbers) -> Number:
    """Return the energy of a body in the gravity field [J], 0 at the origin."""
    energy = 0.0 * load(x, (0, 0))
    if gravity is not None:
        for i in range(particles.mass.size):
            if particles.free[i]:
                energy = energy - load(particles.mass, i) * dot(vector(gravity), row(x, i))
    return energy
