"""Rigid bodies at surfaces: the impulses that surfaces and friction give their particles at a node.

A particle near a surface gives way along the normal n by W = 1/M + (r × n) · I⁻¹ (r × n) per impulse: to the
law of contact (`springgym.contact.law`) it is a particle of mass 1/W, which all else gives what gravity,
actuators and the impulses at the other particles do to its speed. Its way is that of the flights, curved as
they are. The impulse acts at the arm r that makes the mean velocity along n the way over the time: its work
is then that of the barrier to rounding. Friction stops what slips, as far as `springgym.contact.cone` allows.

All particles act on each other through the motion of the body. They are taken one after the other, and the
flight is flown anew, until neither changes (Gauss and Seidel).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.contact.cone import within_cone
from springgym.contact.law import Span, meet
from springgym.contact.surfaces import coefficient, count, energy_at, facing, lowest, strength_and_reach
from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Vector
from springgym.core.lanes import any_lane, epsilon, maximum, minimum, select, sqrt
from springgym.core.vectors import TINY, choose, cross, dot, plus_scaled, row, set_row, vec
from springgym.integrators.envelope import Block
from springgym.rigid.flight import angular_velocity, combine, components, fly, turned
from springgym.rigid.solid import Motion, Solid, State

SWEEPS = 40
"""How often the particles are taken in turn, at the most. Where that is too seldom, the next step goes on
from there: what stays in touch finds its balance over some steps."""

AGREED = 1e-9
"""Change of the particles' ways by the last sweep, as a share of Δ, at which the impulses are found."""

SURFACES = 7
"""How many surfaces there may be. For each the workspace has `ARRAYS` arrays, a row a particle:"""

PUSH, RUB, NORMAL, ARM = range(4)
"""(impulse [N·s], J/A [N·s], 0) along n; friction [N·s], n and the arm of both, in body axes."""

ARRAYS = 4

LOADS = ARRAYS * SURFACES
"""The array behind them has force and torque of the actuators as its first rows."""


class RigidNode(NamedTuple):
    """A node of a rigid body, and what all but the surfaces makes of it."""

    span: Span
    """its time"""
    begin: State
    """half a step before"""
    state: State
    """with which it is reached"""
    axes: Block
    """the principal axes there, in world coordinates"""
    before: Motion
    """the motion with which it is reached"""
    rate: Motion
    """change of motion by gravity [1/s]"""
    thrown: Motion
    """change of motion by actuators"""
    free: Motion
    """the motion after it without surfaces"""
    falling: Vector
    """the velocity after it without surfaces and actuators, in world coordinates [m/s]"""


class SoFar(NamedTuple):
    """What is found so far of a particle at a surface."""

    way: tuple[Vector, Vector]
    """where the particle is at both ends of the flights [m]"""
    given: Motion
    """change of motion by surfaces"""
    after: Motion
    """the motion that the second flight began with"""
    going: Mask
    """where impulses are still to change"""


# --- Motions ------------------------------------------------------------------------------------------


@compiled
def velocity_of(place: Vector, motion: Motion, solid: Solid) -> Vector:
    """Return the velocity of a particle."""
    return motion[0] + cross(angular_velocity(motion[1], solid.rigid), place)


@compiled
def pushed(motion: Motion, place: Vector, push: Vector, solid: Solid) -> Motion:
    """Return the motion after an impulse at a particle."""
    return plus_scaled(motion[0], solid.lightness, push), motion[1] + cross(place, push)


@compiled
def sum_of(one: Motion, scale: Number, other: Motion) -> Motion:
    """Return the sum of a motion and ``scale`` times another."""
    return plus_scaled(one[0], scale, other[0]), plus_scaled(one[1], scale, other[1])


@compiled
def product_of(one: Motion, other: Motion, solid: Solid) -> Number:
    """Return the product of two motions [J]: that of one with itself is twice its kinetic energy."""
    turning = dot(one[1], angular_velocity(other[1], solid.rigid))
    return solid.total * dot(one[0], other[0]) + turning


@compiled
def inverse_mass(arm: Vector, n: Vector, solid: Solid) -> Number:
    """Return the speed along n per impulse along n, for n of any length [1/kg]."""
    lever = cross(arm, n)
    return solid.lightness * dot(n, n) + dot(lever, angular_velocity(lever, solid.rigid)) + TINY


