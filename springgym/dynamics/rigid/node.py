"""Rigid bodies in a step in which they may touch something, see `springgym.dynamics.step`.

A body flies freely for half a step (`springgym.dynamics.rigid.flight`), to the node. There it receives the
impulses of gravity, actuators and contact, and then it flies freely for the other half.

A step begins by reading position, attitude and momenta off the particles, so that results are bit-identical
for calls of any length. Contacts are found from the particles, solved like those of springs
(`springgym.dynamics.contact.solver`), and turn each body as one.

Flights are curved. The gaps at surfaces at the end of a step are first those of flights without contact, and
then, by iteration, those of flights with the current impulses. A particle gets its impulse at the arm r for
which the mean velocity along n is the displacement over the time: its work is then that of the barrier.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, NamedTuple

import numpy as np

from springgym.core.compiler.decorators import compiled
from springgym.core.language.bodies import all_rows, bodies_of, first_row, of_body
from springgym.core.language.kinds import Block, Mask, Number, Rows, Vector
from springgym.core.language.lanes import any_lane, epsilon, maximum, select
from springgym.core.language.memory import load, store
from springgym.core.language.vectors import apply, choose, cross, dot, plus_scaled, row, set_row, vec
from springgym.dynamics.arrays import of_copies
from springgym.dynamics.contact.ground import Grounded, ahead_of, find_ground
from springgym.dynamics.contact.movers import spin, velocity_between
from springgym.dynamics.contact.round import Way
from springgym.dynamics.contact.solver import prepare_row, reach_of, solve
from springgym.dynamics.forces.ledger import LedgerEntry, record
from springgym.dynamics.methods.node import record_losses
from springgym.dynamics.records import MOST_ITERATED, ContactCount, Problem, RowSpace, Surfaces, Times
from springgym.dynamics.rigid.body import read_state, set_particles
from springgym.dynamics.rigid.flight import angular_velocity, combine, fly, turned
from springgym.dynamics.rigid.kick import load_of_actuators, weight
from springgym.dynamics.rigid.solid import Motion, Rigid, Solid, State, Twin
from springgym.dynamics.step import Bodies, Kind
from springgym.dynamics.terms import Thrust, Wrench

SWEEPS = 80
"""Largest number of sweeps in an iteration. If it does not suffice, the next step continues from the
impulses."""

FLIGHTS = 40
"""Largest number of iterations, which find flights and impulses from each other. If it does not suffice, the
next step continues from the impulses."""

AGREED = 1e-9
"""Sweeps and iterations end when one changes no gap by more than this fraction of Δ."""

FEW = 4
"""Largest number of sweeps in an iteration, and of iterations, with more than `MOST_ITERATED` bodies in a
scene. The next node continues from their impulses (`springgym.dynamics.contact.warm`). If sweeps ended at
1e-3 Δ instead, their error would differ from node to node and shake a pile."""

STILL = 1e-3
"""Rotation of a body in a step, over Δ [rad/m], below which `look_ahead` moves no lever arm. Paths are then
curved by less than 1e-10 Δ. The quotient of this curve and the rotation is rounding, and would shake bodies
at rest."""


class BodyRow(IntEnum):
    """Rows of a body at the node: its `State` and `Solid`."""

    AXES = 0
    """the first of the three principal axes, a row each"""
    MOMENTUM = 3
    POSITION = 4
    VELOCITY = 5
    CENTRE = 6
    MASS = 7
    """mass, 1/mass and 0"""


BODY_ROWS = BodyRow.MASS + 1


class RigidNode(NamedTuple):
    """A rigid body at a node, and its motion after it without contact."""

    span: Times
    """the times of the node"""
    state: State
    """the state at the node"""
    axes: Block
    """the principal axes at the node, in world coordinates"""
    before: Motion
    """the motion before the node"""
    rate: Motion
    """change of motion by gravity [1/s]"""
    thrown: Motion
    """change of motion by actuators"""
    free: Motion
    """the motion after the node without contact"""
    falling: Vector
    """the velocity after the node without contact and actuators, in world coordinates [m/s]"""


class Workspace(NamedTuple):
    """The arrays in which a thread computes rigid bodies."""

    bodies: Annotated[np.ndarray, of_copies("bodies", BODY_ROWS, 3)]
    """the state of each body at the node, by `BodyRow`"""
    loads: Annotated[np.ndarray, of_copies("bodies", 2, 3)]
    """force and torque of the actuators, in body coordinates"""
    begin: Annotated[Rows, of_copies("particles", 3)]
    """positions of all particles where the step begins [m]"""
    here: Annotated[Rows, of_copies("particles", 3)]
    """positions at the node [m]"""
    end: Annotated[Rows, of_copies("particles", 3)]
    """positions at the end of the step, with the current impulses [m]"""
    idle: Annotated[Rows, of_copies("particles", 3)]
    """workspace"""
    rows: RowSpace
    """the workspace of contacts"""


# --- A body ---------------------------------------------------------------------------------------------


@compiled
def sum_of(one: Motion, scale: Number, other: Motion) -> Motion:
    """Return the sum of a motion and ``scale`` times another."""
    return plus_scaled(one[0], scale, other[0]), plus_scaled(one[1], scale, other[1])


@compiled
def product_of(one: Motion, other: Motion, solid: Solid) -> Number:
    """Return the product of two motions [J]: that of a motion with itself is twice its kinetic energy."""
    turning = dot(one[1], angular_velocity(other[1], solid.rigid))
    return solid.total * dot(one[0], other[0]) + turning


@compiled
def state_after(node: RigidNode, given: Motion, solid: Solid) -> State:
    """Return the state half a step after the node, where contact changed the motion by ``given``."""
    velocity = node.falling + combine(node.axes, node.thrown[0] + given[0])
    state = State(node.state.q, node.free[1] + given[1], node.state.position, velocity)
    return fly(state, node.span.out, solid.rigid, solid.asymmetry)


@compiled
def inverse_inertia(axes: Block, rigid: Rigid) -> tuple[Vector, Vector]:
    """Return I⁻¹ in world coordinates, given the principal axes: xx, yy, zz; xy, xz, yz.

    It is 0 for a body that cannot turn.
    """
    zero = 0.0 * axes[0][0]
    diagonal = vec(zero, zero, zero)
    across = vec(zero, zero, zero)
    if rigid.turns:
        for n in range(3):
            e = axes[n]
            inverse = 1.0 / load(rigid.moments, n)
            diagonal = plus_scaled(diagonal, inverse, vec(e[0] * e[0], e[1] * e[1], e[2] * e[2]))
            across = plus_scaled(across, inverse, vec(e[0] * e[1], e[0] * e[2], e[1] * e[2]))
    return diagonal, across


@compiled
def set_loads(b: Rows, q: Vector, solid: Solid, wrench: Wrench | None, thrust: Thrust | None) -> None:
    """Set the first rows of ``b`` to force and torque of the actuators, in body coordinates."""
    if wrench is not None or thrust is not None:
        force, torque = load_of_actuators(q, solid, wrench, thrust)
        set_row(b, 0, force)
        set_row(b, 1, torque)


@compiled
def thrown_by(b: Rows, tau: Number, solid: Solid, wrench: Wrench | None, thrust: Thrust | None) -> Motion:
    """Return the change of motion by actuators in ``tau`` seconds."""
    nothing = 0.0 * tau * solid.centre
    if wrench is None and thrust is None:
        return nothing, nothing
    return plus_scaled(nothing, tau * solid.lightness, row(b, 0)), plus_scaled(nothing, tau, row(b, 1))


@compiled
def reach_node(state: State, span: Times, b: Rows, solid: Solid) -> RigidNode:
    """Return the node of a body; ``b`` is set by `set_loads`."""
    axes = turned(solid.axes, state.q)
    before = (apply(axes, state.velocity), state.momentum)
    twist, push = weight(state.q, 1.0, solid.terms.gravity, solid)
    rate = (solid.lightness * apply(axes, push), twist)
    thrown = thrown_by(b, span.whole, solid, solid.terms.wrench, solid.terms.thrust)
    soon = sum_of(sum_of(before, span.whole, rate), 1.0, thrown)
    falling = plus_scaled(state.velocity, span.whole * solid.lightness, push)
    return RigidNode(span, state, axes, before, rate, thrown, soon, falling)


@compiled
def keep_state(state: State, solid: Solid, rows: Rows) -> None:
    """Store the state and the `Solid` of a body at the node."""
    axes = turned(solid.axes, state.q)
    for n in range(3):
        set_row(rows, BodyRow.AXES + n, axes[n])
    set_row(rows, BodyRow.MOMENTUM, state.momentum)
    set_row(rows, BodyRow.POSITION, state.position)
    set_row(rows, BodyRow.VELOCITY, state.velocity)
    set_row(rows, BodyRow.CENTRE, solid.centre)
    set_row(rows, BodyRow.MASS, vec(solid.total, solid.lightness, 0.0 * solid.total))


@compiled
def kept_state(rows: Rows, twin: Twin) -> tuple[State, Solid]:
    """Return the stored `State` of a body at the node, and its `Solid`."""
    rigid, asymmetry, terms = twin
    mass = row(rows, BodyRow.MASS)
    zero = 0.0 * mass[0]
    axes = (row(rows, BodyRow.AXES), row(rows, BodyRow.AXES + 1), row(rows, BodyRow.AXES + 2))
    solid = Solid(rigid, asymmetry, axes, row(rows, BodyRow.CENTRE), mass[0], mass[1], terms)
    q = (1.0 + zero, zero, zero, zero)
    return State(
        q, row(rows, BodyRow.MOMENTUM), row(rows, BodyRow.POSITION), row(rows, BodyRow.VELOCITY)
    ), solid


@compiled
def node_of(body: int, span: Times, space: Workspace, twin: Twin) -> tuple[RigidNode, Solid]:
    """Return the `RigidNode` of a body, and its `Solid`."""
    state, solid = kept_state(space.bodies[body], twin)
    return reach_node(state, span, space.loads[body], solid), solid


@compiled
def arrive(body: int, bodies: Bodies, span: Times) -> None:
    """Fly a body to the node, and compute its motion after it without contact."""
    x = of_body(bodies.x, body)
    v = of_body(bodies.v, body)
    twin = of_body(bodies.twins, body)
    rigid, asymmetry, terms = twin
    space = bodies.space
    rows = space.rows
    kept = space.bodies[body]
    b = space.loads[body]
    turning = rows.contacts.turning
    first = first_row(bodies.x, body)
    behind = first + x.shape[0]
    count = bodies_of(bodies.x)
    zero = 0.0 * span.out
    nothing = vec(zero, zero, zero)
    if not rigid.moves:
        for i in range(x.shape[0]):
            for of in (space.begin, space.here, space.end):
                set_row(of, first + i, row(x, i))
            set_row(space.idle, first + i, nothing)
        for n in range(2 * body, 2 * body + 2):
            for of in (rows.before, rows.free, rows.velocity, turning.turn):
                set_row(of, n, nothing)
            set_row(turning.turn, n + 2 * count, nothing)
        store(turning.lightness, body, zero)
        set_row(turning.point, body, row(x, 0))
        set_row(turning.point, body + count, row(x, 0))
        return
    for i in range(x.shape[0]):
        set_row(space.begin, first + i, row(x, i))
    start, seen = read_state(x, v, rigid, asymmetry, terms)
    state = fly(start, span.lead, rigid, asymmetry)
    set_particles(space.here[first:behind], space.idle[first:behind], state, seen)
    keep_state(state, seen, kept)
    there, solid = kept_state(kept, twin)
    set_loads(b, there.q, solid, terms.wrench, terms.thrust)
    node = reach_node(there, span, b, solid)
    store(turning.lightness, body, solid.lightness)
    set_row(turning.point, body, state.position)
    set_turn(body, 0, solid.axes, space, rigid)
    velocity = node.falling + combine(solid.axes, node.thrown[0])
    momentum = combine(solid.axes, node.free[1])
    set_row(rows.before, 2 * body, state.velocity)
    set_row(rows.before, 2 * body + 1, combine(solid.axes, state.momentum))
    for of in (rows.free, rows.velocity):
        set_row(of, 2 * body, velocity)
        set_row(of, 2 * body + 1, momentum)


@compiled
def set_turn(body: int, at_end: int, axes: Block, space: Workspace, rigid: Rigid) -> None:
    """Set I⁻¹ of a body at the node or, if ``at_end`` is 1, at the end of the step."""
    turning = space.rows.contacts.turning
    diagonal, across = inverse_inertia(axes, rigid)
    n = 2 * (body + at_end * turning.turns.size)
    set_row(turning.turn, n, diagonal)
    set_row(turning.turn, n + 1, across)


@compiled
def change_by_contact(body: int, node: RigidNode, space: Workspace) -> Motion:
    """Return the change of a body's motion by the current impulses of contact."""
    rows = space.rows
    n = 2 * body
    faster = row(rows.velocity, n) - row(rows.free, n)
    return apply(node.axes, faster), apply(node.axes, row(rows.velocity, n + 1) - row(rows.free, n + 1))


