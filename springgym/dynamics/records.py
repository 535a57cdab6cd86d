"""The records of contact: surfaces, bodies that may touch, neighbour lists, and rows of contacts.

Each element of an array holds one number per copy of a block, unless all copies share the array.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np

from springgym.core.language.kinds import Number, Numbers, Rows, Vector
from springgym.dynamics.arrays import flags, of_copies, whole

Kinds: TypeAlias = tuple[Any, ...]
"""All surfaces of each kind, see `springgym.model.surfaces.surface`; in overloads, Numba's types of them."""


Facing: TypeAlias = tuple[Vector, Number, Number]
"""The mean normal n̄ of a surface along a path, its square, and the gap [m] where the path begins."""


class Times(NamedTuple):
    """The times of a node [s]: of the drifts before and after it."""

    lead: Number
    """the time before the node, h/2; 0 where `springgym.dynamics.step` searches before the first step"""
    out: Number
    """the time after the node, h/2"""
    whole: Number
    """the sum of both times"""


class Surfaces(NamedTuple):
    """Surfaces of any kinds, and the contact of a body with them."""

    kinds: Kinds
    strength: np.ndarray
    """(1,) the strength c of the barrier [N·m²]"""
    reach: float
    """the contact margin Δ [m]"""
    coarse_from: float
    """the normal speed above which a contact counts as coarse [m/s], see `springgym.model.resolution`"""
    radius: float | None
    """the radius of balls and rods [m], whose gaps count from their skin; None if all bodies are of points"""
    coupled: bool | None
    """True if `springgym.model.surfaces.coupled`; else None, so that no iteration is compiled"""
    totals: Numbers | None = None
    """(`PAIR_TOTALS`,) totals of the body, of which only `PairTotal.COARSE` and `PairTotal.FASTEST` are set;
    None where contacts are rows"""


class Resistance(NamedTuple):
    """Coefficients of rolling and torsional resistance, of surfaces (1,) or of pairs of bodies (pairs,)."""

    rolling: np.ndarray
    """the coefficient ρ of rolling resistance [m]"""
    torsional: np.ndarray
    """the coefficient τ of torsional resistance [m]"""


class SurfaceImpulse(NamedTuple):
    """The changes of a particle's velocity by surfaces at the node of a step."""

    change: Vector
    """change of velocity by normal impulses [m/s]"""
    rub: Vector
    """change of velocity by friction [m/s]"""
    force: Vector
    """change of velocity by normal impulses without loss, Σ J n [m/s]: its product with the displacement,
    over the time, is the barriers' work"""


MOST_ITERATED = 10
"""Largest number of bodies in a scene whose sweeps are iterated until impulses agree. With more bodies, a
node takes a few sweeps, and the next node continues from its impulses."""


PASSES = 2
"""Number of iterations within a sweep that find a contact's couple and friction from each other."""


LEAST = 0.01
"""Least share of K by which friction is taken to change the slip of a feature that does not turn."""


class Rounds(NamedTuple):
    """The round features of a body."""

    first: np.ndarray
    """(features,) index of the first carrier of each feature in the arrays of carriers below"""
    behind: np.ndarray
    """(features,) index after the last carrier of each feature"""
    particle: np.ndarray
    """(carriers,) index of the particle of each carrier"""
    base: np.ndarray
    """(carriers,) weight of the feature's centre"""
    slope: np.ndarray
    """(carriers, 3) gradient B of the weight in the rest shape [1/m]"""
    matrix: np.ndarray
    """(3 features, 3) rows of the matrix A of each feature [m²]"""


class Shapes(NamedTuple):
    """The features of all bodies, one body after another, by indices of the scene's particles."""

    vertices: np.ndarray
    """(V, 1) the particle at each vertex"""
    triangles: np.ndarray | None
    """(T, 3) the particles at the corners of each triangle; None if no body has triangles"""
    edges: np.ndarray | None
    """(E, 2) the particles at the ends of each sharp edge, or rod of a body without triangles; None if no
    body has any"""
    start: np.ndarray
    """(3, bodies + 1) index of each body's first vertex, triangle and edge in the arrays above; the last
    column is their number"""
    radius: np.ndarray
    """(bodies,) radius of balls and rods [m]"""
    rods: np.ndarray | None
    """(bodies,) whether a body is of rods; None if none is"""
    balls: np.ndarray | None
    """(bodies,) whether a body is a ball; None if none is"""


