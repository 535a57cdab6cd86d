"""Contacts of a node as arrays over the copies, from the results of kernels there."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from springgym.bodies.rotations import axes
from springgym.collisions import as_met
from springgym.contact.records import (
    ENTRIES,
    FAR,
    FAST,
    GAP,
    IMPULSE,
    MISSES,
    ROWS,
    TOUCHING,
    Collisions,
    Rolling,
)
from springgym.core.blocks import numbers
from springgym.core.compiling import kernel
from springgym.core.kinds import Ragged
from springgym.core.ragged import share
from springgym.forces.memory import PHASE
from springgym.rigid import Rigid
from springgym.rigid.node import Company
from springgym.rigid.rolling import FEATURES
from springgym.rigid.surfaces import ARRAYS, NORMAL, PUSH, RUB
from springgym.scene import Scene
from springgym.surfaces import Surface, by_kind, scales
from springgym.terms import Terms

NONE = -1
"""In place of a number: no body, no surface, no contact."""

DIFFERENCE = 1e-4
"""Share of Δ over which the height above a surface is differentiated."""

ROUNDING = 1e-9
"""Smallest impulse [N·s] of a particle that is reported, as a share of its momentum; less is rounding."""


class Contacts(NamedTuple):
    """Contacts of all copies at a node, in arrays of shape (copies, most) or (copies, most, 3).

    ``most`` is the largest number of contacts in a copy. In a copy with fewer contacts, ``there`` is False
    for the other entries, their indices are −1, and all else is 0. Contacts between bodies come first, by
    pair. Those of particles with surfaces follow, by particle, and then those of round features with
    surfaces, by body. Two features have a contact if they are nearer than Δ or push each other, so two cubes
    that lie face on face have several contacts. A round feature touches a surface in one point.

    ``impulse`` acts on the first body in the step h around the node. The second body, or the surface, gets
    the opposite impulse. ``force`` is the mean over that time. At rest, the impulses of a body's contacts sum
    to its weight times h.
    """

    there: np.ndarray
    """(copies, most) mask: True where this entry holds a contact"""
    first: np.ndarray
    """(copies, most) index of the first body"""
    second: np.ndarray
    """(copies, most) index of the second body; −1 where the first body touches a surface"""
    surface: np.ndarray
    """(copies, most) index of the surface; −1 where two bodies touch"""
    particle: np.ndarray
    """(copies, most) index, among all, of the particle that touches a surface; −1 where two bodies touch, or
    a round feature and a surface"""
    point: np.ndarray
    """(copies, most, 3) position of the contact, halfway between the two sides [m]"""
    normal: np.ndarray
    """(copies, most, 3) the unit vector from the second body, or the surface, to the first"""
    gap: np.ndarray
    """(copies, most) gap between the two sides [m]; negative where they overlap"""
    impulse: np.ndarray
    """(copies, most, 3) impulse on the first body, normal and friction together [N·s]"""
    force: np.ndarray
    """(copies, most, 3) force on the first body [N]"""


class PairSums(NamedTuple):
    """Sums over all pairs of colliding bodies, (copies,): see `PairReadings`."""

    touching: np.ndarray
    """number of pairs that touch"""
    impulse: np.ndarray
    """the sum of all impulses along normals [N·s]"""
    least_gap: np.ndarray
    """the least gap of any pair, or the reach of its contact if that is less [m]"""
    misses: np.ndarray
    """number of contacts that were found too late"""
    too_fast: np.ndarray
    """number of contacts that moved by more than a fifth of Δ in a step, each counted in every such step: the
    impact is coarse"""


def pair_sums(collisions: Collisions, copies: int) -> PairSums:
    """Return the totals of each copy, summed over all pairs."""
    sums = np.empty((len(PairSums._fields), copies))
    sum_pairs(numbers(collisions.totals), collisions.pairs.reach, sums)
    return PairSums(*sums)


@kernel
def sum_pairs(totals: np.ndarray, reach: np.ndarray, sums: np.ndarray) -> None:
    """Write `PairSums` (fields, copies) of totals (blocks, pairs × entries, copies of a block)."""
    width = totals.shape[2]
    for c in range(sums.shape[1]):
        block, lane = c // width, c % width
        touching, impulse, misses, too_fast, least = 0.0, 0.0, 0.0, 0.0, math.inf
        for pair in range(reach.size):
            first = pair * ENTRIES
            touching += 1.0 if totals[block, first + TOUCHING, lane] > 0.0 else 0.0
            impulse += totals[block, first + IMPULSE, lane]
            misses += totals[block, first + MISSES, lane]
            too_fast += totals[block, first + FAST, lane]
            gap = totals[block, first + GAP, lane]
            gap = reach[pair] if gap > reach[pair] else gap
            if not math.isnan(least) and not gap >= least:  # one that is not a number is told
                least = gap
        sums[0, c], sums[1, c], sums[2, c], sums[3, c], sums[4, c] = (
            touching,
            impulse,
            least,
            misses,
            too_fast,
        )


class Here(NamedTuple):
    """A block of copies whose last node was just computed again."""

    block: int
    x: np.ndarray
    """positions of all blocks [m]"""
    v: np.ndarray
    """velocities of all blocks [m/s]"""
    workspace: Any
    """what the node was computed in"""
    terms: Any
    twin: tuple[Any, ...]
    """the rigid bodies, in rigid dynamics"""
    step: float
    """h [s]"""

    @property
    def places(self) -> np.ndarray:
        """Return positions (N, 3, width) [m]."""
        return numbers(self.x)[self.block]

    @property
    def span(self) -> np.ndarray:
        """Return the time of the node (width,) [s]: h, or of a fresh copy half of it."""
        phase = numbers(_values(self.terms.memory.marks))[self.block, PHASE]
        return np.where(phase < 0.5, 0.5, 1.0) * self.step


def clear(workspace: Any, rigid: bool) -> None:
    """Set the workspace of rigid bodies to zero: a node writes only where bodies touch."""
    if rigid:
        numbers(workspace.surfaces if isinstance(workspace, Company) else workspace)[:] = 0.0


def refusal(scene: Scene, terms: Terms) -> str:
    """Return the reason why the contacts of a scene cannot be reported; empty if they can."""
    if not scene.can_touch:
        return ""
    if terms.memory is None:
        return "contacts need a method with nodes: use verlet, and Contact in place of PaperContact"
    if scene.surfaces and len(scene.bodies) > 1 and terms.collisions is None:
        return "contacts of several bodies with surfaces need bodies that collide; give the scene collisions"
    return ""


def of_block(scene: Scene, here: Here) -> Contacts:
    """Return the contacts of a block's copies, one after another in arrays (n,), with copies in ``there``."""
    found = []
    if len(scene.meetings):
        found.append(_of_bodies(scene, here))
    if scene.surfaces:
        if here.twin:
            found += [_of_rigid(scene, n, here) for n, of in enumerate(scene.bodies) if not of.body.rounds]
        else:
            found.append(_with_surfaces(scene, here))
        found += [_of_rounds(scene, n, here) for n, of in enumerate(scene.bodies) if of.body.rounds]
    return Contacts(*(np.concatenate(of) for of in zip(*found, strict=True)))


