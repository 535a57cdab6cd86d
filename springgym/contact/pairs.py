"""Bodies that collide as compiled functions take them, what these compute in, and what they tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from springgym.bodies import Body
from springgym.collisions import Meetings, Shape
from springgym.core.blocks import aligned_zeros
from springgym.core.compiling import compiled
from springgym.core.kinds import Number, Numbers
from springgym.core.lanes import load, store

FAR = 1e9
"""Distance [m] of what is no contact, in a lane where another copy has one."""

MOST_CONTACTS = 64
"""Contacts of a copy, for each of its bodies: beyond, they are counted and left out."""

LISTED, CANDIDATES = 16, 8
"""Rows of features that lists have room for, in all of the scene's features: more are listed anew at each
node; and candidates for each row, or all are."""

PARALLEL = 2.0
"""σ of edges, the sine of the angle from which they count in full: this times Δ over the longest edge."""

MOST_PARALLEL = 0.2


class Shapes(NamedTuple):
    """Features of all bodies, one body after another, by the numbers of the scene's particles."""

    vertices: np.ndarray
    """(V, 1)"""
    triangles: np.ndarray | None
    """(T, 3)"""
    edges: np.ndarray | None
    """(E, 2) sharp edges, and the rods of bodies without triangles"""
    start: np.ndarray
    """(3, bodies + 1) where each body's vertices, triangles and edges begin, and the end"""
    radius: np.ndarray
    """(bodies,) [m] of balls and rods"""
    rods: np.ndarray | None
    """(bodies,) whether a body is of rods; None if none is"""
    balls: np.ndarray | None
    """(bodies,) whether a body is a ball; None if none is"""


class Pairs(NamedTuple):
    """Pairs of bodies that may meet, each array of shape (pairs,)."""

    first: np.ndarray
    second: np.ndarray
    reach: np.ndarray
    """Δ [m]"""
    least_reach: float
    """the least of them [m]"""
    parallel: np.ndarray
    """σ² of edges [1]"""
    strength: np.ndarray
    """c [N·m²]"""
    friction: np.ndarray | None
    """μ [1]"""
    loss: np.ndarray | None
    """β [1]"""
    shapes: Shapes
    most: int
    """contacts of a copy"""


