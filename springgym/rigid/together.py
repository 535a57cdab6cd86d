"""The node of a step where rigid bodies collide: all of them pass it together.

All impulses of a step act at once, at its node, as where springs hold bodies together
(`springgym.integrators.together`): contacts are found in the same way, from the particles of the bodies,
follow the same law and are told of alike. What differs is what they move (`springgym.contact.solids`).

Contacts of a rigid body all act on each other. They are taken in turns, surfaces first, then pairs of bodies
there and back with their friction, until the speeds of those between bodies agree (Gauss and Seidel);
surfaces have the last word.

Each step begins with the particles: position, attitude and momenta are read off them where the node is
reached. So calls of any length take the same steps, to the bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from springgym.contact.friction import SWEEPS, rub
from springgym.contact.lists import Lists
from springgym.contact.rows import ContactRows, Problem
from springgym.contact.search import find_contacts
from springgym.contact.solids import CHANGE, GOING
from springgym.contact.solver import add_totals, lift_apart, prepare, sweep, taper
from springgym.contact.totals import halve_totals, list_changing, remember_totals, resume_totals
from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Mask, Number, Rows, Vector
from springgym.core.lanes import any_lane, bodies_of, epsilon, load, maximum, minimum, of_body, select, store
from springgym.core.vectors import TINY, choose, plus_scaled, row, set_row, vec
from springgym.forces.ledger import CONTACT, WORK, record
from springgym.forces.memory import PHASE, STORED, halve, remember, resume, share_actions
from springgym.integrators.node import (
    PASSES,
    READS,
    START,
    STARTS,
    Node,
    node_at,
    record_losses,
    start_together,
    store_energy_of_pairs,
)
from springgym.integrators.record import Phase
from springgym.rigid.contact import (
    RigidNode,
    clearance,
    leave,
    meet_surfaces,
    product_of,
    reach_node,
    read_node,
    record_surface_losses,
    set_loads,
    sum_of,
)
from springgym.rigid.flight import Motion, State, combine, components, fly
from springgym.rigid.motion import Solid, Twin, read_state, set_particles

if TYPE_CHECKING:
    from springgym.contact.law import Span
    from springgym.contact.surfaces import Surfaces


TURNS = 40
"""How often surfaces and pairs are taken in turn, at the most. Where that is too seldom, the next step goes
on from there: what stays in touch finds its balance over some steps."""

AGREED = 1e-9
"""Change of the ways of contacts by the last turn, as a share of Δ, at which the impulses are found."""

AXES, SPIN, POSITION, VELOCITY, CENTRE, MASS, GIVEN, TURNED, NEAR = 0, 3, 4, 5, 6, 7, 8, 9, 10
"""Rows of a body at the node: its `State` and `Solid`, with 1 over its mass behind the mass; the change of
motion by surfaces; and its clearance half a step before, and 1 where surfaces were near in any turn."""

ROWS = 11


class Company(NamedTuple):
    """The arrays in which a thread computes rigid bodies that collide.

    If nothing else is said, they have shape (2 bodies, 3): a row for the velocity [m/s] and one for the
    angular momentum [kg·m²/s] of each body, in world coordinates.
    """

    bodies: np.ndarray
    """(bodies, `ROWS`, 3) the state of each body at the node, by rows from `AXES` to `NEAR`"""
    loads: np.ndarray
    """(bodies, N, 3) what actuators give particles, see `springgym.rigid.contact.set_loads`"""
    surfaces: np.ndarray
    """(bodies, arrays, N, 3) what surfaces give, as `springgym.rigid.contact` keeps it"""
    pushed: np.ndarray
    """(bodies,) whether surfaces gave a body anything at this node"""
    before: np.ndarray
    """the motion with which the node is reached"""
    free: np.ndarray
    """the motion after the node, but for contact"""
    velocity: np.ndarray
    """the motion after the node, with as much of contact as is known"""
    known: np.ndarray
    """this motion when surfaces had their last turn"""
    by_bodies: np.ndarray
    """change of motion that bodies gave each other until that turn"""
    shift: np.ndarray
    """how far bodies are lifted off others where a node is read [m]; the second row of each is 0"""
    changed: np.ndarray
    """(1,) 1 where bodies may have given each other more since that turn"""
    lists: Lists
    """the features that are near each other"""
    contacts: ContactRows
    """the contacts of the node"""


# --- A body ---------------------------------------------------------------------------------------------


@compiled
def keep_state(state: State, solid: Solid, rows: Rows) -> None:
    """Keep where a body is at the node and how it moves."""
    for n in range(3):
        set_row(rows, AXES + n, solid.axes[n])
    set_row(rows, SPIN, state.spin)
    set_row(rows, POSITION, state.position)
    set_row(rows, VELOCITY, state.velocity)
    set_row(rows, CENTRE, solid.centre)
    set_row(rows, MASS, vec(solid.total, solid.lightness, 0.0 * solid.total))


@compiled
def kept_state(rows: Rows, twin: Twin) -> tuple[State, Solid]:
    """Return the `State` of a body at the node, and its `Solid`; ``twin`` is what kernels take of a body."""
    rigid, asymmetry, terms = twin
    mass = row(rows, MASS)
    zero = 0.0 * mass[0]
    axes = (row(rows, AXES), row(rows, AXES + 1), row(rows, AXES + 2))
    solid = Solid(rigid, asymmetry, axes, row(rows, CENTRE), mass[0], mass[1], terms)
    q = (1.0 + zero, zero, zero, zero)
    return State(q, row(rows, SPIN), row(rows, POSITION), row(rows, VELOCITY)), solid


@compiled
def half_a_step_before(state: State, span: Span, solid: Solid, surfaces: Surfaces | None) -> State:
    """Return where the way of a body to the node began; surfaces alone ask for it."""
    if surfaces is not None:
        return fly(state, -1.0 * span.lead, solid.rigid, solid.asymmetry)
    return state


@compiled
def node_of(body: int, span: Span, space: Company, twin: Twin) -> tuple[RigidNode, Solid]:
    """Return the `RigidNode` of a body without contact, and its `Solid`."""
    state, solid = kept_state(space.bodies[body], twin)
    first = half_a_step_before(state, span, solid, solid.terms.surfaces)
    return reach_node(first, state, span, space.loads[body], solid), solid


@compiled
def pushed_by_pairs(node: RigidNode, body: int, space: Company) -> tuple[RigidNode, Motion]:
    """Return a node with what bodies give each other as a part of all that surfaces do not, and that part."""
    by_bodies = (
        components(node.axes, row(space.by_bodies, 2 * body)),
        components(node.axes, row(space.by_bodies, 2 * body + 1)),
    )
    falling = node.falling + row(space.by_bodies, 2 * body)
    soon = sum_of(node.free, 1.0, by_bodies)
    span, first, state, axes, before, rate, thrown, _, _ = node
    return RigidNode(span, first, state, axes, before, rate, thrown, soon, falling), by_bodies


@compiled
def near_surfaces(state: State, solid: Solid, surfaces: Surfaces | None) -> Number:
    """Return the `clearance` of a body, or 1 without surfaces."""
    if surfaces is not None:
        return clearance(state, solid)
    return 1.0 + 0.0 * state.q[0]


@compiled
def reach(body: int, all_bodies: Phase, node: Node, first: bool, space: Company, twin: Twin) -> None:
    """Read off how a body reaches the node, and find what all but contact gives it there."""
    x, v, ledger = of_body(all_bodies, body)
    rigid, asymmetry, terms = twin
    rows, b, solids = space.bodies[body], space.loads[body], space.contacts.solids
    zero, last = 0.0 * node.phase, node.stage == READS
    nothing = vec(zero, zero, zero)
    space.pushed[body] = False
    if not rigid.moves:
        set_row(space.velocity, 2 * body, nothing)
        set_row(space.velocity, 2 * body + 1, nothing)
        if last:
            remember(x, b, 1.0 + zero, ledger, terms.memory, terms.memory.pushed)
        return
    state, seen = read_state(x, v, rigid, asymmetry, terms)
    keep_state(state, seen, rows)
    set_loads(b, state.q, seen, terms.wrench, terms.thrust)
    if first:
        share_actions(b, node.phase, terms.memory, terms.memory.pushed, None)
    if last:
        remember(x, b, 1.0 + zero, ledger, terms.memory, terms.memory.pushed)
    reached, solid = node_of(body, node.span, space, twin)
    set_row(solids.point, body, state.position)
    store(solids.lightness, body, solid.lightness)
    turn = inverse_inertia(solid)
    set_row(solids.turn, 2 * body, turn[0])
    set_row(solids.turn, 2 * body + 1, turn[1])
    set_row(space.before, 2 * body, state.velocity)
    set_row(space.before, 2 * body + 1, combine(solid.axes, state.spin))
    velocity = reached.falling + combine(solid.axes, reached.thrown[0])
    spin = combine(solid.axes, reached.free[1])
    for part in range(2):
        soon = velocity if part == 0 else spin
        set_row(space.free, 2 * body + part, soon)
        set_row(space.velocity, 2 * body + part, soon)
        set_row(space.known, 2 * body + part, soon)
        set_row(space.by_bodies, 2 * body + part, nothing)
        set_row(rows, GIVEN + part, nothing)
    ahead = near_surfaces(reached.begin, solid, terms.surfaces)
    set_row(rows, NEAR, vec(ahead, zero, zero))


@compiled
def inverse_inertia(solid: Solid) -> tuple[Vector, Vector]:
    """Return I⁻¹ of a body, in world coordinates: xx, yy, zz; xy, xz, yz. It is 0 of what cannot turn."""
    zero = 0.0 * solid.total
    diagonal, across = vec(zero, zero, zero), vec(zero, zero, zero)
    if solid.rigid.turns:
        for n in range(3):
            e, inverse = solid.axes[n], 1.0 / load(solid.rigid.moments, n)
            diagonal = plus_scaled(diagonal, inverse, vec(e[0] * e[0], e[1] * e[1], e[2] * e[2]))
            across = plus_scaled(across, inverse, vec(e[0] * e[1], e[0] * e[2], e[1] * e[2]))
    return diagonal, across


# --- Contact --------------------------------------------------------------------------------------------


@compiled
def push_by_surfaces(body: int, span: Span, space: Company, twin: Twin) -> None:
    """Let surfaces give a body what follows from all else, bodies' pushes among it."""
    going = load(space.changed, 0) > 0.5
    for n in range(2 * body, 2 * body + 2):
        given = row(space.by_bodies, n) + (row(space.velocity, n) - row(space.known, n))
        set_row(space.by_bodies, n, choose(going, given, row(space.by_bodies, n)))
    ask_surfaces(body, span, going, space, twin, twin[2].surfaces)
    for n in range(2 * body, 2 * body + 2):
        set_row(space.known, n, row(space.velocity, n))


