"""The node of a step of rigid bodies: where all impulses of the step act at once.

The body flies freely for half a step (`springgym.rigid.flight`), receives the impulses of gravity, actuators,
surfaces, other bodies and friction, and flies freely for the other half. As for particles that springs hold
together (`springgym.integrators.node`), an impulse p changes the kinetic energy by p · (v₋ + v₊)/2, and the
state is read amid the node.

A body alone takes its state from node to node. Bodies that collide pass each node together, and each step
begins with the particles: position, attitude and momenta are read off them where the node is reached, so that
calls of any length take the same steps, to the bit. Contacts are found from the particles, follow the same
law and are told of as those of springs. What differs is what they move (`springgym.contact.solids`).

Contacts of a rigid body all act on each other. They are taken in turns, surfaces first, then pairs of bodies
there and back with their friction, until the speeds of those between bodies agree (Gauss and Seidel);
surfaces have the last word.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.contact.friction import rub
from springgym.contact.law import Span
from springgym.contact.points import lifted
from springgym.contact.records import CHANGE, GOING, ContactRows, Lists, Problem, Rounds, Surfaces, WarmStart
from springgym.contact.round import lifted_feature, rolls
from springgym.contact.search import find_contacts
from springgym.contact.solver import add_totals, lift_apart, prepare, sweep, taper
from springgym.contact.spheres import as_seen
from springgym.contact.surfaces import coefficient, count
from springgym.contact.totals import list_changing, remember_totals
from springgym.contact.warm import keep_impulses, start_warm
from springgym.core.compiling import compiled
from springgym.core.kinds import Ledger, Mask, Number, Rows, Vector
from springgym.core.lanes import any_lane, bodies_of, epsilon, load, maximum, minimum, of_body, select, store
from springgym.core.vectors import TINY, choose, dot, plus_scaled, row, set_row, vec
from springgym.forces.ledger import CONTACT, FRICTION, WORK, record
from springgym.forces.memory import STORED, halve, remember, share_actions
from springgym.integrators.node import (
    READS,
    STARTS,
    Node,
    record_losses,
    start_together,
    store_energy_of_pairs,
)
from springgym.integrators.record import Phase
from springgym.rigid.body import read_state, set_particles
from springgym.rigid.flight import combine, components, fly, turned
from springgym.rigid.kick import load_of_actuators, weight
from springgym.rigid.rolling import given_by_rows, inverse_inertia, problem_of, roll_on_surfaces
from springgym.rigid.solid import Motion, Solid, State, Twin
from springgym.rigid.surfaces import (
    AGREED,
    ARM,
    ARRAYS,
    NORMAL,
    PUSH,
    RUB,
    RigidNode,
    clearance,
    energy_in_barriers,
    leave,
    meet_surfaces,
    place_of,
    product_of,
    straight,
    sum_of,
    velocity_of,
)
from springgym.terms import Thrust, Wrench

TURNS = 40
"""How often surfaces and pairs are taken in turn, at the most, if they do not agree to `AGREED` before."""

WARM_AGREED = 1e-3
"""Change of a contact's speed by the last turn, as a share of Δ in a step, at which pairs agree among many
bodies: from there the next node goes on (`springgym.contact.warm`)."""

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
    """(bodies, N or 2, 3) what actuators give particles, see `set_loads`"""
    surfaces: np.ndarray
    """(bodies, arrays, N, 3) what surfaces give, as `springgym.rigid.surfaces` keeps it, or
    `springgym.rigid.rolling`"""
    pushed: np.ndarray
    """(bodies,) whether surfaces gave a body anything at this node"""
    before: np.ndarray
    """the motion with which the node is reached"""
    free: np.ndarray
    """the motion after the node, but for contact"""
    velocity: np.ndarray
    """the motion after the node, with the impulses found so far"""
    by_surfaces: np.ndarray
    """change of motion that surfaces gave in their last turn"""
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
def reach_node(begin: State, state: State, span: Span, b: Rows, solid: Solid) -> RigidNode:
    """Return a node; ``b`` is of `set_loads`."""
    axes = turned(solid.axes, state.q)
    before = (components(axes, state.velocity), state.spin)
    twist, push = weight(state.q, 1.0, solid.terms.gravity, solid)
    rate = (solid.lightness * components(axes, push), twist)
    thrown = thrown_by(b, span.whole, solid, solid.terms.wrench, solid.terms.thrust)
    soon = sum_of(sum_of(before, span.whole, rate), 1.0, thrown)
    falling = plus_scaled(state.velocity, span.whole * solid.lightness, push)
    return RigidNode(span, begin, state, axes, before, rate, thrown, soon, falling)


@compiled
def pass_alone(
    node: RigidNode, near: tuple[Number, Number], ledger: Ledger, workspace: np.ndarray, solid: Solid
) -> tuple[State, tuple[Number, Number], Motion]:
    """Let all act at a node.

    ``near`` is the `clearance` half a step before, and a number: 1 where surfaces were near at the last
    node. Returns the state half a step later, ``near`` there, and the change of motion by surfaces.
    """
    nothing = 0.0 * node.before[0]
    given = (nothing, nothing)
    if rolls(solid.terms.rounds):
        given = roll_on_surfaces(node, workspace, solid, solid.terms.rounds)
        enter(node, given, None, True, ledger, workspace, solid)
        return leave(node, given, solid), near, given
    end = leave(node, given, solid)
    ahead = clearance(end, solid)
    active = select(minimum(near[0], ahead) < 0.0, 1.0 + nothing[0], 0.0)
    touched = any_lane(active > 0.5)
    if touched:
        given = meet_surfaces(node, active * near[1] > 0.5, active, workspace, solid)
        end = leave(node, given, solid)
        ahead = clearance(end, solid)
    enter(node, given, None, touched, ledger, workspace, solid)
    return end, (ahead, active), given


@compiled
def enter(
    node: RigidNode,
    given: Motion,
    by_bodies: Motion | None,
    touched: bool,
    ledger: Ledger,
    workspace: np.ndarray,
    solid: Solid,
) -> None:
    """Enter the actuators' work, and what contact and friction took.

    ``given`` is the change of motion by surfaces, if these ``touched`` the body in any copy, and
    ``by_bodies`` that by other bodies, if they collide.
    """
    middle = sum_of(sum_of(node.before, node.span.lead, node.rate), 0.5, node.thrown)
    middle = sum_of(plus_half(middle, by_bodies), 0.5, given)
    record(ledger, WORK, product_of(node.thrown, middle, solid))
    if touched:
        record_surface_losses(node, given, middle, ledger, workspace, solid, solid.terms.surfaces)
    enter_start(node, by_bodies, middle, ledger, solid)


@compiled
def plus_half(middle: Motion, by_bodies: Motion | None) -> Motion:
    """Return a motion with half of what bodies give each other, if they collide."""
    if by_bodies is None:
        return middle
    return sum_of(middle, 0.5, by_bodies)


@compiled
def record_surface_losses(
    node: RigidNode,
    given: Motion,
    middle: Motion,
    ledger: Ledger,
    workspace: np.ndarray,
    solid: Solid,
    surfaces: Surfaces | None,
) -> None:
    """Enter what surfaces, if there are any, took; ``middle`` is the mean motion at the node."""
    if surfaces is None:
        return
    late = 0.5 * (node.span.out - node.span.lead)
    lost, rubbed, fallen, met = losses(node, given, middle, workspace, solid, solid.terms.rounds)
    # `springgym.integrators.node.begun_in_touch`
    whole = product_of(node.rate, node.rate, solid)
    rests = select(met > 0.0, minimum(fallen * fallen / (maximum(met, 0.0) + TINY), whole), 0.0)
    lost = lost + 2.0 * late * late * rests
    record(ledger, CONTACT, lost)
    record(ledger, FRICTION, rubbed)


@compiled
def losses(
    node: RigidNode, given: Motion, middle: Motion, workspace: np.ndarray, solid: Solid, rounds: Rounds | None
) -> tuple[Number, Number, Number, Number]:
    """Return what surfaces took by their pushes and by friction [J]; and the products of these pushes with
    the motion by gravity in a second [J/s], and with ``given`` [J]."""
    if rounds is not None and rolls(rounds):
        return losses_of_features(node, given, middle, workspace, solid, rounds)
    return losses_of_particles(node, given, middle, workspace, solid)


@compiled
def is_lossy(span: Span, solid: Solid) -> Mask:
    """Tell where losses are entered. A whole node without loss keeps the energy; what rounding leaves of that
    is not."""
    return select(span.lead > 0.0, coefficient(solid.terms.loss, 0.0 * span.lead), 1.0) > 0.0


@compiled
def losses_of_particles(
    node: RigidNode, given: Motion, middle: Motion, workspace: np.ndarray, solid: Solid
) -> tuple[Number, Number, Number, Number]:
    """Return the `losses` of a body that meets surfaces with its particles."""
    span, none = node.span, 0.0 * node.before[0][0]
    after = sum_of(node.free, 1.0, given)
    lost, rubbed, fallen, met = none, none, none, none
    late = 0.5 * (span.out - span.lead)
    lossy = is_lossy(span, solid)
    for k in range(count(solid.terms.surfaces.kinds)):
        for i in range(solid.terms.particles.mass.size):
            push = row(workspace[ARRAYS * k + PUSH], i)
            impulse, force = push[0], push[1]
            if any_lane(force > 0.0):
                n, arm = row(workspace[ARRAYS * k + NORMAL], i), row(workspace[ARRAYS * k + ARM], i)
                way = straight(n, arm, node, after, solid)
                mean = velocity_of(arm, middle, solid)
                lost = lost + select(lossy, force * way / span.whole - impulse * dot(n, mean), 0.0)
                falling = velocity_of(arm, node.rate, solid)
                fallen = fallen + impulse * dot(n, falling)
                met = met + impulse * dot(n, velocity_of(arm, given, solid))
                rub = row(workspace[ARRAYS * k + RUB], i)
                rubbed = rubbed - dot(rub, plus_scaled(mean, late, falling))
    return lost, rubbed, fallen, met


@compiled
def losses_of_features(
    node: RigidNode, given: Motion, middle: Motion, workspace: np.ndarray, solid: Solid, rounds: Rounds
) -> tuple[Number, Number, Number, Number]:
    """Return the `losses` of a body that meets surfaces with its round features."""
    span = node.span
    change, rub, force = given_by_rows(node, problem_of(node, node.state, workspace, solid, rounds), solid)
    after = sum_of(node.free, 1.0, given)
    way = span.lead * product_of(force, node.before, solid) + span.out * product_of(force, after, solid)
    lost = way / span.whole - product_of(change, middle, solid)
    late = sum_of(middle, 0.5 * (span.out - span.lead), node.rate)
    return (
        select(is_lossy(span, solid), lost, 0.0),
        -1.0 * product_of(rub, late, solid),
        product_of(change, node.rate, solid),
        product_of(change, given, solid),
    )


@compiled
def shown_at(
    node: RigidNode, end: State, shift: Vector, workspace: np.ndarray, solid: Solid, rounds: Rounds | None
) -> tuple[Number, Number, Vector]:
    """Return what barriers of surfaces store around a node, less what they store where it is read [J], in two
    numbers; and where the body's point is shown then: shifted off bodies and, unless pinned, lifted off
    surfaces."""
    if rounds is not None and rolls(rounds):
        problem = problem_of(node, node.state, workspace, solid, rounds)
        stored, lift = lifted_feature(shift, problem.space.velocity, problem)
        moves = solid.lightness + 0.0 * lift[0] > 0.0
        return stored, 0.0 * stored, node.state.position + choose(moves, lift, shift)
    return shown_by_particles(node, end, shift, solid, solid.terms.surfaces)


@compiled
def shown_by_particles(
    node: RigidNode, end: State, shift: Vector, solid: Solid, surfaces: Surfaces | None
) -> tuple[Number, Number, Vector]:
    """Return what `shown_at` does, of a body that meets surfaces with its particles."""
    shown, terms = node.state.position + shift, solid.terms
    if surfaces is not None:
        begun, ended = turned(solid.axes, node.begin.q), turned(solid.axes, end.q)
        for i in range(terms.particles.mass.size):
            if terms.particles.free[i]:
                place = shown + combine(node.axes, row(solid.rigid.shape, i))
                first, final = place_of(i, node.begin, begun, solid), place_of(i, end, ended, solid)
                lift = lifted(place, first, final, terms)
                shown = choose(solid.lightness + 0.0 * shown[0] > 0.0, shown + lift, shown)
    around = 0.5 * (energy_in_barriers(node.begin, solid) + energy_in_barriers(end, solid))
    read = State(node.state.q, node.state.spin, shown, node.state.velocity)
    return around, energy_in_barriers(read, solid), shown


@compiled
def read_node(
    node: RigidNode,
    end: State,
    given: Motion,
    shift: Vector,
    ledger: Ledger,
    workspace: np.ndarray,
    solid: Solid,
) -> State:
    """Return the state amid a node, where it is read; half of the node's entries are left in the ledger."""
    memory, terms = solid.terms.memory, solid.terms
    halve(ledger, memory)
    record(ledger, WORK, -0.125 * product_of(node.thrown, node.thrown, solid))
    stored = 0.125 * product_of(given, sum_of(given, 2.0, node.thrown), solid)
    state = node.state
    around, there, shown = shown_at(node, end, shift, workspace, solid, terms.rounds)
    _, push = weight(state.q, 1.0, terms.gravity, solid)
    stored = stored + dot(push, shown - state.position)
    spin = 0.5 * (state.spin + (node.free[1] + given[1]))
    read = State(state.q, spin, shown, 0.5 * (state.velocity + end.velocity))
    store(memory.marks, STORED, (stored + around) - there)
    return read