class Pairs(NamedTuple):
    """The pairs of bodies that may touch, and then each body with the surfaces, if there are any.

    Each array has shape (pairs,), if nothing else is said.
    """

    among: int
    """the number of pairs of two bodies"""
    first: np.ndarray
    """the index of the first body of each pair"""
    second: np.ndarray
    """the index of the second body of each pair; −1 for surfaces"""
    reach: np.ndarray
    """the contact margin Δ, the gap below which contact repels both bodies [m]"""
    coarse_from: np.ndarray
    """the normal speed above which a contact counts as coarse [m/s], see `springgym.model.resolution`"""
    least_reach: float
    """the least Δ of all pairs [m]"""
    parallel: np.ndarray
    """the square σ² of the sine below which two edges count as parallel [1]"""
    strength: np.ndarray
    """the strength c of the barrier [N·m²]"""
    friction: np.ndarray | None
    """the coefficient μ of friction [1]; None if no pair has friction"""
    resistance: Resistance | None
    """the coefficients of rolling and torsional resistance of all pairs; None if all are zero"""
    loss: np.ndarray | None
    """the loss factor β of restitution [1]; None if no pair loses any energy by it"""
    radius: np.ndarray
    """(bodies,) the radius of the balls or rods of each body [m]; 0 of a body with faces"""
    single: np.ndarray
    """(bodies,) whether a body is a single particle"""
    shapes: Shapes | None
    """the features of all bodies; None if bodies do not collide"""
    most: int
    """the largest number of contacts of bodies that a copy can have"""


NO_ENTRY = -1.0
"""Entry of a list in a copy that has fewer entries than others."""


class PairList(IntEnum):
    """The lists of pairs, by their indices in `Neighbours.length`."""

    WATCHED = 0
    """`Neighbours.watched`"""
    CLOSE = 1
    """`Neighbours.close`"""