def padded(found: list[Contacts], copies: int) -> Contacts:
    """Return contacts of some blocks as those of all copies, padded."""
    if not found:
        shapes = [(copies, 0)] * 5 + [(copies, 0, 3)] * 2 + [(copies, 0)] + [(copies, 0, 3)] * 2
        kinds = [bool, *[int] * 4, *[float] * 5]
        return Contacts(*(np.zeros(*of) for of in zip(shapes, kinds, strict=True)))
    copy, *values = (np.concatenate(of) for of in zip(*found, strict=True))
    kept = copy < copies  # a block may be padded
    copy, values = copy[kept], [of[kept] for of in values]
    order = np.argsort(copy, kind="stable")
    copy = copy[order]
    count = np.bincount(copy, minlength=copies)
    place = copy, np.arange(len(copy)) - (np.cumsum(count) - count)[copy]
    most = int(count.max(initial=0))
    there = np.zeros((copies, most), bool)
    there[place] = True
    arrays = []
    for of in values:
        array = np.full((copies, most, *of.shape[1:]), NONE if of.dtype.kind == "i" else 0, of.dtype)
        array[place] = of[order]
        arrays.append(array)
    return Contacts(there, *arrays)


def _of_bodies(scene: Scene, here: Here) -> Contacts:
    """Return contacts between bodies, from the rows of a thread."""
    work, met = here.workspace, scene.meetings
    contacts = getattr(work, "exchange", work).contacts
    rows = int(contacts.length[ROWS])
    pair = contacts.pair[:rows].astype(int)
    gap, push = (numbers(of)[:rows].astype(float) for of in (contacts.gap, contacts.impulse))
    reach = met.reach[pair][:, None]
    row, lane = np.nonzero((gap < 0.5 * FAR) & ((gap < reach) | (push != 0.0)))
    pair, gap, push = pair[row], gap[row, lane], push[row, lane]
    first, second = met.first[pair], met.second[pair]
    width = here.places.shape[-1]
    particle, weight = (
        numbers(of)[: 4 * rows].reshape(rows, 4, width)[row, :, lane].astype(float)
        for of in (contacts.particle, contacts.weight)
    )
    weight[np.arange(4) >= contacts.members[row][:, None]] = 0.0
    particle = np.where(weight != 0.0, particle, 0.0).astype(int)
    bodies = [placed.body for placed in scene.bodies]
    seen = as_met(scene.shapes, bodies, scene.starts, np.moveaxis(here.places.astype(float), -1, 0))
    places = seen[lane[:, None], particle]
    ahead = particle[:, 0] < scene.starts[second]  # the first particle is of the first body
    sign = np.where(ahead, 1.0, -1.0)[:, None]
    normal, rub, slide = (
        numbers(of)[:rows][row, :, lane].astype(float)
        for of in (contacts.normal, contacts.friction, contacts.taper)
    )
    impulse = push[:, None] * normal + rub + slide
    if contacts.solids is None:  # else rows are of the first body already
        normal, impulse = sign * normal, sign * impulse
    radius = np.array([shape.radius for shape in scene.shapes])
    both = (np.abs(weight)[:, None] @ places)[:, 0]  # the sum of the points of both
    point = 0.5 * (both + (radius[second] - radius[first])[:, None] * normal)
    none = np.full(len(row), NONE)
    copy = here.block * width + lane
    force = impulse / here.span[lane][:, None]
    return Contacts(copy, first, second, none, none, point, normal, gap, impulse, force)


