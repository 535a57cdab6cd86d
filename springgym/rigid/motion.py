"""The motion of a rigid body, seen as that of its particles.

A kernel reads position, orientation and momenta off the particles, moves the one rigid body, and sets
the particles to it; nothing else is kept, so whatever reads particles reads a rigid body too.

The step is a symmetric splitting: kick h/2, flight h, kick h/2. Kicks change the momenta by gravity and
actuators, flights are free (`springgym.rigid.flight`) or touch surfaces (`springgym.rigid.contact`).
Higher orders compose such steps (`springgym.rigid.METHODS`).

Source: Hairer, Lubich & Wanner, Geometric Numerical Integration, sec. V.3 and VII.5.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from springgym.blocks import at
from springgym.compiling import compiled, kernel
from springgym.forces.ledger import WORK, record
from springgym.kinds import Ledger, Number, Numbers, Rows, Vector
from springgym.lanes import any_lane, bodies_of, load, of_body
from springgym.rigid.contact import rub, slide
from springgym.rigid.flight import angular_velocity, combine, components, fly, turned
from springgym.rigid.rotation import turn, turn_back
from springgym.vectors import (
    angular_momentum,
    cross,
    dot,
    mass_centre,
    minus,
    plus,
    row,
    set_row,
    times,
    triad,
    vector,
)

if TYPE_CHECKING:
    from springgym.forces import Particles, Terms
    from springgym.forces.actuators import Thrust, Wrench
    from springgym.forces.barrier import HollowSphere, Planes


class Rigid(NamedTuple):
    """The rigid body, as its kernel takes it."""

    shape: np.ndarray
    """(N, 3) particles in principal axes, from the pin or the centre of mass [m]"""
    moments: np.ndarray
    """(3,) [kg·m²]"""
    triad: np.ndarray
    """(3, 3) rows: the body's `triad` in principal axes"""
    markers: np.ndarray
    """(3,) the particles of that triad"""
    pivot: int
    """the pinned particle, or −1"""
    stages: np.ndarray
    """(stages,) the composition: shares of the step that its second-order steps take"""


@compiled
def rows(matrix: Rows) -> Any:
    return row(matrix, 0), row(matrix, 1), row(matrix, 2)


@compiled
def orientation(x: Rows, rigid: Rigid) -> Any:
    """The principal axes in world coordinates: how the triad of the particles stands to that of the shape."""
    here = triad(x, rigid.markers)
    e1, e2, e3 = rows(rigid.triad)
    return (
        combine(here, (e1[0], e2[0], e3[0])),
        combine(here, (e1[1], e2[1], e3[1])),
        combine(here, (e1[2], e2[2], e3[2])),
    )


@compiled
def kick(
    q: Vector,
    spin: Vector,
    velocity: Vector,
    tau: Number,
    ledger: Ledger,
    axes: Vector,
    total: Number,
    centre: Vector,
    rigid: Rigid,
    gravity: Numbers,
    wrench: Wrench | None,
    thrust: Thrust | None,
) -> Any:
    """Let gravity and actuators act for ``tau`` seconds; the actuators' exact work goes to the ledger.

    It is the mean of the velocity before and after, times what they push.
    ``axes`` are the principal axes in world coordinates where ``q`` is the identity.
    """
    twist, push = times(0.0, spin), times(0.0, velocity)
    if gravity is not None:
        if rigid.pivot < 0:
            push = plus(push, times(tau * total, vector(gravity)))
        else:
            down = turn_back(q, components(axes, vector(gravity)))
            twist = times(tau * total, cross(centre, down))
    if wrench is not None or thrust is not None:
        force, torque = load_of_actuators(q, centre, axes, rigid, wrench, thrust)
        torque = times(tau, torque)
        twist = plus(twist, torque)
        if rigid.pivot < 0:
            force = times(tau, combine(axes, turn(q, force)))
            push = plus(push, force)
            record(ledger, WORK, dot(plus(velocity, times(0.5 / total, push)), force))
        record(ledger, WORK, dot(angular_velocity(plus(spin, times(0.5, twist)), rigid), torque))
    return plus(spin, twist), plus(velocity, times(1.0 / total, push))


@compiled
def load_of_actuators(
    q: Vector, centre: Vector, axes: Vector, rigid: Rigid, wrench: Wrench | None, thrust: Thrust | None
) -> Any:
    """Force [N] and torque [N·m] of the actuators about the body's point, in body coordinates."""
    force = times(0.0 * q[0], centre)
    torque = force
    body = rows(rigid.triad)
    if wrench is not None:
        e3 = body[2]
        force = turn_back(q, components(axes, vector(wrench.force)))
        torque = turn_back(q, components(axes, vector(wrench.torque)))
        torque = minus(torque, times((1.0 - wrench.axial) * dot(torque, e3), e3))
        torque = plus(torque, combine(body, vector(wrench.body_torque)))
        torque = plus(torque, cross(centre, force))
    if thrust is not None:
        for n in range(thrust.particle.size):
            thrown = row(thrust.force, n)
            local = combine(body, thrown) if thrust.turns else turn_back(q, components(axes, thrown))
            force = plus(force, local)
            torque = plus(torque, cross(row(rigid.shape, thrust.particle[n]), local))
    return force, torque


