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

Rigid bodies are pushed at one point (`springgym.contact.solids`), where j leaves no torque.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from springgym.core.compiling import compiled
from springgym.core.kinds import Mask, Number, Numbers, Rows, Vector
from springgym.core.lanes import any_lane, load, load_each, maximum, minimum, select, sqrt, store
from springgym.core.vectors import (
    TINY,
    choose,
    cross,
    dot,
    plus_scaled,
    row,
    row_each,
    set_row,
    set_row_each,
)
from springgym.contact.solids import among_going, between, push_both, yielding_of_both
from springgym.contact.pairs import FRICTION, spend, tell

if TYPE_CHECKING:
    from springgym.forces import Particles
    from springgym.contact.solids import Solids


SHALLOW = 0.05
"""Where n is nearer to a face's plane than this sine, or along a rod, no friction acts: d/A has no bound."""

SWEEPS, TURNS = 2, 3
"""Turns of `rub` that hold back what slips, and all."""


@compiled
def lay_out(x: Rows, k: Number, friction: Numbers, room: Any) -> None:
    """Find G and H of contact k."""
    if friction is not None and room.members[k] > 2:
        n = row(room.toward, k)
        none = 0.0 * n[0]
        apart = 0.0 * n
        for j in range(room.members[k]):
            apart = plus_scaled(apart, load(room.weight, 4 * k + j), place_of(x, k, j, room))
        d = dot(apart, n)
        first = place_of(x, k, 1, room)
        if room.members[k] == 4:
            crossed = crosses(k, room)
            u = place_of(x, k, 2, room) - first
            u = choose(crossed, first - place_of(x, k, 0, room), u)
            q = place_of(x, k, 3, room) - choose(crossed, place_of(x, k, 2, room), first)
            across = cross(u, q)
            area = dot(n, across)
            steep = area * area > (SHALLOW * SHALLOW) * dot(across, across)
            scale = select(steep, d / select(steep, area, 1.0), none)
            set_row(room.tilt, 2 * k, scale * cross(q, n))
            set_row(room.tilt, 2 * k + 1, scale * cross(n, u))
            store(room.rubs, k, select(steep, 1.0 + none, none))
        else:
            u = place_of(x, k, 2, room) - first
            along = u - dot(u, n) * n
            square = dot(along, along)
            steep = square > (SHALLOW * SHALLOW) * dot(u, u)
            inverse = select(steep, 1.0 / select(steep, square, 1.0), none)
            set_row(room.tilt, 2 * k, (d * inverse) * along)
            set_row(room.tilt, 2 * k + 1, sqrt(inverse) * along)
            store(room.rubs, k, select(steep, 1.0 + none, none))


@compiled
def place_of(x: Rows, k: Number, j: int, room: Any) -> Any:
    """Return a row of the contact's particle ``j``: its position, or its velocity."""
    return row_each(x, load(room.particle, 4 * k + j))


@compiled
def crosses(k: Number, room: Any) -> Any:
    """Say where a contact is of two edges: else it is of a vertex and a face."""
    return load(room.weight, 4 * k + 1) > 0.0


@compiled
def rub(
    w: Rows,
    v: Rows,
    turn: Any,
    count: Number,
    particles: Particles,
    pairs: Any,
    friction: Numbers,
    room: Any,
    tally: Numbers,
) -> None:
    """Hold back what slips, in two turns; in the third tell the loss, j times the mean of the slips before
    and after."""
    if friction is not None:
        for m in range(count):
            k = count - 1 - m if turn == 1 else m
            p = room.pair[k]
            limit, given = load(friction, p) * pressed(k, room, room.solids), row(room.rub, k)
            acts = limit > 0.0
            if turn < SWEEPS:
                acts = maximum(limit, dot(given, given)) > 0.0  # what was given may have to be taken back
            acts = among_going(acts, room.solids)
            if any_lane(acts):
                slip = slipping(v, k, pairs, room, room.solids)
                if turn < SWEEPS:
                    j = held_back(slip, k, given, limit, particles, pairs, room)
                    push_across(v, k, j - given, acts, particles, pairs, room, room.solids)
                    set_row(room.rub, k, choose(acts, j, given))
                else:
                    slip = slip + slipping(w, k, pairs, room, room.solids)
                    lost = select(acts, -0.5 * dot(given, slip), 0.0)
                    spend(room, p, 1, lost)
                    tell(tally, p, FRICTION, lost)