class Neighbours(NamedTuple):
    """The neighbour lists of features: the workspace of `springgym.dynamics.contact.search`.

    Lists of features persist from node to node; those of one pair follow those of another. They have room for
    V vertices, T triangles and E edges.
    """

    origin: Annotated[np.ndarray, of_copies("particles", 3)]
    """positions of vertices when features were listed [m]"""
    shift: Annotated[np.ndarray, of_copies("particles", 3)]
    """displacement of vertices since then [m]"""
    moved: Annotated[np.ndarray, of_copies("bodies")]
    """the largest displacement of a vertex, plus what is added for fast bodies [m]"""
    mean_shift: Annotated[np.ndarray, of_copies("bodies", 3)]
    """the mean displacement of vertices [m]"""
    bend: Annotated[np.ndarray, of_copies("bodies")]
    """the largest difference of a vertex's displacement from the mean [m]"""
    mean: Annotated[np.ndarray, of_copies("bodies", 3)]
    """the mean velocity of vertices [m/s]"""
    turning: Annotated[np.ndarray, of_copies("bodies")]
    """the largest difference of a vertex's velocity from the mean [m/s]"""
    low: Annotated[np.ndarray, of_copies("bodies", 3)]
    """lower corners of the boxes around the bodies, when features were listed [m]"""
    high: Annotated[np.ndarray, of_copies("bodies", 3)]
    """upper corners of these boxes [m]"""
    along: Annotated[np.ndarray, of_copies("particles")]
    """distance of vertices from the other body of a pair, along the line of their centres [m]"""
    listed: Annotated[np.ndarray, of_copies("pairs")]
    """the distance below which all features of a pair were listed [m]; 0 before the first listing"""
    gap: Annotated[np.ndarray, of_copies("pairs")]
    """lower bound of the distances of a pair's features when they were listed [m]"""
    nearest: Annotated[np.ndarray, of_copies("pairs")]
    """lower bound of these distances at this node [m]"""
    reach: Annotated[np.ndarray, of_copies("pairs")]
    """search distance for contacts at this node [m]"""
    watched: Annotated[np.ndarray, whole("pairs")]
    """list: pairs of bodies that are not far apart in some copy, ascending"""
    ahead: Annotated[np.ndarray, of_copies("bodies")]
    """excess of the motion in half a step over the allowed one, when pairs were watched [m]"""
    margin: Annotated[np.ndarray, of_copies("bodies")]
    """the distance that a body may move before the search lists the watched pairs anew [m]"""
    travelled: Annotated[np.ndarray, of_copies("bodies")]
    """bound of the motion from when pairs were watched to when features were listed [m]"""
    close: Annotated[np.ndarray, whole("pairs")]
    """list of the watched pairs that may touch at this node"""
    length: Annotated[np.ndarray, whole(2)]
    """the lengths of the lists of a `PairList`"""
    kept: Annotated[np.ndarray, flags(1)]
    """whether the lists of all pairs are stored"""
    used: Annotated[np.ndarray, whole(4)]
    """the numbers of rows of vertices, triangles, edges and candidates in use"""
    ends: Annotated[np.ndarray, whole("pairs", 3, 3)]
    """of vertices, triangles and edges: first rows of the first and second body, and the end"""
    vertex: Annotated[np.ndarray, of_copies("V")]
    """list of the vertices of a pair that lie between the two bodies: the first body's come first"""
    vertex_particle: Annotated[np.ndarray, of_copies("V")]
    """the particles at these vertices"""
    point: Annotated[np.ndarray, of_copies("V", 3)]
    """positions of these vertices [m]"""
    triangle: Annotated[np.ndarray, of_copies("T")]
    """list of the triangles of a pair that lie between both bodies: those of the first body, then of the
    second"""
    triangle_particles: Annotated[np.ndarray, of_copies("3 T")]
    """the particles at the corners of these triangles"""
    corner: Annotated[np.ndarray, of_copies("T", 3)]
    """the first corner of each triangle [m]"""
    first: Annotated[np.ndarray, of_copies("T", 3)]
    """the side u of each triangle, from its first corner to its second [m]"""
    second: Annotated[np.ndarray, of_copies("T", 3)]
    """the side w of each triangle, from its first corner to its third [m]"""
    normal: Annotated[np.ndarray, of_copies("T", 3)]
    """the cross product u × w, whose length is twice the area of the triangle [m²]"""
    square: Annotated[np.ndarray, of_copies("T")]
    """|u × w|², the square of twice the area [m⁴]; −1 in rows without a triangle"""
    products: Annotated[np.ndarray, of_copies("T", 3)]
    """the products |u|², u·w and |w|² of the sides [m²]"""
    sizes: Annotated[np.ndarray, of_copies("T", 3)]
    """1 over ``square`` [m⁻⁴], 1 over the product of all sides' squares [m⁻⁶], the largest of
    these [m²]"""
    edge: Annotated[np.ndarray, of_copies("E")]
    """list of the edges of a pair that lie between both bodies: those of the first body, then of the
    second"""
    edge_particles: Annotated[np.ndarray, of_copies("2 E")]
    """the particles at the ends of these edges"""
    start: Annotated[np.ndarray, of_copies("E", 3)]
    """the first end of each edge [m]"""
    way: Annotated[np.ndarray, of_copies("E", 3)]
    """the vector from the first end of each edge to its second [m]; 0 in rows without an edge"""
    candidate: np.ndarray
    """rows of triangles and edges: first all of them in order, then those near a vertex or an edge"""
    faces: Annotated[np.ndarray, whole("V", 2)]
    """first index and end, in ``candidate``, of the triangles of the other body near each vertex"""
    partners: Annotated[np.ndarray, whole("E", 2)]
    """first index and end, in ``candidate``, of the second body's edges near each edge of the first"""
    crossed: Annotated[np.ndarray, of_copies("most")]
    """list of the rows of edges of one body that cross edges of the other"""
    crossing: Annotated[np.ndarray, of_copies("most")]
    """the rows of the edges that they cross"""


