"""Round features of bodies at surfaces: what rolls.

A feature is an ellipsoid in the rest shape, with the centre ξc and the matrix A; its carriers say where each
of its material points is by constant weights, affine in ξ (`springgym.bodies.round`):

    x(ξ) = Σ wᵢ(ξ) xᵢ,    wᵢ(ξ) = wᵢ(ξc) + Bᵢ · (ξ − ξc).

A surface whose height has the gradient n is met at the support point, with g = Fᵀ n and F = Σ xᵢ ⊗ Bᵢ,

    ξ = ξc − A g/√(g · A g).

At the node of a step that is a row of contact: the gap d is the height of x(ξ), its speed is u = n · Σ wᵢ vᵢ,
its inverse mass W = Σ wᵢ²/mᵢ, and the impulse J n moves particle i by wᵢ J n/mᵢ. The gap h₀ of
`springgym.contact.law` is that of the feature where the step begins, a = d + (h/2) u + s that where all else
would end it: what the point of contact gains on its way over the skin, s, of second order in the angle that a
step turns by, is taken from the velocities before contact. Read backwards a step is, but for what contact
changes of s, one by the same rule, so that the energy of what rolls does not drift. Each impulse p changes
the kinetic energy by p · (v₋ + v₊)/2 of the point ξ, which the ledger enters.

Friction is Coulomb's. What sticks is the point that touches at the end of the way: its slip is
s = P Σ w′ᵢ vᵢ with P = 1 − n nᵀ and the weights w′ of the support point where the particles are by then, and
an impulse j of friction, which acts at the point ξ of the node, changes it by K j, K = Σ wᵢ w′ᵢ/mᵢ. With
w′ = w friction that sticks is of first order in h: a disk precesses 1.6 % too slowly. (A rolling body moves
the point of contact over its skin; for the rigid bodies that are the limit of stiff springs see Kane &
Levinson, Int. J. Non-Linear Mech. 17 (1982) 175, doi:10.1016/0020-7462(82)90017-8.)

Resistance to rolling and to spinning (`springgym.contact.cone`) is a couple q, dry as friction is: what
stops the part of ω across n, or along it, or as much as the push allows. ω is that of the feature's
carriers, ω = I⁻¹ Σ mᵢ rᵢ × vᵢ with their arms rᵢ from their centre of mass and their inertia I, and a couple
moves them by δvᵢ = (I⁻¹ q) × rᵢ. That is no momentum, the angular momentum q, and the work q · (ω₋ + ω₊)/2.
Couple and friction act on each other. What would stop both the slip and the turning begins, and each then
follows from the other, in turns.

A rigid body is told by its particles, which keep their shape. An impulse p at the arm r from its centre of
mass, or its pin, moves them as one body (`Carrier`),

    δv = p/M,    δω = I⁻¹ (r × p),    δvᵢ = δv + δω × rᵢ,

so that W along n is 1/M + (r × n) · I⁻¹ (r × n). Its ways are flights, curved as they are. As it turns, ω
does not stay what it is at the node: the slip at the end of the way is that of the point which touches there,
with the arm r′ and the inertia I′ that the body has by then, and K is 1/M + (r′ × n) · I′⁻¹ (r × n).

On a curved surface n is found in turns from the point and the point from n: they agree where the feature is
less curved outwards than the surface is inwards.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from springgym.bodies import Body
from springgym.bodies.round import weights
from springgym.contact.cone import part_resisted, within_cone
from springgym.contact.law import Span, barrier_energy, meet
from springgym.contact.records import LEAST, PASSES, Resistance, Rolling, Rounds, Surfaces
from springgym.contact.surfaces import coefficient, count, standing, strength_and_reach
from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.core.lanes import any_lane, epsilon, load, maximum, minimum, select, sqrt
from springgym.core.vectors import (
    TINY,
    add_scaled,
    choose,
    cross,
    dot,
    inverse_symmetric,
    multiplied,
    plus_scaled,
    row,
    set_row,
    unit,
    vec,
)
from springgym.terms import Terms

TURNS = 40
"""How often the features and surfaces that know of each other are taken in turn, at the most."""

AGREED = 1e-9
"""Change of a way by the last turn, as a share of Δ, at which they agree."""

BENDS = 6
"""Turns in which a point and the normal of a curved surface find each other."""

LIFTS = 4
"""Newton's steps that lift a body to be read."""