@compiled
def ask_surfaces(
    body: int,
    span: Span,
    going: Mask,
    space: Company,
    twin: Twin,
    surfaces: Surfaces | None,
) -> None:
    """Find what surfaces, if there are any, give a body in the copies that are ``going``."""
    if surfaces is not None:
        free, solid = node_of(body, span, space, twin)
        node, _ = pushed_by_pairs(free, body, space)
        rows, none = space.bodies[body], 0.0 * span.out
        nothing = 0.0 * node.before[0]
        ahead = near_surfaces(leave(node, (nothing, nothing), solid), solid, surfaces)
        near = row(rows, NEAR)
        close = select(minimum(near[0], ahead) < 0.0, 1.0 + none, near[1])
        set_row(rows, NEAR, vec(near[0], select(going, close, near[1]), none))
        active = select(going, close, 0.0)
        if any_lane(active > 0.5):
            known = active > (-1.0 if space.pushed[body] else 2.0)
            given = meet_surfaces(node, known, active, space.surfaces[body], solid)
            space.pushed[body] = True
            for part in range(2):
                new, old = given[part], row(rows, GIVEN + part)
                set_row(rows, GIVEN + part, choose(going, new, old))
        for part in range(2):
            n = 2 * body + part
            by_surfaces = combine(node.axes, row(rows, GIVEN + part))
            now = (row(space.free, n) + row(space.by_bodies, n)) + by_surfaces
            set_row(space.velocity, n, choose(going, now, row(space.velocity, n)))