class Room(NamedTuple):
    """What a thread finds contacts in.

    Rows of lists hold something of each copy, its own: row r of a list the r-th of each. A copy that has
    less than others has `NONE` there, and the particles of another. So a list is as long as the longest of a
    copy, and what a copy has, and in which order, does not depend on the others.

    Lists of features stay from node to node, one pair's behind another's.
    """

    origin: np.ndarray
    """(particles, 3) where vertices were when features were listed [m]"""
    shift: np.ndarray
    """(particles, 3) how far they moved since then [m]"""
    moved: np.ndarray
    """(bodies,) the farthest that a vertex moved [m]"""
    mean_shift: np.ndarray
    """(bodies, 3) the mean of how far vertices moved [m]"""
    bend: np.ndarray
    """(bodies,) the largest difference from it [m]"""
    mean: np.ndarray
    """(bodies, 3) the mean velocity of vertices [m/s]"""
    turning: np.ndarray
    """(bodies,) the largest difference from it [m/s]"""
    low: np.ndarray
    """(bodies, 3) boxes around the bodies, when features were listed [m]"""
    high: np.ndarray
    along: np.ndarray
    """(particles,) how far from the slab between both bodies of a pair, likewise [m]"""
    listed: np.ndarray
    """(pairs,) nearer than this all features of a pair were listed then; 0 before [m]"""
    gap: np.ndarray
    """(pairs,) no features were nearer than this then [m]"""
    nearest: np.ndarray
    """(pairs,) nor are they nearer than this now [m]"""
    reach: np.ndarray
    """(pairs,) how far to look for contacts at this node [m]"""
    watched: np.ndarray
    """(pairs,) list: pairs of bodies that are not far apart in some copy, ascending"""
    ahead: np.ndarray
    """(bodies,) by how much the way in half a step exceeds what is allowed for, as pairs were watched [m]"""
    margin: np.ndarray
    """(bodies,) how far a body may move before these are listed anew [m]"""
    travelled: np.ndarray
    """(bodies,) how far it moved since then, up to when features were listed, at the most [m]"""
    close: np.ndarray
    """(pairs,) list: those of them that may touch at this node"""
    met: np.ndarray
    """(pairs,) list: those of them that have contacts"""
    length: np.ndarray
    """(4,) how many are `WATCHED`, `CLOSE` and `MET`; and how many rows of contacts that makes: `ROWS`"""
    kept: np.ndarray
    """(1,) whether the lists of all pairs are there"""
    used: np.ndarray
    """(4,) how many rows of vertices, triangles, edges and candidates are in use"""
    ends: np.ndarray
    """(pairs, 3, 3) where vertices, triangles and edges begin of the first body, of the second, and end"""
    vertex: np.ndarray
    """(V,) list: vertices of a pair that lie between the two bodies, the first's before"""
    vertex_particle: np.ndarray
    """(V,) which particles they are"""
    point: np.ndarray
    """(V, 3) where they are [m]"""
    triangle: np.ndarray
    """(T,) list: triangles likewise"""
    triangle_particles: np.ndarray
    """(3 T,)"""
    corner: np.ndarray
    """(T, 3) their first corner [m]"""
    first: np.ndarray
    """(T, 3) from there to the second [m]"""
    second: np.ndarray
    """(T, 3) and to the third"""
    normal: np.ndarray
    """(T, 3) their product, as long as twice the area [m²]"""
    square: np.ndarray
    """(T,) the square of that length [m⁴]; −1 where there is none"""
    products: np.ndarray
    """(T, 3) of the sides from the first corner: |u|², u·w and |w|² [m²]"""
    sizes: np.ndarray
    """(T, 3) 1 over ``square`` [m⁻⁴], 1 over the product of all sides' squares [m⁻⁶], the largest of
    these [m²]"""
    edge: np.ndarray
    """(E,) list: edges likewise"""
    edge_particles: np.ndarray
    """(2 E,)"""
    start: np.ndarray
    """(E, 3) where they begin [m]"""
    way: np.ndarray
    """(E, 3) from there to the end; 0 where there is none"""
    candidate: np.ndarray
    """rows of triangles and edges: first all of them, in turn; then those near a vertex or an edge"""
    faces: np.ndarray
    """(V, 2) where the candidates of a vertex begin there, and end: triangles of the other body"""
    partners: np.ndarray
    """(E, 2) and those of an edge of the first body: edges of the second"""
    crossed: np.ndarray
    """(most,) list: edges that meet others, by their rows,"""
    crossing: np.ndarray
    """(most,) and these"""
    have: np.ndarray
    """(2,) contacts of each copy: in all, and of this pair"""
    left_out: np.ndarray
    """(pairs,) contacts for which there was no room, at this node"""
    pair: np.ndarray
    """(rows,) whose contact it is, in all copies"""
    members: np.ndarray
    """(rows,) how many particles it has, in all copies"""
    particle: np.ndarray
    """(4 rows,) which"""
    weight: np.ndarray
    """(4 rows,) w: they sum to 0"""
    toward: np.ndarray
    """(rows, 3) the normal, from the second body to the first"""
    distance: np.ndarray
    """(rows,) d [m], `FAR` where there is no contact"""
    share: np.ndarray
    """(rows,) Φ"""
    before: np.ndarray
    """(rows,) u₀, the speed along the normal before the node [m/s]"""
    gain: np.ndarray
    """(4 rows,) w/m [1/kg]"""
    inverse: np.ndarray
    """(rows,) W [1/kg]"""
    push: np.ndarray
    """(rows,) J [N·s]"""
    rub: np.ndarray
    """(rows, 3) the impulse of friction [N·s]"""
    slide: np.ndarray
    """(rows, 3) the impulse of the gradient of Φ [N·s]"""
    tilt: np.ndarray
    """(2 rows, 3) G and H; of a rod, G and the direction along it: see `springgym.contact.friction`"""
    rubs: np.ndarray
    """(rows,) 1 where friction acts, else 0"""
    spent: np.ndarray
    """(pairs, 3) energy lost to damping, and to friction, and given by the barriers, at this node [J]"""
    solids: Any = None
    """the `springgym.contact.solids.Solids` of rigid bodies; None where particles move by themselves"""


WATCHED, CLOSE, MET, ROWS = range(4)
"""Lists of pairs, and the rows of contacts."""

NONE = -1.0
"""Of a list, in a copy that has less than others."""


class Near(NamedTuple):
    """Two bodies near each other."""

    pair: Any
    bodies: tuple[Any, Any]
    lead: Any
    """time since the step began [s]"""
    reach: Any
    """how far to look for contacts [m]"""
    radius: Any
    """of what lies around their features, both together [m]"""


class Touch(NamedTuple):
    """A contact of each copy, where its ``share`` is positive."""

    particles: tuple[Any, Any, Any, Any]
    weights: tuple[Any, Any, Any, Any]
    normal: Any
    distance: Any
    share: Any


class Search(NamedTuple):
    """Where contacts are looked for, and listed."""

    x: np.ndarray
    """positions (N, 3) [m]"""
    w: np.ndarray
    """velocities (N, 3) before the node [m/s]"""
    pairs: Pairs
    room: Room


