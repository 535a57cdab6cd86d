"""Let contacts move rigid bodies: two of them, at one point.

At a node a rigid body has the velocity v of its point, the centre of mass or the pin, and the angular
momentum L about that point, in world coordinates. A contact sees two bodies a and b from one place, at the
arms r from their points, and gives them opposite impulses there:

    u = v_a + ω_a × r_a − v_b − ω_b × r_b,    ω = I⁻¹ L,
    an impulse j:  v_a += j/M_a, L_a += r_a × j,    v_b −= j/M_b, L_b −= r_b × j.

So momentum and angular momentum are kept to rounding. Along a unit vector s the relative velocity changes by
W j, W = Σ 1/M + (r × s) · I⁻¹ (r × s). Of a body that cannot move, or not turn, 1/M or I⁻¹ is 0.

The place is halfway between the two points of the contact. Of a ball, which has no inertia and is not turned,
it is the centre: that is on the same normal. Of a sphere that turns, or a capsule, it is where friction acts
on those of springs, too: at the arm −ρ n from its centre or axis (`springgym.contact.spheres`).

Impulses are found in turns until a copy's own agree, whatever other copies of its block need.
"""

from __future__ import annotations

from springgym.contact.law import Span
from springgym.contact.records import CHANGE, GOING, Ends, Problem, Solids, Spheres
from springgym.contact.spheres import body_of, is_capsule, lever, own_weight
from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Rows, Vector
from springgym.core.lanes import load, maximum, select, sqrt, store
from springgym.core.vectors import choose, cross, dot, multiplied, plus_scaled, row, row_each, set_row


@compiled
def set_arms(k: int, problem: Problem, solids: Solids) -> Number:
    """Find where contact k pushes its bodies, from the second towards the first; returns its W [1/kg]."""
    pairs, contacts = problem.pairs, problem.contacts
    p = contacts.pair[k]
    a, b = pairs.first[p], pairs.second[p]
    n, place = row(contacts.normal, k), midpoint(k, problem)
    if solids.balls[a]:
        place = row(problem.x, solids.start[a])
    elif solids.balls[b]:
        place = row(problem.x, solids.start[b])
    first = load(contacts.particle, 4 * k) < 1.0 * solids.start[b]  # whose weights are positive
    n = choose(first, n, -1.0 * n)
    set_row(contacts.normal, k, n)
    if not (solids.balls[a] or solids.balls[b]):
        place = on_skin(place, n, k, problem, contacts.spheres)
    set_row(solids.arm, 2 * k, place - row(solids.point, a))
    set_row(solids.arm, 2 * k + 1, place - row(solids.point, b))
    return inverse_mass_of_both(n, k, problem, solids)


@compiled
def midpoint(k: int, problem: Problem) -> Vector:
    """Return the place halfway between the two points of contact k [m]."""
    contacts, place = problem.contacts, 0.0 * row(problem.contacts.normal, k)
    for j in range(contacts.members[k]):
        weight = load(contacts.weight, 4 * k + j)
        half = 0.5 * maximum(weight, -1.0 * weight)
        place = plus_scaled(place, half, row_each(problem.x, load(contacts.particle, 4 * k + j)))
    return place


@compiled
def on_skin(place: Vector, n: Vector, k: int, problem: Problem, spheres: Spheres | None) -> Vector:
    """Return where contact k touches one of its bodies, if that is a sphere or a capsule; else a place."""
    if spheres is not None:
        for side in range(2):
            body = body_of(1 - side, k, problem)
            if spheres.skin[body] > 0.0:
                along = lever(body, k, problem, spheres) * n
                axis = on_axis(body, k, problem, spheres)
                place = axis + along if side == 0 else axis - along
    return place


@compiled
def on_axis(body: int, k: int, problem: Problem, spheres: Spheres) -> Vector:
    """Return the centre of a sphere, or the point of a capsule's axis that contact k concerns [m]."""
    place = row(problem.x, spheres.start[body])
    if is_capsule(body, spheres):
        contacts, place = problem.contacts, 0.0 * place
        for m in range(contacts.members[k]):
            weight = own_weight(body, k, m, problem, spheres)
            i = load(contacts.particle, 4 * k + m)
            place = plus_scaled(place, maximum(weight, -1.0 * weight), row_each(problem.x, i))
    return place


@compiled
def velocity_at(v: Rows, body: int, arm: Vector, solids: Solids) -> Vector:
    """Return the velocity of a body at an arm from its point."""
    return row(v, 2 * body) + cross(turning_of(body, row(v, 2 * body + 1), solids), arm)


@compiled
def turning_of(body: int, moment: Vector, solids: Solids) -> Vector:
    """Return the angular velocity of a body with an angular momentum."""
    return multiplied(row(solids.turn, 2 * body), row(solids.turn, 2 * body + 1), moment)