def _with_surfaces(scene: Scene, here: Here) -> Contacts:
    """Return contacts with surfaces, from their impulse on each particle; several surfaces share it."""
    begin, x, end, given = _ways(scene, here)
    reach, radius = scene.of_particles(
        [(scales(scene.contact, placed.body)[1], placed.body.radius) for placed in scene.bodies]
    ).T
    places, shape = np.concatenate([begin, x, end]), (3, *x.shape[:2])
    heights = np.stack([surface.height(places).reshape(shape) - radius for surface in scene.surfaces])
    meets = scene.of_particles([(not placed.body.rounds,) for placed in scene.bodies])[:, 0]
    near = (heights.min(axis=1) < reach) & scene.free & meets
    surface, lane, particle = np.nonzero(near)
    at = x[lane, particle]
    normal = np.empty((len(surface), 3))
    for n, one in enumerate(scene.surfaces):
        mine = surface == n
        normal[mine] = _gradient(one, at[mine], DIFFERENCE * reach[particle[mine]])
    gap = heights[surface, 1, lane, particle]
    impulse = _told_apart(lane * len(reach) + particle, normal, given[lane, particle])
    point = at - (0.5 * gap + radius[particle])[:, None] * normal
    body = np.searchsorted(scene.starts, particle, side="right") - 1
    order = np.lexsort((surface, particle, lane))
    none = np.full(len(surface), NONE)
    copy = here.block * len(x) + lane
    force = impulse / here.span[lane][:, None]
    found = Contacts(copy, body, none, surface, particle, point, normal, gap, impulse, force)
    return Contacts(*(of[order] for of in found))


