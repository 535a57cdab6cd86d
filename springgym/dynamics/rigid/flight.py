"""The free motion of a rigid body.

With two equal moments it is exact: a rotation about the angular momentum, and one about the third axis,

    R(t) = R(0) exp(t Π/I₁) exp(t (1/I₃ − 1/I₁) Π₃ e₃),        Π = R(t)ᵀ L in body coordinates.

If the moments differ, ½(1/I₂ − 1/I₁) Π₂² is split off: a rotation about the second axis for half of the
time, before and after. All rotations are exact, so orientation stays orthonormal and the angular momentum
constant to round-off, whatever the step.

Sources: Fassò 2003, doi:10.1016/S0021-9991(03)00219-8; Dullweber, Leimkuhler & McLachlan 1997,
doi:10.1063/1.474310.
"""

from __future__ import annotations

from springgym.core.compiler.decorators import compiled
from springgym.core.language.kinds import Block, Number, Numbers, Vector
from springgym.core.language.memory import load
from springgym.core.language.vectors import vec, vector
from springgym.dynamics.rigid.rotation import normalised, product, rotation_vector, sine_cosine, turn
from springgym.dynamics.rigid.solid import Rigid, State


@compiled
def combine(axes: Block, u: Vector) -> Vector:
    """Σ uₙ × axis n."""
    return u[0] * axes[0] + (u[1] * axes[1] + u[2] * axes[2])


@compiled
def turned(axes: Block, q: Vector) -> Block:
    """Return the principal axes in world coordinates, given those where ``q`` is the identity."""
    return (
        combine(axes, turn(q, vec(1.0, 0.0, 0.0))),
        combine(axes, turn(q, vec(0.0, 1.0, 0.0))),
        combine(axes, turn(q, vec(0.0, 0.0, 1.0))),
    )


@compiled
def angular_velocity(momentum: Vector, rigid: Rigid) -> Vector:
    moments = vector(rigid.moments)
    return vec(momentum[0] / moments[0], momentum[1] / moments[1], momentum[2] / moments[2])


@compiled
def twist_about_second(q: Vector, momentum: Vector, tau: Number, asymmetry: Numbers) -> tuple[Vector, Vector]:
    """Apply the flow of ½(1/I₂ − 1/I₁) Π₂² for ``tau`` seconds."""
    s, c = sine_cosine(0.5 * tau * load(asymmetry, 0) * momentum[1])
    turned = (c * q[0] - s * q[2], c * q[1] - s * q[3], c * q[2] + s * q[0], c * q[3] + s * q[1])
    sine = 2.0 * s * c
    cosine = 1.0 - 2.0 * s * s
    return turned, vec(
        cosine * momentum[0] - sine * momentum[2], momentum[1], cosine * momentum[2] + sine * momentum[0]
    )


@compiled
def turn_freely(q: Vector, momentum: Vector, tau: Number, rigid: Rigid) -> tuple[Vector, Vector]:
    """Rotate a free body whose first two moments are I₁ for ``tau`` seconds."""
    slow = 1.0 / load(rigid.moments, 0)
    q = product(q, rotation_vector(momentum, tau * slow))
    s, c = sine_cosine(0.5 * tau * (1.0 / load(rigid.moments, 2) - slow) * momentum[2])
    turned = (c * q[0] - s * q[3], c * q[1] + s * q[2], c * q[2] - s * q[1], c * q[3] + s * q[0])
    sine = 2.0 * s * c
    cosine = 1.0 - 2.0 * s * s
    return normalised(turned), vec(
        cosine * momentum[0] + sine * momentum[1], cosine * momentum[1] - sine * momentum[0], momentum[2]
    )


@compiled
def fly(state: State, tau: Number, rigid: Rigid, asymmetry: Numbers) -> State:
    """Return the state after a free flight of ``tau`` seconds."""
    q, momentum, position, velocity = state
    if asymmetry is not None:
        q, momentum = twist_about_second(q, momentum, 0.5 * tau, asymmetry)
    q, momentum = turn_freely(q, momentum, tau, rigid)
    if asymmetry is not None:
        q, momentum = twist_about_second(q, momentum, 0.5 * tau, asymmetry)
    return State(q, momentum, position + tau * velocity, velocity)