LOW, TAKEN = 1e-5, 0.2
"""Shares of Δ. What begins a step nearer than the first was missed: its point of contact went so far over
the skin in a step, as that of a coin that falls flat, that it is behind the surface. Its gaps are taken as
farther by what lets it begin at the second, so that it is pushed out gently, and not within a step."""

AWAY = 0.5
"""K is taken for at least this share of W: a flat disk has it less where the point that touches runs away
within half a step, and there friction waits for the next."""


class Way(NamedTuple):
    """The straight ways that particles take: positions and, if they move on, velocities and for how long."""

    rows: Rows
    """(N, 3) positions [m]; or velocities, of which a point's is asked for"""
    v: Rows | None
    """(N, 3) velocities [m/s]; None if they stay"""
    tau: Number
    """for how long they move on [s]"""


class Carrier(NamedTuple):
    """A rigid body that carries round features, as impulses move it.

    Its point is the centre of mass or, of a pinned body, the pin. I⁻¹ about it is xx, yy, zz; xy, xz, yz.
    """

    begin: Rows
    """(N, 3) positions of its particles where the step begins [m]"""
    end: Rows
    """(N, 3) positions where the step would end without contact [m]"""
    leaving: Rows
    """(N, 3) velocities there, with the impulses found so far [m/s]"""
    lightness: Number
    """1/M [1/kg]; 0 of a pinned body"""
    point: Vector
    """position of the body's point at the node [m]"""
    turn: tuple[Vector, Vector]
    """inverse inertia I⁻¹ at the node [1/(kg·m²)]"""
    end_point: Vector
    """position of the body's point where the step would end without contact [m]"""
    end_turn: tuple[Vector, Vector]
    """inverse inertia I⁻¹ there [1/(kg·m²)]"""


class Carriers(NamedTuple):
    """Centre of mass and inverse inertia of the particles that carry a feature, at the node."""

    centre: Vector
    """[m]"""
    diagonal: Vector
    """Components xx, yy, zz of I⁻¹ [1/(kg·m²)]"""
    across: Vector
    """Components xy, xz, yz of I⁻¹ [1/(kg·m²)]"""


class RoundProblem(NamedTuple):
    """All that the impulses of surfaces on the round features of a body at a node follow from."""

    x: Rows
    """(N, 3) positions at the node [m]"""
    before: Rows
    """(N, 3) velocities before it [m/s]"""
    span: Span
    """the time of the node"""
    space: Rolling | None
    """None without round features, where this is not asked for"""
    rounds: Rounds
    terms: Terms
    carrier: Carrier | None
    """the rigid body that carries the features; None where particles move by themselves"""


def packed_rounds(body: Body) -> Rounds:
    """Return the round features of a body as compiled functions take them."""
    particle, base, slope = [np.zeros(0, int)], [np.zeros(0)], [np.zeros((0, 3))]
    for feature in body.rounds:
        carriers = feature.carriers(len(body.masses))
        constant, steep = weights(body.masses, body.positions, carriers)
        particle.append(carriers)
        base.append(constant + steep @ feature.centre)
        slope.append(steep)
    ends = np.cumsum([len(own) for own in particle])
    return Rounds(
        first=ends[:-1].astype(np.uint32),
        behind=ends[1:].astype(np.uint32),
        particle=np.concatenate(particle).astype(np.uint32),
        base=np.concatenate(base),
        slope=np.ascontiguousarray(np.concatenate(slope)),
        matrix=np.array([feature.matrix for feature in body.rounds]).reshape(-1, 3),
    )


@compiled
def rolls(rounds: Rounds | None) -> bool:
    """Tell whether a body has round features."""
    if rounds is None:
        return False
    return rounds.first.size > 0


# --- Material points --------------------------------------------------------------------------------------


