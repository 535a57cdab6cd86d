"""Conversion between the state of a rigid body and that of its particles.

A body of particles of masses mᵢ at xᵢ with velocities vᵢ has, about its point X, the pin or centre of mass,

    P = Σ mᵢ vᵢ,    L = Σ mᵢ (xᵢ − X) × vᵢ,

and each particle of a rigid one moves with V + ω × r, ω = I⁻¹ L. No other state is stored, so that code which
reads particles reads rigid bodies, too.
"""

from __future__ import annotations

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Block, Numbers, Rows
from springgym.core.language.memory import load
from springgym.core.language.vectors import (
    angular_momentum,
    apply,
    block,
    cross,
    mass_centre,
    row,
    set_row,
    triad,
    vec,
)
from springgym.dynamics.rigid.flight import angular_velocity, combine, turned
from springgym.dynamics.rigid.solid import Rigid, Solid, State
from springgym.dynamics.terms import Terms


@compiled
def orientation(x: Rows, rigid: Rigid) -> Block:
    """Return the principal axes in world coordinates, from the triads of the particles and of the shape."""
    here = triad(x, rigid.markers)
    e1, e2, e3 = block(rigid.triad, 0)
    return (
        combine(here, vec(e1[0], e2[0], e3[0])),
        combine(here, vec(e1[1], e2[1], e3[1])),
        combine(here, vec(e1[2], e2[2], e3[2])),
    )


@compiled
def set_particles(x: Rows, v: Rows, state: State, solid: Solid) -> None:
    """Set positions and velocities of the particles of a rigid body."""
    _, momentum, position, velocity = state
    now = turned(solid.axes, state.q)
    omega = combine(now, angular_velocity(momentum, solid.rigid))
    for i in range(solid.terms.particles.mass.size):
        r = combine(now, row(solid.rigid.shape, i))
        set_row(x, i, position + r)
        set_row(v, i, velocity + cross(omega, r))


@compiled
def read_state(x: Rows, v: Rows, rigid: Rigid, asymmetry: Numbers, terms: Terms) -> tuple[State, Solid]:
    """Return the `State` with the particles' momenta and the orientation of their triad, and its `Solid`."""
    mass = terms.particles.mass
    zero = 0.0 * load(x, (0, 0))
    nothing = vec(zero, zero, zero)
    if rigid.pivot >= 0:
        position = row(x, rigid.pivot)
        velocity = nothing
    else:
        position = mass_centre(x, mass)
        velocity = mass_centre(v, mass)
    if rigid.turns:
        axes = orientation(x, rigid)
        momentum = apply(axes, angular_momentum(x, v, mass, position))
    else:
        axes = (vec(1.0 + zero, zero, zero), vec(zero, 1.0 + zero, zero), vec(zero, zero, 1.0 + zero))
        momentum = nothing
    centre = mass_centre(rigid.shape, mass)
    total = load(mass, 0)
    for i in range(1, mass.size):
        total = total + load(mass, i)
    lightness = 1.0 / total
    if rigid.pivot >= 0:
        lightness = 0.0 * lightness
    solid = Solid(rigid, asymmetry, axes, centre, total, lightness, terms)
    return State((1.0 + zero, zero, zero, zero), momentum, position, velocity), solid
