"""Contacts of all copies at a node, as arrays, from the workspaces of kernels."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from springgym.core.compiler.decorators import kernel
from springgym.core.language.blocks import numbers
from springgym.core.language.kinds import Ragged
from springgym.dynamics.records import FAR, PAIR_TOTALS, Collisions, ContactCount, PairTotal
from springgym.dynamics.terms import Terms
from springgym.model.scene import Scene
from springgym.model.surfaces import by_kind, gradients, scales

__all__ = [
    "LEAST_IMPULSE",
    "NO_INDEX",
    "Contacts",
    "PairSums",
    "SteppedBlock",
    "of_block",
    "padded",
    "pair_sums",
    "refusal",
    "sum_pairs",
]

NO_INDEX = -1
"""Index where there is no body, surface or contact."""

LEAST_IMPULSE = 1e-9
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
    """(copies, most) index, among all particles, of the one that touches a surface; −1 where two bodies
    touch, or a round feature and a surface"""
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
    min_gap: np.ndarray
    """the least gap of any pair, or its contact margin if that is less [m]"""
    late_contacts: np.ndarray
    """number of contacts that were found too late"""
    coarse_contacts: np.ndarray
    """number of contacts, of pairs and with surfaces, that were too fast to keep their restitution, see
    `springgym.simulator.Simulator.coarse_contacts`"""


def pair_sums(collisions: Collisions, copies: int) -> PairSums:
    """Return the totals of each copy, summed over all pairs."""
    sums = np.empty((len(PairSums._fields), copies))
    sum_pairs(numbers(collisions.totals), collisions.pairs.reach, collisions.pairs.among, sums)
    return PairSums(*sums)


@kernel
def sum_pairs(totals: np.ndarray, reach: np.ndarray, among: int, sums: np.ndarray) -> None:
    """Write `PairSums` (fields, copies) from totals (blocks, pairs × entries, copies of a block).

    The first ``among`` are pairs of bodies; of others, with surfaces, only coarse contacts count.
    """
    width = totals.shape[2]
    for c in range(sums.shape[1]):
        block = c // width
        lane = c % width
        touching = 0.0
        impulse = 0.0
        misses = 0.0
        coarse = 0.0
        least = math.inf
        for pair in range(reach.size):
            first = pair * PAIR_TOTALS
            coarse += totals[block, first + PairTotal.COARSE, lane]
            if pair >= among:
                continue
            touching += 1.0 if totals[block, first + PairTotal.TOUCHING, lane] > 0.0 else 0.0
            impulse += totals[block, first + PairTotal.IMPULSE, lane]
            misses += totals[block, first + PairTotal.MISSES, lane]
            gap = totals[block, first + PairTotal.GAP, lane]
            gap = reach[pair] if gap > reach[pair] else gap
            if not math.isnan(least) and not gap >= least:  # a NaN is reported
                least = gap
        for n, total in enumerate((touching, impulse, least, misses, coarse)):
            sums[n, c] = total


class SteppedBlock(NamedTuple):
    """A block of copies that was just advanced by a step."""

    block: int
    begin: tuple[np.ndarray, np.ndarray]
    """positions [m] and velocities [m/s], (N, 3, width), at the beginning of the step"""
    end: tuple[np.ndarray, np.ndarray]
    """positions and velocities at the end of the step"""
    workspace: Any
    """the workspace in which the step was computed"""
    terms: Any
    twin: tuple[Any, ...]
    """the rigid bodies, in rigid dynamics"""
    step: float
    """h [s]"""


def refusal(scene: Scene, terms: Terms, nodes: bool) -> str:
    """Return the reason why the contacts of a scene cannot be reported; empty if they can."""
    if not scene.can_touch:
        return ""
    if not nodes:
        return "contacts need a method with nodes: use verlet, and Contact instead of PaperContact"
    if len(scene.bodies) > 1 and terms.collisions is None:
        return "contacts of several bodies with surfaces need bodies that collide; give the scene collisions"
    return ""


def of_block(scene: Scene, here: SteppedBlock) -> Contacts:
    """Return the contacts of a block's copies in arrays (n,), with the index of the copy in ``there``."""
    return _with_surfaces(scene, here) if here.terms.collisions is None else _of_rows(scene, here)


def padded(found: list[Contacts], copies: int) -> Contacts:
    """Return the contacts of all copies, padded to (copies, most), from those of blocks."""
    if not found:
        shapes = [(copies, 0)] * 5 + [(copies, 0, 3)] * 2 + [(copies, 0)] + [(copies, 0, 3)] * 2
        kinds = [bool, *[int] * 4, *[float] * 5]
        return Contacts(*(np.zeros(*of) for of in zip(shapes, kinds, strict=True)))
    copy, *values = (np.concatenate(of) for of in zip(*found, strict=True))
    kept = copy < copies  # a block may be padded
    copy = copy[kept]
    values = [of[kept] for of in values]
    order = np.argsort(copy, kind="stable")
    copy = copy[order]
    count = np.bincount(copy, minlength=copies)
    place = copy, np.arange(len(copy)) - (np.cumsum(count) - count)[copy]
    most = int(count.max(initial=0))
    there = np.zeros((copies, most), bool)
    there[place] = True
    arrays = []
    for of in values:
        array = np.full((copies, most, *of.shape[1:]), NO_INDEX if of.dtype.kind == "i" else 0, of.dtype)
        array[place] = of[order]
        arrays.append(array)
    return Contacts(there, *arrays)