@compiled
def between(v: Rows, k: int, problem: Problem, solids: Solids) -> Vector:
    """Return the velocity of the first body of contact k relative to the second."""
    p = problem.contacts.pair[k]
    first = velocity_at(v, problem.pairs.first[p], row(solids.arm, 2 * k), solids)
    return first - velocity_at(v, problem.pairs.second[p], row(solids.arm, 2 * k + 1), solids)


@compiled
def inverse_mass_of(body: int, push: Vector, moment: Vector, solids: Solids) -> Number:
    """Return twice the kinetic energy that a body at rest has from an impulse and a moment."""
    return load(solids.lightness, body) * dot(push, push) + dot(moment, turning_of(body, moment, solids))


@compiled
def inverse_mass_of_both(along: Vector, k: int, problem: Problem, solids: Solids) -> Number:
    """Return W of contact k along a unit vector [1/kg]; 0 along none."""
    p = problem.contacts.pair[k]
    moment = cross(row(solids.arm, 2 * k), along)
    first = inverse_mass_of(problem.pairs.first[p], along, moment, solids)
    moment = cross(row(solids.arm, 2 * k + 1), along)
    return first + inverse_mass_of(problem.pairs.second[p], along, moment, solids)


@compiled
def push_body(
    v: Rows, body: int, scale: Number, push: Vector, moment: Vector, on: Mask, solids: Solids
) -> None:
    """Give a body ``scale`` times an impulse and a moment, in some lanes; the others are left to the bit."""
    velocity, spin = row(v, 2 * body), row(v, 2 * body + 1)
    faster = plus_scaled(velocity, scale * load(solids.lightness, body), push)
    set_row(v, 2 * body, choose(on, faster, velocity))
    set_row(v, 2 * body + 1, choose(on, plus_scaled(spin, scale, moment), spin))


@compiled
def push_both(v: Rows, k: int, j: Vector, on: Mask, problem: Problem, solids: Solids) -> None:
    """Give the bodies of contact k opposite impulses."""
    pairs, p = problem.pairs, problem.contacts.pair[k]
    push_body(v, pairs.first[p], 1.0, j, cross(row(solids.arm, 2 * k), j), on, solids)
    push_body(v, pairs.second[p], -1.0, j, cross(row(solids.arm, 2 * k + 1), j), on, solids)
    count_change(sqrt(dot(j, j)) * load(problem.contacts.inverse_mass, k) / pairs.reach[p], on, solids)


@compiled
def count_change(change: Number, on: Mask, solids: Solids) -> None:
    """Keep the largest `CHANGE`."""
    most = load(solids.turns, CHANGE)
    store(solids.turns, CHANGE, maximum(most, select(on, change, 0.0)))


@compiled
def push_ends_of_both(
    v: Rows, k: int, pushes: Ends, mean: Number, on: Mask, problem: Problem, solids: Solids
) -> Vector:
    """Give the bodies of contact k of two edges what `springgym.contact.solver.push_ends` says.

    Returns the impulse on the first body.
    """
    pairs, contacts, x = problem.pairs, problem.contacts, problem.x
    p = contacts.pair[k]
    a, b = pairs.first[p], pairs.second[p]
    here, there = row(solids.point, a), row(solids.point, b)
    g0, g1, g2, g3 = pushes
    first = cross(row_each(x, load(contacts.particle, 4 * k)) - here, g0)
    first = first + cross(row_each(x, load(contacts.particle, 4 * k + 1)) - here, g1)
    second = cross(row_each(x, load(contacts.particle, 4 * k + 2)) - there, g2)
    second = -1.0 * (second + cross(row_each(x, load(contacts.particle, 4 * k + 3)) - there, g3))
    push = g0 + g1
    size = inverse_mass_of(a, push, first, solids) + inverse_mass_of(b, push, second, solids)
    q = gradient_impulse(problem.span, mean, size)
    push_body(v, a, q, push, first, on, solids)
    push_body(v, b, -1.0 * q, push, second, on, solids)
    count_change(sqrt(q * q * size * load(contacts.inverse_mass, k)) / pairs.reach[p], on, solids)
    return q * push


@compiled
def gradient_impulse(span: Span, mean: Number, size: Number) -> Number:
    """Return −q, the impulse of the gradient of an energy that is ``mean`` per Φ; ``size`` is G."""
    return (-1.0 * span.whole) * mean / (1.0 + (span.out * span.whole) * mean * size)


@compiled
def among_going(on: Mask, solids: Solids | None) -> Mask:
    """Return where a mask holds in copies whose impulses are to change: in all, if no bodies are rigid."""
    if solids is not None:
        return select(on, load(solids.turns, GOING), 0.0) > 0.5
    return on