@compiled
def weight(c: int, point: Vector, rounds: Rounds) -> Number:
    """Return the weight of carrier ``c`` at a point, ξ − ξc, of its feature."""
    return load(rounds.base, c) + dot(row(rounds.slope, c), point)


@compiled
def moved(i: int, way: Way, v: Rows | None) -> Vector:
    """Return the row of particle ``i`` that a way ends with."""
    if v is None:
        return row(way.rows, i)
    return plus_scaled(row(way.rows, i), way.tau, row(v, i))


@compiled
def at(e: int, point: Vector, way: Way, rounds: Rounds) -> Vector:
    """Return where a point of feature ``e`` is after a way of positions; or how it moves, of velocities."""
    total = 0.0 * point
    for c in range(rounds.first[e], rounds.behind[e]):
        total = plus_scaled(total, weight(c, point, rounds), moved(rounds.particle[c], way, way.v))
    return total


@compiled
def support(e: int, n: Vector, way: Way, rounds: Rounds) -> Vector:
    """Return the point, ξ − ξc, of feature ``e`` farthest against n, after a way."""
    g = 0.0 * row(way.rows, 0)
    for c in range(rounds.first[e], rounds.behind[e]):
        g = plus_scaled(g, dot(n, moved(rounds.particle[c], way, way.v)), row(rounds.slope, c))
    pull = vec(
        dot(row(rounds.matrix, 3 * e), g),
        dot(row(rounds.matrix, 3 * e + 1), g),
        dot(row(rounds.matrix, 3 * e + 2), g),
    )
    return -1.0 / sqrt(dot(g, pull) + TINY) * pull


@compiled
def nearest(
    e: int, k: int, way: Way, shift: Vector, rounds: Rounds, surfaces: Surfaces
) -> tuple[Vector, Vector, Number, Number]:
    """Return where feature ``e`` is nearest to surface ``k``: the point ξ − ξc, n, n² and the gap [m].

    That is after a way of all particles, and a ``shift`` [m].
    """
    point = 0.0 * shift
    n, square, gap = standing(k, at(e, point, way, rounds) + shift, surfaces)
    for _ in range(1 if surfaces.coupled is None else BENDS):
        point = support(e, n, way, rounds)
        n, square, gap = standing(k, at(e, point, way, rounds) + shift, surfaces)
    return point, 0.0 * shift + n, 0.0 * gap + square, gap


@compiled
def ends_of_step(problem: RoundProblem, carrier: Carrier | None) -> tuple[Way, Way]:
    """Return the ways to where the step begins, and to where it would end without contact."""
    span, before, after = problem.span, problem.before, problem.space.velocity
    if carrier is None:
        return Way(problem.x, before, -1.0 * span.lead), Way(problem.x, after, span.out)
    none = 0.0 * span.out
    return Way(carrier.begin, before, none), Way(carrier.end, after, none)


@compiled
def inverse_mass(
    e: int, first: Vector, second: Vector, along: Vector, problem: RoundProblem, carrier: Carrier | None
) -> Number:
    """Return the inverse mass between two points of feature ``e`` along a vector [1/kg].

    An impulse of 1 N·s at the ``first`` point at the node changes the velocity of the ``second`` at the end
    of the way by this. Where particles move by themselves it is Σ w w′/m.
    """
    rounds, total = problem.rounds, 0.0 * first[0]
    if carrier is None:
        for c in range(rounds.first[e], rounds.behind[e]):
            both = weight(c, first, rounds) * weight(c, second, rounds)
            total = total + both * load(problem.terms.particles.inverse_mass, rounds.particle[c])
        return total
    there = at(e, second, Way(carrier.end, None, None), rounds) - carrier.end_point
    spun = turned(carrier.end_turn, cross(arm(e, first, problem, carrier), along))
    return carrier.lightness + dot(cross(there, along), spun) / (dot(along, along) + TINY)