def _of_rows(scene: Scene, here: SteppedBlock) -> Contacts:
    """Return the contacts that were solved together, from the rows of a thread."""
    contacts = here.workspace.rows.contacts
    pairs = here.terms.collisions.pairs
    rows = int(contacts.length[ContactCount.ROWS])
    width = here.begin[0].shape[-1]
    pair, surface, feature = (of[:rows] for of in (contacts.pair, contacts.surface, contacts.feature))
    gap, push = (numbers(of)[:rows].astype(float) for of in (contacts.gap, contacts.impulse))
    place, n, rub, slide = (
        np.moveaxis(numbers(of)[:rows].astype(float), -1, 1)
        for of in (contacts.place, contacts.normal, contacts.friction, contacts.taper)
    )
    order = [k for same in by_kind(scene.surfaces).values() for k in same]
    radius = np.array([of.body.radius for of in scene.bodies])
    below = np.flatnonzero(surface >= 0)
    for k in below:
        bare = 0.0 if feature[k] >= 0 else radius[pairs.first[pair[k]]]
        gap[k] = scene.surfaces[order[surface[k]]].height(place[k]) - bare
    row, lane = np.nonzero((gap < 0.5 * FAR) & ((gap < pairs.reach[pair][:, None]) | (push != 0.0)))
    last = np.argsort((surface >= 0)[row] & (feature >= 0)[row], kind="stable")
    row = row[last]
    lane = lane[last]
    pair = pair[row]
    surface = surface[row]
    feature = feature[row]
    impulse = (push[..., None] * n + rub + slide)[row, lane]
    gap = gap[row, lane]
    n = n[row, lane]
    place = place[row, lane]
    n = n / np.linalg.norm(n, axis=1, keepdims=True)
    first = pairs.first[pair]
    meets = surface >= 0
    bare = np.where(feature >= 0, 0.0, radius[first])
    point = place - np.where(meets, 0.5 * gap + bare, 0.0)[:, None] * n
    particle = np.where(meets & (feature < 0), numbers(contacts.particle)[4 * row, lane], NO_INDEX).astype(
        int
    )
    surface = np.where(meets, np.array([*order, NO_INDEX])[surface], NO_INDEX)
    second = np.where(meets, NO_INDEX, pairs.second[pair])
    copy = here.block * width + lane
    return Contacts(copy, first, second, surface, particle, point, n, gap, impulse, impulse / here.step)


def _with_surfaces(scene: Scene, here: SteppedBlock) -> Contacts:
    """Return contacts with surfaces, from their impulse on each particle, divided among them."""
    begin, x, end, given = _ways(here)
    reach, radius = scene.of_particles(
        [(scales(scene.contact, placed.body)[1], placed.body.radius) for placed in scene.bodies]
    ).T
    places = np.concatenate([begin, x, end])
    shape = (3, *x.shape[:2])
    heights = np.stack([surface.height(places).reshape(shape) - radius for surface in scene.surfaces])
    meets = scene.of_particles([(not placed.body.rounds,) for placed in scene.bodies])[:, 0]
    near = (heights.min(axis=1) < reach) & scene.free & meets
    surface, lane, particle = np.nonzero(near)
    at = x[lane, particle]
    normal = np.empty((len(surface), 3))
    for n, one in enumerate(scene.surfaces):
        mine = surface == n
        slope = gradients(one, at[mine], reach[particle[mine]])
        normal[mine] = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    gap = heights[surface, 1, lane, particle]
    impulse = _divided(lane * len(reach) + particle, normal, given[lane, particle])
    point = at - (0.5 * gap + radius[particle])[:, None] * normal
    body = np.searchsorted(scene.offsets, particle, side="right") - 1
    order = np.lexsort((surface, particle, lane))
    none = np.full(len(surface), NO_INDEX)
    copy = here.block * len(x) + lane
    force = impulse / here.step
    found = Contacts(copy, body, none, surface, particle, point, normal, gap, impulse, force)
    return Contacts(*(of[order] for of in found))


def _ways(here: SteppedBlock) -> tuple[np.ndarray, ...]:
    """Return the positions of particles where the step begins, at its node and where it ends, and the impulse
    of surfaces on them.

    Each is (width, N, 3): positions in m, and impulses in N·s.
    """
    terms = here.terms
    work = here.workspace
    half = 0.5 * here.step
    (begin, before), (end, after) = (
        (place.astype(float), speed.astype(float)) for place, speed in (here.begin, here.end)
    )
    kicked, acceleration = (numbers(of)[: len(begin)].astype(float) for of in (work.w, work.a))
    if not any((terms.dampers, terms.wrench, terms.thrust, terms.drive)):
        kicked = before + half * acceleration
    change = after - (kicked + half * acceleration)
    change = np.where(np.abs(change) < LEAST_IMPULSE * (np.abs(after) + np.abs(before)), 0.0, change)
    mass = terms.particles.mass
    mass = mass.values if isinstance(mass, Ragged) else mass
    mass = numbers(mass)[here.block] if mass.dtype.names else mass[:, None]
    ways = (begin, begin + half * before, end, mass[:, None] * change)
    return tuple(np.moveaxis(of, -1, 0) for of in ways)


def _divided(particle: np.ndarray, normal: np.ndarray, given: np.ndarray) -> np.ndarray:
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