@compiled
def fly_on(body: int, bodies: Bodies, span: Times, space: Workspace, twin: Twin) -> None:
    """Compute the end of a body's flight with the current impulses."""
    if twin[0].moves:
        node, solid = node_of(body, span, space, twin)
        end = state_after(node, change_by_contact(body, node, space), solid)
        first = first_row(bodies.x, body)
        behind = first + solid.terms.particles.mass.size
        set_particles(space.end[first:behind], space.idle[first:behind], end, solid)
        turning = space.rows.contacts.turning
        set_row(turning.point, body + turning.turns.size, end.position)
        set_turn(body, 1, turned(solid.axes, end.q), space, twin[0])


@compiled
def grounded(body: int, bodies: Bodies) -> Grounded:
    """Return a body in the form that `find_ground` takes."""
    space = bodies.space
    terms = of_body(bodies.terms, body)
    first = first_row(bodies.x, body)
    behind = first + terms.particles.mass.size
    begin = Way(space.begin[first:behind], None, 0.0)
    end = Way(space.end[first:behind], None, 0.0)
    pair = terms.collisions.pairs.among + body
    here = space.here[first:behind]
    free = terms.particles.free
    return Grounded(pair, body, first, here, begin, end, free, terms.surfaces, space.rows.contacts)


# --- The node -------------------------------------------------------------------------------------------


