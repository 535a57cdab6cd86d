"""Changes of a rigid body's momenta by gravity and actuators."""

from __future__ import annotations

from typing import Any

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Ledger, Number, Numbers, Vector
from springgym.core.language.vectors import apply, block, cross, dot, row, vector
from springgym.dynamics.forces.ledger import LedgerEntry, record
from springgym.dynamics.rigid.flight import angular_velocity, combine
from springgym.dynamics.rigid.rotation import turn, turn_back
from springgym.dynamics.rigid.solid import Solid, State
from springgym.dynamics.terms import Thrust, Wrench


@compiled
def weight(q: Vector, tau: Number, gravity: Numbers, solid: Solid) -> Any:
    """Change of the angular momentum, in body coordinates, and of the momentum in ``tau`` seconds."""
    push = 0.0 * q[0] * solid.centre
    twist = push
    if gravity is not None:
        if solid.rigid.pivot < 0:
            push = push + tau * solid.total * vector(gravity)
        else:
            down = turn_back(q, apply(solid.axes, vector(gravity)))
            twist = tau * solid.total * cross(solid.centre, down)
    return twist, push


@compiled
def kick(
    state: State, tau: Number, ledger: Ledger, solid: Solid, wrench: Wrench | None, thrust: Thrust | None
) -> Any:
    """Apply gravity and actuators for ``tau`` seconds; the actuators' exact work goes to the ledger.

    The work is the product of their impulse with the mean of the velocities before and after.
    """
    q, momentum, position, velocity = state
    rigid = solid.rigid
    total = solid.total
    twist, push = weight(q, tau, solid.terms.gravity, solid)
    if wrench is not None or thrust is not None:
        force, torque = load_of_actuators(q, solid, wrench, thrust)
        torque = tau * torque
        twist = twist + torque
        if rigid.pivot < 0:
            force = tau * combine(solid.axes, turn(q, force))
            push = push + force
            record(ledger, LedgerEntry.WORK, dot(velocity + 0.5 / total * push, force))
        record(ledger, LedgerEntry.WORK, dot(angular_velocity(momentum + 0.5 * twist, rigid), torque))
    return State(q, momentum + twist, position, velocity + 1.0 / total * push)


@compiled
def load_of_actuators(q: Vector, solid: Solid, wrench: Wrench | None, thrust: Thrust | None) -> Any:
    """Force [N] and torque [N·m] of the actuators about the body's point, in body coordinates."""
    rigid = solid.rigid
    centre = solid.centre
    axes = solid.axes
    force = 0.0 * q[0] * centre
    torque = force
    body = block(rigid.triad, 0)
    if wrench is not None:
        e3 = body[2]
        force = turn_back(q, apply(axes, vector(wrench.force)))
        torque = turn_back(q, apply(axes, vector(wrench.torque)))
        torque = torque - (1.0 - wrench.axial) * dot(torque, e3) * e3
        torque = torque + combine(body, vector(wrench.body_torque))
        torque = torque + cross(centre, force)
    if thrust is not None:
        for n in range(thrust.particle.size):
            thrown = row(thrust.force, n)
            local = combine(body, thrown) if thrust.turns else turn_back(q, apply(axes, thrown))
            force = force + local
            torque = torque + cross(row(rigid.shape, thrust.particle[n]), local)
    return force, torque