@compiled
def leave(node: RigidNode, given: Motion, solid: Solid) -> State:
    """Return the state half a step later, where surfaces change the motion by ``given``."""
    velocity = node.falling + combine(node.axes, node.thrown[0] + given[0])
    state = State(node.state.q, node.free[1] + given[1], node.state.position, velocity)
    return fly(state, node.span.out, solid.rigid, solid.asymmetry)


# --- Surfaces -----------------------------------------------------------------------------------------


@compiled
def place_of(i: int, state: State, axes: Block, solid: Solid) -> Vector:
    """Return the position of a particle."""
    return state.position + combine(axes, row(solid.rigid.shape, i))


@compiled
def clearance(state: State, solid: Solid) -> Number:
    """Return the least height of a particle above a surface, less Δ [m]."""
    particles, surfaces = solid.terms.particles, solid.terms.surfaces
    axes = turned(solid.axes, state.q)
    least = 1.0 + 0.0 * state.q[0]
    for i in range(particles.mass.size):
        if particles.free[i]:
            place = place_of(i, state, axes, solid)
            least = minimum(least, lowest(place, surfaces) - surfaces.reach)
    return least


@compiled
def energy_in_barriers(state: State, solid: Solid) -> Number:
    """Return the energy of the particles in the barriers of all surfaces [J]."""
    particles = solid.terms.particles
    axes = turned(solid.axes, state.q)
    energy = 0.0 * state.q[0]
    for i in range(particles.mass.size):
        if particles.free[i]:
            place = place_of(i, state, axes, solid)
            energy = energy + energy_at(place, solid.terms.surfaces)
    return energy


@compiled
def warm_start(given: Motion, known: Mask, workspace: np.ndarray, solid: Solid) -> Motion:
    """Add the impulses of the node before to a motion, where they are ``known``; elsewhere they are 0."""
    nothing = 0.0 * given[0]
    for k in range(count(solid.terms.surfaces.kinds)):
        for i in range(solid.terms.particles.mass.size):
            push = choose(known, row(workspace[ARRAYS * k + PUSH], i), nothing)
            rub = choose(known, row(workspace[ARRAYS * k + RUB], i), nothing)
            n = choose(known, row(workspace[ARRAYS * k + NORMAL], i), nothing)
            arm = choose(known, row(workspace[ARRAYS * k + ARM], i), nothing)
            set_row(workspace[ARRAYS * k + PUSH], i, push)
            set_row(workspace[ARRAYS * k + RUB], i, rub)
            set_row(workspace[ARRAYS * k + NORMAL], i, n)
            set_row(workspace[ARRAYS * k + ARM], i, arm)
            given = pushed(given, arm, plus_scaled(rub, push[0], n), solid)
    return given


@compiled
def meet_surfaces(
    node: RigidNode, known: Mask, active: Number, workspace: np.ndarray, solid: Solid
) -> Motion:
    """Return what surfaces and friction change of the motion where ``active`` is 1."""
    _, reach = strength_and_reach(solid.terms.surfaces)
    nothing = 0.0 * node.before[0]
    given = warm_start((nothing, nothing), known, workspace, solid)
    enough = (AGREED + 64 * epsilon(nothing[0])) * reach
    start = turned(solid.axes, node.begin.q)
    for _ in range(SWEEPS):
        end = leave(node, given, solid)
        finish = turned(solid.axes, end.q)
        after, changed = sum_of(node.free, 1.0, given), nothing[0]
        for k in range(count(solid.terms.surfaces.kinds)):
            for i in range(solid.terms.particles.mass.size):
                if solid.terms.particles.free[i]:
                    way = (place_of(i, node.begin, start, solid), place_of(i, end, finish, solid))
                    rows = workspace[ARRAYS * k : ARRAYS * (k + 1)]
                    sofar = SoFar(way, given, after, active > 0.5)
                    given, change = touch(i, k, sofar, node, rows, solid)
                    changed = maximum(changed, change)
        active = select(changed > enough, active, 0.0)
        if not any_lane(active > 0.5):
            break
    return given