@compiled
def takes_turns(contacts: Number, turn: int, surfaces: Surfaces | None) -> bool:
    """Return whether surfaces have a turn before the last one."""
    return surfaces is not None and contacts > 0 and turn < TURNS


@compiled
def find_impulses(problem: Problem, space: Company, twins: Twin) -> None:
    """Find what surfaces and bodies give at a node."""
    pairs, velocity, span = problem.pairs, space.velocity, problem.span
    turns, terms = problem.contacts.solids.turns, twins[2]
    one = 1.0 + 0.0 * span.out
    enough = AGREED + 64 * epsilon(one)
    store(turns, GOING, one)
    store(space.changed, 0, one)
    going, turn = problem.rows > 0, 0
    while True:
        last = not going or turn == TURNS
        if last or takes_turns(problem.rows, turn, terms.surfaces):
            for body in range(space.pushed.size):
                twin = of_body(twins, body)
                if twin[0].moves:
                    push_by_surfaces(body, span, space, twin)
            store(space.changed, 0, 0.0 * one)
        if last:
            break
        for back in range(2):
            store(turns, CHANGE, 0.0 * one)
            sweep(velocity, back == 1, problem)
            rub(velocity, back, problem, pairs.friction)
        if turn == 0:
            taper(velocity, problem, pairs.shapes.edges)
        active = load(turns, GOING)
        store(space.changed, 0, maximum(load(space.changed, 0), active))
        active = select(span.whole * load(turns, CHANGE) > enough, active, 0.0)
        store(turns, GOING, active)
        going = any_lane(active > 0.5)
        turn += 1
    if problem.rows > 0:
        store(turns, GOING, one)
        rub(velocity, SWEEPS, problem, pairs.friction)