TOUCHING, IMPULSE, GAP, ENERGY, CONTACT, FRICTION, MISSES, FAST, OVERFLOW, FASTEST = range(10)
"""What a tally holds of each pair: whether it touches; the sum of J [N·s] and the least distance [m] since it
was emptied; the energy in the barriers [J]; what was lost to damping and to friction [J]; and how often a
contact was found too late, was faster than it is computed well for, or had no room; and the largest speed
along its normal that any contact which pushes was reached with [m/s]."""

ENTRIES = 10

RESOLVED = 1.0
"""Share of Δ that a contact may move by in a step: what is faster is not in reach before it is through."""


class PairReadings(NamedTuple):
    """What a tally tells of pairs, (copies, pairs), in the order of `Scene.meetings`."""

    touching: np.ndarray
    """whether anything pushes at the node where the state is read"""
    impulse: np.ndarray
    """the sum of all impulses along normals, up to this node and half of what it gives [N·s]"""
    least_gap: np.ndarray
    """the least distance that any contact had [m]; infinite if none was near"""
    energy: np.ndarray
    """in the barriers between them, the mean before and after the node [J]"""
    contact_loss: np.ndarray
    """what was lost to restitution [J]"""
    friction_loss: np.ndarray
    """and to friction [J]"""
    misses: np.ndarray
    """how often a contact was found when the bodies were in each other already, or almost, or were read so"""
    too_fast: np.ndarray
    """how often one came faster than it is computed well for: a fifth of Δ in a step"""
    overflow: np.ndarray
    """how often one was left out for want of room"""
    fastest: np.ndarray
    """the largest speed along its normal that any contact which pushes was reached with [m/s]"""


class Meets(NamedTuple):
    """Bodies that collide, and what is told of them."""

    pairs: Pairs
    tally: np.ndarray
    """(pairs × `ENTRIES`,)"""
    before: np.ndarray
    """(pairs × `ENTRIES`,) the tally before the last node, which the next call makes anew"""
    told: np.ndarray
    """(1 + pairs,) list: how many pairs, and which, ascending, touch, or have a tally that is not ``before``;
    all others have nothing to be told of"""


@compiled
def entry_of(told: np.ndarray, n: Any) -> Any:
    """Return a number of a list that all copies of a block share."""
    return told[n]["lanes"][0]


@compiled
def set_entry(told: np.ndarray, n: Any, value: Any) -> None:
    """Set a number of a list that all copies of a block share."""
    told[n]["lanes"][0] = value


@compiled
def note(room: Any, told: np.ndarray) -> None:
    """Add the pairs that have contacts to those that there is something to be told of."""
    count, at = entry_of(told, 0), 1
    for n in range(room.length[MET]):
        p = room.met[n]
        while at <= count and entry_of(told, at) < p:
            at += 1
        if at > count or entry_of(told, at) != p:
            for m in range(count, at - 1, -1):
                set_entry(told, m + 1, entry_of(told, m))
            set_entry(told, at, p)
            count += 1
    set_entry(told, 0, count)


@compiled
def spend(room: Any, pair: Any, kind: Any, energy: Number) -> None:
    """Add to what a pair spent at this node: 0 damping, 1 friction, 2 given by its barriers [J]."""
    store(room.spent, (pair, kind), load(room.spent, (pair, kind)) + energy)


@compiled
def tell(tally: Numbers, pair: Number, entry: Number, value: Number) -> None:
    """Add to an entry of a pair; a tally of None keeps none."""
    if tally is not None:
        n = pair * ENTRIES + entry
        store(tally, n, load(tally, n) + value)


def packed_shapes(shapes: Sequence[Shape], first: Sequence[int]) -> Shapes:
    """Features of all bodies, whose particles begin at ``first`` among those of the scene."""
    kinds = [
        [getattr(shape, name) + n for shape, n in zip(shapes, first, strict=True)]
        for name in ("vertices", "triangles", "edges")
    ]
    start = np.array([np.cumsum([0, *map(len, kind)]) for kind in kinds])
    vertices, triangles, edges = (np.concatenate(kind).astype(np.uint32) for kind in kinds)
    rods = np.array([not len(shape.triangles) and len(shape.edges) > 0 for shape in shapes])
    balls = np.array([not len(shape.triangles) and not len(shape.edges) for shape in shapes])
    return Shapes(
        vertices[:, None],
        triangles if len(triangles) else None,
        edges if len(edges) else None,
        start,
        np.array([shape.radius for shape in shapes]),
        rods if rods.any() else None,
        balls if balls.any() else None,
    )