@compiled
def straight(n: Vector, arm: Vector, node: RigidNode, after: Motion, solid: Solid) -> Number:
    """Return the way along n of a particle that flies straight, with its velocities at the node."""
    way = node.span.lead * dot(n, velocity_of(arm, node.before, solid))
    return way + node.span.out * dot(n, velocity_of(arm, after, solid))


@compiled
def touch(
    i: int, k: int, sofar: SoFar, node: RigidNode, workspace: np.ndarray, solid: Solid
) -> tuple[Motion, Number]:
    """Find anew what surface ``k`` gives particle ``i``.

    Returns the change of motion, and that of the particle's way [m].
    """
    way, given, after, going = sofar
    span = node.span
    strength, reach = strength_and_reach(solid.terms.surfaces)
    normal, _, start = facing(k, way[0], way[1], solid.terms.surfaces)
    own, rubbed = row(workspace[PUSH], i), row(workspace[RUB], i)
    gone = dot(normal, way[1] - way[0])
    near = minimum(minimum(start, start + gone) - reach, -1.0 * own[0])
    if not any_lane(near < 0.0):
        return given, 0.0 * start
    n = components(node.axes, normal)
    # Where the way along n is exactly that of the mean velocity: the work is then that of the barrier.
    arm = 0.5 * (way[0] + way[1]) - node.state.position
    arm = components(node.axes, arm)
    curve = gone - straight(n, arm, node, after, solid)
    lever = cross(n, angular_velocity(node.before[1] + after[1], solid.rigid))
    lever = 0.5 * span.whole * lever
    arm = plus_scaled(arm, curve / (dot(lever, lever) + (curve / reach) * (curve / reach) + TINY), lever)
    a = inverse_mass(arm, n, solid)
    old, at = row(workspace[NORMAL], i), row(workspace[ARM], i)
    others = pushed(given, at, -1.0 * plus_scaled(rubbed, own[0], old), solid)
    rub = rubbed - dot(n, rubbed) / (dot(n, n) + TINY) * n
    others = pushed(others, arm, rub, solid)
    u = dot(n, velocity_of(arm, node.before, solid))
    s = dot(n, velocity_of(arm, sum_of(node.free, 1.0, others), solid)) - u
    u = u + (gone - straight(n, arm, node, after, solid)) / span.whole
    ahead = start + (span.whole * u + span.out * s)
    touching = maximum(near, minimum(start, ahead) - reach) < 0.0
    none = 0.0 * u
    nothing = vec(none, none, none)
    beta, mu = coefficient(solid.terms.loss, none), coefficient(solid.terms.friction, none)
    gain, impulse = meet(start, ahead, span, strength * a, reach, beta, touching)
    push = choose(touching, 1.0 / a * vec(gain, impulse, none), nothing)
    others = pushed(others, arm, push[0] * n, solid)
    rub, others, slowed = stick(n, arm, rub, mu * maximum(push[0], 0.0), others, node, solid)
    change = span.whole * (slowed + a * maximum(push[0] - own[0], own[0] - push[0]))
    change = select(going, change, 0.0)
    given = choose(going, others[0], given[0]), choose(going, others[1], given[1])
    set_row(workspace[PUSH], i, choose(going, push, own))
    set_row(workspace[RUB], i, choose(going, choose(touching, rub, nothing), rubbed))
    set_row(workspace[NORMAL], i, choose(going, n, old))
    set_row(workspace[ARM], i, choose(going, arm, at))
    return given, change


@compiled
def stick(
    n: Vector, arm: Vector, old: Vector, limit: Number, given: Motion, node: RigidNode, solid: Solid
) -> tuple[Vector, Motion, Number]:
    """Return friction that stops a particle along a surface or, at its limit, works against its motion.

    ``old`` is the friction that is in the motion already. With the new one come the change of motion, and
    that of the particle's speed.
    """
    slip = velocity_of(arm, sum_of(node.free, 1.0, given), solid)
    slip = slip - dot(n, slip) / (dot(n, n) + TINY) * n
    a = inverse_mass(arm, 1.0 / sqrt(dot(slip, slip) + TINY) * slip, solid)
    new = within_cone(old - 1.0 / a * slip, limit)
    change = new - old
    return new, pushed(given, arm, change, solid), a * sqrt(dot(change, change))