@compiled
def keep_workspace(body: int, bodies: Bodies) -> None:
    """Do nothing: the workspace of a rigid body is set anew in each step."""


@compiled
def at_node(bodies: Bodies, placed: bool) -> tuple[Rows, Rows]:
    """Return positions and velocities of all particles: at the node, or where they were ``placed``."""
    here = bodies.space.here
    speeds = bodies.space.idle
    if placed:
        x = all_rows(bodies.x)
        v = all_rows(bodies.v)
        for i in range(x.shape[0]):
            set_row(here, i, row(x, i))
            set_row(speeds, i, row(v, i))
    return here, speeds


@compiled
def find_at_surfaces(body: int, bodies: Bodies, span: Times) -> None:
    """List the contacts of a body with surfaces, given its flight without contact."""
    list_ground(body, bodies, span, bodies.terms.surfaces)


@compiled
def list_ground(body: int, bodies: Bodies, span: Times, surfaces: Surfaces | None) -> None:
    """List the contacts of a body with surfaces, if there are any."""
    twin = of_body(bodies.twins, body)
    if surfaces is not None and twin[0].moves:
        fly_on(body, bodies, span, bodies.space, twin)
        contacts = bodies.space.rows.contacts
        own = grounded(body, bodies)
        contacts.length[ContactCount.ROWS] = find_ground(
            contacts.length[ContactCount.ROWS], own, twin[2].rounds
        )