@compiled
def inverse_mass_at_node(
    e: int, point: Vector, along: Vector, problem: RoundProblem, carrier: Carrier | None
) -> Number:
    """Return the inverse W of the effective mass of a point of feature ``e`` along a vector [1/kg]."""
    if carrier is None:
        return inverse_mass(e, point, point, along, problem, None)
    moment = cross(arm(e, point, problem, carrier), along)
    return carrier.lightness + dot(moment, turned(carrier.turn, moment)) / (dot(along, along) + TINY)


@compiled
def turned(turn: tuple[Vector, Vector], moment: Vector) -> Vector:
    """Return the angular velocity that the moment of an impulse gives a body: I⁻¹ times it."""
    return multiplied(turn[0], turn[1], moment)


@compiled
def arm(e: int, point: Vector, problem: RoundProblem, carrier: Carrier) -> Vector:
    """Return the arm of a point of feature ``e`` from a rigid body's own at the node [m]."""
    return at(e, point, Way(problem.x, None, None), problem.rounds) - carrier.point


@compiled
def give(
    e: int, point: Vector, impulse: Vector, v: Rows, problem: RoundProblem, carrier: Carrier | None
) -> None:
    """Give a point of feature ``e`` an impulse [N·s]."""
    rounds, particles = problem.rounds, problem.terms.particles
    if carrier is None:
        for c in range(rounds.first[e], rounds.behind[e]):
            i = rounds.particle[c]
            add_scaled(v, i, weight(c, point, rounds) * load(particles.inverse_mass, i), impulse)
    else:
        moment = cross(arm(e, point, problem, carrier), impulse)
        give_body(carrier.lightness * impulse, moment, v, problem, carrier)


@compiled
def give_body(faster: Vector, moment: Vector, v: Rows, problem: RoundProblem, carrier: Carrier) -> None:
    """Add ``faster`` [m/s] to a rigid body's velocity, and ``moment`` [N·m·s] to its angular momentum."""
    spun, later = turned(carrier.turn, moment), turned(carrier.end_turn, moment)
    for i in range(problem.terms.particles.mass.size):
        set_row(v, i, row(v, i) + (faster + cross(spun, row(problem.x, i) - carrier.point)))
        there = row(carrier.end, i) - carrier.end_point
        set_row(carrier.leaving, i, row(carrier.leaving, i) + (faster + cross(later, there)))


@compiled
def slip_at_end(
    e: int, k: int, v: Rows, problem: RoundProblem, carrier: Carrier | None
) -> tuple[Vector, Vector]:
    """Return the point, ξ − ξc, of feature ``e`` that touches surface ``k`` at the end of the way, and how it
    moves there [m/s]."""
    rounds, none = problem.rounds, 0.0 * row(problem.x, 0)
    if carrier is None:
        way = Way(problem.x, v, problem.span.out)
        there, _, _, _ = nearest(e, k, way, none, rounds, problem.terms.surfaces)
        return there, at(e, there, Way(v, None, None), rounds)
    there, _, _, _ = nearest(e, k, Way(carrier.end, None, None), none, rounds, problem.terms.surfaces)
    return there, at(e, there, Way(carrier.leaving, None, None), rounds)


# --- The node ---------------------------------------------------------------------------------------------


@compiled
def roll(problem: RoundProblem, again: bool) -> bool:
    """Find what surfaces give a body by its round features; tell whether they touch it in any copy.

    All else takes the velocities from those before the node to those of the `Rolling`. If this is called
    ``again`` at the same node, with other velocities, the rows keep what `begin_row` set.
    """
    x, span, space, rounds, surfaces = (
        problem.x,
        problem.span,
        problem.space,
        problem.rounds,
        problem.terms.surfaces,
    )
    for i in range(x.shape[0]):
        for rows in (space.change, space.rub, space.force):
            set_row(rows, i, vec(0.0, 0.0, 0.0))
    found, none = False, 0.0 * row(x, 0)
    before, after = ends_of_step(problem, problem.carrier)
    for e in range(rounds.first.size):
        for k in range(count(surfaces.kinds)):
            r = e * count(surfaces.kinds) + k
            if not again:
                begin_row(r, e, k, before, problem)
            point, n, size = row(space.point, r), row(space.normal, r), row(space.size, r)
            start, inverse = size[0], size[2]
            _, _, _, ahead = nearest(e, k, after, none, rounds, surfaces)
            base = ahead - span.out * dot(n, at(e, point, Way(space.velocity, None, None), rounds))
            set_row(space.size, r, vec(start, base, inverse))
            set_row(space.push, r, vec(0.0, 0.0, 0.0))
            set_row(space.friction, r, vec(0.0, 0.0, 0.0))
            begin_couple(r, space, problem.terms.resistance)
            if any_lane(minimum(start, ahead) < surfaces.reach):
                found = True
    if found:
        solve(problem)
        if problem.carrier is None:
            sum_up(problem)
    return found