# --- Bodies that collide ---------------------------------------------------------------------------------


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
    """Return the `clearance` of a body's particles, or 1 if it does not meet surfaces with them."""
    if surfaces is not None and not rolls(solid.terms.rounds):
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
    turn = inverse_inertia(solid.axes, rigid)
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
        set_row(space.by_surfaces, 2 * body + part, nothing)
        set_row(space.by_bodies, 2 * body + part, nothing)
        set_row(rows, GIVEN + part, nothing)
    ahead = near_surfaces(reached.begin, solid, terms.surfaces)
    set_row(rows, NEAR, vec(ahead, zero, zero))


@compiled
def push_by_surfaces(body: int, span: Span, space: Company, twin: Twin) -> None:
    """Let surfaces give a body what follows from all else, bodies' pushes among it."""
    going = load(space.changed, 0) > 0.5
    for n in range(2 * body, 2 * body + 2):
        given = (row(space.velocity, n) - row(space.free, n)) - row(space.by_surfaces, n)
        set_row(space.by_bodies, n, choose(going, given, row(space.by_bodies, n)))
    ask_surfaces(body, span, going, space, twin, twin[2].surfaces)


@compiled
def ask_surfaces(
    body: int, span: Span, going: Mask, space: Company, twin: Twin, surfaces: Surfaces | None
) -> None:
    """Find what surfaces, if there are any, give a body in the copies that are ``going``."""
    if surfaces is not None:
        free, solid = node_of(body, span, space, twin)
        node, _ = pushed_by_pairs(free, body, space)
        rows, none = space.bodies[body], 0.0 * span.out
        nothing = 0.0 * node.before[0]
        if rolls(solid.terms.rounds):
            given = roll_on_surfaces(node, space.surfaces[body], solid, solid.terms.rounds)
            keep_given(body, given, going, space)
        ahead = near_surfaces(leave(node, (nothing, nothing), solid), solid, surfaces)
        near = row(rows, NEAR)
        close = select(minimum(near[0], ahead) < 0.0, 1.0 + none, near[1])
        set_row(rows, NEAR, vec(near[0], select(going, close, near[1]), none))
        active = select(going, close, 0.0)
        if any_lane(active > 0.5):
            known = active > (-1.0 if space.pushed[body] else 2.0)
            given = meet_surfaces(node, known, active, space.surfaces[body], solid)
            keep_given(body, given, going, space)
        for part in range(2):
            n = 2 * body + part
            before, by_surfaces = row(space.by_surfaces, n), combine(node.axes, row(rows, GIVEN + part))
            # surfaces that are out of reach change no bit
            now = row(space.velocity, n) + (by_surfaces - before)
            set_row(space.velocity, n, choose(going, now, row(space.velocity, n)))
            set_row(space.by_surfaces, n, choose(going, by_surfaces, before))