# --- The node -------------------------------------------------------------------------------------------


@compiled
def leave_together(body: int, all_bodies: Phase, node: Node, space: Company, twin: Twin) -> None:
    """Let a body go on to the next node, and enter what it lost; or, at the ``last``, read it."""
    x, v, ledger = of_body(all_bodies, body)
    rigid, _, terms = twin
    span, last = node.span, node.stage == READS
    if not rigid.moves:
        if last:
            halve(ledger, terms.memory)
            store(terms.memory.marks, STORED, 0.0)
            for i in range(x.shape[0]):
                set_row(terms.memory.arrived, i, row(v, i))
        return
    free, solid = node_of(body, span, space, twin)
    passed, by_bodies = pushed_by_pairs(free, body, space)
    given = (row(space.bodies[body], GIVEN), row(space.bodies[body], TURNED))
    end = leave(passed, given, solid)
    middle = sum_of(sum_of(passed.before, span.lead, passed.rate), 0.5, passed.thrown)
    middle = sum_of(sum_of(middle, 0.5, by_bodies), 0.5, given)
    record(ledger, WORK, product_of(passed.thrown, middle, solid))
    if space.pushed[body]:
        record_pushes(passed, given, middle, ledger, space.surfaces[body], solid, terms.surfaces)
    enter_start(passed, by_bodies, middle, ledger, solid)
    if last:
        for i in range(x.shape[0]):
            set_row(terms.memory.arrived, i, row(v, i))
        shift = row(space.shift, 2 * body)
        read = read_node(free, end, sum_of(by_bodies, 1.0, given), shift, ledger, solid)
        set_particles(x, v, read, solid)
    else:
        state = fly(end, span.out, solid.rigid, solid.asymmetry)
        set_particles(x, v, state, solid)


