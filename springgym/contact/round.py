"""Round features of bodies of springs at surfaces: what rolls.

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

On a curved surface n is found in turns from the point and the point from n: they agree where the feature is
less curved outwards than the surface is inwards.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from springgym.bodies import Body
from springgym.bodies.round import weights
from springgym.contact.law import barrier_energy, meet
from springgym.contact.surfaces import Surfaces, coefficient, count, standing, strength_and_reach
from springgym.core.compiling import compiled
from springgym.core.kinds import Number, Rows, Vector
from springgym.core.lanes import any_lane, epsilon, load, maximum, minimum, select, sqrt
from springgym.core.vectors import TINY, add_scaled, choose, dot, plus_scaled, row, set_row, vec

if TYPE_CHECKING:
    from springgym.forces import Particles, Terms


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

ARRAYS = 9
"""Arrays of (particles or rows, 3) that a node computes in."""


class Rounds(NamedTuple):
    """The round features of a body."""

    first: np.ndarray
    """(features,) index of the first carrier of each feature in the arrays of carriers below"""
    behind: np.ndarray
    """(features,) and where they end"""
    particle: np.ndarray
    """(carriers,)"""
    base: np.ndarray
    """(carriers,) weight of the feature's centre"""
    slope: np.ndarray
    """(carriers, 3) B [1/m]"""
    matrix: np.ndarray
    """(3 features, 3) rows of A [m²]"""


class Rolling(NamedTuple):
    """Workspace: of particles (N, 3), and of rows, one for each feature and surface, (rows, 3)."""

    velocity: Any
    """velocities after the node with as much of contact as is known [m/s]"""
    change: Any
    """of velocity by pushes [m/s]; this and the next two as `springgym.integrators.node.Given`"""
    rub: Any
    force: Any
    point: Any
    """ξ − ξc of the support point [m]"""
    normal: Any
    """n"""
    size: Any
    """h₀ [m], d + s [m], W n² [1/kg]"""
    push: Any
    """J L [N·s], and J"""
    friction: Any
    """j [N·s]"""


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
def rolling_of(workspace: Any, first: int, rounds: Rounds | None) -> Any:
    """Return arrays of a workspace, from the ``first`` one on, as `Rolling`; None without round features."""
    if rounds is None:
        return None
    return Rolling(
        workspace[first],
        workspace[first + 1],
        workspace[first + 2],
        workspace[first + 3],
        workspace[first + 4],
        workspace[first + 5],
        workspace[first + 6],
        workspace[first + 7],
        workspace[first + 8],
    )


@compiled
def rolls(rounds: Rounds | None) -> bool:
    """Tell whether a body has round features."""
    if rounds is None:
        return False
    return rounds.first.size > 0


# --- Material points --------------------------------------------------------------------------------------


@compiled
def weight(c: int, point: Vector, rounds: Rounds) -> Any:
    """Return the weight of carrier ``c`` at a point, ξ − ξc, of its feature."""
    return load(rounds.base, c) + dot(row(rounds.slope, c), point)


@compiled
def moved(i: int, x: Rows, v: Rows | None, tau: Number) -> Any:
    """Return where particle ``i`` is after ``tau`` seconds of a straight way; now, if no ``v`` is given."""
    if v is None:
        return row(x, i)
    return plus_scaled(row(x, i), tau, row(v, i))


@compiled
def at(e: int, point: Vector, x: Rows, rounds: Rounds, v: Rows | None = None, tau: Number = None) -> Any:
    """Return where a point of feature ``e`` is, of positions; or how it moves, of velocities."""
    total = 0.0 * point
    for c in range(rounds.first[e], rounds.behind[e]):
        total = plus_scaled(total, weight(c, point, rounds), moved(rounds.particle[c], x, v, tau))
    return total


@compiled
def support(e: int, n: Vector, x: Rows, v: Rows | None, tau: Number, rounds: Rounds) -> Any:
    """Return the point, ξ − ξc, of feature ``e`` farthest against n, of particles that are `moved`."""
    g = 0.0 * row(x, 0)
    for c in range(rounds.first[e], rounds.behind[e]):
        g = plus_scaled(g, dot(n, moved(rounds.particle[c], x, v, tau)), row(rounds.slope, c))
    pull = vec(
        dot(row(rounds.matrix, 3 * e), g),
        dot(row(rounds.matrix, 3 * e + 1), g),
        dot(row(rounds.matrix, 3 * e + 2), g),
    )
    return -1.0 / sqrt(dot(g, pull) + TINY) * pull