@compiled
def keep_given(body: int, given: Motion, going: Mask, space: Company) -> None:
    """Keep what surfaces give a body in the copies that are ``going``."""
    rows = space.bodies[body]
    space.pushed[body] = True
    for part in range(2):
        set_row(rows, GIVEN + part, choose(going, given[part], row(rows, GIVEN + part)))


@compiled
def agreement(table: WarmStart | None) -> float:
    """Return the share of Δ to which pairs agree, after a step from nothing or from the last node."""
    if table is None:
        return AGREED
    return WARM_AGREED


@compiled
def takes_turns(contacts: int, surfaces: Surfaces | None) -> bool:
    """Return whether surfaces have turns before the last one."""
    return surfaces is not None and contacts > 0


@compiled
def find_impulses(problem: Problem, space: Company, twins: Twin) -> None:
    """Find what surfaces and bodies give at a node."""
    pairs, velocity, span = problem.pairs, space.velocity, problem.span
    turns, terms = problem.contacts.solids.turns, twins[2]
    one = 1.0 + 0.0 * span.out
    enough = agreement(terms.collisions.warm) + 64 * epsilon(one)
    store(turns, GOING, one)
    store(space.changed, 0, one)
    start_warm(velocity, problem, terms.collisions.warm)
    going, turn = problem.rows > 0, 0
    while True:
        last = not going or turn == TURNS
        if last or takes_turns(problem.rows, terms.surfaces):
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
        rub(velocity, pairs.sweeps, problem, pairs.friction)