Quad: TypeAlias = tuple[Number, Number, Number, Number]
"""A number of each of four particles."""


class Near(NamedTuple):
    """Two bodies near each other at a node."""

    pair: int
    bodies: tuple[int, int]
    lead: Number
    """time from the beginning of the step to the node [s]"""
    reach: Number
    """search distance for contacts [m]"""
    radius: Number
    """the sum of the radii of balls and rods of both [m]"""


class Closest(NamedTuple):
    """The closest points of two features of each copy: a contact where its ``share`` is positive."""

    particles: Quad
    """the indices of up to four particles"""
    weights: Quad
    """the weights w of these particles [1]: they sum to 0"""
    normal: Vector
    """the normal n, from the second body to the first"""
    gap: Number
    """the gap d [m]"""
    share: Number
    """the factor Φ of the strength [1]"""


FAR = 1e9
"""Gap [m] of a row in the copies that have no contact there."""


class ContactCount(IntEnum):
    """What `ContactRows.length` counts."""

    PAIRS = 0
    """the pairs that have contacts, `ContactRows.touching_pairs`"""
    ROWS = 1
    """the rows of contacts"""


Ends: TypeAlias = tuple[Vector, Vector, Vector, Vector]
"""A vector for each of the four ends of two edges."""


class Turning(NamedTuple):
    """The bodies that contacts turn as one, see `springgym.dynamics.contact.movers`."""

    turns: np.ndarray
    """(bodies,) whether contacts turn a body as one"""
    balls: np.ndarray
    """(bodies,) True for a ball, whose contacts are found from its centre of mass"""
    first: np.ndarray
    """(bodies,) the index of the row that holds its velocity; the next row holds its angular momentum"""
    pivot: np.ndarray
    """(bodies,) the index of its only pinned particle; −1 if none or all particles are pinned"""
    lightness: Annotated[np.ndarray, of_copies("bodies")]
    """the inverse mass 1/M of each body [1/kg]; 0 for pinned bodies"""
    point: Annotated[np.ndarray, of_copies("2 bodies", 3)]
    """the point X, centre of mass or pin, of each body at the node [m]; then those at the end of the step"""
    turn: Annotated[np.ndarray, of_copies("4 bodies", 3)]
    """the inverse inertia I⁻¹ about the body's point at the node, in two rows: xx, yy, zz, and
    xy, xz, yz [1/(kg·m²)]; then those of all bodies at the end of the step"""