@compiled
def nearest(
    e: int,
    k: int,
    x: Rows,
    v: Rows | None,
    tau: Number,
    shift: Vector,
    rounds: Rounds,
    surfaces: Surfaces,
) -> Any:
    """Return where feature ``e`` is nearest to surface ``k``: the point ξ − ξc, n, n² and the gap [m].

    That is, where all particles are moved by ``shift``, and go straight on for ``tau`` seconds if ``v`` is
    given.
    """
    point = 0.0 * shift
    n, square, gap = standing(k, at(e, point, x, rounds, v, tau) + shift, surfaces)
    for _ in range(1 if surfaces.coupled is None else BENDS):
        point = support(e, n, x, v, tau, rounds)
        n, square, gap = standing(k, at(e, point, x, rounds, v, tau) + shift, surfaces)
    return point, 0.0 * shift + n, 0.0 * gap + square, gap


@compiled
def yielding(e: int, first: Vector, second: Vector, particles: Particles, rounds: Rounds) -> Any:
    """Return Σ w w′/m [1/kg] of two points of feature ``e``."""
    total = 0.0 * first[0]
    for c in range(rounds.first[e], rounds.behind[e]):
        both = weight(c, first, rounds) * weight(c, second, rounds)
        total = total + both * load(particles.inverse_mass, rounds.particle[c])
    return total


@compiled
def give(e: int, point: Vector, impulse: Vector, v: Rows, particles: Particles, rounds: Rounds) -> None:
    """Give a point of feature ``e`` an impulse [N·s]."""
    for c in range(rounds.first[e], rounds.behind[e]):
        i = rounds.particle[c]
        add_scaled(v, i, weight(c, point, rounds) * load(particles.inverse_mass, i), impulse)


# --- The node ---------------------------------------------------------------------------------------------


@compiled
def roll(x: Rows, v: Rows, w: Rows, a: Rows, span: Any, rolling: Any, rounds: Rounds, terms: Terms) -> bool:
    """Find what surfaces give a body by its round features at a node; whether they touch it in any copy.

    All else takes the velocities from ``v`` to ``w``, and on by a kick of the accelerations ``a``.
    """
    for i in range(x.shape[0]):
        set_row(rolling.velocity, i, plus_scaled(row(w, i), span.out, row(a, i)))
        for rows in (rolling.change, rolling.rub, rolling.force):
            set_row(rows, i, vec(0.0, 0.0, 0.0))
    found, surfaces, none = False, terms.surfaces, 0.0 * row(x, 0)
    for e in range(rounds.first.size):
        for k in range(count(surfaces.kinds)):
            r = e * count(surfaces.kinds) + k
            point, n, square, _ = nearest(e, k, x, None, None, none, rounds, surfaces)
            lead, out, after = -1.0 * span.lead, span.out, rolling.velocity
            _, _, _, start = nearest(e, k, x, v, lead, none, rounds, surfaces)
            _, _, _, ahead = nearest(e, k, x, after, out, none, rounds, surfaces)
            set_row(rolling.point, r, point)
            set_row(rolling.normal, r, n)
            inverse = square * yielding(e, point, point, terms.particles, rounds)
            base = ahead - out * dot(n, at(e, point, after, rounds))
            taken = select(start < LOW * surfaces.reach, TAKEN * surfaces.reach, start)
            set_row(rolling.size, r, vec(taken, base + (taken - start), inverse))
            set_row(rolling.push, r, vec(0.0, 0.0, 0.0))
            set_row(rolling.friction, r, vec(0.0, 0.0, 0.0))
            if any_lane(minimum(start, ahead) < surfaces.reach):
                found = True
    if found:
        solve(x, span, rolling, rounds, terms)
        sum_up(rolling, rounds, terms)
    return found


@compiled
def gaps(r: int, e: int, v: Rows, without: Number, span: Any, rolling: Any, rounds: Rounds) -> Any:
    """Return the gaps [m] of row ``r`` where the step begins and ends, ``without`` some of its speed."""
    size, n, point = row(rolling.size, r), row(rolling.normal, r), row(rolling.point, r)
    return size[0], size[1] + span.out * (dot(n, at(e, point, v, rounds)) - without)