@compiled
def begin_row(r: int, e: int, k: int, before: Way, problem: RoundProblem) -> None:
    """Set what positions alone determine in row ``r``: point, normal, first gap and inverse mass."""
    space, rounds, surfaces = problem.space, problem.rounds, problem.terms.surfaces
    none = 0.0 * row(problem.x, 0)
    point, n, square, _ = nearest(e, k, Way(problem.x, None, None), none, rounds, surfaces)
    _, _, _, start = nearest(e, k, before, none, rounds, surfaces)
    inverse = square * inverse_mass_at_node(e, point, n, problem, problem.carrier)
    set_row(space.point, r, point)
    set_row(space.normal, r, n)
    set_row(space.size, r, vec(start, start, inverse))


@compiled
def begin_couple(r: int, space: Rolling, resistance: Resistance | None) -> None:
    """Set the couple of row ``r`` to zero, if the scene has rolling or torsional resistance."""
    if resistance is not None:
        set_row(space.couple, r, vec(0.0, 0.0, 0.0))


@compiled
def gaps(r: int, e: int, v: Rows, without: Number, problem: RoundProblem) -> tuple[Number, Number]:
    """Return the gaps [m] of row ``r`` where the step begins and ends, ``without`` some of its speed.

    What was missed is taken as farther.
    """
    space, reach = problem.space, problem.terms.surfaces.reach
    size, n, point = row(space.size, r), row(space.normal, r), row(space.point, r)
    speed = dot(n, at(e, point, Way(v, None, None), problem.rounds))
    taken = select(size[0] < LOW * reach, TAKEN * reach, size[0])
    return taken, size[1] + (taken - size[0]) + problem.span.out * (speed - without)


@compiled
def solve(problem: RoundProblem) -> None:
    """Find the impulses of all rows, each from what all others give, in turns until they agree."""
    span, space, rounds, surfaces = problem.span, problem.space, problem.rounds, problem.terms.surfaces
    strength, reach = strength_and_reach(surfaces)
    kinds = count(surfaces.kinds)
    none = 0.0 * span.out
    beta = coefficient(problem.terms.loss, none)
    resistance = problem.terms.resistance
    by_turns = problem.carrier is not None or resistance is not None
    enough = (AGREED + 64 * epsilon(none)) * reach
    active = 1.0 + none
    for turn in range(TURNS):
        farthest = none
        for e in range(rounds.first.size):
            for k in range(kinds):
                r = e * kinds + k
                point, n, inverse = row(space.point, r), row(space.normal, r), row(space.size, r)[2]
                old = row(space.push, r)
                start, free = gaps(r, e, space.velocity, inverse * old[0], problem)
                going = active > 0.5
                touches = minimum(start, free) < reach
                if not any_lane(maximum(select(touches, active, 0.0), old[0]) > 0.0):
                    continue
                gain, ideal = meet(start, free, span, strength * inverse, reach, beta, touches)
                share = select(touches, 1.0 / (inverse + TINY), 0.0)
                new = choose(going, vec(share * gain, share * ideal, 0.0), old)
                set_row(space.push, r, new)
                change = new[0] - old[0]
                give(e, point, change * n, space.velocity, problem, problem.carrier)
                if turn == 0:
                    hold_centre(r, e, k, problem, problem.terms.friction, resistance)
                rubbed = hold_back(r, e, k, going, problem, problem.terms.friction)
                turned_by = hold_turning(r, e, k, going, problem, resistance)
                moved = span.whole * inverse * change
                farthest = maximum(farthest, maximum(moved, -moved))
                if by_turns:
                    farthest = maximum(farthest, maximum(rubbed, turned_by))
        if not by_turns and rounds.first.size * kinds == 1:
            break
        active = select(farthest > enough, active, 0.0)
        if not any_lane(active > 0.5):
            break