class ContactRows(NamedTuple):
    """The contacts of a node, one row each, with their impulses.

    There are as many arms as rows if a body turns as one, as many couples if turning is resisted, else one.
    """

    length: Annotated[np.ndarray, whole(2)]
    """the numbers of a `ContactCount`"""
    touching_pairs: Annotated[np.ndarray, whole("pairs")]
    """list of the pairs of bodies that have contacts, in ascending order"""
    left_out: Annotated[np.ndarray, of_copies("pairs")]
    """number of contacts at this node that were left out for lack of space"""
    counts: Annotated[np.ndarray, of_copies(2)]
    """number of contacts of each copy: in all, and of the pair that is being searched"""
    pair: Annotated[np.ndarray, whole("rows")]
    """the pair that this contact belongs to, the same in all copies"""
    body: Annotated[np.ndarray, whole("2 rows")]
    """the indices of its first and its second body; −1 for a surface"""
    surface: Annotated[np.ndarray, whole("rows")]
    """the index of the surface; −1 between bodies"""
    feature: Annotated[np.ndarray, whole("rows")]
    """the index of the round feature that touches a surface; −1 for a particle"""
    members: Annotated[np.ndarray, whole("rows")]
    """the number of particles of the contact, the same in all copies"""
    loose: Annotated[np.ndarray, whole("rows")]
    """the number of the contact's particles if any of them moves individually, else 0; None if no
    bodies collide"""
    only: Annotated[np.ndarray, whole("rows")]
    """the index of the particle at a surface if it moves individually; else −1"""
    touching: Annotated[np.ndarray, whole("rows")]
    """the index of the particle at a surface; −1 of round features and between bodies"""
    at_end: Annotated[np.ndarray, whole("rows")]
    """1 if slip is that of the points which touch at the end of the step, else 0"""
    tilts: Annotated[np.ndarray, whole("rows")]
    """1 if the torque of friction has to be cancelled, see `springgym.dynamics.contact.friction`,
    else 0"""
    particle: Annotated[np.ndarray, of_copies("4 rows")]
    """the indices of the particles"""
    weight: Annotated[np.ndarray, of_copies("4 rows")]
    """the weights w of particles that move individually: > 0 in the first body"""
    normal: Annotated[np.ndarray, of_copies("rows", 3)]
    """the normal n from the second side to the first; at a surface the gradient of the height"""
    gap: Annotated[np.ndarray, of_copies("rows")]
    """the gap d at the node [m], to which h u/2 is added until the step ends; `FAR` in copies without
    this contact"""
    start: Annotated[np.ndarray, of_copies("rows")]
    """the gap h₀ at the beginning of the step [m]"""
    shift: Annotated[np.ndarray, of_copies("rows")]
    """the length that is added to a gap too small to be resolved [m]; else 0"""
    share: Annotated[np.ndarray, of_copies("rows")]
    """the factor Φ, 0 to 1, by which the strength c is multiplied where edges meet"""
    place: Annotated[np.ndarray, of_copies("rows", 3)]
    """the position of the contact [m]"""
    arm: Annotated[np.ndarray, of_copies("4 arms", 3)]
    """arms from the points X of both bodies, if they turn as one, to the contact at the node, and
    to the points that touch at the end of the step [m]"""
    approach: Annotated[np.ndarray, of_copies("rows")]
    """the speed u₀ along the normal before the node [m/s]"""
    gain: Annotated[np.ndarray, of_copies("4 rows")]
    """the weight of each particle over its mass, w/m [1/kg]"""
    inverse_mass: Annotated[np.ndarray, of_copies("rows")]
    """the inverse mass W along the normal [1/kg]"""
    impulse: Annotated[np.ndarray, of_copies("rows")]
    """the impulse J along the normal [N·s]"""
    friction: Annotated[np.ndarray, of_copies("rows", 3)]
    """the impulse of friction on the first body [N·s]"""
    couple: Annotated[np.ndarray, of_copies("couples", 3)]
    """the angular impulse of the couple on the first body [N·m·s]"""
    taper: Annotated[np.ndarray, of_copies("rows", 3)]
    """the impulse of the gradient of Φ on the first body [N·s]"""
    tilt: Annotated[np.ndarray, of_copies("2 rows", 3)]
    """G and H; of a rod, G and the direction along it: see
    `springgym.dynamics.contact.friction`"""
    height: Annotated[np.ndarray, of_copies("rows")]
    """the distance along n of the points at which friction acts on both sides [m]"""
    crossed: Annotated[np.ndarray, of_copies("rows")]
    """more than 0 where two edges meet"""
    grips: Annotated[np.ndarray, of_copies("rows")]
    """1 where friction acts, else 0"""
    losses: Annotated[np.ndarray, of_copies("bodies", 3)]
    """each body's losses at this node to restitution and to friction [J]; the last column is 0"""
    going: Annotated[np.ndarray, of_copies(1)]
    """1 while the impulses of a copy are iterated, else 0"""
    change: Annotated[np.ndarray, of_copies(1)]
    """the largest change of a displacement in a sweep, divided by the Δ of its contact [1]"""
    turning: Turning | None
    """the bodies that turn as one; None if none do"""


class Problem(NamedTuple):
    """All that determines the impulses of the contacts of a node."""

    span: Times
    """the time of the node"""
    x: Rows
    """(N, 3) positions of all particles at the node, as others see them [m]"""
    before: Rows
    """velocities before the node [m/s], see `springgym.dynamics.contact.movers`"""
    inverse_mass: Numbers
    """(N,) the inverse masses of the particles [1/kg]"""
    pairs: Pairs
    """the pairs of bodies, and their parameters"""
    contacts: ContactRows
    """the contacts, with their impulses as output"""
    totals: Numbers
    """the totals of each pair, see `springgym.dynamics.contact.totals`"""


