"""Coulomb's friction of bodies that touch, and what keeps the angular momentum.

A contact's friction is an impulse j ⊥ n, given to its particles by their weights w. The points of both bodies
that touch are D = Σ w x = d n apart, so that it leaves a torque D × j. What cancels it are impulses along n,

    δvᵢ = (wᵢ j + (gᵢ · j) n)/mᵢ,    Σ gᵢ = 0,    Σ (gᵢ · j) xᵢ = d j + γ n for all j ⊥ n.

They are the push of a face whose friction acts at the height d above it. With u and q two sides of the face,
or the two edges that cross, A = n · (u × q), G = d (q × n)/A and H = d (n × u)/A, the far end of u has g = G,
that of q has g = H, and their near ends take that back. The slip is what such an impulse works against,

    slip = Σ (wᵢ (1 − n nᵀ) + gᵢ nᵀ) vᵢ:    the velocity of one body at the other's point, as both turn.

Along a unit vector ŝ an impulse changes it by K = W + Σ (gᵢ · ŝ)²/mᵢ. A rod alone is rubbed along itself
only; two balls are points here, and no impulse across the line of their centres keeps the angular momentum.

A sphere that turns is met at its skin, and the face has what is left of D: d is the gap then, and the sphere
turns (`springgym.contact.spheres`). Two of them have one point where they touch, and D leaves nothing over;
neither does it between a capsule and a point or a rod.

Rigid bodies are pushed at one point (`springgym.contact.solids`), where j leaves no torque.
"""

from __future__ import annotations

from springgym.contact.cone import within_cone
from springgym.contact.records import FRICTION, PASSES, ContactRows, Problem, Resistance, Solids, Spheres
from springgym.contact.rows import add_loss
from springgym.contact.solids import among_going, between, inverse_mass_of_both, push_both
from springgym.contact.spheres import (
    at_one_point,
    inverse_mass_by_turning,
    skins,
    slip_by_turning,
    turn_by_friction,
)
from springgym.contact.totals import add_to
from springgym.contact.turning import energy_of_turning, stop_turning, without_turning
from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.core.lanes import any_lane, load, load_each, maximum, select, sqrt, store
from springgym.core.vectors import TINY, choose, cross, dot, plus_scaled, row, row_each, set_row, set_row_each

SHALLOW = 0.05
"""Where n is nearer to a face's plane than this sine, or along a rod, no friction acts: d/A has no bound."""


@compiled
def lay_out(k: int, problem: Problem, friction: Numbers, spheres: Spheres | None) -> None:
    """Find G and H of contact k."""
    contacts, x = problem.contacts, problem.x
    if friction is not None and at_one_point(k, problem, spheres):
        for side in range(2):
            set_row(contacts.tilt, 2 * k + side, 0.0 * row(contacts.normal, k))
    elif friction is not None and contacts.members[k] > 2:
        n = row(contacts.normal, k)
        none = 0.0 * n[0]
        apart = 0.0 * n
        for j in range(contacts.members[k]):
            apart = plus_scaled(apart, load(contacts.weight, 4 * k + j), row_of(x, k, j, contacts))
        d = dot(apart, n)
        if spheres is not None:
            d = d - skins(k, problem, spheres)
        first = row_of(x, k, 1, contacts)
        if contacts.members[k] == 4:
            crossed = crosses(k, contacts)
            u = row_of(x, k, 2, contacts) - first
            u = choose(crossed, first - row_of(x, k, 0, contacts), u)
            q = row_of(x, k, 3, contacts) - choose(crossed, row_of(x, k, 2, contacts), first)
            across = cross(u, q)
            area = dot(n, across)
            steep = area * area > (SHALLOW * SHALLOW) * dot(across, across)
            scale = select(steep, d / select(steep, area, 1.0), none)
            set_row(contacts.tilt, 2 * k, scale * cross(q, n))
            set_row(contacts.tilt, 2 * k + 1, scale * cross(n, u))
            store(contacts.grips, k, select(steep, 1.0 + none, none))
        else:
            u = row_of(x, k, 2, contacts) - first
            along = u - dot(u, n) * n
            square = dot(along, along)
            steep = square > (SHALLOW * SHALLOW) * dot(u, u)
            inverse = select(steep, 1.0 / select(steep, square, 1.0), none)
            set_row(contacts.tilt, 2 * k, (d * inverse) * along)
            set_row(contacts.tilt, 2 * k + 1, sqrt(inverse) * along)
            store(contacts.grips, k, select(steep, 1.0 + none, none))


@compiled
def row_of(rows: Rows, k: int, j: int, contacts: ContactRows) -> Vector:
    """Return a row of particle ``j`` of contact k: its position, or its velocity."""
    return row_each(rows, load(contacts.particle, 4 * k + j))


