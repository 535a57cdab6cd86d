"""A step of bodies that may touch something: the order of all that happens in it.

Bodies move for half a step, receive all impulses of the step at once, at its node, and move for the other
half. Bodies of springs drift: their particles fly straight (`springgym.dynamics.methods.node`). Rigid bodies
fly freely (`springgym.dynamics.rigid.node`). An impulse p changes the kinetic energy by exactly p · (v₋ +
v₊)/2, with the velocities v₋ and v₊ before and after the node. The ledger records this, and a contact takes
this mean for its rate of deformation (`springgym.dynamics.contact.law`). The mean is zero for resting bodies,
so that they lose nothing, and do not creep.

1. **Each body arrives** at the node. Springs, gravity, actuators and dampers give it the velocity that it has
   without contact.
2. **Contact** changes these velocities. Contacts are found from the positions at the node, and at the
   beginning and end of the step (`springgym.dynamics.contact.search` between bodies,
   `springgym.dynamics.contact.ground` at surfaces). Their impulses are solved together
   (`springgym.dynamics.contact.solver`), beginning with those of the last node
   (`springgym.dynamics.contact.warm`).
3. **Each body leaves** the node, with the velocity that contact gave it, and its losses are recorded.

A state is that at the end of a step, with positions and velocities of the same time.

In scenes where no body collides, rolls or is rigid (`springgym.dynamics.packing.solves_rows`), each particle
touches surfaces by itself, and bodies do not depend on each other: step 2 is then part of step 3, and bodies
take their steps one after another (`advance_alone`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from springgym.core.compiler.decorators import compiled
from springgym.core.language.bodies import all_rows, bodies_of, first_row, of_body
from springgym.core.language.kinds import Ledger, Nested, Number, Rows
from springgym.core.language.memory import load, store
from springgym.core.language.vectors import mass_centre, row, set_row
from springgym.dynamics.contact.ground import shift_arms
from springgym.dynamics.contact.rows import describe
from springgym.dynamics.contact.search import find
from springgym.dynamics.contact.solver import add_totals, prepare, start_totals
from springgym.dynamics.contact.totals import entry_of, list_changing
from springgym.dynamics.contact.warm import keep_impulses, start_warm
from springgym.dynamics.records import (
    PAIR_TOTALS,
    Collisions,
    ContactCount,
    Neighbours,
    PairTotal,
    Problem,
    RowSpace,
    Times,
    Turning,
)
from springgym.dynamics.terms import Terms


class Bodies(NamedTuple):
    """The bodies of a block, or one of them: `springgym.core.language.bodies.of_body` selects it in all
    fields."""

    x: Rows
    """(N, 3) positions [m]"""
    v: Rows
    """(N, 3) velocities [m/s]: v₋ until a body leaves the node, then v₊"""
    ledger: Ledger
    space: Any
    """workspace of the thread; its field ``rows`` is the `RowSpace` of contacts"""
    terms: Terms
    twins: Nested
    """the bodies as rigid ones, see `springgym.dynamics.rigid.solid.Twin`; None for bodies of springs"""


class Alone(NamedTuple):
    """What a step must know of bodies whose contacts do not depend on each other: compiled functions."""

    expect_contact: Callable[..., None]
    """(body, bodies): prepare the workspace of a body for a call of several steps"""
    arrive: Callable[..., None]
    """(body, bodies, span): move a body to the node, and find its motion after it without contact"""
    leave: Callable[..., None]
    """(body, bodies, span): apply contact, move to the end of the step, record losses"""


class Kind(NamedTuple):
    """What a step must know of a kind of bodies whose contacts are solved together: compiled functions."""

    expect_contact: Callable[..., None]
    """(body, bodies): prepare the workspace of a body for a call of several steps"""
    arrive: Callable[..., None]
    """(body, bodies, span): move a body to the node, and find its motion after it without contact"""
    leave: Callable[..., None]
    """(body, bodies, span): apply what contact changed, move to the end of the step, record losses"""
    at_node: Callable[..., tuple[Rows, Rows]]
    """(bodies, placed): return positions and velocities of all particles where the search looks for contacts:
    at the node, or where copies were ``placed``"""
    find_at_surfaces: Callable[..., None]
    """(body, bodies, span): add the contacts of a body with surfaces"""
    join: Callable[..., None]
    """(bodies, span, problem, between): bring the bodies that have contacts into the form of contacts"""
    find_impulses: Callable[..., None]
    """(bodies, span, problem, between): find all impulses"""


# --- Steps ------------------------------------------------------------------------------------------------


@compiled
def advance_together(kind: Kind, bodies: Bodies, h: Number, steps: int, placed: bool) -> None:
    """Advance bodies whose contacts are solved together by ``steps`` steps of h [s].

    If copies were just ``placed``, only find which of their bodies touch. One function does both, because the
    search for contacts takes long to compile.
    """
    span = span_of(h, bodies.x)
    if placed:
        span = Times(0.0 * span.lead, span.out, span.out)
    for body in range(bodies_of(bodies.x)):
        kind.expect_contact(body, bodies)
    for _ in range(1 if placed else steps):
        step(kind, bodies, span, placed)
    store_energy_of_pairs(bodies.terms.collisions)


@compiled
def step(kind: Kind, bodies: Bodies, span: Times, placed: bool) -> None:
    """Take a step of all bodies together, or only search for contacts, see `advance_together`."""
    if not placed:
        for body in range(bodies_of(bodies.x)):
            kind.arrive(body, bodies, span)
    act_by_contact(kind, bodies, span, placed)
    if not placed:
        for body in range(bodies_of(bodies.x)):
            kind.leave(body, bodies, span)


@compiled
def act_by_contact(kind: Kind, bodies: Bodies, span: Times, placed: bool) -> None:
    """Find the contacts at a node, and their impulses."""
    collisions = bodies.terms.collisions
    space = bodies.space.rows
    contacts = space.contacts
    x, v = kind.at_node(bodies, placed)
    problem = problem_of(bodies, x, v, span)
    between = find_between_bodies(problem, space, space.lists)
    contacts.length[ContactCount.ROWS] = between
    if not placed:
        for body in range(bodies_of(bodies.x)):
            kind.find_at_surfaces(body, bodies, span)
    list_changing(contacts, collisions.totals, collisions.changing)
    if placed:
        start_totals(load(collisions.fresh, 0) > 0.5, problem, collisions.changing)
        store(collisions.fresh, 0, 0.0)
        return
    if contacts.length[ContactCount.ROWS] > 0:
        kind.join(bodies, span, problem, between)
        begin_rows(between, space.velocity, problem, collisions, space.lists)
        kind.find_impulses(bodies, span, problem, between)
    add_totals(space.velocity, problem, collisions.changing)
    keep_impulses(problem, collisions.warm)


@compiled
def advance_alone(kind: Alone, bodies: Bodies, h: Number, steps: int) -> None:
    """Advance one body whose contacts do not depend on each other by ``steps`` steps of h [s]."""
    span = span_of(h, bodies.x)
    kind.expect_contact(0, bodies)
    for _ in range(steps):
        kind.arrive(0, bodies, span)
        kind.leave(0, bodies, span)


@compiled
def span_of(h: Number, x: Rows) -> Times:
    """Return the times of the node of a step of h [s] in each lane."""
    whole = h + 0.0 * load(of_body(x, 0), (0, 0))
    return Times(0.5 * whole, 0.5 * whole, whole)


# --- Contacts ---------------------------------------------------------------------------------------------


@compiled
def problem_of(bodies: Bodies, x: Rows, v: Rows, span: Times) -> Problem:
    """Return the `Problem` of a node, given all particles there, before its contacts are found."""
    particles = bodies.terms.particles
    pairs = bodies.terms.collisions.pairs
    space = bodies.space.rows
    fetch(bodies.x, particles.mass, x, v, space, space.lists)
    inverse_mass = all_rows(particles.inverse_mass)
    totals = bodies.terms.collisions.totals
    return Problem(span, space.places, space.before, inverse_mass, pairs, space.contacts, totals)


@compiled
def fetch(of: Any, mass: Any, x: Rows, v: Rows, space: RowSpace, lists: Neighbours | None) -> None:
    """Copy positions and velocities of all particles in the form of contacts, if bodies collide."""
    if lists is not None:
        for i in range(x.shape[0]):
            set_row(space.places, i, row(x, i))
            set_row(space.speeds, i, row(v, i))
        see_balls(of, mass, space, space.contacts.turning)


@compiled
def see_balls(of: Any, mass: Any, space: RowSpace, turning: Turning | None) -> None:
    """Move the first particle of each ball to its centre of mass, in the arrays of contacts."""
    if turning is not None:
        for n in range(bodies_of(of)):
            if turning.balls[n]:
                own = of_body(mass, n)
                first = first_row(of, n)
                for rows in (space.places, space.speeds):
                    set_row(rows, first, mass_centre(rows[first : first + own.size], own))


@compiled
def find_between_bodies(problem: Problem, space: RowSpace, lists: Neighbours | None) -> int:
    """List the contacts between bodies, if they collide, and return the number of rows."""
    if lists is None:
        space.contacts.length[ContactCount.PAIRS] = 0
        return 0
    return find(problem.x, space.speeds, problem.span, problem.pairs, lists, space.contacts)


@compiled
def begin_rows(
    between: int, v: Rows, problem: Problem, collisions: Collisions, lists: Neighbours | None
) -> None:
    """Prepare all contacts, the first of which are ``between`` bodies, and warm-start their impulses."""
    contacts = problem.contacts
    for k in range(contacts.length[ContactCount.ROWS]):
        if lists is not None and k < between:
            describe(k, problem)
        else:
            shift_arms(k, contacts, contacts.turning)
        prepare(k, v, problem)
    start_warm(v, problem, collisions.warm)


@compiled
def store_energy_of_pairs(collisions: Collisions | None) -> None:
    """Assign half of the energy in a pair's barriers to each of its bodies, if bodies collide."""
    if collisions is not None:
        pairs = collisions.pairs
        for body in range(collisions.stored.shape[0]):
            store(collisions.stored, body, 0.0)
        for n in range(1, entry_of(collisions.changing, 0) + 1):
            p = entry_of(collisions.changing, n)
            if p < pairs.among:
                half = 0.5 * load(collisions.totals, p * PAIR_TOTALS + PairTotal.ENERGY)
                for side in range(2):
                    own = pairs.first[p] if side == 0 else pairs.second[p]
                    store(collisions.stored, own, load(collisions.stored, own) + half)