@compiled
def stay_joined(bodies: Bodies, span: Times, problem: Problem, between: int) -> None:
    """Do nothing: rigid bodies arrive in the form of contacts."""


@compiled
def find_impulses(bodies: Bodies, span: Times, problem: Problem, between: int) -> None:
    """Find all impulses; at surfaces, iterate them with the flights that follow from them."""
    iterate_flights(bodies, span, problem, between, bodies.terms.surfaces)


@compiled
def iterate_flights(
    bodies: Bodies, span: Times, problem: Problem, between: int, surfaces: Surfaces | None
) -> None:
    """Find all impulses, and with ``surfaces`` the flights that follow from them, from each other."""
    space = bodies.space
    contacts = space.rows.contacts
    going = 1.0 + 0.0 * span.out
    enough = AGREED + 64 * epsilon(going)
    sweeps, flights = (SWEEPS, FLIGHTS) if bodies_of(bodies.x) <= MOST_ITERATED else (FEW, FEW)
    for turn in range(1 if surfaces is None or contacts.length[ContactCount.ROWS] == between else flights):
        store(contacts.going, 0, going)
        solve(space.rows.velocity, sweeps, enough, turn == 0, problem)
        if surfaces is not None and turn < flights - 1 and contacts.length[ContactCount.ROWS] > between:
            for body in range(bodies_of(bodies.x)):
                fly_on(body, bodies, span, space, of_body(bodies.twins, body))
            moved = 0.0 * span.out
            for k in range(between, contacts.length[ContactCount.ROWS]):
                own = grounded(contacts.body[2 * k], bodies)
                ahead = ahead_of(k, own, of_body(bodies.twins, contacts.body[2 * k])[2].rounds)
                moved = maximum(moved, look_ahead(k, going > 0.5, ahead, space.rows.velocity, problem))
            going = select(moved > enough, going, 0.0)
            if not any_lane(going > 0.5):
                break