@compiled
def crosses(k: int, contacts: ContactRows) -> Mask:
    """Return where a contact is of two edges: else it is of a vertex and a face."""
    return load(contacts.weight, 4 * k + 1) > 0.0


@compiled
def rub(v: Rows, turn: int, problem: Problem, friction: Numbers) -> None:
    """Apply friction, and couples where turning is resisted; after all sweeps, enter what they lost.

    Sweeps go to and fro. Friction loses −j times the mean of the slips before and after.
    """
    if friction is not None:
        contacts, pairs = problem.contacts, problem.pairs
        for m in range(problem.rows):
            k = problem.rows - 1 - m if turn % 2 == 1 else m
            p = contacts.pair[k]
            limit = load(friction, p) * pressed(k, problem, contacts.solids, contacts.spheres)
            given = row(contacts.friction, k)
            acts = limit > 0.0
            if turn < pairs.sweeps:
                acts = maximum(limit, dot(given, given)) > 0.0  # what was given may have to be taken back
            acts = among_going(acts, contacts.solids)
            if any_lane(acts):
                if turn < pairs.sweeps:
                    hold(v, k, limit, acts, problem, pairs.resistance)
                else:
                    slip = slip_of(v, k, problem, contacts.solids)
                    slip = slip + slip_of(problem.before, k, problem, contacts.solids)
                    lost = -0.5 * dot(given, slip) + energy_of_turning(v, k, problem, pairs.resistance)
                    lost = select(acts, lost, 0.0)
                    add_loss(contacts, p, 1, lost)
                    add_to(problem.totals, p, FRICTION, lost)


@compiled
def stop_slip(v: Rows, k: int, limit: Number, acts: Mask, problem: Problem) -> None:
    """Let friction stop what slips in contact k, in some lanes, or give as much as the push there allows."""
    contacts = problem.contacts
    given, slip = row(contacts.friction, k), slip_of(v, k, problem, contacts.solids)
    j = held_back(slip, k, given, limit, problem)
    push_across(v, k, j - given, acts, problem, contacts.solids)
    set_row(contacts.friction, k, choose(acts, j, given))


@compiled
def hold(v: Rows, k: int, limit: Number, acts: Mask, problem: Problem, resistance: Resistance | None) -> None:
    """Let friction, and a couple if there is one, stop what slips and turns in contact k, in some lanes."""
    resists = False
    if resistance is not None:
        p = problem.contacts.pair[k]
        resists = resistance.rolling[p] + resistance.torsional[p] > 0.0
        if resists:
            stop_centre(v, k, limit, acts, problem)
    for _ in range(PASSES if resists else 1):
        if resists:
            stop_turning(v, k, acts, problem, resistance)
        stop_slip(v, k, limit, acts, problem)


@compiled
def stop_centre(v: Rows, k: int, limit: Number, acts: Mask, problem: Problem) -> None:
    """Begin the friction of contact k with what would stop its slip if a couple stopped its rolling."""
    contacts = problem.contacts
    given, couple = row(contacts.friction, k), row(contacts.couple, k)
    fresh = select(acts, dot(given, given) + dot(couple, couple), 1.0) <= 0.0
    if any_lane(fresh):
        slip = slip_of(v, k, problem, contacts.solids)
        along = 1.0 / (sqrt(dot(slip, slip)) + TINY) * slip
        inverse = inverse_mass_along(along, k, problem, contacts.solids)
        slip, inverse = without_turning(slip, inverse, v, k, problem)
        j = within_cone(-1.0 / (inverse + TINY) * slip, limit)
        push_across(v, k, j, fresh, problem, contacts.solids)
        set_row(contacts.friction, k, choose(fresh, j, given))


@compiled
def pressed(k: int, problem: Problem, solids: Solids | None, spheres: Spheres | None) -> Number:
    """Return the push of contact k [N·s] where friction acts; 0 where it does not."""
    contacts = problem.contacts
    push = load(contacts.impulse, k)
    if solids is not None:
        return push
    if at_one_point(k, problem, spheres):
        return push
    if contacts.members[k] == 2:
        return 0.0 * push
    return load(contacts.grips, k) * push


@compiled
def slip_of(v: Rows, k: int, problem: Problem, solids: Solids | None) -> Vector:
    """Return how contact k slips [m/s]."""
    n = row(problem.contacts.normal, k)
    if solids is not None:
        slip = between(v, k, problem, solids)
        return slip - dot(slip, n) * n
    return slip_of_particles(v, k, problem, problem.contacts.spheres)