def longest_edge(body: Body, shape: Shape) -> float:
    """The length [m] of the longest edge of a body that others meet; 0 if it has none."""
    ends = body.positions[shape.edges]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max(initial=0.0))


def parallel(met: Meetings, longest: Sequence[float]) -> np.ndarray:
    """Return σ² (pairs,), below which edges count as parallel, given the longest edge of each body [m]."""
    both = np.maximum(np.array(longest)[met.first], np.array(longest)[met.second])
    sine = np.full(len(both), 1.0)
    np.divide(PARALLEL * met.reach, both, out=sine, where=both > 0)
    return np.where(both > 0, np.minimum(sine, MOST_PARALLEL) ** 2, 1.0)


def most_contacts(met: Meetings, shapes: Sequence[Shape]) -> tuple[int, int]:
    """Contacts that a copy may have, and rows of a list: of each vertex, and of each edge with each."""
    vertices, edges = (np.array([len(getattr(of, name)) for of in shapes]) for name in ("vertices", "edges"))
    found = int((vertices[met.first] + vertices[met.second] + edges[met.first] * edges[met.second]).sum())
    return min(found, MOST_CONTACTS * len(shapes)), found


def room(pairs: Pairs, particles: int, rows: int, dtype: Any) -> Room:
    """What a thread finds contacts in, on elements of ``dtype``; ``rows`` is the most a block can have."""
    shapes = pairs.shapes
    bodies, count = len(shapes.radius), len(pairs.first)
    features = np.diff(shapes.start, axis=1)
    of_pairs = features[:, pairs.first] + features[:, pairs.second]
    # lists of all pairs, unless that is absurd; at least those of any one
    most = np.maximum(of_pairs.max(axis=1), np.minimum(of_pairs.sum(axis=1), LISTED * features.sum(axis=1)))
    vertices, triangles, edges = (int(n) + 1 for n in most)
    candidates = max(triangles, edges) + CANDIDATES * (vertices + edges)
    width = np.dtype(dtype)["lanes"].shape[0]
    rows = min(rows, pairs.most * width) + 1
    rubbing = 1 if pairs.friction is None else rows

    def lanes(*shape: int) -> np.ndarray:
        return aligned_zeros(shape, dtype)

    return Room(
        origin=lanes(particles, 3),
        shift=lanes(particles, 3),
        moved=lanes(bodies),
        mean_shift=lanes(bodies, 3),
        bend=lanes(bodies),
        mean=lanes(bodies, 3),
        turning=lanes(bodies),
        low=lanes(bodies, 3),
        high=lanes(bodies, 3),
        along=lanes(particles),
        listed=lanes(count),
        gap=lanes(count),
        nearest=lanes(count),
        reach=lanes(count),
        watched=np.zeros(count, np.int64),
        margin=lanes(bodies),
        ahead=lanes(bodies),
        travelled=lanes(bodies),
        close=np.zeros(count, np.int64),
        met=np.zeros(count, np.int64),
        length=np.zeros(4, np.int64),
        kept=np.zeros(1, np.bool_),
        used=np.zeros(4, np.int64),
        ends=np.zeros((count, 3, 3), np.int64),
        vertex=lanes(vertices),
        vertex_particle=lanes(vertices),
        point=lanes(vertices, 3),
        triangle=lanes(triangles),
        triangle_particles=lanes(3 * triangles),
        corner=lanes(triangles, 3),
        first=lanes(triangles, 3),
        second=lanes(triangles, 3),
        normal=lanes(triangles, 3),
        square=lanes(triangles),
        products=lanes(triangles, 3),
        sizes=lanes(triangles, 3),
        edge=lanes(edges),
        edge_particles=lanes(2 * edges),
        start=lanes(edges, 3),
        way=lanes(edges, 3),
        candidate=np.arange(candidates),
        faces=np.zeros((vertices, 2), np.int64),
        partners=np.zeros((edges, 2), np.int64),
        crossed=lanes(pairs.most),
        crossing=lanes(pairs.most),
        have=lanes(2),
        left_out=lanes(count),
        pair=np.zeros(rows, np.int32),
        members=np.zeros(rows, np.int32),
        particle=lanes(4 * rows),
        weight=lanes(4 * rows),
        toward=lanes(rows, 3),
        distance=lanes(rows),
        share=lanes(rows),
        before=lanes(rows),
        gain=lanes(4 * rows),
        inverse=lanes(rows),
        push=lanes(rows),
        rub=lanes(rows, 3),
        slide=lanes(rows, 3),
        tilt=lanes(2 * rubbing, 3),
        rubs=lanes(rubbing),
        spent=lanes(count, 3),
    )
