"""Resist the turning of two bodies that touch: rolling and torsional resistance between bodies.

Where a sphere or a capsule touches another body with the push J, a couple q acts on the first
body and −q on the second, and changes their angular velocities by I⁻¹ q and −I⁻¹ q. With ω = ω₁ − ω₂ and the
unit normal n, it stops ω − (ω · n) n, which is rolling, as far as its part across n is at most ρ J, and
(ω · n) n, which is spinning, as far as its part along n is at most τ J (`springgym.contact.cone`).

Friction and couple are found from each other, in passes. They begin with the friction that stops the slip if
the couple stops all rolling. The couple −ω/g does so, with g = d · (I₁⁻¹ + I₂⁻¹) d along the direction d of
ω. Beside it, an impulse of 1 along s changes the slip by K and by what the couple that stops the rolling by s
changes it.

The particles of a body get (I⁻¹ q) × (xᵢ − c), as in `springgym.contact.spheres`: no spring is strained.
"""

from __future__ import annotations

from springgym.contact.cone import part_resisted, within_cone
from springgym.contact.records import LEAST, ContactRows, Problem, Resistance, Solids, Spheres
from springgym.contact.solids import count_change, midpoint, on_skin, push_body, turning_of
from springgym.contact.spheres import body_of, spin_of, turn_body, turned
from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Rows, Vector
from springgym.core.lanes import load, maximum, select, sqrt
from springgym.core.vectors import TINY, choose, cross, dot, row, set_row


@compiled
def begin_couple(k: int, contacts: ContactRows, resistance: Resistance | None) -> None:
    """Set the couple of contact k to zero."""
    if resistance is not None:
        set_row(contacts.couple, k, 0.0 * row(contacts.normal, k))


# --- How bodies turn --------------------------------------------------------------------------------------


@compiled
def turning_by(body: int, moment: Vector, solids: Solids | None, spheres: Spheres | None) -> Vector:
    """Return I⁻¹ times the moment of an impulse on a body."""
    if solids is not None:
        return turning_of(body, moment, solids)
    if spheres is not None:
        return turned(body, moment, spheres)
    raise LookupError("neither rigid bodies nor spheres")


@compiled
def spin(
    v: Rows, side: int, k: int, problem: Problem, solids: Solids | None, spheres: Spheres | None
) -> Vector:
    """Return ω of the first or the second body of contact k [rad/s]."""
    body = body_of(side, k, problem)
    if solids is not None:
        return turning_of(body, row(v, 2 * body + 1), solids)
    if spheres is not None:
        return spin_of(body, v, problem, spheres)
    raise LookupError("neither rigid bodies nor spheres")


@compiled
def turning_between(v: Rows, k: int, problem: Problem) -> Vector:
    """Return ω of the first body of contact k less that of the second [rad/s]."""
    solids, spheres = problem.contacts.solids, problem.contacts.spheres
    return spin(v, 0, k, problem, solids, spheres) - spin(v, 1, k, problem, solids, spheres)


@compiled
def turning_of_both(moment: Vector, k: int, problem: Problem) -> Vector:
    """Return the change of ω by a couple on the first body of contact k, and its opposite on the second."""
    solids, spheres = problem.contacts.solids, problem.contacts.spheres
    first = turning_by(body_of(0, k, problem), moment, solids, spheres)
    return first + turning_by(body_of(1, k, problem), moment, solids, spheres)


@compiled
def facing(k: int, problem: Problem, solids: Solids | None, spheres: Spheres | None) -> Number:
    """Return the sign of contact k: 1 where its slip is the first body's relative to the second, else −1.

    Friction and normal have the same sign.
    """
    one = 1.0 + 0.0 * load(problem.contacts.gap, k)
    if solids is None and spheres is not None:
        starts = 1.0 * spheres.start[body_of(1, k, problem)]
        return select(load(problem.contacts.particle, 4 * k) < starts, one, -1.0)
    return one


@compiled
def arm_of(side: int, k: int, problem: Problem, solids: Solids | None, spheres: Spheres | None) -> Vector:
    """Return the arm from the first or the second body's centre to where contact k touches [m]."""
    if solids is not None:
        return row(solids.arm, 2 * k + side)
    if spheres is not None:
        n = facing(k, problem, solids, spheres) * row(problem.contacts.normal, k)
        place = on_skin(midpoint(k, problem), n, k, problem, spheres)
        return place - row(spheres.centre, body_of(side, k, problem))
    raise LookupError("neither rigid bodies nor spheres")