@compiled
def move(
    x: Rows,
    v: Rows,
    ledger: Ledger,
    workspace: np.ndarray,
    h: Number,
    steps: int,
    rigid: Rigid,
    asymmetry: Numbers,
    particles: Particles,
    gravity: Any,
    wrench: Wrench | None,
    thrust: Thrust | None,
    planes: Planes | None,
    bowl: HollowSphere | None,
    friction: Numbers,
    impact_damping: Numbers,
) -> None:
    """Take the particles of one block through ``steps`` steps; none only makes them rigid."""
    axes = orientation(x, rigid)
    zero = 0.0 * load(x, (0, 0))
    q = (1.0 + zero, zero, zero, zero)
    if rigid.pivot >= 0:
        position = row(x, rigid.pivot)
        velocity = (zero, zero, zero)
    else:
        position = mass_centre(x, particles.mass)
        velocity = mass_centre(v, particles.mass)
    spin = components(axes, angular_momentum(x, v, particles.mass, position))
    centre = mass_centre(rigid.shape, particles.mass)
    total = load(particles.mass, 0)
    for i in range(1, particles.mass.size):
        total = total + load(particles.mass, i)
    lightness = 1.0 / total
    if rigid.pivot >= 0:
        lightness = 0.0 * lightness
    act = (axes, total, centre, rigid, gravity, wrench, thrust)
    if planes is not None or bowl is not None:
        near = False
        for _ in range(steps):
            spin, velocity = kick(q, spin, velocity, 0.5 * h, ledger, *act)
            q, spin, position, velocity, margin = slide(
                q,
                spin,
                position,
                velocity,
                h,
                near,
                ledger,
                workspace,
                axes,
                lightness,
                rigid,
                asymmetry,
                particles,
                planes,
                bowl,
                friction,
                impact_damping,
            )
            near = any_lane(margin < 0.0)
            spin, velocity = kick(q, spin, velocity, 0.5 * h, ledger, *act)
            if friction is not None and near:
                spin, velocity = rub(
                    q,
                    spin,
                    position,
                    velocity,
                    margin,
                    ledger,
                    workspace,
                    axes,
                    lightness,
                    rigid,
                    particles,
                    planes,
                    bowl,
                    friction,
                )
    else:
        last = steps * rigid.stages.size
        before = 0.0
        for n in range(last + 1):
            ahead = h * rigid.stages[n % rigid.stages.size] if n < last else 0.0
            if last > 0:
                spin, velocity = kick(q, spin, velocity, 0.5 * (before + ahead), ledger, *act)
            if n < last:
                q, spin, position = fly(q, spin, position, velocity, ahead, rigid, asymmetry)
            before = ahead
    now = turned(axes, q)
    omega = combine(now, angular_velocity(spin, rigid))
    for i in range(particles.mass.size):
        r = combine(now, row(rigid.shape, i))
        set_row(x, i, plus(position, r))
        set_row(v, i, plus(velocity, cross(omega, r)))


@cache
def kernel_reading(read: Callable[..., None]) -> Callable[..., None]:
    """As the kernels of springs; ``terms`` are `Rigid`, the asymmetry, and the scene's `Terms`.

    If ``settles``, the particles are put onto the rigid shape and then take their steps, be it none;
    else they are left as they are, and only read off.
    """

    @kernel
    def advance(
        x: Any,
        v: Any,
        ledger: Ledger,
        workspace: np.ndarray,
        first: Any,
        last: Any,
        h: Any,
        steps: int,
        settles: bool,
        terms: Terms,
        reads: bool,
        readout: Any,
        space: Numbers,
        pivot: np.ndarray,
        markers: np.ndarray,
    ) -> None:
        for block in range(first, last):
            xb, vb, entries, all_terms = at(x, block), at(v, block), at(ledger, block), at(terms, block)
            if settles:
                for body in range(bodies_of(xb)):
                    rigid, asymmetry, own = of_body(all_terms, body)
                    move(
                        of_body(xb, body),
                        of_body(vb, body),
                        of_body(entries, body),
                        workspace,
                        h,
                        steps,
                        rigid,
                        asymmetry,
                        own.particles,
                        own.gravity,
                        own.wrench,
                        own.thrust,
                        own.planes,
                        own.bowl,
                        own.friction,
                        own.impact_damping,
                    )
            if reads:
                read(block, xb, vb, entries, readout, space, pivot, markers, all_terms[2])

    return advance