def _of_rounds(scene: Scene, body: int, here: Here) -> Contacts:
    """Return the contacts of a body's round features with surfaces, from the rows that the node solved."""
    rolling, rounds = _rolling(body, here), share(here.terms.rounds, body)
    order = np.array([n for same in by_kind(scene.surfaces).values() for n in same])
    rows = len(rounds.first) * len(order)
    point, n, size, push, friction = (
        np.moveaxis(numbers(of)[:rows].astype(float), -1, 1)
        for of in (rolling.point, rolling.normal, rolling.size, rolling.push, rolling.friction)
    )
    x = np.moveaxis(here.places.astype(float), -1, 0)[:, scene.slices[body]]
    place, gap = np.zeros_like(point), np.zeros(point.shape[:2])
    for r in range(rows):
        feature, k = divmod(r, len(order))
        for c in range(rounds.first[feature], rounds.behind[feature]):
            weight = rounds.base[c] + (point[r] * rounds.slope[c]).sum(axis=-1)
            place[r] += weight[:, None] * x[:, rounds.particle[c]]
        gap[r] = scene.surfaces[order[k]].height(place[r])
    _, reach = scales(scene.contact, scene.bodies[body].body)
    near = (np.minimum(gap, size[..., 0]) < reach) | (push[..., 0] > 0.0)
    lane, row = np.nonzero(near.T)
    gap, normal = gap[row, lane], n[row, lane]
    impulse = push[row, lane, :1] * normal + friction[row, lane]
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    point = place[row, lane] - 0.5 * gap[:, None] * normal
    none, first = np.full(len(row), NONE), np.full(len(row), body)
    copy, surface = here.block * len(x) + lane, order[row % len(order)]
    force = impulse / here.span[lane][:, None]
    return Contacts(copy, first, none, surface, none, point, normal, gap, impulse, force)


def _rolling(body: int, here: Here) -> Rolling:
    """Return the rows of a body's round features at the node."""
    if here.twin:
        return Rolling(*_of_surfaces(body, here)[:FEATURES])

    def own(rows: Any) -> Any:
        return rows.values[rows.start[body] : rows.start[body + 1]] if isinstance(rows, Ragged) else rows

    return Rolling(*map(own, here.workspace.rolling))


def _of_surfaces(body: int, here: Here) -> np.ndarray:
    """Return the arrays in which surfaces push a rigid body."""
    work = here.workspace
    found: np.ndarray = work.surfaces[body] if isinstance(work, Company) else work
    return found


def _of_rigid(scene: Scene, body: int, here: Here) -> Contacts:
    """Return the contacts of a rigid body's particles with surfaces, from what the node found for each."""
    placed, own = scene.bodies[body], scene.slices[body]
    x = np.moveaxis(here.places.astype(float), -1, 0)[:, own]
    _, reach = scales(scene.contact, placed.body)
    space, attitude = numbers(_of_surfaces(body, here)).astype(float), _attitude(scene, body, x, here)
    found = []
    for k, n in enumerate(n for same in by_kind(scene.surfaces).values() for n in same):
        push, rub, normal = (
            np.moveaxis(space[ARRAYS * k + part, : x.shape[1]], -1, 0) for part in (PUSH, RUB, NORMAL)
        )
        gap = scene.surfaces[n].height(x.reshape(-1, 3)).reshape(x.shape[:2]) - placed.body.radius
        lane, i = np.nonzero(((gap < reach) | (push[..., 0] > 0.0)) & scene.free[own])
        given = push[lane, i, :1] * normal[lane, i] + rub[lane, i]
        impulse = np.einsum("nij,nj->ni", attitude[lane], given)
        at, gap = x[lane, i], gap[lane, i]
        upwards = _gradient(scene.surfaces[n], at, np.full(len(i), DIFFERENCE * reach))
        point = at - (0.5 * gap + placed.body.radius)[:, None] * upwards
        none, first, surface = (np.full(len(i), value) for value in (NONE, body, n))
        copy, force = here.block * len(x) + lane, impulse / here.span[lane][:, None]
        particle = own.start + i
        found.append(Contacts(copy, first, none, surface, particle, point, upwards, gap, impulse, force))
    told = Contacts(*(np.concatenate(of) for of in zip(*found, strict=True)))
    order = np.lexsort((told.surface, told.particle, told.there))
    return Contacts(*(of[order] for of in told))