@compiled
def leave_together(body: int, all_bodies: Phase, node: Node, space: Company, twin: Twin) -> None:
    """Let a body go on to the next node, and enter what it lost; or, where the node is for that, read it."""
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
    touched = space.pushed[body]
    enter(passed, given, by_bodies, touched, ledger, space.surfaces[body], solid)
    if last:
        for i in range(x.shape[0]):
            set_row(terms.memory.arrived, i, row(v, i))
        shift = row(space.shift, 2 * body)
        given = sum_of(by_bodies, 1.0, given)
        read = read_node(free, end, given, shift, ledger, space.surfaces[body], solid)
        set_particles(x, v, read, solid)
    else:
        state = fly(end, span.out, solid.rigid, solid.asymmetry)
        set_particles(x, v, state, solid)


@compiled
def enter_start(
    node: RigidNode, by_bodies: Motion | None, middle: Motion, ledger: Ledger, solid: Solid
) -> None:
    """Enter, of the half node of a fresh copy, what bodies took from one body, if they collide; what its
    barriers gave is entered for the pair.

    There they push against gravity before it acts, see `springgym.integrators.node.begun_in_touch`.
    """
    if by_bodies is not None:
        late = 0.5 * (node.span.out - node.span.lead)
        fallen, met = product_of(node.rate, by_bodies, solid), product_of(by_bodies, by_bodies, solid)
        rests = 2.0 * late * late * fallen * fallen / (met + TINY)
        lost = rests - product_of(by_bodies, middle, solid)
        record(ledger, CONTACT, select(late > 0.0, lost, 0.0))


@compiled
def pass_together(phase: Phase, node: Node, first: bool, space: Company, twins: Twin) -> None:
    """Let all act on all bodies at a node: `springgym.integrators.node.pass_node` of rigid bodies."""
    x, v, ledger = phase
    terms, last = twins[2], node.stage == READS
    collisions, contacts = terms.collisions, space.contacts
    particles, found_in = terms.particles, (space.lists, contacts)
    places, reached, inverse_mass = as_seen(
        x.values, v.values, particles.mass.values, particles.inverse_mass.values, contacts.spheres
    )
    span = node.span
    problem = find_contacts(places, reached, space.before, inverse_mass, span, collisions, found_in)
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
    if not last:
        keep_impulses(problem, collisions.warm)
    if last:
        for n in range(2 * count):
            set_row(space.shift, n, vec(0.0, 0.0, 0.0))
        lift_apart(space.shift, space.velocity, problem)
    for body in range(count):
        leave_together(body, phase, node, space, of_body(twins, body))
    if last:
        store_energy_of_pairs(collisions, terms.memory, 0.5)