@compiled
def slip_of_particles(v: Rows, k: int, problem: Problem, spheres: Spheres | None) -> Vector:
    """Return how the particles of contact k slip, those of one body as seen from the other's point [m/s]."""
    contacts = problem.contacts
    n, slip = row(contacts.normal, k), 0.0 * row(contacts.normal, k)
    for j in range(contacts.members[k]):
        slip = plus_scaled(slip, load(contacts.weight, 4 * k + j), row_of(v, k, j, contacts))
    if spheres is not None:
        slip = slip + slip_by_turning(v, k, problem, spheres)
        if contacts.members[k] == 2 or at_one_point(k, problem, spheres):
            return slip - dot(slip, n) * n
    if contacts.members[k] == 3:
        along = row(contacts.tilt, 2 * k + 1)
        slip = dot(slip, along) * along
        turn = dot(n, row_of(v, k, 2, contacts) - row_of(v, k, 1, contacts))
        return plus_scaled(slip, turn, row(contacts.tilt, 2 * k))
    crossed = crosses(k, contacts)
    first, third = row_of(v, k, 1, contacts), row_of(v, k, 2, contacts)
    turn = dot(n, choose(crossed, first - row_of(v, k, 0, contacts), third - first))
    other = dot(n, row_of(v, k, 3, contacts) - choose(crossed, third, first))
    slip = plus_scaled(slip - dot(slip, n) * n, turn, row(contacts.tilt, 2 * k))
    return plus_scaled(slip, other, row(contacts.tilt, 2 * k + 1))


@compiled
def normal_part(k: int, m: int, j: Vector, contacts: ContactRows) -> Number:
    """Return gᵢ · j of the contact's particle ``m``, for an impulse j across the normal."""
    g = dot(row(contacts.tilt, 2 * k), j)
    if contacts.members[k] == 3:
        return g if m == 2 else (-1.0 * g if m == 1 else 0.0 * g)
    h = dot(row(contacts.tilt, 2 * k + 1), j)
    crossed = crosses(k, contacts)
    if m == 0:
        return select(crossed, -1.0 * g, 0.0)
    if m == 1:
        return select(crossed, g, -1.0 * (g + h))
    if m == 2:
        return select(crossed, -1.0 * h, g)
    return h


@compiled
def inverse_mass_along(along: Vector, k: int, problem: Problem, solids: Solids | None) -> Number:
    """Return K of contact k along a unit vector across its normal [1/kg]."""
    contacts = problem.contacts
    if solids is not None:
        return inverse_mass_of_both(along, k, problem, solids)
    total = inverse_mass_of_sides(along, k, problem, contacts.spheres)
    for m in range(contacts.members[k]):
        lift = normal_part(k, m, along, contacts)
        total = total + lift * lift * load_each(problem.inverse_mass, load(contacts.particle, 4 * k + m))
    return total


@compiled
def inverse_mass_of_sides(along: Vector, k: int, problem: Problem, spheres: Spheres | None) -> Number:
    """Return W of contact k, and what the turning of spheres adds to it along a unit vector [1/kg]."""
    inverse = load(problem.contacts.inverse_mass, k)
    if spheres is not None:
        inverse = inverse + inverse_mass_by_turning(along, k, problem, spheres)
    return inverse


@compiled
def held_back(slip: Vector, k: int, given: Vector, limit: Number, problem: Problem) -> Vector:
    """Return the impulse that stops a slip, besides what was ``given``; or as much as friction can give."""
    along = 1.0 / (sqrt(dot(slip, slip)) + TINY) * slip
    inverse = inverse_mass_along(along, k, problem, problem.contacts.solids)
    return within_cone(given - 1.0 / (inverse + TINY) * slip, limit)


@compiled
def push_across(v: Rows, k: int, j: Vector, acts: Mask, problem: Problem, solids: Solids | None) -> None:
    """Give contact k an impulse across its normal, in some lanes."""
    if solids is not None:
        push_both(v, k, j, acts, problem, solids)
    else:
        push_particles_across(v, k, j, acts, problem, problem.contacts.spheres)


@compiled
def push_particles_across(
    v: Rows, k: int, j: Vector, acts: Mask, problem: Problem, spheres: Spheres | None
) -> None:
    """Give the particles of contact k an impulse across its normal, and what takes its torque back."""
    contacts = problem.contacts
    n = row(contacts.normal, k)
    if spheres is not None:
        turn_by_friction(v, k, j, acts, problem, spheres)
    for m in range(contacts.members[k]):
        i = load(contacts.particle, 4 * k + m)
        before = row_each(v, i)
        after = plus_scaled(before, load(contacts.gain, 4 * k + m), j)
        after = plus_scaled(after, normal_part(k, m, j, contacts) * load_each(problem.inverse_mass, i), n)
        set_row_each(v, i, choose(acts, after, before))
