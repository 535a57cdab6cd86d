"""Rigid bodies that roll: what surfaces give them by round features, see `springgym.contact.round`.

A body is told by its particles, which keep their shape: at the node, and where its flights begin and end.
What it is given is summed up as a change of its motion,

    δv = Σ p/M,    δL = Σ r × p,

with which it flies on.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.contact.records import Resistance, Rolling, Rounds
from springgym.contact.round import Carrier, RoundProblem, arm, roll
from springgym.contact.surfaces import count
from springgym.core.compiling import compiled
from springgym.core.kinds import Rows, Vector
from springgym.core.lanes import load
from springgym.core.vectors import cross, plus_scaled, row, set_row, vec
from springgym.integrators.envelope import Block
from springgym.rigid.flight import angular_velocity, combine, components, turned
from springgym.rigid.solid import Motion, Rigid, Solid, State
from springgym.rigid.surfaces import RigidNode, leave, place_of, pushed

FEATURES = len(Rolling._fields)
"""Number of arrays in a `Rolling`."""

PLACES, BEFORE, BEGIN, END, LEAVING = range(FEATURES, FEATURES + 5)
"""Indices of the arrays behind them, of rows of particles (N, 3): positions [m] and velocities [m/s] with
which the node is reached; positions where the step begins, and where it would end without contact; and the
velocities there, with the impulses found so far."""

ROOM = FEATURES + 5
"""Number of all these arrays."""


class GivenByRows(NamedTuple):
    """What surfaces give a body at its round features, as changes of its motion."""

    change: Motion
    """by pushes"""
    rub: Motion
    """by friction"""
    force: Motion
    """by Σ J n, as of `springgym.contact.records.Given`"""


@compiled
def rolling_of(workspace: np.ndarray) -> Rolling:
    """Return the arrays of a body's workspace in which its features roll."""
    return Rolling(
        workspace[0],
        workspace[1],
        workspace[2],
        workspace[3],
        workspace[4],
        workspace[5],
        workspace[6],
        workspace[7],
        workspace[8],
        workspace[9],
    )


@compiled
def set_places(rows: Rows, state: State, solid: Solid) -> None:
    """Set rows to the positions of the particles."""
    axes = turned(solid.axes, state.q)
    for i in range(solid.terms.particles.mass.size):
        set_row(rows, i, place_of(i, state, axes, solid))


@compiled
def set_velocities(rows: Rows, velocity: Vector, spin: Vector, axes: Block, solid: Solid) -> None:
    """Set rows to the velocities of the particles, from that of the body's point and the angular momentum in
    body coordinates."""
    omega = combine(axes, angular_velocity(spin, solid.rigid))
    for i in range(solid.terms.particles.mass.size):
        set_row(rows, i, velocity + cross(omega, combine(axes, row(solid.rigid.shape, i))))


@compiled
def inverse_inertia(axes: Block, rigid: Rigid) -> tuple[Vector, Vector]:
    """Return I⁻¹ in world coordinates, given the principal axes: xx, yy, zz; xy, xz, yz.

    It is 0 of what cannot turn.
    """
    zero = 0.0 * axes[0][0]
    diagonal, across = vec(zero, zero, zero), vec(zero, zero, zero)
    if rigid.turns:
        for n in range(3):
            e, inverse = axes[n], 1.0 / load(rigid.moments, n)
            diagonal = plus_scaled(diagonal, inverse, vec(e[0] * e[0], e[1] * e[1], e[2] * e[2]))
            across = plus_scaled(across, inverse, vec(e[0] * e[1], e[0] * e[2], e[1] * e[2]))
    return diagonal, across


@compiled
def problem_of(
    node: RigidNode, end: State, workspace: np.ndarray, solid: Solid, rounds: Rounds
) -> RoundProblem:
    """Return what the impulses of a body's round features follow from; without contact the step would ``end``
    like that."""
    carrier = Carrier(
        workspace[BEGIN],
        workspace[END],
        workspace[LEAVING],
        solid.lightness,
        node.state.position,
        inverse_inertia(node.axes, solid.rigid),
        end.position,
        inverse_inertia(turned(solid.axes, end.q), solid.rigid),
    )
    rolling = rolling_of(workspace)
    return RoundProblem(
        workspace[PLACES], workspace[BEFORE], node.span, rolling, rounds, solid.terms, carrier
    )


@compiled
def roll_on_surfaces(node: RigidNode, workspace: np.ndarray, solid: Solid, rounds: Rounds | None) -> Motion:
    """Return what surfaces and friction change of a body's motion by its round features, if it has any."""
    nothing = 0.0 * node.before[0]
    if rounds is None:
        return nothing, nothing
    end = leave(node, (nothing, nothing), solid)
    problem = problem_of(node, end, workspace, solid, rounds)
    set_places(problem.x, node.state, solid)
    set_places(workspace[BEGIN], node.begin, solid)
    set_places(workspace[END], end, solid)
    before, free = combine(node.axes, node.before[0]), combine(node.axes, node.free[0])
    set_velocities(problem.before, before, node.before[1], node.axes, solid)
    set_velocities(problem.space.velocity, free, node.free[1], node.axes, solid)
    set_velocities(workspace[LEAVING], end.velocity, end.spin, turned(solid.axes, end.q), solid)
    roll(problem, False)
    given = given_by_rows(node, problem, solid)
    return given.change[0] + given.rub[0], given.change[1] + given.rub[1]


@compiled
def twisted(motion: Motion, couple: Vector, resistance: Resistance | None) -> Motion:
    """Return the motion after the angular impulse of a couple, if the scene has resistance."""
    if resistance is None:
        return motion
    return motion[0], motion[1] + couple


@compiled
def given_by_rows(node: RigidNode, problem: RoundProblem, solid: Solid) -> GivenByRows:
    """Sum up what all rows of contact give a body."""
    space, kinds = problem.space, count(problem.terms.surfaces.kinds)
    nothing = 0.0 * node.before[0]
    change, rub, force = (nothing, nothing), (nothing, nothing), (nothing, nothing)
    for e in range(problem.rounds.first.size):
        for k in range(kinds):
            r = e * kinds + k
            place = components(node.axes, arm(e, row(space.point, r), problem, problem.carrier))
            n, push = components(node.axes, row(space.normal, r)), row(space.push, r)
            change = pushed(change, place, push[0] * n, solid)
            force = pushed(force, place, push[1] * n, solid)
            rub = pushed(rub, place, components(node.axes, row(space.friction, r)), solid)
            rub = twisted(rub, components(node.axes, row(space.couple, r)), solid.terms.resistance)
    return GivenByRows(change, rub, force)