@compiled
def pressed(k: Number, room: Any, solids: Solids | None) -> Any:
    """Return the push of contact k [N·s] where friction acts; 0 where it does not."""
    push = load(room.push, k)
    if solids is not None:
        return push
    if room.members[k] == 2:
        return 0.0 * push
    return load(room.rubs, k) * push


@compiled
def slipping(v: Rows, k: Number, pairs: Any, room: Any, solids: Solids | None) -> Any:
    """Return how contact k slips (3,) [m/s]."""
    n = row(room.toward, k)
    if solids is not None:
        slip = between(v, k, pairs, room, solids)
        return slip - dot(slip, n) * n
    return slipping_particles(v, k, room)


@compiled
def slipping_particles(v: Rows, k: Number, room: Any) -> Any:
    """Return how the particles of contact k slip, those of one body as seen from the other's point."""
    n, slip = row(room.toward, k), 0.0 * row(room.toward, k)
    for j in range(room.members[k]):
        slip = plus_scaled(slip, load(room.weight, 4 * k + j), place_of(v, k, j, room))
    if room.members[k] == 3:
        along = row(room.tilt, 2 * k + 1)
        slip = dot(slip, along) * along
        turn = dot(n, place_of(v, k, 2, room) - place_of(v, k, 1, room))
        return plus_scaled(slip, turn, row(room.tilt, 2 * k))
    crossed = crosses(k, room)
    first, third = place_of(v, k, 1, room), place_of(v, k, 2, room)
    turn = dot(n, choose(crossed, first - place_of(v, k, 0, room), third - first))
    other = dot(n, place_of(v, k, 3, room) - choose(crossed, third, first))
    slip = plus_scaled(slip - dot(slip, n) * n, turn, row(room.tilt, 2 * k))
    return plus_scaled(slip, other, row(room.tilt, 2 * k + 1))


@compiled
def raised(k: Number, j: int, by: Vector, room: Any) -> Any:
    """Return gᵢ · j for the contact's particle ``j`` and an impulse ``by``."""
    g = dot(row(room.tilt, 2 * k), by)
    if room.members[k] == 3:
        return g if j == 2 else (-1.0 * g if j == 1 else 0.0 * g)
    h = dot(row(room.tilt, 2 * k + 1), by)
    crossed = crosses(k, room)
    if j == 0:
        return select(crossed, -1.0 * g, 0.0)
    if j == 1:
        return select(crossed, g, -1.0 * (g + h))
    if j == 2:
        return select(crossed, -1.0 * h, g)
    return h


@compiled
def yielding_along(
    along: Vector, k: Number, particles: Particles, pairs: Any, room: Any, solids: Solids | None
) -> Any:
    """Return K of contact k along a unit vector [1/kg]."""
    if solids is not None:
        return yielding_of_both(along, k, pairs, room, solids)
    yielding = load(room.inverse, k)
    for j in range(room.members[k]):
        lift = raised(k, j, along, room)
        i = load(room.particle, 4 * k + j)
        yielding = yielding + lift * lift * load_each(particles.inverse_mass, i)
    return yielding


@compiled
def held_back(
    slip: Vector, k: Number, given: Vector, limit: Number, particles: Particles, pairs: Any, room: Any
) -> Any:
    """Return the impulse that stops a slip, besides what was ``given``; or as much as friction can give."""
    along = 1.0 / (sqrt(dot(slip, slip)) + TINY) * slip
    yielding = yielding_along(along, k, particles, pairs, room, room.solids)
    wanted = given - 1.0 / (yielding + TINY) * slip
    size = sqrt(dot(wanted, wanted)) + TINY
    return minimum(limit / size, 1.0) * wanted


@compiled
def push_across(
    v: Rows,
    k: Number,
    j: Vector,
    acts: Mask,
    particles: Particles,
    pairs: Any,
    room: Any,
    solids: Solids | None,
) -> None:
    """Give contact k an impulse across its normal, in some lanes."""
    if solids is not None:
        push_both(v, k, j, acts, pairs, room, solids)
    else:
        give_across(v, k, j, acts, particles, room)


@compiled
def give_across(v: Rows, k: Number, j: Vector, acts: Mask, particles: Particles, room: Any) -> None:
    """Give the particles of contact k an impulse across its normal, and what takes its torque back."""
    n = row(room.toward, k)
    for m in range(room.members[k]):
        i = load(room.particle, 4 * k + m)
        before = row_each(v, i)
        after = plus_scaled(before, load(room.gain, 4 * k + m), j)
        after = plus_scaled(after, raised(k, m, j, room) * load_each(particles.inverse_mass, i), n)
        set_row_each(v, i, choose(acts, after, before))