@compiled
def hold_back(r: int, e: int, k: int, going: Mask, problem: RoundProblem, friction: Numbers) -> Number:
    """Let friction stop what slips at row ``r``, or give as much as the push there allows.

    Returns how far that moves the point in the step [m].
    """
    changed = 0.0 * problem.span.out
    if friction is not None:
        space = problem.space
        point, n, old = row(space.point, r), row(space.normal, r), row(space.friction, r)
        v, push = space.velocity, row(space.push, r)[0]
        there, slip = slip_at_end(e, k, v, problem, problem.carrier)
        square = dot(n, n)
        slip = slip - dot(slip, n) / square * n
        least = AWAY * inverse_mass_at_node(e, point, slip, problem, problem.carrier)
        inverse = maximum(inverse_mass(e, point, there, slip, problem, problem.carrier), least) + TINY
        wanted = old - 1.0 / inverse * slip
        limit = load(friction, 0) * sqrt(square) * push
        new = within_cone(wanted, limit)
        new = choose(going, new, old)
        set_row(space.friction, r, new)
        give(e, point, new - old, v, problem, problem.carrier)
        changed = problem.span.whole * inverse * sqrt(dot(new - old, new - old))
    return changed


# --- Resistance to turning --------------------------------------------------------------------------------


@compiled
def carriers_of(e: int, problem: RoundProblem) -> Carriers:
    """Return centre of mass and inverse inertia of the particles that carry feature ``e``, at the node."""
    rounds, mass = problem.rounds, problem.terms.particles.mass
    total, centre = 0.0 * problem.span.out, 0.0 * row(problem.x, 0)
    for c in range(rounds.first[e], rounds.behind[e]):
        i = rounds.particle[c]
        total = total + load(mass, i)
        centre = plus_scaled(centre, load(mass, i), row(problem.x, i))
    centre = 1.0 / total * centre
    diagonal, across = 0.0 * centre, 0.0 * centre
    for c in range(rounds.first[e], rounds.behind[e]):
        i = rounds.particle[c]
        r = row(problem.x, i) - centre
        square = vec(r[1] * r[1] + r[2] * r[2], r[0] * r[0] + r[2] * r[2], r[0] * r[0] + r[1] * r[1])
        diagonal = plus_scaled(diagonal, load(mass, i), square)
        across = plus_scaled(across, -1.0 * load(mass, i), vec(r[0] * r[1], r[0] * r[2], r[1] * r[2]))
    tensor = diagonal[0], diagonal[1], diagonal[2], across[0], across[1], across[2]
    diagonal, across = inverse_symmetric(tensor)
    return Carriers(centre, diagonal, across)


@compiled
def turning(e: int, v: Rows, carriers: Carriers, problem: RoundProblem) -> Vector:
    """Return the angular velocity [rad/s] of the particles that carry feature ``e``."""
    rounds, momentum = problem.rounds, 0.0 * carriers.centre
    for c in range(rounds.first[e], rounds.behind[e]):
        i = rounds.particle[c]
        moment = cross(row(problem.x, i) - carriers.centre, row(v, i))
        momentum = plus_scaled(momentum, load(problem.terms.particles.mass, i), moment)
    return multiplied(carriers.diagonal, carriers.across, momentum)


@compiled
def turning_by(
    e: int, couple: Vector, carriers: Carriers, problem: RoundProblem, carrier: Carrier | None
) -> Vector:
    """Return the change of `turning` [rad/s] that the angular impulse of a couple [N·m·s] causes."""
    if carrier is not None:
        return turned(carrier.turn, couple)
    rounds, particles = problem.rounds, problem.terms.particles
    spun, momentum = multiplied(carriers.diagonal, carriers.across, couple), 0.0 * couple
    for c in range(rounds.first[e], rounds.behind[e]):
        i = rounds.particle[c]
        r, mass = row(problem.x, i) - carriers.centre, load(particles.mass, i)
        share = mass * (mass * load(particles.inverse_mass, i))
        momentum = plus_scaled(momentum, share, cross(r, cross(spun, r)))
    return multiplied(carriers.diagonal, carriers.across, momentum)