def _attitude(scene: Scene, body: int, x: np.ndarray, here: Here) -> np.ndarray:
    """Return the principal axes of a rigid body in its places (width, N, 3), as columns (width, 3, 3)."""
    twin: Rigid = share(here.twin, body)[0]
    if not twin.turns:
        return np.broadcast_to(np.eye(3), (len(x), 3, 3))
    triad = numbers(twin.triad)[here.block] if twin.triad.dtype.names else twin.triad[..., None]
    triad = np.broadcast_to(triad, (3, 3, len(x))).astype(float)
    world = np.stack([axes(places, scene.bodies[body].body.markers) for places in x])
    return np.einsum("wij,jkw->wik", world, triad)


def _ways(scene: Scene, here: Here) -> tuple[np.ndarray, ...]:
    """Return the positions of particles half a step before the node, at it and half a step after it, and the
    impulse of surfaces on them.

    Each is (width, N, 3): positions in m, and impulses in N·s.
    """
    terms, block, work = here.terms, here.block, here.workspace
    mean, arrived = (numbers(_values(of))[block].astype(float) for of in (here.v, terms.memory.arrived))
    after, x, out = 2.0 * mean - arrived, here.places.astype(float), 0.5 * here.step
    if terms.collisions is None:
        kicked, acceleration = (numbers(of)[: len(x)].astype(float) for of in (work.w, work.a))
        if not any((terms.dampers, terms.wrench, terms.thrust, terms.drive)):
            kicked = arrived + (here.span - out) * acceleration
        change = after - (kicked + out * acceleration)
        quiet = np.abs(change) < ROUNDING * (np.abs(after) + np.abs(arrived))
        change = np.where(quiet, 0.0, change)
    else:
        change = sum(numbers(of.values).astype(float) for of in (work.exchange.change, work.exchange.rub))
    mass = _values(terms.particles.mass)
    mass = numbers(mass)[block] if mass.dtype.names else mass[:, None]
    lead = here.span - out
    ways = (x - lead * arrived, x, x + out * after, mass[:, None] * change)
    return tuple(np.moveaxis(of, -1, 0) for of in ways)


def _gradient(surface: Surface, places: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return the unit normals (n, 3) of a surface at places (n, 3), by differences over steps (n,) [m]."""
    steps = step[:, None, None] * np.eye(3)
    rise = surface.height(places[:, None] + steps) - surface.height(places[:, None] - steps)
    return np.asarray(rise / np.linalg.norm(rise, axis=-1, keepdims=True))


def _told_apart(particle: np.ndarray, normal: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Divide the impulse of surfaces on particles (n, 3) among the near surfaces, with normals (n, 3).

    The pushes are the smallest ones along the normals that add up to the part of the impulse in their span.
    The rest is friction, which is divided in the same proportions.
    """
    impulse = given.copy()
    each, count = np.unique(particle, return_counts=True)
    for one in each[count > 1]:
        rows = np.flatnonzero(particle == one)
        pushes = np.linalg.lstsq(normal[rows].T, given[rows[0]], rcond=None)[0]
        rubbed = given[rows[0]] - pushes @ normal[rows]
        whole = np.abs(pushes).sum()
        shares = np.abs(pushes) / whole if whole > 0 else np.full(len(rows), 1 / len(rows))
        impulse[rows] = pushes[:, None] * normal[rows] + shares[:, None] * rubbed
    return impulse


def _values(rows: np.ndarray | Ragged) -> np.ndarray:
    """Return the array of rows of one body or of several."""
    return rows.values if isinstance(rows, Ragged) else rows