@compiled
def slip_by_couple(q: Vector, k: int, problem: Problem) -> Vector:
    """Return by how much a couple changes the slip of contact k [m/s]."""
    solids, spheres = problem.contacts.solids, problem.contacts.spheres
    slip = 0.0 * q
    for side in range(2):
        changed = turning_by(body_of(side, k, problem), q, solids, spheres)
        slip = slip + cross(changed, arm_of(side, k, problem, solids, spheres))
    n = row(problem.contacts.normal, k)
    return facing(k, problem, solids, spheres) * (slip - dot(slip, n) * n)


@compiled
def turning_by_impulse(along: Vector, k: int, problem: Problem) -> Vector:
    """Return by how much a unit impulse of friction in contact k changes ω [rad/s]."""
    solids, spheres = problem.contacts.solids, problem.contacts.spheres
    changed = 0.0 * along
    for side in range(2):
        moment = cross(arm_of(side, k, problem, solids, spheres), along)
        changed = changed + turning_by(body_of(side, k, problem), moment, solids, spheres)
    return facing(k, problem, solids, spheres) * changed


# --- Couples ----------------------------------------------------------------------------------------------


@compiled
def twist(
    v: Rows, k: int, q: Vector, acts: Mask, problem: Problem, solids: Solids | None, spheres: Spheres | None
) -> None:
    """Apply the angular impulse q of a couple [N·m·s] to the bodies of contact k, in some lanes."""
    for side in range(2):
        body = body_of(side, k, problem)
        one = 1.0 if side == 0 else -1.0
        if solids is not None:
            push_body(v, body, one, 0.0 * q, q, acts, solids)
        elif spheres is not None:
            turn_body(v, body, one, turned(body, q, spheres), acts, problem, spheres)
    if solids is not None:
        slip = slip_by_couple(q, k, problem)
        reach = problem.pairs.reach[problem.contacts.pair[k]]
        count_change(sqrt(dot(slip, slip)) / reach, acts, solids)


@compiled
def couple_against(rate: Vector, k: int, problem: Problem) -> Vector:
    """Return the couple that stops an angular velocity along its own direction."""
    direction = 1.0 / (sqrt(dot(rate, rate)) + TINY) * rate
    gives = dot(direction, turning_of_both(direction, k, problem)) + TINY
    return -1.0 / gives * rate


@compiled
def stop_turning(v: Rows, k: int, acts: Mask, problem: Problem, resistance: Resistance | None) -> None:
    """Apply the couples that stop rolling and then spinning in contact k, as far as its push allows."""
    if resistance is not None:
        contacts = problem.contacts
        p, n, push = contacts.pair[k], row(contacts.normal, k), load(contacts.impulse, k)
        for part in range(2):
            old = row(contacts.couple, k)
            rate, held, limit = part_resisted(
                part, turning_between(v, k, problem), old, n, push, resistance, p
            )
            change = within_cone(held + couple_against(rate, k, problem), limit) - held
            change = choose(acts, change, 0.0 * change)
            set_row(contacts.couple, k, old + change)
            twist(v, k, change, acts, problem, contacts.solids, contacts.spheres)


@compiled
def without_turning(
    slip: Vector, inverse: Number, v: Rows, k: int, problem: Problem
) -> tuple[Vector, Number]:
    """Return the slip of contact k if a couple stopped all rolling, and K beside such a couple.

    ``inverse`` is K along the slip.
    """
    n = row(problem.contacts.normal, k)
    rate = turning_between(v, k, problem)
    stops = couple_against(rate - dot(rate, n) * n, k, problem)
    slip = slip + slip_by_couple(stops, k, problem)
    along = 1.0 / (sqrt(dot(slip, slip)) + TINY) * slip
    rate = turning_by_impulse(along, k, problem)
    stops = couple_against(rate - dot(rate, n) * n, k, problem)
    left = inverse + dot(along, slip_by_couple(stops, k, problem))
    return slip, maximum(left, LEAST * inverse)


@compiled
def energy_of_turning(v: Rows, k: int, problem: Problem, resistance: Resistance | None) -> Number:
    """Return the energy that the couple of contact k took from the turning [J]."""
    lost = 0.0 * load(problem.contacts.gap, k)
    if resistance is not None:
        rate = turning_between(v, k, problem) + turning_between(problem.before, k, problem)
        lost = -0.5 * dot(row(problem.contacts.couple, k), rate)
    return lost