@compiled
def look_ahead(k: int, going: Mask, ahead: Number, v: Rows, problem: Problem) -> Number:
    """Set the gap of contact k with a surface to ``ahead``, where flights now end, in copies ``going``.

    Its arm is moved to where the mean velocity gives the same displacement. Return the change of the gap,
    over Δ, where the contact has an impulse.
    """
    contacts = problem.contacts
    span = problem.span
    turning = problem.contacts.turning
    body = contacts.body[2 * k]
    n = row(contacts.normal, k)
    arm = row(contacts.arm, 4 * k)
    before = load(contacts.start, k) - load(contacts.shift, k)
    impulse = load(contacts.impulse, k)
    u0 = dot(n, velocity_between(problem.before, k, 0, problem))
    u1 = dot(n, velocity_between(v, k, 0, problem))
    off = ahead + load(contacts.shift, k) - (load(contacts.gap, k) + span.out * u1)
    if contacts.feature[k] < 0:
        curve = (ahead - before) - (span.lead * u0 + span.out * u1)
        both = spin(problem.before, body, 0, turning) + spin(v, body, 0, turning)
        lever = 0.5 * span.whole * cross(n, both)
        reach = reach_of(k, problem)
        least = (curve / reach) * (curve / reach) + (STILL * reach) * (STILL * reach)
        more = curve / (dot(lever, lever) + least) * lever
        more = choose(select(going, impulse, 0.0) > 0.0, more, 0.0 * more)
        set_row(contacts.arm, 4 * k, arm + more)
        moment = row(v, 2 * body + 1) + cross(more, impulse * n + row(contacts.friction, k))
        set_row(v, 2 * body + 1, moment)
        store(contacts.inverse_mass, k, prepare_row(k, problem))
        store(contacts.approach, k, dot(n, velocity_between(problem.before, k, 0, problem)))
    u1 = dot(n, velocity_between(v, k, 0, problem))
    gap = ahead + load(contacts.shift, k) - span.out * u1
    store(contacts.gap, k, select(going, gap, load(contacts.gap, k)))
    return select(select(going, impulse, 0.0) > 0.0, maximum(off, -1.0 * off) / reach_of(k, problem), 0.0)


@compiled
def leave(body: int, bodies: Bodies, span: Times) -> None:
    """Fly a body on to the end of the step, and record the actuators' work and the losses in contact."""
    space = bodies.space
    ledger = of_body(bodies.ledger, body)
    twin = of_body(bodies.twins, body)
    if twin[0].moves:
        node, solid = node_of(body, span, space, twin)
        change = change_by_contact(body, node, space)
        middle = sum_of(sum_of(node.before, span.lead, node.rate), 0.5, sum_of(node.thrown, 1.0, change))
        record(ledger, LedgerEntry.WORK, product_of(node.thrown, middle, solid))
        x = of_body(bodies.x, body)
        v = of_body(bodies.v, body)
        set_particles(x, v, state_after(node, change, solid), solid)
    record_losses(body, ledger, space.rows.contacts)


RIGID = Kind(keep_workspace, arrive, leave, at_node, find_at_surfaces, stay_joined, find_impulses)
"""Rigid bodies whose contacts are solved together."""