class RowSpace(NamedTuple):
    """The arrays in which a thread solves contacts; rows are of all particles.

    If a body turns as one, its first two rows are its velocity [m/s] and angular momentum [kg·m²/s].
    """

    velocity: Annotated[Rows, of_copies("rows", 3)]
    """velocities after the node, with the current impulses of contact [m/s]"""
    free: Annotated[Rows, of_copies("rows", 3)]
    """velocities after the node without contact [m/s]"""
    before: Annotated[Rows, of_copies("rows", 3)]
    """velocities before the node [m/s]"""
    places: Annotated[Rows, of_copies("rows", 3)]
    """positions at the node as contacts use them: the first particle of a ball is at its centre [m]"""
    speeds: Annotated[Rows, of_copies("rows", 3)]
    """velocities before the node as contacts use them [m/s]"""
    active: Annotated[np.ndarray, flags("bodies")]
    """whether a body has contacts in any copy"""
    rolls: Annotated[np.ndarray, flags("bodies")]
    """whether the slip of any contact of a body is measured at the end of the step"""
    lists: Neighbours | None
    """the features that are near each other; None if bodies do not collide"""
    contacts: ContactRows


class Search(NamedTuple):
    """The arrays that a search for contacts reads and writes."""

    x: Rows
    """positions (N, 3) [m]"""
    w: Rows
    """velocities (N, 3) before the node [m/s]"""
    pairs: Pairs
    lists: Neighbours
    contacts: ContactRows


class WarmStart(NamedTuple):
    """The impulses of the last node's contacts, from which the solver starts.

    Each copy of the scene has a hash table of 2ⁿ rows.
    """

    pair: np.ndarray
    """(rows,) the index of the contact's pair, plus one; 0 in an empty row"""
    first: np.ndarray
    """(rows,) the first particle of the contact, or the round feature"""
    others: np.ndarray
    """(rows,) a number made of the other ends of two edges; the surface's index; 0 for a vertex"""
    impulse: np.ndarray
    """(rows,) the impulse J along the normal [N·s]"""
    friction: np.ndarray | None
    """(rows, 3) the impulse of friction [N·s]; None if no pair has friction"""
    couple: np.ndarray | None
    """(rows, 3) the angular impulse of the couple [N·m·s]; None if no turning is resisted"""
    in_use: np.ndarray
    """(1,) 1 if the table holds the impulse of any contact, else 0"""


class PairTotal(IntEnum):
    """The totals of a pair of bodies, or of a body and the surfaces, in the order of
    `springgym.dynamics.contact.totals.PairReadings`."""

    TOUCHING = 0
    """whether the pair touches"""
    IMPULSE = 1
    """the sum of the impulses J along normals [N·s]"""
    GAP = 2
    """the least gap [m]"""
    ENERGY = 3
    """the energy in the barriers [J]"""
    CONTACT = 4
    """the loss to restitution [J]"""
    FRICTION = 5
    """the loss to friction [J]"""
    MISSES = 6
    """the number of contacts that were found too late"""
    COARSE = 7
    """the number of contacts that were too fast to keep their restitution"""
    OVERFLOW = 8
    """the number of contacts that had no space"""
    FASTEST = 9
    """the largest approach speed along the normal of any contact with an impulse [m/s]"""


PAIR_TOTALS = len(PairTotal)


class Collisions(NamedTuple):
    """Bodies that collide, with their totals and warm start."""

    pairs: Pairs
    totals: np.ndarray
    """(pairs × `PAIR_TOTALS`,) the totals of each pair, in the order of `PairTotal`"""
    stored: np.ndarray
    """(bodies,) half of the energy in the barriers of each body's pairs [J]"""
    fresh: np.ndarray
    """(1,) 1 in copies that were just placed and whose touching bodies are not found yet, else 0"""
    changing: np.ndarray
    """(1 + pairs,) the number of pairs that may touch or have energy in their barriers; these, ascending"""
    warm: WarmStart | None = None
    """the impulses of the last node; None if contacts start from nothing"""