@compiled
def pivot(carriers: Carriers, carrier: Carrier | None) -> Vector:
    """Return the point [m] about which an impulse turns the body that carries a feature."""
    if carrier is None:
        return carriers.centre
    return carrier.point


@compiled
def twist(
    e: int, couple: Vector, v: Rows, carriers: Carriers, problem: RoundProblem, carrier: Carrier | None
) -> None:
    """Apply the angular impulse of a couple [N·m·s] to the particles that carry feature ``e``."""
    if carrier is None:
        rounds, particles = problem.rounds, problem.terms.particles
        spun = multiplied(carriers.diagonal, carriers.across, couple)
        for c in range(rounds.first[e], rounds.behind[e]):
            i = rounds.particle[c]
            share = load(particles.mass, i) * load(particles.inverse_mass, i)
            add_scaled(v, i, share, cross(spun, row(problem.x, i) - carriers.centre))
    else:
        give_body(0.0 * couple, couple, v, problem, carrier)


@compiled
def hold_centre(
    r: int, e: int, k: int, problem: RoundProblem, friction: Numbers, resistance: Resistance | None
) -> None:
    """Apply the friction at row ``r`` that would stop a feature's slip without rotation, at most μJ.

    Where the couple can stop all rolling, too, that is the answer. The slip is that of the point that touches
    less ω × its arm, which friction changes by K less what it changes that by.
    """
    if friction is not None and resistance is not None:
        space, rounds, carrier = problem.space, problem.rounds, problem.carrier
        carriers, v = carriers_of(e, problem), space.velocity
        point, n, old = row(space.point, r), row(space.normal, r), row(space.friction, r)
        along = unit(n)
        there, slip = slip_at_end(e, k, v, problem, carrier)
        here = Way(problem.x, None, None)
        lever = at(e, there, here, rounds) - carriers.centre
        rate = turning(e, v, carriers, problem)
        slip = slip - cross(rate - dot(rate, along) * along, lever)
        slip = slip - dot(slip, along) * along
        direction = 1.0 / (sqrt(dot(slip, slip)) + TINY) * slip
        moment = cross(at(e, point, here, rounds) - pivot(carriers, carrier), direction)
        spun = turning_by(e, moment, carriers, problem, carrier)
        whole = inverse_mass(e, point, there, direction, problem, carrier)
        inverse = maximum(whole - dot(direction, cross(spun, lever)), LEAST * whole) + TINY
        limit = load(friction, 0) * sqrt(dot(n, n)) * row(space.push, r)[0]
        wanted = old - 1.0 / inverse * slip
        new = within_cone(wanted, limit)
        set_row(space.friction, r, new)
        give(e, point, new - old, v, problem, carrier)


@compiled
def hold_turning(
    r: int, e: int, k: int, going: Mask, problem: RoundProblem, resistance: Resistance | None
) -> Number:
    """Apply the couples at row ``r`` that stop rolling and spinning, and then the friction that stops slip.

    Returns how far that moves the skin in the step [m].
    """
    changed = 0.0 * problem.span.out
    if resistance is not None:
        space, v = problem.space, problem.space.velocity
        carriers, point = carriers_of(e, problem), row(space.point, r)
        lever = at(e, point, Way(problem.x, None, None), problem.rounds) - carriers.centre
        was = turning(e, v, carriers, problem)
        for _ in range(PASSES):
            stop_turning(r, e, going, carriers, problem, resistance)
            rubbed = hold_back(r, e, k, going, problem, problem.terms.friction)
            changed = maximum(changed, rubbed)
        more = turning(e, v, carriers, problem) - was
        moved = problem.span.whole * sqrt(dot(more, more) * dot(lever, lever))
        changed = maximum(changed, moved)
    return changed