@compiled
def solve(x: Rows, span: Any, rolling: Any, rounds: Rounds, terms: Terms) -> None:
    """Find the impulses of all rows, each from what all others give, in turns until they agree."""
    surfaces, particles = terms.surfaces, terms.particles
    strength, reach = strength_and_reach(surfaces)
    kinds = count(surfaces.kinds)
    none = 0.0 * span.out
    beta = coefficient(terms.loss, none)
    enough = (AGREED + 64 * epsilon(none)) * reach
    active = 1.0 + none
    for _ in range(TURNS):
        farthest = none
        for e in range(rounds.first.size):
            for k in range(kinds):
                r = e * kinds + k
                point, n, inverse = row(rolling.point, r), row(rolling.normal, r), row(rolling.size, r)[2]
                old = row(rolling.push, r)
                mine = inverse * old[0]
                start, free = gaps(r, e, rolling.velocity, mine, span, rolling, rounds)
                going = active > 0.5
                touches = minimum(start, free) < reach
                if not any_lane(maximum(select(touches, active, 0.0), old[0]) > 0.0):
                    continue
                gain, ideal = meet(start, free, span, strength * inverse, reach, beta, touches)
                share = select(touches, 1.0 / (inverse + TINY), 0.0)
                new = choose(going, vec(share * gain, share * ideal, 0.0), old)
                set_row(rolling.push, r, new)
                change = new[0] - old[0]
                give(e, point, change * n, rolling.velocity, particles, rounds)
                if terms.friction is not None:
                    hold_back(x, r, e, k, new[0], going, span, rolling, rounds, terms)
                moved = span.whole * inverse * change
                farthest = maximum(farthest, maximum(moved, -moved))
        if rounds.first.size * kinds == 1:
            break
        active = select(farthest > enough, active, 0.0)
        if not any_lane(active > 0.5):
            break


@compiled
def hold_back(
    x: Rows,
    r: int,
    e: int,
    k: int,
    push: Number,
    going: Any,
    span: Any,
    rolling: Any,
    rounds: Rounds,
    terms: Terms,
) -> None:
    """Let friction stop what slips at row ``r``, or give as much as a ``push`` [N·s] allows."""
    point, n, old = row(rolling.point, r), row(rolling.normal, r), row(rolling.friction, r)
    v = rolling.velocity
    there, _, _, _ = nearest(e, k, x, v, span.out, 0.0 * n, rounds, terms.surfaces)
    square = dot(n, n)
    slip = at(e, there, v, rounds)
    slip = slip - dot(slip, n) / square * n
    least = AWAY * yielding(e, point, point, terms.particles, rounds)
    wanted = old - 1.0 / (maximum(yielding(e, point, there, terms.particles, rounds), least) + TINY) * slip
    limit = coefficient(terms.friction, 0.0 * push) * sqrt(square) * push
    wanted = minimum(limit / sqrt(dot(wanted, wanted) + TINY), 1.0) * wanted
    new = choose(going, wanted, old)
    set_row(rolling.friction, r, new)
    give(e, point, new - old, v, terms.particles, rounds)


@compiled
def sum_up(rolling: Any, rounds: Rounds, terms: Terms) -> None:
    """Find what each particle was given by all rows."""
    kinds = count(terms.surfaces.kinds)
    for e in range(rounds.first.size):
        for k in range(kinds):
            r = e * kinds + k
            point, n, push = row(rolling.point, r), row(rolling.normal, r), row(rolling.push, r)
            give(e, point, push[0] * n, rolling.change, terms.particles, rounds)
            give(e, point, push[1] * n, rolling.force, terms.particles, rounds)
            give(e, point, row(rolling.friction, r), rolling.rub, terms.particles, rounds)


# --- Energy -------------------------------------------------------------------------------------------------


@compiled
def lifted_feature(x: Rows, v: Rows, span: Any, rolling: Any, rounds: Rounds, terms: Terms) -> Any:
    """Return what barriers hold around a node beside what they hold where it is read [J], and its lift [m].

    ``v`` are the velocities behind the node. As `springgym.integrators.node.lifted`, for a whole body.
    """
    surfaces = terms.surfaces
    kinds, none = count(surfaces.kinds), 0.0 * row(x, 0)
    strength, reach = strength_and_reach(surfaces)
    held, lift = none[0], none
    for e in range(rounds.first.size):
        for k in range(kinds):
            r = e * kinds + k
            start, finish = gaps(r, e, v, none[0], span, rolling, rounds)
            around = barrier_energy(start, strength, reach) + barrier_energy(finish, strength, reach)
            held = held + 0.5 * around
            lowest = 0.5 * minimum(minimum(start, finish), reach)
            for _ in range(1 if surfaces.coupled is None else LIFTS):
                _, n, square, gap = nearest(e, k, x, None, None, lift, rounds, surfaces)
                short = maximum(lowest - gap, 0.0)
                if not any_lane(short > 0.0):
                    break
                lift = plus_scaled(lift, short / square, n)
    return held - feature_energy(x, lift, rounds, surfaces), lift


@compiled
def feature_energy(x: Rows, shift: Vector, rounds: Rounds, surfaces: Surfaces) -> Any:
    """Return the energy [J] of a body's round features, moved by ``shift``, in the barriers of surfaces."""
    energy = 0.0 * shift[0]
    for e in range(rounds.first.size):
        for k in range(count(surfaces.kinds)):
            _, _, _, gap = nearest(e, k, x, None, None, shift, rounds, surfaces)
            energy = energy + barrier_energy(gap, load(surfaces.strength, 0), surfaces.reach)
    return energy