@compiled
def record_pushes(
    node: RigidNode,
    given: Motion,
    middle: Motion,
    ledger: Ledger,
    rows: np.ndarray,
    solid: Solid,
    surfaces: Surfaces | None,
) -> None:
    """Enter what surfaces took, if there are any."""
    if surfaces is not None:
        record_surface_losses(node, given, middle, ledger, rows, solid)


@compiled
def enter_start(node: RigidNode, by_bodies: Motion, middle: Motion, ledger: Ledger, solid: Solid) -> None:
    """Enter, of the half node of a fresh copy, what bodies took from one body; what its barriers gave is
    entered for the pair.

    There they push against gravity before it acts, see `springgym.integrators.node.begun_in_touch`.
    """
    late = 0.5 * (node.span.out - node.span.lead)
    fallen, met = product_of(node.rate, by_bodies, solid), product_of(by_bodies, by_bodies, solid)
    rests = 2.0 * late * late * fallen * fallen / (met + TINY)
    lost = rests - product_of(by_bodies, middle, solid)
    record(ledger, CONTACT, select(late > 0.0, lost, 0.0))


@compiled
def pass_together(phase: Phase, node: Node, first: bool, space: Company, twins: Twin) -> None:
    """Let all act on all bodies at a node: `springgym.integrators.together.pass_together` of rigid bodies."""
    x, v, ledger = phase
    terms, last = twins[2], node.stage == READS
    collisions, contacts = terms.collisions, space.contacts
    found_in, inverse_mass = (space.lists, contacts), terms.particles.inverse_mass.values
    problem = find_contacts(x.values, v.values, space.before, inverse_mass, node.span, collisions, found_in)
    if node.stage == STARTS:
        start_together(collisions, terms.memory, node.phase, problem)
        return
    count = bodies_of(x)
    for body in range(count):
        reach(body, phase, node, first, space, of_body(twins, body))
    if last:
        remember_totals(collisions)
    list_changing(contacts, collisions.changing)
    prepare(problem, None)
    find_impulses(problem, space, twins)
    add_totals(space.velocity, problem, collisions.changing)
    if problem.rows > 0:
        record_losses(ledger, problem)
    if last:
        for n in range(2 * count):
            set_row(space.shift, n, vec(0.0, 0.0, 0.0))
        lift_apart(space.shift, space.velocity, problem)
    for body in range(count):
        leave_together(body, phase, node, space, of_body(twins, body))
    if last:
        store_energy_of_pairs(collisions, terms.memory, 0.5)


@compiled
def move_together(bodies: Phase, space: Company, h: Number, steps: int, settles: bool, twins: Twin) -> None:
    """Take all bodies through the steps together; the last node is made anew by the next call.

    None only makes them rigid, if it ``settles``; as many as `springgym.integrators.together.START` tell
    which bodies of fresh copies touch, as many as `LOOK` make the last node anew.
    """
    x, v, ledger = bodies
    if steps == 0:
        if settles:
            for body in range(bodies_of(x)):
                settle(of_body(x, body), of_body(v, body), of_body(twins, body))
    else:
        memory, collisions = twins[2].memory, twins[2].collisions
        phase, goes, end = load(of_body(memory, 0).marks, PHASE), steps != START, max(steps, 0)
        if goes:
            for body in range(bodies_of(x)):
                resume(of_body(x, body), of_body(v, body), of_body(ledger, body), of_body(memory, body))
            resume_totals(phase, collisions)
        for n in range(end + 1):
            stage = STARTS if not goes else (READS if n == end else PASSES)
            now = phase if n == 0 else 1.0 + 0.0 * phase
            pass_together(bodies, node_at(now, h, stage), n == 0, space, twins)
        if goes:
            halve_totals(collisions)


@compiled
def settle(x: Rows, v: Rows, twin: Twin) -> None:
    """Put the particles of a body onto its rigid shape; their momenta stay."""
    rigid, asymmetry, terms = twin
    if rigid.moves:
        state, solid = read_state(x, v, rigid, asymmetry, terms)
        set_particles(x, v, state, solid)