@compiled
def stop_turning(
    r: int, e: int, going: Mask, carriers: Carriers, problem: RoundProblem, resistance: Resistance
) -> None:
    """Apply the couples that stop rolling, and then spinning, at row ``r``, as far as the push allows."""
    space, v = problem.space, problem.space.velocity
    n = row(space.normal, r)
    along, push = unit(n), sqrt(dot(n, n)) * row(space.push, r)[0]
    for part in range(2):
        old = row(space.couple, r)
        rate, held, limit = part_resisted(
            part, turning(e, v, carriers, problem), old, along, push, resistance, 0
        )
        direction = 1.0 / (sqrt(dot(rate, rate)) + TINY) * rate
        gives = dot(direction, turning_by(e, direction, carriers, problem, problem.carrier)) + TINY
        change = within_cone(held - 1.0 / gives * rate, limit) - held
        change = choose(going, change, 0.0 * change)
        set_row(space.couple, r, old + change)
        twist(e, change, v, carriers, problem, problem.carrier)


@compiled
def sum_up(problem: RoundProblem) -> None:
    """Sum up what all rows give each particle, where particles move by themselves."""
    space, kinds = problem.space, count(problem.terms.surfaces.kinds)
    for e in range(problem.rounds.first.size):
        for k in range(kinds):
            r = e * kinds + k
            point, n, push = row(space.point, r), row(space.normal, r), row(space.push, r)
            impulses = push[0] * n, push[1] * n, row(space.friction, r)
            for part, v in enumerate((space.change, space.force, space.rub)):
                give(e, point, impulses[part], v, problem, None)
            sum_up_couple(r, e, problem, problem.terms.resistance)


@compiled
def sum_up_couple(r: int, e: int, problem: RoundProblem, resistance: Resistance | None) -> None:
    """Add the couple of row ``r`` to the impulses of friction, if the scene has resistance."""
    if resistance is not None:
        space = problem.space
        twist(e, row(space.couple, r), space.rub, carriers_of(e, problem), problem, None)


# --- Energy -------------------------------------------------------------------------------------------------


@compiled
def lifted_feature(shift: Vector, v: Rows, problem: RoundProblem) -> tuple[Number, Vector]:
    """Return what barriers store around a node beside what they store where it is read [J], and how far that
    is off the node [m]: by a ``shift``, and lifted off surfaces.

    ``v`` are the velocities after the node. As `springgym.contact.points.lifted`, for a whole body.
    """
    rounds, surfaces = problem.rounds, problem.terms.surfaces
    kinds, none = count(surfaces.kinds), 0.0 * row(problem.x, 0)
    strength, reach = strength_and_reach(surfaces)
    stored, lift = none[0], none + shift
    for e in range(rounds.first.size):
        for k in range(kinds):
            start, finish = gaps(e * kinds + k, e, v, none[0], problem)
            around = barrier_energy(start, strength, reach) + barrier_energy(finish, strength, reach)
            stored = stored + 0.5 * around
            lowest = 0.5 * minimum(minimum(start, finish), reach)
            for _ in range(1 if surfaces.coupled is None else LIFTS):
                _, n, square, gap = nearest(e, k, Way(problem.x, None, None), lift, rounds, surfaces)
                short = maximum(lowest - gap, 0.0)
                if not any_lane(short > 0.0):
                    break
                lift = plus_scaled(lift, short / square, n)
    return stored - feature_energy(problem.x, lift, rounds, surfaces), lift


@compiled
def feature_energy(x: Rows, shift: Vector, rounds: Rounds, surfaces: Surfaces) -> Number:
    """Return the energy [J] of a body's round features, moved by ``shift``, in the barriers of surfaces."""
    energy = 0.0 * shift[0]
    for e in range(rounds.first.size):
        for k in range(count(surfaces.kinds)):
            _, _, _, gap = nearest(e, k, Way(x, None, None), shift, rounds, surfaces)
            energy = energy + barrier_energy(gap, load(surfaces.strength, 0), surfaces.reach)
    return energy
